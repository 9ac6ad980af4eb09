//! The part of a model that is attached.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;

use roxmltree::{Document, Node};

use crate::text::{Edits, escape, inner};
use crate::{Error, preparse};

/// Sections whose entries name parts of bodies.
const DEPENDENT: &[&str] = &["contact", "equality", "tendon", "actuator"];
/// Attributes by the kind of part that they name.
const KINDS: &[(&str, &[&str])] = &[
    ("body", &["body", "body1", "body2"]),
    ("joint", &["joint", "joint1", "joint2", "jointinparent"]),
    ("geom", &["geom", "geom1", "geom2"]),
    ("site", &["site", "site1", "site2", "refsite", "cranksite", "slidersite", "sidesite"]),
    ("tendon", &["tendon", "tendon1", "tendon2"]),
];

/// Which part is meant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Which {
    /// Everything in the world.
    World,
    /// A body by name.
    Body(String),
    /// A frame by name.
    Frame(String),
}

impl Which {
    pub(super) fn of(place: Node<'_, '_>) -> Which {
        match (place.attribute("body"), place.attribute("frame")) {
            (Some(body), _) => Which::Body(body.to_owned()),
            (None, Some(frame)) => Which::Frame(frame.to_owned()),
            (None, None) => Which::World,
        }
    }
}

/// Why nothing could be cut out.
pub(super) enum NoPiece {
    /// The part is not there.
    Missing(String),
    /// The text is no XML.
    Text(Error),
}

impl NoPiece {
    pub(super) fn at(self, place: Node<'_, '_>, path: &Path) -> Error {
        match self {
            NoPiece::Missing(message) => preparse::refuse(place, path, message),
            NoPiece::Text(e) => e,
        }
    }
}

/// The text of a part, and of the sections that belong to it.
pub(super) struct Piece {
    pub(super) body: String,
    pub(super) sections: String,
    /// The keyframes, if the part has every joint of its model.
    pub(super) keys: Option<String>,
    /// Whether motors, tendons or constraints belong to it.
    pub(super) has_dependents: bool,
}

impl Piece {
    /// Cuts a part out of a model whose names have the prefix already.
    pub(super) fn cut(
        xml: &str,
        path: &Path,
        which: &Which,
        prefix: &str,
        main: &str,
    ) -> Result<Piece, NoPiece> {
        let doc = preparse::parse(xml, path).map_err(NoPiece::Text)?;
        let world = || {
            let roots = doc.root_element().children().filter(|n| n.has_tag_name("worldbody"));
            roots.map(|n| inner(n, xml)).collect::<String>()
        };
        let named = |tag: &'static str, name: &str| {
            let full = format!("{prefix}{name}");
            let is = |n: &Node<'_, '_>| {
                n.has_tag_name(tag)
                    && n.attribute("name") == Some(&full)
                    && n.ancestors().any(|a| a.has_tag_name("worldbody"))
            };
            doc.descendants().find(is).ok_or_else(|| {
                NoPiece::Missing(format!(
                    "<attach> names the {tag} {name:?}, which {} does not have",
                    path.display()
                ))
            })
        };
        let (body, part) = match which {
            Which::World => (world(), None),
            Which::Body(name) if name == "world" => {
                let name = escape(&format!("{prefix}world"));
                (
                    format!(
                        "<body name=\"{name}\" childclass=\"{}\">{}</body>",
                        escape(main),
                        world()
                    ),
                    None,
                )
            }
            Which::Body(name) => {
                let node = named("body", name)?;
                (alone(node, xml, main), Some(node))
            }
            Which::Frame(name) => {
                let node = named("frame", name)?;
                (alone(node, xml, main), Some(node))
            }
        };
        let there = Parts::of(&doc, part);
        let (mut sections, mut has_dependents) = (String::new(), false);
        for section in doc.root_element().children().filter(Node::is_element) {
            let tag = section.tag_name().name();
            if DEPENDENT.contains(&tag) {
                let entries = section.children().filter(|n| n.is_element() && there.cover(*n));
                let text: String = entries.filter_map(|n| xml.get(n.range())).collect();
                has_dependents |= !text.is_empty();
                write!(sections, "<{tag}>{text}</{tag}>").ok();
            } else if tag == "asset" || tag == "default" {
                sections += xml.get(section.range()).unwrap_or_default();
            }
        }
        let joints = |n: &Node<'_, '_>| n.descendants().filter(is_joint).count();
        let complete = part.is_none_or(|p| joints(&p) == joints(&doc.root()));
        let keys = if complete { Some(keyframes(&doc, xml).map_err(NoPiece::Text)?) } else { None };
        Ok(Piece { body, sections, keys, has_dependents })
    }
}

