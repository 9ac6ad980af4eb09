//! The session: one thread that owns the document.

mod actor;
mod command;
mod findings;
mod history;
mod opening;
mod settings;
mod shown;
mod view;

pub(crate) use actor::{reference, start};
pub(crate) use command::{Author, Session, SessionCommand};
