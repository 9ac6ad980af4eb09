//! Facts about a robot, and what can be asked about its poses.

use serde::{Deserialize, Serialize};

use robert_base::units::Unit;
use robert_clip::JointTable;
use robert_robot::{Camera, Group};
use robert_rollout::Offer;

/// One robot, in short.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RobotCard {
    /// Identifier.
    pub id: String,
    /// What it is loaded by: its id, or its folder.
    pub source: String,
    /// Whether it comes with the program.
    pub builtin: bool,
    /// Names of the trained models that it has.
    pub models: Vec<String>,
}

/// A named pose of a robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct PoseFacts {
    /// Its name.
    pub name: String,
    /// One value per state joint.
    pub q: Vec<f64>,
}

/// A body of a robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct BodyFacts {
    /// Its name.
    pub name: String,
    /// Its parent; 0 is the world.
    pub parent: usize,
    /// State joints that move it against its parent.
    pub joints: Vec<usize>,
}

/// Where a joint acts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct AxisFacts {
    /// The body that it moves.
    pub body: usize,
    /// A point on the axis, in the body's frame, m.
    pub pos: [f64; 3],
    /// Direction, in the body's frame.
    pub axis: [f64; 3],
}

/// A point that can be pulled.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct SiteFacts {
    /// Its name.
    pub name: String,
    /// Its body.
    pub body: usize,
    /// Position in the body's frame, m.
    pub pos: [f64; 3],
}

/// What a page needs to know about a robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RobotFacts {
    /// Identifier.
    pub id: String,
    /// What it is loaded by: its id, or its folder.
    pub source: String,
    /// Name for people.
    pub title: String,
    /// A sentence or two.
    pub about: String,
    /// Origin and terms.
    pub licence: String,
    /// Joints, limits, mirror, couplings: what clips need.
    pub table: JointTable,
    /// Fingers, limbs.
    pub groups: Vec<Group>,
    /// Actuator names.
    pub actuators: Vec<String>,
    /// Named poses, the home pose first.
    pub poses: Vec<PoseFacts>,
    /// Sites that can be dragged by inverse kinematics.
    pub ik_sites: Vec<SiteFacts>,
    /// Axes of the state joints.
    pub axes: Vec<AxisFacts>,
    /// Default view.
    pub camera: Camera,
    /// Bodies, the world first.
    pub bodies: Vec<BodyFacts>,
    /// Residual above which a pose counts as not reached, rad or m.
    pub settle_tolerance: f64,
    /// Policies that can perform it.
    pub offers: Vec<Offer>,
}

/// All that is seen of one body in one colour.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct MeshFacts {
    /// Its body, 0 = the world.
    pub body: usize,
    /// sRGB and opacity, 0 to 1.
    pub rgba: [f32; 4],
    /// Corners in the body's frame, x y z each, m.
    pub vertices: Vec<f32>,
    /// Three indices each, counter-clockwise from outside.
    pub faces: Vec<u32>,
}

/// What a robot looks like.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Geometry {
    /// The robot.
    pub robot: String,
    /// Body names, the world first.
    pub bodies: Vec<String>,
    /// Meshes, in order of bodies.
    pub meshes: Vec<MeshFacts>,
    /// Body transforms in the home pose; (nbody, 7) position and quaternion w x y z.
    pub home: Vec<f32>,
}

/// Body of `POST /api/ik`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct IkRequest {
    /// Where to start, one value per state joint.
    pub q: Vec<f64>,
    /// The site that is pulled.
    #[serde(default)]
    pub site: String,
    /// In its place: a body by name, and a point in its frame, m.
    #[serde(default)]
    pub body: Option<(String, [f64; 3])>,
    /// Where to, world, m.
    pub pos: [f64; 3],
    /// Orientation, w x y z; absent = free.
    #[serde(default)]
    pub quat: Option<[f64; 4]>,
    /// Joints that must stay.
    #[serde(default)]
    pub locked: Vec<String>,
}

/// What inverse kinematics found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct IkAnswer {
    /// One value per state joint, inside the limits.
    pub q: Vec<f64>,
    /// Distance left, m.
    pub distance_m: f64,
    /// Whether the target was reached.
    pub reached: bool,
}

/// Where a pose comes to rest when the robot is driven there.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct SettleAnswer {
    /// One value per state joint.
    pub q: Vec<f64>,
    /// Distance from what was asked for, by joint.
    pub residual: Vec<f64>,
    /// The greatest, and its joint.
    pub worst: f64,
    /// Index of the joint that has it.
    pub worst_joint: usize,
    /// Whether all are within the robot's tolerance.
    pub within: bool,
}

/// How near a performance came.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct MeanError {
    /// Mean absolute error over unmasked frames and joints.
    pub value: f64,
    /// rad or m.
    pub unit: Unit,
}

/// What is under a pointer.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Hovered {
    /// The body.
    pub body: String,
    /// The joint that moves it, if one does.
    pub joint: Option<String>,
}
