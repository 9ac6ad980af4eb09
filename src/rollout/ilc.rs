//! Iterative learning control: performs a clip again and again, with goals moved by what was missed.
//!
//! After each pass the goals that the policy sees move by a share of the error, joint by joint and
//! frame by frame (Arimoto 1984). A joint that became worse returns to its best correction and takes
//! a smaller step in the opposite direction, because a joint that is blocked by touch is best left
//! where it is, or moved away. The command stays as it is: errors are measured against it. If a
//! joint still stays away from its goals, or moves unnaturally in a gap, the path of a planner is
//! tried ([`super::planned`]), and a search follows ([`super::detour`]).

use super::detour::{self, Detours, Try};
use super::error::Error;
use super::gaps::{score, unnatural};
use super::planned::{self, Planned};
use super::registry::PolicyConfig;
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

/// Tries of the search that are simulated at once, from the same motion. The number is fixed, so
/// that the result does not depend on the number of threads.
const AT_ONCE: usize = 4;
/// Frames by which one step advances each try.
const CHUNK: usize = 8;

/// A try of the search.
struct Attempt {
    rollout: Rollout,
    what: Try,
    going: bool,
}

/// How the motion of a policy is improved, one stage after another.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
#[derive(schemars::JsonSchema)]
pub enum Stage {
    /// Passes with goals that are moved by what was missed.
    Correct,
    /// A planner performs the clip. Its frames take several times as long as those of a policy.
    Plan,
    /// Passes along the planner's path.
    Follow,
    /// Tries of the random search.
    Search,
}

impl Stage {
    /// The title of a progress bar.
    pub(super) fn title(self) -> &'static str {
        match self {
            Stage::Correct => "correct the goals",
            Stage::Plan => "plan a path",
            Stage::Follow => "follow the path",
            Stage::Search => "search",
        }
    }
}

/// A clip that is performed again, pass by pass.
pub(super) struct Learner {
    correction: Correction,
    passes: usize,
    trial: Rollout,
    /// The best pass or try, if it is better than the motion from which it learns.
    best: Option<Rollout>,
    /// The best error so far, with the penalty for unnatural motion in gaps.
    least: f64,
    /// That penalty.
    gaps: f64,
    /// States of the motion from which it learns, 30 of history first; (30 + frames, S).
    states: Vec<f64>,
    /// Whether the policy is fast enough for a search.
    searches: bool,
    /// The frames that the search may still simulate, the planner before it, the search, its tries, and
    /// rollouts for more.
    budget: usize,
    planned: Option<Planned>,
    detours: Option<Detours>,
    attempts: Vec<Attempt>,
    spare: Vec<Rollout>,
    threads: usize,
    /// Frames simulated.
    frames: usize,
    /// How often a better motion was found.
    improvements: usize,
    over: bool,
}

impl Learner {
    /// Learns from `first`, which `policy` has performed to its end. `trial` is the same rollout at
    /// its beginning. A search runs on `threads` threads. `None` if the clip is too long, or commands
    /// nothing.
    ///
    /// # Errors
    /// As [`Rollout::correct`].
    pub(super) fn new(
        policy: &PolicyConfig,
        first: &Rollout,
        mut trial: Rollout,
        threads: usize,
    ) -> Result<Option<Learner>, Error> {
        let Some(least) = score(first).filter(|_| first.frames() <= LONGEST) else {
            return Ok(None);
        };
        let mut correction = Correction::new(first.plan());
        correction.learn(first.plan(), first.reached());
        trial.correct(&correction.shift)?;
        Ok(Some(Learner {
            correction,
            passes: 0,
            trial,
            best: None,
            least,
            gaps: unnatural(first),
            states: first.states().to_vec(),
            searches: policy.is_fast(),
            budget: 0,
            planned: None,
            detours: None,
            attempts: Vec::new(),
            spare: Vec::new(),
            threads,
            frames: 0,
            improvements: 0,
            over: false,
        }))
    }

    /// Simulates one frame, or some frames of each try. False when there is nothing left to try.
    /// `fresh` makes a rollout for another pass.
    pub(super) fn step(&mut self, fresh: impl Fn() -> Result<Rollout, Error>) -> bool {
        let going = !self.over
            && match (&self.planned, &self.detours) {
                (_, Some(_)) => self.search(),
                (Some(_), None) => self.follow(&fresh) || self.begin_search(&fresh),
                (None, None) => self.pass(&fresh) || self.begin_plan() || self.begin_search(&fresh),
            };
        self.over = !going;
        going
    }

    /// A frame of a pass; false after the last one.
    fn pass(&mut self, fresh: &dyn Fn() -> Result<Rollout, Error>) -> bool {
        // The plant may diverge with a correction; the passes before it count.
        match self.trial.step() {
            Ok(Some(_)) => {
                self.frames += 1;
                true
            }
            Ok(None) => self.end_pass(fresh).is_ok() && self.passes < PASSES,
            Err(_) => false,
        }
    }

    /// Frames simulated so far.
    pub(super) fn frames(&self) -> usize {
        self.frames
    }

