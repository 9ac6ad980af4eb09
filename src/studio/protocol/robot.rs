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
    /// The source that it is loaded from: its id, or its folder.
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

/// The position and the axis of a joint.
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
    /// Orientation in the body's frame, w x y z.
    pub quat: [f64; 4],
}

/// The facts about a robot that a page needs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RobotFacts {
    /// Identifier.
    pub id: String,
    /// The source that it is loaded from: its id, or its folder.
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
    /// Distance above which a pose counts as not reached, rad or m.
    pub settle_tolerance: f64,
    /// Policies that can perform it.
    pub offers: Vec<Offer>,
}

/// The visible parts of one body in one colour.
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

/// The shape of a robot.
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
    /// The pose at which the search starts, one value per state joint.
    pub q: Vec<f64>,
    /// The site that is pulled.
    #[serde(default)]
    pub site: String,
    /// Instead of a site: a body by name, and a point in its frame, m.
    #[serde(default)]
    pub body: Option<(String, [f64; 3])>,
    /// The target of the point in the world, m; if it is absent, only the pins count.
    #[serde(default)]
    pub pos: Option<[f64; 3]>,
    /// Orientation, w x y z; absent = free.
    #[serde(default)]
    pub quat: Option<[f64; 4]>,
    /// Joints that must stay.
    #[serde(default)]
    pub locked: Vec<String>,
    /// Sites that are held meanwhile.
    #[serde(default)]
    pub pins: Vec<Pin>,
}

/// A site that inverse kinematics keeps in place, or at another site.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Pin {
    /// The site.
    pub site: String,
    /// The place where the point stays, in the world, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pos: Option<[f64; 3]>,
    /// The orientation of the point there, w x y z; free if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quat: Option<[f64; 4]>,
    /// Instead of both: the site that it touches.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub to: Option<String>,
}

/// The result of inverse kinematics.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct IkAnswer {
    /// One value per state joint, inside the limits.
    pub q: Vec<f64>,
    /// Distance left to the target, m; 0 if there is no target.
    pub distance_m: f64,
    /// Whether the target was reached and every pin is met.
    pub reached: bool,
    /// Distance left by pin, m.
    pub pins_m: Vec<f64>,
    /// Bodies that touch in the pose, and the depth, m; the deepest first.
    pub contacts: Vec<(String, String, f64)>,
}

/// Body of `POST /api/draw`: a line that a person drew over a page's 3D view.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct DrawRequest {
    /// The page.
    pub tab: String,
    /// The pose at which the line begins, one value per state joint.
    pub q: Vec<f64>,
    /// The site that goes along the line.
    pub site: String,
    /// The plane in which the line is drawn.
    pub plane: Plane,
    /// Points of the picture, 0 to 1 from the top left corner, with the time at which each was
    /// drawn, s.
    pub points: Vec<[f64; 3]>,
    /// The duration of the whole line at constant speed, s; if absent, as long as the drawing took.
    #[serde(default)]
    pub secs: Option<f64>,
    /// Allowed distance between path and line, m.
    pub tolerance_m: f64,
    /// Joints that must stay.
    #[serde(default)]
    pub locked: Vec<String>,
}

/// A plane to draw on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum Plane {
    /// The ground, z = 0.
    Ground,
    /// Level, through the site.
    Level,
    /// Through the site, facing the camera.
    View,
}

/// The path that follows a drawn line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct DrawAnswer {
    /// Keys, joined by straight lines; frames count from the beginning of the line.
    pub keys: Vec<DrawnKey>,
    /// Frames until the last key ends.
    pub frames: u32,
    /// The largest distance between site and line where the line leaves the robot's reach, m.
    pub off_m: f64,
    /// The line in the world, m.
    pub line: Vec<[f64; 3]>,
}

/// A key of a drawn line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct DrawnKey {
    /// Frames after the line was begun.
    pub frame: u32,
    /// Frames that it is held.
    pub hold: u32,
    /// One value per state joint.
    pub q: Vec<f64>,
}

/// The pose that the robot reaches when it is driven to a pose and comes to rest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct SettleAnswer {
    /// One value per state joint.
    pub q: Vec<f64>,
    /// The distance from the requested pose, by joint.
    pub residual: Vec<f64>,
    /// The greatest, and its joint.
    pub worst: f64,
    /// Index of the joint that has it.
    pub worst_joint: usize,
    /// Whether all are within the robot's tolerance.
    pub within: bool,
}

/// The errors of a performance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct MeanError {
    /// Mean absolute error over unmasked frames and joints.
    pub value: f64,
    /// rad or m.
    pub unit: Unit,
}

/// The part of the robot that is under a pointer.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Hovered {
    /// The body.
    pub body: String,
    /// The joint that moves it, if one does.
    pub joint: Option<String>,
}
