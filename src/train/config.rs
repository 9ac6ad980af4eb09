//! Settings of a training run, presets, `--set key=value`. They are saved with the result.

use serde::{Deserialize, Serialize};

use super::Error;
use robert_net::mask::{MaskKind, Schedule};
use robert_net::observer::SEEN;
use robert_net::token::TokenConfig;
use robert_net::{
    AdamConfig, COMMAND, Facts, MaskGranularity, Mixing, NetConfig, SkipKind, TokenKind, WINDOW,
};
use robert_rollout::{Inference, PolicyConfig, PolicyName};

/// The most steps; with the largest batch and all rounds every window still has its own number.
const MOST_STEPS: u64 = 1_000_000_000_000;

/// All settings of a training run; together with the data they determine its result.
///
/// ```
/// use robert_train::TrainConfig;
///
/// let mut config = TrainConfig::preset("instant")?;
/// config.set("lr=1e-4")?;
/// assert_eq!(config.lr, 1e-4);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
    /// Preset that this started from.
    pub preset: String,
    /// Transformer layers.
    pub layers: usize,
    /// Width of a token.
    pub width: usize,
    /// Attention heads.
    pub heads: usize,
    /// The operation that passes information between frames; `none` is a feed-forward network for
    /// each frame.
    pub mixing: Mixing,
    /// Action bins K; 1 is plain regression.
    pub bins: usize,
    /// Factor on the offset loss when K > 1.
    pub offset_weight: f64,
    /// Token variant.
    pub tokens: TokenKind,
    /// Stop distances and hinge angles in a `goal` token.
    pub profile: bool,
    /// Whether tokens up to the current frame contain the difference between the last action and
    /// the linear prediction, and the ratio of both over the past. Earlier frames are then not
    /// learned from, because the next token reveals their action.
    #[serde(default)]
    pub previous_action: bool,
    /// The unit of the distance of a slide without stops from the current frame, in `pos` tokens.
    #[serde(default)]
    pub slide_unit: SlideUnit,
    /// Whether a mask hides whole frames or single joints.
    pub mask_granularity: MaskGranularity,
    /// The linear prediction beside the network.
    pub skip: SkipKind,
    /// Back differences in the linear fit; 0 chooses by robot.
    pub ridge_history: usize,
    /// The rule that chooses the hidden command frames.
    pub mask: MaskKind,
    /// Windows per step.
    pub batch: usize,
    /// Steps.
    pub steps: u64,
    /// Greatest learning rate.
    pub lr: f64,
    /// Schedule of the learning rate.
    pub schedule: Schedule,
    /// Weight decay, on the weights of linear maps only.
    pub weight_decay: f64,
    /// Largest norm of the gradient.
    pub clip: f64,
    /// Loss at the current frame only, instead of all 51.
    pub current_only: bool,
    /// Decay d of the running average of the weights that is kept as the model; 0 is off. Until
    /// step 9 d / (1 - d) the average spans about the last ninth of the steps so far, so one value
    /// fits short and long runs.
    pub average: f64,
    /// Rounds of self-correction: the network performs tasks from its own data, and the reached
    /// motion is added to the data; 0 is off.
    pub self_correct: u64,
    /// Share of windows that come from earlier rounds.
    pub self_share: f64,
    /// Tasks per round, of 80 frames each.
    pub self_tasks: usize,
    /// Loss weight of frames with a joint near a stop, where torque cannot be inferred.
    pub stop_weight: f64,
    /// Loss weight of frames in self-contact.
    pub contact_weight: f64,
    /// The target of such frames.
    #[serde(default)]
    pub contact_target: ContactTarget,
    /// Whether the model learns what actions can move, fills gaps itself and ignores goals in
    /// directions that no actuator moves. Without it the network sees masks and goals unchanged.
    #[serde(default)]
    pub reach: bool,
    /// Penalty of the linear prediction per sample; if absent, it follows from the number of
    /// inputs. See [`super::penalty`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ridge_penalty: Option<f64>,
    /// Whether frames that press instead of moving count as self-contact although none is recorded:
    /// frames whose action is far from a linear function of the positions around them.
    #[serde(default)]
    pub leave_pressing: bool,
    /// Percent that the newest frame counts in the disturbance that the policy adds to each action;
    /// 0 is off. See [`robert_net::observer`].
    #[serde(default, skip_serializing_if = "robert_net::checkpoint::is_off")]
    pub observer: u8,
    /// The tasks that choose the best checkpoint.
    #[serde(default)]
    pub select: Select,
    /// How the network performs these tasks: options of a policy, such as `+mean+ahead=2+smooth`; without any by default.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub select_with: String,
    /// Seed of all random choices: weights, batches, masks, split.
    pub seed: u64,
}

