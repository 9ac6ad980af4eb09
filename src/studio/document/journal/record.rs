//! The records of a journal, and a report of lost ones.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use robert_clip::Delta;

/// One record.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Record {
    /// The document on which all other records build; always the first record, and only there.
    Base {
        /// Its text.
        text: String,
        /// The file it is saved in; `None` for a clip without a name.
        path: Option<PathBuf>,
    },
    /// An edit.
    Edit {
        /// The name of the edit in the history.
        label: String,
        /// The difference that the edit made.
        patch: Box<Delta>,
    },
    /// The last edit was taken back.
    Undo,
    /// It was done again.
    Redo,
    /// The studio closed the document by itself. If this record is missing at the end, the studio
    /// was killed with the clip open.
    Closed,
    /// It was taken up again.
    Opened,
}

/// The damage of a journal.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Damage {
    /// Bytes of a record that was not written completely, and so never acknowledged.
    pub(crate) torn_bytes: u64,
    /// Other damage, in words.
    pub(crate) lost: Vec<String>,
    /// The path where the damaged file is kept.
    pub(crate) kept: Option<PathBuf>,
}

impl Damage {
    /// The lost parts, in words.
    pub(crate) fn words(&self) -> String {
        let torn = (self.torn_bytes > 0)
            .then(|| format!("an edit of {} bytes was not written to its end", self.torn_bytes));
        self.lost.iter().cloned().chain(torn).collect::<Vec<_>>().join(", ")
    }
}
