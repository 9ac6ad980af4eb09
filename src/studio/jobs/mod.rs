//! Jobs: collect, train, evaluate, import and export from the browser, as child processes that run
//! the same commands as a shell.
//!
//! A job is `robert KIND ARGS.. --jsonl`. Its stdout contains one event per line: `progress` (only
//! the newest is kept), `figures` for curves, `log`, and at the end `result`. Cancelling sends the
//! signal of Ctrl-C, so the job writes its checkpoint. Resuming starts it again with `--resume`.

mod arguments;
mod process;

pub(crate) use process::{Extra, Jobs};
