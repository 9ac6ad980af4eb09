//! Removes bodies from a model with everything that refers to them, and handles bodies that float.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use roxmltree::{Document, Node};

use super::classes::Classes;
use super::draft::Draft;
use crate::text::{Edits, blank};
use crate::{Error, preparse};

/// Sections whose entries refer to parts of bodies.
const SECTIONS: &[&str] = &["actuator", "tendon", "equality", "contact", "sensor", "deformable"];
/// The elements that an attribute can refer to.
const REFERENCES: &[(&str, &[&str])] = &[
    ("body", &["body", "body1", "body2", "bodyname", "target"]),
    ("joint", &["joint", "joint1", "joint2", "jointinparent"]),
    ("geom", &["geom", "geom1", "geom2"]),
    ("site", &["site", "site1", "site2", "refsite", "cranksite", "slidersite", "sidesite"]),
    ("tendon", &["tendon", "tendon1", "tendon2"]),
];

/// The text without these bodies.
///
/// # Errors
/// [`Error::Unfit`] for a name that no body has.
pub(super) fn without(
    mut xml: String,
    names: &[String],
    path: &Path,
    draft: &mut Draft,
) -> Result<String, Error> {
    for name in names {
        xml = without_one(&xml, name, path, draft)?;
    }
    Ok(xml)
}

fn without_one(xml: &str, name: &str, path: &Path, draft: &mut Draft) -> Result<String, Error> {
    let doc = preparse::parse(xml, path)?;
    let is = |n: &Node<'_, '_>| n.has_tag_name("body") && n.attribute("name") == Some(name);
    let Some(body) = doc.descendants().find(|n| is(n) && in_world(n)) else {
        let frame = |n: &Node<'_, '_>| {
            let name = n.attribute("name").unwrap_or_default();
            n.has_tag_name("body") && (name.starts_with("frame_") || name.starts_with("replica_"))
        };
        let top = |n: &Node<'_, '_>| n.has_tag_name("worldbody") || frame(n);
        let known: Vec<&str> = doc
            .descendants()
            .filter(|n| n.has_tag_name("body") && !frame(n) && n.parent().is_some_and(|p| top(&p)))
            .filter_map(|n| n.attribute("name"))
            .collect();
        let message = format!(
            "--without {name}: there is no such body; in the world are: {}",
            known.join(", ")
        );
        return Err(Error::Unfit { message, path: path.to_owned() });
    };
    let mut gone: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for n in body.descendants().filter(Node::is_element) {
        let kind = match n.tag_name().name() {
            "body" => "body",
            "joint" | "freejoint" => "joint",
            "geom" => "geom",
            "site" => "site",
            _ => continue,
        };
        if let Some(value) = n.attribute("name") {
            gone.entry(kind).or_default().insert(value);
        }
    }
    let mut removed: BTreeSet<usize> = BTreeSet::new();
    let mut edits = Edits::default();
    edits.replace(body.range(), blank(xml, body));
    // A removed tendon's motor is removed with it.
    loop {
        let before = removed.len();
        for entry in doc.descendants().filter(is_entry) {
            if removed.contains(&entry.range().start) {
                continue;
            }
            let refers = |n: Node<'_, '_>| {
                REFERENCES.iter().any(|(kind, attributes)| {
                    let gone = gone.get(kind);
                    attributes.iter().any(|a| {
                        n.attribute(*a).is_some_and(|v| gone.is_some_and(|g| g.contains(v)))
                    })
                })
            };
            if entry.descendants().filter(Node::is_element).any(refers) {
                removed.insert(entry.range().start);
                edits.replace(entry.range(), blank(xml, entry));
                let tendon = entry.parent().is_some_and(|p| p.has_tag_name("tendon"));
                if let Some(name) = entry.attribute("name").filter(|_| tendon) {
                    gone.entry("tendon").or_default().insert(name);
                }
            }
        }
        if removed.len() == before {
            break;
        }
    }
    // Cameras and lights that follow it.
    let looks = |n: &Node<'_, '_>| n.has_tag_name("camera") || n.has_tag_name("light");
    for node in doc.descendants().filter(looks) {
        let bodies = gone.get("body");
        if node.attribute("target").is_some_and(|t| bodies.is_some_and(|g| g.contains(t))) {
            edits.replace(node.range(), blank(xml, node));
        }
    }
    for key in doc.root_element().children().filter(|n| n.has_tag_name("keyframe")) {
        edits.replace(key.range(), blank(xml, key));
    }
    draft.dropped.push(format!(
        "body \"{name}\", {} entries that refer to it, and all keyframes, because their qpos includes it",
        removed.len()
    ));
    Ok(edits.apply(xml))
}

