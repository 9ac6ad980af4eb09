//! Policies by name.

use robert_base::json;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;

use super::adaptive_computed_torque::AdaptiveComputedTorque;
use super::computed_torque::ComputedTorque;
use super::error::Error;
use super::fitted::FitKind;
use super::ilqr::{Ilqr, IlqrConfig};
use super::inverse::Inverse;
use super::learned::{self, Learned, Linear};
use super::nearest::Nearest;
use super::pd::Pd;
use super::policy::Policy;
use super::random::Random;
use super::refine::Refined;
use super::sampling::{PredictiveSampling, SamplingConfig};
use super::shipped;
use super::zero::Zero;
use robert_base::{fsio, limits};
use robert_net::{Card, MaskGranularity, Model, SkipKind, Threads};
use robert_robot::Robot;

/// All policies.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize,
)]
#[serde(rename_all = "kebab-case")]
#[derive(schemars::JsonSchema)]
pub enum PolicyName {
    /// No torque.
    Zero,
    /// A new random action in every frame.
    Random,
    /// Proportional-derivative, gains from the mass matrix.
    Pd,
    /// Inverse dynamics of the true model.
    ComputedTorque,
    /// Inverse dynamics of a model whose mass, damping and motor strength are identified.
    AdaptiveComputedTorque,
    /// Receding-horizon iLQR on the true model.
    Ilqr,
    /// Predictive sampling on the true model.
    PredictiveSampling,
    /// A trained network.
    Robert,
    /// The linear prediction inside a model file.
    Ridge,
    /// The actions of the most similar recorded moments.
    Nearest,
    /// A small network of three frames.
    MlpInverse,
    /// The best of several on the given clip; see [`super::Contenders`].
    Auto,
}

/// The name to type for each policy, its argument and a description, in the order of tables.
const NAMES: [(PolicyName, &str, &str, &str); 12] = {
    use PolicyName as P;
    [
        (
            P::Auto,
            "auto",
            "[:MODEL]",
            "the best of several policies, by simulation, with corrected goals",
        ),
        (P::Zero, "zero", "", "no torque"),
        (P::Random, "random", "", "a new random action in every frame"),
        (P::Pd, "pd", "", "proportional-derivative control, joint by joint"),
        (P::ComputedTorque, "computed-torque", "", "inverse dynamics of the robot's model"),
        (
            P::AdaptiveComputedTorque,
            "adaptive-computed-torque",
            "",
            "the same; infers mass, damping and motor strength from the past motion",
        ),
        (P::Ilqr, "ilqr", "", "receding-horizon optimal control on the model"),
        (P::PredictiveSampling, "predictive-sampling", "", "random search about pd, on the model"),
        (
            P::Robert,
            "robert",
            "[:MODEL]",
            "a trained network: file, run directory or built-in name",
        ),
        (
            P::Ridge,
            "ridge",
            "[:MODEL]",
            "the linear prediction inside such a model, or a robert fit",
        ),
        (
            P::Nearest,
            "nearest",
            ":PATH",
            "the actions of the most similar recorded moments: data or fit",
        ),
        (P::MlpInverse, "mlp-inverse", ":PATH", "a small inverse model that robert fit makes"),
    ]
};

