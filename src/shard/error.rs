//! Errors of plans, shards and merges.

use std::path::PathBuf;

use robert_base::exit::{Exit, HasExit};
use robert_base::fsio;

/// Errors between a spec and its merged results.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A spec that cannot be read or makes no sense.
    #[error("{place}: {why}")]
    Spec {
        /// The problem, in words.
        why: String,
        /// The file, with line and column where they are known.
        place: String,
    },
    /// A cell that could not run.
    #[error("shard {index} ({what}) cannot run: {why}")]
    Cell {
        /// Index.
        index: usize,
        /// Its description.
        what: String,
        /// The reason.
        why: String,
    },
    /// A plan that is damaged or missing.
    #[error("{why}: {path}", path = path.display())]
    Plan {
        /// The problem, in words.
        why: String,
        /// The plan, or something that it names.
        path: PathBuf,
    },
    /// An index beyond the plan.
    #[error("there is no shard {index}: the plan has {shards}, numbered from 0")]
    Index {
        /// The index asked for.
        index: usize,
        /// Shards of the plan.
        shards: usize,
    },
    /// This machine would compute other bits than the plan requires.
    #[error(
        "this machine computes with {here}, the plan was made for {planned}: results would differ in their last bits. Run it on another machine, plan with --numerics avx2, or allow it with --any-processor"
    )]
    Processor {
        /// Kind of this machine.
        here: String,
        /// Kind of the plan.
        planned: String,
    },
    /// This processor lacks what `--numerics avx2` needs.
    #[error("this processor lacks AVX2: plan without --numerics, or on another machine")]
    NoAvx2,
    /// This program is not the one that made the plan.
    #[error(
        "this program (sha256 {here:.12}) is not the one that made the plan ({planned:.12}). Plan again, plan with --copy-binary and run that copy, or allow it with --any-build"
    )]
    Build {
        /// Sha-256 of this program.
        here: String,
        /// Sha-256 of the plan's.
        planned: String,
    },
    /// An input that has changed since the plan was made.
    #[error("{what} has changed since the plan was made; plan again")]
    Input {
        /// The input.
        what: String,
    },
    /// Shards that a merge needs.
    #[error("{why}", why = incomplete(.missing, .corrupt, .foreign))]
    Incomplete {
        /// Indices without files.
        missing: Vec<usize>,
        /// Indices whose files are damaged.
        corrupt: Vec<usize>,
        /// Indices of shards made by another kind of processor or another program.
        foreign: Vec<usize>,
    },
    /// Two runs of one shard on one kind of machine gave different files.
    #[error("shard {index} gave other files than an earlier run of it; both are kept: {path} and {other}", path = path.display(), other = other.display())]
    Differs {
        /// Index.
        index: usize,
        /// The earlier one.
        path: PathBuf,
        /// The later one.
        other: PathBuf,
    },
    /// A stop was requested.
    #[error("stopped at shard {index}; the same command continues")]
    Stopped {
        /// The shard in progress.
        index: usize,
    },
    /// The output folder holds something else.
    #[error("{path} is not empty and was not made by a merge; choose another --out", path = path.display())]
    Occupied {
        /// The folder.
        path: PathBuf,
    },
    /// A child process that died repeatedly.
    #[error(
        "the process that ran shard {index} ended {times} times without an answer, last with {status}"
    )]
    Died {
        /// Index.
        index: usize,
        /// The number of attempts.
        times: u32,
        /// The exit status of the last attempt.
        status: String,
    },
    /// A command of the queue that is missing or failed.
    #[error("{why}")]
    Queue {
        /// What happened, and what may help.
        why: String,
        /// Whether the program is missing.
        missing: bool,
    },
    /// Robots.
    #[error(transparent)]
    Robot(#[from] robert_robot::Error),
    /// Collection.
    #[error(transparent)]
    Collect(#[from] robert_explore::Error),
    /// Data.
    #[error(transparent)]
    Data(#[from] robert_dataset::Error),
    /// Policies and rollouts.
    #[error(transparent)]
    Rollout(#[from] robert_rollout::Error),
    /// Built-in tasks.
    #[error(transparent)]
    Tasks(#[from] robert_rollout::tasks::TaskError),
    /// Clips.
    #[error(transparent)]
    Clip(#[from] robert_clip::ClipError),
    /// Training.
    #[error(transparent)]
    Train(#[from] robert_train::Error),
    /// Files.
    #[error(transparent)]
    Files(#[from] fsio::Error),
}

/// The largest number of indices in a message; the command `missing` lists all of them.
const SHOWN: usize = 1000;

fn incomplete(missing: &[usize], corrupt: &[usize], foreign: &[usize]) -> String {
    let named = [("missing", missing), ("corrupt", corrupt), ("foreign", foreign)];
    let parts = named.iter().filter(|(_, list)| !list.is_empty()).map(|(name, list)| {
        let shown: Vec<String> = list.iter().take(SHOWN).map(ToString::to_string).collect();
        let more = list.len().saturating_sub(SHOWN);
        let rest = if more > 0 { format!(" and {more} more") } else { String::new() };
        format!("{name}: {}{rest}", shown.join(" "))
    });
    let parts: Vec<String> = parts.collect();
    let count = missing.len() + corrupt.len() + foreign.len();
    let noun = if count == 1 { "shard is" } else { "shards are" };
    format!("{count} {noun} not there to merge ({}); nothing was written", parts.join("; "))
}

impl HasExit for Error {
    fn exit(&self) -> Exit {
        match self {
            Error::Spec { .. } | Error::Cell { .. } | Error::Plan { .. } | Error::Input { .. } => {
                Exit::Invalid
            }
            Error::Index { .. } | Error::Occupied { .. } => Exit::Usage,
            Error::Processor { .. } | Error::NoAvx2 | Error::Build { .. } => Exit::Missing,
            Error::Incomplete { .. } => Exit::Threshold,
            Error::Differs { .. } | Error::Died { .. } => Exit::Failed,
            Error::Stopped { .. } => Exit::Interrupted,
            Error::Queue { missing, .. } => {
                if *missing {
                    Exit::Missing
                } else {
                    Exit::Failed
                }
            }
            Error::Robot(e) => e.exit(),
            Error::Collect(e) => e.exit(),
            Error::Data(e) => e.exit(),
            Error::Rollout(e) => e.exit(),
            Error::Tasks(e) => e.exit(),
            Error::Clip(e) => e.exit(),
            Error::Train(e) => e.exit(),
            Error::Files(e) => e.exit(),
        }
    }
}

/// An error of the operating system while writing `path`.
pub(super) fn write_error(path: &std::path::Path) -> impl Fn(std::io::Error) -> Error + '_ {
    move |source| fsio::Error::Write { source, path: path.to_owned() }.into()
}
