//! Commands to the session, and the handle that sends them.

use std::path::PathBuf;
use std::sync::mpsc::Sender;

use tokio::sync::oneshot;

use super::shown::Shown;
use crate::document::Edit;
use crate::protocol::{DocumentView, Edited, Error, RobotFacts, RolloutSettings, Saved};
use crate::simulation::worker::Checked;
use robert_clip::{Change, Clip, Command, Demand, Op};

/// The client that asked for an edit.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Author {
    /// Client number; 0 over HTTP.
    pub(crate) client: u64,
    /// The number of its request, which the answer repeats.
    pub(crate) id: Option<u64>,
}

pub(super) type Reply<T> = oneshot::Sender<Result<T, Error>>;

/// Everything that the session can be asked to do.
#[derive(Debug)]
pub(crate) enum SessionCommand {
    /// A change of the document, or other work that waits for a disk.
    Write(Write),
    /// Previews an edit without committing it.
    Preview(Box<Op>, Reply<Option<Demand>>),
    /// Ends the preview and shows the document again.
    PreviewEnd(Reply<()>),
    /// The document as clients see it; `None` if none is open.
    View(Reply<Option<Box<DocumentView>>>),
    /// The clip's text.
    Text(Reply<String>),
    /// The clip and its command.
    Content(Reply<(Clip, Command)>),
    /// Sets how rollouts are made.
    Settings(RolloutSettings, Reply<()>),
    /// Starts a rollout now.
    Run(Reply<()>),
    /// The simulation's verdicts on poses: which of them the robot can hold.
    Judged { robot: String, poses: Vec<Vec<f64>>, verdicts: Result<Vec<Checked>, Error> },
    /// The result of a command to the writer.
    Written(Box<Written>),
}

/// Commands to the writer, which are carried out in order.
#[derive(Debug)]
pub(crate) enum Write {
    /// An edit, undo, redo.
    Edit(Author, Edit, Reply<Edited>),
    /// Replaces the content by this text, as an edit.
    Put(Author, String, Reply<Edited>),
    /// Discards unsaved edits.
    Discard(Author, Reply<Edited>),
    /// Replaces the document by what its file contains now.
    Reload(Author, Reply<Edited>),
    /// Opens a file.
    Open(PathBuf, Reply<DocumentView>),
    /// Opens a clip that has no file yet.
    New(Box<Clip>, Reply<DocumentView>),
    /// Opens an empty clip of `length` frames for this robot.
    Blank { robot: String, length: u32, name: String, reply: Reply<DocumentView> },
    /// Opens what was open in a killed studio, an unsaved clip or the last file; false if there is
    /// nothing.
    Recover(Reply<bool>),
    /// Reports that the recovered document was shown without an error.
    Recovered(Reply<bool>),
    /// Opens a clip again that was never saved.
    Draft(u32, Reply<DocumentView>),
    /// Remembers the folder of a robot, for clips that name its id.
    Know(String, Reply<()>),
    /// Saves the document, under `path` if one is given; `replace` overwrites another file.
    Save { path: Option<PathBuf>, replace: bool, reply: Reply<Saved> },
    /// Closes the document.
    Close(Reply<()>),
    /// Ends the session.
    Shutdown(Reply<()>),
}

impl Write {
    /// Answers the command with this error instead of carrying it out.
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

/// The result of a command to the writer. Changes in it are already on disk.
#[derive(Debug)]
pub(crate) enum Written {
    /// Edits, and the document afterwards.
    Edits(Vec<Answered>, Option<Shown>),
    /// The document was replaced by the content of its file.
    Reloaded(Answered, Option<Shown>),
    /// Another document was opened; `asked` are the facts about its robot, if they were requested.
    Opened { shown: Shown, asked: Option<Asked>, reply: Reply<DocumentView> },
    /// The document that a killed studio had open was opened again.
    Recovered { shown: Shown, asked: Option<Asked>, reply: Reply<bool> },
    /// The requested document is already open.
    Same(Reply<DocumentView>),
    /// The document was saved, or the reason why not.
    Saved(Result<Saved, Error>, Option<Shown>, Reply<Saved>),
    /// The document was closed.
    Closed(Reply<()>),
    /// The writer has ended.
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
