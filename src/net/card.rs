//! The model card: everything about a model except its numbers.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::config::{COMMAND, HISTORY};
use super::observer;
use super::reach::Reach;
use super::token::{Facts, Normaliser, TokenConfig, Tokeniser};
use super::{Error, MaskGranularity, NetConfig};
use robert_base::limits;

/// Value of `format`.
pub const FORMAT: &str = "robert-model/1";

/// The robot that a model drives.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotCard {
    /// Name of the robot.
    pub id: String,
    /// Sha-256 of its MJCF.
    pub model_sha256: String,
    /// State joints in order.
    pub joints: Vec<String>,
    /// Actuators in order.
    pub actuators: Vec<String>,
}

/// The window a model reads.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WindowCard {
    /// Frames before the current one.
    pub history: usize,
    /// The current frame.
    pub current: usize,
    /// Commanded frames.
    pub command: usize,
    /// Frames per second.
    pub rate_hz: u32,
}

/// The simulation that produced the data.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhysicsCard {
    /// Simulator step, s.
    pub dt: f64,
    /// Simulator steps in a frame.
    pub substeps: usize,
    /// Integrator.
    pub integrator: String,
    /// Friction cone.
    pub cone: String,
}

/// The usual range and speed of a joint.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Usual {
    /// 1 of 100 frames is below, rad or m.
    pub low: f64,
    /// 1 of 100 frames is above, rad or m.
    pub high: f64,
    /// 1 of 100 frames is faster, rad/s or m/s.
    pub speed: f64,
}

/// The training of a model.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingCard {
    /// Sha-256 of the dataset's manifest.
    pub dataset_sha256: String,
    /// Transitions of the dataset by the agent that made them; empty in files of older programs.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub agents: BTreeMap<String, u64>,
    /// Resolved settings.
    pub config: serde_json::Value,
    /// Seed.
    pub seed: u64,
    /// Steps taken.
    pub step: u64,
    /// Precision by suite, if it was measured.
    pub precision: BTreeMap<String, f64>,
    /// Notes for people: data, commands, limits.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub notes: String,
}

/// Everything about a model except its numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Card {
    /// [`FORMAT`].
    pub format: String,
    /// Robot.
    pub robot: RobotCard,
    /// Window.
    pub window: WindowCard,
    /// Simulation.
    pub physics: PhysicsCard,
    /// Sizes.
    pub net: NetConfig,
    /// Features.
    pub tokens: TokenConfig,
    /// The masks that the model was trained with; the studio offers per-joint masks accordingly.
    pub mask_granularity: MaskGranularity,
    /// The facts about the robot that the features use.
    pub facts: Facts,
    /// Normaliser of the training split.
    pub normaliser: Normaliser,
    /// The usual range of each joint in the training split; empty in files of older programs.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub usual: Vec<Usual>,
    /// The effect of actions, and the usual speeds; a policy without it uses goals unchanged.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reach: Option<Reach>,
    /// Percent that the newest frame counts in the disturbance that the policy adds to each action;
    /// 0 is off. See [`super::observer`].
    #[serde(default, skip_serializing_if = "is_off")]
    pub observer: u8,
    /// Meaning of the actions.
    pub action: String,
    /// Training record.
    pub training: TrainingCard,
}

/// Whether an observer of this weight is off, so that files need not contain it.
pub fn is_off(observer: &u8) -> bool {
    *observer == 0
}

impl Card {
    /// A card for a network of this process, with the standard window, physics and action.
    pub fn new(
        robot: RobotCard,
        net: NetConfig,
        tokens: &Tokeniser,
        normaliser: Normaliser,
        training: TrainingCard,
    ) -> Self {
        Card {
            format: FORMAT.into(),
            robot,
            window: WindowCard {
                history: HISTORY,
                current: 1,
                command: COMMAND,
                rate_hz: robert_base::units::FPS,
            },
            physics: PhysicsCard {
                dt: robert_base::units::SIM_DT,
                substeps: robert_base::units::SUBSTEPS,
                integrator: "Euler".into(),
                cone: "pyramidal".into(),
            },
            net,
            mask_granularity: tokens.config().granularity,
            tokens: tokens.config().clone(),
            facts: tokens.facts().clone(),
            normaliser,
            usual: Vec::new(),
            reach: None,
            observer: 0,
            action: "[-1, 1] scaled to ctrlrange".into(),
            training,
        }
    }
}

