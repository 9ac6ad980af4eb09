//! Units and the clock. Radians, metres and seconds everywhere below `ui/`; time is
//! counted in whole frames of 1/20 s so that a clip and its rollout can never drift.

/// Length of one control step (one frame), seconds: 20 Hz as in the paper.
pub const CTRL_DT: f64 = 0.05;

/// Frames a second.
pub const FPS: u32 = 20;

/// Simulator step, seconds. Another substep count is another learning problem, so it
/// is the same for every robot that we train.
pub const SIM_DT: f64 = 0.005;

/// Simulator steps in one control step.
pub const SUBSTEPS: usize = 10;

/// A point or length of time in whole frames at [`FPS`].
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    serde::Serialize,
    serde::Deserialize,
)]
#[serde(transparent)]
pub struct Frames(pub u32);

impl Frames {
    /// The same time in seconds.
    pub fn secs(self) -> f64 {
        f64::from(self.0) * CTRL_DT
    }
}

/// The unit of one joint coordinate.
#[derive(
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    Hash,
    serde::Serialize,
    serde::Deserialize,
    schemars::JsonSchema,
)]
#[serde(rename_all = "lowercase")]
pub enum Unit {
    /// Hinge joints.
    Rad,
    /// Slide joints, metres.
    M,
}

impl Unit {
    /// Symbol for tables and axes.
    pub fn symbol(self) -> &'static str {
        match self {
            Unit::Rad => "rad",
            Unit::M => "m",
        }
    }
}
