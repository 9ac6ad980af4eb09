//! The quality of the motion inside gaps. Gaps have no goals, so Precision does not measure them,
//! but a person sees a detour, an overshoot or a jolt at once.
//!
//! A gap is a run of frames without a goal of a joint between two frames with one (frame 0, the
//! start, counts as one). Joints whose gaps have the same ends share a gap. Its figures compare the
//! reached motion with the simplest one between the same ends:
//!
//! - *path*: length of the path in joint space divided by the straight line between the states
//!   reached at the two ends;
//! - *overshoot*: how far a joint leaves the interval of its two goals and the states reached at
//!   them, beyond the allowance of [`ALLOWANCE`] plus [`ALLOWED_SHARE`] of the step between the
//!   goals. The reached states count because two joints of one tendon cannot be set apart, and
//!   staying where they were is not an overshoot;
//! - *jerk*: root mean square of the third differences of the motion, from the frame before the gap
//!   to the one after it, divided by those of the minimum-jerk motion from rest to rest (`10 s^3 -
//!   15 s^4 + 6 s^5`) over the same straight line in the same time. Start and stop are left out:
//!   the minimum jerk falls with the cube of the time, so constant speed, with a jolt at either
//!   end, would count as 7 over one second and as 35 over three.
//!
//! Path and jerk are measured only if the two ends are at least [`MOVES`] apart; below that both
//! are noise.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::error::Error;
use super::gap::Gap;
use super::goals::Goals;
use super::run::Rollout;
use super::spline;
use super::window::HISTORY;
use super::worst::Worst;

/// Shortest straight line for which path and jerk are measured, rad or m.
pub(super) const MOVES: f64 = 0.1;

/// Overshoot that is allowed, rad or m.
pub(super) const ALLOWANCE: f64 = 0.02;

/// Allowance for overshoot as a share of the step between the two goals.
pub(super) const ALLOWED_SHARE: f64 = 0.05;

/// The largest overshoot of a joint that contact does not force, or if there is none, of all.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Overshoot {
    /// Distance beyond the allowance, rad or m.
    pub value: f64,
    /// The joint.
    pub joint: String,
    /// The frame.
    pub frame: usize,
    /// Whether it needs contact: if the policy repeats the gap where nothing touches, neither the robot itself
    /// nor a floor, the joint does not leave its allowance on this side. False if it was not repeated
    /// ([`GapFigures::measure`]).
    #[serde(default)]
    pub by_contact: bool,
}

/// The motion inside the gaps of one rollout.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GapFigures {
    /// Gaps.
    pub gaps: usize,
    /// Gaps whose ends are at least .1 rad or m apart.
    pub moves: usize,
    /// Mean path over these, at least 1.
    pub path: Option<f64>,
    /// The worst.
    pub path_worst: Option<Worst>,
    /// `None` if no joint exceeded its allowance.
    pub overshoot: Option<Overshoot>,
    /// Mean jerk over the gaps that move; 1 is the minimum-jerk motion from rest to rest.
    pub jerk: Option<f64>,
    /// The worst.
    pub jerk_worst: Option<Worst>,
    /// For recorded motion: error on masked frames divided by that of a cubic spline through the
    /// visible ones; below 1 is closer to the hidden motion.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub to_cubic: Option<f64>,
}

/// States by frame: 30 of history, then frame 0 and the reached states.
struct Motion<'a> {
    states: &'a [f64],
    dim: usize,
}

impl Motion<'_> {
    fn frames(&self) -> usize {
        (self.states.len() / self.dim).saturating_sub(HISTORY)
    }

    /// A joint at a frame that may be in the history.
    fn at(&self, frame: isize, joint: usize) -> f64 {
        self.states[(HISTORY as isize + frame) as usize * self.dim + joint]
    }

    fn distance(&self, a: usize, b: usize, joints: &[usize]) -> f64 {
        let step = |&j: &usize| self.at(b as isize, j) - self.at(a as isize, j);
        joints.iter().map(|j| step(j).powi(2)).sum::<f64>().sqrt()
    }
}

