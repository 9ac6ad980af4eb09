//! `robert shard status DIR` and `robert shard missing DIR`.

use std::path::PathBuf;

use super::super::failure::Outcome;
use super::super::out;
use super::accept::AcceptArgs;
use crate::shard::{Plan, State, ranges, survey};

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert shard status work/eval\n  robert shard status work/eval --json | jq '.missing | length'\n\nThe files of every shard are read and hashed; no queue is asked. With --json, done, missing, corrupt\nand foreign are lists of indices. Foreign shards are whole, but were computed by another kind of\nprocessor or another build of the program."
)]
pub(in super::super) struct StatusArgs {
    /// Folder of the plan.
    dir: PathBuf,
    #[command(flatten)]
    accept: AcceptArgs,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert shard missing work/eval\n  robert shard missing work/eval | parallel -j2 robert shard run work/eval --index {}"
)]
pub(in super::super) struct MissingArgs {
    /// Folder of the plan.
    dir: PathBuf,
    #[command(flatten)]
    accept: AcceptArgs,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub(super) fn status(args: &StatusArgs) -> Outcome {
    let plan = Plan::load(&args.dir)?;
    let found = survey(&args.dir, &plan, args.accept.accept());
    let (done, missing) = (found.done(), found.missing());
    let (corrupt, foreign) = (found.corrupt(), found.foreign());
    if args.json {
        return out::json(&serde_json::json!({
            "shards": plan.shards(),
            "done": done,
            "missing": missing,
            "corrupt": corrupt,
            "foreign": foreign,
        }));
    }
    let mut lines = vec![format!("{} of {} shards are done", done.len(), plan.shards())];
    if !missing.is_empty() {
        lines.push(format!("missing: {}", ranges(&missing)));
    }
    for (index, state) in found.states.iter().enumerate() {
        match state {
            State::Corrupt(why) => lines.push(format!("corrupt: {index} ({why})")),
            State::Foreign(why) => lines.push(format!("foreign: {index} ({why})")),
            State::Done | State::Missing => {}
        }
    }
    out::line(&lines.join("\n"))
}

pub(super) fn missing(args: &MissingArgs) -> Outcome {
    let plan = Plan::load(&args.dir)?;
    let left = survey(&args.dir, &plan, args.accept.accept()).left();
    if args.json {
        return out::json(&left);
    }
    let lines: Vec<String> = left.iter().map(|i| format!("{i}\n")).collect();
    out::bytes(lines.concat().as_bytes())
}
