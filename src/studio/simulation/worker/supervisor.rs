//! The supervisor: it starts the child, passes requests on, and replaces a child that died.
//!
//! It is a thread of its own, because `PR_SET_PDEATHSIG` reacts to the end of the *thread* that
//! forked: the child must not be started from a pool whose threads come and go. Without requests it
//! sleeps, so an idle studio needs no processor time.

use std::collections::BTreeMap;
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::process::{Child, Stdio};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use serde_bytes::ByteBuf;

use super::codec;
use super::message::{
    Envelope, Perform, Ping, Refusal, SimulationEvent, WorkerMessage, WorkerRequest,
};
use crate::protocol::{Error, WorkerPhase, WorkerState};
use robert_base::exit::Exit;
use robert_base::scratch::Scratch;

/// A stopped child that is silent for this long during a question is considered dead.
const SILENCE: Duration = Duration::from_millis(1500);
/// A child that is silent for this long is considered dead in any case. Its reader thread never
/// computes, so it answers at once when the machine runs it; on a crowded machine that can take a
/// while.
const DEAD_SILENCE: Duration = Duration::from_secs(15);
/// A child that does not read its messages for this long is considered dead.
const BLOCKED: Duration = Duration::from_secs(4);
/// After this time without a message the child is asked whether it is alive.
const ASK_AFTER: Duration = Duration::from_millis(500);
/// Time for one question (not for a rollout, which may take as long as it moves on).
const PATIENCE: Duration = Duration::from_mins(1);
/// The number of deaths within [`DEATH_WINDOW`] after which no new child is started.
const DEATHS: usize = 3;
const DEATH_WINDOW: Duration = Duration::from_mins(1);

/// Receives the worker's events. Called from the supervisor's thread; must be quick.
pub(crate) trait WorkerSink: Send + Sync {
    /// A part of a rollout.
    fn event(&self, event: SimulationEvent);
    /// The worker's own state changed.
    fn state(&self, state: &WorkerState);
}

/// Takes an answer as it came.
pub(super) type Reply = Box<dyn FnOnce(Result<ByteBuf, Error>) + Send>;

/// Messages to the supervisor.
pub(super) enum Inbox {
    Ask { request: WorkerRequest, reply: Option<Reply> },
    Message { child: u64, message: WorkerMessage },
    Gone { child: u64, reason: String },
    Restart,
    Shutdown,
}

/// The worker is not there.
pub(super) fn gone(reason: &str) -> Error {
    Error::Worker { reason: reason.to_owned() }
}

struct Pending {
    reply: Option<Reply>,
    /// The earliest time at which the worker can have begun it.
    since: Instant,
    /// Whether it waits behind other slow requests: see [`WorkerRequest::is_slow`].
    slow: bool,
}

struct Running {
    process: Child,
    socket: UnixStream,
    number: u64,
}

/// Requests that are sent again to a new child.
#[derive(Default)]
struct Replayed {
    robot: Option<WorkerRequest>,
    policy: Option<WorkerRequest>,
    perform: Option<Box<Perform>>,
}

impl Replayed {
    fn note(&mut self, request: &WorkerRequest) {
        match request {
            WorkerRequest::LoadRobot(_) => {
                self.robot = Some(request.clone());
                self.perform = None;
            }
            WorkerRequest::SetPolicy(_) => {
                self.policy = Some(request.clone());
                self.perform = None;
            }
            WorkerRequest::Perform(perform) => self.perform = Some(perform.clone()),
            WorkerRequest::Stop(_) => self.perform = None,
            _ => {}
        }
    }

    fn requests(&self) -> impl Iterator<Item = WorkerRequest> + use<> {
        let perform = self.perform.clone().map(WorkerRequest::Perform);
        [self.robot.clone(), self.policy.clone(), perform].into_iter().flatten()
    }
}

/// Signs of life of the child.
struct Pulse {
    /// The time of its last message, or of the first request after a rest.
    heard: Instant,
    /// It was asked whether it lives.
    pinged: bool,
    /// A rollout is under way.
    performing: bool,
}

struct Supervisor {
    binary: PathBuf,
    sink: Arc<dyn WorkerSink>,
    inbox: Sender<Inbox>,
    child: Option<Running>,
    questions: Questions,
    pulse: Pulse,
    replayed: Replayed,
    history: History,
    /// The child is started on demand, and ended after this time without demand.
    rest: Option<Duration>,
    /// The simulator writes its log into the current folder.
    scratch: Scratch,
}

/// Questions without an answer so far.
#[derive(Default)]
struct Questions {
    last_id: u64,
    pending: BTreeMap<u64, Pending>,
}

/// The children so far.
#[derive(Default)]
struct History {
    started: u64,
    deaths: Vec<Instant>,
    state: WorkerState,
}

