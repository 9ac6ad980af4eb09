//! Performs shards in child processes of this machine.
//!
//! Each child performs one shard after the other: it reads indices from its stdin and answers each
//! with a line. So a shard does not cost the start of a program, and a crash costs one child. An
//! index whose child died is given to another child, three times at most.

use std::collections::VecDeque;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::process::CommandExt as _;
use std::path::PathBuf;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread::ScopedJoinHandle;
use std::time::Duration;

use robert_base::child;
use robert_base::exit::Exit;
use robert_base::progress::{Cancel, Progress};
use serde::{Deserialize, Serialize};

use super::Error;
use super::error::write_error;

/// The number of attempts for a shard whose process dies.
const TRIES: u32 = 3;
/// The interval between two checks for a request to stop.
const LOOK: Duration = Duration::from_millis(50);

/// The answer of a child about one index: a line of JSON on its stdout.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Answer {
    /// The index.
    pub index: usize,
    /// The exit code that this shard alone would cause.
    pub exit: u8,
    /// The reason of its failure; empty when it is done.
    pub error: String,
}

/// Options for performing shards.
#[derive(Debug)]
pub struct Pool {
    /// The program.
    pub binary: PathBuf,
    /// Arguments that make it read indices and write answers.
    pub args: Vec<String>,
    /// Children at once.
    pub jobs: usize,
}

/// The outcome of the shards.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Pooled {
    /// Shards that are done.
    pub done: usize,
    /// Shards that failed.
    pub failed: Vec<Answer>,
    /// Whether a stop was requested, or a failure occurred that all shards would share.
    pub stopped: bool,
}

/// The state that all children share.
struct Board {
    queue: VecDeque<usize>,
    /// The number of times that the child of an index died.
    deaths: std::collections::BTreeMap<usize, u32>,
    found: Pooled,
    pids: Vec<rustix::process::Pid>,
}

impl Pool {
    /// Performs these shards. A stop lets the children save checkpoints.
    ///
    /// # Errors
    /// When a child cannot be started.
    pub fn run(
        &self,
        indices: &[usize],
        progress: &dyn Progress,
        cancel: &Cancel,
    ) -> Result<Pooled, Error> {
        let total = indices.len() as u64;
        let board = Mutex::new(Board {
            queue: indices.iter().copied().collect(),
            deaths: std::collections::BTreeMap::new(),
            found: Pooled::default(),
            pids: Vec::new(),
        });
        progress.tick(0, total, "");
        let jobs = self.jobs.clamp(1, indices.len().max(1));
        let ended = AtomicBool::new(false);
        std::thread::scope(|scope| {
            let workers: Vec<_> =
                (0..jobs).map(|_| scope.spawn(|| self.serve(&board, total, progress))).collect();
            let watch = scope.spawn(|| {
                while !ended.load(Ordering::Relaxed) {
                    if cancel.is_cancelled() {
                        stop(&board);
                        return;
                    }
                    std::thread::sleep(LOOK);
                }
            });
            // All threads have ended before anything else happens, so a panic of one cannot leave
            // the watching thread waiting for ever.
            let served: Vec<_> = workers.into_iter().map(ScopedJoinHandle::join).collect();
            ended.store(true, Ordering::Relaxed);
            watch.join().unwrap_or_else(|p| std::panic::resume_unwind(p));
            let mut first = None;
            for served in served {
                let served = served.unwrap_or_else(|p| std::panic::resume_unwind(p));
                first = first.or(served.err());
            }
            first.map_or(Ok(()), Err)
        })?;
        let mut found = board.into_inner().unwrap_or_else(PoisonError::into_inner).found;
        found.failed.sort_by_key(|a| a.index);
        found.stopped |= cancel.is_cancelled();
        Ok(found)
    }

