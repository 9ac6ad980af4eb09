//! How the motion of a policy is improved after it has performed a clip.
//!
//! The best contenders repeat the clip and correct their goals ([`super::ilc`]). The nearest one goes
//! on: if joints still stay away from their goals, or move unnaturally in a gap, it follows the path of
//! a planner ([`super::planned`]), and then searches for detours ([`super::detour`]). If a joint still
//! jams, it searches again under a strict judge ([`super::judge`]). Where an error or a jolt is left that
//! could be seen, the planner's own motion counts as well, if it is clearly better.

use super::detour::{self, Detours, Try};
use super::error::Error;
use super::gaps::unnatural;
use super::ilc::Repeats;
use super::jam::{self, Off};
use super::judge::Judge;
use super::planned::{self, Planned};
use super::policy_config::PolicyConfig;
use super::run::Rollout;

/// The number of checks of a search.
const CHECKS: usize = 4;
/// The share of the error that a search must gain between two checks to go on.
const GAINS: f64 = 0.0005;
/// The number of contenders that repeat the clip.
pub(super) const RACERS: usize = 3;
/// A search under a strict judge may simulate a share of the frames: one in so many.
const STRICT: usize = 2;
/// The score from which a planner performs the clip although every joint arrives, rad or m: smaller errors
/// cannot be seen.
pub(super) const VISIBLE_ERROR: f64 = 0.001;
/// The penalty for unnatural motion in gaps and for a missed frame from which a planner performs the clip
/// as well, rad or m: for instance a mean jerk of 3.1.
const UNNATURAL: f64 = 1e-4;
/// The share of the score that the planner's own motion must gain to be kept. Policies that learned go
/// first, because they need no model to run.
const CLEAR_GAIN: f64 = 0.03;
/// The share from which there is no search: so much is hardly found by chance.
const BEYOND_CHANCE: f64 = 0.1;
/// The share that it must gain to be kept although the contenders move more naturally in gaps: a pole that
/// stands is worth a jerk.
const FAR_NEARER: f64 = 0.5;
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

/// A clip that is performed again and again.
pub(super) struct Learner {
    /// The contenders that repeat the clip; after the passes, the best one alone.
    racers: Vec<Repeats>,
    /// The frames that the search may still simulate.
    budget: usize,
    /// The planner whose path is followed before the search.
    planned: Option<Planned>,
    /// Planners whose turn comes after this one.
    plans: Vec<PolicyConfig>,
    /// The planner and its place after the contenders; `None` if its motion must not be chosen.
    planner: Option<(usize, PolicyConfig)>,
    /// The motion of the planner, its score, and whether it is as natural in gaps as the contenders'; once
    /// the policy has followed it.
    own: Option<(Rollout, f64, bool)>,
    /// Frames at which joints are off their goals on the planner's path, once it is known.
    floor: Option<Vec<Off>>,
    /// The frames of the search under a strict judge; 0 once it has begun.
    strict: usize,
    /// The smallest error of the motions from which the contenders learned. What is kept is better.
    first: f64,
    /// The largest penalty of these motions for unnatural motion in gaps. The planner's path may lead
    /// to as much; the search then stays below what it started from.
    natural: f64,
    /// The search, once it has begun.
    detours: Option<Detours>,
    /// The tries that are simulated now.
    attempts: Vec<Attempt>,
    /// Rollouts for more of them.
    spare: Vec<Rollout>,
    threads: usize,
    /// The budget at which the search ends unless it has gained enough since the last such check, and
    /// the error then.
    check: (usize, f64),
    check_every: usize,
    /// Frames simulated, but for the passes of the racers.
    frames: usize,
    over: bool,
}

impl Learner {
    /// A learner on `threads` threads, on whose number the result does not depend. `None` without a
    /// racer. `planner` is the planner whose motion may be chosen, and its place after the contenders.
    pub(super) fn new(
        racers: Vec<Repeats>,
        planner: Option<(usize, PolicyConfig)>,
        threads: usize,
    ) -> Option<Learner> {
        let first = racers.iter().map(|r| r.least).fold(f64::INFINITY, f64::min);
        let natural = racers.iter().map(|r| r.gaps).fold(0.0, f64::max);
        (!racers.is_empty()).then(|| Learner {
            racers,
            first,
            natural,
            budget: 0,
            planned: None,
            plans: Vec::new(),
            planner,
            own: None,
            floor: None,
            strict: 0,
            detours: None,
            attempts: Vec::new(),
            spare: Vec::new(),
            threads: threads.max(1),
            check: (0, f64::INFINITY),
            check_every: 0,
            frames: 0,
            over: false,
        })
    }

