//! Words that 2.2.2 does not know, found by asking it: the compiler names one after the other,
//! each is taken out and told.

use roxmltree::Node;

use super::draft::Draft;
use crate::robot::text::Edits;
use crate::robot::{Error, preparse};

/// Words that a model may have taken out.
pub(super) const MOST: usize = 60;

/// Attributes that change how the robot moves, with what is lost: (attribute, what).
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

/// Takes out what an error of the compiler names, if that can be done. Gives whether it was.
pub(super) fn heal(
    draft: &mut Draft,
    error: &Error,
    path: &std::path::Path,
) -> Result<bool, Error> {
    let Error::Checked { message, .. } = error else { return Ok(false) };
    // Only muscles need the range of their lengths, and they become motors.
    if message.contains("lengthrange") || message.contains("length range") {
        let none = "<compiler><lengthrange mode=\"none\"/></compiler>";
        if draft.xml.contains(none) {
            return Ok(false);
        }
        draft.append(none, path)?;
        return Ok(true);
    }
    let quoted = |after: &str| {
        let rest = message.split_once(after)?.1;
        let rest = rest.split_once('\'')?.1;
        Some(rest.split_once('\'')?.0.to_owned())
    };
    let doc = preparse::parse(&draft.xml, path)?;
    let mut edits = Edits::default();
    let mut told = Vec::new();
    let element = quoted("Element ").unwrap_or_default();
    let is = |n: &Node<'_, '_>| n.has_tag_name(element.as_str());
    if let Some(word) = quoted("unrecognized attribute:") {
        for node in doc.descendants().filter(|n| is(n) && n.has_attribute(word.as_str())) {
            edits.unset(node, &word);
            told.push(format!("{element}/{word}"));
        }
    } else if let Some(word) = quoted("invalid keyword:") {
        for node in doc.descendants().filter(is) {
            let named = node.attributes().find(|a| a.value() == word);
            if let Some(name) = named.map(|a| a.name().to_owned()) {
                edits.unset(node, &name);
                told.push(format!("{element}/{name}=\"{word}\""));
            }
        }
    } else if let Some(word) =
        message.contains("not found in geom").then(|| quoted("material")).flatten()
    {
        for node in doc.descendants().filter(|n| n.attribute("material") == Some(word.as_str())) {
            edits.unset(node, "material");
        }
        draft.dropped.push(format!("material \"{word}\", which the file does not define"));
        let xml = edits.apply(&draft.xml);
        draft.xml = xml;
        return Ok(true);
    }
    if told.is_empty() {
        return Ok(false);
    }
    let xml = edits.apply(&draft.xml);
    drop(doc);
    draft.xml = xml;
    draft.unknown.extend(told);
    Ok(true)
}

/// What to say of an error that nothing here heals: an element that 2.2.2 does not know.
pub(super) fn hint(message: &str) -> Option<&'static str> {
    message.contains("unrecognized element").then_some(
        "; MuJoCo 2.2.2 does not know this element: take it out of the file, or write it in \
         older words",
    )
}

/// Tells what was taken out, apart by whether it changes how the robot moves.
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
