//! The supervisor: starts the child, passes requests, notices death, starts another.
//!
//! One thread of its own: `PR_SET_PDEATHSIG` counts the death of the *thread* that forked,
//! so the child must not be started from a pool whose threads come and go. While nothing
//! is asked it sleeps; an idle studio costs nothing.

use std::collections::BTreeMap;
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::process::{Child, Stdio};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use super::{Answer, Ask, Report, Request, WorkerPhase, WorkerState, codec, exit_of};
use crate::studio::error::Error;

/// A child that was stopped and is silent this long while something is asked of it is dead.
const SILENCE: Duration = Duration::from_millis(1500);
/// A child that is silent this long is dead in any case. Its reader never computes, so on a
/// machine that gives it its turn it answers at once; on a crowded one that can take a while.
const DEAD_SILENCE: Duration = Duration::from_secs(15);
/// A child that does not take what is sent to it for so long is dead.
const BLOCKED: Duration = Duration::from_secs(4);
/// A child that is silent this long is asked whether it lives.
const ASK_AFTER: Duration = Duration::from_millis(500);
/// Time for one question (not for a rollout, which may take as long as it moves on).
const PATIENCE: Duration = Duration::from_mins(1);
/// Deaths within [`DEATH_WINDOW`] after which it is given up.
const DEATHS: usize = 3;
const DEATH_WINDOW: Duration = Duration::from_mins(1);

/// Who hears what the worker says unasked. Called from the supervisor's thread; must be
/// quick.
pub trait WorkerSink: Send + Sync {
    /// A part of a rollout.
    fn report(&self, report: Report);
    /// The worker's own state changed.
    fn state(&self, state: &WorkerState);
}

type Reply = Box<dyn FnOnce(Result<Report, Error>) + Send>;

enum Inbox {
    Ask { request: Request, reply: Option<Reply> },
    Answer { child: u64, answer: Answer },
    Gone { child: u64, reason: String },
    Restart,
    Shutdown,
}

/// A way to ask the worker. Clones ask the same one.
#[derive(Clone)]
pub struct WorkerHandle {
    inbox: Sender<Inbox>,
}

impl std::fmt::Debug for WorkerHandle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("WorkerHandle")
    }
}

impl WorkerHandle {
    /// Starts the supervisor, and the child with it. `binary` is this program.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn start(binary: PathBuf, sink: Arc<dyn WorkerSink>) -> io::Result<WorkerHandle> {
        Self::supervise(binary, sink, None)
    }

    /// The same with a child that is started when something is asked, and ended again when
    /// nothing has been asked for `rest`: its memory is needed now and then only.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn start_resting(
        binary: PathBuf,
        sink: Arc<dyn WorkerSink>,
        rest: Duration,
    ) -> io::Result<WorkerHandle> {
        Self::supervise(binary, sink, Some(rest))
    }

    fn supervise(
        binary: PathBuf,
        sink: Arc<dyn WorkerSink>,
        rest: Option<Duration>,
    ) -> io::Result<WorkerHandle> {
        let (inbox, asks) = channel();
        let supervisor = Supervisor {
            binary,
            sink,
            inbox: inbox.clone(),
            child: None,
            started: 0,
            next_id: 0,
            pending: BTreeMap::new(),
            performing: false,
            heard: Instant::now(),
            pinged: false,
            robot: None,
            policy: None,
            perform: None,
            deaths: Vec::new(),
            state: WorkerState::default(),
            rest,
            scratch: tempfile::tempdir()?,
        };
        std::thread::Builder::new().name("worker".into()).spawn(move || supervisor.run(&asks))?;
        Ok(WorkerHandle { inbox })
    }

    /// Asks without waiting for an answer.
    pub fn tell(&self, request: Request) {
        self.inbox.send(Inbox::Ask { request, reply: None }).ok();
    }

    /// Asks, and calls back with the answer.
    pub fn ask_with(
        &self,
        request: Request,
        reply: impl FnOnce(Result<Report, Error>) + Send + 'static,
    ) {
        self.inbox.send(Inbox::Ask { request, reply: Some(Box::new(reply)) }).ok();
    }

    /// Asks and waits, in an asynchronous context.
    ///
    /// # Errors
    /// [`Error::Worker`], [`Error::Simulation`].
    pub async fn ask(&self, request: Request) -> Result<Report, Error> {
        let (tx, rx) = tokio::sync::oneshot::channel();
        self.ask_with(request, move |answer| {
            tx.send(answer).ok();
        });
        rx.await.unwrap_or_else(|_| Err(gone("it has been shut down")))
    }

    /// Asks and waits, on a thread that may block.
    ///
    /// # Errors
    /// [`Error::Worker`], [`Error::Simulation`].
    pub fn ask_blocking(&self, request: Request, patience: Duration) -> Result<Report, Error> {
        let (tx, rx) = channel();
        self.ask_with(request, move |answer| {
            tx.send(answer).ok();
        });
        rx.recv_timeout(patience).unwrap_or_else(|_| Err(gone("it does not answer")))
    }

    /// Starts a new child after the supervisor gave up.
    pub fn restart(&self) {
        self.inbox.send(Inbox::Restart).ok();
    }

    /// Ends the child and the supervisor.
    pub fn shutdown(&self) {
        self.inbox.send(Inbox::Shutdown).ok();
    }
}

