//! A failed command: a message and an exit code.

use std::fmt::Display;
use std::io::Write as _;
use std::path::Path;

use super::escape::plain;
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
    /// The command line asks for something that is not possible.
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

    /// The same with the file that it is about.
    #[must_use]
    pub(super) fn about(self, file: &Path) -> Self {
        Self::with(self.exit, format!("{}: {}", file.display(), self.sentence()))
    }

    /// Prints `error: …` and its causes to stderr.
    pub(super) fn report(&self) {
        // Not `eprintln!`, which panics when nobody listens any more.
        writeln!(std::io::stderr(), "error: {}", plain(&self.sentence())).ok();
    }

    /// The error and its causes on one line. A cause that a message already contains is left out.
    pub(super) fn sentence(&self) -> String {
        let mut text = String::new();
        for cause in self.error.chain().map(ToString::to_string) {
            if text.is_empty() {
                text = cause;
            } else if !text.contains(&cause) {
                text = format!("{text}: {cause}");
            }
        }
        text
    }
}

impl<E: HasExit> From<E> for Failure {
    fn from(error: E) -> Self {
        Failure { exit: error.exit(), error: anyhow::Error::new(error) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn causes_are_told_once() {
        let missing = crate::fsio::read_capped(std::path::Path::new("/gone"), 1).unwrap_err();
        let said = Failure::from(missing).sentence();
        assert_eq!(said.matches("No such file").count(), 1, "{said}");
        let error = anyhow::anyhow!("disk full").context("cannot write a.mcap");
        assert_eq!(
            Failure { exit: Exit::Failed, error }.sentence(),
            "cannot write a.mcap: disk full"
        );
    }
}
