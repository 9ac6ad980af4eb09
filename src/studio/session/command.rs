//! What the session is asked, and the way to ask it.

use std::path::PathBuf;
use std::sync::mpsc::Sender;

use tokio::sync::oneshot;

use crate::document::Edit;
use crate::protocol::{DocumentView, Edited, Error, RolloutSettings, Saved};
use crate::simulation::worker::Checked;
use robert_clip::{Clip, Command, Demand, Op};

/// Who asks for an edit.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Author {
    /// Client number; 0 over HTTP.
    pub(crate) client: u64,
    /// Its request.
    pub(crate) id: Option<u64>,
}

pub(super) type Reply<T> = oneshot::Sender<Result<T, Error>>;

/// What is asked of the session.
#[derive(Debug)]
pub(crate) enum SessionCommand {
    /// An edit, undo, redo.
    Edit(Author, Edit, Reply<Edited>),
    /// Replaces the content by this text, as an edit.
    Put(Author, String, Reply<Edited>),
    /// Gives up unsaved edits.
    Discard(Author, Reply<Edited>),
    /// Takes over what the file holds now.
    Reload(Author, Reply<Edited>),
    /// Previews an edit without committing it.
    Preview(Box<Op>, Reply<Option<Demand>>),
    /// Back to the document.
    PreviewEnd(Reply<()>),
    /// Opens a file.
    Open(PathBuf, Reply<DocumentView>),
    /// Starts from a clip without a file.
    New(Box<Clip>, Reply<DocumentView>),
    /// Starts empty for this robot.
    Blank { robot: String, length: u32, name: String, reply: Reply<DocumentView> },
    /// Brings back what a killed studio had open, an unsaved clip or the last file; false when
    /// nothing was.
    Recover(Reply<bool>),
    /// Takes up a clip that was never saved.
    Draft(u32, Reply<DocumentView>),
    /// Remembers a robot from a folder, for clips that name its id.
    Know(String, Reply<()>),
    /// Saves.
    Save { path: Option<PathBuf>, replace: bool, reply: Reply<Saved> },
    /// Closes.
    Close(Reply<()>),
    /// The document as it is.
    View(Reply<Option<Box<DocumentView>>>),
    /// The clip's text.
    Text(Reply<String>),
    /// The clip and its command.
    Content(Reply<(Clip, Command)>),
    /// How rollouts are made.
    Settings(RolloutSettings, Reply<()>),
    /// Rolls out now.
    Run(Reply<()>),
    /// Verdicts of the simulation on poses.
    Judged { robot: String, poses: Vec<Vec<f64>>, verdicts: Result<Vec<Checked>, Error> },
    /// Ends the session.
    Shutdown(Reply<()>),
}

/// A way to ask the session.
#[derive(Clone, Debug)]
pub(crate) struct Session(Sender<SessionCommand>);

impl Session {
    /// A way to ask whoever takes from the other end.
    pub(super) fn new(inbox: Sender<SessionCommand>) -> Session {
        Session(inbox)
    }

    /// Asks and waits.
    ///
    /// # Errors
    /// The session's refusal.
    pub(crate) async fn ask<T>(
        &self,
        ask: impl FnOnce(Reply<T>) -> SessionCommand,
    ) -> Result<T, Error> {
        let (tx, rx) = oneshot::channel();
        self.0.send(ask(tx)).ok();
        rx.await.unwrap_or_else(|_| Err(Error::request("the studio is shutting down")))
    }
}
