//! Why the studio refuses something, as a client reads it.

use serde::Serialize;

use super::error::Error;
use robert_base::exit::{Exit, HasExit};
use robert_clip::ClipError;

/// The kind of a refusal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum Code {
    /// A file, a value or an edit is wrong.
    Invalid,
    /// A request is malformed.
    Request,
    /// No token.
    Unauthorized,
    /// The sender may not ask for this.
    Forbidden,
    /// There is no such thing.
    NotFound,
    /// No clip is open.
    NoDocument,
    /// The clip needs a file name first.
    Untitled,
    /// A file of that name exists.
    Exists,
    /// Another program has changed the file meanwhile.
    Changed,
    /// Another studio has it.
    Locked,
    /// The simulation is down.
    Worker,
    /// A body is too large.
    TooLarge,
    /// A cap was reached.
    Full,
    /// It was tried and failed.
    Failed,
}

/// A place in a file.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Place {
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub col: usize,
}

/// A refusal.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ErrorBody {
    /// Its kind.
    pub code: Code,
    /// The sentence that the command line prints after `error: `.
    pub message: String,
    /// The place, for files.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub place: Option<Place>,
    /// A way to solve the problem, if the message does not contain it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mend: Option<String>,
}

impl ErrorBody {
    /// A refusal.
    pub fn new(code: Code, message: impl Into<String>) -> ErrorBody {
        ErrorBody { code, message: message.into(), place: None, mend: None }
    }

    /// The HTTP status.
    pub fn status(&self) -> u16 {
        match self.code {
            Code::Invalid => 422,
            Code::Request => 400,
            Code::Unauthorized => 401,
            Code::Forbidden => 403,
            Code::NotFound | Code::NoDocument => 404,
            Code::Untitled | Code::Exists | Code::Changed | Code::Locked => 409,
            Code::TooLarge => 413,
            Code::Full => 429,
            Code::Worker => 503,
            Code::Failed => 500,
        }
    }
}

impl From<&Error> for ErrorBody {
    fn from(e: &Error) -> ErrorBody {
        let code = match e {
            Error::NoDocument => Code::NoDocument,
            Error::Untitled => Code::Untitled,
            Error::Exists { .. } => Code::Exists,
            Error::Changed { .. } => Code::Changed,
            Error::Locked { .. } => Code::Locked,
            Error::Worker { .. } => Code::Worker,
            Error::Request { .. } => Code::Request,
            Error::NotFound { .. } => Code::NotFound,
            Error::TooLarge { .. } => Code::TooLarge,
            Error::Full { .. } => Code::Full,
            other if other.exit() == Exit::Invalid => Code::Invalid,
            _ => Code::Failed,
        };
        let place = match e {
            Error::Clip(c) => ClipError::line_col(c).map(|(line, col)| Place { line, col }),
            _ => None,
        };
        let mend = match e {
            Error::Locked { .. } => Some("close the other studio, or save under another name"),
            Error::Untitled => Some("use save as"),
            Error::Exists { .. } => Some("another name, or \"replace\": true"),
            Error::Changed { .. } => Some("\"replace\": true, /api/reload, or another path"),
            Error::Worker { .. } => Some("press restart; edits are safe meanwhile"),
            _ => None,
        };
        ErrorBody { code, message: e.to_string(), place, mend: mend.map(str::to_owned) }
    }
}
