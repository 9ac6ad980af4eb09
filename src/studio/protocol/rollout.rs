//! The rollout, takes and the simulation as clients see them.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use robert_rollout::{Guide, PolicyConfig, PolicyName, Stage, Trial};

/// The settings of the live rollout.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RolloutSettings {
    /// The policy.
    pub policy: PolicyName,
    /// Improve each action on the model.
    pub refine: bool,
    /// Virtual commands through masks.
    pub guide: Guide,
    /// Seed.
    pub seed: u64,
    /// Roll out after every edit.
    pub auto: bool,
    /// Model or fit file, for learned policies.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model_path: Option<String>,
}

impl RolloutSettings {
    /// The chosen policy, without its model.
    pub fn config(&self) -> PolicyConfig {
        let mut config = PolicyConfig::new(self.policy);
        config.refine = self.refine;
        config.guide = self.guide;
        config
    }

    /// The name of the policy in takes and pictures.
    pub fn label(&self) -> String {
        let model_path = self.model_path.as_ref().map(Into::into);
        PolicyConfig { model_path, ..self.config() }.label()
    }
}

impl Default for RolloutSettings {
    fn default() -> Self {
        RolloutSettings {
            policy: PolicyName::ComputedTorque,
            refine: false,
            guide: Guide::None,
            seed: 0,
            auto: true,
            model_path: None,
        }
    }
}

/// `GET /api/rollout`.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RolloutView {
    /// State.
    pub state: RolloutState,
    /// Achieved states; `q[f]` is frame f.
    pub q: Vec<Vec<f32>>,
    /// Mean absolute error by frame, null where masked.
    pub error: Vec<Option<f64>>,
    /// Full figures, when done.
    #[cfg_attr(test, schemars(with = "Option<robert_rollout::Precision>"))]
    pub precision: Option<Value>,
}

/// The progress of the rollout.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RolloutState {
    /// The number of the rollout; increases with every restart.
    #[serde(rename = "gen")]
    pub generation: u64,
    /// Version of the document that it performs; 0 for a preview.
    pub rev: u64,
    /// The phase in which it is.
    pub phase: Phase,
    /// Frames `0..cached_to` are valid.
    pub cached_to: usize,
    /// Frames of the clip.
    pub frames: usize,
    /// The frame it was resumed from.
    pub resumed_at: usize,
    /// Mean absolute error so far, rad or m.
    pub mae: Option<f64>,
    /// Time a simulated frame takes, milliseconds.
    pub ms_per_frame: Option<f64>,
    /// The policy, such as `pd+refine`. For `auto` the policy that it chose, as soon as it has
    /// chosen.
    pub policy: String,
    /// The policies that `auto` compared, in the order in which they were tried; empty for a named
    /// policy.
    pub tried: Vec<Trial>,
    /// How the motion is being improved, once all frames are there.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stage: Option<Stage>,
    /// Why it failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}

/// The phase of a rollout.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum Phase {
    /// There is none.
    #[default]
    Off,
    /// Asked for, no frame yet.
    Waiting,
    /// Frames come.
    Running,
    /// All frames are there.
    Done,
    /// It broke; frames before stand.
    Failed,
}

/// A take, in short.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct TakeCard {
    /// Number, for `GET /api/takes/{id}` and the operations on it.
    pub id: u64,
    /// The name of the policy.
    pub name: String,
    /// Title of its clip.
    pub clip: String,
    /// The version of the document that it performs, as long as that document is open.
    pub rev: u64,
    /// Policy as tables show it.
    pub policy: String,
    /// Seed of the policy's draws.
    pub seed: u64,
    /// Mean absolute error over all goals, rad or m.
    pub mae: Option<f64>,
    /// Frames.
    pub frames: usize,
    /// The joint with the largest mean absolute error over its goals.
    pub worst_joint: Option<String>,
    /// That error, rad or m.
    pub worst: Option<f64>,
    /// Roughness: root mean square of the motion's third differences over all joints, rad/s³ or
    /// m/s³. Smoother is lower.
    pub jerk: Option<f64>,
    /// Kept until it is removed.
    pub pinned: bool,
    /// Whether its goals equal those of the current command, so that the errors can be compared.
    pub same_goals: bool,
}

/// All that a client draws of takes.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct TakesView {
    /// Takes of the open robot, the newest first.
    pub takes: Vec<TakeCard>,
    /// The takes drawn beside the current motion, in this order; the last one also in the viewport.
    pub compared: Vec<u64>,
    /// Sentences about pinned takes on disk that could not be read when the studio began.
    pub skipped: Vec<String>,
}

/// The motion of a take.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct TakeFrames {
    /// Achieved states by frame; (frames, S).
    pub q: Vec<Vec<f32>>,
    /// Mean absolute error by frame, null where masked.
    pub error: Vec<Option<f64>>,
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
    /// Not started yet, or not needed at the moment.
    #[default]
    Starting,
    /// Up.
    Ready,
    /// It died; a new one comes.
    Restarting,
    /// The worker died too often; it starts again only on request.
    Stopped,
}
