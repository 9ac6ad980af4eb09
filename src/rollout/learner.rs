//! How the motion of a policy is improved after it has performed a clip.
//!
//! The best contenders repeat the clip and correct their goals ([`super::ilc`]). The nearest one goes
//! on: if joints still stay away from their goals, or move unnaturally in a gap, it follows the path of
//! a planner ([`super::planned`]), and then searches for detours ([`super::search`]). If a joint still
//! jams, it searches again under a strict judge ([`super::judge`]). Where an error or a jolt is left that
//! could be seen, the planner's own motion counts as well, if it is clearly better. In the end rough gaps of a
//! policy's motion are made softer ([`super::soften`]).

use super::detour;
use super::error::Error;
use super::ilc::Repeats;
use super::jam::{self, Off};
use super::lead::Lead;
use super::natural::{counted, unnatural, unnatural_but_for_jolts};
use super::planned::{self, Planned};
use super::policy_config::PolicyConfig;
use super::run::Rollout;
use super::search::{self, Search};
use super::soften::Softening;

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
/// The share of the score, or of the error in it, that it must gain to be kept although the contenders move more
/// naturally in gaps: a pole that stands is worth a jerk.
const FAR_NEARER: f64 = 0.5;
/// The share of the error that it must gain to be kept, however it moves in gaps, where a joint of the policy
/// jams to the end, that is, where the planner's arrives: a finger that stays caught is worse than a jolt.
const FREED: f64 = 0.25;
/// Frames by which one step advances each contender.
const CHUNK: usize = 8;

/// The motion of a planner.
struct Own {
    /// The planner's place after the contenders.
    at: usize,
    motion: Rollout,
    score: f64,
    /// The part of the score that is the penalty for unnatural motion in gaps.
    gaps: f64,
    /// The same, with little for jerk.
    but_for_jolts: f64,
    /// Whether it is as natural in gaps as the contenders'.
    natural: bool,
    /// Its error, if it may take the place of a motion in which a joint jams.
    error: Option<f64>,
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
    /// Tries of softer motion in gaps.
    Soften,
}

impl Stage {
    /// The title of a progress bar.
    pub(super) fn title(self) -> &'static str {
        match self {
            Stage::Correct => "correct the goals",
            Stage::Plan => "plan a path",
            Stage::Follow => "follow the path",
            Stage::Search => "search",
            Stage::Soften => "soften the gaps",
        }
    }
}

/// A clip that is performed again and again.
pub(super) struct Learner {
    /// The contenders that repeat the clip; after the passes, the best one alone.
    racers: Vec<Repeats>,
    /// Whether joints stay away or move unnaturally after the passes.
    wanted: bool,
    /// The planner whose path is followed before the search.
    planned: Option<Planned>,
    /// Planners whose turn comes after this one.
    plans: Vec<PolicyConfig>,
    /// The planners whose motions may be chosen, and their places after the contenders.
    planners: Vec<(usize, PolicyConfig)>,
    /// Their motions, once the policy has followed them.
    own: Vec<Own>,
    /// Frames at which joints are off their goals on the planner's path, once it is known.
    floor: Option<Vec<Off>>,
    /// Whether a strict judge decides by now.
    is_strict: bool,
    /// The smallest error of the motions from which the contenders learned. What is kept is better.
    first: f64,
    /// The smallest sum of error and penalty of all that were tried, which a motion that is chosen must
    /// have less than.
    tried: f64,
    /// The largest penalty of these motions for unnatural motion in gaps. The planner's path may lead
    /// to as much; the search then stays below what it started from.
    natural: f64,
    /// The search, once it has begun.
    search: Option<Search>,
    /// The softening of gaps, while it goes on.
    softening: Option<Softening>,
    threads: usize,
    /// Frames simulated by planners and the passes that follow them.
    frames: usize,
    over: bool,
}

impl Learner {
    /// A learner on `threads` threads, on whose number the result does not depend. `None` without a
    /// racer. `planners` are those whose motions may be chosen, and their places after the contenders; `tried` is
    /// the smallest sum of error and penalty so far.
    pub(super) fn new(
        racers: Vec<Repeats>,
        planners: Vec<(usize, PolicyConfig)>,
        tried: f64,
        threads: usize,
    ) -> Option<Learner> {
        let first = racers.iter().map(|r| r.least).fold(f64::INFINITY, f64::min);
        let natural = racers.iter().map(|r| r.gaps).fold(0.0, f64::max);
        (!racers.is_empty()).then(|| Learner {
            racers,
            first,
            tried,
            natural,
            wanted: false,
            planned: None,
            plans: Vec::new(),
            planners,
            own: Vec::new(),
            floor: None,
            is_strict: false,
            search: None,
            softening: None,
            threads: threads.max(1),
            frames: 0,
            over: false,
        })
    }

