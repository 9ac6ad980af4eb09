//! Commands to the session, and the handle that sends them.

use std::path::PathBuf;
use std::sync::mpsc::Sender;

use tokio::sync::oneshot;

use super::shown::Shown;
use crate::document::Edit;
use crate::protocol::{DocumentView, Edited, Error, RobotFacts, RolloutSettings, Saved};
use crate::simulation::worker::Checked;
use robert_clip::{Change, Clip, Command, Demand, Op};

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
    /// A change of the document, or something else that needs a disk.
    Write(Write),
    /// Previews an edit without committing it.
    Preview(Box<Op>, Reply<Option<Demand>>),
    /// Back to the document.
    PreviewEnd(Reply<()>),
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
    /// The writer has done something.
    Written(Box<Written>),
}

/// Commands to the writer, which are carried out in order.
#[derive(Debug)]
pub(crate) enum Write {
    /// An edit, undo, redo.
    Edit(Author, Edit, Reply<Edited>),
    /// Replaces the content by this text, as an edit.
    Put(Author, String, Reply<Edited>),
    /// Gives up unsaved edits.
    Discard(Author, Reply<Edited>),
    /// Takes over what the file holds now.
    Reload(Author, Reply<Edited>),
    /// Opens a file.
    Open(PathBuf, Reply<DocumentView>),
    /// Starts from a clip without a file.
    New(Box<Clip>, Reply<DocumentView>),
    /// Starts empty for this robot.
    Blank { robot: String, length: u32, name: String, reply: Reply<DocumentView> },
    /// Opens what was open in a killed studio, an unsaved clip or the last file; false if there is
    /// nothing.
    Recover(Reply<bool>),
    /// Reports that the recovered document was shown without an error.
    Recovered(Reply<bool>),
    /// Takes up a clip that was never saved.
    Draft(u32, Reply<DocumentView>),
    /// Remembers a robot from a folder, for clips that name its id.
    Know(String, Reply<()>),
    /// Saves.
    Save { path: Option<PathBuf>, replace: bool, reply: Reply<Saved> },
    /// Closes.
    Close(Reply<()>),
    /// Ends the session.
    Shutdown(Reply<()>),
}

impl Write {
    /// It is not done, for this reason.
    pub(super) fn refuse(self, error: Error) {
        match self {
            Write::Edit(.., reply)
            | Write::Put(.., reply)
            | Write::Discard(_, reply)
            | Write::Reload(_, reply) => drop(reply.send(Err(error))),
            Write::Open(_, reply)
            | Write::New(_, reply)
            | Write::Blank { reply, .. }
            | Write::Draft(_, reply) => drop(reply.send(Err(error))),
            Write::Recover(reply) | Write::Recovered(reply) => drop(reply.send(Err(error))),
            Write::Know(_, reply) | Write::Close(reply) | Write::Shutdown(reply) => {
                drop(reply.send(Err(error)));
            }
            Write::Save { reply, .. } => drop(reply.send(Err(error))),
        }
    }
}

/// The result of an edit, its author, and the channel for the answer.
pub(super) type Answered = (Result<Vec<Change>, Error>, Author, Reply<Edited>);

/// The facts about a clip's robot, as the simulation answered.
pub(crate) type Asked = Result<RobotFacts, Error>;

/// What the writer has done. All of it is on disk.
#[derive(Debug)]
pub(crate) enum Written {
    /// Edits, and the document afterwards.
    Edits(Vec<Answered>, Option<Shown>),
    /// The content of the file taken over.
    Reloaded(Answered, Option<Shown>),
    /// Another document, and the facts about its robot as far as they are known.
    Opened { shown: Shown, asked: Option<Asked>, reply: Reply<DocumentView> },
    /// What a killed studio had open.
    Recovered { shown: Shown, asked: Option<Asked>, reply: Reply<bool> },
    /// The requested document is already open.
    Same(Reply<DocumentView>),
    /// Saved, or not.
    Saved(Result<Saved, Error>, Option<Shown>, Reply<Saved>),
    /// No document.
    Closed(Reply<()>),
    /// The last that it does.
    Ended(Reply<()>),
}

/// A way to ask the session.
#[derive(Clone, Debug)]
pub(crate) struct Session {
    inbox: Sender<SessionCommand>,
}

impl Session {
    /// A handle whose commands go to this inbox.
    pub(super) fn new(inbox: Sender<SessionCommand>) -> Session {
        Session { inbox }
    }

    /// Sends a command and waits for the answer. It comes soon, except for a [`Write`] that waits
    /// for a disk.
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

    /// Asks the writer and waits.
    ///
    /// # Errors
    /// The writer's refusal; [`Error::Stalled`] when its disk has not answered for long.
    pub(crate) async fn write<T>(&self, ask: impl FnOnce(Reply<T>) -> Write) -> Result<T, Error> {
        self.ask(|reply| SessionCommand::Write(ask(reply))).await
    }

    /// The document as clients see it.
    ///
    /// # Errors
    /// Only if the studio is shutting down.
    pub(crate) async fn view(&self) -> Result<Option<Box<DocumentView>>, Error> {
        self.ask(SessionCommand::View).await
    }

    /// The clip's text.
    ///
    /// # Errors
    /// [`Error::NoDocument`].
    pub(crate) async fn text(&self) -> Result<String, Error> {
        self.ask(SessionCommand::Text).await
    }

    /// The clip and its command.
    ///
    /// # Errors
    /// [`Error::NoDocument`].
    pub(crate) async fn content(&self) -> Result<(Clip, Command), Error> {
        self.ask(SessionCommand::Content).await
    }
}
