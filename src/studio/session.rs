//! The session: one thread that owns the document.
//!
//! Whatever clients ask arrives in one queue and is done in order; edits that wait together
//! share one `fdatasync`. If this thread panics the process ends: the journal is on disk, and
//! a half-applied edit must never be built upon.

mod findings;
mod opening;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use tokio::sync::oneshot;

use self::opening::Asked;
use super::document::{Document, Edit};
use super::error::Error;
use super::hub::Hub;
use super::live::Live;
use super::protocol::{
    DocumentView, Edited, Event, Findings, History, RolloutSettings, Saved, policies,
};
use super::recent::Recent;
use super::worker::{Checked, Report, RobotFacts, WorkerHandle};
use crate::clip::{
    self, Batch, Change, Clip, Command, Delta, Demand, Granularity, JointTable, Level, Op, RobotRef,
};
use crate::net::MaskGranularity;
use crate::net::checkpoint::read_card;
use crate::rollout::{Guide, Offer, PolicyName, model_path};

/// Labels of the history that are sent.
const LABELS: usize = 100;
/// How long opening waits for the facts of its robot.
const ROBOT_PATIENCE: Duration = Duration::from_secs(20);
/// Poses whose verdicts are remembered.
const VERDICTS: usize = 4_000;
/// Poses that are judged in one go, so that a question in between need not wait long.
const JUDGED_AT_ONCE: usize = 4;

/// Who asks for an edit.
#[derive(Clone, Copy, Debug, Default)]
pub struct Author {
    /// Client number; 0 over HTTP.
    pub client: u64,
    /// Its request.
    pub id: Option<u64>,
}

type Reply<T> = oneshot::Sender<Result<T, Error>>;

/// What is asked of the session.
#[derive(Debug)]
pub enum Ask {
    /// An edit, undo, redo.
    Edit(Author, Edit, Reply<Edited>),
    /// Replaces the content by this text, as an edit.
    Put(Author, String, Reply<Edited>),
    /// Gives up unsaved edits.
    Discard(Author, Reply<Edited>),
    /// Rolls out as if.
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
    Judged { robot: String, poses: Vec<Vec<f64>>, verdicts: Result<Report, Error> },
    /// Ends the session.
    Shutdown(Reply<()>),
}

/// A way to ask the session.
#[derive(Clone, Debug)]
pub struct Session(Sender<Ask>);

impl Session {
    /// Starts the thread.
    ///
    /// # Errors
    /// When the system gives none.
    pub fn start(
        state_dir: PathBuf,
        folder: PathBuf,
        hub: Hub,
        live: Arc<Live>,
        worker: WorkerHandle,
        recent: Arc<Recent>,
    ) -> std::io::Result<Session> {
        let (tx, rx) = channel();
        let desk = Desk {
            document: None,
            opened: 0,
            state_dir,
            hub,
            live,
            worker,
            recent,
            facts: None,
            sources: BTreeMap::new(),
            folder,
            verdicts: BTreeMap::new(),
            judging: false,
            previewing: false,
            chosen: false,
            granularity: Granularity::Joint,
            inbox: tx.clone(),
        };
        std::thread::Builder::new().name("session".into()).spawn(move || {
            let work = std::panic::AssertUnwindSafe(move || desk.run(&rx));
            if std::panic::catch_unwind(work).is_err() {
                tracing::error!("the session broke; every acknowledged edit is in its journal");
                std::process::exit(1);
            }
        })?;
        Ok(Session(tx))
    }

    /// Asks and waits.
    ///
    /// # Errors
    /// The session's refusal.
    pub async fn ask<T>(&self, ask: impl FnOnce(Reply<T>) -> Ask) -> Result<T, Error> {
        let (tx, rx) = oneshot::channel();
        self.0.send(ask(tx)).ok();
        rx.await.unwrap_or_else(|_| Err(Error::request("the studio is shutting down")))
    }
}

struct Desk {
    document: Option<Document>,
    /// How many documents there have been.
    opened: u64,
    state_dir: PathBuf,
    hub: Hub,
    live: Arc<Live>,
    worker: WorkerHandle,
    recent: Arc<Recent>,
    facts: Option<Arc<RobotFacts>>,
    /// Folders of robots that are not in the program, by id.
    sources: BTreeMap<String, String>,
    folder: PathBuf,
    /// By the bits of a pose in state order.
    verdicts: BTreeMap<Vec<u64>, Checked>,
    judging: bool,
    previewing: bool,
    /// Somebody chose a policy; until then each robot has its own.
    chosen: bool,
    /// What masks the policy in use can take.
    granularity: Granularity,
    inbox: Sender<Ask>,
}

