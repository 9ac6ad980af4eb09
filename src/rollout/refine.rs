//! Refinement: one iLQR iteration per frame on the robot's model, starting at the action of another
//! policy.
//!
//! A refined policy uses the model, so tables list it separately. Its figure measures the model;
//! the other policy only makes the search cheaper.

use std::sync::Arc;

use super::error::Error;
use super::ilqr::{Ilqr, IlqrConfig};
use super::policy::{Policy, View};
use robert_robot::Robot;

/// A policy whose action is improved on the model before it is applied.
pub(super) struct Refined {
    inner: Box<dyn Policy>,
    planner: Ilqr,
    hint: Vec<f64>,
}

impl Refined {
    /// Wraps a policy.
    ///
    /// # Errors
    /// [`Error::Setup`], [`Error::Timestep`].
    pub(super) fn new(robot: &Arc<Robot>, inner: Box<dyn Policy>) -> Result<Refined, Error> {
        let planner = Ilqr::new(robot, &IlqrConfig::for_robot(robot))?;
        Ok(Refined { inner, planner, hint: vec![0.0; robot.action_dim()] })
    }
}

impl Policy for Refined {
    fn name(&self) -> String {
        format!("{}+refine", self.inner.name())
    }

    fn uses_model(&self) -> bool {
        true
    }

    fn sees_plan(&self) -> bool {
        self.inner.sees_plan()
    }

    fn card(&self) -> Option<String> {
        self.inner.card()
    }

    fn reset(&mut self, seed: u64) {
        self.inner.reset(seed);
        self.planner.reset(seed);
    }

    fn act(&mut self, view: &View<'_>, action: &mut [f64]) -> Result<(), Error> {
        self.inner.act(view, &mut self.hint)?;
        self.planner.act_from(view, Some(&self.hint), action)?;
        self.inner.applied(action);
        Ok(())
    }

    fn memory(&self) -> Vec<f64> {
        let mut memory = self.inner.memory();
        memory.extend(self.planner.memory());
        memory
    }

    fn recall(&mut self, memory: &[f64]) {
        // The memory of the inner policy may grow with the rollout; that of the planner does not.
        let inner = memory.len().saturating_sub(self.planner.memory().len());
        let (inner, planner) = memory.split_at(inner);
        self.inner.recall(inner);
        self.planner.recall(planner);
    }
}

impl std::fmt::Debug for Refined {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Refined").field("inner", &self.inner.name()).finish_non_exhaustive()
    }
}
