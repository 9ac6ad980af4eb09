//! Collect, train, evaluate, import and export from the browser: the same commands as in a
//! shell, as children.
//!
//! A job is `robert KIND ARGS.. --jsonl`; its stdout is events, a line each: `progress` (only
//! the newest is kept), `figures` for curves, `log`, and at the end `result`. Cancelling sends
//! what Ctrl-C sends, so the job writes its checkpoint; resuming starts it again with `--resume`.

use std::collections::{BTreeMap, VecDeque};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{ChildStdout, Command, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use serde::{Deserialize, Serialize};

use super::error::Error;
use super::hub::Hub;
use super::protocol::Event;
use crate::progress::{JobEvent, JobProgress};
use crate::{child, limits};

/// What can be started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum JobKind {
    /// Gather motion without reward.
    Collect,
    /// Train a network.
    Train,
    /// Measure policies.
    Eval,
    /// Render a picture or a film.
    Render,
    /// Write a take in another format.
    Export,
    /// Make a robot's folder out of a model file.
    Import,
}

impl JobKind {
    fn command(self) -> &'static str {
        match self {
            JobKind::Collect => "collect",
            JobKind::Train => "train",
            JobKind::Eval => "eval",
            JobKind::Render => "render",
            JobKind::Export => "export",
            JobKind::Import => "import",
        }
    }

    /// The arguments that let an ended job go on.
    fn resumed(self, args: &[String]) -> Result<Vec<String>, Error> {
        let mut next = args.to_vec();
        match self {
            // A run directory is its own memory of all other settings.
            JobKind::Train => {
                if value_of(args, "--resume").is_some() {
                    return Ok(next);
                }
                let run = value_of(args, "--out")
                    .ok_or_else(|| Error::request("this training was started without --out"))?;
                next = without(args, &["--out", "--preset", "--set"]);
                next.extend(["--resume".to_owned(), run]);
            }
            JobKind::Collect => {
                if !args.iter().any(|a| a == "--resume") {
                    next.push("--resume".into());
                }
            }
            // Short enough to begin anew.
            JobKind::Eval | JobKind::Render | JobKind::Export | JobKind::Import => {}
        }
        Ok(next)
    }
}

/// The value of `--name V` or `--name=V`.
fn value_of(args: &[String], name: &str) -> Option<String> {
    let glued = format!("{name}=");
    args.iter().enumerate().find_map(|(i, a)| {
        if a == name { args.get(i + 1).cloned() } else { a.strip_prefix(&glued).map(str::to_owned) }
    })
}

/// The arguments without these options and their values.
fn without(args: &[String], names: &[&str]) -> Vec<String> {
    let mut kept = Vec::new();
    let mut skip = false;
    for a in args {
        if std::mem::take(&mut skip) {
            continue;
        }
        if names.contains(&a.as_str()) {
            skip = true;
        } else if !names.iter().any(|n| a.strip_prefix(n).is_some_and(|r| r.starts_with('='))) {
            kept.push(a.clone());
        }
    }
    kept
}

/// `POST /api/jobs`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct JobRequest {
    /// What.
    pub kind: JobKind,
    /// Arguments as on the command line, without `--jsonl`.
    pub args: Vec<String>,
}

/// How a job is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum JobPhase {
    /// It runs.
    Running,
    /// It was asked to stop.
    Cancelling,
    /// It ended well.
    Done,
    /// It ended after being asked to stop, with a checkpoint.
    Interrupted,
    /// It ended badly.
    Failed,
}

