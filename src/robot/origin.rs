//! The XML of a model file, and the places in it that errors name, also after the text was changed.

use std::path::{Path, PathBuf};

use roxmltree::{Document, Node};

use super::error::Error;
use robert_base::{fsio, limits, xml};

/// Parses XML within the limits.
pub(super) fn parse<'a>(text: &'a str, path: &Path) -> Result<Document<'a>, Error> {
    xml::parse(text, limits::XML_ELEMENTS).map_err(|e| Error::Refused {
        message: e.message,
        line: e.line,
        column: e.column,
        path: path.to_owned(),
    })
}

/// Line and column of a node, from 1.
pub(super) fn place(node: Node<'_, '_>) -> (u32, u32) {
    let pos = node.document().text_pos_at(node.range().start);
    (pos.row, pos.col)
}

/// An error at a node. Its text may have been changed since it was read from the file.
pub(super) fn refuse(node: Node<'_, '_>, path: &Path, message: impl Into<String>) -> Error {
    let (line, column) = place(node);
    refuse_at(node.document().input_text(), (line, column), path, message.into())
}

/// An error at a line and column of a text that may have been changed since it was read from the file.
pub(super) fn refuse_at(
    text: &str,
    (line, column): (u32, u32),
    path: &Path,
    message: String,
) -> Error {
    match Origin::of(text, line, column, path) {
        Origin::Line { path, line } => Error::Refused { message, line, column, path },
        Origin::Excerpt(excerpt) => {
            let message = format!("{message}; the element is {excerpt}");
            Error::Refused { message, line: 0, column: 0, path: path.to_owned() }
        }
    }
}

/// Where a line of a changed text comes from.
pub(super) enum Origin {
    /// This line, from 1, of the file or of one that it includes.
    Line { path: PathBuf, line: u32 },
    /// The files do not have the line once: several have it, or it was written anew.
    Excerpt(String),
}

impl Origin {
    /// Looks a line of `text` up in the file and in those that it includes. Includes, frames and replicas move lines,
    /// other changes do not.
    pub(super) fn of(text: &str, line: u32, column: u32, path: &Path) -> Origin {
        let here = |line| Origin::Line { path: path.to_owned(), line };
        let Some(source) = read(path) else { return here(line) };
        if source.lines().count() == text.lines().count() {
            return here(line);
        }
        let at = usize::try_from(line).unwrap_or(usize::MAX).saturating_sub(1);
        let whole = text.lines().nth(at).unwrap_or_default();
        let words = whole.trim();
        let mut found = Vec::new();
        for (path, source) in with_includes(path, source) {
            let alike = (1..).zip(source.lines()).filter(|(_, other)| other.trim() == words);
            found.extend(alike.map(|(line, _)| Origin::Line { path: path.clone(), line }));
        }
        if found.len() == 1 && !words.is_empty() {
            return found.remove(0);
        }
        let column = usize::try_from(column).unwrap_or(usize::MAX).saturating_sub(1);
        let from = whole.chars().skip(column).collect::<String>();
        let tag = from.split_inclusive('>').next().unwrap_or_default();
        Origin::Excerpt(tag.trim().chars().take(120).collect())
    }
}

fn read(path: &Path) -> Option<String> {
    let bytes = fsio::read_capped(path, limits::MODEL_BYTES).ok()?;
    Some(String::from_utf8_lossy(&bytes).into_owned())
}

/// A model file and the files that it includes, with their texts. That they may be read was checked before.
fn with_includes(main: &Path, text: String) -> Vec<(PathBuf, String)> {
    let folder = main.parent().unwrap_or(Path::new(""));
    let mut all = vec![(main.to_owned(), text)];
    let mut next = 0;
    while let Some((_, text)) = all.get(next) {
        let files: Vec<PathBuf> = match xml::parse(text, limits::XML_ELEMENTS) {
            Ok(doc) => {
                let includes = doc.descendants().filter(|n| n.has_tag_name("include"));
                includes.filter_map(|n| Some(folder.join(n.attribute("file")?))).collect()
            }
            Err(_) => Vec::new(),
        };
        for file in files {
            if all.len() < limits::PROJECT_FILES && all.iter().all(|(known, _)| *known != file) {
                all.extend(read(&file).map(|text| (file, text)));
            }
        }
        next += 1;
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_of_an_included_file_is_found_there() {
        let dir = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
        write("main.xml", "<mujoco>\n  <include file=\"a.xml\"/>\n  <own/>\n</mujoco>\n");
        write("a.xml", "<x>\n  <body/>\n  <include file=\"b.xml\"/>\n  <body/>\n</x>\n");
        write("b.xml", "<x>\n  <joint/>\n  <own/>\n</x>\n");
        let text = "<mujoco>\n  <body/>\n  <joint/>\n  <own/>\n  <body/>\n  <own/>\n</mujoco>\n";
        let main = dir.path().join("main.xml");
        let of = |line| match Origin::of(text, line, 3, &main) {
            Origin::Line { path, line } => {
                format!("{}:{line}", path.file_name().unwrap().to_string_lossy())
            }
            Origin::Excerpt(tag) => tag,
        };
        assert_eq!(of(3), "b.xml:2");
        // Two files, and two lines of one, say the same.
        assert_eq!([of(4), of(2)], ["<own/>", "<body/>"]);
        assert_eq!(of(7), "main.xml:4");
        // Nothing is read twice where files include each other.
        write("b.xml", "<x>\n  <joint/>\n  <include file=\"a.xml\"/>\n</x>\n");
        assert_eq!(with_includes(&main, read(&main).unwrap()).len(), 3);
        assert_eq!(of(3), "b.xml:2");
    }
}