/// Starts the supervisor; messages to it go into the inbox.
pub(super) fn start(
    binary: PathBuf,
    sink: Arc<dyn WorkerSink>,
    rest: Option<Duration>,
) -> io::Result<Sender<Inbox>> {
    let (inbox, messages) = channel();
    let supervisor = Supervisor {
        binary,
        sink,
        inbox: inbox.clone(),
        child: None,
        questions: Questions::default(),
        pulse: Pulse { heard: Instant::now(), pinged: false, performing: false },
        replayed: Replayed::default(),
        history: History::default(),
        rest,
        scratch: Scratch::new()?,
    };
    std::thread::Builder::new().name("worker".into()).spawn(move || supervisor.run(&messages))?;
    Ok(inbox)
}

impl Supervisor {
    fn run(mut self, messages: &Receiver<Inbox>) {
        if self.rest.is_none() {
            self.spawn();
        }
        loop {
            let busy = self.pulse.performing || !self.questions.pending.is_empty();
            let rest = self.rest.filter(|_| self.child.is_some());
            let message = if let (false, None) = (busy, rest) {
                match messages.recv() {
                    Ok(message) => Some(message),
                    Err(_) => break,
                }
            } else {
                let wait = if busy { Duration::from_millis(100) } else { rest.unwrap_or(SILENCE) };
                match messages.recv_timeout(wait) {
                    Ok(message) => Some(message),
                    Err(RecvTimeoutError::Timeout) => {
                        if !busy && rest.is_some() {
                            self.stop_resting();
                        }
                        None
                    }
                    Err(RecvTimeoutError::Disconnected) => break,
                }
            };
            match message {
                Some(Inbox::Ask { request, reply }) => self.ask(request, reply),
                Some(Inbox::Message { child, message }) if self.is_current(child) => {
                    self.handle(message);
                }
                Some(Inbox::Gone { child, reason }) if self.is_current(child) => {
                    self.died(&reason);
                }
                Some(Inbox::Restart) if self.child.is_none() => {
                    self.history.deaths.clear();
                    self.spawn();
                }
                // There is no message, or it is from a child that has been replaced.
                None | Some(Inbox::Message { .. } | Inbox::Gone { .. } | Inbox::Restart) => {}
                Some(Inbox::Shutdown) => break,
            }
            self.watch();
        }
        self.reap();
        self.fail_pending("it has been shut down");
    }

    /// Nobody needs the child at the moment.
    fn stop_resting(&mut self) {
        if let Some(running) = &mut self.child {
            running.process.kill().ok();
        }
        self.reap();
        self.set_state(WorkerPhase::Starting, None);
    }

    fn is_current(&self, child: u64) -> bool {
        self.child.as_ref().is_some_and(|c| c.number == child)
    }

    fn set_state(&mut self, phase: WorkerPhase, reason: Option<String>) {
        self.history.state.phase = phase;
        self.history.state.pid = self.child.as_ref().map(|c| c.process.id());
        if reason.is_some() || phase == WorkerPhase::Ready {
            self.history.state.reason = reason;
        }
        self.sink.state(&self.history.state);
    }

    fn spawn(&mut self) {
        self.history.started += 1;
        match spawn(&self.binary, self.scratch.path(), self.history.started, &self.inbox) {
            Ok(running) => {
                self.child = Some(running);
                self.pulse.heard = Instant::now();
                self.pulse.pinged = false;
                self.set_state(WorkerPhase::Ready, None);
                for request in self.replayed.requests() {
                    self.send(request, None);
                }
            }
            Err(e) => {
                let reason = format!("cannot start {}: {e}", self.binary.display());
                self.set_state(WorkerPhase::Stopped, Some(reason));
            }
        }
    }

    fn ask(&mut self, request: WorkerRequest, reply: Option<Reply>) {
        self.replayed.note(&request);
        let recent = self.history.deaths.iter().filter(|d| d.elapsed() < DEATH_WINDOW).count();
        if self.child.is_none() && self.rest.is_some() && recent < DEATHS {
            self.spawn();
        }
        if self.child.is_none() {
            if let Some(reply) = reply {
                let reason = self.history.state.reason.clone();
                reply(Err(gone(&reason.unwrap_or_else(|| "it stopped".into()))));
            }
            return;
        }
        self.send(request, reply);
    }

    fn send(&mut self, request: WorkerRequest, reply: Option<Reply>) {
        if self.questions.pending.is_empty() && !self.pulse.performing {
            self.pulse.heard = Instant::now();
            self.pulse.pinged = false;
        }
        self.pulse.performing |= matches!(request, WorkerRequest::Perform(_));
        self.questions.last_id += 1;
        let id = self.questions.last_id;
        // A Perform has no answer of its own: its end is told by generation.
        if !matches!(request, WorkerRequest::Perform(_)) {
            let (since, slow) = (Instant::now(), request.is_slow());
            self.questions.pending.insert(id, Pending { reply, since, slow });
        }
        let Some(child) = &mut self.child else { return };
        if let Err(e) = codec::write(&mut child.socket, &Envelope { id, request }) {
            self.died(&format!("it takes no requests ({e})"));
        }
    }

