//! A foreign MJCF as a draft: files get plain names, every part gets a name, and attributes of
//! later `MuJoCo` versions are removed if nothing depends on them.

use std::collections::BTreeSet;

use roxmltree::{Document, Node};

use super::config::ImportConfig;
use super::draft::{ASSET_DIR, Draft, physics};
use super::loose;
use super::modern;
use super::sites;
use super::split;
use super::words::Words;
use crate::text::{Edits, blank};
use crate::{Error, mesh, preparse, text};

/// Attributes of later versions (or of tools) that 2.2.2 does not know and that have no effect
/// here: (element, attribute).
const UNKNOWN: &[(&str, &str)] = &[
    ("camera", "focal"),
    ("camera", "focalpixel"),
    ("camera", "orthographic"),
    ("camera", "output"),
    ("camera", "principal"),
    ("camera", "principalpixel"),
    ("camera", "projection"),
    ("camera", "resolution"),
    ("camera", "sensorsize"),
    ("light", "bulbradius"),
    ("light", "intensity"),
    ("light", "range"),
    ("light", "texture"),
    ("light", "type"),
    ("default", "group"),
    ("fixed", "actuatorfrclimited"),
    ("fixed", "actuatorfrcrange"),
    ("fixed", "armature"),
    ("spatial", "actuatorfrclimited"),
    ("spatial", "actuatorfrcrange"),
    ("spatial", "armature"),
    ("tendon", "actuatorfrclimited"),
    ("tendon", "actuatorfrcrange"),
    ("tendon", "armature"),
    ("general", "actdim"),
    ("general", "actearly"),
    ("general", "delay"),
    ("general", "interp"),
    ("general", "nsample"),
    ("position", "actearly"),
    ("position", "delay"),
    ("position", "interp"),
    ("position", "nsample"),
    ("position", "timeconst"),
    ("motor", "delay"),
    ("motor", "interp"),
    ("motor", "nsample"),
    ("velocity", "delay"),
    ("velocity", "interp"),
    ("velocity", "nsample"),
    ("intvelocity", "actearly"),
    ("joint", "actuatorgravcomp"),
    ("flag", "invdiscrete"),
    ("flag", "sleep"),
    ("option", "sleep_tolerance"),
    ("compiler", "fitaabb"),
    ("option", "actuatorgroupdisable"),
    ("option", "ccd_iterations"),
    ("option", "ccd_tolerance"),
    ("option", "ls_iterations"),
    ("option", "ls_tolerance"),
    ("option", "sdf_initpoints"),
    ("option", "sdf_iterations"),
    ("flag", "autoreset"),
    ("flag", "eulerdamp"),
    ("flag", "island"),
    ("flag", "midphase"),
    ("flag", "multiccd"),
    ("flag", "nativeccd"),
    ("compiler", "alignfree"),
    ("compiler", "assetdir"),
    ("compiler", "saveinertial"),
    ("size", "memory"),
    ("material", "metallic"),
    ("material", "roughness"),
    ("mesh", "content_type"),
    ("mesh", "inertia"),
    ("mesh", "maxhullvert"),
    ("mesh", "octree_maxdepth"),
    ("texture", "colorspace"),
    ("texture", "content_type"),
    ("texture", "nchannel"),
    ("hfield", "content_type"),
    ("joint", "actuatorfrclimited"),
    ("joint", "actuatorfrcrange"),
    ("freejoint", "align"),
    ("body", "gravcomp"),
    ("body", "sleep"),
    ("position", "dampratio"),
    ("position", "inheritrange"),
    ("position", "kv"),
];

/// Attributes of the list above that [`Words`] keeps, so that nothing is lost.
const KEPT: &[&str] =
    &["actuatorfrclimited", "actuatorfrcrange", "gravcomp", "dampratio", "inheritrange", "kv"];

/// Sections that are not needed for the simulation of a robot.
const UNUSED: &[&str] = &["visual", "sensor", "statistic"];

