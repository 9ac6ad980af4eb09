//! A search for a way around what blocks a joint.
//!
//! A finger that meets another one too early stays behind it for as long as both goals are held, and
//! repeated corrections of its goal do not take it around. This search moves the goals of a few joints at random, for
//! a moment or for a whole hold, near frames with a large error or with unnatural motion ([`super::search`]
//! performs these tries and keeps what makes a part of the motion better: a random local search). It knows
//! nothing of the model: each try is a rollout of the policy.

use std::ops::Range;

use super::goals::Goals;
use super::holds;
use super::jam;
use super::judge::Judge;
use super::lead::Lead;
use super::natural;
use super::parts::counted;
use super::run::Rollout;
use super::window::HISTORY;
use robert_base::rng::{Rng, Stream};

/// Frames that are simulated, as a multiple of those of the part.
const BUDGET: usize = 80;
/// Frames that are simulated at most in a part, for a robot of 24 joints.
const BUDGET_MOST: usize = 32_000;
/// Frames before a large error at which a movement begins.
const BEFORE: u64 = 20;
/// Frames after a large error at which a movement ends.
const AFTER: u64 = 25;
/// The share of movements that last for a whole hold, if the error is in a long one.
const WHOLE_HOLDS: f64 = 0.5;
/// Joints that move besides the one with the error, on average (nearly).
const OTHERS: f64 = 1.0;
/// The farthest that the search moves a goal in all, rad or m.
const FARTHEST: f64 = 0.5;
/// Frames over which a movement of a goal begins and ends.
const EASE: usize = 4;
/// A try ends when the sum of its errors is larger by so much, rad or m.
const PATIENCE: f64 = 0.2;
/// Weight of a joint that stays away for a second or more, beside one that is late.
const STAYS: f64 = 3.0;
/// Frames after the movements of goals at which a try is compared with the best motion up to there.
const SETTLES: usize = 20;

/// A joint at a frame, and its cost: by how much the sum of all errors would be less without it, rad or
/// m.
#[derive(Clone, Copy, Debug)]
struct Place {
    frame: usize,
    joint: usize,
    cost: f64,
}

/// The search about the best motion so far.
#[derive(Debug)]
pub(super) struct Detours {
    /// What leads that motion.
    lead: Lead,
    /// Its states, 30 of history first; (30 + frames, S).
    states: Vec<f64>,
    /// The frames whose goals move. Those after them are as they were, or not simulated yet.
    part: Range<usize>,
    /// The penalty of its gaps up to the end of the part, rad or m.
    gaps: f64,
    judge: Judge,
    /// Where joints stay away from their goals in it, or move unnaturally.
    places: Vec<Place>,
    /// The error of each of its frames, summed over joints.
    errors: Vec<f64>,
    tries: u64,
}

/// A correction that is tried.
#[derive(Debug)]
pub(super) struct Try {
    /// What leads it.
    pub(super) lead: Lead,
    /// The sum by which its errors are larger.
    worse: f64,
    /// The frames that were summed.
    summed: usize,
    /// The frame from which it is compared as soon as it gains nothing more.
    settled: usize,
    /// Whether it was compared.
    compared: bool,
}

impl Detours {
    /// Searches about a motion, which must have been simulated up to the end of the `part`.
    pub(super) fn new(motion: &Rollout, judge: &Judge, part: Range<usize>) -> Detours {
        let lead = motion.lead_or_none();
        Detours::about(motion.sought(), motion.plan(), motion.states(), lead, judge, part)
    }

    /// Searches about the motion with these `states`, (30 + frames, S), and this lead. The policy sees
    /// the `plan`.
    fn about(
        goals: &Goals,
        plan: &Goals,
        states: &[f64],
        lead: Lead,
        judge: &Judge,
        part: Range<usize>,
    ) -> Detours {
        let states = &states[..(HISTORY + part.end) * goals.dim()];
        let reached = reached(goals, states);
        Detours {
            lead,
            states: states.to_vec(),
            gaps: natural::counted(natural::penalty(goals, states)),
            places: places(goals, plan, states, judge, part.start),
            errors: (0..part.end).map(|f| judge.error_at(goals, reached, f)).collect(),
            judge: judge.clone(),
            part,
            tries: 0,
        }
    }

