//! Where a line of a changed text was in the file that it was read from.

use std::path::Path;

use robert_base::{fsio, limits};

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
