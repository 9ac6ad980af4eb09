//! Leaves out what a model cannot have because a file is missing, with all that consists of it.

use std::collections::BTreeSet;
use std::path::Path;

use roxmltree::Node;

use super::asset_dirs::{AssetDirs, names_file, stem};
use super::error::Error;
use super::mesh;
use super::origin::parse;
use super::reference::{Unresolved, resolve};
use super::text::{Edits, blank};

/// Assets that other elements use, with an attribute of the same name.
const USED: &[&str] = &["mesh", "hfield", "texture"];
/// Names that a sentence lists.
const LISTED: usize = 5;

/// What was left out.
#[derive(Clone, Debug, Default)]
pub struct Without {
    /// A sentence about the files; empty if none is missing.
    pub dropped: Vec<String>,
    /// A sentence about bodies that may have lost mass.
    pub warnings: Vec<String>,
}

/// The text without assets whose files are missing or cannot be used, without shapes and skins made
/// of them, and with materials that keep their colour alone. Files outside the project folder stay,
/// so that they are refused later.
///
/// # Errors
/// [`Error::Refused`] for a text that is not XML.
pub(super) fn without(
    xml: &str,
    path: &Path,
    dir: &Path,
    root: &Path,
) -> Result<(String, Without), Error> {
    let doc = parse(xml, path)?;
    let dirs = AssetDirs::of(&doc);
    // Why the file of an element cannot be used.
    let flaw = |node: Node<'_, '_>| {
        let tag = node.tag_name().name();
        node.attributes().filter(|a| names_file(tag, a.name())).find_map(|a| {
            match resolve(dir, &dirs.path(tag, a.value()), root) {
                Ok(file) => mesh::check_file(&file).err(),
                Err(Unresolved::Missing(why)) => Some(why),
                Err(Unresolved::Refused(_)) => None,
            }
        })
    };
    let mut edits = Edits::default();
    let (mut gone, mut said) = (BTreeSet::new(), Vec::new());
    for node in doc.descendants().filter(Node::is_element) {
        let Some(why) = flaw(node) else { continue };
        let tag = node.tag_name().name();
        let file = node.attributes().find(|a| names_file(tag, a.name())).map(|a| stem(a.value()));
        gone.insert((tag, node.attribute("name").map(str::to_owned).or(file).unwrap_or_default()));
        said.push(format!("{tag} file {why}"));
        edits.replace(node.range(), blank(xml, node));
    }
    if gone.is_empty() {
        return Ok((xml.to_owned(), Without::default()));
    }
    let (mut shapes, mut named, mut lighter) = (0, BTreeSet::new(), BTreeSet::new());
    for node in doc.descendants().filter(Node::is_element) {
        let lost = |tag: &&&str| {
            node.attribute(**tag).is_some_and(|name| gone.contains(&(**tag, name.to_owned())))
        };
        for tag in USED.iter().filter(lost) {
            let body = node.parent().filter(|p| p.has_tag_name("body") || p.has_tag_name("frame"));
            // A default class keeps its other settings.
            let Some(body) = body.filter(|_| node.has_tag_name("geom")) else {
                edits.unset(node, tag);
                continue;
            };
            shapes += 1;
            named.extend(node.attribute("name"));
            if !body.children().any(|n| n.has_tag_name("inertial")) {
                lighter.insert(body.attribute("name").unwrap_or("without a name"));
            }
            edits.replace(node.range(), blank(xml, node));
            break;
        }
    }
    for pair in doc.descendants().filter(|n| n.has_tag_name("pair")) {
        let ends = ["geom1", "geom2"].map(|end| pair.attribute(end));
        if ends.into_iter().flatten().any(|geom| named.contains(geom)) {
            edits.replace(pair.range(), blank(xml, pair));
        }
    }
    let more = said.len().saturating_sub(LISTED);
    said.truncate(LISTED);
    let more = if more > 0 { format!("; and {more} more") } else { String::new() };
    let dropped = format!(
        "{}{more}; shapes made of them: {shapes}, which neither collide nor weigh nor appear in pictures",
        said.join("; ")
    );
    let mut left_out = Without { dropped: vec![dropped], warnings: Vec::new() };
    if !lighter.is_empty() {
        let names: Vec<String> = lighter.iter().take(LISTED).map(|n| format!("{n:?}")).collect();
        left_out.warnings.push(format!(
            "bodies without <inertial> that weigh less without these shapes: {}{}",
            names.join(", "),
            if lighter.len() > LISTED { ", …" } else { "" }
        ));
    }
    Ok((edits.apply(xml), left_out))
}