impl PolicyName {
    /// Cases in which the policy is best, in a few words; measured in `docs/models.md` and
    /// `docs/baselines.md`.
    pub fn suits(self) -> &'static str {
        match self {
            PolicyName::Zero => "seeing what gravity alone does",
            PolicyName::Random => "comparison: the error of a policy that has learned nothing",
            PolicyName::Pd => "slow motion with a goal in every frame",
            PolicyName::ComputedTorque => "an accurate robot model and goals close together",
            PolicyName::AdaptiveComputedTorque => {
                "a robot model whose mass, damping or motor strength is wrong"
            }
            PolicyName::Ilqr => "an accurate robot model and goals far apart (slow)",
            PolicyName::PredictiveSampling => "an accurate robot model and contact (slow)",
            PolicyName::Robert => "goals far apart, little damping, an inaccurate robot model",
            PolicyName::Ridge => "nearly linear robots, or seconds of recorded motion",
            PolicyName::Nearest => "comparison: shows what the recorded motion already contains",
            PolicyName::MlpInverse => "a goal in every frame, an inaccurate robot model",
            PolicyName::Auto => {
                "any clip: tries several policies, repeats the best and corrects their goals"
            }
        }
    }

    /// The name as it is typed.
    pub fn as_str(self) -> &'static str {
        NAMES.iter().find(|n| n.0 == self).map_or("", |n| n.1)
    }

    /// Whether it needs a file with what it learned.
    pub fn needs_model(self) -> bool {
        matches!(
            self,
            PolicyName::Robert | PolicyName::Ridge | PolicyName::Nearest | PolicyName::MlpInverse
        )
    }

    /// All names.
    pub fn all() -> impl Iterator<Item = PolicyName> {
        NAMES.iter().map(|n| n.0)
    }

    /// The usage and description of each policy, for help texts.
    pub fn usages() -> impl Iterator<Item = (String, &'static str)> {
        NAMES.iter().map(|(_, name, argument, what)| (format!("{name}{argument}"), *what))
    }
}

impl FromStr for PolicyName {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        NAMES.iter().find(|n| n.1 == text).map(|n| n.0).ok_or_else(|| Error::UnknownPolicy {
            name: text.to_owned(),
            known: NAMES.iter().map(|n| n.1).collect::<Vec<_>>().join(", "),
        })
    }
}

/// A policy that is available for a robot.
#[derive(
    Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema,
)]
pub struct Offer {
    /// The policy's name.
    pub name: PolicyName,
    /// Name of the model, if it is not the robot's default one.
    pub model: Option<String>,
    /// Cases in which it is best, in a few words.
    pub suits: String,
    /// The guide that should fill masked frames for it.
    pub guide: Guide,
    /// What is missing before it can be chosen; `None` if nothing is.
    pub needs: Option<String>,
    /// Whether it computes with the robot's model.
    pub knows_model: bool,
    /// Whether it needs seconds for a clip.
    pub slow: bool,
    /// The masks that it accepts: for a learned policy those it was trained with, for all others
    /// any.
    pub masks: MaskGranularity,
    /// Whether it is the robot's default.
    pub default: bool,
}

/// All policies for a robot, including models. All pages and tables use this list.
pub fn offers(robot: &Robot) -> Vec<Offer> {
    let offer = |name: PolicyName| Offer {
        name,
        model: None,
        suits: name.suits().to_owned(),
        guide: Guide::None,
        knows_model: matches!(
            name,
            PolicyName::Auto
                | PolicyName::ComputedTorque
                | PolicyName::AdaptiveComputedTorque
                | PolicyName::Ilqr
                | PolicyName::PredictiveSampling
        ),
        slow: matches!(name, PolicyName::Ilqr | PolicyName::PredictiveSampling),
        needs: None,
        masks: MaskGranularity::Joint,
        default: name == PolicyName::Auto,
    };
    let mut list = Vec::new();
    for name in PolicyName::all() {
        if !name.needs_model() {
            list.push(offer(name));
            continue;
        }
        match shipped::get(robot, shipped::DEFAULT) {
            Ok(Some(model)) => {
                let masks = model.card.masks();
                // A network's file need not contain the linear prediction.
                let lacks = name == PolicyName::Ridge && model.encoder.ridge.is_none();
                let needs = match name {
                    PolicyName::Nearest => Some("recorded motion: name the dataset"),
                    PolicyName::MlpInverse => Some("a fit: name its file or dataset"),
                    _ => lacks.then_some("a model with a linear prediction in it"),
                };
                let needs = needs.map(str::to_owned);
                let (suits, guide) = match name {
                    PolicyName::Robert => case(&model.card),
                    _ => (name.suits(), Guide::None),
                };
                let suits = suits.to_owned();
                list.push(Offer { suits, guide, needs, masks, ..offer(name) });
            }
            Ok(None) => {
                let needs = Some(format!(
                    "there is no built-in model for {}: train one, or name its file",
                    robot.id()
                ));
                list.push(Offer { needs, ..offer(name) });
            }
            Err(e) => list.push(Offer { needs: Some(e.to_string()), ..offer(name) }),
        }
    }
    for name in shipped::of(robot).into_iter().filter(|n| n != shipped::DEFAULT) {
        let Ok(Some(model)) = shipped::get(robot, &name) else { continue };
        let masks = model.card.masks();
        let (suits, guide) = case(&model.card);
        let suits = suits.to_owned();
        let named = Offer { model: Some(name), suits, guide, masks, ..offer(PolicyName::Robert) };
        list.push(Offer { default: false, ..named });
    }
    list
}

