//! The torque limit of motors if the source names none: enough to carry and to move the robot.

use super::config::ImportConfig;
use super::plausible;
use crate::Error;
use crate::derive::digits;
use robert_mujoco::{Joint, Model, Transmission};

/// The limit of a motor that carries nothing, N m or N.
const LEAST: f64 = 10.0;
/// It is lowered to this many times what the most loaded joint of its kind needs: a finger does not
/// get the motor of an arm.
const OF_MOST: f64 = 20.0;

/// Forces for the motors of a model, N m or N.
pub(super) struct Efforts {
    /// The effort that the user asked for.
    asked: Option<f64>,
    /// By joint, not yet rounded, N m or N.
    needed: Vec<f64>,
    /// The least limit of hinges and of slides, N m or N.
    least: [f64; 2],
    slides: Vec<bool>,
}

impl Efforts {
    /// Force limits from the weights and inertias of the model, unless the user gives one.
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub(super) fn of(model: &Model, config: &ImportConfig) -> Result<Efforts, Error> {
        let needed: Vec<f64> = match config.effort {
            Some(_) => Vec::new(),
            None => plausible::loads(model)?.iter().map(plausible::Load::effort).collect(),
        };
        let slides: Vec<bool> = (0..model.jnt_type().len())
            .map(|j| model.joint_type(j) == Some(Joint::Slide))
            .collect();
        let least = [false, true].map(|kind| {
            let own = needed.iter().zip(&slides).filter(|(_, slides)| **slides == kind);
            let most = own.map(|(needed, _)| *needed).filter(|n| n.is_finite()).fold(0.0, f64::max);
            if most > 0.0 { digits(OF_MOST * most, 2).min(LEAST) } else { LEAST }
        });
        Ok(Efforts { asked: config.effort, needed, least, slides })
    }

    /// The limit of a joint, rounded up to a whole number if it is above [`LEAST`].
    pub(super) fn joint(&self, joint: usize) -> f64 {
        let least = self.least[usize::from(self.slides.get(joint).is_some_and(|s| *s))];
        match (self.asked, self.needed.get(joint)) {
            (Some(effort), _) => effort,
            (None, Some(needed)) if *needed > least && needed.is_finite() => needed.ceil(),
            (None, _) => least,
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
