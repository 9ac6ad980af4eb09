//! The named history of the document, as clients see it.

use crate::document::Document;
use crate::protocol::History;

/// Labels of the history that are sent.
pub(super) const LABELS: usize = 100;

pub(super) fn history(document: &Document) -> History {
    let (len, done) = document.history();
    // A range of edits around the current one, so that names are shown even after undoing many
    // steps.
    let first = done.saturating_sub(LABELS).min(len.saturating_sub(LABELS));
    let labels = document.labels(first..first + LABELS);
    History { labels, first, done, len }
}