/// Cases in which a trained network is best, and the guide that should fill masked frames for it;
/// measured in `docs/models.md`.
pub fn case(card: &Card) -> (&'static str, Guide) {
    if card.tokens.previous_action {
        // Small steps reveal the plant, and the guide divides wide gaps into small steps.
        let suits = "an unknown payload, damping or motor strength; turns the guide on";
        (suits, Guide::Linear)
    } else if card.net.skip == SkipKind::Off {
        ("comparison: the network as in the paper, without the linear prediction", Guide::None)
    } else {
        (PolicyName::Robert.suits(), Guide::None)
    }
}

/// The rule that fills masked frames before a policy sees them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
#[derive(schemars::JsonSchema)]
pub enum Guide {
    /// Nothing: the policy sees the mask.
    #[default]
    None,
    /// The straight line from the reached state to the next goal, drawn anew in every frame.
    Linear,
    /// A smooth curve from goal to goal through the whole gap, planned before the rollout.
    Smooth,
}

impl Guide {
    /// The option after a policy's name; empty without a guide.
    pub fn suffix(self) -> &'static str {
        match self {
            Guide::None => "",
            Guide::Linear => "+guide",
            Guide::Smooth => "+smooth",
        }
    }
}

/// How a trained network is used; other policies ignore it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Inference {
    /// Windows whose predictions for the current frame are averaged; 1 is off, 21 at most.
    pub ensemble: usize,
    /// Draw the action bin (as in the paper) instead of using the most likely one.
    pub sample: bool,
    /// Leave masked frames to the network, even if its file contains data to fill gaps.
    pub masks: bool,
    /// Scale the linear prediction by the ratio of applied to predicted actions in the past; for
    /// `ridge`.
    pub gain: bool,
    /// Threads that share one window; the action is the same to the last bit.
    pub threads: Threads,
}

impl Default for Inference {
    fn default() -> Self {
        Inference { ensemble: 1, sample: false, masks: false, gain: false, threads: Threads::One }
    }
}

/// Labels for policies in one table. If two would be equal, their files distinguish them.
pub(super) fn labels(policies: &[PolicyConfig]) -> Vec<String> {
    let short: Vec<String> = policies.iter().map(PolicyConfig::label).collect();
    let twice = |label: &String| short.iter().filter(|l| *l == label).count() > 1;
    let long = |p: &PolicyConfig| p.labelled(p.model_path.as_deref().and_then(Path::to_str));
    let each = policies.iter().zip(&short);
    each.map(|(p, label)| if twice(label) { long(p) } else { label.clone() }).collect()
}

/// The error for an unknown file, run or model, with the existing names.
fn unknown(robot: &Robot, path: &Path) -> Error {
    let listed = |what: &str, names: &[String]| match names {
        [] => format!("no {what}"),
        names => format!("the {what} {}", names.join(", ")),
    };
    let (models, runs) = (shipped::of(robot), learned::runs_near(path));
    Error::UnknownModel {
        robot: robot.id().to_owned(),
        name: path.display().to_string(),
        known: format!("{} and {}", listed("models", &models), listed("runs", &runs)),
    }
}