/// The tasks whose mean Precision chooses the best checkpoint.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Select {
    /// The suites `manual` and `extra`, with equal weights.
    #[default]
    Tasks,
    /// As in the paper: the suite `manual` merged with tasks extracted from the held-out part of the
    /// data, of which a third has a quarter and a third half of its frames hidden. All tasks have
    /// equal weights.
    Extracted,
}

/// The unit of the distance of a slide without stops from the current frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SlideUnit {
    /// The standard deviation of recorded positions, which may be many metres.
    #[default]
    Spread,
    /// Ten frames of typical motion.
    Motion,
}

/// The target of frames in self-contact, where torque presses instead of moving.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ContactTarget {
    /// The applied action.
    #[default]
    Action,
    /// The linear prediction, so that the network does not change it where nothing can be learned;
    /// without a skip the same as `Action`.
    Linear,
}

impl Default for TrainConfig {
    /// `quick`: about five minutes on two cores.
    fn default() -> Self {
        TrainConfig {
            preset: "quick".into(),
            layers: 4,
            width: 128,
            heads: 4,
            mixing: Mixing::Attention,
            bins: 1,
            offset_weight: 10.0,
            tokens: TokenKind::Goal,
            profile: true,
            previous_action: false,
            slide_unit: SlideUnit::Spread,
            mask_granularity: MaskGranularity::State,
            skip: SkipKind::Gated,
            ridge_history: 0,
            mask: MaskKind::ClUniform,
            batch: 128,
            steps: 2_000,
            lr: 1e-3,
            schedule: Schedule::Cosine,
            weight_decay: 0.1,
            clip: 1.0,
            current_only: false,
            average: 0.999,
            self_correct: 0,
            self_share: 0.25,
            self_tasks: 240,
            stop_weight: 0.1,
            contact_weight: 0.05,
            contact_target: ContactTarget::Action,
            reach: true,
            ridge_penalty: None,
            leave_pressing: false,
            observer: 0,
            select: Select::Tasks,
            select_with: String::new(),
            seed: 0,
        }
    }
}

/// Presets with a line for the help text.
pub const PRESETS: [(&str, &str); 9] = [
    ("instant", "the linear prediction alone, fitted in seconds without training"),
    ("quick", "4 layers of 128, goal tokens, gated skip: about five minutes on two cores"),
    ("pm-tiny", "2 layers of 64, 256 x 10k: Pointmass, ablations"),
    ("pm-plus", "3 layers of 96, 256 x 10k: Pointmass"),
    ("ur-small", "4 layers of 128, 256 x 10k: UR5e"),
    ("hand-base", "4 layers of 192, 256 x 10k: Shadow Hand"),
    ("paper-pointmass", "the paper's smallest: 2 layers of 64, pos tokens, K = 10, 512 x 10k"),
    ("paper-ur5e", "the paper's: 6 layers of 768, pos tokens, K = 10, 512 x 12k"),
    ("paper-shadow", "the paper's: 6 layers of 768, pos tokens, K = 10, 512 x 15k"),
];

