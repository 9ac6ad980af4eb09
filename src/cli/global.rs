//! Options of every command.

use clap::Args;

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

/// Threads to work with: the given number, else one per core.
pub(super) fn threads(asked: Option<u16>) -> usize {
    asked.map_or_else(|| std::thread::available_parallelism().map_or(1, usize::from), usize::from)
}
