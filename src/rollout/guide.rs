//! The guide: the rule that fills masked frames.

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
    /// A smooth curve from goal to goal through the whole gap, planned before the rollout; in dropouts of a recording
    /// the most likely motion.
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
