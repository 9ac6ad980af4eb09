//! Options of every command.

use clap::Args;
use clap::builder::RangedU64ValueParser;

pub(super) use crate::parallel::cores;

/// Options of every command.
#[derive(Args, Clone, Copy, Debug)]
#[command(next_help_heading = "Global options")]
pub(super) struct Global {
    /// Print results and errors only: no progress, notes or warnings.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub(super) quiet: bool,
    /// Like --json, preceded by progress as JSON lines on stdout; for other programs.
    #[arg(long, global = true)]
    pub(super) jsonl: bool,
    /// Print more; give it twice for debugging.
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub(super) verbose: u8,
}

/// Threads of a command that computes.
#[derive(Args, Clone, Copy, Debug)]
pub(super) struct Threads {
    /// Threads [default: all cores]. They change the time and not the results.
    #[arg(long, value_name = "N", value_parser = thread_count())]
    pub(super) threads: Option<usize>,
}

impl Threads {
    /// The given number, else one per core.
    pub(super) fn count(self) -> usize {
        self.threads.unwrap_or_else(cores)
    }
}

/// The number that every `--threads` takes.
pub(super) fn thread_count() -> RangedU64ValueParser<usize> {
    RangedU64ValueParser::new().range(1..=1024)
}
