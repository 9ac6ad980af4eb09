//! Messages between the studio and its worker process.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_bytes::ByteBuf;

use crate::protocol::{
    DrawAnswer, Geometry, IkAnswer, IkRequest, MeanError, RobotFacts, SettleAnswer,
};
use robert_base::exit::{Exit, HasExit};
use robert_clip::Command;
use robert_rollout::{Choice, PolicyConfig, Precision, Stage};

/// A question to the worker. Its type determines the type of the answer.
pub(crate) trait Question: Into<WorkerRequest> {
    /// The type of the worker's answer.
    type Answer: Serialize + DeserializeOwned + Send + 'static;
}

/// Parent → child.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Envelope {
    /// Comes back with the answer.
    pub(super) id: u64,
    /// The request.
    pub(super) request: WorkerRequest,
}

/// Declares the requests, and the question type of each.
macro_rules! requests {
    ($($(#[$doc:meta])* $name:ident => $answer:ty;)*) => {
        /// A request to the child.
        #[derive(Clone, Debug, Serialize, Deserialize)]
        pub(crate) enum WorkerRequest {
            $($(#[$doc])* $name(Box<$name>),)*
        }

        $(impl From<$name> for WorkerRequest {
            fn from(question: $name) -> WorkerRequest {
                WorkerRequest::$name(Box::new(question))
            }
        }

        impl Question for $name {
            type Answer = $answer;
        })*
    };
}

requests! {
    /// Asks whether the child is alive; answered even during simulation.
    Ping => ();
    /// The robot of what follows.
    LoadRobot => RobotFacts;
    /// Sets policy, guide and options of rollouts.
    SetPolicy => ();
    /// A rollout.
    Perform => ();
    /// No rollout any more.
    Stop => ();
    /// Body transforms of poses.
    Kinematics => Vec<Vec<f32>>;
    /// Inverse kinematics.
    IkRequest => IkAnswer;
    /// Keys of a drawn line.
    Trace => DrawAnswer;
    /// Settles a pose in simulation.
    Settle => SettleAnswer;
    /// Checks poses for lints.
    CheckPoses => Vec<Checked>;
    /// Facts about any robot.
    DescribeRobot => RobotFacts;
    /// The geometry of any robot.
    LookAtRobot => Geometry;
    /// A picture.
    PaintRequest => Picture;
    /// The body that a picture would show at a point.
    PickRequest => Option<String>;
}

impl WorkerRequest {
    /// Whether the answer may take long, so that frames must not wait for it.
    pub(super) fn is_slow(&self) -> bool {
        matches!(
            self,
            WorkerRequest::Settle(_)
                | WorkerRequest::CheckPoses(_)
                | WorkerRequest::DescribeRobot(_)
                | WorkerRequest::LookAtRobot(_)
                | WorkerRequest::PaintRequest(_)
                | WorkerRequest::PickRequest(_)
        )
    }
}

/// Are you alive?
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Ping;

/// Makes this the robot of what follows.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct LoadRobot {
    /// Builtin id or folder.
    pub(crate) robot: String,
}

/// Policy, guide and options of rollouts.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct SetPolicy {
    /// The policy.
    pub(crate) policy: PolicyConfig,
    /// Seed of its draws.
    pub(crate) seed: u64,
}

/// Performs a clip, from the first frame that can differ from the last one. The frames come as
/// [`SimulationEvent`]s; there is no answer.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Perform {
    /// Number of the rollout.
    pub(crate) generation: u64,
    /// With the policy `auto`: whether all contenders perform, or only the one that was best last
    /// time.
    pub(crate) compare: bool,
    /// The clip.
    pub(crate) command: Dense,
}

/// Stops performing; frames so far stay.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Stop;

/// Body transforms of poses of the current robot: by pose, (nbody, 7) position and quaternion
/// w x y z.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Kinematics {
    /// One value per state joint each.
    pub(crate) poses: Vec<Vec<f64>>,
}

/// A drawn line that a site should follow.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Trace {
    /// The pose at which the line begins, one value per state joint.
    pub(crate) q: Vec<f64>,
    /// The site.
    pub(crate) site: String,
    /// Points of the line: x, y, z in m, and seconds.
    pub(crate) line: Vec<[f64; 4]>,
    /// The duration of the whole line at constant speed, s.
    pub(crate) secs: Option<f64>,
    /// Allowed distance between path and line, m.
    pub(crate) tolerance_m: f64,
    /// The highest speed of each state joint, rad/s or m/s.
    pub(crate) speeds: Vec<Option<f64>>,
    /// Joints that must stay.
    pub(crate) locked: Vec<String>,
}

/// Asks for the pose that settles from `q`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Settle {
    /// Builtin id or folder.
    pub(crate) robot: String,
    /// One value per state joint.
    pub(crate) q: Vec<f64>,
}

/// Contacts and residuals of poses, for lints.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct CheckPoses {
    /// Builtin id or folder.
    pub(crate) robot: String,
    /// One value per state joint each.
    pub(crate) poses: Vec<Vec<f64>>,
}

/// Facts about any robot.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct DescribeRobot {
    /// Builtin id or folder.
    pub(crate) robot: String,
}

