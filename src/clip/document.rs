//! The clip: the document that a person draws on the timeline.
//!
//! Plain data with public fields, so that a program can build one; [`Clip::validate`] checks the
//! rules. Values are on a grid of 1e-6 (rad or m). Memory and file contain the same values, so a
//! saved clip rolls out exactly as the one on screen.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::grid::round;
use super::offset::Offset;
use super::reach::Reach;
use super::tangent::Tangent;

use robert_base::units::{FPS, Unit};

/// The format this program writes.
pub const FORMAT: &str = "robert-clip/1";

/// One value per joint, in the order of [`RobotRef::joints`]; a key says nothing about a joint that is `None`.
pub type Row = Vec<Option<f64>>;

/// The command after the hold of a key, up to the next key of each joint.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, schemars::JsonSchema,
)]
#[serde(rename_all = "lowercase")]
pub enum Fill {
    /// Nothing; the policy decides. The paper's keyframe mode.
    #[default]
    Mask,
    /// The straight line to the joint's next key.
    Linear,
    /// Monotone cubic to the joint's next key (no overshoot, zero slope at holds and ends), unless a key
    /// has a tangent.
    Cubic,
    /// This key's value until the joint's next key.
    Hold,
}

impl Fill {
    /// All kinds, in the order the studio cycles through them.
    pub const ALL: [Fill; 4] = [Fill::Mask, Fill::Linear, Fill::Cubic, Fill::Hold];

    /// Its word in the file.
    pub fn word(self) -> &'static str {
        match self {
            Fill::Mask => "mask",
            Fill::Linear => "linear",
            Fill::Cubic => "cubic",
            Fill::Hold => "hold",
        }
    }

    /// The kind with this word.
    pub fn from_word(word: &str) -> Option<Fill> {
        Fill::ALL.into_iter().find(|f| f.word() == word)
    }
}

/// The robot a clip was made for, and its joint order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RobotRef {
    /// Robot id, such as `ur5e`.
    pub id: String,
    /// Path of its model, for people.
    pub model: Option<String>,
    /// Sha-256 of that model, 64 lower-case hex digits.
    pub model_sha256: Option<String>,
    /// Joint names; every row of the clip follows this order.
    pub joints: Vec<String>,
    /// Units of the joints; empty if the file has none.
    pub units: Vec<Unit>,
}

/// The source of a key's values.
#[derive(Clone, Debug, PartialEq)]
pub enum Goal {
    /// A named pose of this clip.
    Pose(String),
    /// Values of its own.
    Q(Row),
    /// No values: its end-effector goals determine the joints, near the line between the keys
    /// around it.
    Open,
}

/// A keyframe: an unmasked command frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "KeyFields", into = "KeyFields")]
pub struct Key {
    /// Its frame, in 1/20 s.
    pub frame: u32,
    /// Its values.
    pub goal: Goal,
    /// End-effector goals. The compiler finds joint values near [`Key::goal`] that bring the points
    /// there.
    pub reach: Vec<Reach>,
    /// The number of frames for which it is commanded (at least 1). The end of the clip ends it early, and so
    /// does for a joint the next key with a value for it.
    pub hold: u32,
    /// The fill after it, if it differs from [`Clip::fill`].
    pub fill: Option<Fill>,
    /// Slopes of cubic curves at this key, by joint. Joints that are not listed have automatic
    /// slopes.
    pub tangents: BTreeMap<String, Tangent>,
    /// A remark.
    pub note: String,
}

impl Key {
    /// A key with values of its own.
    pub fn new(frame: u32, q: &[f64]) -> Key {
        Key::with(frame, Goal::Q(q.iter().copied().map(Some).collect()))
    }

    /// A key that takes a named pose.
    pub fn posed(frame: u32, pose: &str) -> Key {
        Key::with(frame, Goal::Pose(pose.to_owned()))
    }

    /// A key of this goal.
    pub fn with(frame: u32, goal: Goal) -> Key {
        let (reach, tangents, note) = (Vec::new(), BTreeMap::new(), String::new());
        Key { frame, goal, reach, hold: 1, fill: None, tangents, note }
    }

