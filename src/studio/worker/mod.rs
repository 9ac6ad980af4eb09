//! The simulation in a process of its own.
//!
//! A segmentation fault, an allocation that aborts, an endless loop: none of them can be
//! caught inside a process, and models are foreign files. So everything that touches the simulator
//! runs in a child of the same binary (`robert __worker`), under limits that it sets itself.
//! The parent owns the document and the journal; the child owns nothing that matters.
//!
//! Rejected: threads with `catch_unwind` (catches none of the above) and a crate for
//! sandboxes (the child is our own code; what it needs is limits, not a jail).
//!
//! `mod.rs` is the vocabulary, `codec.rs` the framing, `child.rs` what runs in the child,
//! `parent.rs` the supervisor. Pictures are painted in a second child of the same kind
//! (`paint.rs`), so that neither a graphics driver nor its memory is felt by the simulation.

pub mod child;
mod codec;
mod paint;
pub mod parent;
mod query;

pub use parent::{WorkerHandle, WorkerSink};

use serde::{Deserialize, Serialize};

use crate::clip::{Command, JointTable};
use crate::exit::Exit;
use crate::robot::{Camera, Group};
use crate::rollout::{Offer, PolicyConfig};
use crate::units::Unit;

/// Parent → child.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Ask {
    /// Comes back in the reply; 0 wants none.
    pub id: u64,
    /// What.
    pub request: Request,
}

/// What the child is asked for.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum Request {
    /// Are you alive? Answered even while simulating.
    Ping,
    /// Makes this the robot of what follows.
    Robot {
        /// Builtin id or folder.
        robot: String,
    },
    /// How to roll out.
    Policy {
        /// The policy.
        policy: PolicyConfig,
        /// Seed of its draws.
        seed: u64,
    },
    /// Performs a clip, from the first frame that can differ from the last one. Streams
    /// [`Report::Started`], [`Report::Frames`] and [`Report::Ended`].
    Perform {
        /// Number of the rollout.
        generation: u64,
        /// The clip.
        command: Dense,
    },
    /// Stops performing; frames so far stay.
    Stop,
    /// Body transforms of poses of the current robot.
    Kinematics {
        /// One value per state joint each.
        poses: Vec<Vec<f64>>,
    },
    /// Inverse kinematics on the current robot.
    Ik(super::protocol::IkRequest),
    /// Where a pose comes to rest.
    Settle {
        /// Builtin id or folder.
        robot: String,
        /// One value per state joint.
        q: Vec<f64>,
    },
    /// Contacts and residuals of poses, for lints.
    Check {
        /// Builtin id or folder.
        robot: String,
        /// One value per state joint each.
        poses: Vec<Vec<f64>>,
    },
    /// Facts about any robot.
    Facts {
        /// Builtin id or folder.
        robot: String,
    },
    /// What any robot looks like.
    Geometry {
        /// Builtin id or folder.
        robot: String,
    },
    /// A picture.
    Paint(Box<PaintRequest>),
    /// The body that a picture would show at a point (-1 to 1, y up).
    Pick(Box<PaintRequest>, [f32; 2]),
}

/// A picture to paint.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct PaintRequest {
    /// Builtin id or folder.
    pub robot: String,
    /// What is seen.
    pub subject: Subject,
    /// The frame; the last one when there are fewer.
    pub frame: usize,
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// What is laid over, as [`crate::render::Overlay::parse`] reads it.
    pub overlay: String,
    /// Fast and less smooth.
    pub draft: bool,
}

/// What a picture shows.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum Subject {
    /// A pose; one value per state joint.
    Pose(Vec<f64>),
    /// A motion. What has the same stamp is the same motion, and is not looked through again.
    Motion {
        /// See above.
        stamp: u64,
        /// It.
        motion: Box<MotionRows>,
    },
    /// A clip, to be performed first, by the robot's default policy.
    Clip {
        /// Title.
        name: String,
        /// The clip.
        command: Dense,
        /// Frames of its keys.
        keys: Vec<usize>,
    },
}

/// A motion as [`crate::render::Motion`] takes it, rows in state order.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct MotionRows {
    /// Title.
    pub name: String,
    /// Who performed it.
    pub performer: String,
    /// NaN = no goal; (frames, S).
    pub commanded: Vec<Vec<f32>>,
    /// (frames, S).
    pub achieved: Vec<Vec<f32>>,
    /// Frames of the keys.
    pub keys: Vec<usize>,
}

impl Request {
    /// Whether it may take long and must not stand in the way of frames.
    pub fn is_slow(&self) -> bool {
        matches!(
            self,
            Request::Settle { .. }
                | Request::Check { .. }
                | Request::Facts { .. }
                | Request::Geometry { .. }
                | Request::Paint(_)
                | Request::Pick(..)
        )
    }
}

