//! Goals that lead a policy along the path of a planner.
//!
//! Where goals cannot all be reached, the order in which joints move decides what is reached: a finger
//! that comes first blocks the next one. iLQR, which knows the model, looks ahead and often finds
//! a better order. The policy follows where it went, as its goals are moved to the states that iLQR
//! reached.

use super::error::Error;
use super::goals::Goals;
use super::jam::{self, Off};
use super::policy_config::PolicyConfig;
use super::run::Rollout;

/// Passes of the policy along the path.
pub(super) const PASSES: usize = 3;
/// Share of the distance to the path by which goals move after a pass.
const GAIN: f64 = 0.6;

/// The longest clip that is planned, in frames of a robot with [`COORDINATES`]: about a minute of one
/// core.
const LONGEST: usize = 6000;
/// The velocities of the Shadow Hand.
const COORDINATES: usize = 24;

/// Whether a planner performs the clip within about a minute. The time of a frame grows with the
/// cube of the velocities.
pub(super) fn is_affordable(trial: &Rollout) -> bool {
    let larger = (trial.robot().model().nv() as f64 / COORDINATES as f64).max(1.0);
    trial.frames() as f64 * larger.powi(3) <= LONGEST as f64
}

/// A planner that performs the clip, and the passes of a policy that follows it.
pub(super) struct Planned {
    /// The settings of the planner.
    pub(super) config: PolicyConfig,
    planner: Rollout,
    /// Whether the first correction was made.
    pub(super) began: bool,
    /// The passes since then.
    pub(super) passes: usize,
    /// The correction of the next pass; (frames, S).
    shift: Vec<f64>,
}

impl Planned {
    /// A planner of these settings at the beginning of the clip that `trial` performs.
    pub(super) fn new(trial: &Rollout, config: &PolicyConfig) -> Result<Planned, Error> {
        let planner = trial.with(config.build(trial.robot())?, config.guide)?;
        let shift = vec![0.0; trial.frames() * trial.goals().dim()];
        Ok(Planned { config: config.clone(), planner, began: false, passes: 0, shift })
    }

    /// Plans one frame; false at the end.
    pub(super) fn plan(&mut self) -> Result<bool, Error> {
        Ok(self.planner.step()?.is_some())
    }

    /// The correction of the first pass: to the planner's path.
    pub(super) fn begin(&mut self) -> &[f64] {
        let (goals, d) = (self.planner.goals(), self.planner.goals().dim());
        self.shift = between_goals(goals, |i| self.planner.reached()[i] - goals.row(i / d)[i % d]);
        self.began = true;
        &self.shift
    }

    /// The correction after a pass that reached these states; (frames, S).
    pub(super) fn go_on(&mut self, reached: &[f64]) -> &[f64] {
        self.passes += 1;
        let missed = |i: usize| GAIN * (self.planner.reached()[i] - reached[i]);
        let moved = between_goals(self.planner.goals(), missed);
        self.shift.iter_mut().zip(moved).for_each(|(s, m)| *s += m);
        &self.shift
    }

    /// Whether the path was planned to its end.
    pub(super) fn is_done(&self) -> bool {
        self.planner.is_done()
    }

    /// Frames at which joints are more than `limit` off their goals on the path.
    pub(super) fn off(&self, limit: f64) -> Vec<Off> {
        jam::off(self.planner.sought(), self.planner.reached(), limit)
    }

    /// The planner's own motion.
    pub(super) fn into_motion(self) -> Rollout {
        self.planner
    }

    /// Frames that are still to be planned.
    pub(super) fn frames_to_plan(&self) -> usize {
        self.planner.frames() - 1 - self.planner.frame()
    }

    /// Frames that are still to be simulated by a policy that is at `frame` of a pass.
    pub(super) fn frames_left(&self, frame: usize) -> usize {
        ((PASSES - self.passes) * (self.planner.frames() - 1)).saturating_sub(frame)
    }
}

/// `value` of each goal, by its index in (frames, S), and straight lines between the goals of a joint.
/// It is 0 at frame 0 and after the last goal.
fn between_goals(goals: &Goals, value: impl Fn(usize) -> f64) -> Vec<f64> {
    let d = goals.dim();
    let mut all = vec![0.0; goals.frames() * d];
    for j in 0..d {
        let (mut from, mut a) = (0, 0.0);
        for to in (1..goals.frames()).filter(|&f| goals.is_visible(f, j)) {
            let b = value(to * d + j);
            for f in from + 1..=to {
                all[f * d + j] = a + (b - a) * (f - from) as f64 / (to - from) as f64;
            }
            (from, a) = (to, b);
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use robert_clip::Command;

    #[test]
    fn values_of_goals_are_joined_by_lines() {
        let seen = [false, false, false, true, true, false, false, true, false, false];
        let command =
            Command::from_dense(vec!["a".into()], vec![0.0], vec![0.0; 10], seen.to_vec()).unwrap();
        let found = between_goals(&Goals::new(&command), |i| i as f64);
        assert_eq!(found, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 0.0, 0.0]);
        let away = between_goals(&Goals::new(&command), |i| if i == 7 { 3.0 } else { 0.0 });
        assert_eq!(away, [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 0.0, 0.0]);
    }
}