    /// Simulates some frames. False when there is nothing left to try. `fresh` makes a rollout of a
    /// contender at its beginning.
    pub(super) fn step(&mut self, fresh: impl Fn(usize) -> Result<Rollout, Error>) -> bool {
        let going = !self.over
            && match self.stage() {
                Stage::Search => {
                    self.search() || self.search_strictly() || self.begin_softening(&fresh)
                }
                Stage::Soften => self.soften(),
                Stage::Plan | Stage::Follow => {
                    self.follow()
                        || self.next_plan()
                        || self.begin_search(&fresh)
                        || self.begin_softening(&fresh)
                }
                Stage::Correct => {
                    self.race()
                        || self.begin_plan()
                        || self.begin_search(&fresh)
                        || self.begin_softening(&fresh)
                }
            };
        self.over = !going;
        going
    }

    /// What the next step belongs to.
    pub(super) fn stage(&self) -> Stage {
        match (&self.planned, &self.search) {
            _ if self.softening.is_some() => Stage::Soften,
            (_, Some(_)) => Stage::Search,
            (Some(planned), None) if planned.began => Stage::Follow,
            (Some(_), None) => Stage::Plan,
            (None, None) => Stage::Correct,
        }
    }

    /// Frames simulated so far.
    pub(super) fn frames(&self) -> usize {
        let searched = self.search.as_ref().map_or(0, Search::frames);
        let softened = self.softening.as_ref().map_or(0, Softening::frames);
        self.frames + searched + softened + self.racers.iter().map(|r| r.frames).sum::<usize>()
    }

    /// Frames that are still to be simulated in this stage, at most.
    pub(super) fn frames_left(&self) -> usize {
        match (&self.search, &self.planned) {
            _ if self.over => 0,
            _ if let Some(softening) = &self.softening => softening.frames_left(),
            (Some(search), _) => search.frames_left(),
            (None, Some(planned)) if planned.began => {
                planned.frames_left(self.lead().trial.frame())
            }
            (None, Some(planned)) => planned.frames_to_plan(),
            (None, None) => self.racers.iter().map(Repeats::frames_left).sum(),
        }
    }

    /// Whether the passes are over and a planner's path or detours are tried.
    pub(super) fn searches(&self) -> bool {
        self.stage() != Stage::Correct && !self.over
    }

    /// The contender that leads.
    pub(super) fn at(&self) -> usize {
        self.own().map_or(self.lead().at, |own| own.at)
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
        self.own().map(|own| &own.motion).or_else(|| self.lead().best())
    }

    /// The best motion of a planner, if it is clearly better, or if only the policy's jams.
    fn own(&self) -> Option<&Own> {
        self.own_by(CLEAR_GAIN).or_else(|| self.freed())
    }

