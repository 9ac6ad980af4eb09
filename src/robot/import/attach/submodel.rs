//! A model in the terms of the model that attaches it: names, default classes, angles, files.

use std::path::{Path, PathBuf};

use roxmltree::{Document, Node};

use super::angles::Angles;
use crate::import::classes::Classes;
use crate::text::{Edits, compiler, escape, inner, insert_first};
use crate::{Error, preparse};
use robert_base::xml::numbers;

/// Attributes that name a part of the model.
const NAMES: &[&str] = &[
    "name",
    "class",
    "childclass",
    "actuator",
    "body",
    "body1",
    "body2",
    "cranksite",
    "geom",
    "geom1",
    "geom2",
    "hfield",
    "joint",
    "joint1",
    "joint2",
    "jointinparent",
    "material",
    "mesh",
    "refsite",
    "sidesite",
    "site",
    "site1",
    "site2",
    "slidersite",
    "target",
    "tendon",
    "tendon1",
    "tendon2",
    "texture",
];
/// Sections whose words are no names of parts.
const WITHOUT_NAMES: &[&str] =
    &["compiler", "custom", "extension", "option", "size", "statistic", "visual"];
/// Elements outside of the worldbody that may have a default class, by section.
const CLASSED: &[&str] = &["actuator", "contact", "equality", "tendon"];
/// Elements of the worldbody that may have a default class.
const CLASSED_PARTS: &[&str] = &["geom", "site", "camera", "light"];

/// The terms of the other model.
pub(super) struct Terms<'a> {
    /// In front of every name.
    pub(super) prefix: &'a str,
    /// The name of the outermost default class here; `None` leaves it the outermost.
    pub(super) main: Option<&'a str>,
    /// How that model writes angles.
    pub(super) angles: &'a Angles,
    /// The folder of this model's file, seen from that of the other one.
    pub(super) folder: PathBuf,
}

/// The text of a model in other terms. Its files are written from the folder of the other model, without
/// `meshdir` and the like.
///
/// # Errors
/// [`Error::Refused`] for a text that is no XML.
pub(super) fn in_terms(xml: &str, path: &Path, terms: &Terms<'_>) -> Result<String, Error> {
    let doc = preparse::parse(xml, path)?;
    let mut edits = Edits::default();
    Angles::of(&doc).write_as(terms.angles, &doc, &mut edits);
    let main = outermost(&doc);
    let named = |name: &str, value: &str| match (name, terms.main) {
        ("class" | "childclass", Some(new)) if value == main => new.to_owned(),
        ("class" | "childclass", None) if value == main => value.to_owned(),
        ("body" | "body1" | "body2" | "target", _) if value == "world" => value.to_owned(),
        _ => format!("{}{value}", terms.prefix),
    };
    for section in doc.root_element().children().filter(Node::is_element) {
        if WITHOUT_NAMES.contains(&section.tag_name().name()) {
            continue;
        }
        for node in section.descendants().filter(Node::is_element) {
            for a in node.attributes().filter(|a| NAMES.contains(&a.name())) {
                let new = named(a.name(), a.value());
                if new != a.value() {
                    edits.replace(a.range_value(), escape(&new));
                }
            }
        }
    }
    files(&doc, terms, &mut edits);
    inertias(&doc, &mut edits);
    if let Some(main) = terms.main {
        classes(&doc, main, &mut edits);
    }
    // Default classes are moved as a whole, with the changes inside of them.
    let text = edits.apply(xml);
    match terms.main {
        Some(main) => nested(&text, path, main),
        None => Ok(text),
    }
}

/// The name of the outermost default class.
fn outermost<'a>(doc: &'a Document<'_>) -> &'a str {
    let top = doc.root_element().children().find(|n| n.has_tag_name("default"));
    top.and_then(|n| n.attribute("class")).unwrap_or("main")
}

/// Whether the outermost default class says anything of its own.
pub(super) fn has_defaults(doc: &Document<'_>) -> bool {
    let tops = doc.root_element().children().filter(|n| n.has_tag_name("default"));
    tops.flat_map(|n| n.children()).any(|n| n.is_element() && !n.has_tag_name("default"))
}