impl TrainConfig {
    /// The settings of a preset.
    ///
    /// # Errors
    /// [`Error::Preset`] with the existing names.
    pub fn preset(name: &str) -> Result<Self, Error> {
        let product = |layers, width, heads, lr| TrainConfig {
            layers,
            width,
            heads,
            lr,
            batch: 256,
            steps: 10_000,
            ..Self::default()
        };
        let paper = |layers, width, heads, steps| TrainConfig {
            layers,
            width,
            heads,
            bins: 10,
            tokens: TokenKind::Pos,
            profile: false,
            skip: SkipKind::Off,
            reach: false,
            mask: MaskKind::Cl,
            batch: 512,
            steps,
            lr: 7e-5,
            schedule: Schedule::Paper,
            average: 0.0,
            stop_weight: 1.0,
            contact_weight: 1.0,
            contact_target: ContactTarget::Action,
            select: Select::Extracted,
            ..Self::default()
        };
        let cfg = match name {
            "instant" => {
                TrainConfig { steps: 0, layers: 1, width: 16, heads: 1, ..Self::default() }
            }
            "quick" => Self::default(),
            "pm-tiny" => product(2, 64, 4, 1e-3),
            "pm-plus" => product(3, 96, 4, 1e-3),
            "ur-small" => product(4, 128, 4, 1e-3),
            "hand-base" => product(4, 192, 6, 5e-4),
            "paper-pointmass" => paper(2, 64, 4, 10_000),
            "paper-ur5e" => paper(6, 768, 6, 12_000),
            "paper-shadow" => paper(6, 768, 6, 15_000),
            _ => {
                let known = PRESETS.map(|(name, _)| name).join(", ");
                return Err(Error::Preset { name: name.to_owned(), known });
            }
        };
        Ok(TrainConfig { preset: name.to_owned(), ..cfg })
    }

    /// Changes one setting by `key=value`.
    ///
    /// # Errors
    /// [`Error::Setting`]: no such key, or a value of another type.
    pub fn set(&mut self, assignment: &str) -> Result<(), Error> {
        let fail = |why: String| Error::Setting { setting: assignment.to_owned(), why };
        let (key, value) =
            assignment.split_once('=').ok_or_else(|| fail("expected key=value".into()))?;
        let (key, value) = (key.trim(), value.trim());
        if key == "preset" {
            return Err(fail("is not a single setting: choose it with --preset, or in a sweep file with preset = above [set]".into()));
        }
        let mut table = toml::Table::try_from(&*self).map_err(|e| fail(e.to_string()))?;
        // A setting without a value is not in the table, but may be given one.
        let given = TrainConfig {
            ridge_penalty: Some(0.0),
            observer: 1,
            select_with: "+".to_owned(),
            ..self.clone()
        };
        let known = toml::Table::try_from(given).map_err(|e| fail(e.to_string()))?;
        let Some(old) = known.get(key) else {
            let keys: Vec<_> = known.keys().map(String::as_str).collect();
            return Err(fail(format!("no setting {key:?}; there are {}", keys.join(", "))));
        };
        let parsed = match old {
            toml::Value::Float(_) => value.parse().ok().map(toml::Value::Float),
            toml::Value::Integer(_) => {
                let typed =
                    || robert_base::units::count(value).ok().and_then(|n| i64::try_from(n).ok());
                value.parse().ok().or_else(typed).map(toml::Value::Integer)
            }
            toml::Value::Boolean(_) => value.parse().ok().map(toml::Value::Boolean),
            _ => Some(toml::Value::String(value.to_owned())),
        };
        let kind = old.type_str();
        let parsed = parsed.ok_or_else(|| fail(format!("{value:?} is not a {kind}")))?;
        table.insert(key.to_owned(), parsed);
        let next: TrainConfig = table
            .try_into()
            .map_err(|e: toml::de::Error| fail(e.message().trim().replace('\n', " ")))?;
        next.check()?;
        *self = next;
        Ok(())
    }

