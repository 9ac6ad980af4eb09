//! Iterative learning control: performs a clip again and again, with goals moved by what was missed.
//!
//! After each pass the goals that the policy sees move by a share of the error, joint by joint and
//! frame by frame (Arimoto 1984). A joint that became worse returns to its best correction and takes
//! a smaller step in the opposite direction, because a joint that is blocked by touch is best left
//! where it is, or moved away. The command stays as it is: errors are measured against it.

use super::error::Error;
use super::gaps::unnatural;
use super::run::Rollout;
use super::window::Goals;

/// Passes after the first.
pub(super) const PASSES: usize = 6;
/// Longest clip that is repeated, in frames (five minutes); the passes before are kept in memory.
pub(super) const LONGEST: usize = 6000;
/// Share of the error by which a goal moves.
const GAIN: f64 = 0.6;
/// Factor of the gain after a pass in which the joint became worse.
const TURN: f64 = -0.3;
/// The farthest that a goal moves, rad or m.
const FARTHEST: f64 = 0.2;

/// The correction of a clip, learned pass by pass.
#[derive(Debug)]
struct Correction {
    /// The correction of the next pass; (frames, S).
    shift: Vec<f64>,
    /// By joint, the best correction so far, the errors it left, and their sum; (frames, S), (S).
    best: Vec<f64>,
    missed: Vec<f64>,
    least: Vec<f64>,
    gain: Vec<f64>,
}

impl Correction {
    fn new(plan: &Goals) -> Correction {
        let zero = vec![0.0; plan.frames() * plan.dim()];
        Correction {
            shift: zero.clone(),
            best: zero.clone(),
            missed: zero,
            least: vec![f64::INFINITY; plan.dim()],
            gain: vec![GAIN; plan.dim()],
        }
    }

    /// Learns from a pass with the present correction; `reached` is (frames, S).
    fn learn(&mut self, plan: &Goals, reached: &[f64]) {
        let d = plan.dim();
        for j in 0..d {
            let seen = || (1..plan.frames()).filter(|&f| plan.is_visible(f, j));
            let error = |f: usize| plan.row(f)[j] - reached[f * d + j];
            let sum = seen().map(|f| error(f).abs()).sum();
            if sum <= self.least[j] {
                self.least[j] = sum;
                for f in seen() {
                    let i = f * d + j;
                    (self.best[i], self.missed[i]) = (self.shift[i], error(f));
                }
            } else {
                self.gain[j] *= TURN;
            }
            for f in seen() {
                let i = f * d + j;
                let moved = self.best[i] + self.gain[j] * self.missed[i];
                self.shift[i] = moved.clamp(-FARTHEST, FARTHEST);
            }
        }
    }
}

/// A clip that is performed again, pass by pass.
pub(super) struct Learner {
    correction: Correction,
    passes: usize,
    trial: Rollout,
    /// The best pass, if it is better than the motion from which it learns.
    best: Option<Rollout>,
    /// The best error so far, with the penalty for unnatural motion in gaps.
    least: f64,
}

impl Learner {
    /// Learns from `first`, which has reached its end with the error `least`. `trial` is the same
    /// rollout at its beginning.
    pub(super) fn new(first: &Rollout, least: f64, mut trial: Rollout) -> Result<Learner, Error> {
        let mut correction = Correction::new(first.plan());
        correction.learn(first.plan(), first.reached());
        trial.correct(&correction.shift)?;
        Ok(Learner { correction, passes: 0, trial, best: None, least })
    }

    /// Simulates one frame. False after the last pass, or after one that failed. `fresh` makes the
    /// rollout of another pass.
    pub(super) fn step(&mut self, fresh: impl FnOnce() -> Result<Rollout, Error>) -> bool {
        if self.passes == PASSES {
            return false;
        }
        let more = match self.trial.step() {
            Ok(Some(_)) => return true,
            Ok(None) => self.end_pass(fresh).is_ok(),
            // The plant may diverge with this correction; the passes before it count.
            Err(_) => false,
        };
        if !more {
            self.passes = PASSES;
        }
        more && self.passes < PASSES
    }

