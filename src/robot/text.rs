//! Small edits of MJCF text that leave all other bytes unchanged.
//!
//! Rejected: writing the model with `mj_saveLastXML`, which rounds numbers to six digits, and
//! setting fields of the compiled model, after which text and model differ and the sha-256 in a
//! dataset would not distinguish two plants.

use std::collections::BTreeMap;
use std::ops::Range;

/// Replacements by byte range, applied together.
#[derive(Debug, Default)]
pub(super) struct Edits {
    /// Start, end, new text. Inserts have start == end.
    list: Vec<(usize, usize, String)>,
}

impl Edits {
    /// Replaces a range.
    pub(super) fn replace(&mut self, at: Range<usize>, text: impl Into<String>) {
        self.list.push((at.start, at.end, text.into()));
    }

    /// Inserts before a byte.
    pub(super) fn insert(&mut self, at: usize, text: impl Into<String>) {
        self.list.push((at, at, text.into()));
    }

    /// Sets an attribute of an element; adds it if it is missing.
    pub(super) fn set(&mut self, node: roxmltree::Node<'_, '_>, name: &str, value: &str) {
        let value = escape(value);
        match node.attributes().find(|a| a.name() == name) {
            Some(a) => self.replace(a.range_value(), value),
            None => self.insert(after_tag_name(node), format!(" {name}=\"{value}\"")),
        }
    }

    /// Removes an attribute.
    pub(super) fn unset(&mut self, node: roxmltree::Node<'_, '_>, name: &str) {
        if let Some(a) = node.attributes().find(|a| a.name() == name) {
            self.replace(a.range(), "");
        }
    }

    /// The text with all edits applied. Edits inside a replaced range are left out.
    pub(super) fn apply(mut self, text: &str) -> String {
        self.list.sort_by_key(|(start, end, _)| (*start, std::cmp::Reverse(*end)));
        let mut out = String::with_capacity(text.len() + 1024);
        let mut done = 0;
        for (start, end, new) in &self.list {
            if *start < done {
                continue;
            }
            out.push_str(text.get(done..*start).unwrap_or_default());
            out.push_str(new);
            done = *end;
        }
        out.push_str(text.get(done..).unwrap_or_default());
        out
    }
}

/// The byte after the name in `<name …>`.
fn after_tag_name(node: roxmltree::Node<'_, '_>) -> usize {
    let start = node.range().start;
    let text = node.document().input_text();
    let rest = text.get(start + 1..).unwrap_or_default();
    let len = rest.find(|c: char| c.is_whitespace() || c == '>' || c == '/').unwrap_or(0);
    start + 1 + len
}

/// The byte before `</name>`; `None` for `<name/>`.
pub(super) fn before_close(node: roxmltree::Node<'_, '_>) -> Option<usize> {
    let range = node.range();
    let text = node.document().input_text().get(range.clone())?;
    let close = text.rfind("</")?;
    Some(range.start + close)
}

/// What `<compiler>` says; the last one counts.
pub(super) fn compiler<'a>(doc: &'a roxmltree::Document<'_>, name: &str) -> Option<&'a str> {
    let sections = doc.root_element().children().filter(|n| n.has_tag_name("compiler"));
    sections.filter_map(|n| n.attribute(name)).next_back()
}

/// The text between an element's tags, out of the document's own.
pub(super) fn inner<'x>(node: roxmltree::Node<'_, '_>, xml: &'x str) -> &'x str {
    match (node.first_child(), before_close(node)) {
        (Some(first), Some(end)) => xml.get(first.range().start..end).unwrap_or_default(),
        _ => "",
    }
}

/// As many line breaks as the node contains, so that later lines keep their numbers.
pub(super) fn blank(xml: &str, node: roxmltree::Node<'_, '_>) -> String {
    let lines = xml.get(node.range()).map_or(0, |t| t.matches('\n').count());
    "\n".repeat(lines)
}

