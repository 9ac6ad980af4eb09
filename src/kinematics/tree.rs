//! The tree of bodies: names, fixed frames, joints, sites.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A robot as its geometry: bodies on hinges and slides.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Kinematics {
    /// Bodies, the world first; every body comes after its parent.
    pub links: Vec<LinkFrame>,
    /// Joints, in state order.
    pub joints: Vec<JointAxis>,
    /// Named points of bodies.
    pub sites: Vec<SiteFrame>,
    /// Where bodies are held together, so that the tree has closed loops.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub closures: Vec<Closure>,
    /// Joints that one tendon pulls. As far as inverse kinematics is concerned q / factor is the same for all of
    /// them, as if they were equally stiff; contact may set them apart.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tendons: Vec<Vec<Share>>,
}

/// A body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LinkFrame {
    /// Its name; may be empty.
    pub name: String,
    /// Index of its parent; 0 for the world itself.
    pub parent: usize,
    /// Position in its parent's frame with all joints at their reference, m.
    pub pos: [f64; 3],
    /// Orientation there, w x y z.
    pub quat: [f64; 4],
    /// Its joints in the order in which they act.
    pub joints: Vec<usize>,
}

/// The motion that a joint allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum JointMotion {
    /// Turns its body about the axis.
    Hinge,
    /// Shifts its body along the axis.
    Slide,
}

/// A joint of a body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct JointAxis {
    /// The motion that it allows.
    pub motion: JointMotion,
    /// A point of the axis in the body's frame, m.
    pub pos: [f64; 3],
    /// The direction of the axis in the body's frame; length 1.
    pub axis: [f64; 3],
    /// The joint value at which the body is placed as [`LinkFrame`] says, rad or m.
    pub reference: f64,
    /// Lowest and highest value, rad or m; `None` = unbounded.
    pub range: Option<[f64; 2]>,
    /// The joint that it follows without a motor of its own.
    pub follows: Option<Follow>,
}

/// The coupling of a joint to another: q = offset + multiplier * q of the leader.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Follow {
    /// Index of the leader.
    pub leader: usize,
    /// Added, rad or m.
    pub offset: f64,
    /// Factor.
    pub multiplier: f64,
}

/// A joint on a tendon.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Share {
    /// Index of the joint.
    pub joint: usize,
    /// Its factor; not 0.
    pub factor: f64,
}

/// A named point of a body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SiteFrame {
    /// Its name.
    pub name: String,
    /// Index of its body.
    pub link: usize,
    /// Position in the body's frame, m.
    pub pos: [f64; 3],
    /// Orientation in the body's frame, w x y z.
    pub quat: [f64; 4],
}

/// Two points that a constraint holds together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Closure {
    /// The points.
    pub ends: [Anchor; 2],
    /// Whether their orientations are the same, too.
    pub turns: bool,
}

/// A frame that is fixed to a body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Anchor {
    /// Index of the body.
    pub link: usize,
    /// Position in the body's frame, m.
    pub pos: [f64; 3],
    /// Orientation in the body's frame, w x y z.
    pub quat: [f64; 4],
}

/// A point that can be moved.
#[derive(Clone, Debug, PartialEq)]
pub enum Point {
    /// A site, by name.
    Site(String),
    /// A point fixed in a body's frame, m.
    Body {
        /// The body's name.
        body: String,
        /// The point in its frame, m.
        offset: [f64; 3],
    },
}

impl Point {
    /// Its site, or its body.
    pub fn name(&self) -> &str {
        match self {
            Point::Site(name) | Point::Body { body: name, .. } => name,
        }
    }
}
