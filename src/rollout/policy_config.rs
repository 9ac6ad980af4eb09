//! A policy as it is named and built.

use robert_base::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::adaptive_computed_torque::AdaptiveComputedTorque;
use super::computed_torque::ComputedTorque;
use super::error::Error;
use super::fitted::FitKind;
use super::guide::Guide;
use super::ilqr::{Ilqr, IlqrConfig};
use super::inference::Inference;
use super::inverse::Inverse;
use super::linear::Linear;
use super::model_file;
use super::nearest::Nearest;
use super::pd::Pd;
use super::policy::Policy;
use super::policy_name::PolicyName;
use super::random::Random;
use super::refine::Refined;
use super::sampling::{PredictiveSampling, SamplingConfig};
use super::shipped;
use super::zero::Zero;
use robert_base::{fsio, limits};
use robert_net::Model;
use robert_robot::Robot;

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
    let (models, runs) = (shipped::of(robot), model_file::runs_near(path));
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
        let Inference { ensemble, sample, mean, masks, ahead, gain, observer, .. } = self.inference;
        let sample = if sample { "+sample" } else { "" };
        let mean = if mean { "+mean" } else { "" };
        let masks = if masks { "+masks" } else { "" };
        let gain = if gain { "+gain" } else { "" };
        let ensemble = if ensemble > 1 { format!("+ensemble={ensemble}") } else { String::new() };
        let ahead = if ahead > 0 { format!("+ahead={ahead}") } else { String::new() };
        let observer = observer.map(|n| format!("+observer={n}")).unwrap_or_default();
        let model = model.map(|m| format!(":{m}")).unwrap_or_default();
        let of_network = format!("{sample}{mean}{masks}{gain}{observer}{ahead}{ensemble}");
        format!("{}{model}{of_network}{guide}{refine}{ilc}", self.name.as_str())
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
            None => Ok(Arc::new(model_file::load(robot, path)?)),
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
            _ => Some(model_file::model_path(path)),
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
                Box::new(self.inference.network(model)?)
            }
            PolicyName::Ridge => {
                let model = self.model(robot)?;
                let linear = Linear::new(model.encoder.clone())?.with_card(&model.card);
                let linear = linear.with_gain(self.inference.gain);
                Box::new(linear.with_observer(self.inference.observer)?)
            }
            PolicyName::Nearest => {
                Box::new(Nearest::open(self.needed_path()?, &model_file::robot_card(robot))?)
            }
            PolicyName::MlpInverse => {
                let path = self.needed_path()?;
                let path = self.file().unwrap_or_else(|| path.to_owned());
                Box::new(Inverse::load(&path, Some(&model_file::robot_card(robot)))?)
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
}