    /// Refuses values that are invalid by themselves; [`TrainConfig::check_network`] checks
    /// combinations.
    ///
    /// # Errors
    /// [`Error::Setting`].
    pub fn check(&self) -> Result<(), Error> {
        let refuse = |setting: &str, why: &str| {
            Err(Error::Setting { setting: setting.to_owned(), why: why.to_owned() })
        };
        let positive = |x: f64| x.is_finite() && x > 0.0;
        let weight = |x: f64| x.is_finite() && (0.0..=1e6).contains(&x);
        match () {
            () if !(1..=65_536).contains(&self.batch) => refuse("batch", "takes 1 to 65536"),
            () if self.steps > MOST_STEPS => refuse("steps", "takes 0 to 1e12"),
            () if self.ridge_history >= WINDOW - COMMAND => {
                refuse("ridge_history", "takes 0 to 30")
            }
            () if !positive(self.lr) => refuse("lr", "must be positive"),
            () if !positive(self.clip) => refuse("clip", "must be positive"),
            () if !weight(self.weight_decay) => refuse("weight_decay", "must be 0 or more"),
            () if !(0.0..1.0).contains(&self.average) => refuse("average", "takes 0 to below 1"),
            () if !weight(self.stop_weight) => refuse("stop_weight", "must be 0 or more"),
            () if !weight(self.contact_weight) => refuse("contact_weight", "must be 0 or more"),
            () if !self.ridge_penalty.is_none_or(weight) => {
                refuse("ridge_penalty", "must be 0 or more")
            }
            () if self.observer > 100 => refuse("observer", "takes 0 to 100"),
            () if self.observes() && (self.previous_action || self.current_only) => refuse(
                if self.observer > 0 { "observer" } else { "select_with" },
                "an observer infers past actions, which are not learned with previous_action or current_only",
            ),
            () if self.observes() && self.ridge_history >= SEEN => {
                let setting = if self.observer > 0 { "observer" } else { "select_with" };
                refuse(setting, "an observer needs a ridge_history below 28")
            }
            () if self.self_correct > 100 => refuse("self_correct", "takes 0 to 100"),
            () if !(0.0..=1.0).contains(&self.self_share) => refuse("self_share", "takes 0 to 1"),
            () if !(1..=1_000_000).contains(&self.self_tasks) => {
                refuse("self_tasks", "takes 1 to a million")
            }
            () if self.selecting_policy().is_none() => refuse(
                "select_with",
                "takes options of a network: +guide, +smooth, +sample, +mean, +masks, +observer=N, +ahead=N or +ensemble=N",
            ),
            () if self.seed > i64::MAX as u64 => refuse("seed", "takes 63 bits"),
            () => Ok(()),
        }
    }

    /// Whether the policy has an observer, for good or where it is selected.
    fn observes(&self) -> bool {
        let selecting = self.selecting_policy().and_then(|policy| policy.inference.observer);
        self.observer > 0 || selecting.is_some_and(|percent| percent > 0)
    }

    /// The policy that performs the tasks which choose the best checkpoint, without its model; `None` if
    /// `select_with` has no such options.
    pub(super) fn selecting_policy(&self) -> Option<PolicyConfig> {
        let policy: PolicyConfig = format!("robert{}", self.select_with).parse().ok()?;
        let network = PolicyConfig {
            guide: policy.guide,
            inference: Inference { gain: false, ..policy.inference },
            ..PolicyConfig::new(PolicyName::Robert)
        };
        (policy == network).then_some(policy)
    }

    /// Refuses sizes that are invalid for every robot, before data are read. Call it when all
    /// settings are known, since some are valid only together.
    ///
    /// # Errors
    /// [`Error::Setting`].
    pub fn check_network(&self) -> Result<(), Error> {
        // Uses the least numbers of inputs and actions; those of a robot are checked with its data.
        self.net_config(1, 1, false).check().map_err(|e| match e {
            robert_net::Error::Config { field, why } => {
                Error::Setting { setting: field.to_owned(), why }
            }
            other => other.into(),
        })
    }

    /// The features for this robot.
    pub fn token_config(&self, facts: &Facts) -> TokenConfig {
        let own = TokenConfig::for_robot(facts);
        TokenConfig {
            kind: self.tokens,
            granularity: self.mask_granularity,
            profile: self.profile,
            ridge_history: if self.ridge_history == 0 {
                own.ridge_history
            } else {
                self.ridge_history
            },
            ridge_friction: own.ridge_friction,
            previous_action: self.previous_action,
        }
    }

    /// The network, behind an encoder with this many inputs.
    pub fn net_config(&self, inputs: usize, actions: usize, mask_replaces: bool) -> NetConfig {
        NetConfig {
            layers: self.layers,
            width: self.width,
            heads: self.heads,
            inputs,
            actions,
            bins: self.bins,
            offset_weight: self.offset_weight,
            mask_replaces,
            skip: self.skip,
            mixing: self.mixing,
            dead_zone: 0.0,
        }
    }