/// A compiled clip on its way to the child.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Dense {
    /// Joint names, the order of the rows.
    pub joints: Vec<String>,
    /// State before frame 0; (dim).
    pub start: Vec<f32>,
    /// (frames, dim).
    pub q: Vec<f32>,
    /// (frames, dim).
    pub visible: Vec<bool>,
}

impl Dense {
    /// A command's rows.
    pub fn of(command: &Command) -> Dense {
        let dim = command.dim();
        let visible =
            (0..command.frames()).flat_map(|f| (0..dim).map(move |j| command.sees(f, j))).collect();
        Dense {
            joints: command.joints().to_vec(),
            start: command.start().to_vec(),
            q: command.q().to_vec(),
            visible,
        }
    }
}

/// Child → parent.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Answer {
    /// The request; 0 for what nobody asked for.
    pub id: u64,
    /// What.
    pub report: Report,
}

/// What the child says.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum Report {
    /// Alive.
    Pong,
    /// Done.
    Ok,
    /// It cannot be; the robot or the file is at fault.
    Refused {
        /// The sentence that the command line prints.
        message: String,
        /// Its class.
        exit: u8,
    },
    /// A rollout begins.
    Started {
        /// Which.
        generation: u64,
        /// Frames up to this one stand.
        resumed_at: usize,
    },
    /// Simulated frames.
    Frames(Frames),
    /// A rollout ended.
    Ended {
        /// Which.
        generation: u64,
        /// Full figures ([`crate::rollout::Precision`]) when it reached the end.
        precision: Option<Box<crate::rollout::Precision>>,
        /// Why it broke, when it did.
        error: Option<String>,
    },
    /// Answer to [`Request::Kinematics`]: by pose, (nbody, 7) position and quaternion w x y z.
    Bodies(Vec<Vec<f32>>),
    /// Answer to [`Request::Ik`].
    Ik(IkAnswer),
    /// Answer to [`Request::Settle`].
    Settled(SettleAnswer),
    /// Answer to [`Request::Check`], by pose.
    Checked(Vec<Checked>),
    /// Answer to [`Request::Robot`] and [`Request::Facts`].
    Facts(Box<RobotFacts>),
    /// Answer to [`Request::Geometry`].
    Geometry(Box<Geometry>),
    /// Answer to [`Request::Pick`].
    Picked(Option<String>),
    /// Answer to [`Request::Paint`].
    Picture {
        /// The file.
        #[serde(with = "serde_bytes")]
        jpeg: Vec<u8>,
        /// Mean error of what was performed for it.
        error: Option<MeanError>,
    },
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

/// A run of simulated frames.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Frames {
    /// Which rollout.
    pub generation: u64,
    /// First frame.
    pub from: usize,
    /// Achieved states by frame.
    pub q: Vec<Vec<f32>>,
    /// Mean absolute error by frame, rad or m; `None` where masked.
    pub error: Vec<Option<f64>>,
    /// Body transforms by frame; (nbody, 7) position and quaternion w x y z.
    pub bodies: Vec<Vec<f32>>,
    /// The same of the command, interpolated where masked.
    pub goal_bodies: Vec<Vec<f32>>,
    /// Actions that led here, by frame, -1..1.
    pub action: Vec<Vec<f32>>,
    /// Time that the simulation and the policy took, seconds in all.
    pub secs: f64,
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

/// What simulation says about a pose.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Checked {
    /// Bodies that touch, with the depth in metres.
    pub contacts: Vec<(String, String, f64)>,
    /// Where it settles; (state).
    pub settled: Option<Vec<f64>>,
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

/// The simulation as a banner shows it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct WorkerState {
    /// `starting`, `ready`, `restarting`, `stopped`.
    pub phase: WorkerPhase,
    /// Its process.
    pub pid: Option<u32>,
    /// Times that it died in this run.
    pub deaths: u32,
    /// Why it died last.
    pub reason: Option<String>,
}

/// Phases of the worker.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum WorkerPhase {
    /// Not up yet, or not needed at the moment.
    #[default]
    Starting,
    /// Up.
    Ready,
    /// It died; a new one comes.
    Restarting,
    /// It died too often; someone must ask for another.
    Stopped,
}

/// The exit class of a code that came over the wire.
pub(super) fn exit_of(code: u8) -> Exit {
    match code {
        2 => Exit::Usage,
        3 => Exit::Invalid,
        4 => Exit::Threshold,
        5 => Exit::Missing,
        130 => Exit::Interrupted,
        _ => Exit::Failed,
    }
}