/// A policy as named on the command line.
///
/// ```
/// use std::sync::Arc;
///
/// use robert_robot::Robot;
/// use robert_rollout::{PolicyConfig, PolicyName};
///
/// let robot = Arc::new(Robot::builtin("ur5e")?);
/// let refined = PolicyConfig { refine: true, ..PolicyConfig::new(PolicyName::Pd) };
/// assert_eq!(refined.build(&robot)?.name(), "pd+refine");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PolicyConfig {
    /// The policy's name.
    pub name: PolicyName,
    /// The rule that fills masked frames.
    pub guide: Guide,
    /// Improve each action on the model.
    pub refine: bool,
    /// Repeat the clip in simulation, moving the goals by what was missed (iterative learning
    /// control), then search for something better where joints stay away.
    #[serde(default)]
    pub ilc: bool,
    /// Model or fit file, or the name of a shipped model, for learned policies; `None` is the
    /// robot's shipped default.
    pub model_path: Option<PathBuf>,
    /// The use of a trained network.
    #[serde(default)]
    pub inference: Inference,
}

impl PolicyConfig {
    /// This policy with default options.
    pub fn new(name: PolicyName) -> PolicyConfig {
        PolicyConfig {
            name,
            guide: Guide::None,
            refine: false,
            ilc: false,
            model_path: None,
            inference: Inference::default(),
        }
    }

    /// The policy that measures floors; see [`super::floor`].
    pub fn floor() -> PolicyConfig {
        PolicyConfig::new(PolicyName::Ilqr)
    }

    /// Whether it is found by trying policies on the clip; see [`super::Contenders`].
    pub fn is_tried(&self) -> bool {
        self.name == PolicyName::Auto || self.ilc
    }

    /// Whether it is fast enough for a search of thousands of frames.
    pub(super) fn is_fast(&self) -> bool {
        let slow = [PolicyName::Ilqr, PolicyName::PredictiveSampling, PolicyName::Nearest];
        !self.refine && !slow.contains(&self.name)
    }

    /// The label in tables: `pd`, `pd+guide`, `robert:adaptive+ensemble=3+refine`. It does not
    /// contain files or folders; see `labels`.
    pub fn label(&self) -> String {
        self.labelled(self.model_name())
    }

    /// The model's name, if it was given by name; an existing file or folder is a path.
    fn model_name(&self) -> Option<&str> {
        let path = self.model_path.as_deref()?;
        path.to_str().filter(|name| !name.contains('/') && !path.exists())
    }

    fn labelled(&self, model: Option<&str>) -> String {
        let guide = self.guide.suffix();
        let ilc = if self.ilc { "+ilc" } else { "" };
        let refine = if self.refine { "+refine" } else { "" };
        let Inference { ensemble, sample, masks, gain, .. } = self.inference;
        let sample = if sample { "+sample" } else { "" };
        let masks = if masks { "+masks" } else { "" };
        let gain = if gain { "+gain" } else { "" };
        let ensemble = if ensemble > 1 { format!("+ensemble={ensemble}") } else { String::new() };
        let model = model.map(|m| format!(":{m}")).unwrap_or_default();
        format!("{}{model}{sample}{masks}{gain}{ensemble}{guide}{refine}{ilc}", self.name.as_str())
    }

