//! Findings, and the interface that checks poses by simulation.

use serde::Serialize;

use crate::op::Op;

/// Severity of a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
#[derive(schemars::JsonSchema)]
pub enum Level {
    /// Worth knowing.
    Info,
    /// The motion will differ from the clip.
    Warning,
    /// The command cannot be performed by this robot or policy.
    Error,
}

/// Kinds of findings. The words are stable, so scripts may filter by them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
#[derive(schemars::JsonSchema)]
pub enum Rule {
    /// Made for another robot, or another version of its model.
    OtherRobot,
    /// A joint the robot does not have, or one that the clip lacks.
    UnknownJoint,
    /// A unit that differs from the robot's.
    Unit,
    /// A value outside the joint's range.
    JointLimit,
    /// A joint would have to move faster than it can.
    JointSpeed,
    /// The policy sees no goal.
    BlindSpan,
    /// Joints of one actuator that cannot be set apart.
    Coupled,
    /// Single joints are masked, but the policy was trained on whole frames.
    PartialMask,
    /// Links that touch.
    SelfCollision,
    /// A pose that the robot does not reach.
    Unreachable,
    /// A key that a mask hides, or a hold that is cut short.
    Hidden,
    /// No key at all, or a single frame.
    Empty,
}

/// An edit that removes a finding.
#[derive(Clone, Debug, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Fix {
    /// Its text on a button.
    pub title: String,
    /// The edit.
    pub op: Op,
}

/// A finding.
#[derive(Clone, Debug, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Lint {
    /// Its severity.
    pub level: Level,
    /// Its rule.
    pub rule: Rule,
    /// The message, with figures and units.
    pub message: String,
    /// The frames concerned, `[from, to)`; `None` = the clip as a whole.
    pub frames: Option<[u32; 2]>,
    /// The joints concerned.
    pub joints: Vec<String>,
    /// JSON pointer of the value to look at.
    pub pointer: String,
    /// Fixes, best first; the JSON name is `mends`, which scripts use.
    #[serde(rename = "mends")]
    pub fixes: Vec<Fix>,
    /// Of a pose that the robot cannot hold ([`Rule::Unreachable`]): what it holds instead.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub settled: Option<SettledPose>,
    /// Findings of this rule that are not listed; 0 but for the remark that says so.
    #[serde(skip)]
    pub unlisted: usize,
}

/// The pose in which a robot comes to rest when it is driven to another one that it cannot hold.
#[derive(Clone, Debug, PartialEq, Serialize, schemars::JsonSchema)]
pub struct SettledPose {
    /// The pose it was driven to, in the clip's joint order, rad or m.
    pub asked: Vec<f64>,
    /// The pose in which it rests, in the clip's joint order, rad or m.
    pub q: Vec<f64>,
    /// The joint that stays farthest off.
    pub joint: String,
    /// How far, rad or m.
    pub distance: f64,
    /// The frames that command the pose: of each key `[from, to)`.
    pub held: Vec<[u32; 2]>,
}

/// The result of simulating one pose.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PoseReport {
    /// Pairs of bodies that touch, by name, with the depth in metres.
    pub contacts: Vec<(String, String, f64)>,
    /// The pose that the robot settles in when it is driven there, in the clip's joint
    /// order; `None` when not simulated.
    pub settled: Option<Vec<f64>>,
}

/// Checks poses by simulation.
pub trait PoseChecker {
    /// Reports on the pose `q` (rad or m) of these joints.
    fn check(&mut self, joints: &[String], q: &[f64]) -> PoseReport;

    /// Largest settle residual that still counts as reached, rad or m.
    fn tolerance(&self) -> f64 {
        0.05
    }
}
