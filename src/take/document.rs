//! The take as a value.

use serde::{Deserialize, Serialize};

use robert_base::fsio;
use robert_base::units::{CTRL_DT, Unit};
use robert_clip::Command;
use robert_robot::{PlantConfig, Robot};
use robert_rollout::{self as rollout, Goals, Guide, PolicyConfig, Precision, RolloutConfig};

/// Numbers of one body pose: position in m, then orientation w x y z.
pub(super) const POSE: usize = 7;

/// The facts about the robot that a take needs.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotFacts {
    /// Robot id.
    pub id: String,
    /// Sha-256 of its model.
    pub model_sha256: String,
    /// Names of the state, in order.
    pub joints: Vec<String>,
    /// Units of the state.
    pub units: Vec<Unit>,
    /// Names of the action, in order.
    pub actuators: Vec<String>,
    /// Names of the bodies without the world; unique, and generated if the model has none.
    pub bodies: Vec<String>,
}

/// The origin of a take.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// The label of the policy: `pd`, `pd+guide`, `robert+refine`.
    pub policy: String,
    /// Name of the policy's model file, if it has one; without its folder, which is private.
    #[serde(default)]
    pub policy_file: Option<String>,
    /// Sha-256 of that file.
    pub policy_sha256: Option<String>,
    /// The settings of the policy for this robot; null if it has none.
    #[serde(default)]
    pub settings: serde_json::Value,
    /// Seed of the policy's random choices.
    pub seed: u64,
    /// The rule that filled masked frames.
    pub guide: Guide,
    /// Whether each action was improved on the model.
    pub refine: bool,
    /// The simulated plant.
    pub plant: PlantConfig,
    /// Program and version.
    pub program: String,
}

impl Provenance {
    /// The provenance of a rollout made with these settings.
    ///
    /// # Errors
    /// When the model file cannot be read.
    pub fn new(
        robot: &Robot,
        policy: &PolicyConfig,
        config: &RolloutConfig,
    ) -> Result<Provenance, rollout::Error> {
        let (policy_file, policy_sha256) = policy.model_file(robot)?.unzip();
        Ok(Provenance {
            policy: policy.label(),
            policy_file,
            policy_sha256,
            settings: policy.settings(robot),
            seed: config.seed,
            guide: config.guide,
            refine: policy.refine,
            plant: config.plant,
            program: format!("robert {}", env!("CARGO_PKG_VERSION")),
        })
    }
}

/// One of the two motions of a take.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum What {
    /// The reached motion.
    #[default]
    Achieved,
    /// The command.
    Command,
}

/// A recorded rollout. Rows are frames of 1/20 s, frame 0 is the start.
///
/// ```
/// use std::sync::Arc;
///
/// use robert_clip::compile;
/// use robert_base::progress::Cancel;
/// use robert_robot::Robot;
/// use robert_rollout::{PolicyConfig, PolicyName, Rollout, RolloutConfig, Start, tasks};
/// use robert_take::{Provenance, Take};
///
/// let clip = tasks::find("pointmass/circle", None)?;
/// let (robot, command) = (Arc::new(Robot::builtin(&clip.robot.id)?), compile(&clip)?);
/// let (policy, config) = (PolicyConfig::new(PolicyName::Pd), RolloutConfig::default());
/// let made_by = Provenance::new(&robot, &policy, &config)?;
/// let mut rollout = Rollout::new(&robot, policy.build(&robot)?, &command, Start::Pose, config)?;
/// rollout.run(&Cancel::default())?;
/// let take = Take::record(&rollout, &command, Some(&clip), made_by)?;
/// assert_eq!(take.frames(), rollout.frame() + 1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Take {
    /// The robot.
    pub robot: RobotFacts,
    /// Canonical text of the clip; `None` for motions that never were clips.
    pub clip_text: Option<String>,
    /// The command; it may be longer than the reached motion.
    pub command: Command,
    /// Reached state, rad or m; (frames, S).
    pub reached: Vec<f64>,
    /// Joint velocity, rad/s or m/s; (frames, S).
    pub velocity: Vec<f64>,
    /// Torque or force on each joint from the actuators during the frame that begins here,
    /// N m or N; (frames - 1, S).
    pub effort: Vec<f64>,
    /// Action at each frame except the last, -1..1; (frames - 1, A).
    pub actions: Vec<f64>,
    /// The actions as controls, N m or N; (frames - 1, A).
    pub ctrl: Vec<f64>,
    /// World poses of the bodies, x y z (m) and w x y z; (frames, B, 7).
    pub poses: Vec<f64>,
    /// World poses of the bodies at the commanded pose, for frames with a goal for every joint;
    /// (frames).
    pub ghost: Vec<Option<Vec<f64>>>,
    /// Its origin.
    pub provenance: Provenance,
    /// The card of a learned policy, JSON: its training data and figures.
    pub policy_card: Option<String>,
}

