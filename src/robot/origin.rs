//! The XML of a model file, and the places in it that errors name, also after the text was changed.

use std::path::Path;

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
    let path = path.to_owned();
    match Origin::of(text, line, column, &path) {
        Origin::Line(line) => Error::Refused { message, line, column, path },
        Origin::Excerpt(excerpt) => {
            let message = format!("{message}; the element is {excerpt}");
            Error::Refused { message, line: 0, column: 0, path }
        }
    }
}

/// Where a line of a changed text comes from.
pub(super) enum Origin {
    /// This line of the file, from 1.
    Line(u32),
    /// The file does not have the line: an include or an attached model has it, or it was written anew.
    Excerpt(String),
}

impl Origin {
    /// Looks a line of `text` up in the file. Includes, frames and replicas move lines, other changes do
    /// not.
    pub(super) fn of(text: &str, line: u32, column: u32, path: &Path) -> Origin {
        let Ok(bytes) = fsio::read_capped(path, limits::MODEL_BYTES) else {
            return Origin::Line(line);
        };
        let source = String::from_utf8_lossy(&bytes);
        if source.lines().count() == text.lines().count() {
            return Origin::Line(line);
        }
        let at = usize::try_from(line).unwrap_or(usize::MAX).saturating_sub(1);
        let whole = text.lines().nth(at).unwrap_or_default();
        let words = whole.trim();
        let mut alike = (1..).zip(source.lines()).filter(|(_, other)| other.trim() == words);
        match (alike.next(), alike.next()) {
            (Some((line, _)), None) if !words.is_empty() => Origin::Line(line),
            _ => {
                let column = usize::try_from(column).unwrap_or(usize::MAX).saturating_sub(1);
                let from = whole.chars().skip(column).collect::<String>();
                let tag = from.split_inclusive('>').next().unwrap_or_default();
                Origin::Excerpt(tag.trim().chars().take(120).collect())
            }
        }
    }
}
