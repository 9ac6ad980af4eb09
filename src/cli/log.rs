//! Log lines on stderr. WARN means something was assumed or dropped, ERROR means lost.

use std::io::IsTerminal;

use tracing_subscriber::EnvFilter;

/// Installs the subscriber. `ROBERT_LOG` (tracing's filter syntax) overrides the flags.
pub(super) fn init(quiet: bool, verbose: u8) {
    let level = match (quiet, verbose) {
        (true, _) => "error",
        (false, 0) => "warn,robert=info",
        (false, 1) => "info,robert=debug",
        (false, _) => "debug,robert=trace",
    };
    let filter = EnvFilter::try_from_env("ROBERT_LOG").unwrap_or_else(|_| EnvFilter::new(level));
    let color = std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
    // A second call (tests in one process) keeps the first subscriber.
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(color)
        .with_target(false)
        .without_time()
        .try_init()
        .ok();
}
