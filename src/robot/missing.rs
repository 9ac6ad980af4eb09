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

/// The text without assets whose files are missing or no meshes, without shapes and skins made of
/// them, and with materials that keep their colour alone. A sentence says what is gone. Files
/// outside the project folder stay, so that they are refused later.
///
/// # Errors
/// [`Error::Refused`] for a text that is not XML.
pub(super) fn without(
    xml: &str,
    path: &Path,
    dir: &Path,
    root: &Path,
) -> Result<(String, Vec<String>), Error> {
    let doc = parse(xml, path)?;
    let dirs = AssetDirs::of(&doc);
    let is_missing = |node: &Node<'_, '_>| {
        let tag = node.tag_name().name();
        node.attributes().filter(|a| names_file(tag, a.name())).any(|a| {
            match resolve(dir, &dirs.path(tag, a.value()), root) {
                Ok(file) => mesh::check_file(&file).is_err(),
                Err(why) => matches!(why, Unresolved::Missing(_)),
            }
        })
    };
    let mut edits = Edits::default();
    let mut gone = BTreeSet::new();
    let mut names = Vec::new();
    for node in doc.descendants().filter(is_missing) {
        let tag = node.tag_name().name();
        let file = node.attributes().find(|a| names_file(tag, a.name())).map(|a| a.value());
        let name = node.attribute("name").map(str::to_owned);
        let name = name.unwrap_or_else(|| stem(file.unwrap_or_default()));
        names.push(name.clone());
        gone.insert((tag, name));
        edits.replace(node.range(), blank(xml, node));
    }
    if gone.is_empty() {
        return Ok((xml.to_owned(), Vec::new()));
    }
    let mut shapes = 0;
    for node in doc.descendants().filter(Node::is_element) {
        let lost = |tag: &&&str| {
            node.attribute(**tag).is_some_and(|name| gone.contains(&(**tag, name.to_owned())))
        };
        let Some(tag) = USED.iter().find(lost) else { continue };
        if node.has_tag_name("geom") {
            shapes += 1;
            edits.replace(node.range(), blank(xml, node));
        } else {
            edits.unset(node, tag);
        }
    }
    let files = names.len();
    names.truncate(5);
    let more = if files > names.len() {
        format!(" and {} more", files - names.len())
    } else {
        String::new()
    };
    let said = format!(
        "{files} files that are missing ({}{more}), and {shapes} shapes made of them, which neither collide nor \
         appear in pictures",
        names.join(", ")
    );
    Ok((edits.apply(xml), vec![said]))
}
