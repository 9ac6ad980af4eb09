//! The session: one thread that owns the document.
//!
//! All requests of clients arrive in one queue and are handled in order. Edits that wait together
//! share one `fdatasync`. If this thread panics the process ends: the journal is on disk, and no
//! edit may be based on one that was applied in part.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};

use super::command::{Author, Reply, Session, SessionCommand};
use super::history::history;
use super::shown::{Shelf, Showing};
use crate::document::{Document, Edit};
use crate::protocol::{DocumentView, Edited, Error, Event, History, Hub, RobotFacts, Saved};
use crate::simulation::Simulation;
use crate::simulation::worker::Checked;
use crate::workspace::Workspace;
use robert_clip as clip;
use robert_clip::{Batch, Change, Delta, Demand, Granularity, JointTable, Level, Op, RobotRef};

pub(super) struct SessionActor {
    pub(super) document: Option<Document>,
    /// The number of documents so far.
    pub(super) opened: u64,
    pub(super) workspace: Arc<Workspace>,
    pub(super) hub: Hub,
    pub(super) simulation: Simulation,
    /// Folders of robots that are not in the program, by id.
    pub(super) sources: BTreeMap<String, String>,
    pub(super) judgement: Judgement,
    pub(super) previewing: bool,
    pub(super) choice: Choice,
    pub(super) inbox: Sender<SessionCommand>,
}

/// Answers of the simulation about poses.
#[derive(Default)]
pub(super) struct Judgement {
    /// By the bits of a pose in state order.
    pub(super) verdicts: BTreeMap<Vec<u64>, Checked>,
    /// A question is under way.
    pub(super) asking: bool,
}

/// The policy in use.
pub(super) struct Choice {
    /// Whether a person chose the policy; until then each robot has its own.
    pub(super) by_hand: bool,
    /// The masks that the policy accepts.
    pub(super) granularity: Granularity,
}

/// The simulation's answer about a clip's robot.
pub(crate) type Asked = Result<RobotFacts, Error>;

/// Starts the session's thread.
///
/// # Errors
/// When the system gives none.
pub(crate) fn start(
    workspace: Arc<Workspace>,
    hub: Hub,
    simulation: Simulation,
) -> std::io::Result<Session> {
    let (tx, rx) = channel();
    let actor = SessionActor {
        document: None,
        opened: 0,
        workspace,
        hub,
        simulation,
        sources: BTreeMap::new(),
        judgement: Judgement::default(),
        previewing: false,
        choice: Choice { by_hand: false, granularity: Granularity::Joint },
        inbox: tx.clone(),
    };
    let shelf = Shelf::default();
    let showing = Showing::new(Arc::clone(&shelf));
    std::thread::Builder::new().name("session".into()).spawn(move || {
        let work = std::panic::AssertUnwindSafe(move || actor.run(&rx, showing));
        if std::panic::catch_unwind(work).is_err() {
            tracing::error!("the session broke; every acknowledged edit is in its journal");
            std::process::exit(1);
        }
    })?;
    Ok(Session::new(tx, shelf))
}

impl SessionActor {
    pub(super) fn run(mut self, asks: &Receiver<SessionCommand>, mut showing: Showing) {
        loop {
            let first = match showing.wait() {
                Some(time) => asks.recv_timeout(time),
                None => asks.recv().map_err(RecvTimeoutError::from),
            };
            let mut edits = Vec::new();
            let mut next = match first {
                Ok(first) => Some(first),
                Err(RecvTimeoutError::Timeout) => None,
                Err(RecvTimeoutError::Disconnected) => return,
            };
            while let Some(ask) = next {
                if !ask.only_reads() {
                    showing.changed();
                }
                match ask {
                    SessionCommand::Edit(author, edit, reply) => edits.push((author, edit, reply)),
                    SessionCommand::Shutdown(reply) => {
                        self.edit(std::mem::take(&mut edits));
                        if let Some(document) = self.document.take() {
                            document.close();
                        }
                        reply.send(Ok(())).ok();
                        return;
                    }
                    other => {
                        self.edit(std::mem::take(&mut edits));
                        self.answer(other);
                    }
                }
                next = asks.try_recv().ok();
            }
            self.edit(edits);
            showing.renew(|| self.shown());
        }
    }

