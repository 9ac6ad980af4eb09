//! Errors of the studio, and their form for browsers and shells.

use std::path::PathBuf;
use std::time::Duration;

use robert_base::exit::{Exit, HasExit};
use robert_base::fsio;
use robert_clip::{ClipError, OpError};

/// An error of the studio.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The clip cannot be read.
    #[error(transparent)]
    Clip(#[from] ClipError),
    /// An edit was refused; the clip is as before.
    #[error(transparent)]
    Op(#[from] OpError),
    /// The clip cannot be written in this format.
    #[error(transparent)]
    Export(#[from] robert_clip::formats::ExportError),
    /// A file operation failed.
    #[error(transparent)]
    File(#[from] fsio::Error),
    /// No clip is open.
    #[error("no clip is open; open or create one first")]
    NoDocument,
    /// The clip has never been saved, so it needs a name.
    #[error("the clip has no file yet; save it under a name")]
    Untitled,
    /// Saving under this name would overwrite another file.
    #[error("there is a file of that name already; say that it is to be replaced: {path}", path = .path.display())]
    Exists {
        /// The other file.
        path: PathBuf,
    },
    /// Another program has changed the clip's file since the studio read or wrote it.
    #[error("another program has changed this file since it was read here; overwrite it, read it again, or save under another name: {path}", path = .path.display())]
    Changed {
        /// The file.
        path: PathBuf,
    },
    /// Another instance edits this clip.
    #[error("another studio has this clip open (its journal is locked): {path}", path = .path.display())]
    Locked {
        /// The journal.
        path: PathBuf,
    },
    /// The journal cannot be written, so the edit was not made.
    #[error("the edit was not taken, because its journal cannot be written: {source}: {path}", path = .path.display())]
    Journal {
        /// The operating system's error.
        source: std::io::Error,
        /// The journal.
        path: PathBuf,
    },
    /// The disk of the journal or of the clip's file does not answer.
    #[error("nothing was changed: the disk that the last edit or save is written to has not answered for {} s", .waited.as_secs())]
    Stalled {
        /// Time since it was asked.
        waited: Duration,
    },
    /// The disk has not answered while somebody waited for this edit; it may still be made.
    #[error("the disk has not answered for {} s; the edit is made when it does", .waited.as_secs())]
    Waiting {
        /// Time since it was asked.
        waited: Duration,
    },
    /// The file with the journal's name is not a journal; it was left as it is.
    #[error("this file has the name of the clip's journal and is none: {what}; move it away: {path}", path = .path.display())]
    NotAJournal {
        /// The kind of file that it is.
        what: String,
        /// The file.
        path: PathBuf,
    },
    /// The port is taken or forbidden.
    #[error(
        "cannot listen on 127.0.0.1:{port}: {source}; choose another with --port, or 0 for any"
    )]
    Bind {
        /// The port.
        port: u16,
        /// The operating system's error.
        source: std::io::Error,
    },
    /// The server itself failed.
    #[error("the server failed: {0}")]
    Server(#[source] std::io::Error),
    /// The simulation worker failed at this request, with this message.
    #[error("{message}")]
    Simulation {
        /// The message of the worker.
        message: String,
        /// Its class.
        exit: Exit,
    },
    /// The simulation worker is not there.
    #[error("the simulation is not available: {reason}")]
    Worker {
        /// Why.
        reason: String,
    },
    /// A request makes no sense.
    #[error("{what}")]
    Request {
        /// The problem, and what would be right.
        what: String,
    },
    /// There is no such thing.
    #[error("there is no {what}")]
    NotFound {
        /// The thing that was asked for.
        what: String,
    },
    /// A body has too many bytes.
    #[error("the body has more than {cap} bytes")]
    TooLarge {
        /// The allowed number of bytes.
        cap: usize,
    },
    /// A cap was reached.
    #[error("too many {what}: at most {cap}")]
    Full {
        /// The kind of the things.
        what: &'static str,
        /// The cap.
        cap: usize,
    },
}

impl HasExit for Error {
    fn exit(&self) -> Exit {
        match self {
            Error::Clip(e) => e.exit(),
            Error::Op(e) => e.exit(),
            Error::Export(e) => e.exit(),
            Error::File(e) => e.exit(),
            Error::Simulation { exit, .. } => *exit,
            Error::Journal { .. }
            | Error::Stalled { .. }
            | Error::Waiting { .. }
            | Error::Server(_)
            | Error::Worker { .. } => Exit::Failed,
            Error::Bind { .. } => Exit::Usage,
            _ => Exit::Invalid,
        }
    }
}

impl Error {
    /// A request that makes no sense.
    pub fn request(what: impl Into<String>) -> Error {
        Error::Request { what: what.into() }
    }
}