/// A job as the page sees it.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct JobView {
    /// Number.
    pub id: u64,
    /// What.
    pub kind: JobKind,
    /// Its arguments.
    pub args: Vec<String>,
    /// What it is for, in words.
    pub title: String,
    /// How it is.
    pub phase: JobPhase,
    /// Exit code, when it has ended.
    pub exit: Option<i32>,
    /// How far it is: the newest `progress` event.
    pub progress: Option<JobProgress>,
    /// The newest other event.
    pub last: Option<JobEvent>,
    /// Name of the file that it makes for `GET /api/jobs/{id}/file`; it is there when the job
    /// is done.
    pub file: Option<String>,
    /// Other events so far.
    pub events: usize,
    /// Number of the first event in `lines`.
    pub first: usize,
    /// Events, in `GET /api/jobs/{id}` only.
    pub lines: Vec<JobEvent>,
    /// The last lines of its log.
    pub log: Vec<String>,
    /// Seconds it has run.
    pub secs: f64,
}

struct Job {
    kind: JobKind,
    args: Vec<String>,
    extra: Extra,
    phase: JobPhase,
    progress: Option<JobProgress>,
    exit: Option<i32>,
    pid: Option<Pid>,
    lines: VecDeque<JobEvent>,
    events: usize,
    log: VecDeque<String>,
    begin: Instant,
    secs: f64,
}

/// What the studio knows about a job beside its arguments.
#[derive(Clone, Debug, Default)]
pub struct Extra {
    /// What it is for.
    pub title: String,
    /// The file that it makes, for downloading.
    pub output: Option<PathBuf>,
    /// Files that it needs, gone with the job.
    pub scratch: Option<Arc<tempfile::TempDir>>,
}

/// Time for the last lines of a job that has ended; a child of its own may hold them open.
const LOG_PATIENCE: Duration = Duration::from_secs(1);
/// Log lines kept.
const LOG: usize = 100;
/// Bytes of one line that are kept.
const LINE_BYTES: usize = 64 << 10;

#[derive(Default)]
struct Inner {
    jobs: BTreeMap<u64, Job>,
    next: u64,
}

/// All jobs of this run.
#[derive(Clone)]
pub struct Jobs {
    inner: Arc<Mutex<Inner>>,
    hub: Hub,
    binary: PathBuf,
}

impl std::fmt::Debug for Jobs {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Jobs")
    }
}

