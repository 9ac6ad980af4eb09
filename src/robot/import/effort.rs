//! The torque limit of motors if the source names none: enough to carry and to move the robot.

use super::config::ImportConfig;
use super::plausible;
use crate::Error;
use robert_mujoco::{Model, Transmission};

/// Force limit of a motor that carries nothing, N m or N.
const LEAST: f64 = 10.0;

/// Forces for the motors of a model, N m or N.
pub(super) struct Efforts {
    /// The effort that the user asked for.
    asked: Option<f64>,
    /// By joint, not yet rounded, N m or N.
    needed: Vec<f64>,
}

impl Efforts {
    /// Force limits from the weights and inertias of the model, unless the user gives one.
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub(super) fn of(model: &Model, config: &ImportConfig) -> Result<Efforts, Error> {
        let needed = match config.effort {
            Some(_) => Vec::new(),
            None => plausible::loads(model)?.iter().map(plausible::Load::effort).collect(),
        };
        Ok(Efforts { asked: config.effort, needed })
    }

    /// The limit of a joint, rounded up to a whole number.
    pub(super) fn joint(&self, joint: usize) -> f64 {
        match (self.asked, self.needed.get(joint)) {
            (Some(effort), _) => effort,
            (None, Some(needed)) if needed.is_finite() => needed.ceil().max(LEAST),
            (None, _) => LEAST,
        }
    }

    /// The limit of an actuator at a joint or tendon.
    pub(super) fn actuator(&self, model: &Model, actuator: usize) -> f64 {
        match model.transmission(actuator) {
            Some(Transmission::Joint(j)) => self.joint(j),
            _ => self.asked.unwrap_or(LEAST),
        }
    }

    /// In words, for the report.
    pub(super) fn words(&self, lo: f64, hi: f64) -> String {
        let sized =
            if self.asked.is_none() && hi > LEAST { ", sized to carry the robot" } else { "" };
        if lo < hi {
            format!("+-{lo} to +-{hi}{sized} (change with --effort)")
        } else {
            format!("+-{hi}{sized} (change with --effort)")
        }
    }
}
