//! `robert shard merge DIR --out OUT`.

use std::path::PathBuf;

use super::super::failure::Outcome;
use super::super::out;
use super::accept::AcceptArgs;
use crate::shard::{Error, Plan, merge};

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert shard merge work/eval --out results/eval\n  robert shard merge work/motion --out data/motion --copy\n\nA collection becomes a dataset, with hard links to the motion of the shards. An evaluation becomes\nrows.csv and results.json, a sweep or seeds the models and results.json. merged.json lists every\nfile with its sha256 and has equal bytes for equal work.\n\nIf shards are missing, corrupt or foreign, nothing is written, their indices are printed, one a\nline, and the exit code is 4."
)]
pub(in super::super) struct Args {
    /// Folder of the plan.
    dir: PathBuf,
    /// Folder for the results. An earlier merge there is replaced.
    #[arg(short, long, value_name = "OUT")]
    out: PathBuf,
    /// Copy the motion of a collection instead of making hard links to it. Where the file system
    /// has no hard links, it is copied anyway.
    #[arg(long)]
    copy: bool,
    #[command(flatten)]
    accept: AcceptArgs,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Outcome {
    let plan = Plan::load(&args.dir)?;
    let merged = match merge(&args.dir, &plan, &args.out, args.accept.accept(), args.copy) {
        Err(Error::Incomplete { missing, corrupt, foreign }) => {
            if args.json {
                out::json(&serde_json::json!({
                    "missing": missing,
                    "corrupt": corrupt,
                    "foreign": foreign,
                }))?;
            } else {
                let mut all: Vec<(usize, &str)> = Vec::new();
                let named = [(&missing, "missing"), (&corrupt, "corrupt"), (&foreign, "foreign")];
                for (list, what) in named {
                    all.extend(list.iter().map(|&i| (i, what)));
                }
                all.sort_unstable();
                let lines = all.iter().map(|(i, what)| format!("{i} {what}\n"));
                out::bytes(lines.collect::<Vec<_>>().concat().as_bytes())?;
            }
            return Err(Error::Incomplete { missing, corrupt, foreign }.into());
        }
        found => found?,
    };
    if args.json {
        return out::json(&serde_json::json!({
            "out": args.out,
            "shards": merged.shards,
            "sha256": merged.sha256(),
            "lost": merged.lost,
            "numerics": merged.numerics,
            "summary": merged.summary,
        }));
    }
    let lost =
        if merged.lost > 0 { format!(", {} rollouts lost", merged.lost) } else { String::new() };
    out::line(&format!(
        "{}: {} shards{lost}, sha256 {}",
        args.out.display(),
        merged.shards,
        merged.sha256()
    ))
}