impl Jobs {
    /// None yet.
    pub fn new(hub: Hub, binary: PathBuf) -> Jobs {
        Jobs { inner: Arc::default(), hub, binary }
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Starts one.
    ///
    /// # Errors
    /// [`Error::Full`], [`Error::Server`] when it cannot be started.
    pub fn start(&self, request: JobRequest, folder: &Path) -> Result<JobView, Error> {
        self.start_with(request, Extra::default(), folder)
    }

    /// Starts one of the studio's own.
    ///
    /// # Errors
    /// As [`Jobs::start`].
    pub fn start_with(
        &self,
        request: JobRequest,
        extra: Extra,
        folder: &Path,
    ) -> Result<JobView, Error> {
        if request.args.iter().any(|a| a.contains('\0')) || request.args.len() > 256 {
            return Err(Error::request("these are no arguments"));
        }
        let id = {
            let mut inner = self.lock();
            let running = inner.jobs.values().filter(|j| j.pid.is_some()).count();
            if running >= limits::JOBS {
                return Err(Error::Full { what: "jobs", cap: limits::JOBS });
            }
            let mut command = child::command(&self.binary);
            command
                .arg(request.kind.command())
                .args(&request.args)
                .arg("--jsonl")
                .current_dir(folder)
                .env("NO_COLOR", "1")
                .stdin(Stdio::null())
                .stdout(Stdio::piped())
                .stderr(Stdio::piped());
            let id = inner.next + 1;
            let pid = self.clone().run(id, command)?;
            while inner.jobs.len() >= limits::JOBS {
                let ended = inner.jobs.iter().find(|(_, j)| j.pid.is_none()).map(|(id, _)| *id);
                let Some(ended) = ended else { break };
                inner.jobs.remove(&ended);
            }
            inner.next = id;
            let job = Job {
                kind: request.kind,
                args: request.args,
                extra,
                phase: JobPhase::Running,
                progress: None,
                exit: None,
                pid,
                lines: VecDeque::new(),
                events: 0,
                log: VecDeque::new(),
                begin: Instant::now(),
                secs: 0.0,
            };
            inner.jobs.insert(id, job);
            id
        };
        self.view(id, usize::MAX)
    }

    /// Starts the process and follows it until it ends, on a thread of its own: a child ends
    /// with the thread that started it. Nothing is heard of it before the caller has let go of
    /// the list.
    fn run(self, id: u64, mut command: Command) -> Result<Option<Pid>, Error> {
        let (started, starting) = std::sync::mpsc::channel();
        let follow = move || {
            let mut child = match command.spawn() {
                Ok(child) => child,
                Err(e) => return drop(started.send(Err(e))),
            };
            let pid = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
            started.send(Ok(pid)).ok();
            let (out, err) = (child.stdout.take(), child.stderr.take());
            let jobs = self.clone();
            let log = std::thread::spawn(move || {
                for line in err.into_iter().flat_map(|e| BufReader::new(e).lines()) {
                    let Ok(line) = line else { break };
                    jobs.with(id, |job| keep(&mut job.log, LOG, clipped(line)));
                }
            });
            self.hear(id, out);
            let exit = child.wait().ok().and_then(|s| s.code());
            // Whoever hears of the end wants to read why; the pipe closes with the job.
            let until = Instant::now() + LOG_PATIENCE;
            while !log.is_finished() && Instant::now() < until {
                std::thread::sleep(Duration::from_millis(2));
            }
            self.with(id, |job| {
                job.pid = None;
                job.exit = exit;
                job.secs = job.begin.elapsed().as_secs_f64();
                job.phase = match exit {
                    Some(0) => JobPhase::Done,
                    Some(130) => JobPhase::Interrupted,
                    None if job.phase == JobPhase::Cancelling => JobPhase::Interrupted,
                    _ => JobPhase::Failed,
                };
            });
            self.tell(id);
        };
        let thread = std::thread::Builder::new().name(format!("job {id}"));
        thread.spawn(follow).map_err(Error::Server)?;
        starting.recv().map_err(std::io::Error::other).flatten().map_err(Error::Server)
    }

    /// Takes what the job says, until it says no more.
    fn hear(&self, id: u64, out: Option<ChildStdout>) {
        for line in out.into_iter().flat_map(|o| BufReader::new(o).lines()) {
            let Ok(line) = line else { break };
            let event = serde_json::from_str(&line)
                .unwrap_or_else(|_| JobEvent::Log { line: clipped(line) });
            self.with(id, |job| match event {
                JobEvent::Progress(progress) => job.progress = Some(progress),
                event => {
                    job.events += 1;
                    keep(&mut job.lines, limits::JOB_LINES, event);
                }
            });
            self.tell(id);
        }
    }

    fn with(&self, id: u64, change: impl FnOnce(&mut Job)) {
        if let Some(job) = self.lock().jobs.get_mut(&id) {
            change(job);
        }
    }

    fn tell(&self, id: u64) {
        if let Ok(view) = self.view(id, usize::MAX) {
            self.hub.send(&Event::Job(Box::new(view)));
        }
    }

    /// All jobs, without their events.
    pub fn list(&self) -> Vec<JobView> {
        self.lock().jobs.iter().map(|(id, job)| job.view(*id, usize::MAX)).collect()
    }

    /// One job with its events from number `from` on.
    ///
    /// # Errors
    /// [`Error::NotFound`].
    pub fn view(&self, id: u64, from: usize) -> Result<JobView, Error> {
        let inner = self.lock();
        let job = inner.jobs.get(&id).ok_or_else(|| missing(id))?;
        Ok(job.view(id, from))
    }

    /// Asks it to stop as Ctrl-C would; a second time ends it at once.
    ///
    /// # Errors
    /// [`Error::NotFound`].
    pub fn cancel(&self, id: u64) -> Result<JobView, Error> {
        {
            let mut inner = self.lock();
            let job = inner.jobs.get_mut(&id).ok_or_else(|| missing(id))?;
            if let Some(pid) = job.pid {
                let signal = match job.phase {
                    JobPhase::Running => Signal::INT,
                    _ => Signal::KILL,
                };
                kill_process(pid, signal).ok();
                job.phase = JobPhase::Cancelling;
            }
        }
        self.tell(id);
        self.view(id, usize::MAX)
    }

    /// Starts an ended job again where it stopped.
    ///
    /// # Errors
    /// [`Error::NotFound`], [`Error::Request`] while it runs.
    pub fn resume(&self, id: u64, folder: &Path) -> Result<JobView, Error> {
        let (kind, args, extra) = {
            let inner = self.lock();
            let job = inner.jobs.get(&id).ok_or_else(|| missing(id))?;
            if job.pid.is_some() {
                return Err(Error::request(format!("job {id} is still running")));
            }
            (job.kind, job.args.clone(), job.extra.clone())
        };
        let args = kind.resumed(&args)?;
        self.start_with(JobRequest { kind, args }, extra, folder)
    }

    /// The file that a job has made.
    ///
    /// # Errors
    /// [`Error::NotFound`] before it is there.
    pub fn file(&self, id: u64) -> Result<PathBuf, Error> {
        let inner = self.lock();
        let job = inner.jobs.get(&id).ok_or_else(|| missing(id))?;
        let made = job.extra.output.clone().filter(|_| job.phase == JobPhase::Done);
        made.ok_or_else(|| Error::NotFound { what: format!("file of job {id} yet") })
    }

    /// Ends all: the studio goes.
    pub fn stop(&self) {
        for job in self.lock().jobs.values() {
            if let Some(pid) = job.pid {
                kill_process(pid, Signal::INT).ok();
            }
        }
    }
}

impl Job {
    fn view(&self, id: u64, from: usize) -> JobView {
        let dropped = self.events - self.lines.len();
        let first = from.clamp(dropped, self.events);
        JobView {
            id,
            kind: self.kind,
            args: self.args.clone(),
            title: self.extra.title.clone(),
            phase: self.phase,
            exit: self.exit,
            progress: self.progress.clone(),
            last: self.lines.back().cloned(),
            file: self
                .extra
                .output
                .as_ref()
                .and_then(|p| Some(p.file_name()?.to_string_lossy().into_owned())),
            events: self.events,
            first,
            lines: self.lines.iter().skip(first - dropped).cloned().collect(),
            log: self.log.iter().cloned().collect(),
            secs: if self.pid.is_some() { self.begin.elapsed().as_secs_f64() } else { self.secs },
        }
    }
}

fn missing(id: u64) -> Error {
    Error::NotFound { what: format!("job {id}") }
}

fn keep<T>(list: &mut VecDeque<T>, cap: usize, item: T) {
    if list.len() >= cap {
        list.pop_front();
    }
    list.push_back(item);
}

fn clipped(mut line: String) -> String {
    if line.len() > LINE_BYTES {
        let mut end = LINE_BYTES;
        while !line.is_char_boundary(end) {
            end -= 1;
        }
        line.truncate(end);
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stopped_training_goes_on_in_its_own_folder() {
        let words = |t: &str| t.split(' ').map(str::to_owned).collect::<Vec<_>>();
        let args =
            words("--robot ur5e --data d --preset quick --set lr=1 --set=seed=2 --out runs/a");
        let next = JobKind::Train.resumed(&args).unwrap();
        assert_eq!(next, words("--robot ur5e --data d --resume runs/a"));
        assert_eq!(JobKind::Train.resumed(&next).unwrap(), next, "and so the second time");
        let next = JobKind::Collect.resumed(&words("--out d")).unwrap();
        assert_eq!(next, words("--out d --resume"));
        assert_eq!(JobKind::Collect.resumed(&next).unwrap(), next);
        assert!(JobKind::Train.resumed(&words("--robot ur5e")).is_err());
    }
}
