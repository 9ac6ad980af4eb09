//! The writer: one thread that owns the document and waits for disks.
//!
//! All changes of the document are made here, one after another; edits that wait together share
//! one `fdatasync`. Nobody else waits for it: the session shows the document as it was last
//! acknowledged, and a refused or failed edit was never seen by anybody. If this thread panics the
//! process ends: the journal is on disk, and a half-applied edit must never be built upon.

use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::command::{Answered, Author, Reply, SessionCommand, Write, Written};
use super::shown::Shown;
use crate::document::{Document, Edit};
use crate::protocol::{Edited, Error, Saved};
use crate::simulation::Simulation;
use crate::workspace::Workspace;
use robert_base::limits;
use robert_clip as clip;
use robert_clip::{Batch, Change, Delta, Op};

/// If the writer has worked on one change for longer than this, it accepts no others. It is the
/// time limit of a request, so whoever sent that change has already been told that there is no
/// answer.
const PATIENCE: Duration = Duration::from_secs(limits::BODY_SECS);

/// The time at which the writer began its current work; `None` while it waits.
type Busy = Arc<Mutex<Option<Instant>>>;

/// The way to the writer.
pub(super) struct WriterHandle {
    asks: Sender<Write>,
    busy: Busy,
}

impl WriterHandle {
    /// Passes a command on, or refuses it if the disk has not answered for [`PATIENCE`].
    pub(super) fn tell(&self, ask: Write) {
        let busy = *self.busy.lock().unwrap_or_else(PoisonError::into_inner);
        match busy.map(|since| since.elapsed()) {
            Some(waited) if waited > PATIENCE => ask.refuse(Error::Stalled { waited }),
            _ => drop(self.asks.send(ask)),
        }
    }
}

pub(super) struct Writer {
    pub(super) document: Option<Document>,
    pub(super) workspace: Arc<Workspace>,
    pub(super) simulation: Simulation,
    /// Folders of robots that are not in the program, by id.
    pub(super) sources: BTreeMap<String, String>,
    session: Sender<SessionCommand>,
    busy: Busy,
}

impl Writer {
    /// Starts the thread. What it has done goes to `session`.
    ///
    /// # Errors
    /// If the operating system cannot start the thread.
    pub(super) fn start(
        workspace: Arc<Workspace>,
        simulation: Simulation,
        session: Sender<SessionCommand>,
    ) -> std::io::Result<WriterHandle> {
        let (asks, inbox) = channel();
        let busy = Busy::default();
        let handle = WriterHandle { asks, busy: Arc::clone(&busy) };
        let sources = BTreeMap::new();
        let writer = Writer { document: None, workspace, simulation, sources, session, busy };
        std::thread::Builder::new().name("writer".into()).spawn(move || {
            super::or_end(move || writer.run(&inbox));
        })?;
        Ok(handle)
    }

    fn run(mut self, asks: &Receiver<Write>) {
        while let Ok(first) = asks.recv() {
            let mut edits = Vec::new();
            let mut next = Some(first);
            while let Some(ask) = next {
                match ask {
                    Write::Edit(author, edit, reply) => edits.push((author, edit, reply)),
                    Write::Shutdown(reply) => {
                        self.edit(std::mem::take(&mut edits));
                        if let Some(document) = self.document.take() {
                            document.close();
                        }
                        self.tell(Written::Ended(reply));
                        return;
                    }
                    other => {
                        self.edit(std::mem::take(&mut edits));
                        self.at_work(|writer| writer.answer(other));
                    }
                }
                next = asks.try_recv().ok();
            }
            self.edit(edits);
        }
    }

    /// Others can see how long it takes.
    fn at_work(&mut self, work: impl FnOnce(&mut Writer)) {
        let busy = Arc::clone(&self.busy);
        *busy.lock().unwrap_or_else(PoisonError::into_inner) = Some(Instant::now());
        work(self);
        *busy.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }

    pub(super) fn tell(&self, written: Written) {
        self.session.send(SessionCommand::Written(Box::new(written))).ok();
    }

    fn answer(&mut self, ask: Write) {
        match ask {
            Write::Put(author, text, reply) => {
                let result = self.put(text);
                self.tell(Written::Edits(vec![(result, author, reply)], self.shown()));
            }
            Write::Discard(author, reply) => {
                let result = self.open_document().and_then(Document::discard);
                self.tell(Written::Edits(vec![(result, author, reply)], self.shown()));
            }
            Write::Reload(author, reply) => {
                let result = self.open_document().and_then(Document::reload);
                self.tell(Written::Reloaded((result, author, reply), self.shown()));
            }
            Write::Open(path, reply) => self.open(&path, reply),
            Write::New(clip, reply) => self.start_from(*clip, reply),
            Write::Blank { robot, length, name, reply } => self.blank(&robot, length, name, reply),
            Write::Know(robot, reply) => {
                reply.send(self.know(&robot).map(|_| ())).ok();
            }
            Write::Draft(number, reply) => self.take_up_draft(number, reply),
            Write::Recover(reply) => self.recover(reply),
            Write::Recovered(reply) => {
                if let Some(document) = &mut self.document {
                    document.taken_up();
                }
                reply.send(Ok(true)).ok();
            }
            Write::Save { path, replace, reply } => {
                let result = self.save(path.as_deref(), replace);
                self.tell(Written::Saved(result, self.shown(), reply));
            }
            Write::Close(reply) => {
                if let Some(document) = self.document.take() {
                    document.close();
                }
                self.tell(Written::Closed(reply));
            }
            Write::Edit(..) | Write::Shutdown(_) => {}
        }
    }

    fn shown(&self) -> Option<Shown> {
        self.document.as_ref().map(Shown::of)
    }

    fn open_document(&mut self) -> Result<&mut Document, Error> {
        self.document.as_mut().ok_or(Error::NoDocument)
    }

    fn edit(&mut self, edits: Vec<(Author, Edit, Reply<Edited>)>) {
        if edits.is_empty() {
            return;
        }
        self.at_work(|writer| {
            let (asked, rest): (Vec<Edit>, Vec<(Author, Reply<Edited>)>) =
                edits.into_iter().map(|(a, e, r)| (e, (a, r))).unzip();
            let answers = match &mut writer.document {
                Some(document) => document.edit(&asked),
                None => asked.iter().map(|_| Err(Error::NoDocument)).collect(),
            };
            let answered = answers.into_iter().zip(rest);
            let answered: Vec<Answered> = answered.map(|(r, (a, reply))| (r, a, reply)).collect();
            writer.tell(Written::Edits(answered, writer.shown()));
        });
    }

    fn put(&mut self, text: String) -> Result<Vec<Change>, Error> {
        let next = clip::parse(text)?.clip;
        let document = self.open_document()?;
        if !document.takes_content_of(&next) {
            return Err(Error::request(
                "this text is for another robot or has other extensions (`robot`, `x`); open it as a clip of its own instead",
            ));
        }
        let patch = Delta::between(document.clip(), &next);
        let op = Op::Batch(Batch {
            label: "Replace the text".into(),
            ops: vec![Op::Patch(Box::new(patch))],
        });
        document.edit(&[Edit::Op(Box::new(op))]).pop().unwrap_or_else(|| Ok(Vec::new()))
    }

    fn save(&mut self, path: Option<&std::path::Path>, replace: bool) -> Result<Saved, Error> {
        let workspace = Arc::clone(&self.workspace);
        let document = self.open_document()?;
        document.save(path, replace, &workspace.state_dir)?;
        if let Some(path) = document.path() {
            workspace.recent.opened(path, document.clip());
        }
        let path = document.path().map(|p| p.display().to_string()).unwrap_or_default();
        Ok(Saved { path, rev: document.version().rev })
    }
}