pub(super) fn draft(project: &preparse::Project, config: &ImportConfig) -> Result<Draft, Error> {
    let path = &project.path;
    let mut draft = Draft { title: title(project), ..Draft::default() };
    if config.base_height_m != 0.0 {
        let message = "--base-height is for URDF; an MJCF places its own base".to_owned();
        return Err(Error::Unfit { message, path: path.clone() });
    }
    let named = plain(project, config, &mut draft)?;
    let doc = preparse::parse(&named, path)?;
    let mut edits = Edits::default();
    draft.words = Words::of(&doc, path)?;
    for node in doc.descendants().filter(Node::is_element) {
        attributes(node, &mut edits, &mut draft.unknown);
    }
    // It says how long to look for the lengths of muscles, which are replaced by motors.
    for node in doc.descendants().filter(|n| n.has_tag_name("lengthrange")) {
        edits.replace(node.range(), "");
    }
    for section in doc.root_element().children().filter(Node::is_element) {
        let tag = section.tag_name().name();
        if UNUSED.contains(&tag) {
            edits.replace(section.range(), blank(&named, section));
            if tag == "sensor" {
                once(&mut draft.dropped, "sensors: the state is the joint positions");
            }
        }
    }
    adhesion(&doc, &mut draft, &mut edits);
    mocap(&doc, &mut draft, &mut edits);
    files(&doc, project, &mut draft, &mut edits)?;
    let loosened = free_base(&doc, path, config, &mut draft, &mut edits)?;
    let split = split::balls(&doc, &config.weld, &mut draft, &mut edits);
    weld(&doc, path, config, &mut draft, &mut edits)?;
    let other = loosened == Loosened::Others || split || !config.weld.is_empty();
    for key in doc.root_element().children().filter(|n| n.has_tag_name("keyframe")) {
        let first = !other && loosened == Loosened::First;
        let held = first && held_keys(&doc, key, &mut draft, &mut edits);
        if !held && (other || loosened != Loosened::Nothing) {
            edits.replace(key.range(), blank(&named, key));
            once(&mut draft.dropped, "keyframes: their qpos counts the joints that were replaced");
        }
    }
    let limits = autolimits(&doc);
    draft.xml = edits.apply(&named);
    drop(doc);
    draft.changed.push(
        "physics: time step 0.005 s, Euler, pyramidal friction cone, 20 Hz control".to_owned(),
    );
    let dirs = format!(
        "<compiler meshdir=\"{ASSET_DIR}\" texturedir=\"{ASSET_DIR}\" strippath=\"false\"{limits}/>{}{}",
        physics(),
        weightless(&mut draft)
    );
    draft.append(&dirs, path)?;
    Ok(draft)
}

/// The text for MuJoCo 2.2.2, with a name on every part, without the removed sections.
fn plain(
    project: &preparse::Project,
    config: &ImportConfig,
    draft: &mut Draft,
) -> Result<String, Error> {
    let path = &project.path;
    let (flat, said) = modern::flatten(project.xml.clone(), path, "")?;
    draft.changed.extend(said);
    let doc = preparse::parse(&flat, path)?;
    let mut edits = Edits::default();
    names(&doc, draft, &mut edits);
    let named = edits.apply(&flat);
    drop(doc);
    let named = sites::to_bodies(&named, path, draft)?;
    loose::without(named, &config.without, path, draft)
}

/// Switches gravity off if the source compensates it for every moving body.
fn weightless(draft: &mut Draft) -> &'static str {
    let Words { moving, weightless, .. } = draft.words;
    if weightless == 0 {
        return "";
    }
    if weightless == moving {
        draft
            .changed
            .push("gravity is off: the source compensates it on every body (gravcomp)".into());
        return "<option gravity=\"0 0 0\"/>";
    }
    draft.dropped.push(format!(
        "gravcomp: the source compensates the gravity of {weightless} of {moving} moving bodies, \
         here the motors carry it"
    ));
    ""
}

/// Removes suction actuators: suction acts on bodies and not on joints, and its elements may lack
/// attributes that 2.2.2 requires.
fn adhesion(doc: &Document<'_>, draft: &mut Draft, edits: &mut Edits) {
    let is = |n: &Node<'_, '_>| {
        n.has_tag_name("adhesion")
            && n.parent().is_some_and(|p| p.has_tag_name("actuator") || p.has_tag_name("default"))
    };
    let mut count = 0;
    for node in doc.descendants().filter(is) {
        edits.replace(node.range(), "");
        count += usize::from(node.parent().is_some_and(|p| p.has_tag_name("actuator")));
    }
    if count > 0 {
        draft
            .dropped
            .push(format!("{count} adhesion actuators: they pull at bodies, not at joints"));
    }
}

fn title(project: &preparse::Project) -> String {
    let named = preparse::parse(&project.xml, &project.path)
        .ok()
        .and_then(|d| d.root_element().attribute("model").map(str::to_owned));
    named.unwrap_or_else(|| {
        project.path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default()
    })
}

fn attributes(node: Node<'_, '_>, edits: &mut Edits, removed: &mut BTreeSet<String>) {
    let tag = node.tag_name().name();
    for (element, attribute) in UNKNOWN {
        if *element == tag && node.has_attribute(*attribute) {
            edits.unset(node, attribute);
            if !KEPT.contains(attribute) {
                removed.insert(format!("{tag}/{attribute}"));
            }
        }
    }
    // MuJoCo 4 writes what kind of servo the gains make.
    if tag == "general" && node.attribute("input") == Some("pos") {
        edits.unset(node, "input");
    }
    if tag == "option" && matches!(node.attribute("integrator"), Some("implicitfast")) {
        edits.unset(node, "integrator");
    }
}

