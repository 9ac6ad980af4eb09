//! The session: one thread that answers for the document.
//!
//! It shows the document as the writer last acknowledged it, previews edits on it, lets the
//! simulation perform it, and tells everyone what has changed. It never waits for a disk: what
//! changes the document is passed on to the writer. If this thread panics the process ends.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};

use super::command::{Answered, Asked, Author, Session, SessionCommand, Write, Written};
use super::shown::Shown;
use super::writer::{Writer, WriterHandle};
use crate::protocol::{DocumentView, Edited, Error, Event, Hub};
use crate::simulation::Simulation;
use crate::simulation::worker::Checked;
use crate::workspace::Workspace;
use robert_clip as clip;
use robert_clip::{Change, Demand, Granularity, Level, Op};

pub(super) struct SessionActor {
    /// The open document as it was last acknowledged.
    pub(super) shown: Option<Shown>,
    /// How many documents there have been.
    pub(super) opened: u64,
    pub(super) workspace: Arc<Workspace>,
    pub(super) hub: Hub,
    pub(super) simulation: Simulation,
    pub(super) judgement: Judgement,
    pub(super) previewing: bool,
    pub(super) choice: Choice,
    pub(super) inbox: Sender<SessionCommand>,
    pub(super) writer: WriterHandle,
}

/// The answers of the simulation about poses that the clip commands.
#[derive(Default)]
pub(super) struct Judgement {
    /// Verdicts; the key is the bits of the pose's values, in state order.
    pub(super) verdicts: BTreeMap<Vec<u64>, Checked>,
    /// Whether a question is under way.
    pub(super) asking: bool,
}

/// The policy in use.
pub(super) struct Choice {
    /// Whether a person chose the settings; until then each robot has its own.
    pub(super) by_hand: bool,
    /// Whether the policy accepts masks of single joints, or only of whole frames.
    pub(super) granularity: Granularity,
}

/// Starts the threads of the session and of its writer.
///
/// # Errors
/// If the operating system cannot start the thread.
pub(crate) fn start(
    workspace: Arc<Workspace>,
    hub: Hub,
    simulation: Simulation,
) -> std::io::Result<Session> {
    let (tx, rx) = channel();
    let writer = Writer::start(Arc::clone(&workspace), simulation.clone(), tx.clone())?;
    let actor = SessionActor {
        shown: None,
        opened: 0,
        workspace,
        hub,
        simulation,
        judgement: Judgement::default(),
        previewing: false,
        choice: Choice { by_hand: false, granularity: Granularity::Joint },
        inbox: tx.clone(),
        writer,
    };
    std::thread::Builder::new().name("session".into()).spawn(move || {
        super::or_end(move || actor.run(&rx));
    })?;
    Ok(Session::new(tx))
}

impl SessionActor {
    fn run(mut self, asks: &Receiver<SessionCommand>) {
        while let Ok(ask) = asks.recv() {
            self.answer(ask);
        }
    }

    fn answer(&mut self, ask: SessionCommand) {
        match ask {
            SessionCommand::Write(ask) => self.writer.tell(ask),
            SessionCommand::Written(done) => self.written(*done),
            SessionCommand::Preview(op, reply) => {
                reply.send(self.preview(&op)).ok();
            }
            SessionCommand::PreviewEnd(reply) => {
                if std::mem::take(&mut self.previewing) {
                    self.perform();
                }
                reply.send(Ok(())).ok();
            }
            SessionCommand::View(reply) => {
                let view = self.shown.is_some().then(|| Box::new(self.view()));
                reply.send(Ok(view)).ok();
            }
            SessionCommand::Text(reply) => {
                reply.send(self.open_document().map(Shown::text)).ok();
            }
            SessionCommand::Content(reply) => {
                let content = self.open_document().map(|d| (d.clip().clone(), d.command().clone()));
                reply.send(content).ok();
            }
            SessionCommand::Settings(settings, reply) => {
                self.choice.by_hand = true;
                self.settle_on(settings);
                self.perform();
                self.tell_findings();
                reply.send(Ok(())).ok();
            }
            SessionCommand::Run(reply) => {
                let result = self.open_document().map(|_| ());
                if result.is_ok() {
                    self.perform_now();
                }
                reply.send(result).ok();
            }
            SessionCommand::Judged { robot, poses, verdicts } => {
                self.judged(&robot, &poses, verdicts);
            }
        }
    }

