//! Joints with several axes, as slides and hinges.

use std::fmt::Write as _;

use roxmltree::{Document, Node};

use super::draft::Draft;
use super::loose::{is_ball, slides_beside};
use crate::text::{Edits, escape};

/// The axes of the hinges in place of a ball, and their names.
const TURNS: [(&str, &str); 3] = [("roll", "1 0 0"), ("pitch", "0 1 0"), ("yaw", "0 0 1")];
/// The axes of the slides in place of a free joint, and their names.
const WAYS: [(&str, &str); 3] = [("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1")];
/// What a ball has in common with a hinge.
const COMMON: &[&str] =
    &["class", "pos", "damping", "armature", "frictionloss", "stiffness", "group"];

/// Three slides and three hinges along and about the axes of the body, in place of a free joint. A
/// free joint takes nothing from default classes, so neither do they.
pub(super) fn six_joints(name: &str) -> String {
    let own = " damping=\"0\" armature=\"0\" frictionloss=\"0\" stiffness=\"0\"";
    let slides = WAYS.map(|(part, axis)| joint(name, part, "slide", axis, own));
    let hinges = TURNS.map(|(part, axis)| joint(name, part, "hinge", axis, own));
    slides.concat() + &hinges.concat()
}

fn joint(name: &str, part: &str, kind: &str, axis: &str, own: &str) -> String {
    let name = escape(name);
    format!(
        "<joint name=\"{name}_{part}\" type=\"{kind}\" axis=\"{axis}\" limited=\"false\"{own}/>"
    )
}

/// Replaces ball joints by three hinges each, except in the base of a robot that floats. Returns
/// whether there was any.
pub(super) fn balls(doc: &Document<'_>, draft: &mut Draft, edits: &mut Edits) -> bool {
    let mut names = Vec::new();
    for ball in doc.descendants().filter(|n| is_ball(n) && slides_beside(*n).len() != 3) {
        let name = ball.attribute("name").unwrap_or("ball");
        let own = own(ball);
        edits.replace(
            ball.range(),
            TURNS.map(|(p, axis)| joint(name, p, "hinge", axis, &own)).concat(),
        );
        let stop = ball.has_attribute("range") && ball.attribute("limited") != Some("false");
        names.push(if stop { format!("{name} (its stop is left out)") } else { name.to_owned() });
    }
    if !names.is_empty() {
        let names = names.join(", ");
        draft.changed.push(format!("ball joints are now three hinges each: {names}"));
    }
    !names.is_empty()
}

fn own(ball: Node<'_, '_>) -> String {
    let mut text = String::new();
    for name in COMMON {
        if let Some(value) = ball.attribute(*name) {
            write!(text, " {name}=\"{}\"", escape(value)).ok();
        }
    }
    text
}
