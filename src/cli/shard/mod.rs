//! `robert shard`: large work in parts that any machine can do.

mod accept;
mod merge;
mod plan;
mod run;
mod status;
mod submit;

use super::failure::Outcome;
use super::global::Global;

#[derive(clap::Subcommand, Debug)]
#[command(
    after_help = "Examples:\n  robert shard plan examples/shards/eval.toml --out work/eval\n  robert shard submit work/eval --backend local\n  robert shard merge work/eval --out results/eval"
)]
pub(super) enum Args {
    /// Divide the work of a spec into shards; every shard is checked first.
    Plan(plan::Args),
    /// Run one or more shards; what is done is skipped.
    Run(run::Args),
    /// Count the shards that are done, missing, corrupt or foreign.
    Status(status::StatusArgs),
    /// List the shards that are not done, one index a line.
    Missing(status::MissingArgs),
    /// Merge the results; refuses while a shard is missing.
    Merge(merge::Args),
    /// Run all shards that are not done, on this machine or on a cluster.
    Submit(submit::Args),
}

pub(super) fn run(args: &Args, global: Global) -> Outcome {
    match args {
        Args::Plan(args) => plan::run(args, global),
        Args::Run(args) => run::run(args, global),
        Args::Status(args) => status::status(args),
        Args::Missing(args) => status::missing(args),
        Args::Merge(args) => merge::run(args),
        Args::Submit(args) => submit::run(args, global),
    }
}