    /// The same key, commanded for this many frames.
    #[must_use]
    pub fn held(self, hold_frames: u32) -> Key {
        Key { hold: hold_frames, ..self }
    }

    /// The same key, with this fill after it.
    #[must_use]
    pub fn filled(self, fill: Fill) -> Key {
        Key { fill: Some(fill), ..self }
    }
}

/// A key as in JSON.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct KeyFields {
    frame: u32,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pose: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    q: Option<Row>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    reach: Vec<Reach>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    hold: Option<u32>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    fill: Option<Fill>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    tangents: BTreeMap<String, Tangent>,
    #[serde(default, skip_serializing_if = "String::is_empty")]
    note: String,
}

impl TryFrom<KeyFields> for Key {
    type Error = &'static str;

    fn try_from(k: KeyFields) -> Result<Key, Self::Error> {
        let goal = match (k.pose, k.q) {
            (Some(pose), None) => Goal::Pose(pose),
            (None, Some(q)) => Goal::Q(q),
            (None, None) if !k.reach.is_empty() => Goal::Open,
            (None, None) => return Err("a key needs `pose`, `q` or `reach`"),
            _ => return Err("a key needs either `pose` or `q`, not both"),
        };
        let hold = k.hold.unwrap_or(1);
        let (reach, fill, tangents, note) = (k.reach, k.fill, k.tangents, k.note);
        Ok(Key { frame: k.frame, goal, reach, hold, fill, tangents, note })
    }
}

impl From<Key> for KeyFields {
    fn from(k: Key) -> KeyFields {
        let (pose, q) = match k.goal {
            Goal::Pose(pose) => (Some(pose), None),
            Goal::Q(q) => (None, Some(q)),
            Goal::Open => (None, None),
        };
        let hold = (k.hold != 1).then_some(k.hold);
        let (reach, fill, tangents, note) = (k.reach, k.fill, k.tangents, k.note);
        KeyFields { frame: k.frame, pose, q, reach, hold, fill, tangents, note }
    }
}

/// The state before frame 0: held for the whole pre-roll.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Start {
    /// A named pose of this clip (a complete one).
    Pose(String),
    /// One value per joint.
    Q(Vec<f64>),
}

/// Frames without a goal, regardless of keys and fills: `[from, to)`.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mask {
    /// First masked frame.
    pub from: u32,
    /// First frame after it.
    pub to: u32,
    /// The joints concerned, in the clip's order; `None` = all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joints: Option<Vec<String>>,
}

/// A named moment, or a named block of frames.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Marker {
    /// The frame of the marker.
    pub frame: u32,
    /// Its name.
    pub name: String,
    /// First frame after it; makes it a block, which can be moved and repeated as a whole.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub to: Option<u32>,
}

/// An animation document, `robert-clip/1`.
///
/// ```
/// use robert_clip::{Clip, Key, RobotRef, compile};
///
/// let joints = vec!["x".to_owned(), "y".to_owned()];
/// let robot = RobotRef { id: "pointmass".to_owned(), joints, ..RobotRef::default() };
/// let mut clip = Clip::new(robot, 41);
/// clip.keys = vec![Key::new(0, &[0.0, 0.0]), Key::new(40, &[0.3, -0.1])];
/// // Between the two keys lie 39 masked frames, more than a policy looks ahead.
/// assert!(!compile(&clip)?.blind_spans().is_empty());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Clip {
    /// A title.
    pub name: String,
    /// Remarks.
    pub notes: String,
    /// The robot it is for.
    pub robot: RobotRef,
    /// Frames in the clip: 0..length.
    pub length: u32,
    /// The fill after keys without their own.
    pub fill: Fill,
    /// The state before frame 0; `None` = the values of the first key.
    pub start: Option<Start>,
    /// Named poses.
    pub poses: BTreeMap<String, Row>,
    /// Keyframes, by frame, at most one per frame.
    pub keys: Vec<Key>,
    /// Values that are added to the command of the keys, by frame, at most one offset per frame.
    pub offsets: Vec<Offset>,
    /// Mask spans.
    pub masks: Vec<Mask>,
    /// Markers, by frame, at most one per frame.
    pub markers: Vec<Marker>,
    /// Extensions of other programs; kept, never read.
    pub x: Map<String, Value>,
}