    /// The policy of a robot where one must do, without the trials of `auto`: the one that its folder
    /// names, else its shipped model, else computed torque, which needs no data.
    ///
    /// # Errors
    /// [`Error::Model`]: a model that is damaged or of another robot, or a folder that names no policy.
    pub fn default_for(robot: &Robot) -> Result<PolicyConfig, Error> {
        if let Some(file) = robot.folder().map(shipped::choice_in).filter(|p| p.is_file()) {
            let text = fsio::read_capped(&file, limits::NAME_BYTES as u64)
                .map_err(robert_net::Error::from)?;
            let name = String::from_utf8_lossy(&text).trim().parse();
            let bad = |e: Error| robert_net::Error::File { why: e.to_string(), path: file.clone() };
            return Ok(PolicyConfig::new(name.map_err(bad)?));
        }
        let learned = shipped::has_default(robot)?;
        Ok(PolicyConfig::new(if learned { PolicyName::Robert } else { PolicyName::ComputedTorque }))
    }

    /// The model to use: a file or run directory, or else a shipped model by its name.
    pub(super) fn model(&self, robot: &Robot) -> Result<Arc<Model>, Error> {
        let policy = self.name.as_str();
        let Some(path) = &self.model_path else {
            let maker = if self.name == PolicyName::Ridge { "fit ridge" } else { "train" };
            let needs = || format!("a model: robert {maker} makes one, then {policy}:PATH");
            return shipped::get(robot, shipped::DEFAULT)?
                .ok_or_else(|| Error::Needs { policy: policy.to_owned(), needs: needs() });
        };
        match self.model_name().map(|name| shipped::get(robot, name)).transpose()?.flatten() {
            Some(model) => Ok(model),
            None if !path.exists() => Err(unknown(robot, path)),
            None => Ok(Arc::new(learned::load(robot, path)?)),
        }
    }

    /// Name, without its folder, and sha-256 of the model file that [`PolicyConfig::build`]
    /// reads; `None` for policies without a model.
    ///
    /// # Errors
    /// [`Error::Model`] when it cannot be read.
    pub fn model_file(&self, robot: &Robot) -> Result<Option<(String, String)>, Error> {
        if !self.name.needs_model() {
            return Ok(None);
        }
        let named = match &self.model_path {
            None => Some(shipped::DEFAULT),
            Some(_) => self.model_name(),
        };
        if let Some(name) = named
            && let Some(sha256) = shipped::sha256(robot, name)?
        {
            return Ok(Some((format!("{name}.safetensors"), sha256)));
        }
        let Some(path) = self.file() else { return Ok(None) };
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let sha256 = fsio::sha256_file(&path).map_err(robert_net::Error::from)?;
        Ok(Some((name, sha256)))
    }

    /// The settings that [`PolicyConfig::build`] uses for this robot; null if there are none.
    pub fn settings(&self, robot: &Robot) -> serde_json::Value {
        // Structs of numbers: serialising cannot fail.
        let ilqr = || json::value(IlqrConfig::for_robot(robot));
        let own = match self.name {
            PolicyName::Ilqr => ilqr(),
            PolicyName::PredictiveSampling => json::value(SamplingConfig::for_robot(robot)),
            _ => serde_json::Value::Null,
        };
        match (own, self.refine) {
            (own, false) => own,
            (serde_json::Value::Object(mut own), true) => {
                own.insert("refine".to_owned(), ilqr());
                own.into()
            }
            (_, true) => serde_json::json!({ "refine": ilqr() }),
        }
    }

    fn needed_path(&self) -> Result<&Path, Error> {
        self.model_path.as_deref().ok_or_else(|| {
            let name = self.name.as_str();
            let data = if self.name == PolicyName::Nearest { " or a dataset" } else { "" };
            Error::Unnamed {
                policy: name.to_owned(),
                needs: format!(
                    "a fit{data}: robert fit {name} --data DIR, then --policy {name}:PATH"
                ),
            }
        })
    }

