//! Parts of a model file that are for other programs: `drake:joint`, `gazebo:ros_control`.
//!
//! Their names have a prefix, which many files do not declare although XML requires it.

use std::collections::BTreeSet;
use std::path::Path;

use roxmltree::Node;

use super::error::Error;
use super::text::Edits;
use robert_base::{limits, xml};

/// Prefixes that are declared for a file.
const DECLARED: usize = 8;

/// The text without these parts, and their names. Lines stay where they are. Elements of a xacro template
/// stay, because without them the model would be another one.
///
/// # Errors
/// [`Error::Refused`] for a text that is no XML.
pub(super) fn without(text: String, path: &Path) -> Result<(String, BTreeSet<String>), Error> {
    let text = declared(text);
    let doc = xml::parse(&text, limits::XML_ELEMENTS).map_err(|e| Error::Refused {
        message: e.message,
        line: e.line,
        column: e.column,
        path: path.to_owned(),
    })?;
    let (mut edits, mut names) = (Edits::default(), BTreeSet::new());
    let written = |at: usize| {
        let rest = text.get(at..).unwrap_or_default();
        rest.split(|c: char| c.is_whitespace() || "=/>".contains(c)).next().unwrap_or_default()
    };
    let is_foreign = |name: &str| name.contains(':') && !name.starts_with("xacro:");
    for node in doc.descendants().filter(Node::is_element) {
        let name = written(node.range().start + 1);
        if is_foreign(name) && node != doc.root_element() {
            let lines = text.get(node.range()).map_or(0, |t| t.matches('\n').count());
            edits.replace(node.range(), "\n".repeat(lines));
            names.insert(name.to_owned());
        }
        for a in node.attributes() {
            let name = written(a.range().start);
            if is_foreign(name) {
                edits.replace(a.range(), "");
                names.insert(name.to_owned());
            }
        }
    }
    drop(doc);
    if names.is_empty() { Ok((text, names)) } else { Ok((edits.apply(&text), names)) }
}

/// The text with a declaration, in its first tag, of the prefixes that it uses without.
fn declared(mut text: String) -> String {
    for _ in 0..DECLARED {
        let Some(prefix) = xml::undeclared(&text, limits::XML_ELEMENTS) else { break };
        let Some(at) = after_first_name(&text).filter(|_| prefix != "xacro") else { break };
        text.insert_str(at, &format!(" xmlns:{prefix}=\"{prefix}\""));
    }
    text
}

/// The byte behind the name of the first element.
fn after_first_name(text: &str) -> Option<usize> {
    let mut at = 0;
    loop {
        at += text.get(at..)?.find('<')?;
        let rest = text.get(at..)?;
        at += match rest.get(1..)?.chars().next()? {
            '?' => rest.find("?>")?,
            '!' => rest.find("-->")?,
            _ => return Some(at + rest.find(|c: char| c.is_whitespace() || "/>".contains(c))?),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_for_other_programs_are_left_out() {
        let text = "<?xml version=\"1.0\"?>\n<!-- a <b:c/> -->\n<robot name=\"r\">\n<link name=\"l\" drake:x=\"1\"/>\n<drake:joint name=\"j\">\n</drake:joint>\n<gz:plugin/></robot>";
        let (out, names) = without(text.to_owned(), Path::new("r.urdf")).unwrap();
        assert_eq!(names.into_iter().collect::<Vec<_>>(), ["drake:joint", "drake:x", "gz:plugin"]);
        assert!(out.contains("<link name=\"l\" />") && !out.contains("<drake"), "{out}");
        assert_eq!(out.lines().count(), text.lines().count());
        let (same, names) =
            without("<robot name=\"a:b\"/>".to_owned(), Path::new("r.urdf")).unwrap();
        assert!(same == "<robot name=\"a:b\"/>" && names.is_empty());
    }

    #[test]
    fn a_template_is_no_model() {
        let e = without("<robot><xacro:if/></robot>".to_owned(), Path::new("r.urdf")).unwrap_err();
        assert!(e.to_string().contains("xacro template"), "{e}");
    }
}