fn in_world(n: &Node<'_, '_>) -> bool {
    n.ancestors().any(|a| a.has_tag_name("worldbody"))
}

fn is_entry(n: &Node<'_, '_>) -> bool {
    n.is_element()
        && n.parent().is_some_and(|p| {
            SECTIONS.iter().any(|s| p.has_tag_name(*s))
                && p.parent_element().is_some_and(|r| r.has_tag_name("mujoco"))
        })
}

/// The joints that let a body float: a free joint, or the ball joint beside three slides without motors.
pub(super) fn floating<'a, 'd>(doc: &'a Document<'d>) -> Vec<Node<'a, 'd>> {
    let free = |n: &Node<'_, '_>| {
        (is_free(n) || is_base(*n)) && n.parent().is_some_and(|p| p.has_tag_name("body"))
    };
    doc.descendants().filter(free).collect()
}

/// The joints of all bodies, in the order of the file.
pub(super) fn joints<'a, 'd>(doc: &'a Document<'d>) -> impl Iterator<Item = Node<'a, 'd>> {
    let is_joint = |n: &Node<'_, '_>| {
        (n.has_tag_name("joint") || n.has_tag_name("freejoint"))
            && n.parent().is_some_and(|p| p.has_tag_name("body"))
    };
    doc.descendants().filter(is_joint)
}

/// Whether this is a free joint.
pub(super) fn is_free(n: &Node<'_, '_>) -> bool {
    n.has_tag_name("freejoint") || (n.has_tag_name("joint") && kind(n) == Some("free"))
}

/// Whether this ball joint and three slides beside it let a body float that no joint carries.
pub(super) fn is_base(ball: Node<'_, '_>) -> bool {
    let joint = |n: Node<'_, '_>| n.has_tag_name("joint");
    let above = ball.ancestors().skip(2).any(|body| body.children().any(joint));
    is_ball(&ball) && slides_beside(ball).len() == 3 && !above
}

/// The joints of each body that floats on three slides and three hinges without motors, and that neither a
/// joint carries nor a loop holds.
pub(super) fn floating_on_six<'a, 'd>(doc: &'a Document<'d>) -> Vec<Vec<Node<'a, 'd>>> {
    let joints = |body: Node<'a, 'd>| -> Vec<_> {
        body.children().filter(|n| n.has_tag_name("joint") || n.has_tag_name("freejoint")).collect()
    };
    let floats = |all: &Vec<Node<'a, 'd>>| {
        let Some(body) = all.first().and_then(Node::parent) else { return false };
        let of = |wanted: &str| all.iter().filter(|j| kind(j).unwrap_or("hinge") == wanted).count();
        all.len() == 6
            && (of("slide"), of("hinge")) == (3, 3)
            && !all.iter().any(|joint| referred(*joint))
            && !body.ancestors().skip(1).any(|above| !joints(above).is_empty())
            && !closes_a_loop(doc, all[0])
    };
    doc.descendants().filter(|n| n.has_tag_name("body")).map(joints).filter(floats).collect()
}

/// The type of a joint: its own, or that of its default class.
pub(super) fn kind<'a>(joint: &Node<'a, '_>) -> Option<&'a str> {
    let class = || Classes::of(joint.document()).get(*joint, &["joint"], "type");
    joint.attribute("type").or_else(class)
}

/// Whether this is a ball joint of a body that nothing else refers to.
pub(super) fn is_ball(n: &Node<'_, '_>) -> bool {
    let ball = n.has_tag_name("joint")
        && kind(n) == Some("ball")
        && n.parent().is_some_and(|p| p.has_tag_name("body"));
    ball && !referred(*n)
}

