//! Errors of clip files.

use std::path::{Path, PathBuf};

use super::flaw::Flaw;
use robert_base::exit::{Exit, HasExit};
use robert_base::fsio;

/// Why a clip, or a file to import as one, cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ClipError {
    /// The file cannot be read or written.
    #[error(transparent)]
    File(#[from] fsio::Error),
    /// The text is not a `robert-clip/1` document.
    #[error("{}{line}:{col}: {message}", prefix(.path.as_deref()))]
    Syntax {
        /// The problem and how to fix it.
        message: String,
        /// Line, from 1.
        line: usize,
        /// Column in characters, from 1.
        col: usize,
        /// The file, if there is one.
        path: Option<PathBuf>,
    },
    /// The document is well formed but breaks a rule.
    #[error("{}{line}:{col}: {flaw}", prefix(.path.as_deref()))]
    Invalid {
        /// The rule.
        flaw: Flaw,
        /// JSON pointer of the value.
        pointer: String,
        /// Line, from 1.
        line: usize,
        /// Column in characters, from 1.
        col: usize,
        /// The file, if there is one.
        path: Option<PathBuf>,
    },
}

impl ClipError {
    /// An error at a place in a text.
    pub fn at(message: impl Into<String>, line: usize, col: usize) -> Self {
        ClipError::Syntax { message: message.into(), line, col, path: None }
    }

    /// The same error with the name of the file.
    #[must_use]
    pub fn in_file(mut self, file: &Path) -> Self {
        match &mut self {
            ClipError::Syntax { path, .. } | ClipError::Invalid { path, .. } => {
                *path = Some(file.to_owned());
            }
            ClipError::File(_) => {}
        }
        self
    }

    /// Line and column, from 1.
    pub fn line_col(&self) -> Option<(usize, usize)> {
        match self {
            ClipError::Syntax { line, col, .. } | ClipError::Invalid { line, col, .. } => {
                Some((*line, *col))
            }
            ClipError::File(_) => None,
        }
    }
}

impl HasExit for ClipError {
    fn exit(&self) -> Exit {
        match self {
            ClipError::File(e) => e.exit(),
            ClipError::Syntax { .. } | ClipError::Invalid { .. } => Exit::Invalid,
        }
    }
}

fn prefix(path: Option<&Path>) -> String {
    path.map(|p| format!("{}:", p.display())).unwrap_or_default()
}