    /// What the next step belongs to.
    pub(super) fn stage(&self) -> Stage {
        match (&self.planned, &self.detours) {
            (_, Some(_)) => Stage::Search,
            (Some(planned), None) if planned.began => Stage::Follow,
            (Some(_), None) => Stage::Plan,
            (None, None) => Stage::Correct,
        }
    }

    /// Frames that are still to be simulated in this stage, at most.
    pub(super) fn frames_left(&self) -> usize {
        let frames = self.trial.frames() - 1;
        let left = |passes: usize| (passes * frames).saturating_sub(self.trial.frame());
        match (self.stage(), &self.planned) {
            _ if self.over => 0,
            (Stage::Search, _) => self.budget,
            (Stage::Follow, Some(planned)) => left(planned::PASSES - planned.passes),
            (Stage::Plan, Some(planned)) => planned.frames_left(),
            _ => left(PASSES - self.passes),
        }
    }

    /// Whether the passes are over and a planner's path or detours are tried.
    pub(super) fn searches(&self) -> bool {
        self.stage() != Stage::Correct && !self.over
    }

    /// How often a better motion was found.
    pub(super) fn improvements(&self) -> usize {
        self.improvements
    }

    /// The states of the best motion so far, 30 of history first; (30 + frames, S).
    fn best_states(&self) -> &[f64] {
        self.best.as_ref().map_or(&self.states, Rollout::states)
    }

    /// Begins to plan, if joints still stay away after the passes; false if they do not, or if no
    /// planner can.
    fn begin_plan(&mut self) -> bool {
        if self.searches {
            self.budget =
                detour::budget(self.trial.goals(), self.trial.plan(), self.best_states());
        }
        if self.budget > 0 && planned::is_affordable(&self.trial) {
            self.planned = Planned::new(&self.trial).ok();
        }
        self.planned.is_some()
    }

    /// A frame of the planner, and then of the passes that follow it; false after the last one.
    fn follow(&mut self, fresh: &dyn Fn() -> Result<Rollout, Error>) -> bool {
        let Some(planned) = &mut self.planned else { return false };
        match planned.plan() {
            Ok(true) => {
                self.frames += 1;
                return true;
            }
            Ok(false) => {}
            Err(_) => return false,
        }
        if !planned.began {
            return self.trial.correct(planned.begin()).is_ok();
        }
        match self.trial.step() {
            Ok(Some(_)) => {
                self.frames += 1;
                true
            }
            Ok(None) => {
                let shift = planned.go_on(self.trial.reached()).to_vec();
                let more = planned.passes < planned::PASSES;
                let fair = unnatural(&self.trial) <= self.gaps;
                (!fair || self.keep_trial(fresh).is_ok())
                    && more
                    && self.trial.correct(&shift).is_ok()
            }
            Err(_) => false,
        }
    }

    /// Begins to search; false if every joint arrives by now.
    fn begin_search(&mut self, fresh: &dyn Fn() -> Result<Rollout, Error>) -> bool {
        // The plan has been followed.
        self.planned = None;
        let away = |l: &Learner| detour::budget(l.trial.goals(), l.trial.plan(), l.best_states());
        if self.budget == 0 || away(self) == 0 {
            return false;
        }
        // The first better try takes the place of a best motion, if there is none yet.
        let count = AT_ONCE + usize::from(self.best.is_none());
        let rollouts: Result<Vec<Rollout>, Error> = (0..count).map(|_| fresh()).collect();
        let Ok(rollouts) = rollouts else { return false };
        self.spare = rollouts;
        let plan = self.trial.plan();
        let none = vec![0.0; plan.frames() * plan.dim()];
        let (states, shift) = match &self.best {
            Some(best) => (best.states(), best.shift().unwrap_or(&none)),
            None => (&self.states[..], &none[..]),
        };
        self.detours = Some(Detours::new(self.trial.goals(), plan, states, shift));
        true
    }

    /// Some frames of each try.
    fn search(&mut self) -> bool {
        if self.attempts.iter().all(|a| !a.going) {
            self.adopt_best();
            if !self.next_tries() {
                return false;
            }
        }
        let Some(detours) = &self.detours else { return false };
        let before: usize = self.attempts.iter().map(|a| a.rollout.simulated()).sum();
        let mut going: Vec<&mut Attempt> = self.attempts.iter_mut().filter(|a| a.going).collect();
        let share = going.len().div_ceil(self.threads.max(1)).max(1);
        let advance = |some: &mut [&mut Attempt]| some.iter_mut().for_each(|a| a.advance(detours));
        std::thread::scope(|scope| {
            let mut shares = going.chunks_mut(share);
            let own = shares.next();
            shares.for_each(|some| drop(scope.spawn(move || advance(some))));
            own.map(advance);
        });
        let frames = self.attempts.iter().map(|a| a.rollout.simulated()).sum::<usize>() - before;
        self.frames += frames;
        self.budget = self.budget.saturating_sub(frames);
        if self.budget == 0 {
            self.adopt_best();
        }
        self.budget > 0
    }