    /// Goes on from a better motion.
    pub(super) fn go_on(&mut self, better: &Rollout) {
        let new = Detours::new(better, &self.judge, self.part.clone());
        *self = Detours { tries: self.tries, ..new };
    }

    /// The next correction to be tried; none if every joint arrives and moves naturally.
    pub(super) fn next(&mut self, goals: &Goals) -> Option<Try> {
        self.tries += 1;
        let mut rng = Rng::new(0, Stream::Detour, self.tries);
        let mut ahead = rng.uniform() * self.places.iter().map(|p| p.cost).sum::<f64>();
        let place = *self
            .places
            .iter()
            .find(|p| {
                ahead -= p.cost;
                ahead <= 0.0
            })
            .or(self.places.last())?;
        let d = goals.dim();
        let mut lead = self.lead.clone();
        let (mut first, mut last) = (self.part.end, 0);
        // A short hold is covered by a movement anyway.
        let hold = holds::around(goals, place.frame, place.joint);
        let long = hold.filter(|hold| hold.len() as u64 > BEFORE + AFTER);
        let whole = long.filter(|_| rng.uniform() < WHOLE_HOLDS);
        for j in 0..d {
            if j != place.joint && rng.uniform() * d as f64 > OTHERS {
                continue;
            }
            let by = rng.range(-FARTHEST, FARTHEST);
            let before = place.frame.saturating_sub(rng.below(BEFORE) as usize);
            let after = place.frame + 1 + rng.below(AFTER) as usize;
            let (begin, end) = match &whole {
                Some(hold) => (hold.start.min(before), hold.end),
                None => (before, after),
            };
            let (begin, end) = (begin.max(self.part.start), end.min(self.part.end));
            (first, last) = (first.min(begin), last.max(end));
            for f in begin..end {
                let share = (f + 1 - begin).min(end - f).min(EASE) as f64 / EASE as f64;
                let s = &mut lead.shift[f * d + j];
                // A planner's path may be farther away already.
                let most = s.abs().max(FARTHEST);
                *s = (*s + by * share).clamp(-most, most);
            }
        }
        // Virtual keyframes may move earlier frames too; their errors are not summed, so such a try
        // may only end later.
        let summed = first.saturating_sub(super::window::COMMAND);
        // The motion of a gap is known at its end.
        let settled = (last + SETTLES..self.part.end).find(|&f| goals.any_visible(f));
        let settled = settled.unwrap_or(self.part.end);
        Some(Try { lead, worse: 0.0, summed, settled, compared: false })
    }

    /// Whether a try goes on after another frame: it may still become better than the best motion.
    pub(super) fn promises(&self, one: &mut Try, trial: &Rollout) -> bool {
        let (goals, frame) = (trial.sought(), trial.frame());
        while one.summed <= frame {
            let error = self.judge.error_at(goals, trial.reached(), one.summed);
            one.worse += error - self.errors[one.summed];
            one.summed += 1;
        }
        if one.worse >= PATIENCE {
            return false;
        }
        let gains = || self.judge.error_at(goals, trial.reached(), frame) < self.errors[frame];
        if one.compared || frame < one.settled || gains() {
            return true;
        }
        // From here on the motions are nearly the same again.
        one.compared = true;
        let mut whole = self.states.clone();
        whole[..trial.states().len()].copy_from_slice(trial.states());
        let gaps = natural::counted(natural::penalty(goals, &whole)) - self.gaps;
        one.worse + gaps * goals.commanded(&counted(&self.part)) < 0.0
    }

    /// Whether there is nothing to try: every joint arrives and moves naturally.
    pub(super) fn is_idle(&self) -> bool {
        self.places.is_empty()
    }
}