    /// The nearest motion of a planner, if it gains [`FREED`] and a joint of the policy still jams.
    fn freed(&self) -> Option<&Own> {
        let best = self.lead().best().filter(|best| !self.jams(best).is_empty())?;
        let most = (1.0 - FREED) * best.errors()?.judged;
        let near = self.own.iter().filter_map(|own| Some((own, own.error.filter(|e| *e < most)?)));
        near.min_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(own, _)| own)
    }

    /// The jams of a motion: none before a planner's path is known.
    fn jams(&self, motion: &Rollout) -> Vec<Off> {
        let far = || jam::off(motion.sought(), motion.reached(), jam::FAR);
        self.floor.as_ref().map_or_else(Vec::new, |floor| jam::jams(&far(), floor))
    }

    /// The best motion of a planner that gains this share of the score, or more if it is less natural in gaps.
    fn own_by(&self, share: f64) -> Option<&Own> {
        let lead = self.lead();
        let far_nearer = |own: f64, lead: f64| own < (1.0 - FAR_NEARER) * lead;
        let nearer = |own: &Own| {
            far_nearer(own.score, lead.least)
                || far_nearer(own.score - own.gaps, lead.least - counted(lead.gaps))
        };
        let gains = |own: &&Own| {
            let error = own.score - own.gaps;
            let worth_a_jolt = far_nearer(error, lead.least - counted(lead.gaps))
                && error + own.but_for_jolts < (1.0 - share) * lead.least;
            worth_a_jolt || own.score < (1.0 - share) * lead.least && (own.natural || nearer(own))
        };
        let found = self.own.iter().filter(|_| falls_short(lead)).filter(gains);
        found.min_by(|a, b| a.score.total_cmp(&b.score))
    }

    /// See [`Learner::best`], and the contender.
    pub(super) fn into_best(mut self) -> Option<(usize, Rollout)> {
        if let Some(at) = self.own().map(|own| own.at) {
            let own = self.own.into_iter().find(|own| own.at == at)?;
            return Some((at, own.motion));
        }
        let at = self.at();
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
        search::on_threads(self.threads, &mut going, |racer| racer.advance(CHUNK));
        !going.is_empty()
    }

    /// Begins to plan, if joints still stay away after the passes, or an error or a jolt is left that could
    /// be seen; false if not, or if no planner can.
    fn begin_plan(&mut self) -> bool {
        let all = self.frames();
        let lead = self.racers.swap_remove(self.place());
        self.frames = all - lead.frames;
        let (goals, plan) = (lead.trial.sought(), lead.trial.plan());
        self.wanted = lead.is_fast && detour::may_help(goals, plan, lead.best_states());
        if lead.is_fast && planned::is_affordable(&lead.trial) {
            // Free of a guide it finds more ways around what blocks a joint; with one it moves naturally.
            let own = self.planners.iter().map(|(_, config)| config.clone()).take(1);
            self.plans.extend(own.filter(|_| self.wanted || falls_short(&lead)));
            let free = PolicyConfig::floor();
            if self.wanted && !self.plans.contains(&free) {
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
            let own = self.planners.iter().find(|(_, config)| planned.config == *config);
            if let Some(&(at, _)) = own {
                self.own.extend(self.score_own(at, planned.into_motion()));
            }
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
            return lead.trial.correct(Lead::of(planned.begin().to_vec())).is_ok();
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
                planned.passes < planned::PASSES && lead.trial.correct(Lead::of(shift)).is_ok()
            }
            Err(_) => false,
        }
    }

    /// The motion of the planner `at` this place, if the judge admits it.
    fn score_own(&self, at: usize, motion: Rollout) -> Option<Own> {
        let score = self.lead().judge().score(&motion)?;
        let gaps = unnatural(&motion);
        let natural = gaps <= self.natural;
        let but_for_jolts = counted(unnatural_but_for_jolts(&motion));
        let gaps = counted(gaps);
        Some(Own { at, motion, score, gaps, but_for_jolts, natural, error: None })
    }

    /// Begins to search; false if every joint arrives by now, or the planner's own motion is nearer by so
    /// much that a search will hardly find it.
    fn begin_search(&mut self, fresh: &dyn Fn(usize) -> Result<Rollout, Error>) -> bool {
        let lead = self.lead();
        let found = self.own_by(BEYOND_CHANCE).is_some();
        let may_help = detour::may_help(lead.trial.sought(), lead.trial.plan(), lead.best_states());
        if !self.wanted || found || !may_help {
            return false;
        }
        self.search = Search::new(lead.best(), lead.judge(), self.threads, || fresh(lead.at)).ok();
        self.search.is_some()
    }

    /// Some frames of the search; false at its end.
    fn search(&mut self) -> bool {
        let Some(search) = &mut self.search else { return false };
        let going = search.step();
        self.keep_found();
        going
    }

    /// Ends the search. What it found until now counts.
    pub(super) fn stop(&mut self) {
        self.over = true;
        self.keep_softer();
        if let Some(search) = &mut self.search {
            search.stop();
            self.keep_found();
        }
    }

    /// Keeps the motion of the search, if it is better.
    fn keep_found(&mut self) {
        let (Some(search), [lead]) = (&mut self.search, &mut self.racers[..]) else { return };
        if let Some(better) = search.offer(lead.least, lead.gaps) {
            search.give_back(lead.keep(better));
        }
    }

    /// Some frames of softer motion in gaps; false at its end, or if there is nothing to soften.
    fn soften(&mut self) -> bool {
        let Some(softening) = &mut self.softening else { return false };
        let going = softening.step();
        if !going {
            self.keep_softer();
        }
        going
    }

    /// Ends the softening, and keeps its motion if it is softer.
    fn keep_softer(&mut self) {
        let Some(softening) = self.softening.take() else { return };
        self.frames += softening.frames();
        let Some(softer) = softening.into_motion() else { return };
        let sum = softer.errors().map(|e| e.judged + counted(unnatural(&softer)));
        if let [lead] = &mut self.racers[..]
            && sum.is_some_and(|sum| sum < self.tried)
        {
            lead.keep(softer);
        }
    }

    /// Begins to soften the best motion of the policy; false if it is natural, or if a planner's motion is chosen
    /// and natural.
    fn begin_softening(&mut self, fresh: &dyn Fn(usize) -> Result<Rollout, Error>) -> bool {
        match self.own().map(|own| own.gaps) {
            // What is softer may be a little farther away, but not so far that the planner is chosen after all.
            None => self.own.clear(),
            Some(gaps) if gaps <= 0.0 => return false,
            Some(_) => {}
        }
        let lead = self.lead();
        if !lead.is_fast || lead.gaps <= 0.0 {
            return false;
        }
        let least = lead.best().and_then(|best| lead.judge().usual(best)).unwrap_or(lead.least);
        let judge = lead.judge().gentle(least, self.first);
        self.softening = Softening::new(lead.best(), judge, self.threads, &|| fresh(lead.at)).ok();
        // Its rollouts take much memory.
        self.frames += self.search.take().map_or(0, |search| search.frames());
        self.softening.is_some()
    }

    /// Searches again if a joint jams in the best motion; false if none does.
    fn search_strictly(&mut self) -> bool {
        let Some(best) = self.lead().best() else { return false };
        let jams = self.jams(best);
        if self.is_strict || jams.is_empty() {
            return false;
        }
        let judge = self.lead().judge().strict(best, &jams, self.first);
        self.is_strict = true;
        self.lead_mut().judge_by(judge.clone());
        for own in &mut self.own {
            // What is chosen must lead all that were tried.
            let error = own.score - own.gaps;
            own.error = Some(error).filter(|error| error + own.but_for_jolts < self.tried);
            // What the judge refuses can only be chosen instead of a motion with a jam.
            own.score = judge.score(&own.motion).unwrap_or(f64::INFINITY);
        }
        if self.own_by(CLEAR_GAIN).is_some() {
            return false;
        }
        let (Some(search), [lead]) = (&mut self.search, &self.racers[..]) else { return false };
        lead.best().is_some_and(|best| search.again(best, &judge, &jams).is_ok())
    }
}

