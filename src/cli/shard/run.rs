//! `robert shard run DIR --index K`: performs shards in this process.

use std::path::PathBuf;

use super::super::failure::{Failure, Outcome};
use super::super::global::{Global, Threads};
use super::super::interrupt::cancel_on_warning;
use super::super::{out, pool};
use super::accept::AcceptArgs;
use crate::exit::{Exit, HasExit};
use crate::progress::Cancel;
use crate::shard::{Done, Error, Runner, slurm};

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert shard run work/eval --index 3\n  robert shard run work/eval --index 20 --count 10     shards 20 to 29\n  robert shard missing work/eval | robert shard run work/eval --stdin\n\nIt may be killed at any time, repeated, and run twice at once. SIGUSR1, SIGTERM and Ctrl-C save a\ncheckpoint of a training shard and end with 130; the same command continues there. With several\nshards the exit code is that of the worst, in the order 3, 5, 4, 1."
)]
pub(in super::super) struct Args {
    /// Folder of the plan.
    dir: PathBuf,
    /// The shard, from 0.
    #[arg(long, value_name = "K", required_unless_present_any = ["task", "stdin"], conflicts_with_all = ["task", "stdin"])]
    index: Option<usize>,
    /// Run this many shards, beginning at --index. Those beyond the plan do not count.
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    count: u32,
    /// Run the shards of a line of this file, which submit has written.
    #[arg(long, value_name = "FILE", requires = "task")]
    tasks: Option<PathBuf>,
    /// The line, from 0.
    #[arg(long, value_name = "T", requires = "tasks")]
    task: Option<usize>,
    /// Read indices from stdin, one a line, and answer each with a line of JSON.
    #[arg(long)]
    stdin: bool,
    /// After SIGUSR1, put this job into the queue again.
    #[arg(long, value_name = "QUEUE", value_parser = ["slurm"])]
    requeue: Option<String>,
    #[command(flatten)]
    threads: Threads,
    /// Minutes between checkpoints of a training shard.
    #[arg(long, default_value_t = 1.0, value_name = "MINUTES")]
    checkpoint_mins: f64,
    #[command(flatten)]
    accept: AcceptArgs,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args, global: Global) -> Outcome {
    if !(args.checkpoint_mins.is_finite() && args.checkpoint_mins >= 0.0) {
        return Err(Failure::usage("--checkpoint-mins takes 0 or more"));
    }
    let (cancel, warned) = cancel_on_warning();
    let accept = args.accept.accept();
    let secs = 60.0 * args.checkpoint_mins;
    let runner = Runner::open(&args.dir, accept, args.threads.count(), secs, &cancel)?;
    if args.stdin {
        return pool::serve(|index| Ok(runner.run(index).map(drop)?));
    }
    let indices = match (&args.tasks, args.task, args.index) {
        (Some(list), Some(task), _) => slurm::task(list, task)?,
        (_, _, Some(first)) => {
            runner.plan().cell(first)?;
            (first..runner.plan().shards().min(first + args.count as usize)).collect()
        }
        _ => return Err(Failure::usage("give --index, --task or --stdin")),
    };
    let found = perform(&runner, &indices, args.json || global.quiet);
    match found {
        Err(e) if e.exit() == Exit::Interrupted && args.requeue.is_some() => {
            again(&runner, &warned)?;
            Err(e)
        }
        Ok(results) if args.json => out::json(&serde_json::json!({ "shards": results })),
        found => found.map(drop),
    }
}

/// Puts the job into the queue again after the queue's warning. If it saved nothing new in its
/// whole time, it would be repeated for ever, so it ends as a failure.
fn again(runner: &Runner, warned: &Cancel) -> Outcome {
    if !warned.is_cancelled() {
        return Ok(());
    }
    if !runner.has_advanced() {
        return Err(Failure::with(
            Exit::Failed,
            "the time limit is too short: nothing was finished and no checkpoint got further. Give the task more time",
        ));
    }
    Ok(slurm::requeue()?)
}

/// Performs the shards. A failure that concerns only one shard does not stop the others.
fn perform(
    runner: &Runner,
    indices: &[usize],
    silent: bool,
) -> Result<Vec<serde_json::Value>, Failure> {
    let mut results = Vec::new();
    let mut worst: Option<Error> = None;
    for &index in indices {
        match runner.run(index) {
            Ok(done) => {
                let how = if done == Done::Now { "done" } else { "done before" };
                if !silent {
                    out::line(&format!("shard {index}: {how}"))?;
                }
                results.push(serde_json::json!({ "index": index, "done": how }));
            }
            Err(e) if pool::alone(e.exit()) && indices.len() > 1 => {
                out::aside(format!("shard {index}: {e}"));
                if worst.as_ref().is_none_or(|w| rank(&e) > rank(w)) {
                    worst = Some(e);
                }
            }
            Err(e) => return Err(e.into()),
        }
    }
    worst.map_or(Ok(results), |e| Err(e.into()))
}

fn rank(e: &Error) -> u8 {
    u8::from(e.exit() == Exit::Threshold)
}
