//! Attributes of later versions that MuJoCo 2.2.2 does not know: removes those without which the
//! model can be imported, and reports them.

use super::draft::Draft;
use crate::Error;

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

/// Changes the draft so that an error of the compiler disappears, if nothing is lost by it. Returns
/// whether it did.
pub(super) fn heal(
    draft: &mut Draft,
    error: &Error,
    path: &std::path::Path,
) -> Result<bool, Error> {
    let Error::Checked { message, .. } = error else { return Ok(false) };
    // Only muscles need the range of their lengths, and they are replaced by motors.
    let none = "<compiler><lengthrange mode=\"none\"/></compiler>";
    let ranges = message.contains("lengthrange") || message.contains("length range");
    if !ranges || draft.xml.contains(none) {
        return Ok(false);
    }
    draft.append(none, path)?;
    Ok(true)
}

/// A way to solve an error of the compiler: attributes that 2.2.2 does not know.
pub(super) fn hint(message: &str) -> Option<&'static str> {
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