    /// The file of [`PolicyConfig::model_path`]; for a folder, the file inside that is read. `None`
    /// for policies without a model, and for shipped models.
    pub fn file(&self) -> Option<PathBuf> {
        let path = self.model_path.as_deref()?;
        let inside = |name: &str| Some(path.join(name)).filter(|p| p.exists());
        let found = match self.name {
            PolicyName::Nearest => {
                inside(FitKind::Nearest.file()).or_else(|| inside("manifest.json"))
            }
            PolicyName::MlpInverse => inside(FitKind::MlpInverse.file()),
            _ => Some(learned::model_path(path)),
        };
        Some(found.unwrap_or_else(|| path.to_owned())).filter(|p| p.is_file())
    }

    /// Builds it for this robot.
    ///
    /// # Errors
    /// Anything that the policy needs and does not find.
    pub fn build(&self, robot: &Arc<Robot>) -> Result<Box<dyn Policy>, Error> {
        if self.is_tried() {
            let needs = "a clip on which it is tried; here, name a policy, without +ilc".to_owned();
            return Err(Error::Needs { policy: self.label(), needs });
        }
        let policy: Box<dyn Policy> = match self.name {
            PolicyName::Auto => unreachable!("auto is tried on a clip"),
            PolicyName::Zero => Box::new(Zero),
            PolicyName::Random => Box::new(Random::default()),
            PolicyName::Pd => Box::new(Pd::new(robot)?),
            PolicyName::ComputedTorque => Box::new(ComputedTorque::new(robot)?),
            PolicyName::AdaptiveComputedTorque => Box::new(AdaptiveComputedTorque::new(robot)?),
            PolicyName::Ilqr => Box::new(Ilqr::new(robot, &IlqrConfig::for_robot(robot))?),
            PolicyName::PredictiveSampling => {
                Box::new(PredictiveSampling::new(robot, &SamplingConfig::for_robot(robot))?)
            }
            PolicyName::Robert => {
                let model = Arc::unwrap_or_clone(self.model(robot)?);
                let Inference { ensemble, sample, masks, threads, .. } = self.inference;
                let options = robert_net::NetPolicyConfig {
                    ensemble,
                    sample_bins: sample,
                    threads,
                    ..robert_net::NetPolicyConfig::default()
                };
                Box::new(Learned::new(model, options)?.with_masks(masks))
            }
            PolicyName::Ridge => {
                let model = self.model(robot)?;
                let linear = Linear::new(model.encoder.clone())?.with_card(&model.card);
                Box::new(linear.with_gain(self.inference.gain))
            }
            PolicyName::Nearest => {
                Box::new(Nearest::open(self.needed_path()?, &learned::robot_card(robot))?)
            }
            PolicyName::MlpInverse => {
                let path = self.needed_path()?;
                let path = self.file().unwrap_or_else(|| path.to_owned());
                Box::new(Inverse::load(&path, Some(&learned::robot_card(robot)))?)
            }
        };
        Ok(if self.refine { Box::new(Refined::new(robot, policy)?) } else { policy })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_side_by_side_are_told_apart() {
        let of = |path: Option<&str>| PolicyConfig {
            model_path: path.map(PathBuf::from),
            ..PolicyConfig::new(PolicyName::Robert)
        };
        let alone = [of(Some("runs/a"))];
        assert_eq!(labels(&alone), ["robert"]);
        let pd = PolicyConfig { guide: Guide::Linear, ..PolicyConfig::new(PolicyName::Pd) };
        let many = [of(None), of(Some("adaptive")), of(Some("runs/a")), of(Some("runs/b")), pd];
        let named = ["robert", "robert:adaptive", "robert:runs/a", "robert:runs/b", "pd+guide"];
        assert_eq!(labels(&many), named);
    }

    #[test]
    fn a_model_that_sees_the_past_wants_the_guide() {
        let offers = offers(&Robot::builtin("pointmass").unwrap());
        let guided = offers.iter().filter(|o| o.guide == Guide::Linear);
        let models: Vec<_> = guided.map(|o| o.model.as_deref()).collect();
        assert_eq!(models, [Some("adaptive")]);
        assert!(offers.iter().any(|o| o.default && o.guide == Guide::None));
    }
}