/// Number of standard deviations on each side of the mean that covers 98 of 100 frames, for files
/// with only these. Joints stay inside their limits, so their tails are short.
const SIDE_STD: f64 = 2.0;
/// Number of standard deviations of speed that 99 of 100 frames stay below.
const SPEED_STD: f64 = 2.58;

impl Card {
    /// The masks that a policy with this model accepts: also single joints, if gaps are filled
    /// before the network sees them.
    pub fn masks(&self) -> MaskGranularity {
        if self.reach.is_some() { MaskGranularity::Joint } else { self.mask_granularity }
    }

    /// Refuses an observer of this weight, in percent, for a network that has not learned to infer past
    /// actions: one that sees them, or one with a loss at the current frame only.
    ///
    /// # Errors
    /// [`Error::Config`].
    pub fn may_observe(&self, percent: u8) -> Result<(), Error> {
        observer::check(percent, &self.tokens)?;
        let current_only = self.training.config.get("current_only");
        let current_only = current_only.and_then(serde_json::Value::as_bool) == Some(true);
        if percent > 0 && (self.tokens.previous_action || current_only) {
            let why = "the network has not learned to infer past actions".to_owned();
            return Err(Error::Config { field: "observer", why });
        }
        Ok(())
    }

    /// The usual range of each joint in the training split, (S); estimated from mean and spread if
    /// the file does not say.
    pub fn usual(&self) -> Vec<Usual> {
        let n = &self.normaliser;
        if self.usual.len() == n.mean.len() {
            return self.usual.clone();
        }
        let each = n.mean.iter().zip(&n.std).zip(&n.std_d1);
        each.map(|((mean, std), step)| Usual {
            low: mean - SIDE_STD * std,
            high: mean + SIDE_STD * std,
            speed: SPEED_STD * step / robert_base::units::CTRL_DT,
        })
        .collect()
    }
}

/// Refuses a file that was made for another robot, and names the difference.
///
/// # Errors
/// [`Error::Robot`].
pub fn same_robot(trained: &RobotCard, given: &RobotCard, path: &Path) -> Result<(), Error> {
    let refuse = |trained: String, given: String| {
        Err(Error::Robot { trained, given, path: path.to_owned() })
    };
    if trained.joints != given.joints {
        let list = |r: &RobotCard| format!("{} with joints {}", r.id, r.joints.join(", "));
        return refuse(list(trained), list(given));
    }
    if trained.actuators != given.actuators {
        let list = |r: &RobotCard| format!("{} with actuators {}", r.id, r.actuators.join(", "));
        return refuse(list(trained), list(given));
    }
    if trained.model_sha256 != given.model_sha256 {
        let short = |r: &RobotCard| {
            format!("{} (model {})", r.id, r.model_sha256.get(..12).unwrap_or(&r.model_sha256))
        };
        return refuse(short(trained), short(given));
    }
    Ok(())
}

/// Refuses a card whose parts contradict each other or this program.
pub(super) fn check_card(card: &Card) -> Result<(), String> {
    let window = &card.window;
    if (window.history, window.current, window.command) != (HISTORY, 1, COMMAND) {
        let (h, c, n) = (window.history, window.current, window.command);
        return Err(format!(
            "a window of {h} + {c} + {n} frames instead of {HISTORY} + 1 + {COMMAND}"
        ));
    }
    if window.rate_hz != robert_base::units::FPS {
        return Err(format!(
            "{} frames a second instead of {}",
            window.rate_hz,
            robert_base::units::FPS
        ));
    }
    if card.robot.joints.len() != card.facts.joints.len() {
        return Err("joint names and joint facts of different numbers".into());
    }
    if card.robot.actuators.len() != card.facts.actions || card.net.actions != card.facts.actions {
        return Err("actuator names and action sizes of different numbers".into());
    }
    if card.facts.joints.len() > limits::JOINTS {
        return Err(format!("{} joints, more than {}", card.facts.joints.len(), limits::JOINTS));
    }
    card.may_observe(card.observer).map_err(|e| e.to_string())?;
    if card.mask_granularity != card.tokens.granularity {
        return Err("two different mask granularities".into());
    }
    Ok(())
}