impl GapFigures {
    /// The figures of a rollout so far. `None` if nothing is masked. Gaps with an overshoot are repeated
    /// without contact until `stopped`; the rollout stays as it is.
    pub fn of(rollout: &mut Rollout, stopped: &dyn Fn() -> bool) -> Option<GapFigures> {
        let joints = rollout.robot().joints().iter().map(|j| j.name.clone());
        let joints: Vec<_> = joints.collect();
        let mut found = GapFigures::measure(rollout.goals(), rollout.states(), &joints)?;
        if found.overshoot.is_some() {
            let (goals, states) = (rollout.goals(), rollout.states());
            let motion = Motion { states, dim: goals.dim() };
            let gaps = gaps(goals, motion.frames().min(goals.frames()));
            let over = gaps.iter().map(|gap| (gap, overshoots(&motion, goals, gap)));
            let over: Vec<_> = over.filter(|(_, over)| !over.is_empty()).collect();
            let all = over.iter().flat_map(|(gap, over)| {
                // An overshoot in a gap that cannot be repeated counts as not forced.
                let forced =
                    forced(rollout, gap, over, stopped).unwrap_or_else(|_| vec![false; over.len()]);
                over.iter().zip(forced)
            });
            let worst = all.max_by(|(a, a_forced), (b, b_forced)| {
                b_forced.cmp(a_forced).then(a.value.total_cmp(&b.value))
            });
            found.overshoot = worst.map(|(o, by_contact)| o.named(&joints, by_contact));
        }
        Some(found)
    }

    /// Measures `states` (30 of history, then frames 0..=t; (30 + t + 1, S)); `joints` are the
    /// names of the state. `None` if nothing is masked.
    pub fn measure(goals: &Goals, states: &[f64], joints: &[String]) -> Option<GapFigures> {
        let motion = Motion { states, dim: goals.dim() };
        let gaps = gaps(goals, motion.frames().min(goals.frames()));
        let mut found = GapFigures { gaps: gaps.len(), ..GapFigures::default() };
        let (mut paths, mut jerks) = (Vec::new(), Vec::new());
        for gap in &gaps {
            for beyond in overshoots(&motion, goals, gap) {
                if found.overshoot.as_ref().is_none_or(|o| beyond.value > o.value) {
                    found.overshoot = Some(beyond.named(joints, false));
                }
            }
            let straight = motion.distance(gap.from, gap.to, &gap.joints);
            if straight < MOVES {
                continue;
            }
            paths.push((way(&motion, gap, &gap.joints) / straight, gap));
            if !differences(gap).is_empty() {
                jerks.push((jerk(&motion, gap, &gap.joints) / least_jerk(gap, straight), gap));
            }
        }
        found.moves = paths.len();
        let detour =
            |gap: &Gap, j: usize| way(&motion, gap, &[j]) - motion.distance(gap.from, gap.to, &[j]);
        let jolt = |gap: &Gap, j: usize| jerk(&motion, gap, &[j]);
        (found.path, found.path_worst) = mean_and_worst(&paths, joints, detour);
        (found.jerk, found.jerk_worst) = mean_and_worst(&jerks, joints, jolt);
        (!gaps.is_empty()).then_some(found)
    }
}

/// The mean of a figure over gaps, and the worst gap with the joint for which `share` is largest.
fn mean_and_worst(
    values: &[(f64, &Gap)],
    joints: &[String],
    share: impl Fn(&Gap, usize) -> f64,
) -> (Option<f64>, Option<Worst>) {
    let Some(&(value, gap)) = values.iter().max_by(|a, b| a.0.total_cmp(&b.0)) else {
        return (None, None);
    };
    let mean = values.iter().map(|v| v.0).sum::<f64>() / values.len() as f64;
    let most = gap.joints.iter().max_by(|&&a, &&b| share(gap, a).total_cmp(&share(gap, b)));
    let joint = most.map_or_else(String::new, |&j| joints[j].clone());
    (Some(mean), Some(Worst { value, joint, frame: gap.from }))
}

/// The gaps within the first `frames` frames, in order.
fn gaps(goals: &Goals, frames: usize) -> Vec<Gap> {
    let mut found = BTreeMap::<(usize, usize), Vec<usize>>::new();
    for j in 0..goals.dim() {
        let mut from = 0;
        for to in (1..frames).filter(|&to| goals.is_visible(to, j)) {
            if to > from + 1 {
                found.entry((from, to)).or_default().push(j);
            }
            from = to;
        }
    }
    found.into_iter().map(|((from, to), joints)| Gap { from, to, joints }).collect()
}

