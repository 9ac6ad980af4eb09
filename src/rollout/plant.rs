//! The plant that is simulated and the plant that a planner believes in.
//!
//! A comparison in which the planner owns the exact simulator flatters it. The mismatch
//! panel changes mass, damping and gear of the simulated plant only.

use std::sync::Arc;

use super::error::Error;
use crate::mujoco::{Data, Model};
use crate::robot::Robot;

/// How the simulated plant differs from the robot's file; factors, 1 is no change.
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
    /// Whether this is the robot as its file says.
    pub fn is_nominal(&self) -> bool {
        *self == PlantConfig::default()
    }

    /// The model of this plant: the robot's own when nothing differs.
    ///
    /// # Errors
    /// [`Error::Setup`].
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
        let fail = |problem: String| Error::Plant { text: text.to_owned(), problem };
        let mut plant = PlantConfig::default();
        for part in text.split(',').filter(|p| !p.trim().is_empty()) {
            let Some((key, value)) = part.split_once('=') else {
                return Err(fail(format!("{part:?} has no =")));
            };
            let factor: f64 =
                value.trim().parse().or(Err(fail(format!("{value:?} is no number"))))?;
            if !(0.01..=100.0).contains(&factor) {
                return Err(fail(format!("{factor} is not within 0.01 to 100")));
            }
            match key.trim() {
                "mass" => plant.mass = factor,
                "damping" => plant.damping = factor,
                "gear" => plant.gear = factor,
                other => return Err(fail(format!("{other:?} is not mass, damping or gear"))),
            }
        }
        Ok(plant)
    }
}

impl std::fmt::Display for PlantConfig {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "mass={},damping={},gear={}", self.mass, self.damping, self.gear)
    }
}

/// A planner's own simulation of the robot as its file says.
#[derive(Debug)]
pub struct Belief {
    /// The robot.
    pub robot: Arc<Robot>,
    /// Work space on the robot's own model.
    pub data: Data,
    /// Simulator steps in one control step.
    pub substeps: usize,
}

impl Belief {
    /// A planner's simulation.
    ///
    /// # Errors
    /// [`Error::Setup`], [`Error::Timestep`].
    pub fn new(robot: &Arc<Robot>) -> Result<Belief, Error> {
        Belief::on(robot, robot.model())
    }

    /// The same robot touching nothing.
    ///
    /// # Errors
    /// As [`Belief::new`].
    pub fn without_contacts(robot: &Arc<Robot>) -> Result<Belief, Error> {
        let mut model = robot.model().duplicate()?;
        model.set_contacts(false);
        Belief::on(robot, &Arc::new(model))
    }

    fn on(robot: &Arc<Robot>, model: &Arc<Model>) -> Result<Belief, Error> {
        let data = Data::new(model)?;
        let substeps = substeps(robot.model())?;
        Ok(Belief { robot: Arc::clone(robot), data, substeps })
    }
}

/// Simulator steps that make up one control step exactly.
///
/// # Errors
/// [`Error::Timestep`] when 0.05 s is no whole number of them: the clock of the rollout
/// would drift against the clip.
pub(super) fn substeps(model: &Model) -> Result<usize, Error> {
    let dt = model.timestep();
    let n = (crate::units::CTRL_DT / dt).round();
    if n >= 1.0 && (n * dt - crate::units::CTRL_DT).abs() < 1e-9 {
        Ok(n as usize)
    } else {
        Err(Error::Timestep { timestep_secs: dt })
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
        for bad in ["mass", "mass=x", "mass=0", "wind=2", "gear=nan"] {
            assert!(bad.parse::<PlantConfig>().is_err(), "{bad}");
        }
    }
}