/// Whether a search may find something better than a motion: some joint stays away, or moves unnaturally.
/// `states` is (30 + frames, S).
pub(super) fn may_help(goals: &Goals, plan: &Goals, states: &[f64]) -> bool {
    !places(goals, plan, states, &Judge::default(), 1).is_empty()
}

/// The frames that the search of a part of so many frames may simulate, for a robot of `dim` joints.
pub(super) fn budget(frames: usize, dim: usize) -> usize {
    // The fewer joints a robot has, the faster it simulates and the more it can try in the same time.
    (BUDGET * frames).min(BUDGET_MOST) * 24 / dim.clamp(6, 240)
}

/// Joints and frames from `from` on that are far from their goals, and those with the worst motion in gaps and holds.
fn places(goals: &Goals, plan: &Goals, states: &[f64], judge: &Judge, from: usize) -> Vec<Place> {
    let (d, reached) = (goals.dim(), reached(goals, states));
    let end = (reached.len() / d).min(goals.frames());
    let place = |i: usize| {
        let (frame, joint) = (i / d, i % d);
        let error = (reached[i] - goals.row(frame)[joint]).abs();
        let cost = judge.weight(goals, frame, joint) * error;
        (goals.is_visible(frame, joint) && error > jam::FAR).then_some(Place { frame, joint, cost })
    };
    let mut found: Vec<_> = (from * d..end * d).filter_map(place).collect();
    for jam in
        jam::off(goals, reached, jam::FAR).iter().filter(|o| o.to - o.from >= jam::LEAST_FRAMES)
    {
        let stays = |p: &&mut Place| p.joint == jam.joint && (jam.from..jam.to).contains(&p.frame);
        found.iter_mut().filter(stays).for_each(|p| p.cost *= STAYS);
    }
    // Only goals that the policy sees can move.
    let near = |frame: usize, joint: usize| {
        let seen = (from..end).filter(|&f| plan.is_visible(f, joint));
        seen.min_by_key(|f| f.abs_diff(frame))
    };
    found.retain_mut(|p| {
        let seen = near(p.frame, p.joint);
        p.frame = seen.unwrap_or(p.frame);
        seen.is_some()
    });
    for natural::Place { frame, joint, penalty } in natural::places(goals, states) {
        let inside = frame >= from;
        if let Some(frame) = near(frame, joint).filter(|_| inside) {
            found.push(Place { frame, joint, cost: penalty * goals.commanded(&(from..end)) });
        }
    }
    found
}

/// `states` from frame 0 on.
fn reached<'a>(goals: &Goals, states: &'a [f64]) -> &'a [f64] {
    &states[HISTORY * goals.dim()..]
}

#[cfg(test)]
mod tests {
    use super::*;
    use robert_clip::Command;

    const FRAMES: usize = 60;

    /// Three joints with the same goals, by frame.
    fn goals(at: impl Fn(usize) -> f32) -> Goals {
        let names = ["a", "b", "c"].map(str::to_owned).to_vec();
        let (q, seen) = ((0..3 * FRAMES).map(|i| at(i / 3)).collect(), vec![true; 3 * FRAMES]);
        Goals::new(&Command::from_dense(names, vec![0.0; 3], q, seen).unwrap())
    }

    /// At rest before frame 0, and then one joint away from frame `from` to `to`.
    fn away(joint: usize, from: usize, to: usize) -> Vec<f64> {
        let mut states = vec![0.0; 3 * (HISTORY + FRAMES)];
        (from..to).for_each(|f| states[3 * (HISTORY + f) + joint] = 0.2);
        states
    }

    fn about(goals: &Goals, states: &[f64], shift: f64, part: Range<usize>) -> Detours {
        let lead = Lead::of(vec![shift; 3 * FRAMES]);
        Detours::about(goals, goals, states, lead, &Judge::default(), part)
    }