impl Desk {
    fn run(mut self, asks: &Receiver<Ask>) {
        while let Ok(first) = asks.recv() {
            let mut edits = Vec::new();
            let mut next = Some(first);
            while let Some(ask) = next {
                match ask {
                    Ask::Edit(author, edit, reply) => edits.push((author, edit, reply)),
                    Ask::Shutdown(reply) => {
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
        }
    }

    fn answer(&mut self, ask: Ask) {
        match ask {
            Ask::Put(author, text, reply) => {
                let result = self.put(author, text);
                reply.send(result).ok();
            }
            Ask::Discard(author, reply) => {
                let result = self.open_document().and_then(Document::discard);
                let result = result.map(|changes| self.changed(author, &changes));
                reply.send(result).ok();
            }
            Ask::Preview(op, reply) => {
                reply.send(self.preview(&op)).ok();
            }
            Ask::PreviewEnd(reply) => {
                if std::mem::take(&mut self.previewing) {
                    self.perform();
                }
                reply.send(Ok(())).ok();
            }
            Ask::Open(path, reply) => {
                let result = self.open(&path);
                reply.send(result).ok();
            }
            Ask::New(clip, reply) => {
                let result = self.start_from(*clip);
                reply.send(result).ok();
            }
            Ask::Blank { robot, length, name, reply } => {
                let result = self.blank(&robot, length, name);
                reply.send(result).ok();
            }
            Ask::Know(robot, reply) => {
                reply.send(self.know(&robot).map(|_| ())).ok();
            }
            Ask::Draft(number, reply) => {
                let result = self.take_up_draft(number);
                reply.send(result).ok();
            }
            Ask::Recover(reply) => {
                reply.send(Ok(self.recover())).ok();
            }
            Ask::Save { path, replace, reply } => {
                let result = self.save(path.as_deref(), replace);
                reply.send(result).ok();
            }
            Ask::Close(reply) => {
                self.close();
                self.live.set_facts(None);
                self.hub.send(&Event::Document { document: None });
                reply.send(Ok(())).ok();
            }
            Ask::View(reply) => {
                let view = self.document.is_some().then(|| Box::new(self.view()));
                reply.send(Ok(view)).ok();
            }
            Ask::Text(reply) => {
                let text = self.document.as_ref().map(Document::text);
                reply.send(text.ok_or(Error::NoDocument)).ok();
            }
            Ask::Content(reply) => {
                let content =
                    self.document.as_ref().map(|d| (d.clip().clone(), d.command().clone()));
                reply.send(content.ok_or(Error::NoDocument)).ok();
            }
            Ask::Settings(settings, reply) => {
                self.chosen = true;
                self.settle_on(settings);
                self.perform();
                self.tell_findings();
                reply.send(Ok(())).ok();
            }
            Ask::Run(reply) => {
                let result = self.open_document().map(|_| ());
                if result.is_ok() {
                    self.perform_now();
                }
                reply.send(result).ok();
            }
            Ask::Judged { robot, poses, verdicts } => self.judged(&robot, &poses, verdicts),
            Ask::Edit(..) | Ask::Shutdown(_) => {}
        }
    }

    /// Performs so from now on.
    fn settle_on(&mut self, settings: RolloutSettings) {
        self.granularity = match self.masks(&settings) {
            MaskGranularity::State => Granularity::State,
            MaskGranularity::Joint => Granularity::Joint,
        };
        self.live.set_settings(settings.clone(), &self.worker, &self.folder);
        self.hub.send(&Event::RolloutSettings(settings));
    }

    fn offers(&self) -> &[Offer] {
        self.facts.as_ref().map(|f| f.offers.as_slice()).unwrap_or_default()
    }

    /// What masks may hide from the policy of these settings. A model that cannot be read
    /// says so itself when it is to perform.
    fn masks(&self, settings: &RolloutSettings) -> MaskGranularity {
        let offered = self
            .offers()
            .iter()
            .find(|o| o.name == settings.policy && o.model == settings.model_path);
        match (offered, &settings.model_path) {
            (Some(offer), _) => offer.masks,
            (None, Some(path)) if settings.policy.needs_model() => {
                let card = read_card(&model_path(&self.folder.join(path)));
                card.map_or(MaskGranularity::Joint, |c| c.masks())
            }
            _ => MaskGranularity::Joint,
        }
    }

    /// The settings for the robot of the document that is being opened: what was chosen, as
    /// far as this robot can have it.
    fn suited(&self, robot: &str) -> RolloutSettings {
        let mut settings = self.live.settings();
        let offers = self.offers();
        if let Some(path) = &settings.model_path {
            let named = offers.iter().any(|o| o.model.as_ref() == Some(path));
            let file = model_path(&self.folder.join(path));
            // Fits of other kinds have no card; whether they suit shows when they are loaded.
            let other = || !file.exists() || read_card(&file).is_ok_and(|c| c.robot.id != robot);
            if !named && other() {
                settings.model_path = None;
                settings.guide = Guide::None;
            }
        }
        let known = offers.iter().find(|o| o.name == settings.policy && o.model.is_none());
        let has = settings.model_path.is_some() || known.is_some_and(|o| o.needs.is_none());
        if (!self.chosen && settings.model_path.is_none()) || !has {
            let default = offers.iter().find(|o| o.default).map(|o| o.name);
            settings.policy = default.unwrap_or(PolicyName::ComputedTorque);
        }
        settings
    }

    fn open_document(&mut self) -> Result<&mut Document, Error> {
        self.document.as_mut().ok_or(Error::NoDocument)
    }

    fn edit(&mut self, edits: Vec<(Author, Edit, Reply<Edited>)>) {
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

    /// Tells everyone about changes; what the author gets back.
    fn announce(&self, author: Author, changes: &[Change]) -> Edited {
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

    fn changed(&mut self, author: Author, changes: &[Change]) -> Edited {
        let edited = self.announce(author, changes);
        if !changes.is_empty() {
            self.previewing = false;
            self.perform();
            self.tell_findings();
        }
        edited
    }

    fn put(&mut self, author: Author, text: String) -> Result<Edited, Error> {
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

    fn preview(&mut self, op: &Op) -> Result<Option<Demand>, Error> {
        let document = self.open_document()?;
        let command = document.preview(op)?;
        let facts = self.facts.as_ref();
        let asked =
            self.document.as_ref().zip(facts).and_then(|(document, facts)| {
                clip::demand(&command, document.command(), &facts.table)
            });
        self.previewing = true;
        if self.live.settings().auto {
            self.live.perform(0, &command, &self.worker);
        }
        Ok(asked)
    }

    /// Rolls the document out, if that is wanted.
    fn perform(&self) {
        if self.live.settings().auto {
            self.perform_now();
        }
    }

    fn perform_now(&self) {
        let Some(document) = &self.document else { return };
        // Without a robot there is nobody to perform; the banner has said so.
        if self.facts.is_some() {
            self.live.set_clip(document.clip());
            self.live.perform(document.rev(), document.command(), &self.worker);
        }
    }

    /// Puts a document in the place of the open one.
    fn take_up(&mut self, document: Document, asked: Option<Asked>) -> DocumentView {
        self.close();
        let (facts, refusal) = match asked {
            Some(Ok(facts)) => (Some(facts), None),
            Some(Err(e)) => (None, Some(e)),
            None => (None, None),
        };
        self.facts = facts.map(Arc::new);
        self.live.set_facts(self.facts.clone());
        let settings = self.suited(&document.clip().robot.id);
        self.settle_on(settings);
        if let Some(path) = document.path() {
            self.recent.opened(path, document.clip());
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

    fn save(&mut self, path: Option<&Path>, replace: bool) -> Result<Saved, Error> {
        let state_dir = self.state_dir.clone();
        let document = self.open_document()?;
        document.save(path, replace, &state_dir)?;
        let saved = Saved {
            path: document.path().map(|p| p.display().to_string()).unwrap_or_default(),
            rev: document.rev(),
        };
        if let (Some(document), Some(path)) =
            (&self.document, self.document.as_ref().and_then(Document::path))
        {
            self.recent.opened(path, document.clip());
        }
        self.hub.send(&Event::Saved { path: saved.path.clone(), rev: saved.rev });
        Ok(saved)
    }

    fn close(&mut self) {
        if let Some(document) = self.document.take() {
            document.close();
        }
        self.live.cancel(&self.worker);
        self.facts = None;
        self.verdicts.clear();
        self.previewing = false;
    }

    /// What is known about the robot, with what the policy in use can leave open.
    fn table(&self) -> JointTable {
        let clip = || self.document.as_ref().map(|d| JointTable::from_clip(d.clip()));
        let known = self.facts.as_ref().map(|f| f.table.clone()).or_else(clip);
        let mut table = known.unwrap_or_else(|| JointTable::from_clip(&nothing()));
        table.granularity = self.granularity;
        table
    }

    fn view(&self) -> DocumentView {
        let Some(document) = &self.document else {
            return DocumentView {
                opened: self.opened,
                rev: 0,
                clip: serde_json::Value::Null,
                path: None,
                dirty: false,
                history: History::default(),
                table: self.table(),
                restored: None,
                findings: Findings::default(),
                policies: Vec::new(),
            };
        };
        DocumentView {
            opened: self.opened,
            rev: document.rev(),
            clip: document.clip().to_json(),
            path: document.path().map(|p| p.display().to_string()),
            dirty: document.is_dirty(),
            history: history(document),
            table: self.table(),
            restored: document.restored().cloned(),
            findings: self.findings().0,
            policies: policies(self.offers()),
        }
    }
}

/// A robot as a clip of it names it.
pub(super) fn reference(table: &JointTable) -> RobotRef {
    RobotRef {
        id: table.robot.clone(),
        model: None,
        model_sha256: table.model_sha256.clone(),
        joints: table.names(),
        units: table.joints.iter().map(|j| j.unit).collect(),
    }
}

/// A clip of no robot.
fn nothing() -> Clip {
    Clip::new(RobotRef::default(), 2)
}

fn history(document: &Document) -> History {
    let (len, done) = document.history();
    // A window around the present, so that undoing far back still shows names.
    let first = done.saturating_sub(LABELS).min(len.saturating_sub(LABELS));
    let labels = document.labels(first..first + LABELS);
    History { labels, first, done, len }
}
