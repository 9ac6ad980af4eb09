//! A search for a way around what blocks a joint.
//!
//! A finger that meets another one too early stays behind it for as long as both goals are held, and
//! repeated corrections of its goal do not take it around. This search moves the goals of a few joints for a
//! moment, at random, near frames with a large error, and keeps what makes the whole motion better
//! (a random local search). It knows nothing of the model: each try is a rollout of the policy.

use super::jam;
use super::run::Rollout;
use super::window::Goals;
use robert_base::rng::{Rng, Stream};

/// Frames that are simulated, as a multiple of those of the clip, and at most.
const BUDGET: usize = 24;
const MOST: usize = 16_000;
/// Frames before a large error at which a movement begins, and after it at which it ends.
const BEFORE: u64 = 20;
const AFTER: u64 = 25;
/// Joints that move besides the one with the error, on average (nearly).
const OTHERS: f64 = 1.0;
/// The farthest that a goal moves in all, rad or m.
const FARTHEST: f64 = 0.5;
/// Frames over which a movement of a goal begins and ends.
const EASE: usize = 4;
/// A try ends when the sum of its errors is larger by so much, rad or m.
const PATIENCE: f64 = 0.2;

/// A joint at a frame.
#[derive(Clone, Copy, Debug)]
struct Place {
    frame: usize,
    joint: usize,
    error: f64,
}

/// The search in one motion.
#[derive(Debug)]
pub(super) struct Detours {
    /// The correction of the best motion; (frames, S).
    shift: Vec<f64>,
    /// Where joints stay away from their goals in it.
    places: Vec<Place>,
    /// The error of each of its frames, summed over joints.
    errors: Vec<f64>,
    /// The present try, the sum by which its errors are larger, and the frames that were summed.
    tried: Vec<f64>,
    worse: f64,
    summed: usize,
    tries: u64,
    frames_left: usize,
}

impl Detours {
    /// Searches in a motion with the correction `shift`; both are (frames, S).
    pub(super) fn new(goals: &Goals, reached: &[f64], shift: &[f64]) -> Detours {
        let mut new = Detours {
            shift: shift.to_vec(),
            places: Vec::new(),
            errors: Vec::new(),
            tried: Vec::new(),
            worse: 0.0,
            summed: 0,
            tries: 0,
            frames_left: budget(goals, reached),
        };
        new.go_on(goals, reached, shift);
        new
    }

    /// Goes on from a better motion.
    pub(super) fn go_on(&mut self, goals: &Goals, reached: &[f64], shift: &[f64]) {
        self.shift = shift.to_vec();
        self.errors = (0..goals.frames()).map(|f| error_at(goals, reached, f)).collect();
        self.places = places(goals, reached);
    }

    /// The next correction to be tried; none if no joint stays away, or the budget is spent.
    pub(super) fn next(&mut self, goals: &Goals) -> Option<&[f64]> {
        // A try that changes nothing counts too, so that the search comes to an end.
        self.frames_left = self.frames_left.checked_sub(1)?;
        self.tries += 1;
        let mut rng = Rng::new(0, Stream::Detour, self.tries);
        let mut ahead = rng.uniform() * self.places.iter().map(|p| p.error).sum::<f64>();
        let place = *self
            .places
            .iter()
            .find(|p| {
                ahead -= p.error;
                ahead <= 0.0
            })
            .or(self.places.last())?;
        let d = goals.dim();
        self.tried.clone_from(&self.shift);
        let mut first = goals.frames();
        for j in 0..d {
            if j != place.joint && rng.uniform() * d as f64 > OTHERS {
                continue;
            }
            let by = rng.range(-FARTHEST, FARTHEST);
            let begin = place.frame.saturating_sub(rng.below(BEFORE) as usize).max(1);
            let end = (place.frame + 1 + rng.below(AFTER) as usize).min(goals.frames());
            first = first.min(begin);
            for f in begin..end {
                let share = (f + 1 - begin).min(end - f).min(EASE) as f64 / EASE as f64;
                let s = &mut self.tried[f * d + j];
                *s = (*s + by * share).clamp(-FARTHEST, FARTHEST);
            }
        }
        // Virtual keyframes may move earlier frames too; their errors are not summed, so such a try
        // may only end later.
        (self.worse, self.summed) = (0.0, first.saturating_sub(super::window::COMMAND));
        Some(&self.tried)
    }

