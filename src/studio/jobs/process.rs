//! The processes of jobs, and their output.

use std::collections::{BTreeMap, VecDeque};
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{ChildStdout, Command, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, WaitId, WaitIdOptions, kill_process, waitid};

use crate::protocol::{Error, Event, Hub, JobKind, JobPhase, JobRequest, JobView};
use robert_base::limits;
use robert_base::progress::{JobEvent, JobProgress};
use robert_base::scratch::Scratch;
use robert_base::{child, fsio};

struct Job {
    kind: JobKind,
    args: Vec<String>,
    extra: Extra,
    phase: JobPhase,
    exit: Option<i32>,
    pid: Option<Pid>,
    said: Said,
    begin: Instant,
    secs: f64,
}

/// The output of a job.
#[derive(Default)]
struct Said {
    progress: Option<JobProgress>,
    /// The newest events.
    lines: VecDeque<JobEvent>,
    /// The number of events so far.
    events: usize,
    log: VecDeque<String>,
}

/// Facts about a job beside its arguments.
#[derive(Clone, Debug, Default)]
pub(crate) struct Extra {
    /// The purpose of the job, in words.
    pub(crate) title: String,
    /// The file that it makes, for downloading.
    pub(crate) output: Option<PathBuf>,
    /// Files that the job needs; they are removed with it.
    #[allow(dead_code)] // held, not read
    pub(crate) scratch: Option<Arc<Scratch>>,
}

/// The time for the last lines of a job that has ended. It is limited, because a child of the job
/// may keep the pipe open.
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
pub(crate) struct Jobs {
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
    pub(crate) fn new(hub: Hub, binary: PathBuf) -> Jobs {
        Jobs { inner: Arc::default(), hub, binary }
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Starts a job.
    ///
    /// # Errors
    /// [`Error::Full`], [`Error::Server`] when it cannot be started.
    pub(crate) fn start(&self, request: JobRequest, folder: &Path) -> Result<JobView, Error> {
        self.start_with(request, Extra::default(), folder)
    }

    /// Starts a job with a title and files, on behalf of the studio.
    ///
    /// # Errors
    /// As [`Jobs::start`]; [`Error::Request`] while another job writes the same file.
    pub(crate) fn start_with(
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
            let file = |extra: &Extra| extra.output.as_deref().map(fsio::resolved);
            let own = file(&extra);
            let mut running = inner.jobs.values().filter(|j| j.pid.is_some());
            if let Some(path) =
                own.filter(|own| running.any(|j| file(&j.extra).as_ref() == Some(own)))
            {
                let what = "another job is writing this file; wait for it, or name another file";
                return Err(Error::request(format!("{what}: {}", path.display())));
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
                let ended = inner.jobs.iter().find(|(_, j)| !j.runs()).map(|(id, _)| *id);
                let Some(ended) = ended else { break };
                inner.jobs.remove(&ended);
            }
            inner.next = id;
            let job = Job {
                kind: request.kind,
                args: request.args,
                extra,
                phase: JobPhase::Running,
                exit: None,
                pid,
                said: Said::default(),
                begin: Instant::now(),
                secs: 0.0,
            };
            inner.jobs.insert(id, job);
            id
        };
        self.view(id, usize::MAX)
    }