    /// Runs one child after the other, until no index is left.
    fn serve(
        &self,
        board: &Mutex<Board>,
        total: u64,
        progress: &dyn Progress,
    ) -> Result<(), Error> {
        let mut worker: Option<Worker> = None;
        while let Some(index) = next(board) {
            let current = match &mut worker {
                Some(current) => current,
                None => worker.insert(Worker::start(self, board)?),
            };
            let Some(answer) = current.ask(index) else {
                let status = worker.take().map_or_else(String::new, |w| w.end(board));
                let mut all = lock(board);
                if all.found.stopped {
                    return Ok(());
                }
                let times = all.deaths.entry(index).or_default();
                *times += 1;
                if *times < TRIES {
                    progress.log(&format!("shard {index}: its process ended ({status}); again"));
                    all.queue.push_back(index);
                } else {
                    let e = Error::Died { index, times: *times, status };
                    let exit = Exit::Failed.code();
                    all.found.failed.push(Answer { index, exit, error: e.to_string() });
                }
                continue;
            };
            let mut all = lock(board);
            if answer.exit == Exit::Ok.code() {
                all.found.done += 1;
                let done = all.found.done as u64;
                drop(all);
                progress.tick(done, total, &format!("shard {index}"));
                continue;
            }
            if answer.exit != Exit::Interrupted.code() {
                progress.log(&format!("shard {index}: {}", answer.error));
                all.found.failed.push(answer.clone());
            }
            // The others continue only if the failure concerns this shard alone.
            let alone = [Exit::Failed.code(), Exit::Threshold.code()].contains(&answer.exit);
            if !alone {
                all.queue.clear();
                all.found.stopped = true;
            }
        }
        if let Some(worker) = worker {
            worker.end(board);
        }
        Ok(())
    }
}

fn lock(board: &Mutex<Board>) -> std::sync::MutexGuard<'_, Board> {
    board.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Takes the next index. A function of its own, so that the lock ends before the work begins.
fn next(board: &Mutex<Board>) -> Option<usize> {
    lock(board).queue.pop_front()
}

/// Empties the queue and asks all children to stop.
fn stop(board: &Mutex<Board>) {
    let mut all = lock(board);
    all.queue.clear();
    all.found.stopped = true;
    for &pid in &all.pids {
        // One that has ended needs no signal.
        rustix::process::kill_process(pid, rustix::process::Signal::TERM).ok();
    }
}

/// A child and its pipes.
struct Worker {
    child: Child,
    stdin: ChildStdin,
    stdout: BufReader<ChildStdout>,
    pid: rustix::process::Pid,
}

impl Worker {
    fn start(pool: &Pool, board: &Mutex<Board>) -> Result<Self, Error> {
        let fail = write_error(&pool.binary);
        let mut command: Command = child::command(&pool.binary);
        // Ctrl-C in a terminal goes to a whole group, and a second signal would end a child before
        // its checkpoint is written.
        command.process_group(0);
        command.args(&pool.args).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().map_err(&fail)?;
        let pipes = (child.stdin.take(), child.stdout.take());
        let (Some(stdin), Some(stdout)) = pipes else {
            return Err(fail(std::io::Error::other("a child without pipes")));
        };
        let pid = rustix::process::Pid::from_child(&child);
        let mut all = lock(board);
        all.pids.push(pid);
        // A stop signals those that are there.
        if all.found.stopped {
            rustix::process::kill_process(pid, rustix::process::Signal::TERM).ok();
        }
        drop(all);
        Ok(Worker { child, stdin, stdout: BufReader::new(stdout), pid })
    }

    /// Lets the child perform a shard; `None` if it died.
    fn ask(&mut self, index: usize) -> Option<Answer> {
        writeln!(self.stdin, "{index}").and_then(|()| self.stdin.flush()).ok()?;
        let mut line = String::new();
        self.stdout.read_line(&mut line).ok().filter(|n| *n > 0)?;
        serde_json::from_str(&line).ok().filter(|a: &Answer| a.index == index)
    }

    /// Closes its input and waits for its end.
    fn end(self, board: &Mutex<Board>) -> String {
        let Worker { mut child, stdin, stdout, pid } = self;
        drop((stdin, stdout));
        let status = child.wait();
        lock(board).pids.retain(|p| *p != pid);
        status.map_or_else(|e| e.to_string(), |s| s.to_string())
    }
}