    /// Begins the next tries; false if there is nothing to try.
    fn next_tries(&mut self) -> bool {
        let Some(detours) = &mut self.detours else { return false };
        self.spare.extend(self.attempts.drain(..).map(|a| a.rollout));
        for _ in 0..AT_ONCE {
            let Some(what) = detours.next(self.trial.goals()) else { break };
            let Some(mut rollout) = self.spare.pop() else { break };
            let begun = match &self.best {
                Some(best) => rollout.branch(best, &what.shift),
                None => rollout.correct(&what.shift),
            };
            // A try counts as a frame, so that the search ends even if tries change nothing.
            self.budget = self.budget.saturating_sub(1);
            self.frames += 1;
            self.attempts.push(Attempt { rollout, what, going: begun.is_ok() });
        }
        !self.attempts.is_empty()
    }

    /// Goes on from the best of the tries, if one is better.
    fn adopt_best(&mut self) {
        let score = |a: &Attempt| score(&a.rollout).filter(|_| a.rollout.is_done());
        let scores = self.attempts.iter().enumerate().filter_map(|(at, a)| Some((at, score(a)?)));
        let fair = scores.filter(|(at, e)| {
            *e < self.least && unnatural(&self.attempts[*at].rollout) <= self.gaps
        });
        let Some((at, _)) = fair.min_by(|a, b| a.1.total_cmp(&b.1)) else { return };
        let better = self.attempts.swap_remove(at).rollout;
        if let Some(detours) = &mut self.detours {
            detours.go_on(&better);
        }
        let spare = self.keep(better);
        self.spare.extend(spare);
    }

    fn end_pass(&mut self, fresh: &dyn Fn() -> Result<Rollout, Error>) -> Result<(), Error> {
        self.passes += 1;
        self.correction.learn(self.trial.plan(), self.trial.reached());
        self.keep_trial(fresh)?;
        self.trial.correct(&self.correction.shift)
    }

    /// Keeps the trial if it is better, and goes on with another rollout.
    fn keep_trial(&mut self, fresh: &dyn Fn() -> Result<Rollout, Error>) -> Result<(), Error> {
        if score(&self.trial).is_some_and(|e| e < self.least) {
            let next = match self.best.take() {
                Some(last) => last,
                None => fresh()?,
            };
            let better = std::mem::replace(&mut self.trial, next);
            self.keep(better);
        }
        Ok(())
    }

    /// Keeps a better motion; the one before.
    fn keep(&mut self, better: Rollout) -> Option<Rollout> {
        (self.least, self.gaps) = (score(&better).unwrap_or(self.least), unnatural(&better));
        self.improvements += 1;
        self.best.replace(better)
    }

    /// The best pass or try, if one is better than the motion from which it learned.
    pub(super) fn best(&self) -> Option<&Rollout> {
        self.best.as_ref()
    }

    /// See [`Learner::best`].
    pub(super) fn into_best(self) -> Option<Rollout> {
        self.best
    }
}

impl Attempt {
    fn advance(&mut self, detours: &Detours) {
        for _ in 0..CHUNK {
            // The plant may diverge with a correction.
            let moved = matches!(self.rollout.step(), Ok(Some(_)));
            self.going = moved && detours.promises(&mut self.what, &self.rollout);
            if !self.going {
                return;
            }
        }
    }
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
        let before = score(&first).unwrap();
        let mut learner = Learner::new(&policy, &first, fresh().unwrap(), 1).unwrap().unwrap();
        while learner.step(fresh) {}
        assert_eq!(learner.passes, PASSES);
        assert_eq!(learner.frames, PASSES * (first.frames() - 1), "nothing is left to search for");
        let best = learner.best().unwrap();
        assert!(score(best).unwrap() < 0.2 * before, "{} {before}", score(best).unwrap());
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
        let search = |threads| {
            let learner = Learner::new(&policy, &first, fresh().unwrap(), threads);
            let mut learner = learner.unwrap().unwrap();
            while learner.stage() != Stage::Search {
                assert!(learner.step(fresh));
            }
            let before = (learner.least, learner.gaps);
            let most = learner.frames_left() + AT_ONCE * CHUNK;
            let frames = learner.frames();
            while learner.step(fresh) {}
            assert!(learner.frames() - frames <= most, "{} of {most}", learner.frames() - frames);
            assert!(!learner.step(fresh) && learner.frames_left() == 0, "it is over for good");
            (before, learner)
        };
        let ((passes, gaps), learner) = search(1);
        assert!(learner.least < passes, "{} {passes}", learner.least);
        assert!(learner.gaps <= gaps, "no way leads through unnatural motion in gaps");
        let (_, on_three) = search(3);
        assert_eq!(on_three.best().unwrap().actions(), learner.best().unwrap().actions());
        let best = learner.into_best().unwrap();
        let mut again = fresh().unwrap();
        again.correct(best.shift().unwrap()).unwrap();
        again.run(&Cancel::default()).unwrap();
        assert_eq!(again.actions(), best.actions());
    }
}