    fn end_pass(&mut self, fresh: impl FnOnce() -> Result<Rollout, Error>) -> Result<(), Error> {
        self.passes += 1;
        self.correction.learn(self.trial.plan(), self.trial.reached());
        if let Some(error) = error(&self.trial).filter(|e| *e < self.least) {
            self.least = error;
            let spare = match self.best.take() {
                Some(spare) => spare,
                None => fresh()?,
            };
            self.best = Some(std::mem::replace(&mut self.trial, spare));
        }
        self.trial.correct(&self.correction.shift)
    }

    /// The best pass, if one is better than the motion from which it learned.
    pub(super) fn best(&self) -> Option<&Rollout> {
        self.best.as_ref()
    }

    /// See [`Learner::best`].
    pub(super) fn into_best(self) -> Option<Rollout> {
        self.best
    }
}

/// Precision with the penalty for unnatural motion in gaps; `None` if nothing was commanded.
fn error(rollout: &Rollout) -> Option<f64> {
    Some(rollout.precision().precision? + unnatural(rollout))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Guide, PolicyConfig, PolicyName, RolloutConfig, Start, tasks};
    use robert_base::progress::Cancel;
    use robert_clip::{Command, compile};
    use robert_robot::Robot;
    use std::sync::Arc;

    /// One joint that reaches 0.8 of its goal, as a spring under a constant load does.
    #[test]
    fn what_is_missed_is_added_and_a_worse_step_turns_around() {
        let q = vec![0.0, 1.0, 1.0];
        let command = Command::from_dense(vec!["a".into()], vec![0.0], q, vec![true; 3]).unwrap();
        let plan = Goals::new(&command);
        let mut correction = Correction::new(&plan);
        correction.learn(&plan, &[0.0, 0.9, 0.9]);
        assert!(correction.shift.iter().zip([0.0, 0.06, 0.06]).all(|(a, b)| (a - b).abs() < 1e-12));
        // The joint is pushed back: away from the best correction, which was none.
        correction.learn(&plan, &[0.0, 0.85, 0.85]);
        assert!((correction.shift[1] + 0.018).abs() < 1e-12, "{:?}", correction.shift);
        correction.missed[1] = -9.0;
        correction.learn(&plan, &[0.0, 0.0, 0.0]);
        assert!(correction.shift.iter().all(|s| s.abs() <= FARTHEST));
    }

    #[test]
    fn each_pass_is_nearer_and_the_command_stays() {
        let robot = Arc::new(Robot::builtin("ur5e").unwrap());
        let command = compile(&tasks::find("ur5e/reacher", None).unwrap()).unwrap();
        let policy = PolicyConfig { guide: Guide::Smooth, ..PolicyConfig::new(PolicyName::Pd) };
        let fresh = || {
            let config = RolloutConfig { guide: policy.guide, ..RolloutConfig::default() };
            Rollout::new(&robot, policy.build(&robot)?, &command, Start::Pose, config)
        };
        let mut first = fresh().unwrap();
        first.run(&Cancel::default()).unwrap();
        let before = error(&first).unwrap();
        let mut learner = Learner::new(&first, before, fresh().unwrap()).unwrap();
        while learner.step(fresh) {}
        assert_eq!(learner.passes, PASSES);
        let best = learner.best().unwrap();
        assert!(error(best).unwrap() < 0.2 * before, "{} {before}", error(best).unwrap());
        assert_eq!(best.goals(), first.goals());
        // A new rollout with the same correction has the same bits.
        let mut again = fresh().unwrap();
        again.correct(best.shift().unwrap()).unwrap();
        again.run(&Cancel::default()).unwrap();
        assert_eq!(again.actions(), best.actions());
    }
}