/// The largest overshoot of a joint in a gap.
struct Beyond {
    joint: usize,
    frame: usize,
    /// Distance beyond the allowance.
    value: f64,
    /// The end of the allowance on this side, and whether it is the upper one.
    limit: f64,
    above: bool,
}

impl Beyond {
    fn named(&self, joints: &[String], by_contact: bool) -> Overshoot {
        let joint = joints[self.joint].clone();
        Overshoot { value: self.value, joint, frame: self.frame, by_contact }
    }
}

/// The largest overshoot of each joint that leaves its allowance.
fn overshoots(motion: &Motion, goals: &Goals, gap: &Gap) -> Vec<Beyond> {
    let goal = |f: usize, j: usize| {
        if goals.is_visible(f, j) { goals.row(f)[j] } else { motion.at(f as isize, j) }
    };
    let mut found = Vec::new();
    for &j in &gap.joints {
        let (a, b) = (goal(gap.from, j), goal(gap.to, j));
        let ends = [a, b, motion.at(gap.from as isize, j), motion.at(gap.to as isize, j)];
        let (lo, hi) = (
            ends.into_iter().fold(f64::INFINITY, f64::min),
            ends.into_iter().fold(f64::NEG_INFINITY, f64::max),
        );
        let beyond = |f: usize| {
            let q = motion.at(f as isize, j);
            (lo - q).max(q - hi)
        };
        let farthest = (gap.from + 1..gap.to).max_by(|&f, &g| beyond(f).total_cmp(&beyond(g)));
        if let Some(frame) = farthest {
            let allowed = ALLOWANCE + ALLOWED_SHARE * (b - a).abs();
            let value = beyond(frame) - allowed;
            if value > 0.0 {
                let above = motion.at(frame as isize, j) > hi;
                let limit = if above { hi + allowed } else { lo - allowed };
                found.push(Beyond { joint: j, frame, value, limit, above });
            }
        }
    }
    found
}

/// Whether each of these overshoots of a gap stays away if the policy repeats the gap where nothing
/// touches. The same actions would not do: a policy that resists a push leaves on the other side.
fn forced(
    rollout: &mut Rollout,
    gap: &Gap,
    over: &[Beyond],
    stopped: &dyn Fn() -> bool,
) -> Result<Vec<bool>, Error> {
    // The frame of the goal is no part of the gap.
    let alone = rollout.without_contact(gap.from, gap.to - 1, stopped)?;
    let dim = rollout.goals().dim();
    let stays = |o: &Beyond| {
        let mut reached = alone.chunks_exact(dim).map(|q| q[o.joint]);
        reached.all(|q| if o.above { q <= o.limit } else { q >= o.limit })
    };
    Ok(over.iter().map(stays).collect())
}

/// The first of the four frames of every third difference inside the gap and its two ends;
/// none if it is shorter than three steps.
fn differences(gap: &Gap) -> std::ops::Range<isize> {
    gap.from as isize..gap.to as isize - 2
}

fn third(x: impl Fn(isize) -> f64, i: isize) -> f64 {
    x(i + 3) - 3.0 * x(i + 2) + 3.0 * x(i + 1) - x(i)
}

/// Length of the path of some joints through a gap.
fn way(motion: &Motion, gap: &Gap, joints: &[usize]) -> f64 {
    (gap.from..gap.to).map(|f| motion.distance(f, f + 1, joints)).sum()
}

/// Root of the summed squared third differences of some joints.
fn jerk(motion: &Motion, gap: &Gap, joints: &[usize]) -> f64 {
    let square = |i, j: &usize| third(|f| motion.at(f, *j), i).powi(2);
    differences(gap).map(|i| joints.iter().map(|j| square(i, j)).sum::<f64>()).sum::<f64>().sqrt()
}

/// The sum of squared third differences of the minimum-jerk motion from rest to rest.
fn least_jerk(gap: &Gap, straight: f64) -> f64 {
    let frames = (gap.to - gap.from) as f64;
    let along = |f: isize| {
        let s = ((f - gap.from as isize) as f64 / frames).clamp(0.0, 1.0);
        straight * s.powi(3) * (10.0 + s * (6.0 * s - 15.0))
    };
    differences(gap).map(|i| third(along, i).powi(2)).sum::<f64>().sqrt()
}

