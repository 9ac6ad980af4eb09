//! What is wrong with a clip that breaks a rule.

use super::json::show;
use robert_base::limits;

/// One broken rule and the JSON pointer of the value that breaks it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{flaw} (at {pointer})")]
pub struct Invalid {
    /// The place, as a JSON pointer into the document.
    pub pointer: String,
    /// The rule.
    pub flaw: Flaw,
}

/// A rule that a clip can break.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Flaw {
    /// A name is empty, too long or contains control characters.
    #[error("{what} {reason}: \"{}\"", show(.name))]
    Name {
        /// What is named.
        what: &'static str,
        /// What is wrong with it.
        reason: &'static str,
        /// The name.
        name: String,
    },
    /// Notes beyond [`limits::NOTES_BYTES`].
    #[error("the notes have {bytes} bytes; at most {} are allowed", limits::NOTES_BYTES)]
    Notes {
        /// Their size.
        bytes: usize,
    },
    /// The list of joints is empty or too long.
    #[error("a robot must have 1 to {} joints, not {count}", limits::JOINTS)]
    Joints {
        /// How many there are.
        count: usize,
    },
    /// A name appears twice in one list.
    #[error("{what} \"{}\" appears twice", show(.name))]
    Twice {
        /// What is named.
        what: &'static str,
        /// The name.
        name: String,
    },
    /// `units` does not match `joints`.
    #[error("{found} units for {joints} joints; give one per joint or none")]
    Units {
        /// Units found.
        found: usize,
        /// Joints.
        joints: usize,
    },
    /// `model_sha256` is not a Sha-256.
    #[error("a SHA-256 must have 64 hex digits")]
    Sha,
    /// A clip of no or too many frames.
    #[error("a clip must have 1 to {} frames, not {frames}", limits::CLIP_FRAMES)]
    Length {
        /// Its length.
        frames: u32,
    },
    /// Too much data in one clip.
    #[error("{what}: {count}; at most {cap} are read")]
    TooMany {
        /// What there is too much of.
        what: &'static str,
        /// How many.
        count: usize,
        /// The cap.
        cap: usize,
    },
    /// A row of another length than the joint list.
    #[error("{found} values for {joints} joints; write null for a joint without a goal")]
    RowLength {
        /// Values found.
        found: usize,
        /// Joints.
        joints: usize,
    },
    /// A row without any goal.
    #[error("every joint is null; a goal needs a value (to hide frames, use `masks`)")]
    RowEmpty,
    /// A value that is not finite or beyond [`limits::CLIP_VALUE_MAX`].
    #[error("{value} is not a joint value (at most {:e} rad or m)", limits::CLIP_VALUE_MAX)]
    Value {
        /// The value.
        value: f64,
    },
    /// A slope that is not finite or beyond [`limits::CLIP_VALUE_MAX`].
    #[error("{slope} is not a slope (at most {:e} rad/s or m/s)", limits::CLIP_VALUE_MAX)]
    Slope {
        /// The slope.
        slope: f64,
    },
    /// A key that says nothing.
    #[error("a key needs `pose`, `q` or `reach`")]
    NoGoal,
    /// A coordinate that is not finite or beyond [`limits::CLIP_VALUE_MAX`].
    #[error("{value} is not a coordinate (at most {:e} m)", limits::CLIP_VALUE_MAX)]
    Place {
        /// The value.
        value: f64,
    },
    /// A quaternion of length 0, or not finite.
    #[error("an orientation needs four numbers w x y z that are not all 0")]
    Quaternion,
    /// End-effector goals cannot be solved without the robot.
    #[error(
        "end-effector goals need the robot, and {} is unknown here; give its folder with --robot",
        show(.robot)
    )]
    NeedsRobot {
        /// Its id.
        robot: String,
    },
    /// A site or body that the robot does not have.
    #[error("the robot has no {kind} \"{}\"{hint}", show(.name))]
    UnknownPoint {
        /// `site` or `body`.
        kind: &'static str,
        /// Its name.
        name: String,
        /// A hint with the nearest name.
        hint: String,
    },
    /// A pose that the clip does not have.
    #[error("there is no pose \"{}\"{hint}", show(.name))]
    UnknownPose {
        /// Its name.
        name: String,
        /// A hint with the nearest name.
        hint: String,
    },
    /// A start pose with nulls.
    #[error("the start needs a value for every joint, but pose \"{}\" leaves some open", show(.name))]
    StartOpen {
        /// The pose.
        name: String,
    },
    /// A frame outside the clip.
    #[error("frame {frame} is outside the clip of {length} frames")]
    Outside {
        /// The frame.
        frame: u32,
        /// The clip's length.
        length: u32,
    },
    /// Two keys, offsets or markers on one frame.
    #[error("there are two {what}s at frame {frame}")]
    Occupied {
        /// `key`, `offset` or `marker`.
        what: &'static str,
        /// The frame.
        frame: u32,
    },
    /// A hold of 0 or too many frames.
    #[error("a hold must be 1 to {} frames, not {hold}", limits::CLIP_FRAMES)]
    Hold {
        /// Its length.
        hold: u32,
    },
    /// An offset without a joint.
    #[error("an offset must add something to a joint; leave it out instead")]
    AddsNothing,
    /// A fade of too many frames.
    #[error("an offset fades over 0 to {} frames, not {frames}", limits::CLIP_FRAMES)]
    Fade {
        /// Its length.
        frames: u32,
    },
    /// A mask span or a block that is empty or leaves the clip.
    #[error("the span {from}..{to} must be increasing and inside the clip of {length} frames")]
    Span {
        /// First frame.
        from: u32,
        /// Frame after the last.
        to: u32,
        /// The clip's length.
        length: u32,
    },
    /// A joint that the clip does not list.
    #[error("there is no joint \"{}\"{hint}", show(.name))]
    UnknownJoint {
        /// Its name.
        name: String,
        /// A hint with the nearest name.
        hint: String,
    },
    /// A mask with an empty joint list.
    #[error("an empty joint list masks nothing; leave `joints` out to mask all")]
    NoJoints,
}

/// Names that a message lists at most.
const LISTED: usize = 12;

/// The first names of a list, in words.
pub(crate) fn some<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    let mut names = names.into_iter();
    let first = names.by_ref().take(LISTED).collect::<Vec<_>>().join(", ");
    if names.next().is_some() { first + ", …" } else { first }
}

/// `; did you mean "x"?` when something close exists.
pub(crate) fn hint<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    // The distance costs name × known, so long names get no hint, and only some are compared.
    if name.len() > 64 {
        return String::new();
    }
    known
        .into_iter()
        .take(1000)
        .filter(|k| k.len() <= 64)
        .map(|k| (strsim::damerau_levenshtein(name, k), k))
        .min()
        .filter(|(d, k)| *d <= 1 + k.len() / 4)
        .map(|(_, k)| format!("; did you mean \"{}\"?", show(k)))
        .unwrap_or_default()
}
