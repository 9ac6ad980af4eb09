//! Commands for the session, and the handle that sends them.

use std::path::PathBuf;
use std::sync::PoisonError;
use std::sync::mpsc::Sender;
use std::time::Duration;

use tokio::sync::oneshot;

use super::shown::{Shelf, Shown};
use crate::document::Edit;
use crate::protocol::{DocumentView, Edited, Error, RolloutSettings, Saved};
use crate::simulation::worker::Checked;
use robert_clip::{Clip, Command, Demand, Op};

/// The client that asks for an edit.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Author {
    /// Client number; 0 over HTTP.
    pub(crate) client: u64,
    /// Its request.
    pub(crate) id: Option<u64>,
}

pub(super) type Reply<T> = oneshot::Sender<Result<T, Error>>;

/// A command for the session.
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
    /// Reopens the document of a killed studio, an unsaved clip or the last file; false if there is
    /// none.
    Recover(Reply<bool>),
    /// Opens a clip that was never saved.
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
    /// Changes how rollouts are made.
    Settings(RolloutSettings, Reply<()>),
    /// Rolls out now.
    Run(Reply<()>),
    /// Verdicts of the simulation on poses.
    Judged { robot: String, poses: Vec<Vec<f64>>, verdicts: Result<Vec<Checked>, Error> },
    /// Ends the session.
    Shutdown(Reply<()>),
}

impl SessionCommand {
    /// Nothing is another document afterwards.
    pub(super) fn only_reads(&self) -> bool {
        matches!(
            self,
            SessionCommand::View(_)
                | SessionCommand::Text(_)
                | SessionCommand::Content(_)
                | SessionCommand::Preview(..)
                | SessionCommand::PreviewEnd(_)
        )
    }
}

/// The time that a reader waits for the session before it takes the document as it last was.
const READER_PATIENCE: Duration = Duration::from_secs(2);

/// A way to ask the session.
#[derive(Clone, Debug)]
pub(crate) struct Session {
    inbox: Sender<SessionCommand>,
    shelf: Shelf,
}

impl Session {
    /// The handle of the session: it sends commands, and reads the document that the session shows.
    pub(super) fn new(inbox: Sender<SessionCommand>, shelf: Shelf) -> Session {
        Session { inbox, shelf }
    }

    /// Sends a command and waits for the answer.
    ///
    /// # Errors
    /// The session's refusal.
    pub(crate) async fn ask<T>(
        &self,
        ask: impl FnOnce(Reply<T>) -> SessionCommand,
    ) -> Result<T, Error> {
        let (tx, rx) = oneshot::channel();
        self.inbox.send(ask(tx)).ok();
        rx.await.unwrap_or_else(|_| Err(Error::request("the studio is shutting down")))
    }

    /// The document as clients see it.
    ///
    /// # Errors
    /// None but that the studio is shutting down.
    pub(crate) async fn view(&self) -> Result<Option<Box<DocumentView>>, Error> {
        self.read(SessionCommand::View, |shown| Ok(shown.view)).await
    }

    /// The clip's text.
    ///
    /// # Errors
    /// [`Error::NoDocument`].
    pub(crate) async fn text(&self) -> Result<String, Error> {
        self.read(SessionCommand::Text, |shown| shown.text.ok_or(Error::NoDocument)).await
    }

    /// The clip and its command.
    ///
    /// # Errors
    /// [`Error::NoDocument`].
    pub(crate) async fn content(&self) -> Result<(Clip, Command), Error> {
        self.read(SessionCommand::Content, |shown| shown.content.ok_or(Error::NoDocument)).await
    }

    /// Sends a command; if the session waits for a disk, the answer is the document as it was last
    /// shown.
    async fn read<T>(
        &self,
        ask: impl FnOnce(Reply<T>) -> SessionCommand,
        shown: impl FnOnce(Shown) -> Result<T, Error>,
    ) -> Result<T, Error> {
        match tokio::time::timeout(READER_PATIENCE, self.ask(ask)).await {
            Ok(answer) => answer,
            Err(_elapsed) => {
                shown(self.shelf.lock().unwrap_or_else(PoisonError::into_inner).clone())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_only_reads_does_not_wait_for_a_disk_that_does_not_answer() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        // The session takes nothing from its queue, as it does while it writes.
        let (inbox, _busy) = std::sync::mpsc::channel();
        let shelf = Shelf::default();
        let session = Session::new(inbox, shelf.clone());
        let begin = std::time::Instant::now();
        runtime.block_on(async {
            assert!(session.view().await.unwrap().is_none());
            shelf.lock().unwrap().text = Some("{}".into());
            assert_eq!(session.text().await.unwrap(), "{}");
            assert!(matches!(session.content().await, Err(Error::NoDocument)));
        });
        assert!(begin.elapsed() < 4 * READER_PATIENCE);
    }
}