fn gone(reason: &str) -> Error {
    Error::Worker { reason: reason.to_owned() }
}

struct Pending {
    reply: Option<Reply>,
    /// When its turn may have begun.
    since: Instant,
    /// It waits behind others of its kind: see [`Request::is_slow`].
    slow: bool,
}

struct Running {
    process: Child,
    socket: UnixStream,
    number: u64,
}

struct Supervisor {
    binary: PathBuf,
    sink: Arc<dyn WorkerSink>,
    inbox: Sender<Inbox>,
    child: Option<Running>,
    started: u64,
    next_id: u64,
    pending: BTreeMap<u64, Pending>,
    /// A rollout is under way.
    performing: bool,
    heard: Instant,
    pinged: bool,
    /// What a new child must be told first.
    robot: Option<Request>,
    policy: Option<Request>,
    perform: Option<Request>,
    deaths: Vec<Instant>,
    state: WorkerState,
    /// Started on demand, ended after so long without any.
    rest: Option<Duration>,
    /// The simulator writes its log into the current folder.
    scratch: tempfile::TempDir,
}

impl Supervisor {
    fn run(mut self, asks: &Receiver<Inbox>) {
        if self.rest.is_none() {
            self.spawn();
        }
        loop {
            let busy = self.performing || !self.pending.is_empty();
            let rest = self.rest.filter(|_| self.child.is_some());
            let message = if let (false, None) = (busy, rest) {
                match asks.recv() {
                    Ok(message) => Some(message),
                    Err(_) => break,
                }
            } else {
                let wait = if busy { Duration::from_millis(100) } else { rest.unwrap_or(SILENCE) };
                match asks.recv_timeout(wait) {
                    Ok(message) => Some(message),
                    Err(RecvTimeoutError::Timeout) => {
                        if !busy && rest.is_some() {
                            self.send_home();
                        }
                        None
                    }
                    Err(RecvTimeoutError::Disconnected) => break,
                }
            };
            match message {
                Some(Inbox::Ask { request, reply }) => self.ask(request, reply),
                Some(Inbox::Answer { child, answer }) if self.is_current(child) => {
                    self.answer(answer);
                }
                Some(Inbox::Gone { child, reason }) if self.is_current(child) => {
                    self.died(&reason);
                }
                Some(Inbox::Restart) if self.child.is_none() => {
                    self.deaths.clear();
                    self.spawn();
                }
                // Nothing new, or from a child that has been buried already.
                None | Some(Inbox::Answer { .. } | Inbox::Gone { .. } | Inbox::Restart) => {}
                Some(Inbox::Shutdown) => break,
            }
            self.watch();
        }
        self.bury();
        self.fail_pending("it has been shut down");
    }

