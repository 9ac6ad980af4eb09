//! The slope of a cubic curve at a key, for one joint.
//!
//! Curves are cubic Hermite curves. A key without a tangent for a joint has the automatic slope of
//! [`mod@crate::compile`], which never overshoots. A tangent replaces it, either on both sides or
//! separately on each. Slopes are in rad/s or m/s, so that a curve keeps its shape when its keys
//! move in time.

use serde::{Deserialize, Serialize};

use super::grid::round;

/// The slope of one joint at one key. A joint without a tangent has the automatic slope.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(untagged)]
pub enum Tangent {
    /// A slope by its name.
    Named(TangentName),
    /// The same slope before and after the key, rad/s or m/s.
    Slope(#[schemars(range(min = -1e6, max = 1e6))] f64),
    /// Two slopes, so that the curve has a corner at the key.
    Corner(Corner),
}

/// A slope that needs no number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum TangentName {
    /// Slope 0: the joint rests for a moment.
    Flat,
    /// On each side the slope of the straight line to the neighbouring key.
    Linear,
}

/// The slopes before and after a key.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Corner {
    /// The slope with which the curve arrives, rad/s or m/s.
    #[serde(rename = "in")]
    #[schemars(range(min = -1e6, max = 1e6))]
    pub before: f64,
    /// The slope with which it leaves, rad/s or m/s.
    #[serde(rename = "out")]
    #[schemars(range(min = -1e6, max = 1e6))]
    pub after: f64,
}

impl Tangent {
    /// Slope 0.
    pub const FLAT: Tangent = Tangent::Named(TangentName::Flat);
    /// The slope of the straight line to the neighbour, on each side.
    pub const LINEAR: Tangent = Tangent::Named(TangentName::Linear);

    /// Different slopes before and after the key, rad/s or m/s.
    pub fn corner(before: f64, after: f64) -> Tangent {
        Tangent::Corner(Corner { before, after })
    }

    /// The slope at the end of the interval before the key; `line` is the slope of the straight line
    /// across this interval. All in rad/s or m/s.
    pub fn before(self, line: f64) -> f64 {
        match self {
            Tangent::Corner(c) => c.before,
            other => other.after(line),
        }
    }

    /// The slope at the beginning of the interval after the key; as [`Tangent::before`].
    pub fn after(self, line: f64) -> f64 {
        match self {
            Tangent::Named(TangentName::Flat) => 0.0,
            Tangent::Named(TangentName::Linear) => line,
            Tangent::Slope(slope) => slope,
            Tangent::Corner(c) => c.after,
        }
    }

    /// The typed slopes, rad/s or m/s; `None` if the tangent has a name.
    pub fn typed(self) -> Option<[f64; 2]> {
        match self {
            Tangent::Named(_) => None,
            Tangent::Slope(slope) => Some([slope; 2]),
            Tangent::Corner(c) => Some([c.before, c.after]),
        }
    }

    /// The same tangent with each typed slope changed.
    #[must_use]
    pub fn map(self, change: impl Fn(f64) -> f64) -> Tangent {
        match self {
            Tangent::Named(_) => self,
            Tangent::Slope(slope) => Tangent::Slope(change(slope)),
            Tangent::Corner(c) => Tangent::corner(change(c.before), change(c.after)),
        }
    }

    /// The same tangent, with slope 0 after the key. A named one has it if the next key has the same value.
    #[must_use]
    pub(crate) fn into_rest(self) -> Tangent {
        self.typed().map_or(self, |[before, _]| Tangent::corner(before, 0.0))
    }

    /// On the document's grid, and one number if both slopes are equal.
    pub(crate) fn normal(self) -> Tangent {
        match self.map(round) {
            Tangent::Corner(c) if c.before == c.after => Tangent::Slope(c.before),
            other => other,
        }
    }

    /// Its text in the file.
    pub(crate) fn text(self) -> String {
        match self {
            Tangent::Named(TangentName::Flat) => "\"flat\"".to_owned(),
            Tangent::Named(TangentName::Linear) => "\"linear\"".to_owned(),
            Tangent::Slope(slope) => slope.to_string(),
            Tangent::Corner(c) => format!("{{\"in\": {}, \"out\": {}}}", c.before, c.after),
        }
    }
}