impl Take {
    /// Reached frames, including frame 0.
    pub fn frames(&self) -> usize {
        self.reached.len() / self.state_dim().max(1)
    }

    /// Numbers in a state.
    pub fn state_dim(&self) -> usize {
        self.robot.joints.len()
    }

    /// Numbers in an action.
    pub fn action_dim(&self) -> usize {
        self.robot.actuators.len()
    }

    /// Length, seconds.
    pub fn secs(&self) -> f64 {
        self.frames().saturating_sub(1) as f64 * CTRL_DT
    }

    /// Reached state of a frame; empty beyond the end. (S)
    pub fn state(&self, frame: usize) -> &[f64] {
        row(&self.reached, frame, self.state_dim())
    }

    /// Body poses of a frame; empty beyond the end. (B, 7)
    pub fn body_poses(&self, frame: usize) -> &[f64] {
        row(&self.poses, frame, self.robot.bodies.len() * POSE)
    }

    /// The figures of the take, equal bit for bit to those of the rollout.
    pub fn precision(&self) -> Precision {
        let goals = Goals::new(&self.command);
        Precision::measure(&goals, &self.reached, &self.actions, self.action_dim())
    }

    /// Sha-256 of the clip's text.
    pub fn clip_sha256(&self) -> Option<String> {
        self.clip_text.as_ref().map(|t| fsio::sha256_hex(t.as_bytes()))
    }

    /// `config.toml`: the complete configuration, for people and to repeat the rollout. It is
    /// derived from robot and provenance, so it is written and never read.
    pub fn config_toml(&self) -> String {
        #[derive(Serialize)]
        struct Config<'a> {
            program: &'a str,
            robot: Model<'a>,
            #[serde(skip_serializing_if = "Option::is_none")]
            clip: Option<Model<'a>>,
            policy: PolicyHeader<'a>,
            rollout: Rollout,
        }
        #[derive(Serialize)]
        struct Model<'a> {
            id: &'a str,
            sha256: String,
        }
        #[derive(Serialize)]
        struct PolicyHeader<'a> {
            name: &'a str,
            #[serde(skip_serializing_if = "Option::is_none")]
            file: Option<&'a str>,
            #[serde(skip_serializing_if = "Option::is_none")]
            sha256: Option<&'a str>,
            guide: Guide,
            refine: bool,
            #[serde(skip_serializing_if = "serde_json::Value::is_null")]
            settings: &'a serde_json::Value,
        }
        #[derive(Serialize)]
        struct Rollout {
            seed: u64,
            frames: usize,
            fps: u32,
            plant: PlantConfig,
        }
        let p = &self.provenance;
        let config = Config {
            program: &p.program,
            robot: Model { id: &self.robot.id, sha256: self.robot.model_sha256.clone() },
            clip: self.clip_sha256().map(|sha256| Model { id: "clip.json", sha256 }),
            policy: PolicyHeader {
                name: &p.policy,
                file: p.policy_file.as_deref(),
                sha256: p.policy_sha256.as_deref(),
                guide: p.guide,
                refine: p.refine,
                settings: &p.settings,
            },
            rollout: Rollout {
                seed: p.seed,
                frames: self.frames(),
                fps: robert_base::units::FPS,
                plant: p.plant,
            },
        };
        // TOML cannot represent a seed beyond 2^63; then there is no config.toml.
        toml::to_string(&config).unwrap_or_default()
    }

    /// Error of a joint at a frame, where the command has a goal for it, rad or m.
    pub fn joint_error(&self, frame: usize, joint: usize) -> Option<f64> {
        let at = u32::try_from(frame).ok()?;
        if !self.command.sees(at, joint) {
            return None;
        }
        let goal = f64::from(*self.command.row(at).get(joint)?);
        Some((self.state(frame).get(joint)? - goal).abs())
    }
}

/// Row `i` of a (rows, dim) array.
pub(super) fn row(values: &[f64], i: usize, dim: usize) -> &[f64] {
    values.get(i * dim..(i + 1) * dim).unwrap_or_default()
}