/// Whether a person would see what is left.
fn falls_short(lead: &Repeats) -> bool {
    lead.least > VISIBLE_ERROR || lead.gaps > UNNATURAL
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::judge::Judge;
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
            let racer =
                Repeats::new((0, &policy), &first, rollouts, Judge::default()).unwrap().unwrap();
            let mut learner =
                Learner::new(vec![racer], Vec::new(), f64::INFINITY, threads).unwrap();
            while learner.stage() != Stage::Search {
                assert!(learner.step(fresh));
            }
            let before = (learner.lead().least, learner.lead().gaps);
            // The second search has half of the frames, and the last step of each may exceed them a little.
            let most = learner.frames_left() * 3 / 2 + 2 * search::AT_ONCE * CHUNK;
            let frames = learner.frames();
            while learner.step(fresh) {}
            assert!(learner.frames() - frames <= most, "{} of {most}", learner.frames() - frames);
            assert!(!learner.step(fresh) && learner.frames_left() == 0, "it is over for good");
            (before, learner)
        };
        let ((passes, gaps), learner) = search(1);
        let least = Judge::default().score(learner.best().unwrap()).unwrap();
        assert!(least < passes, "{least} {passes}");
        assert!(learner.lead().gaps <= gaps, "no way leads through unnatural motion in gaps");
        let (_, on_three) = search(3);
        assert_eq!(on_three.best().unwrap().actions(), learner.best().unwrap().actions());
        the_freed_one_takes_its_place_while_it_jams(on_three, &first);
        let best = learner.into_best().unwrap().1;
        let mut again = fresh(0).unwrap();
        again.correct(best.lead().unwrap().clone()).unwrap();
        again.run(&Cancel::default()).unwrap();
        assert_eq!(again.actions(), best.actions());
    }

    fn the_freed_one_takes_its_place_while_it_jams(mut learner: Learner, first: &Rollout) {
        let built = PolicyConfig::new(PolicyName::Pd).build(first.robot()).unwrap();
        let command = compile(&tasks::find("shadow_hand/thumb_inside", None).unwrap()).unwrap();
        let config = RolloutConfig::default();
        let mut motion = Rollout::new(first.robot(), built, &command, Start::Pose, config).unwrap();
        motion.run(&Cancel::default()).unwrap();
        let best = learner.lead().best().unwrap();
        let (error, off) =
            (best.errors().unwrap().judged, jam::off(best.sought(), best.reached(), jam::FAR));
        let (at, score, gaps, but_for_jolts) = (7, f64::INFINITY, 0.0, 0.0);
        let own = Own { at, motion, score, gaps, but_for_jolts, natural: false, error: None };
        learner.own = vec![own];
        // Off by as much on the planner's path: nothing jams.
        learner.floor = Some(off.clone());
        assert!(!off.is_empty());
        learner.own[0].error = Some(0.7 * error);
        assert_eq!(learner.at(), 0);
        learner.floor = Some(Vec::new());
        assert_eq!(learner.at(), 7);
        learner.own[0].error = Some(0.8 * error);
        assert_eq!(learner.at(), 0, "it must gain a quarter");
        learner.own[0].error = None;
        assert_eq!(learner.at(), 0, "others that were tried lead");
        learner.own[0].error = Some(0.7 * error);
        assert_eq!(learner.into_best().unwrap().0, 7);
    }
}