    #[test]
    fn goals_move_near_the_joint_that_stays_away_and_no_farther_than_allowed() {
        // Hardly a hold.
        let goals = goals(|f| 1e-5 * f as f32);
        let states = away(1, 30, 55);
        assert!(may_help(&goals, &goals, &states));
        assert_eq!(budget(FRAMES, goals.dim()), 4 * BUDGET * FRAMES);
        let mut detours = about(&goals, &states, 0.4, 1..FRAMES);
        let mut moved = [0; 3];
        for _ in 0..200 {
            let tried = detours.next(&goals).unwrap().lead.shift;
            for (i, s) in tried.iter().enumerate().filter(|(_, s)| **s != 0.4) {
                assert!(s.abs() <= FARTHEST && (10..FRAMES).contains(&(i / 3)), "{i}: {s}");
                moved[i % 3] += 1;
            }
        }
        assert!(moved[1] > moved[0] && moved[1] > moved[2] && moved[0] > 0, "{moved:?}");
    }

    #[test]
    fn half_of_the_movements_last_for_a_long_hold() {
        let states = away(1, 10, 40);
        let spans = |goals: &Goals| {
            let mut detours = about(goals, &states, 0.0, 1..FRAMES);
            let mut span = || {
                let tried = detours.next(goals).unwrap().lead.shift;
                let moved = (0..3 * FRAMES).filter(|i| tried[*i] != 0.0).map(|i| i / 3);
                (moved.clone().min().unwrap(), moved.max().unwrap())
            };
            (0..100).map(|_| span()).filter(|s| *s == (1, FRAMES - 1)).count()
        };
        assert!((30..70).contains(&spans(&goals(|_| 0.0))));
        // A goal that moves, and a hold that a movement of a moment covers.
        assert_eq!(spans(&goals(|f| 1e-3 * f as f32)), 0);
        assert_eq!(spans(&goals(|f| f32::from(u8::from(f >= 40)))), 0);
    }

    #[test]
    fn nothing_is_tried_where_every_joint_arrives() {
        let goals = goals(|_| 0.0);
        let states: Vec<f64> = away(0, 30, 40).iter().map(|x| 0.2 * x).collect();
        assert!(!may_help(&goals, &goals, &states));
        let mut detours = about(&goals, &states, 0.0, 1..FRAMES);
        assert!(detours.is_idle() && detours.next(&goals).is_none());
    }

    #[test]
    fn only_goals_of_the_part_move() {
        let goals = goals(|_| 0.0);
        let mut states = away(1, 30, 55);
        (10..20).for_each(|f| states[3 * (HISTORY + f)] = 0.2);
        let mut detours = about(&goals, &states, 0.0, 28..50);
        for _ in 0..100 {
            let tried = detours.next(&goals).unwrap();
            let moved: Vec<_> = (0..3 * FRAMES).filter(|i| tried.lead.shift[*i] != 0.0).collect();
            assert!(moved.iter().all(|i| (28..50).contains(&(i / 3))), "{moved:?}");
            assert!(tried.settled <= 50);
        }
        // What happens before the part, and after it, is none of its business.
        assert!(about(&goals, &states, 0.0, 20..30).is_idle());
        assert!(!about(&goals, &states, 0.0, 1..20).is_idle());
    }

    #[test]
    fn a_swing_past_the_keys_is_a_place_too() {
        let names = ["a", "b", "c"].map(str::to_owned).to_vec();
        let seen = (0..3 * FRAMES).map(|i| i / 3 >= 20).collect();
        let command =
            Command::from_dense(names, vec![0.0; 3], vec![0.0; 3 * FRAMES], seen).unwrap();
        let goals = Goals::new(&command);
        let found = places(&goals, &goals.smooth(), &away(2, 8, 11), &Judge::default(), 1);
        let all: Vec<_> = found.iter().map(|p| p.joint).collect();
        assert_eq!(all, [2], "{found:?}");
        assert!((8..11).contains(&found[0].frame));
        // A policy that does not see goals in the gap is led by the nearest one.
        assert_eq!(places(&goals, &goals, &away(2, 8, 11), &Judge::default(), 1)[0].frame, 20);
        // .18 rad beyond the allowance, which weighs .06 of the Precision of 40 frames.
        assert!((found[0].cost - 0.18 * 0.06 * 3.0 * 40.0).abs() < 1e-9, "{found:?}");
    }
}
