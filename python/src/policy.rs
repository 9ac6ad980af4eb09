//! Policies: as they are asked for, and one at a time in a control loop of one's own.

use std::sync::{Arc, Mutex, PoisonError};

use numpy::{IntoPyArray as _, PyArray1, PyReadonlyArrayDyn};
use pyo3::prelude::*;
use robert::mujoco::Data;
use robert::robot::Robot as LibRobot;
use robert::rollout::{COMMAND, Guide, HISTORY, Policy as Acting, PolicyConfig, View, Window};

use crate::error::{RobertError, raise, wrong};
use crate::robot::Robot;

/// `pd`, `robert+guide`, `ridge:FILE`; nothing is the robot's own.
pub(crate) fn config(text: Option<&str>, robot: &LibRobot) -> PyResult<PolicyConfig> {
    let Some(text) = text else { return PolicyConfig::default_for(robot).map_err(raise) };
    text.parse().map_err(raise)
}

/// A policy that is asked frame by frame.
#[pyclass(frozen)]
pub(crate) struct Policy {
    robot: Arc<LibRobot>,
    config: PolicyConfig,
    acting: Mutex<Turn>,
}

struct Turn {
    policy: Box<dyn Acting>,
    window: Window,
    data: Data,
    frame: usize,
}

#[pymethods]
impl Policy {
    #[new]
    #[pyo3(signature = (robot, policy=None, seed=0))]
    fn new(py: Python<'_>, robot: &Robot, policy: Option<&str>, seed: u64) -> PyResult<Policy> {
        let config = config(policy, &robot.inner)?;
        if config.guide == Guide::Smooth {
            return Err(wrong("+smooth plans a whole clip, and act sees a window; use +guide"));
        }
        let robot = Arc::clone(&robot.inner);
        let mut built = py.detach(|| config.build(&robot)).map_err(raise)?;
        built.reset(seed);
        let window = Window::new(robot.state_dim());
        let data = Data::new(robot.model()).map_err(raise)?;
        let acting = Mutex::new(Turn { policy: built, window, data, frame: 0 });
        Ok(Policy { robot, config, acting })
    }

    #[getter]
    fn label(&self) -> String {
        self.config.label()
    }

    /// Forgets the past; draws come from this seed.
    fn reset(&self, py: Python<'_>, seed: u64) {
        py.detach(|| {
            let mut turn = self.acting.lock().unwrap_or_else(PoisonError::into_inner);
            turn.policy.reset(seed);
            turn.frame = 0;
        });
    }

    /// The action, -1 to 1; (A). `history` (30, S), `current` (S), `goals` and `mask` (20, S).
    fn act<'py>(
        &self,
        py: Python<'py>,
        history: PyReadonlyArrayDyn<'py, f64>,
        current: PyReadonlyArrayDyn<'py, f64>,
        goals: PyReadonlyArrayDyn<'py, f64>,
        mask: PyReadonlyArrayDyn<'py, bool>,
        velocity: Option<PyReadonlyArrayDyn<'py, f64>>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let dim = self.robot.state_dim();
        let history = numbers(&history, HISTORY * dim, "history", f64::is_finite)?;
        let current = numbers(&current, dim, "current", f64::is_finite)?;
        // A goal that is hidden may be any number or none.
        let goals = numbers(&goals, COMMAND * dim, "goals", |_| true)?;
        let seen = mask.as_slice().map_err(|_strided| wrong("mask must be contiguous"))?;
        if seen.len() != COMMAND * dim {
            return Err(wrong(format!("mask has {} values, not {}", seen.len(), COMMAND * dim)));
        }
        if goals.iter().zip(seen).any(|(goal, seen)| *seen && !goal.is_finite()) {
            return Err(wrong(
                "goals holds a value that is no number and is not hidden by the mask",
            ));
        }
        let velocity =
            velocity.as_ref().map(|v| numbers(v, dim, "velocity", f64::is_finite)).transpose()?;
        // The lock is taken without the interpreter's: who waits for it must not hold the other.
        let action = py.detach(|| self.answer(history, current, goals, seen, velocity))?;
        Ok(action.into_pyarray(py))
    }
}

impl Policy {
    fn answer(
        &self,
        history: &[f64],
        current: &[f64],
        goals: &[f64],
        seen: &[bool],
        velocity: Option<&[f64]>,
    ) -> PyResult<Vec<f64>> {
        let dim = self.robot.state_dim();
        let mut turn = self.acting.lock().unwrap_or_else(PoisonError::into_inner);
        let turn = &mut *turn;
        turn.fill(history, current, goals, seen);
        if self.config.guide == Guide::Linear {
            turn.window.guide_linear();
        }
        if turn.policy.uses_model() {
            self.robot.write_state(&mut turn.data, current).map_err(raise)?;
            let mut qvel = vec![0.0; turn.data.qvel().len()];
            for (j, joint) in self.robot.joints().iter().enumerate() {
                let before = history[(HISTORY - 1) * dim + j];
                let drift = (current[j] - before) / robert::units::CTRL_DT;
                qvel[joint.dofadr] = velocity.map_or(drift, |v| v[j]);
            }
            turn.data.set_qvel(&qvel).map_err(raise)?;
        }
        let state = turn.data.snapshot();
        let mut action = vec![0.0; self.robot.action_dim()];
        let view = View { frame: turn.frame, window: &turn.window, state: &state };
        turn.policy.act(&view, &mut action).map_err(raise)?;
        if let Some(actuator) = action.iter().position(|a| !a.is_finite()) {
            return Err(RobertError::new_err(format!(
                "the action of actuator {actuator} is no number"
            )));
        }
        action.iter_mut().for_each(|a| *a = a.clamp(-1.0, 1.0));
        turn.frame += 1;
        Ok(action)
    }
}

impl Turn {
    /// Writes the window. Nothing is known beyond it: a joint without a goal inside has none.
    fn fill(&mut self, history: &[f64], current: &[f64], goals: &[f64], seen: &[bool]) {
        let w = &mut self.window;
        w.history.copy_from_slice(history);
        w.current.copy_from_slice(current);
        w.visible.copy_from_slice(seen);
        for ((to, goal), seen) in w.command.iter_mut().zip(goals).zip(seen) {
            *to = if *seen { *goal } else { 0.0 };
        }
        let dim = w.dim();
        for j in 0..dim {
            let last = (0..COMMAND).rev().find(|f| seen[f * dim + j]);
            w.end[j] = last.map_or(current[j], |f| goals[f * dim + j]);
            w.free[j] = last.is_none();
            w.passing[j] = false;
        }
    }
}

/// The values of an array in C order; each must be fine.
fn numbers<'a>(
    array: &'a PyReadonlyArrayDyn<'_, f64>,
    want: usize,
    what: &str,
    is_fine: impl Fn(f64) -> bool,
) -> PyResult<&'a [f64]> {
    let values =
        array.as_slice().map_err(|_strided| wrong(format!("{what} must be contiguous")))?;
    if values.len() != want {
        return Err(wrong(format!("{what} has {} values, not {want}", values.len())));
    }
    if !values.iter().all(|v| is_fine(*v)) {
        return Err(wrong(format!("{what} holds a value that is no number")));
    }
    Ok(values)
}
