//! What a person sees at once although Precision hardly counts it: unnatural motion in gaps and holds, a missed
//! frame, a free joint that wanders. It counts as a penalty beside Precision where two motions are compared.

use super::gaps::{self, GapFigures};
use super::goals::Goals;
use super::holds;
use super::jam;
use super::run::Rollout;
use super::window::HISTORY;
use robert_robot::{Drive, Robot};

/// The distance that a joint without goals may go without a penalty, rad or m.
const FREE: f64 = 0.1;

/// Penalty of unnatural motion in a gap, as rad or m of error: for each rad or m of overshoot; and for
/// each 1 by which the path, relative to the straight line, exceeds [`LONGEST_PATH`].
pub(super) const SWING_WEIGHT: f64 = 0.06;
const PATH_WEIGHT: f64 = 0.02;
/// The penalty for each 1 by which the jerk, relative to the minimum, exceeds [`MOST_JERK`].
pub(super) const JERK_WEIGHT: f64 = 5e-4;
/// The penalty for each rad or m that the joints move within a hold.
const RESTLESS_WEIGHT: f64 = 0.01;
/// Less motion in a hold is no place to search, rad or m.
const RESTLESS: f64 = 0.1;
/// Limits of natural motion inside a gap: path relative to the straight line, and jerk relative to
/// the minimum. Motion counts as smooth up to a jerk of 3; what is chosen should stay a little below.
const LONGEST_PATH: f64 = 1.3;
const MOST_JERK: f64 = 2.9;
/// The largest penalty for jerk where a motion is far nearer to the goals, rad or m. Over a long gap the least jerk
/// is so small that one touch is hundreds of times as much.
const MOST_JOLT: f64 = 0.02;
/// The largest penalty that counts, rad or m. Where every policy shakes, more must not outweigh the
/// distance to the goals.
const MOST_PENALTY: f64 = 0.1;

/// Penalty of the motion inside gaps, of a missed frame and of a free joint that wanders, rad or m; see
/// [`penalty`]. A free joint may move, but not for a small gain of others.
pub(super) fn unnatural(rollout: &Rollout) -> f64 {
    unnatural_until(rollout, rollout.frames())
}

/// As [`unnatural`], of the frames before `end`.
pub(super) fn unnatural_until(rollout: &Rollout, end: usize) -> f64 {
    let (other, jolts) = measured(rollout, end);
    other + jolts
}

/// As [`unnatural`], with no more for jerk than [`MOST_JOLT`].
pub(super) fn unnatural_but_for_jolts(rollout: &Rollout) -> f64 {
    let (other, jolts) = measured(rollout, rollout.frames());
    other + jolts.min(MOST_JOLT)
}

/// The penalty of a motion without that for jerk, and that for jerk, rad or m.
pub(super) fn apart(rollout: &Rollout) -> (f64, f64) {
    measured(rollout, rollout.frames())
}

/// The penalty of the frames before `end` without that for jerk, and that for jerk.
fn measured(rollout: &Rollout, end: usize) -> (f64, f64) {
    let (goals, states) = (rollout.sought(), rollout.states());
    let states = &states[..((HISTORY + end) * goals.dim()).min(states.len())];
    let way = farthest(&free(rollout.robot(), goals), goals.dim(), states);
    let (other, jolts) = penalties(goals, states);
    (other + SWING_WEIGHT * (way - FREE).max(0.0), jolts)
}

/// The joints without goals that only their motor moves: no other joint of a tendon or of a pair of
/// leader and follower has a goal, either.
fn free(robot: &Robot, goals: &Goals) -> Vec<usize> {
    let open = |j: usize| (1..goals.frames()).all(|f| !goals.is_visible(f, j));
    let place = |name: &String| robot.joint_index(name).ok();
    let moved = robot.actuators().iter().flat_map(|a| match &a.drive {
        Drive::Joint(name) => place(name).into_iter().collect(),
        Drive::Tendon(name) => robot
            .tendon_joints(name)
            .into_iter()
            .filter_map(|j| robot.joint_index(j).ok())
            .collect(),
        Drive::Other(_) => Vec::new(),
    });
    let alone = |j: &usize| goals.ties().partners(*j).all(open);
    moved.filter(|j| open(*j) && alone(j)).collect()
}

