//! The simulated plant, which may differ from the robot's file.
//!
//! A planner that owns the exact simulator looks too good in a comparison, and a policy that
//! learned from one plant cannot recognise another by its motion. [`PlantConfig`] is one plant;
//! [`PlantRange`] is a range from which plants are drawn, for collection and for evaluation.

use std::sync::Arc;

use super::{Error, Robot};
use robert_base::rng::{Rng, Stream};
use robert_mujoco::Model;

/// The simulated plant relative to the robot's file, as factors; 1 is no change.
///
/// ```
/// use robert_robot::PlantConfig;
///
/// let heavier: PlantConfig = "mass=1.25,damping=1.5".parse()?;
/// assert_ne!(heavier, PlantConfig::default());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PlantConfig {
    /// Factor on every mass and inertia.
    pub mass: f64,
    /// Factor on joint damping.
    pub damping: f64,
    /// Factor on the force per control.
    pub gear: f64,
}

impl Default for PlantConfig {
    fn default() -> Self {
        PlantConfig { mass: 1.0, damping: 1.0, gear: 1.0 }
    }
}

impl PlantConfig {
    /// Whether this is the robot of the file.
    pub fn is_nominal(&self) -> bool {
        *self == PlantConfig::default()
    }

    /// The model of this plant; the robot's own if nothing differs.
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub fn model(&self, robot: &Robot) -> Result<Arc<Model>, Error> {
        if self.is_nominal() {
            return Ok(Arc::clone(robot.model()));
        }
        let mut model = robot.model().duplicate()?;
        if self.mass != 1.0 {
            model.scale_mass(self.mass)?;
        }
        model.scale_damping(self.damping);
        model.scale_gear(self.gear);
        Ok(Arc::new(model))
    }
}

impl std::str::FromStr for PlantConfig {
    type Err = Error;

    /// Reads `mass=1.25,damping=1.5,gear=0.85`; each factor within 0.01 to 100.
    fn from_str(text: &str) -> Result<Self, Error> {
        let range: PlantRange = text.parse()?;
        range.single().ok_or_else(|| Error::Plant {
            text: text.to_owned(),
            problem: "expected one plant, not a range".to_owned(),
        })
    }
}

impl std::fmt::Display for PlantConfig {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        PlantRange::from(*self).fmt(f)
    }
}

/// A range of plants: least and greatest factor, log-uniform between them.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlantRange {
    /// Factors on every mass and inertia.
    pub mass: [f64; 2],
    /// Factors on joint damping.
    pub damping: [f64; 2],
    /// Factors on the force per control.
    pub gear: [f64; 2],
}

impl Default for PlantRange {
    fn default() -> Self {
        PlantConfig::default().into()
    }
}

impl From<PlantConfig> for PlantRange {
    fn from(p: PlantConfig) -> Self {
        PlantRange { mass: [p.mass; 2], damping: [p.damping; 2], gear: [p.gear; 2] }
    }
}

impl PlantRange {
    /// The only plant of this range, if there is only one.
    pub fn single(&self) -> Option<PlantConfig> {
        let only = |[lo, hi]: [f64; 2]| (lo == hi).then_some(lo);
        Some(PlantConfig {
            mass: only(self.mass)?,
            damping: only(self.damping)?,
            gear: only(self.gear)?,
        })
    }

    /// The plant of this seed.
    pub fn draw(&self, seed: u64) -> PlantConfig {
        let mut rng = Rng::new(seed, Stream::Plant, 0);
        let mut factor = |[lo, hi]: [f64; 2]| {
            let share = rng.uniform();
            // A fixed plant is returned exactly, without rounding.
            if lo == hi { lo } else { lo * (hi / lo).powf(share) }
        };
        PlantConfig {
            mass: factor(self.mass),
            damping: factor(self.damping),
            gear: factor(self.gear),
        }
    }
}

impl std::str::FromStr for PlantRange {
    type Err = Error;

    /// Reads `mass=0.7..1.4,damping=0.5..2,gear=0.85`; each factor within 0.01 to 100.
    fn from_str(text: &str) -> Result<Self, Error> {
        let fail = |problem: String| Error::Plant { text: text.to_owned(), problem };
        let number = |value: &str| {
            let factor: f64 =
                value.trim().parse().or(Err(fail(format!("{value:?} is not a number"))))?;
            if (0.01..=100.0).contains(&factor) {
                Ok(factor)
            } else {
                Err(fail(format!("{factor} is not in 0.01 to 100")))
            }
        };
        let mut plant = PlantRange::default();
        for part in text.split(',').filter(|p| !p.trim().is_empty()) {
            let Some((key, value)) = part.split_once('=') else {
                return Err(fail(format!("{part:?} has no =")));
            };
            let (lo, hi) = value.split_once("..").unwrap_or((value, value));
            let range = [number(lo)?, number(hi)?];
            if range[0] > range[1] {
                return Err(fail(format!("{value:?} is a decreasing range")));
            }
            match key.trim() {
                "mass" => plant.mass = range,
                "damping" => plant.damping = range,
                "gear" => plant.gear = range,
                other => return Err(fail(format!("{other:?} is not mass, damping or gear"))),
            }
        }
        Ok(plant)
    }
}

impl std::fmt::Display for PlantRange {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let factors = [("mass", self.mass), ("damping", self.damping), ("gear", self.gear)];
        for (i, (name, [lo, hi])) in factors.into_iter().enumerate() {
            let comma = if i == 0 { "" } else { "," };
            if lo == hi {
                write!(f, "{comma}{name}={lo}")?;
            } else {
                write!(f, "{comma}{name}={lo}..{hi}")?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_round_trips_and_mistakes_are_named() {
        let p: PlantConfig = "mass=1.25, gear=0.85".parse().unwrap();
        assert_eq!(p, PlantConfig { mass: 1.25, damping: 1.0, gear: 0.85 });
        assert_eq!(p.to_string().parse::<PlantConfig>().unwrap(), p);
        let r: PlantRange = "mass=.7..1.4,damping=2".parse().unwrap();
        assert_eq!(r, PlantRange { mass: [0.7, 1.4], damping: [2.0; 2], gear: [1.0; 2] });
        assert_eq!(r.to_string().parse::<PlantRange>().unwrap(), r);
        for bad in ["mass", "mass=x", "mass=0", "wind=2", "gear=nan", "mass=2..1", "mass=1.."] {
            assert!(bad.parse::<PlantRange>().is_err(), "{bad}");
        }
        assert!("mass=.7..1.4".parse::<PlantConfig>().is_err());
    }

    #[test]
    fn draws_fill_the_range_and_leave_a_fixed_plant_exact() {
        let fixed = PlantConfig { mass: 1.1, damping: 0.3, gear: 0.7 };
        assert_eq!(PlantRange::from(fixed).draw(9), fixed);
        let r: PlantRange = "mass=.5..2".parse().unwrap();
        let masses: Vec<f64> = (0..400).map(|s| r.draw(s).mass).collect();
        assert!(masses.iter().all(|m| (0.5..=2.0).contains(m)));
        // Log-uniform: as many below one as above.
        let below = masses.iter().filter(|m| **m < 1.0).count();
        assert!((160..240).contains(&below), "{below}");
    }
}
