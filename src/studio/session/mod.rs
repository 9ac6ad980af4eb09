//! The session: a thread that answers for the document, and one that owns it and writes.

mod actor;
mod command;
mod findings;
mod history;
mod opening;
mod settings;
mod shown;
mod view;
mod writer;

pub(crate) use actor::start;
pub(crate) use command::{Author, Session, SessionCommand, Write};
pub(crate) use opening::reference;

/// Does the work of a thread without which there is no document: a panic ends the process.
fn or_end(work: impl FnOnce()) {
    if std::panic::catch_unwind(std::panic::AssertUnwindSafe(work)).is_err() {
        tracing::error!("the session broke; every acknowledged edit is in its journal");
        std::process::exit(1);
    }
}
