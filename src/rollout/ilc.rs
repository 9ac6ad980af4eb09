//! Iterative learning control: performs a clip again and again, with goals moved by what was missed.
//!
//! After each pass the goals that the policy sees move by a share of the error, joint by joint and
//! frame by frame (Arimoto 1984). Each second of a joint learns by itself. Where it became worse, it
//! returns to its best correction and takes smoothed steps, because a joint with little damping
//! cannot follow goals that go to and fro; then smaller steps in the opposite direction, because a
//! joint that is blocked by touch is best left where it is, or moved away. The command stays as it
//! is: errors are measured against it.

use super::error::Error;
use super::goals::Goals;
use super::judge::Judge;
use super::lead::Lead;
use super::natural::unnatural;
use super::policy_config::PolicyConfig;
use super::run::Rollout;

/// Passes after the first.
const PASSES: usize = 6;
/// Longest clip that is repeated, in frames (five minutes); the passes before are kept in memory.
pub(super) const LONGEST: usize = 6000;
/// Share of the error by which a goal moves.
const GAIN: f64 = 0.6;
/// Factor of the gain after a pass in which the joint became worse.
const TURN: f64 = -0.3;
/// Frames that learn together: what is missed in one second says little about the next.
const SECOND: usize = 20;
/// The farthest that a goal moves, rad or m.
const FARTHEST: f64 = 0.2;

/// The correction of a clip, learned pass by pass.
#[derive(Debug)]
struct Correction {
    /// The correction of the next pass; (frames, S).
    shift: Vec<f64>,
    /// The best correction so far; (frames, S).
    best: Vec<f64>,
    /// The errors that it left; (frames, S).
    missed: Vec<f64>,
    /// The sum of these errors over each second of each joint; (seconds, S).
    least: Vec<f64>,
    /// The next step of each second of each joint; (seconds, S).
    step: Vec<Step>,
}

/// How far a second of a joint moves towards what was missed.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Step {
    /// By [`GAIN`], frame by frame.
    Each,
    /// By this gain, with what was missed smoothed over three frames.
    Smooth(f64),
}

impl Step {
    /// The step after one that made this second of the joint worse.
    fn other(self) -> Step {
        match self {
            Step::Each => Step::Smooth(GAIN),
            Step::Smooth(gain) => Step::Smooth(TURN * gain),
        }
    }
}

impl Correction {
    fn new(plan: &Goals) -> Correction {
        let zero = vec![0.0; plan.frames() * plan.dim()];
        let seconds = plan.frames().div_ceil(SECOND) * plan.dim();
        Correction {
            shift: zero.clone(),
            best: zero.clone(),
            missed: zero,
            least: vec![f64::INFINITY; seconds],
            step: vec![Step::Each; seconds],
        }
    }

    /// Learns from a pass with the present correction; `reached` is (frames, S).
    fn learn(&mut self, plan: &Goals, reached: &[f64]) {
        let d = plan.dim();
        for (at, (least, step)) in self.least.iter_mut().zip(&mut self.step).enumerate() {
            let (second, j) = (at / d, at % d);
            let frames = (second * SECOND).max(1)..((second + 1) * SECOND).min(plan.frames());
            let seen = || frames.clone().filter(|&f| plan.is_visible(f, j));
            let error = |f: usize| plan.row(f)[j] - reached[f * d + j];
            let sum = seen().map(|f| error(f).abs()).sum();
            if sum <= *least {
                *least = sum;
                for f in seen() {
                    let i = f * d + j;
                    (self.best[i], self.missed[i]) = (self.shift[i], error(f));
                }
            } else {
                *step = step.other();
            }
        }
        for j in 0..d {
            for f in (1..plan.frames()).filter(|&f| plan.is_visible(f, j)) {
                let i = f * d + j;
                let moved = match self.step[f / SECOND * d + j] {
                    Step::Each => GAIN * self.missed[i],
                    Step::Smooth(gain) => gain * self.smooth(plan, f, j),
                };
                self.shift[i] = (self.best[i] + moved).clamp(-FARTHEST, FARTHEST);
            }
        }
    }

    /// The lead of the next pass.
    fn lead(&self) -> Lead {
        Lead::of(self.shift.clone())
    }

    /// What was missed at a goal, with the frames before and after it.
    fn smooth(&self, plan: &Goals, f: usize, j: usize) -> f64 {
        let i = f * plan.dim() + j;
        let inside = f + 1 < plan.frames();
        if !(inside && plan.is_visible(f - 1, j) && plan.is_visible(f + 1, j)) {
            return self.missed[i];
        }
        let (before, after) = (self.missed[i - plan.dim()], self.missed[i + plan.dim()]);
        0.5 * self.missed[i] + 0.25 * (before + after)
    }
}

/// A policy that repeats a clip, and the best motion that it has found.
pub(super) struct Repeats {
    /// The contender.
    pub(super) at: usize,
    /// Whether it is fast enough for a search.
    pub(super) is_fast: bool,
    correction: Correction,
    passes: usize,
    /// The rollout that performs the next pass.
    pub(super) trial: Rollout,
    /// The rollout for the pass after the first one that is kept.
    spare: Option<Rollout>,
    /// The best motion, if it is better than the one from which it learned.
    best: Option<Rollout>,
    /// The best error so far, with the penalty for unnatural motion in gaps.
    pub(super) least: f64,
    /// That penalty.
    pub(super) gaps: f64,
    /// States of the motion from which it learned, 30 of history first; (30 + frames, S).
    states: Vec<f64>,
    /// Frames simulated in passes.
    pub(super) frames: usize,
    /// How often a better motion was found.
    pub(super) improvements: usize,
    judge: Judge,
    over: bool,
}