/// The distance that one of these joints goes at most from its start, rad or m.
fn farthest(joints: &[usize], dim: usize, states: &[f64]) -> f64 {
    let reached = &states[HISTORY * dim..];
    let way = |row: &[f64]| joints.iter().map(|&j| (row[j] - reached[j]).abs()).fold(0.0, f64::max);
    reached.chunks_exact(dim).map(way).fold(0.0, f64::max)
}

/// Penalty of a motion, rad or m: for overshoot, long paths and jerk in gaps, for the frame that is missed
/// most, and for motion in the most restless hold; `states` is (30 + frames, S), up to any frame. In the
/// mean over frames a key of one frame hardly counts, but a person sees that it is missed, as well as an
/// overshoot by as much.
pub(super) fn penalty(goals: &Goals, states: &[f64]) -> f64 {
    let (other, jolts) = penalties(goals, states);
    other + jolts
}

/// The [`penalty`] without that for jerk, and that for jerk.
pub(super) fn penalties(goals: &Goals, states: &[f64]) -> (f64, f64) {
    let gap = GapFigures::measure(goals, states, &names(goals)).unwrap_or_default();
    let swing = gap.overshoot.map_or(0.0, |o| o.value);
    let detour = gap.path.map_or(0.0, |p| (p - LONGEST_PATH).max(0.0));
    let jolts = gap.jerk.map_or(0.0, |j| (j - MOST_JERK).max(0.0));
    let missed = (worst_frame(goals, states) - jam::FAR).max(0.0);
    let restless = holds::restlessness(goals, states);
    let other = SWING_WEIGHT * (swing + missed) + PATH_WEIGHT * detour + RESTLESS_WEIGHT * restless;
    (other, JERK_WEIGHT * jolts)
}

/// The error of the frame that is farthest from its goals, in the mean over its joints, rad or m.
fn worst_frame(goals: &Goals, states: &[f64]) -> f64 {
    let d = goals.dim();
    let reached = &states[HISTORY * d..];
    let error = |f: usize| {
        let seen = || (0..d).filter(|&j| goals.is_visible(f, j));
        let sum: f64 = seen().map(|j| (reached[f * d + j] - goals.row(f)[j]).abs()).sum();
        sum / seen().count().max(1) as f64
    };
    (1..goals.frames().min(reached.len() / d)).map(error).fold(0.0, f64::max)
}

/// The part of a penalty that counts beside the distance to the goals.
pub(super) fn counted(penalty: f64) -> f64 {
    penalty.min(MOST_PENALTY)
}

/// A joint and a frame with unnatural motion, and its penalty.
pub(super) struct Place {
    pub(super) frame: usize,
    pub(super) joint: usize,
    pub(super) penalty: f64,
}

/// The joint that overshoots most, the one that moves most in the most restless hold, and, if the jerk exceeds its
/// limit, the strongest jolt of the gap with the most.
pub(super) fn places(goals: &Goals, states: &[f64]) -> Vec<Place> {
    let swing = gaps::widest_swing(goals, states).map(|(frame, joint, value)| Place {
        frame,
        joint,
        penalty: counted(SWING_WEIGHT * value),
    });
    let restless = holds::restless(goals, states).filter(|(motion, ..)| *motion > RESTLESS);
    let restless = restless.map(|(motion, frame, joint)| Place {
        frame,
        joint,
        penalty: counted(RESTLESS_WEIGHT * motion),
    });
    let figures = GapFigures::measure(goals, states, &names(goals)).unwrap_or_default();
    let excess = figures.jerk.map_or(0.0, |j| j - MOST_JERK);
    let worst = figures.jerk_worst.filter(|_| excess > 0.0);
    let jolt = worst.and_then(|worst| gaps::strongest_jolt(goals, states, worst.frame));
    let jolt =
        jolt.map(|(frame, joint)| Place { frame, joint, penalty: counted(JERK_WEIGHT * excess) });
    swing.into_iter().chain(restless).chain(jolt).collect()
}

/// Names for figures of which only the numbers count.
fn names(goals: &Goals) -> Vec<String> {
    vec![String::new(); goals.dim()]
}

#[cfg(test)]
mod tests {
    use super::super::gaps::tests::goals;
    use super::*;

    /// The minimum-jerk motion from 0 to 1 in 20 frames.
    fn least(f: usize) -> f64 {
        let s = (f as f64 / 20.0).min(1.0);
        s.powi(3) * (10.0 + s * (6.0 * s - 15.0))
    }