/// Asks for the geometry of any robot.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct LookAtRobot {
    /// Builtin id or folder.
    pub(crate) robot: String,
}

/// A picture to paint.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct PaintRequest {
    /// Builtin id or folder.
    pub(crate) robot: String,
    /// The motion or pose in the picture.
    pub(crate) subject: Subject,
    /// The frame; the last one when there are fewer.
    pub(crate) frame: usize,
    /// Pixels a row.
    pub(crate) width: u32,
    /// Rows.
    pub(crate) height: u32,
    /// The overlay, as [`robert_render::Overlay::parse`] reads it.
    pub(crate) overlay: String,
    /// Fast and less smooth.
    pub(crate) draft: bool,
}

/// The body that a picture would show at a point.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct PickRequest {
    /// The picture.
    pub(crate) picture: PaintRequest,
    /// The point, -1 to 1, y up.
    pub(crate) at: [f32; 2],
}

/// The subject of a picture.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) enum Subject {
    /// A pose; one value per state joint.
    Pose(Vec<f64>),
    /// A motion. Motions with the same stamp are equal, so the camera is not fitted to them again.
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

/// A motion as [`robert_render::Motion`] takes it, rows in state order.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct MotionRows {
    /// Title.
    pub(crate) name: String,
    /// The policy; `None` if these frames are not simulated.
    pub(crate) performer: Option<String>,
    /// NaN = no goal; (frames, S).
    pub(crate) commanded: Vec<Vec<f32>>,
    /// (frames, S).
    pub(crate) achieved: Vec<Vec<f32>>,
    /// Frames of the keys.
    pub(crate) keys: Vec<usize>,
}

/// A compiled clip for the child.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Dense {
    /// Joint names, the order of the rows.
    pub(crate) joints: Vec<String>,
    /// State before frame 0; (dim).
    pub(crate) start: Vec<f32>,
    /// (frames, dim).
    pub(crate) q: Vec<f32>,
    /// (frames, dim).
    pub(crate) visible: Vec<bool>,
}

impl Dense {
    /// A command's rows.
    pub(crate) fn of(command: &Command) -> Dense {
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
pub(super) enum WorkerMessage {
    /// The answer to the request of this number, as [`Question::Answer`] is written.
    Answer(u64, ByteBuf),
    /// The request of this number cannot be carried out.
    Refused(u64, Refusal),
    /// An event that no request asked for.
    Event(SimulationEvent),
}

/// A refusal: the reason lies in the robot or the file.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Refusal {
    /// The sentence that the command line prints.
    pub(super) message: String,
    /// Its class.
    pub(super) exit: u8,
}

impl Refusal {
    /// A refusal of a request that makes no sense.
    pub(super) fn invalid(message: impl Into<String>) -> Refusal {
        Refusal { message: message.into(), exit: Exit::Invalid.code() }
    }
}

impl<E: HasExit> From<E> for Refusal {
    fn from(e: E) -> Refusal {
        Refusal { message: e.to_string(), exit: e.exit().code() }
    }
}

/// Events of a rollout.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) enum SimulationEvent {
    /// A rollout begins.
    Started {
        /// The number of the rollout.
        generation: u64,
        /// Frames up to this one stand.
        resumed_at: usize,
    },
    /// Simulated frames.
    Frames(Frames),
    /// All frames are there, and the motion is being improved.
    Improving {
        /// The number of the rollout.
        generation: u64,
        /// How.
        stage: Stage,
    },
    /// A rollout ended.
    Ended {
        /// The number of the rollout.
        generation: u64,
        /// Full figures, when it reached the end.
        precision: Option<Box<Precision>>,
        /// The chosen policy, if several were compared.
        choice: Option<Box<Choice>>,
        /// Why it broke, when it did.
        error: Option<String>,
    },
}

/// A run of simulated frames.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Frames {
    /// The number of the rollout.
    pub(crate) generation: u64,
    /// First frame.
    pub(crate) from: usize,
    /// Achieved states by frame.
    pub(crate) q: Vec<Vec<f32>>,
    /// Mean absolute error by frame, rad or m; `None` where masked.
    pub(crate) error: Vec<Option<f64>>,
    /// Body transforms by frame; (nbody, 7) position and quaternion w x y z.
    pub(crate) bodies: Vec<Vec<f32>>,
    /// Body transforms of the command by frame, interpolated where masked; (nbody, 7) position and
    /// quaternion w x y z.
    pub(crate) goal_bodies: Vec<Vec<f32>>,
    /// Time that the simulation and the policy took, seconds in all.
    pub(crate) secs: f64,
}

/// The simulation's findings about a pose.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Checked {
    /// Bodies that touch, with the depth in metres.
    pub(crate) contacts: Vec<(String, String, f64)>,
    /// The settled pose; (state).
    pub(crate) settled: Option<Vec<f64>>,
}

/// A painted picture.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Picture {
    /// The file.
    #[serde(with = "serde_bytes")]
    pub(crate) jpeg: Vec<u8>,
    /// The mean error of the performance.
    pub(crate) error: Option<MeanError>,
}