/// Removes welds to mocap bodies. Nothing moves these bodies here, so the welds would hold the
/// robot in place.
fn mocap(doc: &Document<'_>, draft: &mut Draft, edits: &mut Edits) {
    let led: BTreeSet<&str> = doc
        .descendants()
        .filter(|n| n.has_tag_name("body") && n.attribute("mocap") == Some("true"))
        .filter_map(|n| n.attribute("name"))
        .collect();
    let sections = doc.root_element().children().filter(|n| n.has_tag_name("equality"));
    let mut count = 0;
    for tie in sections.flat_map(|s| s.children().filter(Node::is_element)) {
        let ends = ["body1", "body2"].map(|a| tie.attribute(a));
        if ends.into_iter().flatten().any(|b| led.contains(b)) {
            edits.replace(tie.range(), "");
            count += 1;
        }
    }
    if count > 0 {
        draft.dropped.push(format!("{count} ties to mocap bodies, which would hold the robot"));
    }
}

/// Gives every referenced file its new plain name.
fn files(
    doc: &Document<'_>,
    project: &preparse::Project,
    draft: &mut Draft,
    edits: &mut Edits,
) -> Result<(), Error> {
    let path = &project.path;
    let dirs = preparse::AssetDirs::of(doc);
    for node in doc.descendants().filter(Node::is_element) {
        let tag = node.tag_name().name();
        for a in node.attributes().filter(|a| preparse::names_file(tag, a.name())) {
            let below = dirs.path(tag, a.value());
            let Some(found) = project.assets.iter().find(|r| r.written == below) else {
                return Err(preparse::refuse(node, path, format!("\"{below}\" was not found")));
            };
            let name = draft.take(&found.path)?;
            edits.replace(a.range_value(), text::escape(&name));
            // A mesh without a name gets the name of its file, which other elements use.
            let implied = a.name() == "file" && !node.has_attribute("name");
            if implied && matches!(tag, "mesh" | "hfield" | "texture") {
                let stem = preparse::stem(a.value());
                edits.set(node, "name", &stem);
            }
            if mesh::extension(&found.path) == "msh" {
                draft.assumed.push(format!("{name}: binary mesh taken as it is"));
            }
        }
    }
    Ok(())
}

/// Gives names to bodies, for contact excludes, and to joints, for the profile.
fn names(doc: &Document<'_>, draft: &mut Draft, edits: &mut Edits) {
    let taken: BTreeSet<&str> = doc.descendants().filter_map(|n| n.attribute("name")).collect();
    let in_world = |n: &Node<'_, '_>| n.ancestors().any(|a| a.has_tag_name("worldbody"));
    let fresh = |stem: &str, n: &mut usize| loop {
        let name = format!("{stem}_{n}");
        *n += 1;
        if !taken.contains(name.as_str()) {
            return name;
        }
    };
    let (mut bodies, mut joints) = (0, 0);
    for node in doc.descendants().filter(in_world) {
        let tag = node.tag_name().name();
        if node.has_attribute("name") {
            continue;
        }
        if tag == "body" {
            let name = fresh("body", &mut bodies);
            edits.set(node, "name", &name);
        } else if tag == "joint" || tag == "freejoint" {
            let name = fresh("joint", &mut joints);
            edits.set(node, "name", &name);
        }
    }
    if joints > 0 {
        draft.changed.push(format!("{joints} nameless joints were given names"));
    }
}

/// The joints that [`free_base`] removed or replaced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Loosened {
    Nothing,
    /// The free joint whose seven coordinates are the first of every qpos.
    First,
    Others,
}

/// The coordinates of a free joint in qpos and qvel.
const FREE: [(&str, usize); 2] = [("qpos", 7), ("qvel", 6)];

/// Takes the coordinates of the free joint at their beginning from the keyframes of a section; false, and nothing
/// is edited, if they have another number of coordinates than the model's hinges and slides need.
fn held_keys(
    doc: &Document<'_>,
    section: Node<'_, '_>,
    draft: &mut Draft,
    edits: &mut Edits,
) -> bool {
    let joints: Vec<_> = loose::joints(doc).collect();
    if joints
        .iter()
        .any(|j| loose::is_free(j) != (*j == joints[0]) || loose::kind(j) == Some("ball"))
    {
        return false;
    }
    let mut kept = Vec::new();
    for key in section.children().filter(|n| n.has_tag_name("key")) {
        for (attribute, free) in FREE {
            let Some(text) = key.attribute(attribute) else { continue };
            let numbers: Vec<&str> = text.split_whitespace().collect();
            if numbers.len() != free + joints.len() - 1 {
                return false;
            }
            kept.push((key, attribute, numbers[free..].join(" ")));
        }
    }
    if !kept.is_empty() {
        once(&mut draft.changed, "keyframes: without the place of the base");
    }
    kept.iter().for_each(|(key, attribute, numbers)| edits.set(*key, attribute, numbers));
    true
}

