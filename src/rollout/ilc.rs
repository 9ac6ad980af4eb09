//! Iterative learning control: performs a clip again and again, with goals moved by what was missed.
//!
//! After each pass the goals that the policy sees move by a share of the error, joint by joint and
//! frame by frame (Arimoto 1984). A joint that became worse returns to its best correction and takes
//! a smaller step in the opposite direction, because a joint that is blocked by touch is best left
//! where it is, or moved away. The command stays as it is: errors are measured against it. If a
//! joint still stays away from its goals, a search for detours follows ([`super::detour`]).

use super::detour::{self, Detours};
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
    /// That penalty.
    gaps: f64,
    /// What the motion from which it learns reached; (frames, S).
    reached: Vec<f64>,
    /// The frames that the search after the passes may simulate, and the search.
    budget: usize,
    detours: Option<Detours>,
    /// How often a better motion was found.
    improvements: usize,
    over: bool,
}

impl Learner {
    /// Learns from `first`, which has reached its end with the error `least`. `trial` is the same
    /// rollout at its beginning. With `searches`, a search for detours follows the passes.
    pub(super) fn new(
        first: &Rollout,
        least: f64,
        mut trial: Rollout,
        searches: bool,
    ) -> Result<Learner, Error> {
        let mut correction = Correction::new(first.plan());
        correction.learn(first.plan(), first.reached());
        trial.correct(&correction.shift)?;
        let (reached, gaps) = (first.reached().to_vec(), unnatural(first));
        let budget = if searches { detour::budget(first.goals(), &reached) } else { 0 };
        Ok(Learner {
            correction,
            passes: 0,
            trial,
            best: None,
            least,
            gaps,
            reached,
            budget,
            detours: None,
            improvements: 0,
            over: false,
        })
    }

    /// Simulates one frame. False when there is nothing left to try. `fresh` makes the rollout of
    /// another pass.
    pub(super) fn step(&mut self, fresh: impl FnOnce() -> Result<Rollout, Error>) -> bool {
        self.over = self.over || !self.advance(fresh);
        !self.over
    }

    fn advance(&mut self, fresh: impl FnOnce() -> Result<Rollout, Error>) -> bool {
        // The plant may diverge with a correction; the passes before it count.
        let (going, failed) = match self.trial.step() {
            Ok(frame) => (frame.is_some(), false),
            Err(_) => (false, true),
        };
        match &mut self.detours {
            None if going => true,
            None => {
                let learned = !failed && self.end_pass(fresh).is_ok();
                (learned && self.passes < PASSES) || self.begin_detours()
            }
            Some(detours) => {
                if going && detours.promises(&self.trial) {
                    return true;
                }
                let better = !going && !failed && self.adopt(fresh).unwrap_or(false);
                self.next_detour(better)
            }
        }
    }

    /// Frames that are still to be simulated, at most.
    pub(super) fn frames_left(&self) -> usize {
        let frames = self.trial.frames() - 1;
        match &self.detours {
            _ if self.over => 0,
            Some(detours) => detours.frames_left(),
            None => {
                self.budget + ((PASSES - self.passes) * frames).saturating_sub(self.trial.frame())
            }
        }
    }

    /// Whether the passes are over and detours are searched for.
    pub(super) fn searches(&self) -> bool {
        self.detours.is_some() && !self.over
    }

    /// How often a better motion was found.
    pub(super) fn improvements(&self) -> usize {
        self.improvements
    }

    fn begin_detours(&mut self) -> bool {
        if self.budget == 0 {
            return false;
        }
        let plan = self.trial.plan();
        let none = vec![0.0; plan.frames() * plan.dim()];
        let (reached, shift) = match &self.best {
            Some(best) => (best.reached(), best.shift().unwrap_or(&none)),
            None => (&self.reached[..], &none[..]),
        };
        self.detours = Some(Detours::new(self.trial.goals(), reached, shift));
        self.next_detour(false)
    }

    fn next_detour(&mut self, better: bool) -> bool {
        let Some(detours) = &mut self.detours else { return false };
        if let (true, Some(best)) = (better, &self.best) {
            detours.go_on(best.goals(), best.reached(), best.shift().unwrap_or_default());
        }
        let next = detours.next(self.trial.goals());
        next.is_some_and(|shift| self.trial.correct(shift).is_ok())
    }

    fn end_pass(&mut self, fresh: impl FnOnce() -> Result<Rollout, Error>) -> Result<(), Error> {
        self.passes += 1;
        self.correction.learn(self.trial.plan(), self.trial.reached());
        self.adopt(fresh)?;
        self.trial.correct(&self.correction.shift)
    }

    /// Keeps the trial if it is the best so far, and says whether it is.
    fn adopt(&mut self, fresh: impl FnOnce() -> Result<Rollout, Error>) -> Result<bool, Error> {
        let Some(error) = error(&self.trial).filter(|e| *e < self.least) else { return Ok(false) };
        let gaps = unnatural(&self.trial);
        if self.detours.is_some() && gaps > self.gaps {
            return Ok(false);
        }
        let spare = match self.best.take() {
            Some(spare) => spare,
            None => fresh()?,
        };
        self.best = Some(std::mem::replace(&mut self.trial, spare));
        (self.least, self.gaps) = (error, gaps);
        self.improvements += 1;
        Ok(true)
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
        let mut learner = Learner::new(&first, before, fresh().unwrap(), true).unwrap();
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

    #[test]
    fn a_finger_that_is_blocked_goes_another_way() {
        let robot = Arc::new(Robot::builtin("shadow_hand").unwrap());
        let command = compile(&tasks::find("shadow_hand/thumb_inside", None).unwrap()).unwrap();
        let policy = PolicyConfig::new(PolicyName::Pd);
        let fresh = || {
            let built = policy.build(&robot)?;
            Rollout::new(&robot, built, &command, Start::Pose, RolloutConfig::default())
        };
        let mut first = fresh().unwrap();
        first.run(&Cancel::default()).unwrap();
        let least = error(&first).unwrap();
        let mut learner = Learner::new(&first, least, fresh().unwrap(), true).unwrap();
        while !learner.searches() {
            assert!(learner.step(fresh));
        }
        let (passes, gaps, budget) = (learner.least, learner.gaps, learner.frames_left());
        let mut frames = 0;
        while learner.step(fresh) {
            frames += 1;
        }
        assert!(frames <= budget, "{frames} of {budget}");
        assert!(!learner.step(fresh) && learner.frames_left() == 0, "it is over for good");
        assert!(learner.least < passes, "{} {passes}", learner.least);
        assert!(learner.gaps <= gaps, "no way leads through unnatural motion in gaps");
        let best = learner.into_best().unwrap();
        let mut again = fresh().unwrap();
        again.correct(best.shift().unwrap()).unwrap();
        again.run(&Cancel::default()).unwrap();
        assert_eq!(again.actions(), best.actions());
    }
}
