//! The document as it was last acknowledged.
//!
//! The writer makes one of these after each change; readers and previews use the last one, however
//! long the writer waits for a disk. A change that is not on disk yet is shown to nobody.

use std::path::PathBuf;
use std::sync::Arc;

use super::history::history;
use crate::document::Document;
use crate::protocol::{History, Restored};
use robert_clip::{Clip, Command, Version};

/// A copy of the document that readers may use while the writer changes the original.
#[derive(Clone, Debug)]
pub(crate) struct Shown {
    pub(super) version: Version,
    pub(super) path: Option<PathBuf>,
    pub(super) dirty: bool,
    pub(super) history: History,
    pub(super) restored: Option<Restored>,
    saved_text: Arc<str>,
}

impl Shown {
    /// The document as it is now.
    pub(super) fn of(document: &Document) -> Shown {
        Shown {
            version: document.version(),
            path: document.path().map(ToOwned::to_owned),
            dirty: document.is_dirty(),
            history: history(document),
            restored: document.restored().cloned(),
            saved_text: document.saved_text(),
        }
    }

    pub(super) fn clip(&self) -> &Clip {
        &self.version.clip
    }

    pub(super) fn command(&self) -> &Command {
        &self.version.command
    }

    /// The text that saving would write.
    pub(super) fn text(&self) -> String {
        if self.dirty { self.clip().to_text() } else { self.saved_text.to_string() }
    }
}
