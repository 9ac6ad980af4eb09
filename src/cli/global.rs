//! What every command understands.

use clap::Args;

/// Options that every command understands.
#[derive(Args, Clone, Copy, Debug)]
pub(super) struct Global {
    /// Say less: errors only.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub(super) quiet: bool,
    /// As --json, and progress as JSON lines on stdout before it: for other programs.
    #[arg(long, global = true)]
    pub(super) jsonl: bool,
    /// Say more; twice for debugging.
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub(super) verbose: u8,
}

/// Threads to work with: as many as were asked for, else one a core.
pub(super) fn threads(asked: Option<u16>) -> usize {
    asked.map_or_else(|| std::thread::available_parallelism().map_or(1, usize::from), usize::from)
}
