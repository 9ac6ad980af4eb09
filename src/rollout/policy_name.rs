//! The name of a policy.

use std::str::FromStr;

use super::error::Error;

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
