//! Collect, train, evaluate, import and export from the browser: the same commands as in a
//! shell, as children.
//!
//! A job is `robert KIND ARGS.. --jsonl`; its stdout is events, a line each: `progress` (only
//! the newest is kept), `figures` for curves, `log`, and at the end `result`. Cancelling sends
//! what Ctrl-C sends, so the job writes its checkpoint; resuming starts it again with `--resume`.

mod arguments;
mod process;

pub(crate) use process::{Extra, Jobs};