    #[test]
    fn a_missed_key_counts_like_an_overshoot() {
        let seen = &[Some(1.0), Some(0.0), None][..];
        let goals = goals(3, 40, &[(0, &[Some(0.0); 3]), (20, seen), (39, seen)]);
        // Of two keyed joints one is .4 off at one key; the third is free.
        let mut all = vec![0.0; (HISTORY + 40) * 3];
        for f in 0..40 {
            let way = least(f);
            all[(HISTORY + f) * 3] = if f == 20 { 0.6 } else { way };
            all[(HISTORY + f) * 3 + 2] = 2.0;
        }
        assert!((worst_frame(&goals, &all) - 0.2).abs() < 1e-9);
        let gaps = GapFigures::measure(&goals, &all, &names(&goals)).unwrap();
        let detour = gaps.path.map_or(0.0, |p| (p - LONGEST_PATH).max(0.0));
        let jolts = gaps.jerk.map_or(0.0, |j| (j - MOST_JERK).max(0.0));
        let swing = gaps.overshoot.map_or(0.0, |o| o.value);
        let other = SWING_WEIGHT * swing + PATH_WEIGHT * detour + JERK_WEIGHT * jolts;
        let missed = SWING_WEIGHT * (0.2 - jam::FAR);
        assert!((penalty(&goals, &all) - other - missed).abs() < 1e-12);
        // Before the key nothing is missed.
        assert!(worst_frame(&goals, &all[..(HISTORY + 20) * 3]) < 1e-9);
    }

    #[test]
    fn a_joint_is_free_if_nothing_that_is_commanded_moves_it() {
        let robot = Robot::builtin("shadow_hand").unwrap();
        let at = |name: &str| robot.joint_index(name).unwrap();
        // Of the index finger's tendon one joint has a goal.
        let mut seen = vec![None; 22];
        seen[at("FFJ2")] = Some(0.5);
        let goals = goals(22, 40, &[(0, &vec![Some(0.0); 22]), (20, &seen)]).tied(&robot);
        let free = free(&robot, &goals);
        assert!(!free.contains(&at("FFJ2")) && !free.contains(&at("FFJ1")), "{free:?}");
        assert!(free.contains(&at("FFJ3")) && free.contains(&at("MFJ1")), "{free:?}");
        assert_eq!(free.len(), 20);
    }

    #[test]
    fn the_way_of_a_free_joint_is_measured_from_its_start() {
        let mut all = vec![0.0; (HISTORY + 40) * 2];
        all[..HISTORY * 2].fill(9.0);
        all[(HISTORY + 20) * 2 + 1] = -0.5;
        assert_eq!((farthest(&[1], 2, &all), farthest(&[0], 2, &all)), (0.5, 0.0));
    }

    #[test]
    fn a_restless_hold_is_a_place() {
        let seen: Vec<(usize, &[Option<f64>])> = (0..40).map(|f| (f, &[Some(0.0)][..])).collect();
        let goals = goals(1, 40, &seen);
        let mut states = vec![0.0; HISTORY + 40];
        states[HISTORY + 20] = 0.05;
        assert!(places(&goals, &states).is_empty(), "too little to be seen");
        states[HISTORY + 20] = 0.2;
        let found = places(&goals, &states);
        assert!(found.len() == 1 && found[0].joint == 0 && found[0].frame < 20);
        assert!(
            (found[0].penalty - RESTLESS_WEIGHT * holds::restlessness(&goals, &states)).abs()
                < 1e-12
        );
    }

    #[test]
    fn the_places_are_the_largest_swing_and_the_strongest_jolt() {
        let seen: Vec<(usize, &[Option<f64>])> =
            (20..30).map(|f| (f, &[Some(1.0)][..])).chain([(0, &[Some(0.0)][..])]).collect();
        let goals = goals(1, 30, &seen);
        let mut states: Vec<f64> =
            vec![0.0; HISTORY].into_iter().chain((0..30).map(least)).collect();
        assert!(places(&goals, &states).is_empty());
        states[HISTORY + 16] = 1.1;
        let found = places(&goals, &states);
        let frames: Vec<usize> = found.iter().map(|p| p.frame).collect();
        assert!(frames[0] == 16 && frames[1].abs_diff(16) <= 2, "{frames:?}");
        let whole: f64 = found.iter().map(|p| p.penalty).sum();
        assert!((whole - penalty(&goals, &states)).abs() < 1e-12);
    }
}
