//! What the compiler of MuJoCo 2.2.2 refuses and the import can mend: attributes of later versions,
//! names that the file does not define, meshes whose faces do not agree. Everything is reported.

use std::collections::BTreeSet;
use std::path::Path;

use roxmltree::Node;

use super::classes::Classes;
use super::draft::Draft;
use super::words::ACTUATORS;
use crate::text::{Edits, escape};
use crate::{Error, mesh, preparse};

/// Attributes that change how the robot moves, with the lost effect: (attribute, effect).
const PHYSICS: &[(&str, &str)] = &[
    ("gravcomp", "gravity is not compensated here"),
    ("actuatorgravcomp", "gravity is not compensated here"),
    ("actuatorfrcrange", "no limit on the force of tendons"),
    ("timeconst", "the servo answers without delay"),
    ("actdim", "actuators have no dynamics of their own"),
    ("actearly", "controls act a time step later"),
    ("delay", "controls act without delay"),
    ("armature", "tendons have no inertia of their own"),
];

/// Changes the draft so that an error of the compiler disappears, if little is lost by it. Returns
/// whether it did.
pub(super) fn heal(draft: &mut Draft, error: &Error, path: &Path) -> Result<bool, Error> {
    let Error::Checked { message, .. } = error else { return Ok(false) };
    // Only muscles need the range of their lengths, and they are replaced by motors.
    let none = "<compiler><lengthrange mode=\"none\"/></compiler>";
    let ranges = ["lengthrange", "length range", "Lengthrange computation"];
    let ranges = ranges.iter().any(|words| message.contains(words));
    if ranges && !draft.xml.contains(none) {
        draft.append(none, path)?;
        return Ok(true);
    }
    if message.contains("stateless actuators must come before stateful actuators") {
        return stateless_first(draft, path);
    }
    if let Some((_, rest)) = message.split_once("material '")
        && let Some((name, _)) = rest.split_once("' not found")
    {
        return material(draft, name, path);
    }
    // "… class" or "… childclass".
    if message.contains("unknown default c") {
        return classes(draft, path);
    }
    for kind in ["light", "camera"] {
        if let Some((_, rest)) = message.split_once(&format!("parent-targeting in {kind} '"))
            && let Some((name, _)) = rest.split_once('\'')
        {
            return still(draft, kind, name, path);
        }
    }
    if let Some((_, rest)) = message.split_once("faces have inconsistent orientation: ") {
        return faces(draft, rest.split(';').next().unwrap_or(rest), path);
    }
    if let Some((_, rest)) = message.split_once("qhull error; Object name = ") {
        return hull(draft, rest.split(',').next().unwrap_or(rest), path);
    }
    Ok(false)
}

/// Puts actuators with dynamics behind the others. Later versions of MuJoCo allow any order.
fn stateless_first(draft: &mut Draft, path: &Path) -> Result<bool, Error> {
    let doc = preparse::parse(&draft.xml, path)?;
    let classes = Classes::of(&doc);
    let sections = doc.root_element().children().filter(|n| n.has_tag_name("actuator"));
    let all: Vec<Node<'_, '_>> =
        sections.flat_map(|s| s.children().filter(Node::is_element)).collect();
    let stateful = |at: &usize| {
        let node = all[*at];
        let tag = node.tag_name().name();
        let dynamics = || classes.get(node, ACTUATORS, "dyntype").is_some_and(|d| d != "none");
        ["muscle", "cylinder", "intvelocity"].contains(&tag) || tag == "general" && dynamics()
    };
    let mut order: Vec<usize> = (0..all.len()).collect();
    order.sort_by_key(stateful);
    if order.is_sorted() {
        return Ok(false);
    }
    let mut edits = Edits::default();
    for (node, from) in all.iter().zip(&order) {
        edits.replace(node.range(), draft.xml.get(all[*from].range()).unwrap_or_default());
    }
    let xml = edits.apply(&draft.xml);
    let servos = &draft.words.servos;
    draft.words.servos =
        order.iter().map(|at| servos.get(*at).copied().unwrap_or_default()).collect();
    draft.changed.push(
        "actuators with dynamics (muscles, cylinders, filters) come last in the action".to_owned(),
    );
    draft.xml = xml;
    Ok(true)
}

/// Takes the target from a light or camera that looks at its own body, which 2.2.2 refuses.
fn still(draft: &mut Draft, kind: &str, name: &str, path: &Path) -> Result<bool, Error> {
    let doc = preparse::parse(&draft.xml, path)?;
    let is = |n: &Node<'_, '_>| n.has_tag_name(kind) && n.attribute("name") == Some(name);
    let Some(node) = doc.descendants().find(|n| is(n) && n.has_attribute("target")) else {
        return Ok(false);
    };
    let mut edits = Edits::default();
    ["target", "mode"].iter().for_each(|attribute| edits.unset(node, attribute));
    let xml = edits.apply(&draft.xml);
    drop(doc);
    draft.xml = xml;
    draft.dropped.push(format!("target of {kind} \"{name}\": its own body"));
    Ok(true)
}

/// Adds a material that the file uses and does not define; it has no colour of its own.
fn material(draft: &mut Draft, name: &str, path: &Path) -> Result<bool, Error> {
    let line = format!("material \"{name}\" is not in the file: what has it keeps its own colour");
    if draft.changed.contains(&line) {
        return Ok(false);
    }
    draft.append(&format!("<asset><material name=\"{}\"/></asset>", escape(name)), path)?;
    draft.changed.push(line);
    Ok(true)
}

