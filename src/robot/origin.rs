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
        // A file that cannot be read may have the same line.
        let files = with_includes(path, source).filter(|_| !words.is_empty()).unwrap_or_default();
        let mut found = Vec::new();
        for (path, source) in files {
            let alike = (1..).zip(source.lines()).filter(|(_, other)| other.trim() == words);
            found.extend(alike.map(|(line, _)| Origin::Line { path: path.clone(), line }));
        }
        if found.len() == 1 {
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

/// A model file and the files that it includes, with their texts; `None` if one of them cannot be read, or is named by a
/// complete path. That includes stay in their folder was checked when the model was read.
fn with_includes(main: &Path, text: String) -> Option<Vec<(PathBuf, String)>> {
    let folder = main.parent().unwrap_or(Path::new(""));
    let mut known = vec![main.canonicalize().ok()?];
    let mut left = limits::MODEL_BYTES.checked_sub(text.len() as u64)?;
    let mut all = vec![(main.to_owned(), text)];
    let mut next = 0;
    while let Some((_, text)) = all.get(next) {
        let doc = xml::parse(text, limits::XML_ELEMENTS).ok()?;
        let includes = doc.descendants().filter(|n| n.has_tag_name("include"));
        let names = includes.map(|n| Some(PathBuf::from(n.attribute("file")?.replace('\\', "/"))));
        let names: Vec<PathBuf> = names.collect::<Option<_>>()?;
        for name in names {
            if name.is_absolute() {
                return None;
            }
            let file = folder.join(name);
            let real = file.canonicalize().ok()?;
            if known.contains(&real) {
                continue;
            }
            let text = read(&file)?;
            left = left.checked_sub(text.len() as u64)?;
            known.push(real);
            all.push((file, text));
        }
        next += 1;
    }
    Some(all)
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
        assert_eq!(with_includes(&main, read(&main).unwrap()).unwrap().len(), 3);
        assert_eq!(of(3), "b.xml:2");
        // What cannot be read may have the line, too.
        write("b.xml", "<x>\n  <joint/>\n  <include file=\"none.xml\"/>\n</x>\n");
        assert_eq!(of(3), "<joint/>");
    }
}
