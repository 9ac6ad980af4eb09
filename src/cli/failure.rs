//! What a command returns when it does not succeed: a message and an exit code.

use std::fmt::Display;

use crate::exit::{Exit, HasExit};

/// The result of a command.
pub type Outcome<T = ()> = Result<T, Failure>;

/// An error on its way to the user, with the exit code it leads to.
#[derive(Debug)]
pub struct Failure {
    exit: Exit,
    error: anyhow::Error,
}

impl Failure {
    /// The command line asks for something that cannot be.
    pub fn usage(message: impl Display) -> Self {
        Self::with(Exit::Usage, message)
    }

    /// A file or value from the user is wrong.
    pub fn invalid(message: impl Display) -> Self {
        Self::with(Exit::Invalid, message)
    }

    /// A failure of this class.
    pub fn with(exit: Exit, message: impl Display) -> Self {
        Failure { exit, error: anyhow::anyhow!("{message}") }
    }

    /// The exit code.
    pub fn exit(&self) -> Exit {
        self.exit
    }

    /// Prints `error: …` and its causes to stderr. A closed stdout is no error worth words.
    pub(super) fn report(&self) {
        if is_broken_pipe(&self.error) {
            return;
        }
        // `{:#}` joins the chain of causes with colons: one line, what then why.
        eprintln!("error: {:#}", self.error);
    }
}

impl<E: HasExit> From<E> for Failure {
    fn from(error: E) -> Self {
        Failure { exit: error.exit(), error: anyhow::Error::new(error) }
    }
}

fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error
        .chain()
        .filter_map(|c| c.downcast_ref::<std::io::Error>())
        .any(|e| e.kind() == std::io::ErrorKind::BrokenPipe)
}
