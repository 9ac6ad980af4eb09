//! Exit codes, with the meaning of each number for scripts.
//!
//! Every library error knows its class through [`HasExit`]; the command line only
//! prints the message and leaves with that code.

/// Why the process ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Exit {
    /// The job was done.
    Ok = 0,
    /// The job itself failed (simulation broke, disk full, training diverged).
    Failed = 1,
    /// The command line was wrong.
    Usage = 2,
    /// A file or value given by the user is invalid; the message names path:line:col.
    Invalid = 3,
    /// A requested threshold was missed (`eval --max-precision`, `clip check`).
    Threshold = 4,
    /// A library, driver or file that the program needs is missing.
    Missing = 5,
    /// Stopped by the user after a checkpoint was written.
    Interrupted = 130,
}

impl Exit {
    /// The number handed to the operating system.
    pub fn code(self) -> u8 {
        self as u8
    }
}

/// An error that knows its exit code.
pub trait HasExit: std::error::Error + Send + Sync + 'static {
    /// The class of this error.
    fn exit(&self) -> Exit;
}

impl HasExit for std::io::Error {
    fn exit(&self) -> Exit {
        Exit::Failed
    }
}