/// Mean absolute error on masked frames of a cubic spline through the visible ones, frame 0
/// and the two before it; `truth` is (frames, S), `history` (30, S). `None` when nothing
/// is masked.
pub(super) fn cubic_error(goals: &Goals, history: &[f64], truth: &[f64]) -> Option<f64> {
    let dim = goals.dim();
    let frames = (truth.len() / dim).min(goals.frames());
    let (mut sum, mut n) = (0.0, 0_usize);
    for j in 0..dim {
        let before = [HISTORY - 2, HISTORY - 1];
        let mut knots: Vec<(f64, f64)> =
            before.iter().map(|&h| (h as f64 - HISTORY as f64, history[h * dim + j])).collect();
        let seen = (0..frames).filter(|&f| f == 0 || goals.is_visible(f, j));
        knots.extend(seen.map(|f| (f as f64, truth[f * dim + j])));
        let cubic = spline::natural(&knots);
        for f in (1..frames).filter(|&f| !goals.is_visible(f, j)) {
            sum += (cubic.at(f as f64) - truth[f * dim + j]).abs();
            n += 1;
        }
    }
    (n > 0).then(|| sum / n as f64)
}

/// The overshoot of the joint that overshoots most: its frame, the joint, and the distance beyond the allowance.
pub(super) fn widest_swing(goals: &Goals, states: &[f64]) -> Option<(usize, usize, f64)> {
    let motion = Motion { states, dim: goals.dim() };
    let gaps = gaps(goals, motion.frames().min(goals.frames()));
    let all = gaps.iter().flat_map(|gap| overshoots(&motion, goals, gap));
    let worst = all.max_by(|a, b| a.value.total_cmp(&b.value))?;
    Some((worst.frame, worst.joint, worst.value))
}

/// How rough a gap is.
pub(super) struct Roughness {
    pub(super) gap: Gap,
    /// Its jerk relative to the least; 0 if it does not move.
    pub(super) jerk: f64,
    /// How far a joint overshoots, rad or m.
    pub(super) overshoot: f64,
}

/// The roughness of each gap.
pub(super) fn roughness(goals: &Goals, states: &[f64]) -> Vec<Roughness> {
    let motion = Motion { states, dim: goals.dim() };
    let of = |gap: Gap| {
        let straight = motion.distance(gap.from, gap.to, &gap.joints);
        let moves = straight >= MOVES && !differences(&gap).is_empty();
        let jerk =
            if moves { jerk(&motion, &gap, &gap.joints) / least_jerk(&gap, straight) } else { 0.0 };
        let over = overshoots(&motion, goals, &gap);
        let overshoot = over.iter().map(|o| o.value).fold(0.0, f64::max);
        Roughness { gap, jerk, overshoot }
    };
    gaps(goals, motion.frames().min(goals.frames())).into_iter().map(of).collect()
}

