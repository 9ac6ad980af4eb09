//! Policies by name.

use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;

use super::computed_torque::ComputedTorque;
use super::error::Error;
use super::ilqr::{Ilqr, IlqrConfig};
use super::learned::{self, Learned, Linear};
use super::pd::Pd;
use super::policy::Policy;
use super::refine::Refined;
use super::sampling::{PredictiveSampling, SamplingConfig};
use super::shipped;
use super::zero::Zero;
use crate::fsio;
use crate::net::Model;
use crate::robot::Robot;

/// Every policy there is.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum PolicyName {
    /// No torque.
    Zero,
    /// Proportional-derivative, gains from the mass matrix.
    Pd,
    /// Inverse dynamics of the true model.
    ComputedTorque,
    /// Receding-horizon iLQR on the true model.
    Ilqr,
    /// Predictive sampling on the true model.
    PredictiveSampling,
    /// A trained network.
    Robert,
    /// The linear answer inside a model file.
    Ridge,
}

/// Names as they are typed, in the order of tables.
const NAMES: [(PolicyName, &str); 7] = [
    (PolicyName::Zero, "zero"),
    (PolicyName::Pd, "pd"),
    (PolicyName::ComputedTorque, "computed-torque"),
    (PolicyName::Ilqr, "ilqr"),
    (PolicyName::PredictiveSampling, "predictive-sampling"),
    (PolicyName::Robert, "robert"),
    (PolicyName::Ridge, "ridge"),
];

impl PolicyName {
    /// The name as it is typed.
    pub fn as_str(self) -> &'static str {
        NAMES.iter().find(|(n, _)| *n == self).map_or("", |(_, s)| s)
    }

    /// Whether it learned something, and needs the file that holds it.
    pub fn needs_model(self) -> bool {
        matches!(self, PolicyName::Robert | PolicyName::Ridge)
    }

    /// All names.
    pub fn all() -> impl Iterator<Item = PolicyName> {
        NAMES.iter().map(|(n, _)| *n)
    }
}

impl FromStr for PolicyName {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        NAMES.iter().find(|(_, s)| *s == text).map(|(n, _)| *n).ok_or_else(|| {
            Error::UnknownPolicy {
                name: text.to_owned(),
                known: NAMES.iter().map(|(_, s)| *s).collect::<Vec<_>>().join(", "),
            }
        })
    }
}

/// What fills masked frames before a policy sees them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Guide {
    /// Nothing: the policy sees the mask.
    #[default]
    None,
    /// The straight line from the reached state to the next goal.
    Linear,
}

/// A policy as asked for on the command line.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PolicyConfig {
    /// Which.
    pub name: PolicyName,
    /// Virtual commands through masks.
    pub guide: Guide,
    /// Improve each action on the model.
    pub refine: bool,
    /// Model or fit file, or the name of a shipped model, for policies that learned
    /// something; nothing is the robot's shipped default.
    pub model_path: Option<PathBuf>,
}

impl PolicyConfig {
    /// This policy with default options.
    pub fn new(name: PolicyName) -> PolicyConfig {
        PolicyConfig { name, guide: Guide::None, refine: false, model_path: None }
    }

    /// The name that tables show: `pd`, `pd+guide`, `robert+refine`.
    pub fn label(&self) -> String {
        let guide = if self.guide == Guide::Linear { "+guide" } else { "" };
        let refine = if self.refine { "+refine" } else { "" };
        format!("{}{guide}{refine}", self.name.as_str())
    }

    /// What performs a robot when nothing else is asked for: its shipped model, else
    /// computed torque, which needs no data.
    pub fn default_for(robot: &Robot) -> PolicyConfig {
        let learned = shipped::has_default(robot);
        PolicyConfig::new(if learned { PolicyName::Robert } else { PolicyName::ComputedTorque })
    }

    /// The model that is meant: a file or run directory, else a shipped one by its name.
    fn model(&self, robot: &Robot) -> Result<Arc<Model>, Error> {
        let policy = self.name.as_str();
        let Some(path) = &self.model_path else {
            let needs = || format!("a model file or run directory: {policy}:PATH");
            return shipped::get(robot, shipped::DEFAULT)?
                .ok_or_else(|| Error::Needs { policy: policy.to_owned(), needs: needs() });
        };
        let shipped = path.to_str().filter(|name| !name.contains('/') && !path.exists());
        match shipped.map(|name| shipped::get(robot, name)).transpose()?.flatten() {
            Some(model) => Ok(model),
            None => Ok(Arc::new(learned::load(robot, Path::new(path))?)),
        }
    }

    /// Name, without its folder, and sha-256 of the model file that [`PolicyConfig::build`]
    /// reads; `None` for policies that learned nothing.
    ///
    /// # Errors
    /// [`Error::Model`] when it cannot be read.
    pub fn model_file(&self, robot: &Robot) -> Result<Option<(String, String)>, Error> {
        if !self.name.needs_model() {
            return Ok(None);
        }
        let named = match &self.model_path {
            None => Some(shipped::DEFAULT),
            Some(path) => path.to_str().filter(|name| !name.contains('/') && !path.exists()),
        };
        if let Some(name) = named
            && let Some(sha256) = shipped::sha256(robot, name)?
        {
            return Ok(Some((format!("{name}.safetensors"), sha256)));
        }
        let Some(path) = self.model_path.as_deref().map(learned::model_path) else {
            return Ok(None);
        };
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let sha256 = fsio::sha256_file(&path).map_err(crate::net::Error::from)?;
        Ok(Some((name, sha256)))
    }

    /// The settings that [`PolicyConfig::build`] uses for this robot; null where there are
    /// none.
    pub fn settings(&self, robot: &Robot) -> serde_json::Value {
        // Structs of numbers: serialising cannot fail.
        let ilqr = || serde_json::to_value(IlqrConfig::for_robot(robot)).unwrap_or_default();
        let own = match self.name {
            PolicyName::Ilqr => ilqr(),
            PolicyName::PredictiveSampling => {
                serde_json::to_value(SamplingConfig::default()).unwrap_or_default()
            }
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

    /// Builds it for this robot.
    ///
    /// # Errors
    /// Whatever the policy needs and does not find.
    pub fn build(&self, robot: &Arc<Robot>) -> Result<Box<dyn Policy>, Error> {
        let policy: Box<dyn Policy> = match self.name {
            PolicyName::Zero => Box::new(Zero),
            PolicyName::Pd => Box::new(Pd::new(robot)?),
            PolicyName::ComputedTorque => Box::new(ComputedTorque::new(robot)?),
            PolicyName::Ilqr => Box::new(Ilqr::new(robot, &IlqrConfig::for_robot(robot))?),
            PolicyName::PredictiveSampling => {
                Box::new(PredictiveSampling::new(robot, &SamplingConfig::default())?)
            }
            PolicyName::Robert => {
                let model = Arc::unwrap_or_clone(self.model(robot)?);
                Box::new(Learned::new(model, crate::net::PolicyConfig::default())?)
            }
            PolicyName::Ridge => {
                let model = self.model(robot)?;
                Box::new(Linear::new(model.encoder.clone())?.with_card(&model.card))
            }
        };
        Ok(if self.refine { Box::new(Refined::new(robot, policy)?) } else { policy })
    }
}