    /// Nobody needs the child at the moment.
    fn send_home(&mut self) {
        if let Some(running) = &mut self.child {
            running.process.kill().ok();
        }
        self.bury();
        self.set_state(WorkerPhase::Starting, None);
    }

    fn is_current(&self, child: u64) -> bool {
        self.child.as_ref().is_some_and(|c| c.number == child)
    }

    fn set_state(&mut self, phase: WorkerPhase, reason: Option<String>) {
        self.state.phase = phase;
        self.state.pid = self.child.as_ref().map(|c| c.process.id());
        if reason.is_some() || phase == WorkerPhase::Ready {
            self.state.reason = reason;
        }
        self.sink.state(&self.state);
    }

    fn spawn(&mut self) {
        self.started += 1;
        match start(&self.binary, self.scratch.path(), self.started, &self.inbox) {
            Ok(running) => {
                self.child = Some(running);
                self.heard = Instant::now();
                self.pinged = false;
                self.set_state(WorkerPhase::Ready, None);
                let again = [self.robot.clone(), self.policy.clone(), self.perform.clone()];
                for request in again.into_iter().flatten() {
                    self.send(request, None);
                }
            }
            Err(e) => {
                let reason = format!("cannot start {}: {e}", self.binary.display());
                self.set_state(WorkerPhase::Stopped, Some(reason));
            }
        }
    }

    fn ask(&mut self, request: Request, reply: Option<Reply>) {
        match &request {
            Request::Robot { .. } => {
                self.robot = Some(request.clone());
                self.perform = None;
            }
            Request::Policy { .. } => {
                self.policy = Some(request.clone());
                self.perform = None;
            }
            Request::Perform { .. } => self.perform = Some(request.clone()),
            Request::Stop => self.perform = None,
            _ => {}
        }
        let recent = self.deaths.iter().filter(|d| d.elapsed() < DEATH_WINDOW).count();
        if self.child.is_none() && self.rest.is_some() && recent < DEATHS {
            self.spawn();
        }
        if self.child.is_none() {
            if let Some(reply) = reply {
                let reason = self.state.reason.clone();
                reply(Err(gone(&reason.unwrap_or_else(|| "it stopped".into()))));
            }
            return;
        }
        self.send(request, reply);
    }

    fn send(&mut self, request: Request, reply: Option<Reply>) {
        if self.pending.is_empty() && !self.performing {
            self.heard = Instant::now();
            self.pinged = false;
        }
        self.performing |= matches!(request, Request::Perform { .. });
        self.next_id += 1;
        let id = self.next_id;
        // A Perform has no answer of its own: its end is told by generation.
        if !matches!(request, Request::Perform { .. }) {
            let (since, slow) = (Instant::now(), request.is_slow());
            self.pending.insert(id, Pending { reply, since, slow });
        }
        let Some(child) = &mut self.child else { return };
        if let Err(e) = codec::write(&mut child.socket, &Ask { id, request }) {
            self.died(&format!("it takes no requests ({e})"));
        }
    }

    fn answer(&mut self, Answer { id, report }: Answer) {
        self.heard = Instant::now();
        self.pinged = false;
        if id == 0 {
            if let (
                Report::Ended { generation, .. },
                Some(Request::Perform { generation: g, .. }),
            ) = (&report, &self.perform)
            {
                self.performing &= generation != g;
            }
            self.sink.report(report);
            return;
        }
        let Some(done) = self.pending.remove(&id) else { return };
        // Who stood in line behind it has not been waited for yet.
        for waiting in self.pending.values_mut().filter(|p| p.slow == done.slow) {
            waiting.since = Instant::now();
        }
        if let Some(reply) = done.reply {
            reply(match report {
                Report::Refused { message, exit } => {
                    Err(Error::Simulation { message, exit: exit_of(exit) })
                }
                other => Ok(other),
            });
        }
        if self.perform.is_none() {
            self.performing = false;
        }
    }

