//! The open document: clip, history, journal, file.

mod content;
pub(crate) mod journal;
mod opening;
mod places;
mod recovery;
mod replayed;
#[cfg(test)]
mod tests;

pub(crate) use content::{Document, Edit};
pub(crate) use places::is_same_file;