    /// Frames that may still be simulated.
    pub(super) fn frames_left(&self) -> usize {
        self.frames_left
    }

    /// Whether the try goes on: it may still become better than the best motion.
    pub(super) fn promises(&mut self, trial: &Rollout) -> bool {
        self.frames_left = self.frames_left.saturating_sub(1);
        while self.summed <= trial.frame() {
            let error = error_at(trial.goals(), trial.reached(), self.summed);
            self.worse += error - self.errors[self.summed];
            self.summed += 1;
        }
        self.worse < PATIENCE && self.frames_left > 0
    }
}

/// The frames that a search may simulate: none if no joint stays away.
pub(super) fn budget(goals: &Goals, reached: &[f64]) -> usize {
    if places(goals, reached).is_empty() { 0 } else { (BUDGET * goals.frames()).min(MOST) }
}

/// Joints and frames in runs of a second or more far from their goals.
fn places(goals: &Goals, reached: &[f64]) -> Vec<Place> {
    let d = goals.dim();
    let place = |frame: usize, joint: usize| {
        let error = (reached[frame * d + joint] - goals.row(frame)[joint]).abs();
        Place { frame, joint, error }
    };
    let off = jam::off(goals, reached, jam::FAR).into_iter();
    let long = off.filter(|o| o.to - o.from >= jam::LEAST_FRAMES);
    long.flat_map(|o| (o.from..o.to).map(move |f| place(f, o.joint))).collect()
}

/// The sum of the errors of a frame.
fn error_at(goals: &Goals, reached: &[f64], f: usize) -> f64 {
    let d = goals.dim();
    (0..d)
        .filter(|&j| goals.is_visible(f, j))
        .map(|j| (reached[f * d + j] - goals.row(f)[j]).abs())
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use robert_clip::Command;

    const FRAMES: usize = 60;

    /// Three joints with goal 0 throughout.
    fn goals() -> Goals {
        let names = ["a", "b", "c"].map(str::to_owned).to_vec();
        let (q, seen) = (vec![0.0; 3 * FRAMES], vec![true; 3 * FRAMES]);
        Goals::new(&Command::from_dense(names, vec![0.0; 3], q, seen).unwrap())
    }

    #[test]
    fn goals_move_near_the_joint_that_stays_away_and_no_farther_than_allowed() {
        let goals = goals();
        let mut reached = vec![0.0; 3 * FRAMES];
        (30..55).for_each(|f| reached[3 * f + 1] = 0.2);
        let mut detours = Detours::new(&goals, &reached, &vec![0.4; 3 * FRAMES]);
        assert_eq!(detours.frames_left, BUDGET * FRAMES);
        let mut moved = [0; 3];
        for _ in 0..200 {
            let tried = detours.next(&goals).unwrap();
            for (i, s) in tried.iter().enumerate().filter(|(_, s)| **s != 0.4) {
                assert!(s.abs() <= FARTHEST && (10..FRAMES).contains(&(i / 3)), "{i}: {s}");
                moved[i % 3] += 1;
            }
        }
        assert!(moved[1] > moved[0] && moved[1] > moved[2] && moved[0] > 0, "{moved:?}");
    }

    #[test]
    fn nothing_is_tried_where_every_joint_arrives_and_tries_come_to_an_end() {
        let goals = goals();
        let mut reached = vec![0.0; 3 * FRAMES];
        // Half a second is no jam.
        (30..40).for_each(|f| reached[3 * f] = 0.2);
        let none = vec![0.0; 3 * FRAMES];
        assert!(Detours::new(&goals, &reached, &none).next(&goals).is_none());
        (30..55).for_each(|f| reached[3 * f] = 0.2);
        let mut detours = Detours::new(&goals, &reached, &none);
        let tries = std::iter::from_fn(|| detours.next(&goals).map(|_| ())).count();
        assert_eq!(tries, BUDGET * FRAMES);
    }
}