impl Repeats {
    /// Learns from `first`, which `policy`, the contender `at`, has performed to its end. The two
    /// rollouts are the same at their beginning. The judge decides what is kept. `None` if the clip is too long, or commands nothing.
    ///
    /// # Errors
    /// As [`Rollout::correct`].
    pub(super) fn new(
        (at, policy): (usize, &PolicyConfig),
        first: &Rollout,
        [mut trial, spare]: [Rollout; 2],
        judge: Judge,
    ) -> Result<Option<Repeats>, Error> {
        if first.precision().precision.is_none() || first.frames() > LONGEST {
            return Ok(None);
        }
        // What the judge refuses may still become better.
        let least = judge.score(first).unwrap_or(f64::INFINITY);
        let mut correction = Correction::new(first.plan());
        correction.learn(first.plan(), first.reached());
        trial.correct(correction.lead())?;
        Ok(Some(Repeats {
            at,
            is_fast: policy.is_fast(),
            correction,
            passes: 0,
            trial,
            spare: Some(spare),
            best: None,
            least,
            gaps: unnatural(first),
            states: first.states().to_vec(),
            frames: 0,
            improvements: 0,
            judge,
            over: false,
        }))
    }

    /// Simulates some frames of the passes; only one if the policy is slow.
    pub(super) fn advance(&mut self, frames: usize) {
        for _ in 0..if self.is_fast { frames } else { 1 } {
            if self.over {
                return;
            }
            // The plant may diverge with a correction; the passes before it count.
            match self.trial.step() {
                Ok(Some(_)) => self.frames += 1,
                Ok(None) => self.over = self.end_pass().is_err() || self.passes == PASSES,
                Err(_) => self.over = true,
            }
        }
    }

    fn end_pass(&mut self) -> Result<(), Error> {
        self.passes += 1;
        self.correction.learn(self.trial.plan(), self.trial.reached());
        self.keep_trial();
        self.trial.correct(self.correction.lead())
    }

    /// Whether all passes are done.
    pub(super) fn is_over(&self) -> bool {
        self.over
    }

    /// Frames that are still to be simulated.
    pub(super) fn frames_left(&self) -> usize {
        let all = (PASSES - self.passes) * (self.trial.frames() - 1);
        if self.over { 0 } else { all.saturating_sub(self.trial.frame()) }
    }

    /// Keeps the trial if it is better, and goes on with another rollout.
    pub(super) fn keep_trial(&mut self) {
        if self.judge.score(&self.trial).is_none_or(|e| e >= self.least) {
            return;
        }
        if let Some(next) = self.best.take().or_else(|| self.spare.take()) {
            let better = std::mem::replace(&mut self.trial, next);
            self.keep(better);
        }
    }

    /// Keeps a better motion; the one before.
    pub(super) fn keep(&mut self, better: Rollout) -> Option<Rollout> {
        self.measure(&better);
        self.improvements += 1;
        self.best.replace(better)
    }

    /// Judges motions by another measure from now on.
    pub(super) fn judge_by(&mut self, judge: Judge) {
        self.judge = judge;
        if let Some(best) = self.best.take() {
            self.measure(&best);
            self.best = Some(best);
        }
    }

    /// What decides between motions.
    pub(super) fn judge(&self) -> &Judge {
        &self.judge
    }

    fn measure(&mut self, best: &Rollout) {
        self.least = self.judge.score(best).unwrap_or(self.least);
        self.gaps = unnatural(best);
    }

    /// The best motion, if it is better than the one from which it learned.
    pub(super) fn best(&self) -> Option<&Rollout> {
        self.best.as_ref()
    }

    /// See [`Repeats::best`].
    pub(super) fn into_best(self) -> Option<Rollout> {
        self.best
    }

    /// The states of the best motion so far, 30 of history first; (30 + frames, S).
    pub(super) fn best_states(&self) -> &[f64] {
        self.best.as_ref().map_or(&self.states, Rollout::states)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Guide, PolicyName, RolloutConfig, Start, tasks};
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
        // The joint is pushed back: smoothed steps from the best correction, which was none, and
        // then away from it.
        correction.learn(&plan, &[0.0, 0.85, 0.85]);
        assert!((correction.shift[1] - 0.045).abs() < 1e-12, "{:?}", correction.shift);
        correction.learn(&plan, &[0.0, 0.85, 0.85]);
        assert!((correction.shift[1] + 0.0135).abs() < 1e-12, "{:?}", correction.shift);
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
            let built = policy.build(&robot).unwrap();
            Rollout::new(&robot, built, &command, Start::Pose, config).unwrap()
        };
        let mut first = fresh();
        first.run(&Cancel::default()).unwrap();
        let score = |r: &Rollout| Judge::default().score(r);
        let before = score(&first).unwrap();
        // A judge who refuses the first motion takes one that becomes better.
        let most = 0.9 * first.precision().precision.unwrap();
        let judge = Judge::default().no_farther_than(most);
        assert_eq!(judge.score(&first), None);
        let repeats = Repeats::new((0, &policy), &first, [fresh(), fresh()], judge).unwrap();
        let mut repeats = repeats.unwrap();
        while !repeats.is_over() {
            repeats.advance(8);
        }
        assert_eq!((repeats.passes, repeats.frames), (PASSES, PASSES * (first.frames() - 1)));
        let best = repeats.best().unwrap();
        assert!(score(best).unwrap() < 0.2 * before, "{} {before}", score(best).unwrap());
        assert_eq!(best.goals(), first.goals());
        // A new rollout with the same correction has the same bits.
        let mut again = fresh();
        again.correct(best.lead().unwrap().clone()).unwrap();
        again.run(&Cancel::default()).unwrap();
        assert_eq!(again.actions(), best.actions());
    }
}