    /// Looks whether the child still moves.
    fn watch(&mut self) {
        if self.child.is_none() || (!self.performing && self.pending.is_empty()) {
            return;
        }
        if self.pending.values().any(|p| p.since.elapsed() > PATIENCE) {
            self.died("one request took longer than a minute");
            return;
        }
        let silent = self.heard.elapsed();
        let dead = silent > DEAD_SILENCE || (silent > SILENCE && self.is_stopped());
        if self.pinged && dead {
            self.died("it does not answer");
        } else if !self.pinged && silent > ASK_AFTER {
            self.pinged = true;
            self.send(Request::Ping, None);
        }
    }

    /// Whether a signal or a debugger holds the child.
    fn is_stopped(&self) -> bool {
        let Some(child) = &self.child else { return false };
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", child.process.id()));
        // After the name in parentheses comes the state.
        let state =
            stat.ok().and_then(|s| s.rsplit_once(") ").map(|(_, rest)| rest.chars().next()));
        matches!(state.flatten(), Some('T' | 't' | 'Z' | 'X'))
    }

    fn died(&mut self, reason: &str) {
        let status = self.bury();
        let reason = match status {
            Some(status) if !reason.is_empty() => format!("{reason}; {status}"),
            Some(status) => status,
            None => reason.to_owned(),
        };
        tracing::warn!("the simulation died: {reason}");
        self.fail_pending(&format!("it died: {reason}"));
        self.performing = false;
        self.state.deaths += 1;
        let now = Instant::now();
        self.deaths.retain(|d| now.duration_since(*d) < DEATH_WINDOW);
        self.deaths.push(now);
        if self.deaths.len() >= DEATHS {
            let reason = format!("it died {DEATHS} times within a minute; last: {reason}");
            self.set_state(WorkerPhase::Stopped, Some(reason));
            return;
        }
        self.set_state(WorkerPhase::Restarting, Some(reason));
        self.spawn();
    }

    /// Kills and reaps the child; says how it ended.
    fn bury(&mut self) -> Option<String> {
        let mut running = self.child.take()?;
        // Give a child that has just hung up the moment it needs to leave its own status.
        let mut status = None;
        for _ in 0..10 {
            status = running.process.try_wait().ok().flatten();
            if status.is_some() {
                break;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        if status.is_none() {
            running.process.kill().ok();
            running.process.wait().ok();
            return None;
        }
        status.map(|s| s.to_string())
    }

    fn fail_pending(&mut self, reason: &str) {
        for pending in std::mem::take(&mut self.pending).into_values() {
            if let Some(reply) = pending.reply {
                reply(Err(gone(reason)));
            }
        }
    }
}

fn start(
    binary: &std::path::Path,
    scratch: &std::path::Path,
    number: u64,
    inbox: &Sender<Inbox>,
) -> io::Result<Running> {
    let (ours, theirs) = UnixStream::pair()?;
    let process = crate::child::command(binary)
        .arg("__worker")
        .stdin(Stdio::from(OwnedFd::from(theirs)))
        .stdout(Stdio::null())
        .current_dir(scratch)
        .spawn()?;
    // A child that was stopped lets the buffer run full: better a death than a wait.
    ours.set_write_timeout(Some(BLOCKED))?;
    let mut reading = io::BufReader::new(ours.try_clone()?);
    let inbox = inbox.clone();
    std::thread::Builder::new().name("worker-in".into()).spawn(move || {
        let reason = loop {
            match codec::read::<Answer>(&mut reading) {
                Ok(Some(answer)) => {
                    if inbox.send(Inbox::Answer { child: number, answer }).is_err() {
                        return;
                    }
                }
                Ok(None) => break String::new(),
                Err(e) => break format!("it speaks nonsense ({e})"),
            }
        };
        inbox.send(Inbox::Gone { child: number, reason }).ok();
    })?;
    Ok(Running { process, socket: ours, number })
}