    fn written(&mut self, done: Written) {
        match done {
            Written::Edits(answered, shown) => {
                self.shown = shown;
                let mut changed = false;
                for one in answered {
                    changed |= self.announce(one);
                }
                self.renew(changed);
            }
            Written::Reloaded(answered, shown) => {
                self.shown = shown;
                let read = answered.0.is_ok();
                let changed = self.announce(answered);
                if read {
                    // The saved content is another one now, even if the document has not changed.
                    let document = Some(Box::new(self.view()));
                    self.hub.send(&Event::Document { document });
                }
                self.renew(changed);
            }
            Written::Opened { shown, asked, reply } => {
                let view = self.take_up(shown, asked);
                reply.send(Ok(view)).ok();
            }
            Written::Recovered { shown, asked, reply } => {
                self.take_up(shown, asked);
                self.writer.tell(Write::Recovered(reply));
            }
            Written::Same(reply) => drop(reply.send(Ok(self.view()))),
            Written::Saved(result, shown, reply) => {
                self.shown = shown;
                if let Ok(saved) = &result {
                    self.hub.send(&Event::Saved { path: saved.path.clone(), rev: saved.rev });
                }
                reply.send(result).ok();
            }
            Written::Closed(reply) => {
                self.close();
                self.simulation.set_robot(None);
                self.hub.send(&Event::Document { document: None });
                reply.send(Ok(())).ok();
            }
            Written::Ended(reply) => drop(reply.send(Ok(()))),
        }
    }

    pub(super) fn open_document(&self) -> Result<&Shown, Error> {
        self.shown.as_ref().ok_or(Error::NoDocument)
    }

    /// Sends changes to all clients, and the answer to their author. Returns whether there are any
    /// changes.
    fn announce(&self, (result, author, reply): Answered) -> bool {
        let any = result.as_ref().is_ok_and(|changes| !changes.is_empty());
        let answer = match (&self.shown, result) {
            (Some(shown), Ok(changes)) => Ok(self.tell_changes(shown, author, &changes)),
            (None, Ok(_)) => Err(Error::NoDocument),
            (_, Err(e)) => Err(e),
        };
        reply.send(answer).ok();
        any
    }

    fn tell_changes(&self, shown: &Shown, author: Author, changes: &[Change]) -> Edited {
        for change in changes {
            self.hub.send(&Event::Edit {
                by: author.client,
                id: author.id,
                rev: change.rev,
                label: change.label.clone(),
                patch: change.patch.clone(),
                dirty: shown.dirty,
                history: shown.history.clone(),
                first_changed_frame: change.first_changed_frame,
                first_changed_step: change.first_changed_step,
            });
        }
        let lints = if author.client == 0 { self.findings().0.lints } else { Vec::new() };
        let patches = changes.iter().map(|c| c.patch.clone()).collect();
        let (rev, history) = (shown.version.rev, shown.history.clone());
        Edited { rev, dirty: shown.dirty, patches, history, lints }
    }

    /// Performs a document that has changed.
    fn renew(&mut self, changed: bool) {
        if changed {
            self.previewing = false;
            self.perform();
            self.tell_findings();
        }
    }

    fn preview(&mut self, op: &Op) -> Result<Option<Demand>, Error> {
        let shown = self.open_document()?;
        let command = shown.version.preview(op)?;
        let robot = self.simulation.robot();
        let asked = robot.and_then(|r| clip::demand(&command, shown.command(), &r.table));
        self.previewing = true;
        if self.simulation.rollout.settings().auto {
            self.simulation.preview(&command);
        }
        Ok(asked)
    }

    /// Rolls the document out, if that is wanted.
    fn perform(&self) {
        if self.simulation.rollout.settings().auto {
            self.perform_now();
        }
    }

    fn perform_now(&self) {
        let Some(shown) = &self.shown else { return };
        // Without a robot there is nobody to perform; the banner has said so.
        if self.simulation.robot().is_some() {
            self.simulation.perform(shown.version.rev, shown.clip(), shown.command());
        }
    }

    /// Opens a document in place of the current one.
    fn take_up(&mut self, shown: Shown, asked: Option<Asked>) -> DocumentView {
        self.close();
        let (facts, refusal) = match asked {
            Some(Ok(facts)) => (Some(facts), None),
            Some(Err(e)) => (None, Some(e)),
            None => (None, None),
        };
        self.simulation.set_robot(facts);
        let settings = self.suited(&shown.clip().robot.id);
        self.settle_on(settings);
        self.shown = Some(shown);
        self.opened += 1;
        let view = self.view();
        self.hub.send(&Event::Document { document: Some(Box::new(view.clone())) });
        if let Some(e) = refusal {
            self.hub.send(&Event::Notice { level: Level::Error, message: e.to_string() });
        }
        self.perform();
        self.tell_findings();
        view
    }

    fn close(&mut self) {
        self.shown = None;
        self.simulation.cancel();
        self.judgement.verdicts.clear();
        self.previewing = false;
    }
}