/// The slides of the same body that nothing refers to.
pub(super) fn slides_beside<'a, 'd>(joint: Node<'a, 'd>) -> Vec<Node<'a, 'd>> {
    let slide = |n: &Node<'_, '_>| n.has_tag_name("joint") && kind(n) == Some("slide");
    let beside = joint.parent().into_iter().flat_map(|body| body.children());
    beside.filter(|n| slide(n) && !referred(*n)).collect()
}

/// Whether a motor, tendon or constraint names this joint.
fn referred(joint: Node<'_, '_>) -> bool {
    let Some(name) = joint.attribute("name") else { return false };
    let joints = REFERENCES.iter().find(|(kind, _)| *kind == "joint").map_or(&[][..], |r| r.1);
    let names = |n: Node<'_, '_>| joints.iter().any(|a| n.attribute(*a) == Some(name));
    let sensor = |n: &Node<'_, '_>| n.parent().is_some_and(|p| p.has_tag_name("sensor"));
    let entries = joint.document().descendants().filter(|n| is_entry(n) && !sensor(n));
    entries.into_iter().any(|entry| entry.descendants().any(names))
}

/// Whether an equality constraint ties the body of this free joint, or one that it carries, to
/// another moving part of the model, as a platform is tied to its legs. Held still or left out, the
/// loop would be lost. Constraints that are switched off, and those to the world or to a mocap body,
/// which are removed, close none.
pub(super) fn closes_a_loop(doc: &Document<'_>, joint: Node<'_, '_>) -> bool {
    let Some(body) = joint.parent() else { return false };
    let carried: BTreeSet<&str> = body
        .descendants()
        .filter(|n| n.has_tag_name("body"))
        .filter_map(|n| n.attribute("name"))
        .collect();
    doc.descendants().filter(is_entry).any(|entry| {
        let ends = ["body1", "body2"].map(|end| entry.attribute(end).filter(|b| *b != "world"));
        let [Some(a), Some(b)] = ends else { return false };
        let loops = entry.has_tag_name("connect") || entry.has_tag_name("weld");
        loops && is_active(entry) && carried.contains(a) != carried.contains(b)
    })
}

/// Whether a constraint between bodies has an effect here.
fn is_active(entry: Node<'_, '_>) -> bool {
    let ends = ["body1", "body2"].into_iter().filter_map(|end| entry.attribute(end));
    entry.attribute("active") != Some("false")
        && !ends.into_iter().any(|b| is_led(entry.document(), b))
}

/// Whether this is the name of a mocap body, which nothing moves here.
pub(super) fn is_led(doc: &Document<'_>, body: &str) -> bool {
    doc.descendants().any(|n| {
        n.has_tag_name("body")
            && n.attribute("mocap") == Some("true")
            && n.attribute("name") == Some(body)
    })
}

/// The reason why a model with floating bodies is refused, and the solutions: remove loose objects,
/// or fix the robot's base.
pub(super) fn ways_out(floating: &[Node<'_, '_>]) -> String {
    let body =
        |n: &Node<'_, '_>| n.parent().and_then(|p| p.attribute("name")).unwrap_or("?").to_owned();
    let jointed = |n: &&Node<'_, '_>| {
        let own = |d: &Node<'_, '_>| d.parent() == n.parent() && is_base(**n);
        let joint =
            |d: Node<'_, '_>| d.has_tag_name("joint") && kind(&d) != Some("free") && !own(&d);
        n.parent().is_some_and(|b| b.descendants().any(joint))
    };
    let loose: Vec<String> =
        floating.iter().filter(|n| !jointed(n)).map(|n| format!("--without {}", body(n))).collect();
    let bases: Vec<String> =
        floating.iter().filter(jointed).map(|n| format!("\"{}\"", body(n))).collect();
    let mut text =
        "this body floats freely; the state takes hinge and slide joints only".to_owned();
    if !loose.is_empty() {
        text.push_str("; loose objects are left out by ");
        text.push_str(&loose.join(" "));
    }
    let held = if bases.is_empty() { "what floats".to_owned() } else { bases.join(" and ") };
    format!("{text}; to hold {held} still where it is: --fixed-base")
}