/// Escapes text for an attribute value.
pub(super) fn escape(value: &str) -> String {
    value.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

/// The model without geoms that neither collide nor have mass; a step takes half the time.
///
/// The caller must make sure that they have no mass ([`super::Physics::discard_visual`]).
pub(super) fn discard_visual(xml: &str) -> Result<String, roxmltree::Error> {
    let doc = roxmltree::Document::parse(xml)?;
    let mut edits = Edits::default();
    let root = doc.root_element();
    match root.children().rfind(|n| n.has_tag_name("compiler")) {
        Some(c) => edits.set(c, "discardvisual", "true"),
        None => insert_first(&mut edits, root, "<compiler discardvisual=\"true\"/>"),
    }
    Ok(edits.apply(xml))
}

/// Inserts an element as first child of the root.
pub(super) fn insert_first(edits: &mut Edits, root: roxmltree::Node<'_, '_>, element: &str) {
    if let Some(first) = root.first_child() {
        edits.insert(first.range().start, format!("\n  {element}"));
    } else {
        let name = root.tag_name().name();
        edits.replace(root.range(), format!("<{name}>{element}</{name}>"));
    }
}

/// The same model with another value of an attribute of joints, by joint name. Unknown names are
/// returned as the error.
pub(super) fn with_joints(
    xml: &str,
    attribute: &str,
    values: &BTreeMap<String, impl ToString>,
) -> Result<String, JointsError> {
    if values.is_empty() {
        return Ok(xml.to_owned());
    }
    let doc = roxmltree::Document::parse(xml)?;
    let mut edits = Edits::default();
    let mut left: Vec<&String> = values.keys().collect();
    for node in doc.descendants().filter(|n| n.has_tag_name("joint")) {
        let inside_body = node.parent().is_some_and(|p| p.has_tag_name("body"));
        let Some(name) = node.attribute("name").filter(|_| inside_body) else { continue };
        if let Some(value) = values.get(name) {
            edits.set(node, attribute, &value.to_string());
            left.retain(|n| *n != name);
        }
    }
    match left.first() {
        Some(name) => Err(JointsError::NoJoint((*name).clone())),
        None => Ok(edits.apply(xml)),
    }
}

/// Why an attribute of joints could not be set.
#[derive(Debug)]
pub(super) enum JointsError {
    /// The XML does not parse.
    Xml(roxmltree::Error),
    /// No joint of that name.
    NoJoint(String),
}

impl From<roxmltree::Error> for JointsError {
    fn from(e: roxmltree::Error) -> Self {
        JointsError::Xml(e)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edits_leave_the_rest_alone() {
        let xml = "<mujoco>\n  <!-- note -->\n  <compiler angle=\"radian\"/>\n  <worldbody><body><joint name=\"a\" damping=\"3\"/><joint name=\"b\"/></body></worldbody>\n</mujoco>";
        let set = BTreeMap::from([("a".to_owned(), 7.5), ("b".to_owned(), 2.0)]);
        let out = with_joints(xml, "damping", &set).unwrap();
        assert_eq!(
            out,
            xml.replace("damping=\"3\"", "damping=\"7.5\"")
                .replace("<joint name=\"b\"", "<joint damping=\"2\" name=\"b\"")
        );
        let out = discard_visual(xml).unwrap();
        assert!(out.contains("<compiler discardvisual=\"true\" angle=\"radian\"/>"));
        assert!(out.contains("<!-- note -->"));
        let out = discard_visual("<mujoco/>").unwrap();
        assert_eq!(out, "<mujoco><compiler discardvisual=\"true\"/></mujoco>");
    }

    #[test]
    fn a_joint_that_is_not_there_is_named() {
        let set = BTreeMap::from([("elbow".to_owned(), 1.0)]);
        let e = with_joints("<mujoco/>", "damping", &set).unwrap_err();
        assert!(matches!(e, JointsError::NoJoint(n) if n == "elbow"));
    }
}
