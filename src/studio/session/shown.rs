//! The document that readers get while the session waits for a disk.
//!
//! The session's thread writes journals and files itself, since an edit may not be acknowledged
//! before its record is on disk. A disk that does not answer (a folder on another machine) delays
//! edits and saves; readers get the document as it last was. Rejected: a separate thread for
//! writing while the document goes on, because a failed write would have to take back edits that
//! others have built upon.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::protocol::DocumentView;
use robert_clip::{Clip, Command};

/// The document as it was a moment ago.
#[derive(Clone, Debug, Default)]
pub(super) struct Shown {
    pub(super) view: Option<Box<DocumentView>>,
    pub(super) text: Option<String>,
    pub(super) content: Option<(Clip, Command)>,
}

/// The place where the session leaves the document for readers.
pub(super) type Shelf = Arc<Mutex<Shown>>;

/// The delay between the first change and the next copy for readers. A copy costs as much as an
/// edit, and edits come in quick succession.
const AFTER: Duration = Duration::from_millis(100);

/// Renews the shelf now and then.
pub(super) struct Showing {
    shelf: Shelf,
    /// The time at which it is renewed.
    due: Option<Instant>,
}

impl Showing {
    pub(super) fn new(shelf: Shelf) -> Showing {
        Showing { shelf, due: None }
    }

    /// Time until it is to be renewed; `None` while nothing has changed.
    pub(super) fn wait(&self) -> Option<Duration> {
        self.due.map(|at| at.saturating_duration_since(Instant::now()))
    }

    /// Something may have changed.
    pub(super) fn changed(&mut self) {
        self.due.get_or_insert_with(|| Instant::now() + AFTER);
    }

    /// Renews it, if it is time.
    pub(super) fn renew(&mut self, shown: impl FnOnce() -> Shown) {
        if self.due.is_none_or(|at| at > Instant::now()) {
            return;
        }
        self.due = None;
        let shown = shown();
        *self.shelf.lock().unwrap_or_else(PoisonError::into_inner) = shown;
    }
}
