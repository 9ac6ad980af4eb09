//! Why an edit is refused.

use crate::flaw::Invalid;
use crate::json::show;
use robert_base::exit::{Exit, HasExit};

/// Why an edit was refused; the clip is unchanged.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum OpError {
    /// No key at this frame.
    #[error("there is no key at frame {frame}")]
    NoKey {
        /// The frame.
        frame: u32,
    },
    /// No marker at this frame.
    #[error("there is no marker at frame {frame}")]
    NoMarker {
        /// The frame.
        frame: u32,
    },
    /// No pose of this name.
    #[error("there is no pose \"{}\"{hint}", show(.name))]
    NoPose {
        /// The name.
        name: String,
        /// A hint with the nearest name.
        hint: String,
    },
    /// A pose of this name exists.
    #[error("there is already a pose \"{}\"", show(.name))]
    PoseTaken {
        /// The name.
        name: String,
    },
    /// No joint of this name.
    #[error("there is no joint \"{}\"{hint}", show(.name))]
    NoJoint {
        /// The name.
        name: String,
        /// A hint with the nearest name.
        hint: String,
    },
    /// Keys would overwrite others.
    #[error(
        "{count} of the keys would overwrite another key (first at frame {frame}); move or delete that key first"
    )]
    Occupied {
        /// How many.
        count: usize,
        /// The first such frame.
        frame: u32,
    },
    /// Keys, offsets or markers are beyond a new end.
    #[error(
        "{count} keys, offsets or markers are at frame {length} or later; move or delete them first, or cut the clip there"
    )]
    Beyond {
        /// How many.
        count: usize,
        /// The new length.
        length: u32,
    },
    /// A key would leave the clip.
    #[error("a key would be at frame {frame}, outside the clip of {length} frames")]
    Outside {
        /// The frame.
        frame: i64,
        /// The clip's length.
        length: u32,
    },
    /// The robot has no mirror image.
    #[error("cannot mirror: {reason}")]
    Mirror {
        /// Why.
        reason: String,
    },
    /// An argument makes no sense.
    #[error("{what}")]
    Argument {
        /// What and why.
        what: String,
    },
    /// The clip would break a rule.
    #[error(transparent)]
    Invalid(#[from] Invalid),
    /// One edit of a batch was refused.
    #[error("edit {index} ({name}): {source}")]
    InBatch {
        /// Which, from 0.
        index: usize,
        /// Its operation.
        name: &'static str,
        /// Why.
        source: Box<OpError>,
    },
}

impl HasExit for OpError {
    fn exit(&self) -> Exit {
        Exit::Invalid
    }
}

pub(super) type Done = Result<(), OpError>;

pub(super) fn argument<T>(what: impl Into<String>) -> Result<T, OpError> {
    Err(OpError::Argument { what: what.into() })
}