/// Writes file names from the folder of the other model. What is nameless gets the name of its file.
fn files(doc: &Document<'_>, terms: &Terms<'_>, edits: &mut Edits) {
    let dirs = preparse::AssetDirs::of(doc);
    for node in doc.descendants().filter(Node::is_element) {
        let tag = node.tag_name().name();
        for a in node.attributes().filter(|a| preparse::names_file(tag, a.name())) {
            let there = terms.folder.join(dirs.path(tag, a.value()).replace('\\', "/"));
            edits.replace(a.range_value(), escape(&there.to_string_lossy()));
            let implied = a.name() == "file" && !node.has_attribute("name");
            if implied && matches!(tag, "mesh" | "hfield" | "texture") {
                let name = format!("{}{}", terms.prefix, preparse::stem(a.value()));
                edits.set(node, "name", &name);
            }
        }
        if tag == "compiler" {
            ["assetdir", "meshdir", "texturedir", "strippath"]
                .iter()
                .for_each(|name| edits.unset(node, name));
        }
    }
}

/// Writes out what `inertiafromgeom` and `inertiagrouprange` do, because they would count for other models,
/// too.
fn inertias(doc: &Document<'_>, edits: &mut Edits) {
    let in_body = |n: &Node<'_, '_>| n.parent().is_some_and(|p| !p.has_tag_name("default"));
    if compiler(doc, "inertiafromgeom") == Some("true") {
        let own = doc.descendants().filter(|n| n.has_tag_name("inertial"));
        own.for_each(|n| edits.replace(n.range(), ""));
    }
    if let Some([lo, hi]) = compiler(doc, "inertiagrouprange").and_then(numbers::<i64>).as_deref() {
        let classes = Classes::of(doc);
        for geom in doc.descendants().filter(|n| n.has_tag_name("geom") && in_body(n)) {
            let group = classes.get(geom, &["geom"], "group").and_then(|g| g.trim().parse().ok());
            if !(*lo..=*hi).contains(&group.unwrap_or(0)) {
                edits.set(geom, "mass", "0");
            }
        }
    }
    for section in doc.root_element().children().filter(|n| n.has_tag_name("compiler")) {
        ["inertiafromgeom", "inertiagrouprange"].iter().for_each(|name| edits.unset(section, name));
    }
}

/// Gives the parts that have the outermost default class its name.
fn classes(doc: &Document<'_>, main: &str, edits: &mut Edits) {
    let in_world = |node: &Node<'_, '_>| {
        let frame = |a: &Node<'_, '_>| a.has_tag_name("frame") || a.has_tag_name("replicate");
        node.ancestors().skip(1).find(|a| !frame(a)).is_some_and(|a| a.has_tag_name("worldbody"))
    };
    for node in doc.descendants().filter(Node::is_element) {
        let tag = node.tag_name().name();
        let above = node.parent().map_or("", |p| p.tag_name().name());
        let class = if in_world(&node) && matches!(tag, "body" | "frame" | "replicate") {
            let covered = node.ancestors().any(|a| a.has_attribute("childclass"));
            (!covered).then_some("childclass")
        } else {
            let classed = match above {
                "worldbody" => CLASSED_PARTS.contains(&tag),
                "asset" => matches!(tag, "mesh" | "material"),
                _ => CLASSED.contains(&above) && tag != "exclude",
            };
            (classed && !node.has_attribute("class")).then_some("class")
        };
        if let Some(attribute) = class {
            edits.set(node, attribute, main);
        }
    }
}

/// The text with its default classes inside of an empty outermost one.
fn nested(xml: &str, path: &Path, main: &str) -> Result<String, Error> {
    let doc = preparse::parse(xml, path)?;
    let mut edits = Edits::default();
    let tops: Vec<Node<'_, '_>> =
        doc.root_element().children().filter(|n| n.has_tag_name("default")).collect();
    let inside: String = tops.iter().map(|n| inner(*n, xml)).collect();
    let all = format!("<default><default class=\"{}\">{inside}</default></default>", escape(main));
    match tops.first() {
        Some(first) => edits.replace(first.range(), all),
        None => insert_first(&mut edits, doc.root_element(), &all),
    }
    tops.iter().skip(1).for_each(|n| edits.replace(n.range(), ""));
    Ok(edits.apply(xml))
}