    /// The optimiser.
    pub fn adam(&self) -> AdamConfig {
        AdamConfig { weight_decay: self.weight_decay, clip: self.clip, ..AdamConfig::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_exist_and_round_trip() {
        for (name, _) in PRESETS {
            let cfg = TrainConfig::preset(name).unwrap();
            assert_eq!(cfg.preset, name);
            let text = toml::to_string(&cfg).unwrap();
            assert_eq!(toml::from_str::<TrainConfig>(&text).unwrap(), cfg);
            cfg.check().unwrap();
        }
        let e = TrainConfig::preset("huge").unwrap_err().to_string();
        assert!(e.contains("huge") && e.contains("ur-small"), "{e}");
    }

    #[test]
    fn the_papers_settings() {
        let cfg = TrainConfig::preset("paper-ur5e").unwrap();
        let net = cfg.net_config(5, 5, true);
        assert_eq!(robert_net::params::Layout::new(&net).count(), 42_619_452);
        assert_eq!((cfg.batch, cfg.steps, cfg.lr), (512, 12_000, 7e-5));
        assert_eq!((cfg.average, cfg.self_correct, cfg.skip), (0.0, 0, SkipKind::Off));
    }

    #[test]
    fn settings_are_checked_by_name_and_type() {
        let mut cfg = TrainConfig::default();
        cfg.set("lr=2e-4").unwrap();
        cfg.set("tokens = pos+d").unwrap();
        cfg.set("mask=cl-block").unwrap();
        cfg.set("current_only=true").unwrap();
        cfg.set("steps=2.5k").unwrap();
        assert_eq!(cfg.steps, 2500);
        cfg.set("ridge_penalty=1e-6").unwrap();
        assert_eq!(cfg.ridge_penalty, Some(1e-6));
        cfg.set("select_with=+mean+ahead=2+smooth").unwrap();
        assert_eq!(cfg.selecting_policy().unwrap().label(), "robert+mean+ahead=2+smooth");
        assert_eq!((cfg.lr, cfg.tokens, cfg.current_only), (2e-4, TokenKind::PosD, true));
        let mut observing = TrainConfig::default();
        observing.set("observer=30").unwrap();
        assert_eq!(observing.observer, 30);
        for no in [
            "previous_action=true",
            "current_only=true",
            "observer=101",
            "observer=300",
            "ridge_history=28",
        ] {
            assert!(observing.set(no).unwrap_err().to_string().contains("observer"), "{no}");
        }
        let before = cfg.clone();
        for bad in
            ["lr", "learning=1", "lr=fast", "steps=1.5", "batch=0", "tokens=best", "average=1"]
                .into_iter()
                .chain([
                    "preset=ur-small",
                    "steps=2000000000000",
                    "ridge_history=31",
                    "ridge_penalty=-1",
                    "select_with=mean",
                    "select_with=:adaptive",
                    "select_with=+refine",
                    "select_with=+gain",
                    // Past actions are not learned with current_only.
                    "observer=30",
                    "select_with=+observer=30",
                ])
        {
            let e = cfg.set(bad).unwrap_err().to_string();
            assert!(e.contains(bad.split('=').next().unwrap()), "{e}");
        }
        assert_eq!(cfg, before);
    }

    #[test]
    fn sizes_are_checked_together_before_any_data() {
        for (name, _) in PRESETS {
            TrainConfig::preset(name).unwrap().check_network().unwrap();
        }
        // The first setting alone is invalid; both together are valid.
        let mut cfg = TrainConfig::default();
        cfg.set("heads=6").unwrap();
        assert!(cfg.check_network().is_err());
        cfg.set("width=96").unwrap();
        cfg.check_network().unwrap();
        for (bad, what) in [
            ("heads=5", "heads"),
            ("width=20", "width"),
            ("bins=97", "bins"),
            ("bins=4", "skip"),
            ("layers=0", "layers"),
        ] {
            let mut cfg = cfg.clone();
            cfg.set(bad).unwrap();
            let e = cfg.check_network().unwrap_err();
            assert!(matches!(e, Error::Setting { .. }), "{e}");
            assert!(e.to_string().contains(what), "{bad}: {e}");
        }
    }
}