/// Adds the default classes that the file uses and does not define: a part of a model that other
/// files complete has such classes. The missing classes may change joints, so a warning is given.
fn classes(draft: &mut Draft, path: &Path) -> Result<bool, Error> {
    let doc = preparse::parse(&draft.xml, path)?;
    let is_default = |n: &Node<'_, '_>| n.has_tag_name("default");
    let defined: BTreeSet<&str> =
        doc.descendants().filter(is_default).filter_map(|n| n.attribute("class")).collect();
    let used = doc.descendants().filter(|n| !is_default(n));
    let missing: BTreeSet<&str> = used
        .flat_map(|n| [n.attribute("class"), n.attribute("childclass")])
        .flatten()
        .filter(|c| !defined.contains(c) && *c != "main")
        .collect();
    if missing.is_empty() {
        return Ok(false);
    }
    let class = |c: &&str| format!("<default class=\"{}\"/>", escape(c));
    let section = format!("<default>{}</default>", missing.iter().map(class).collect::<String>());
    let names: Vec<String> = missing.iter().map(|c| format!("\"{c}\"")).collect();
    let line = format!(
        "default classes that the file does not define say nothing here: {}; if another file \
         defines them (damping, armature, limits), import a model that includes both",
        names.join(", ")
    );
    drop(doc);
    draft.append(&section, path)?;
    draft.warnings.push(line);
    Ok(true)
}

/// Separates the faces of a mesh that do not agree on inside and outside. Its volume becomes the
/// sum of what the faces span, whatever their sign: MuJoCo 3 reads it so by default.
fn faces(draft: &mut Draft, name: &str, path: &Path) -> Result<bool, Error> {
    let why = "its faces do not agree on inside and outside; if it weighs anything, its mass and \
               inertia are estimates";
    rewrite(draft, name, path, mesh::separate_faces, why)
}

/// Moves the points of a mesh a little, where the simulator finds no convex hull of many points in
/// one plane or on one circle.
fn hull(draft: &mut Draft, name: &str, path: &Path) -> Result<bool, Error> {
    let why = "its points were moved by up to a millionth of its size, because the simulator found \
               no convex hull of them";
    rewrite(draft, name, path, mesh::nudged, why)
}

/// Replaces the file of a mesh by what `new` makes of it, once, and warns.
fn rewrite(
    draft: &mut Draft,
    name: &str,
    path: &Path,
    new: fn(&str, &[u8]) -> Option<Vec<u8>>,
    why: &'static str,
) -> Result<bool, Error> {
    let doc = preparse::parse(&draft.xml, path)?;
    let is = |n: &Node<'_, '_>| n.has_tag_name("mesh") && n.attribute("name") == Some(name);
    let Some(file) = doc.descendants().find(is).and_then(|n| n.attribute("file")) else {
        return Ok(false);
    };
    let line = format!("mesh {file}: {why}");
    let known = draft.assets.iter().find(|(n, _)| n == file);
    let Some(bytes) = known.and_then(|(n, bytes)| new(n, bytes)) else {
        return Ok(false);
    };
    let file = file.to_owned();
    drop(doc);
    if !draft.rewritten.insert((name.to_owned(), why)) {
        return Ok(false);
    }
    let kind = mesh::extension(Path::new(&file));
    let new = draft.add(Path::new(&file), &kind, bytes)?;
    let doc = preparse::parse(&draft.xml, path)?;
    let mut edits = Edits::default();
    doc.descendants()
        .filter(|n| n.has_tag_name("mesh") && n.attribute("file") == Some(&file))
        .for_each(|n| edits.set(n, "file", &new));
    let xml = edits.apply(&draft.xml);
    drop(doc);
    draft.xml = xml;
    draft.assets.retain(|(n, _)| *n != file);
    draft.warnings.push(line);
    Ok(true)
}

/// A way to solve an error of the compiler: attributes that 2.2.2 does not know.
pub(super) fn hint(message: &str) -> Option<&'static str> {
    if message.contains("inconsistent orientation") {
        return Some("; turn the faces outwards and save the mesh as OBJ or STL");
    }
    if message.contains("qhull error") {
        return Some(
            "; no convex hull of this mesh was found: give the shape some thickness, or a simpler mesh",
        );
    }
    // Words that every version knows, in a place where they may not stand.
    let parts = ["body", "joint", "freejoint", "geom", "site", "inertial", "camera", "light"];
    let is_part = |part: &&str| message.contains(&format!("Element '{part}'"));
    if message.contains("unrecognized element") && parts.iter().any(is_part) {
        return Some(
            "; this element may not stand here: if the file is a part of a scene, import the file that includes it",
        );
    }
    let words = ["unrecognized attribute", "unrecognized element", "invalid keyword"];
    words.iter().any(|w| message.contains(w)).then_some(
        "; MuJoCo 2.2.2 does not know this: a typing error, or a word of a later version; take \
         it out of the file at this line or write it in older words",
    )
}

/// Reports the removed elements and attributes; those that change the motion are listed apart.
pub(super) fn tell(draft: &mut Draft) {
    let attribute = |word: &str| {
        let name = word.split_once('/').map_or(word, |(_, a)| a);
        name.split_once('=').map_or(name, |(a, _)| a).to_owned()
    };
    let loss = |word: &str| PHYSICS.iter().find(|(a, _)| *a == attribute(word)).map(|(_, l)| *l);
    let (physics, rest): (Vec<&String>, Vec<&String>) =
        draft.unknown.iter().partition(|w| loss(w).is_some());
    let lost: Vec<String> =
        physics.iter().map(|w| format!("{w} ({})", loss(w).unwrap_or_default())).collect();
    let rest: Vec<&str> = rest.into_iter().map(String::as_str).collect();
    if !rest.is_empty() {
        draft
            .dropped
            .push(format!("attributes that MuJoCo 2.2.2 does not know: {}", rest.join(", ")));
    }
    if !lost.is_empty() {
        draft.dropped.push(format!("attributes that change how it moves: {}", lost.join(", ")));
    }
}
