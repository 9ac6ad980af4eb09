//! Log lines on stderr. WARN means that something was assumed or left out, ERROR that something was
//! lost.

use std::io::IsTerminal;

use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;

/// Installs the subscriber. `ROBERT_LOG` (levels by module, `warn,robert=debug`) overrides the
/// flags.
pub(super) fn init(quiet: bool, verbose: u8) {
    let level = match (quiet, verbose) {
        (true, _) => "error",
        (false, 0) => "warn,robert=info",
        (false, 1) => "info,robert=debug",
        (false, _) => "debug,robert=trace",
    };
    let asked = std::env::var("ROBERT_LOG").ok();
    let levels = asked.as_deref().unwrap_or(level).parse::<Targets>();
    let unknown = levels.is_err();
    let levels = levels.unwrap_or_else(|_| Targets::new().with_default(tracing::Level::INFO));
    let color = std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
    // A second call (tests in one process) keeps the first subscriber.
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(std::io::stderr)
        .with_ansi(color)
        .with_target(false)
        .without_time();
    tracing_subscriber::registry().with(lines).with(levels).try_init().ok();
    if unknown {
        tracing::warn!("ROBERT_LOG is not a list of levels such as warn,robert=debug: ignored");
    }
}