/// The frame and the joint of the strongest jolt in the gaps that begin at frame `from`.
pub(super) fn strongest_jolt(goals: &Goals, states: &[f64], from: usize) -> Option<(usize, usize)> {
    let motion = Motion { states, dim: goals.dim() };
    let gaps = gaps(goals, motion.frames().min(goals.frames()));
    let jolts = gaps.iter().filter(|g| g.from == from).flat_map(|gap| {
        let at = |i: isize, j: usize| third(|f| motion.at(f, j), i).abs();
        differences(gap).flat_map(move |i| gap.joints.iter().map(move |&j| (i, j, at(i, j))))
    });
    let (i, joint, _) = jolts.max_by(|a, b| a.2.total_cmp(&b.2))?;
    Some((i as usize + 1, joint))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use robert_clip::Command;

    /// Goals of `dim` joints at the frames given, all else masked.
    pub(in super::super) fn goals(
        dim: usize,
        frames: usize,
        keys: &[(usize, &[Option<f64>])],
    ) -> Goals {
        let (mut q, mut visible) = (vec![0.0; frames * dim], vec![false; frames * dim]);
        for (f, row) in keys {
            for (j, v) in row.iter().enumerate() {
                q[f * dim + j] = v.unwrap_or(0.0) as f32;
                visible[f * dim + j] = v.is_some();
            }
        }
        let names = (0..dim).map(|j| j.to_string()).collect();
        Goals::new(&Command::from_dense(names, vec![0.0; dim], q, visible).unwrap())
    }

    /// States of one joint at rest before frame 0.
    fn states(path: &[f64]) -> Vec<f64> {
        let mut all = vec![path[0]; HISTORY];
        all.extend_from_slice(path);
        all
    }

    fn measure(goals: &Goals, path: &[f64]) -> GapFigures {
        let names: Vec<String> = (0..goals.dim()).map(|j| format!("j{j}")).collect();
        GapFigures::measure(goals, &states(path), &names).unwrap()
    }

    fn there_and_held() -> Goals {
        let held: Vec<(usize, &[Option<f64>])> =
            (20..30).map(|f| (f, &[Some(1.0)][..])).chain([(0, &[Some(0.0)][..])]).collect();
        goals(1, 30, &held)
    }

    fn least(s: f64) -> f64 {
        s.powi(3) * (10.0 + s * (6.0 * s - 15.0))
    }

    #[test]
    fn the_plainest_motion_has_path_and_jerk_of_one() {
        let path: Vec<f64> = (0..30).map(|f| least((f as f64 / 20.0).min(1.0))).collect();
        let found = measure(&there_and_held(), &path);
        assert_eq!((found.gaps, found.moves), (1, 1));
        assert!((found.path.unwrap() - 1.0).abs() < 1e-9, "{found:?}");
        assert!((found.jerk.unwrap() - 1.0).abs() < 1e-9, "{found:?}");
        assert_eq!(found.overshoot, None);
    }

    #[test]
    fn a_jolt_on_the_way_counts_and_so_does_a_wobble() {
        // At constant speed there is no jerk inside.
        let ramp: Vec<f64> = (0..30).map(|f| (f as f64 / 20.0).min(1.0)).collect();
        assert!(measure(&there_and_held(), &ramp).jerk.unwrap() < 1e-9);
        // Rest for ten frames, then twice the speed: by hand, two third differences (v, -v) of
        // the step of .1 over those of the minimum-jerk motion.
        let late: Vec<f64> = (0..30).map(|f| ((f as f64 - 10.0) / 10.0).clamp(0.0, 1.0)).collect();
        let found = measure(&there_and_held(), &late);
        let plain: f64 =
            (0..18).map(|i| third(|f| least(f as f64 / 20.0), i).powi(2)).sum::<f64>().sqrt();
        let by_hand = 0.1 * 2.0_f64.sqrt() / plain;
        assert!((found.jerk.unwrap() - by_hand).abs() < 1e-9, "{found:?} {by_hand}");
        let wobble: Vec<f64> =
            (0..30).map(|f| least((f as f64 / 20.0).min(1.0)) + 0.02 * f64::from(f % 2)).collect();
        assert!(measure(&there_and_held(), &wobble).jerk.unwrap() > 20.0);
    }

    #[test]
    fn swings_past_the_keys_are_measured_beyond_the_allowance() {
        let mut path: Vec<f64> = (0..30).map(|f| (f as f64 / 20.0).min(1.0)).collect();
        path[15] = 1.3;
        path[5] = -0.05;
        let found = measure(&there_and_held(), &path);
        let over = found.overshoot.unwrap();
        assert_eq!((over.frame, over.joint.as_str()), (15, "j0"));
        assert!((over.value - (0.3 - 0.02 - 0.05)).abs() < 1e-9);
        // There and back: .05 + .30 + ... by hand.
        let by_hand: f64 = path.windows(2).take(20).map(|w| (w[1] - w[0]).abs()).sum();
        assert!((found.path.unwrap() - by_hand).abs() < 1e-9);
        let worst = found.path_worst.unwrap();
        assert_eq!((worst.frame, worst.joint.as_str()), (0, "j0"));
    }

    #[test]
    fn what_is_not_reached_at_the_keys_is_no_overshoot() {
        // The goal is 1, and the joint reaches and stays at 1.2.
        let path: Vec<f64> = (0..30).map(|f| 1.2 * (f as f64 / 20.0).min(1.0)).collect();
        assert_eq!(measure(&there_and_held(), &path).overshoot, None);
    }

    #[test]
    fn a_gap_concerns_the_joints_with_a_goal_at_both_ends() {
        let keys: [(usize, &[Option<f64>]); 3] =
            [(0, &[Some(0.0), Some(0.0)]), (10, &[Some(1.0), None]), (20, &[Some(2.0), None])];
        let g = goals(2, 21, &keys);
        let mut path = Vec::new();
        for f in 0..21 {
            // The second joint swings wildly after its last goal.
            path.extend([f64::from(f) / 10.0, if f % 2 == 0 { 0.0 } else { 5.0 }]);
        }
        let mut all = vec![0.0; 2 * HISTORY];
        all.extend(path);
        let names = ["a".to_owned(), "b".to_owned()];
        let found = GapFigures::measure(&g, &all, &names).unwrap();
        assert_eq!((found.gaps, found.moves, found.overshoot), (2, 2, None));
        assert!((found.path.unwrap() - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_joint_that_is_keyed_more_rarely_has_its_own_gap() {
        let only = |x: f64| [Some(x), None];
        let keys =
            [(0, [Some(0.0); 2]), (10, only(0.0)), (20, only(0.0)), (30, [Some(0.0), Some(1.0)])];
        let keys: Vec<(usize, &[Option<f64>])> =
            keys.iter().map(|(f, row)| (*f, &row[..])).collect();
        // The second joint waits, and swings back and forth at the end.
        let mut path = vec![0.0; 31 * 2];
        for (f, x) in [(28, 1.3), (29, 0.2), (30, 1.0)] {
            path[f * 2 + 1] = x;
        }
        let names = ["a".to_owned(), "b".to_owned()];
        let states = [vec![0.0; HISTORY * 2], path].concat();
        let found = GapFigures::measure(&goals(2, 31, &keys), &states, &names).unwrap();
        // Three of the first joint, and one of the second from 0 to 30.
        assert_eq!((found.gaps, found.moves), (4, 1));
        let overshoot = found.overshoot.unwrap();
        assert_eq!((overshoot.joint.as_str(), overshoot.frame), ("b", 28));
        assert!((overshoot.value - 0.23).abs() < 1e-9, "{overshoot:?}");
        assert!(found.jerk.unwrap() > 100.0 && found.path.unwrap() > 3.0);
    }

    #[test]
    fn the_worst_gap_names_the_joint_that_contributes_most() {
        let key = [Some(0.0), Some(1.0)];
        let g = goals(2, 21, &[(0, &key[..]), (20, &[Some(1.0), Some(2.0)])]);
        let mut all = vec![0.0; 2 * HISTORY];
        for f in 0..21 {
            let s = least(f64::from(f) / 20.0);
            all.extend([s, s + if f == 7 { 0.4 } else { 0.0 }]);
        }
        let found = GapFigures::measure(&g, &all, &["a".to_owned(), "b".to_owned()]).unwrap();
        assert_eq!(found.path_worst.unwrap().joint, "b");
        assert_eq!(found.jerk_worst.unwrap().joint, "b");
    }

    #[test]
    fn nothing_masked_is_nothing_measured() {
        let g = goals(1, 2, &[(0, &[Some(0.0)]), (1, &[Some(0.0)])]);
        assert_eq!(GapFigures::measure(&g, &states(&[0.0, 0.0]), &["a".into()]), None);
    }

    #[test]
    fn the_cubic_passes_smooth_motion_and_misses_a_corner() {
        let frames = 41;
        let keys: Vec<(usize, Vec<Option<f64>>)> =
            (0..frames).step_by(4).map(|f| (f, vec![Some(0.0)])).collect();
        let rows: Vec<(usize, &[Option<f64>])> =
            keys.iter().map(|(f, r)| (*f, r.as_slice())).collect();
        let g = goals(1, frames, &rows);
        let wave = |f: isize| (0.1 * f as f64).sin();
        let history: Vec<f64> = (-30..0).map(wave).collect();
        let truth: Vec<f64> = (0..frames as isize).map(wave).collect();
        assert!(cubic_error(&g, &history, &truth).unwrap() < 1e-3);
        let corner: Vec<f64> = truth.iter().map(|v| v.max(0.5)).collect();
        assert!(cubic_error(&g, &[0.5; 30], &corner).unwrap() > 2e-3);
        assert_eq!(cubic_error(&goals(1, 2, &[(1, &[Some(0.0)])]), &[0.0; 30], &[0.0; 2]), None);
    }
}