    /// Simulates some frames. False when there is nothing left to try. `fresh` makes a rollout of a
    /// contender at its beginning.
    pub(super) fn step(&mut self, fresh: impl Fn(usize) -> Result<Rollout, Error>) -> bool {
        let going = !self.over
            && match self.stage() {
                Stage::Search => self.search() || self.search_strictly(),
                Stage::Plan | Stage::Follow => {
                    self.follow() || self.next_plan() || self.begin_search(&fresh)
                }
                Stage::Correct => self.race() || self.begin_plan() || self.begin_search(&fresh),
            };
        self.over = !going;
        going
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

    /// Frames simulated so far.
    pub(super) fn frames(&self) -> usize {
        self.frames + self.racers.iter().map(|r| r.frames).sum::<usize>()
    }

    /// Frames that are still to be simulated in this stage, at most.
    pub(super) fn frames_left(&self) -> usize {
        match (self.stage(), &self.planned) {
            _ if self.over => 0,
            (Stage::Search, _) => self.budget,
            (Stage::Follow, Some(planned)) => planned.frames_left(self.lead().trial.frame()),
            (Stage::Plan, Some(planned)) => planned.frames_to_plan(),
            _ => self.racers.iter().map(Repeats::frames_left).sum(),
        }
    }

    /// Whether the passes are over and a planner's path or detours are tried.
    pub(super) fn searches(&self) -> bool {
        self.stage() != Stage::Correct && !self.over
    }

    /// The contender that leads.
    pub(super) fn at(&self) -> usize {
        match (self.own(), &self.planner) {
            (Some(_), Some((at, _))) => *at,
            _ => self.lead().at,
        }
    }

    /// The contender that leads among those that repeat the clip.
    pub(super) fn leader(&self) -> usize {
        self.lead().at
    }

    /// How often the contender that leads has found a better motion.
    pub(super) fn improvements(&self) -> usize {
        if self.own().is_some() { 1 } else { self.lead().improvements }
    }

    /// The motion of the contender that leads, if it is better than the one from which it learned.
    pub(super) fn best(&self) -> Option<&Rollout> {
        self.own().or_else(|| self.lead().best())
    }

    /// The planner's own motion, if it is clearly better.
    fn own(&self) -> Option<&Rollout> {
        self.own_by(CLEAR_GAIN)
    }

    /// The planner's own motion, if it gains this share of the score, or more if it is less natural in gaps.
    fn own_by(&self, share: f64) -> Option<&Rollout> {
        let lead = self.lead();
        let (motion, score, natural) = self.own.as_ref().filter(|_| falls_short(lead))?;
        let gain = if *natural { share } else { FAR_NEARER };
        (*score < (1.0 - gain) * lead.least).then_some(motion)
    }

    /// See [`Learner::best`], and the contender.
    pub(super) fn into_best(mut self) -> Option<(usize, Rollout)> {
        let at = self.at();
        if self.own().is_some() {
            return self.own.map(|(motion, ..)| (at, motion));
        }
        let lead = self.racers.swap_remove(self.place());
        Some((at, lead.into_best()?))
    }

    /// The place of the racer with the smallest error, the first among equals.
    fn place(&self) -> usize {
        let places = self.racers.iter().enumerate();
        places.min_by(|(_, a), (_, b)| a.least.total_cmp(&b.least)).map_or(0, |(place, _)| place)
    }

    fn lead(&self) -> &Repeats {
        &self.racers[self.place()]
    }

    fn lead_mut(&mut self) -> &mut Repeats {
        let place = self.place();
        &mut self.racers[place]
    }

    /// Some frames of the passes of each racer; false after the last one.
    fn race(&mut self) -> bool {
        let mut going: Vec<_> = self.racers.iter_mut().filter(|r| !r.is_over()).collect();
        on_threads(self.threads, &mut going, |racer| racer.advance(CHUNK));
        !going.is_empty()
    }

    /// Begins to plan, if joints still stay away after the passes, or an error or a jolt is left that could
    /// be seen; false if not, or if no planner can.
    fn begin_plan(&mut self) -> bool {
        let all = self.frames();
        let lead = self.racers.swap_remove(self.place());
        self.frames = all - lead.frames;
        if lead.is_fast {
            self.budget = detour::budget(lead.trial.goals(), lead.trial.plan(), lead.best_states());
        }
        if lead.is_fast && planned::is_affordable(&lead.trial) {
            // Free of a guide it finds more ways around what blocks a joint; with one it moves naturally.
            let own = self.planner.iter().map(|(_, config)| config.clone());
            self.plans.extend(own.filter(|_| self.budget > 0 || falls_short(&lead)));
            let free = PolicyConfig::floor();
            if self.budget > 0 && !self.plans.contains(&free) {
                self.plans.push(free);
            }
        }
        self.racers = vec![lead];
        self.next_plan()
    }

    /// Judges the planner's own motion, and begins with the next planner; false after the last one.
    fn next_plan(&mut self) -> bool {
        if let Some(planned) = self.planned.take().filter(Planned::is_done) {
            self.floor.get_or_insert_with(|| planned.off(jam::NEAR));
            // Only the contender's settings lead to this motion again.
            let own = self.planner.as_ref().filter(|(_, config)| planned.config == *config);
            self.own = own.and_then(|_| self.score_own(planned.into_motion())).or(self.own.take());
        }
        let next = self.plans.pop();
        self.planned = next.and_then(|config| Planned::new(&self.lead().trial, &config).ok());
        self.planned.is_some()
    }

    /// A frame of the planner, and then of the passes that follow it; false after the last one.
    fn follow(&mut self) -> bool {
        let (Some(planned), [lead]) = (&mut self.planned, &mut self.racers[..]) else {
            return false;
        };
        match planned.plan() {
            Ok(true) => {
                self.frames += 1;
                return true;
            }
            Ok(false) => {}
            Err(_) => return false,
        }
        if !planned.began {
            return lead.trial.correct(planned.begin()).is_ok();
        }
        match lead.trial.step() {
            Ok(Some(_)) => {
                self.frames += 1;
                true
            }
            Ok(None) => {
                let shift = planned.go_on(lead.trial.reached()).to_vec();
                if unnatural(&lead.trial) <= self.natural {
                    lead.keep_trial();
                }
                planned.passes < planned::PASSES && lead.trial.correct(&shift).is_ok()
            }
            Err(_) => false,
        }
    }

    /// The planner's own motion, its score, and whether it is as natural in gaps as the least natural
    /// contender.
    fn score_own(&self, motion: Rollout) -> Option<(Rollout, f64, bool)> {
        let score = self.lead().judge().score(&motion)?;
        let natural = unnatural(&motion) <= self.natural;
        Some((motion, score, natural))
    }

    /// Begins to search; false if every joint arrives by now, or the planner's own motion is nearer by so
    /// much that a search will hardly find it.
    fn begin_search(&mut self, fresh: &dyn Fn(usize) -> Result<Rollout, Error>) -> bool {
        self.strict = self.budget / STRICT;
        let lead = self.lead();
        let (goals, plan, states) = (lead.trial.goals(), lead.trial.plan(), lead.best_states());
        let found = self.own_by(BEYOND_CHANCE).is_some();
        if found || self.budget == 0 || detour::budget(goals, plan, states) == 0 {
            return false;
        }
        // The first better try takes the place of a best motion, if there is none yet.
        let count = AT_ONCE + usize::from(lead.best().is_none());
        let rollouts: Result<Vec<Rollout>, Error> = (0..count).map(|_| fresh(lead.at)).collect();
        let Ok(rollouts) = rollouts else { return false };
        let none = vec![0.0; plan.frames() * plan.dim()];
        let shift = lead.best().and_then(Rollout::shift).unwrap_or(&none);
        self.detours = Some(Detours::new(goals, plan, states, shift, lead.judge()));
        self.spare = rollouts;
        self.check_every = self.budget / CHECKS;
        self.check = (self.budget - self.check_every, self.lead().least);
        true
    }

    /// Searches again if a joint jams in the best motion; false if none does.
    fn search_strictly(&mut self) -> bool {
        let budget = std::mem::take(&mut self.strict);
        // The tries that the end of the first search cut off were compared with another measure.
        self.spare.extend(self.attempts.drain(..).map(|a| a.rollout));
        let (Some(best), Some(floor)) = (self.lead().best(), &self.floor) else { return false };
        let jams = jam::jams(&jam::off(best.goals(), best.reached(), jam::FAR), floor);
        if budget == 0 || jams.is_empty() {
            return false;
        }
        let judge = Judge::strict(best, &jams, self.first);
        let shift = best.shift().unwrap_or_default();
        let detours = Detours::new(best.goals(), best.plan(), best.states(), shift, &judge);
        self.detours = Some(detours);
        self.lead_mut().judge_by(judge);
        self.own = self.own.take().and_then(|(motion, ..)| self.score_own(motion));
        if self.own().is_some() {
            return false;
        }
        self.budget = budget;
        self.check_every = budget / CHECKS;
        self.check = (budget - self.check_every, self.lead().least);
        true
    }

    /// Some frames of each try.
    fn search(&mut self) -> bool {
        if self.attempts.iter().all(|a| !a.going) {
            self.adopt_best();
            if self.stalls() || !self.next_tries() {
                return false;
            }
        }
        let Some(detours) = &self.detours else { return false };
        let before: usize = self.attempts.iter().map(|a| a.rollout.simulated()).sum();
        let mut going: Vec<_> = self.attempts.iter_mut().filter(|a| a.going).collect();
        on_threads(self.threads, &mut going, |a| a.advance(detours));
        let frames = self.attempts.iter().map(|a| a.rollout.simulated()).sum::<usize>() - before;
        self.frames += frames;
        self.budget = self.budget.saturating_sub(frames);
        if self.budget == 0 {
            self.adopt_best();
        }
        self.budget > 0
    }

    /// Whether the search has gained too little for its time.
    fn stalls(&mut self) -> bool {
        let (at, error) = self.check;
        if self.budget > at {
            return false;
        }
        let least = self.lead().least;
        self.check = (self.budget.saturating_sub(self.check_every), least);
        least > (1.0 - GAINS) * error
    }

    /// Begins the next tries; false if there is nothing to try.
    fn next_tries(&mut self) -> bool {
        let ([lead], Some(detours)) = (&self.racers[..], &mut self.detours) else { return false };
        self.spare.extend(self.attempts.drain(..).map(|a| a.rollout));
        for _ in 0..AT_ONCE {
            let Some(what) = detours.next(lead.trial.goals()) else { break };
            let Some(mut rollout) = self.spare.pop() else { break };
            let begun = match lead.best() {
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
        let (least, gaps) = (self.lead().least, self.lead().gaps);
        let judge = self.lead().judge();
        let score = |a: &Attempt| a.rollout.is_done().then(|| judge.score(&a.rollout)).flatten();
        let scores = self.attempts.iter().enumerate().filter_map(|(at, a)| Some((at, score(a)?)));
        let fair =
            scores.filter(|(at, e)| *e < least && unnatural(&self.attempts[*at].rollout) <= gaps);
        let Some((at, _)) = fair.min_by(|a, b| a.1.total_cmp(&b.1)) else { return };
        let better = self.attempts.swap_remove(at).rollout;
        if let Some(detours) = &mut self.detours {
            detours.go_on(&better);
        }
        let spare = self.lead_mut().keep(better);
        self.spare.extend(spare);
    }
}

/// Whether a person would see what is left.
fn falls_short(lead: &Repeats) -> bool {
    lead.least > VISIBLE_ERROR || lead.gaps > UNNATURAL
}

/// Lets `work` be done on each item, shared among threads.
fn on_threads<T: Send>(threads: usize, items: &mut [&mut T], work: impl Fn(&mut T) + Sync) {
    let share = items.len().div_ceil(threads).max(1);
    let each = |some: &mut [&mut T]| some.iter_mut().for_each(|item| work(item));
    std::thread::scope(|scope| {
        let mut shares = items.chunks_mut(share);
        let own = shares.next();
        let each = &each;
        shares.for_each(|some| drop(scope.spawn(move || each(some))));
        own.map(each);
    });
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
    use crate::{PolicyConfig, PolicyName, RolloutConfig, Start, tasks};
    use robert_base::progress::Cancel;
    use robert_clip::compile;
    use robert_robot::Robot;
    use std::sync::Arc;

    #[test]
    fn a_finger_that_is_blocked_goes_another_way() {
        let robot = Arc::new(Robot::builtin("shadow_hand").unwrap());
        let command = compile(&tasks::find("shadow_hand/thumb_inside", None).unwrap()).unwrap();
        let policy = PolicyConfig::new(PolicyName::Pd);
        let fresh = |_| {
            let built = policy.build(&robot)?;
            Rollout::new(&robot, built, &command, Start::Pose, RolloutConfig::default())
        };
        let mut first = fresh(0).unwrap();
        first.run(&Cancel::default()).unwrap();
        let search = |threads| {
            let rollouts = [fresh(0).unwrap(), fresh(0).unwrap()];
            let racer = Repeats::new((0, &policy), &first, rollouts).unwrap().unwrap();
            let mut learner = Learner::new(vec![racer], None, threads).unwrap();
            while learner.stage() != Stage::Search {
                assert!(learner.step(fresh));
            }
            let before = (learner.lead().least, learner.lead().gaps);
            let most = learner.frames_left() + learner.strict + 2 * AT_ONCE * CHUNK;
            let frames = learner.frames();
            while learner.step(fresh) {}
            assert!(learner.frames() - frames <= most, "{} of {most}", learner.frames() - frames);
            assert!(!learner.step(fresh) && learner.frames_left() == 0, "it is over for good");
            (before, learner)
        };
        let ((passes, gaps), learner) = search(1);
        let least = Judge::of(&robot).score(learner.best().unwrap()).unwrap();
        assert!(least < passes, "{least} {passes}");
        assert!(learner.lead().gaps <= gaps, "no way leads through unnatural motion in gaps");
        let (_, on_three) = search(3);
        assert_eq!(on_three.best().unwrap().actions(), learner.best().unwrap().actions());
        let best = learner.into_best().unwrap().1;
        let mut again = fresh(0).unwrap();
        again.correct(best.shift().unwrap()).unwrap();
        again.run(&Cancel::default()).unwrap();
        assert_eq!(again.actions(), best.actions());
    }
}
