//! Policies by name.

use std::path::PathBuf;
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
use super::zero::Zero;
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
    /// Model or fit file, for policies that learned something.
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

    fn needed_path(&self) -> Result<&std::path::Path, Error> {
        self.model_path.as_deref().ok_or_else(|| Error::Needs {
            policy: self.name.as_str().to_owned(),
            needs: format!("a model file or run directory: {}:PATH", self.name.as_str()),
        })
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
                let model = learned::load(robot, self.needed_path()?)?;
                Box::new(Learned::new(model, crate::net::PolicyConfig::default())?)
            }
            PolicyName::Ridge => {
                Box::new(Linear::new(learned::load(robot, self.needed_path()?)?.encoder)?)
            }
        };
        Ok(if self.refine { Box::new(Refined::new(robot, policy)?) } else { policy })
    }
}