impl Clip {
    /// An empty clip of `length` frames.
    pub fn new(robot: RobotRef, length: u32) -> Clip {
        Clip {
            name: String::new(),
            notes: String::new(),
            robot,
            length,
            fill: Fill::Mask,
            start: None,
            poses: BTreeMap::new(),
            keys: Vec::new(),
            offsets: Vec::new(),
            masks: Vec::new(),
            markers: Vec::new(),
            x: Map::new(),
        }
    }

    /// Joints of a row.
    pub fn dim(&self) -> usize {
        self.robot.joints.len()
    }

    /// Length in seconds.
    pub fn secs(&self) -> f64 {
        f64::from(self.length) / f64::from(FPS)
    }

    /// Position of a joint in the rows.
    pub fn joint(&self, name: &str) -> Option<usize> {
        self.robot.joints.iter().position(|j| j == name)
    }

    /// Index in [`Clip::keys`] of the key at this frame.
    pub fn key_index(&self, frame: u32) -> Option<usize> {
        self.keys.binary_search_by_key(&frame, |k| k.frame).ok()
    }

    /// The key at this frame.
    pub fn key(&self, frame: u32) -> Option<&Key> {
        self.key_index(frame).and_then(|i| self.keys.get(i))
    }

    /// The values of a key in the document: its own, or those of its pose; `None` if only its
    /// end-effector goals decide.
    pub fn row<'a>(&'a self, key: &'a Key) -> Option<&'a Row> {
        match &key.goal {
            Goal::Q(q) => Some(q),
            Goal::Pose(name) => self.poses.get(name),
            Goal::Open => None,
        }
    }

    /// The fill after this key.
    pub fn fill_after(&self, key: &Key) -> Fill {
        key.fill.unwrap_or(self.fill)
    }

    /// Whether a key has a value for a joint, as far as the document says. A key without values of its own has
    /// those that its end-effector goals lead to.
    pub(crate) fn gives(&self, key: &Key, joint: usize) -> bool {
        key.goal == Goal::Open
            || self.row(key).is_some_and(|row| row.get(joint).is_some_and(Option::is_some))
    }

    /// First frame after the hold of key `index`, if no other key ends it.
    pub(super) fn full_hold(&self, index: usize) -> u32 {
        let Some(key) = self.keys.get(index) else { return 0 };
        key.frame.saturating_add(key.hold.max(1)).min(self.length)
    }

    /// First frame at which the hold of key `index` no longer commands any joint. The next key with a value for
    /// a joint ends the hold of this joint.
    pub fn hold_end(&self, index: usize) -> u32 {
        let full = self.full_hold(index);
        let Some((key, later)) = self.keys.get(index..).and_then(<[Key]>::split_first) else {
            return full;
        };
        let mut later = later.iter().take_while(|k| k.frame < full).peekable();
        if later.peek().is_none() {
            return full;
        }
        let mut held: Vec<usize> = (0..self.dim()).filter(|j| self.gives(key, *j)).collect();
        for next in later {
            held.retain(|j| !self.gives(next, *j));
            if held.is_empty() {
                return next.frame;
            }
        }
        full
    }

    /// Sorts, and rounds every value to the grid.
    pub fn normalize(&mut self) {
        let grid = |row: &mut Row| {
            row.iter_mut().flatten().for_each(|v| *v = round(*v));
        };
        self.keys.sort_by_key(|k| k.frame);
        self.offsets.sort_by_key(|o| o.frame);
        self.offsets.iter_mut().for_each(Offset::normal);
        self.masks.sort();
        self.masks.dedup();
        self.markers.sort();
        for key in &mut self.keys {
            if let Goal::Q(row) = &mut key.goal {
                grid(row);
            }
            key.reach = std::mem::take(&mut key.reach).into_iter().map(Reach::normal).collect();
            key.tangents.values_mut().for_each(|t| *t = t.normal());
        }
        self.poses.values_mut().for_each(grid);
        if let Some(Start::Q(q)) = &mut self.start {
            for v in q {
                *v = round(*v);
            }
        }
        if let Some(sha) = &mut self.robot.model_sha256 {
            sha.make_ascii_lowercase();
        }
    }
}
