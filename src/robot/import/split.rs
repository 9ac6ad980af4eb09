//! Joints with several axes, as slides and hinges.

use std::fmt::Write as _;

use roxmltree::{Document, Node};

use super::classes::Classes;
use super::draft::Draft;
use super::loose::{is_ball, is_base};
use crate::text::{Edits, blank, escape};

/// The axes of the hinges in place of a ball, and their names.
const TURNS: [(&str, &str); 3] = [("roll", "1 0 0"), ("pitch", "0 1 0"), ("yaw", "0 0 1")];
/// The axes of the slides in place of a free joint, and their names.
const WAYS: [(&str, &str); 3] = [("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1")];
/// What these joints have in common with a hinge.
const COMMON: &[&str] = &[
    "class",
    "pos",
    "damping",
    "armature",
    "frictionloss",
    "stiffness",
    "group",
    "springdamper",
    "solreffriction",
    "solimpfriction",
];

/// Replaces a free joint by three slides and three hinges along and about the axes of the body.
pub(super) fn six_joints(doc: &Document<'_>, free: Node<'_, '_>, draft: &mut Draft) -> String {
    // A <freejoint> takes nothing from default classes.
    let own = if free.has_tag_name("freejoint") {
        " damping=\"0\" armature=\"0\" frictionloss=\"0\" stiffness=\"0\"".to_owned()
    } else {
        own(free)
    };
    let parts: Vec<_> =
        WAYS.map(|way| ("slide", way)).into_iter().chain(TURNS.map(|t| ("hinge", t))).collect();
    parts_of(doc, free, &parts, &own, draft)
}

/// Joints for these (kind, (part, axis)), on the lines of the joint that they replace.
fn parts_of(
    doc: &Document<'_>,
    joint: Node<'_, '_>,
    parts: &[(&str, (&str, &str))],
    own: &str,
    draft: &mut Draft,
) -> String {
    let mut name = joint.attribute("name").unwrap_or("joint").to_owned();
    let taken = |name: &str| {
        let is = |part: &str| format!("{name}_{part}");
        let names: Vec<String> = parts.iter().map(|(_, (part, _))| is(part)).collect();
        doc.descendants().any(|n| n.attribute("name").is_some_and(|n| names.iter().any(|m| m == n)))
    };
    while taken(&name) {
        name.push('_');
    }
    let mut text = String::new();
    for (kind, (part, axis)) in parts {
        let name = format!("{name}_{part}");
        let shown = escape(&name);
        write!(
            text,
            "<joint name=\"{shown}\" type=\"{kind}\" axis=\"{axis}\" limited=\"false\"{own}/>"
        )
        .ok();
        draft.split.insert(name);
    }
    text + &blank(doc.input_text(), joint)
}

/// Replaces ball joints by three hinges each, except those that are welded and those in the base of a
/// robot that floats. Returns whether there was any.
pub(super) fn balls(
    doc: &Document<'_>,
    welded: &[String],
    draft: &mut Draft,
    edits: &mut Edits,
) -> bool {
    let (mut names, classes) = (Vec::new(), Classes::of(doc));
    for ball in doc.descendants().filter(|n| is_ball(n) && !is_base(*n)) {
        let name = ball.attribute("name").unwrap_or("ball");
        if welded.iter().any(|w| w == name) {
            continue;
        }
        let hinges = TURNS.map(|turn| ("hinge", turn));
        edits.replace(ball.range(), parts_of(doc, ball, &hinges, &own(ball), draft));
        let given = |attribute| classes.get(ball, &["joint"], attribute);
        let stop = given("range").is_some() && given("limited") != Some("false");
        names.push(if stop { format!("{name} (its stop is left out)") } else { name.to_owned() });
    }
    if !names.is_empty() {
        let names = names.join(", ");
        draft.changed.push(format!("ball joints are now three hinges each: {names}"));
    }
    !names.is_empty()
}

/// The attributes that a hinge has as well.
fn own(joint: Node<'_, '_>) -> String {
    let mut text = String::new();
    for name in COMMON {
        if let Some(value) = joint.attribute(*name) {
            write!(text, " {name}=\"{}\"", escape(value)).ok();
        }
    }
    text
}