/// Replaces free joints of bodies that close a loop, and removes the others if this was requested;
/// otherwise those are an error. Slides and hinges on which a body floats are removed likewise, or warned
/// about. Returns which coordinates are others now.
fn free_base(
    doc: &Document<'_>,
    path: &std::path::Path,
    config: &ImportConfig,
    draft: &mut Draft,
    edits: &mut Edits,
) -> Result<Loosened, Error> {
    let (tied, loose): (Vec<_>, Vec<_>) = loose::floating(doc)
        .into_iter()
        .partition(|joint| !config.fixed_base && loose::closes_a_loop(doc, *joint));
    if let Some(first) = loose.first()
        && !config.fixed_base
    {
        return Err(preparse::refuse(*first, path, loose::ways_out(&loose)));
    }
    let six = loose::floating_on_six(doc);
    let six_go = config.fixed_base && !six.is_empty();
    let loosened = match loose.as_slice() {
        [] if tied.is_empty() && !six_go => Loosened::Nothing,
        [one] if tied.is_empty() && !six_go && loose::joints(doc).next() == Some(*one) => {
            Loosened::First
        }
        _ => Loosened::Others,
    };
    let body = |joint: &Node<'_, '_>| {
        joint.parent().and_then(|p| p.attribute("name")).unwrap_or("a body").to_owned()
    };
    for joints in six {
        let name = body(&joints[0]);
        if config.fixed_base {
            joints.iter().for_each(|joint| edits.replace(joint.range(), ""));
            draft.changed.push(format!("\"{name}\" no longer floats: held where it is"));
        } else {
            draft.warnings.push(format!(
                "\"{name}\" floats on three slides and three hinges without motors, so it falls; --fixed-base \
                 holds it still"
            ));
        }
    }
    for joint in tied.iter().chain(&loose).filter(|joint| loose::is_ball(joint)) {
        loose::slides_beside(*joint).iter().for_each(|s| edits.replace(s.range(), ""));
    }
    for joint in loose {
        edits.replace(joint.range(), "");
        draft.changed.push(format!("\"{}\" no longer floats: held where it is", body(&joint)));
    }
    for joint in tied {
        edits.replace(joint.range(), split::six_joints(doc, joint, draft));
        draft.changed.push(format!(
            "\"{}\" floats and closes a loop: it now has three slides and three hinges",
            body(&joint)
        ));
    }
    Ok(loosened)
}

fn weld(
    doc: &Document<'_>,
    path: &std::path::Path,
    config: &ImportConfig,
    draft: &mut Draft,
    edits: &mut Edits,
) -> Result<(), Error> {
    for name in &config.weld {
        let is = |n: &Node<'_, '_>| {
            n.has_tag_name("joint")
                && n.attribute("name") == Some(name)
                && n.parent().is_some_and(|p| p.has_tag_name("body"))
        };
        let Some(joint) = doc.descendants().find(is) else {
            let message = format!("--weld {name}: there is no such joint");
            return Err(Error::Unfit { message, path: path.to_owned() });
        };
        edits.replace(joint.range(), "");
        draft.changed.push(format!("joint \"{name}\" is welded at its zero"));
        // Actuators and constraints of a removed joint are removed with it.
        for node in doc.descendants().filter(Node::is_element) {
            let parent = node.parent().map_or("", |p| p.tag_name().name());
            let tied = matches!(parent, "actuator" | "equality" | "fixed");
            let names =
                ["joint", "joint1", "joint2"].iter().any(|a| node.attribute(*a) == Some(name));
            if tied && names {
                edits.replace(node.range(), "");
                draft
                    .dropped
                    .push(format!("<{}> of the welded joint \"{name}\"", node.tag_name().name()));
            }
        }
    }
    Ok(())
}

/// Adds a line unless it is there: a file may have several sections of one kind.
fn once(lines: &mut Vec<String>, line: &str) {
    if !lines.iter().any(|there| there == line) {
        lines.push(line.to_owned());
    }
}

/// Later versions infer a limit from a range. 2.2.2 refuses a range without "limited", so adding
/// the attribute changes no model that it accepts.
fn autolimits(doc: &Document<'_>) -> &'static str {
    let said =
        doc.descendants().any(|n| n.has_tag_name("compiler") && n.has_attribute("autolimits"));
    if said { "" } else { " autolimits=\"true\"" }
}