    pub(super) fn answer(&mut self, ask: SessionCommand) {
        match ask {
            SessionCommand::Put(author, text, reply) => {
                let result = self.put(author, text);
                reply.send(result).ok();
            }
            SessionCommand::Discard(author, reply) => {
                let result = self.open_document().and_then(Document::discard);
                let result = result.map(|changes| self.changed(author, &changes));
                reply.send(result).ok();
            }
            SessionCommand::Reload(author, reply) => {
                let result = self.open_document().and_then(Document::reload);
                let result = result.map(|changes| {
                    let edited = self.changed(author, &changes);
                    // The saved content changed, even if nothing else did.
                    let document = Some(Box::new(self.view()));
                    self.hub.send(&Event::Document { document });
                    edited
                });
                reply.send(result).ok();
            }
            SessionCommand::Preview(op, reply) => {
                reply.send(self.preview(&op)).ok();
            }
            SessionCommand::PreviewEnd(reply) => {
                if std::mem::take(&mut self.previewing) {
                    self.perform();
                }
                reply.send(Ok(())).ok();
            }
            SessionCommand::Open(path, reply) => {
                let result = self.open(&path);
                reply.send(result).ok();
            }
            SessionCommand::New(clip, reply) => {
                let result = self.start_from(*clip);
                reply.send(result).ok();
            }
            SessionCommand::Blank { robot, length, name, reply } => {
                let result = self.blank(&robot, length, name);
                reply.send(result).ok();
            }
            SessionCommand::Know(robot, reply) => {
                reply.send(self.know(&robot).map(|_| ())).ok();
            }
            SessionCommand::Draft(number, reply) => {
                let result = self.take_up_draft(number);
                reply.send(result).ok();
            }
            SessionCommand::Recover(reply) => {
                reply.send(Ok(self.recover())).ok();
            }
            SessionCommand::Save { path, replace, reply } => {
                let result = self.save(path.as_deref(), replace);
                reply.send(result).ok();
            }
            SessionCommand::Close(reply) => {
                self.close();
                self.simulation.set_robot(None);
                self.hub.send(&Event::Document { document: None });
                reply.send(Ok(())).ok();
            }
            SessionCommand::View(reply) => {
                let view = self.document.is_some().then(|| Box::new(self.view()));
                reply.send(Ok(view)).ok();
            }
            SessionCommand::Text(reply) => {
                let text = self.document.as_ref().map(Document::text);
                reply.send(text.ok_or(Error::NoDocument)).ok();
            }
            SessionCommand::Content(reply) => {
                let content =
                    self.document.as_ref().map(|d| (d.clip().clone(), d.command().clone()));
                reply.send(content.ok_or(Error::NoDocument)).ok();
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
            SessionCommand::Edit(..) | SessionCommand::Shutdown(_) => {}
        }
    }

    pub(super) fn open_document(&mut self) -> Result<&mut Document, Error> {
        self.document.as_mut().ok_or(Error::NoDocument)
    }

    pub(super) fn edit(&mut self, edits: Vec<(Author, Edit, Reply<Edited>)>) {
        if edits.is_empty() {
            return;
        }
        let Some(document) = &mut self.document else {
            for (.., reply) in edits {
                reply.send(Err(Error::NoDocument)).ok();
            }
            return;
        };
        let (asked, rest): (Vec<Edit>, Vec<(Author, Reply<Edited>)>) =
            edits.into_iter().map(|(a, e, r)| (e, (a, r))).unzip();
        let answers = document.edit(&asked);
        let mut any = false;
        for (answer, (author, reply)) in answers.into_iter().zip(rest) {
            let answer = answer.map(|changes| {
                any |= !changes.is_empty();
                self.announce(author, &changes)
            });
            reply.send(answer).ok();
        }
        if any {
            self.previewing = false;
            self.perform();
            self.tell_findings();
        }
    }

    /// Sends changes to all clients; returns the answer for their author.
    pub(super) fn announce(&self, author: Author, changes: &[Change]) -> Edited {
        let Some(document) = &self.document else {
            return Edited {
                rev: 0,
                dirty: false,
                patches: vec![],
                history: History::default(),
                lints: vec![],
            };
        };
        let history = history(document);
        let dirty = document.is_dirty();
        for change in changes {
            self.hub.send(&Event::Edit {
                by: author.client,
                id: author.id,
                rev: change.rev,
                label: change.label.clone(),
                patch: change.patch.clone(),
                dirty,
                history: history.clone(),
                first_changed_frame: change.first_changed_frame,
                first_changed_step: change.first_changed_step,
            });
        }
        let lints = if author.client == 0 { self.findings().0.lints } else { Vec::new() };
        let patches = changes.iter().map(|c| c.patch.clone()).collect();
        Edited { rev: document.rev(), dirty, patches, history, lints }
    }

    pub(super) fn changed(&mut self, author: Author, changes: &[Change]) -> Edited {
        let edited = self.announce(author, changes);
        if !changes.is_empty() {
            self.previewing = false;
            self.perform();
            self.tell_findings();
        }
        edited
    }

    pub(super) fn put(&mut self, author: Author, text: String) -> Result<Edited, Error> {
        let next = clip::parse(text)?.clip;
        let document = self.open_document()?;
        if next.robot.id != document.clip().robot.id
            || next.robot.joints != document.clip().robot.joints
        {
            return Err(Error::request(
                "this text is for another robot; open it as a clip of its own instead",
            ));
        }
        let patch = Delta::between(document.clip(), &next);
        let op = Op::Batch(Batch {
            label: "Replace the text".into(),
            ops: vec![Op::Patch(Box::new(patch))],
        });
        let changes =
            document.edit(&[Edit::Op(Box::new(op))]).pop().unwrap_or_else(|| Ok(Vec::new()))?;
        Ok(self.changed(author, &changes))
    }

    pub(super) fn preview(&mut self, op: &Op) -> Result<Option<Demand>, Error> {
        let command = self.open_document()?.preview(op)?;
        let robot = self.simulation.robot();
        let asked = self
            .document
            .as_ref()
            .zip(robot)
            .and_then(|(document, r)| clip::demand(&command, document.command(), &r.table));
        self.previewing = true;
        if self.simulation.rollout.settings().auto {
            self.simulation.preview(&command);
        }
        Ok(asked)
    }

    /// Rolls the document out, if rollouts are switched on.
    pub(super) fn perform(&self) {
        if self.simulation.rollout.settings().auto {
            self.perform_now();
        }
    }

    pub(super) fn perform_now(&self) {
        let Some(document) = &self.document else { return };
        // Without a robot nothing can be performed; the banner has said so.
        if self.simulation.robot().is_some() {
            self.simulation.perform(document.rev(), document.clip(), document.command());
        }
    }

    /// Replaces the open document by another.
    pub(super) fn take_up(&mut self, document: Document, asked: Option<Asked>) -> DocumentView {
        self.close();
        let (facts, refusal) = match asked {
            Some(Ok(facts)) => (Some(facts), None),
            Some(Err(e)) => (None, Some(e)),
            None => (None, None),
        };
        self.simulation.set_robot(facts);
        let settings = self.suited(&document.clip().robot.id);
        self.settle_on(settings);
        if let Some(path) = document.path() {
            self.workspace.recent.opened(path, document.clip());
        }
        self.document = Some(document);
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

    pub(super) fn save(&mut self, path: Option<&Path>, replace: bool) -> Result<Saved, Error> {
        let workspace = Arc::clone(&self.workspace);
        let document = self.open_document()?;
        document.save(path, replace, &workspace.state_dir)?;
        let saved = Saved {
            path: document.path().map(|p| p.display().to_string()).unwrap_or_default(),
            rev: document.rev(),
        };
        if let (Some(document), Some(path)) =
            (&self.document, self.document.as_ref().and_then(Document::path))
        {
            self.workspace.recent.opened(path, document.clip());
        }
        self.hub.send(&Event::Saved { path: saved.path.clone(), rev: saved.rev });
        Ok(saved)
    }

    pub(super) fn close(&mut self) {
        if let Some(document) = self.document.take() {
            document.close();
        }
        self.simulation.cancel();
        self.judgement.verdicts.clear();
        self.previewing = false;
    }
}

/// The robot by the id that a clip uses.
pub(crate) fn reference(table: &JointTable) -> RobotRef {
    RobotRef {
        id: table.robot.clone(),
        model: None,
        model_sha256: table.model_sha256.clone(),
        joints: table.names(),
        units: table.joints.iter().map(|j| j.unit).collect(),
    }
}