    /// Starts the process and follows it until it ends, on a thread of its own, since a child ends
    /// with the thread that started it. Events are handled only after the caller has released the
    /// lock of the list.
    fn run(self, id: u64, mut command: Command) -> Result<Option<Pid>, Error> {
        let (started, starting) = std::sync::mpsc::channel();
        let watch = move || {
            let mut child = match command.spawn() {
                Ok(child) => child,
                Err(e) => return drop(started.send(Err(e))),
            };
            let pid = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
            started.send(Ok(pid)).ok();
            let (out, err) = (child.stdout.take(), child.stderr.take());
            let jobs = self.clone();
            let log = std::thread::spawn(move || {
                for line in err.into_iter().flat_map(lines) {
                    jobs.with(id, |job| keep(&mut job.said.log, LOG, clipped(line)));
                }
            });
            self.follow(id, out);
            // Until it is reaped its number belongs to no other process, which a signal could meet.
            if let Some(pid) = pid {
                waitid(WaitId::Pid(pid), WaitIdOptions::EXITED | WaitIdOptions::NOWAIT).ok();
            }
            self.with(id, |job| {
                job.pid = None;
                job.secs = job.begin.elapsed().as_secs_f64();
            });
            let exit = child.wait().ok().and_then(|s| s.code());
            // A client that learns of the end wants to read the reason, so the lines must be
            // complete; the pipe closes with the job.
            let until = Instant::now() + LOG_PATIENCE;
            while !log.is_finished() && Instant::now() < until {
                std::thread::sleep(Duration::from_millis(2));
            }
            self.with(id, |job| {
                job.exit = exit;
                if exit == Some(0) && job.kind == JobKind::Import {
                    // The sent files are in the robot's folder now.
                    job.extra.scratch = None;
                }
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
        thread.spawn(watch).map_err(Error::Server)?;
        starting.recv().map_err(std::io::Error::other).flatten().map_err(Error::Server)
    }

    /// Reads the job's output until it ends.
    fn follow(&self, id: u64, out: Option<ChildStdout>) {
        for line in out.into_iter().flat_map(lines) {
            let event = serde_json::from_str(&line)
                .unwrap_or_else(|_| JobEvent::Log { line: clipped(line) });
            self.with(id, |job| match event {
                JobEvent::Progress(progress) => job.said.progress = Some(progress),
                event => {
                    job.said.events += 1;
                    keep(&mut job.said.lines, limits::JOB_LINES, event);
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
    pub(crate) fn list(&self) -> Vec<JobView> {
        self.lock().jobs.iter().map(|(id, job)| job.view(*id, usize::MAX)).collect()
    }

    /// One job with its events from number `from` on.
    ///
    /// # Errors
    /// [`Error::NotFound`].
    pub(crate) fn view(&self, id: u64, from: usize) -> Result<JobView, Error> {
        let inner = self.lock();
        let job = inner.jobs.get(&id).ok_or_else(|| missing(id))?;
        Ok(job.view(id, from))
    }

    /// Asks it to stop as Ctrl-C would; a second time ends it at once.
    ///
    /// # Errors
    /// [`Error::NotFound`].
    pub(crate) fn cancel(&self, id: u64) -> Result<JobView, Error> {
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
    pub(crate) fn resume(&self, id: u64, folder: &Path) -> Result<JobView, Error> {
        let (kind, args, extra) = {
            let inner = self.lock();
            let job = inner.jobs.get(&id).ok_or_else(|| missing(id))?;
            if job.runs() {
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
    pub(crate) fn file(&self, id: u64) -> Result<PathBuf, Error> {
        let inner = self.lock();
        let job = inner.jobs.get(&id).ok_or_else(|| missing(id))?;
        let made = job.extra.output.clone().filter(|_| job.phase == JobPhase::Done);
        made.ok_or_else(|| Error::NotFound { what: format!("file of job {id} yet") })
    }

    /// Ends all: the studio goes.
    pub(crate) fn stop(&self) {
        for job in self.lock().jobs.values() {
            if let Some(pid) = job.pid {
                kill_process(pid, Signal::INT).ok();
            }
        }
    }
}

impl Job {
    /// Whether it runs, or what it said is still being read.
    fn runs(&self) -> bool {
        matches!(self.phase, JobPhase::Running | JobPhase::Cancelling)
    }

    fn view(&self, id: u64, from: usize) -> JobView {
        let dropped = self.said.events - self.said.lines.len();
        let first = from.clamp(dropped, self.said.events);
        JobView {
            id,
            kind: self.kind,
            args: self.args.clone(),
            title: self.extra.title.clone(),
            phase: self.phase,
            exit: self.exit,
            progress: self.said.progress.clone(),
            last: self.said.lines.back().cloned(),
            file: self
                .extra
                .output
                .as_ref()
                .and_then(|p| Some(p.file_name()?.to_string_lossy().into_owned())),
            events: self.said.events,
            first,
            lines: self.said.lines.iter().skip(first - dropped).cloned().collect(),
            log: self.said.log.iter().cloned().collect(),
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

/// The lines of an output, whatever bytes they hold.
fn lines(out: impl Read) -> impl Iterator<Item = String> {
    let lines = BufReader::new(out).split(b'\n').map_while(Result::ok);
    lines.map(|line| String::from_utf8_lossy(&line).trim_end_matches('\r').to_owned())
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

    /// A shell in the place of the program: it reads the name of the command as a script.
    fn jobs(dir: &Path, script: &str) -> Jobs {
        std::fs::write(dir.join("collect"), script).unwrap();
        Jobs::new(Hub::default(), PathBuf::from("/bin/sh"))
    }

    #[test]
    fn a_line_that_is_no_text_ends_no_output() {
        let said: Vec<String> = lines(&b"one\n\xff two\r\nthree"[..]).collect();
        assert_eq!(said, ["one", "\u{fffd} two", "three"]);
    }

    fn collect() -> JobRequest {
        JobRequest { kind: JobKind::Collect, args: Vec::new() }
    }

    fn wait(jobs: &Jobs, done: impl Fn(&JobView) -> bool) {
        let until = Instant::now() + Duration::from_secs(120);
        while !jobs.list().iter().all(&done) {
            assert!(Instant::now() < until, "{:?}", jobs.list());
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    #[test]
    fn as_many_jobs_run_and_are_kept_as_the_limit_says() {
        let dir = tempfile::tempdir().unwrap();
        let jobs = jobs(dir.path(), "exec sleep 1000");
        for _ in 0..limits::JOBS {
            jobs.start(collect(), dir.path()).unwrap();
        }
        let refused = jobs.start(collect(), dir.path()).unwrap_err();
        assert!(matches!(refused, Error::Full { what: "jobs", cap: limits::JOBS }), "{refused}");
        for id in 1..=limits::JOBS as u64 {
            jobs.cancel(id).unwrap();
            jobs.cancel(id).unwrap();
        }
        wait(&jobs, |job| job.phase == JobPhase::Interrupted);
        // One more, and the oldest is forgotten.
        jobs.start(collect(), dir.path()).unwrap();
        let ids: Vec<u64> = jobs.list().iter().map(|job| job.id).collect();
        assert_eq!(ids, (2..=limits::JOBS as u64 + 1).collect::<Vec<u64>>());
        // The first time as Ctrl-C would, which whoever runs the tests may ignore.
        jobs.cancel(limits::JOBS as u64 + 1).unwrap();
        jobs.cancel(limits::JOBS as u64 + 1).unwrap();
    }

    #[test]
    fn the_newest_lines_of_a_job_are_kept() {
        let dir = tempfile::tempdir().unwrap();
        let last = limits::JOB_LINES + 1;
        let long = LINE_BYTES + 1;
        let script =
            format!("seq {last}; seq {} >&2; head -c {long} /dev/zero | tr '\\0' x >&2", LOG + 1);
        let jobs = jobs(dir.path(), &script);
        jobs.start(collect(), dir.path()).unwrap();
        wait(&jobs, |job| job.phase == JobPhase::Done);
        let job = jobs.view(1, 0).unwrap();
        assert_eq!((job.events, job.first, job.lines.len()), (last, 1, limits::JOB_LINES));
        assert_eq!(job.lines[0], JobEvent::Log { line: "2".to_owned() });
        assert_eq!((job.log.len(), job.log[0].as_str()), (LOG, "3"));
        assert_eq!(job.log[LOG - 1].len(), LINE_BYTES);
    }
}