    fn handle(&mut self, message: WorkerMessage) {
        self.pulse.heard = Instant::now();
        self.pulse.pinged = false;
        match message {
            WorkerMessage::Event(event) => {
                if let (SimulationEvent::Ended { generation, .. }, Some(perform)) =
                    (&event, &self.replayed.perform)
                {
                    self.pulse.performing &= *generation != perform.generation;
                }
                self.sink.event(event);
            }
            WorkerMessage::Answer(id, body) => self.answer(id, Ok(body)),
            WorkerMessage::Refused(id, Refusal { message, exit }) => {
                self.answer(id, Err(Error::Simulation { message, exit: exit_of(exit) }));
            }
        }
    }

    fn answer(&mut self, id: u64, answer: Result<ByteBuf, Error>) {
        let Some(done) = self.questions.pending.remove(&id) else { return };
        // The requests behind it have not waited for their own answers yet.
        for waiting in self.questions.pending.values_mut().filter(|p| p.slow == done.slow) {
            waiting.since = Instant::now();
        }
        if let Some(reply) = done.reply {
            reply(answer);
        }
        if self.replayed.perform.is_none() {
            self.pulse.performing = false;
        }
    }

    /// Looks whether the child still moves.
    fn watch(&mut self) {
        if self.child.is_none() || (!self.pulse.performing && self.questions.pending.is_empty()) {
            return;
        }
        if self.questions.pending.values().any(|p| p.since.elapsed() > PATIENCE) {
            self.died("one request took longer than a minute");
            return;
        }
        let silent = self.pulse.heard.elapsed();
        let dead = silent > DEAD_SILENCE || (silent > SILENCE && self.is_stopped());
        if self.pulse.pinged && dead {
            self.died("it does not answer");
        } else if !self.pulse.pinged && silent > ASK_AFTER {
            self.pulse.pinged = true;
            self.send(WorkerRequest::from(Ping), None);
        }
    }

    /// Whether the child is stopped by a signal or a debugger.
    fn is_stopped(&self) -> bool {
        let Some(child) = &self.child else { return false };
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", child.process.id()));
        // After the name in parentheses comes the state.
        let state =
            stat.ok().and_then(|s| s.rsplit_once(") ").map(|(_, rest)| rest.chars().next()));
        matches!(state.flatten(), Some('T' | 't' | 'Z' | 'X'))
    }

    fn died(&mut self, reason: &str) {
        let status = self.reap();
        let reason = match status {
            Some(status) if !reason.is_empty() => format!("{reason}; {status}"),
            Some(status) => status,
            None => reason.to_owned(),
        };
        tracing::warn!("the simulation died: {reason}");
        self.fail_pending(&format!("it died: {reason}"));
        self.pulse.performing = false;
        self.history.state.deaths += 1;
        let now = Instant::now();
        self.history.deaths.retain(|d| now.duration_since(*d) < DEATH_WINDOW);
        self.history.deaths.push(now);
        if self.history.deaths.len() >= DEATHS {
            let reason = format!("it died {DEATHS} times within a minute; last: {reason}");
            self.set_state(WorkerPhase::Stopped, Some(reason));
            return;
        }
        self.set_state(WorkerPhase::Restarting, Some(reason));
        self.spawn();
    }

    /// Kills and reaps the child; returns how it ended.
    fn reap(&mut self) -> Option<String> {
        let mut running = self.child.take()?;
        // A child that has just hung up needs a moment to exit with its own status.
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
        for pending in std::mem::take(&mut self.questions.pending).into_values() {
            if let Some(reply) = pending.reply {
                reply(Err(gone(reason)));
            }
        }
    }
}

fn spawn(
    binary: &std::path::Path,
    scratch: &std::path::Path,
    number: u64,
    inbox: &Sender<Inbox>,
) -> io::Result<Running> {
    let (ours, theirs) = UnixStream::pair()?;
    let process = robert_base::child::command(binary)
        .arg("__worker")
        .stdin(Stdio::from(OwnedFd::from(theirs)))
        .stdout(Stdio::null())
        .current_dir(scratch)
        .spawn()?;
    // If the child is stopped the buffer fills up: killing it is better than waiting.
    ours.set_write_timeout(Some(BLOCKED))?;
    let mut reading = io::BufReader::new(ours.try_clone()?);
    let inbox = inbox.clone();
    std::thread::Builder::new().name("worker-in".into()).spawn(move || {
        let reason = loop {
            match codec::read::<WorkerMessage>(&mut reading) {
                Ok(Some(message)) => {
                    if inbox.send(Inbox::Message { child: number, message }).is_err() {
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

/// The exit class of a code that came over the wire.
fn exit_of(code: u8) -> Exit {
    match code {
        2 => Exit::Usage,
        3 => Exit::Invalid,
        4 => Exit::Threshold,
        5 => Exit::Missing,
        130 => Exit::Interrupted,
        _ => Exit::Failed,
    }
}
