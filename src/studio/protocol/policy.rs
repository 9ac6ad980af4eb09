//! Policies that can be chosen.

use serde::Serialize;

use robert_rollout::{Guide, Offer, PolicyName};

/// A policy to choose.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct PolicyCard {
    /// Name, as on the command line.
    pub name: PolicyName,
    /// The name of the model, unless it is the robot's default: `model_path` of
    /// `RolloutSettings`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    /// The case that it is best for.
    pub suits: String,
    /// The guide that should fill masked frames for it.
    pub guide: Guide,
    /// Whether it computes with the robot's own model.
    pub knows_model: bool,
    /// Whether it plans for so long that a clip takes seconds.
    pub slow: bool,
    /// Whether it can be chosen for this robot without a model file given by the user.
    pub available: bool,
    /// The missing part that it needs, if it cannot be chosen.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub why: Option<String>,
    /// Whether the policy is learned, so that another model file can be given for it.
    pub learned: bool,
    /// Whether it performs if no policy is chosen.
    pub default: bool,
}

/// All policies, with their availability for this robot.
pub fn policies(offers: &[Offer]) -> Vec<PolicyCard> {
    let card = |o: &Offer| PolicyCard {
        name: o.name,
        model: o.model.clone(),
        suits: o.suits.clone(),
        guide: o.guide,
        knows_model: o.knows_model,
        slow: o.slow,
        available: o.needs.is_none(),
        why: o.needs.clone(),
        learned: o.name.needs_model(),
        default: o.default,
    };
    offers.iter().map(card).collect()
}