/// The text of one body or frame, with the default class that it had in its own place.
fn alone(node: Node<'_, '_>, xml: &str, main: &str) -> String {
    let mut edits = Edits::default();
    if !node.has_attribute("childclass") {
        let class = node.ancestors().find_map(|a| a.attribute("childclass")).unwrap_or(main);
        edits.set(node, "childclass", class);
    }
    let range = node.range();
    let changed = edits.apply(xml);
    let longer = changed.len() - xml.len();
    changed.get(range.start..range.end + longer).unwrap_or_default().to_owned()
}

/// The keyframe sections, without controls and activations: the model that attaches may have other actuators.
fn keyframes(doc: &Document<'_>, xml: &str) -> Result<String, Error> {
    let mut edits = Edits::default();
    for key in doc.descendants().filter(|n| n.has_tag_name("key")) {
        ["ctrl", "act"].iter().for_each(|name| edits.unset(key, name));
    }
    let plain = edits.apply(xml);
    let doc = preparse::parse(&plain, Path::new(""))?;
    let sections = doc.root_element().children().filter(|n| n.has_tag_name("keyframe"));
    Ok(sections.filter_map(|n| plain.get(n.range())).collect())
}

pub(super) fn is_joint(node: &Node<'_, '_>) -> bool {
    (node.has_tag_name("joint") || node.has_tag_name("freejoint"))
        && node.parent().is_some_and(|p| ["body", "frame"].contains(&p.tag_name().name()))
}

/// The names of the parts that are attached, by kind.
struct Parts<'a> {
    /// `None` if all are.
    names: Option<BTreeSet<(&'static str, &'a str)>>,
}

impl<'a> Parts<'a> {
    fn of(doc: &'a Document<'_>, part: Option<Node<'a, '_>>) -> Parts<'a> {
        let Some(part) = part else { return Parts { names: None } };
        let mut parts = Parts { names: Some(BTreeSet::new()) };
        let add = |parts: &mut Parts<'a>, node: Node<'a, '_>, kind: &'static str| {
            if let (Some(names), Some(name)) = (&mut parts.names, node.attribute("name")) {
                names.insert((kind, name));
            }
        };
        for (kind, _) in KINDS {
            let is = |n: &Node<'_, '_>| {
                n.has_tag_name(*kind) || *kind == "joint" && n.has_tag_name("freejoint")
            };
            part.descendants().filter(is).for_each(|n| add(&mut parts, n, kind));
        }
        let tendons = doc.root_element().children().filter(|n| n.has_tag_name("tendon"));
        for tendon in tendons.flat_map(|s| s.children()).filter(Node::is_element) {
            if parts.cover(tendon) {
                add(&mut parts, tendon, "tendon");
            }
        }
        parts
    }

    /// Whether an entry names attached parts only.
    fn cover(&self, entry: Node<'_, '_>) -> bool {
        let Some(names) = &self.names else { return true };
        entry.descendants().flat_map(|n| n.attributes()).all(|a| {
            let kind = KINDS.iter().find(|(_, attributes)| attributes.contains(&a.name()));
            kind.is_none_or(|(kind, _)| names.contains(&(*kind, a.value())) || a.value() == "world")
        })
    }
}
