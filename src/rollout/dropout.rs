//! Dropouts: short gaps in recorded motion, and the most likely motion in them.
//!
//! Between two typed keys anything may happen. Where a few frames of a recording are missing, the frames around them
//! tell how fast the joint moved and how soon its speed changes. So the speed of a joint counts as a Gaussian process,
//! and its position as the sum (Rasmussen and Williams 2006, chapters 2, 4 and 5). The motion in a dropout is the mean of
//! several such processes, given the frames around it, each weighted by how likely it makes these frames.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::sync::LazyLock;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Frames of the longest dropout.
const LONGEST: usize = 10;
/// Visible frames on each side that are looked at, and the farthest of them from the dropout.
const SIDE: usize = 12;
const FARTHEST: usize = 40;
/// Fewest pairs of neighbouring frames around a dropout that must show motion of a recording: at least one before it, and
/// one after it unless it is [`SHORT`].
const MOVING: usize = 4;
/// Frames of the longest dropout that may have no pair after it.
const SHORT: usize = 4;
/// Frames that a covariance spans.
const SPAN: usize = 2 * FARTHEST + LONGEST + 2;
/// What is added to the variance of each position, as a share of that of a step. It keeps the equations well posed.
const JITTER: f64 = 1e-6;
/// How far the motion in a dropout leaves the range of the frames around it at most, as a share of that range.
const BEYOND: f64 = 0.1;
/// Smooth recordings cross cubics: now and then a few windows of five frames lie on one. Where people typed cubics, at
/// least this many windows in a row do, or this share of all windows up to [`FARTHEST`] frames away: a quarter if keys
/// are four frames apart.
const CUBICS: usize = 4;
const CUBIC_SHARE: f64 = 0.2;
/// Positions are stored in single precision: each is off by at most half of this share.
const ROUNDING: f64 = f32::EPSILON as f64;

/// A gap, and the frames around it in which the same joints have goals.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Dropout {
    /// Last visible frame before it.
    from: usize,
    /// First visible frame after it.
    to: usize,
    /// The visible frames around it, at most [`SIDE`] on each side.
    around: Vec<usize>,
}

/// The most likely motion in all dropouts: place in `q` and value. `q` and `visible` are (frames, `dim`).
pub(super) fn likely(q: &[f64], visible: &[bool], dim: usize) -> Vec<(usize, f64)> {
    let mut found: BTreeMap<Dropout, Vec<usize>> = BTreeMap::new();
    for j in 0..dim {
        let column = |all: &[f64]| all.iter().skip(j).step_by(dim).copied().collect::<Vec<_>>();
        let seen: Vec<bool> = visible.iter().skip(j).step_by(dim).copied().collect();
        for dropout in dropouts(&column(q), &seen) {
            found.entry(dropout).or_default().push(j);
        }
    }
    let all = found.iter().flat_map(|(dropout, joints)| dropout.fill(q, dim, joints));
    all.collect()
}

/// The dropouts of a joint with these values, (frames).
fn dropouts(q: &[f64], visible: &[bool]) -> Vec<Dropout> {
    let seen: Vec<usize> = (0..visible.len()).filter(|&f| visible[f]).collect();
    let mut found = Vec::new();
    let mut recorded = None;
    for k in 1..seen.len() {
        let (from, to) = (seen[k - 1], seen[k]);
        if !(2..=LONGEST + 1).contains(&(to - from)) {
            continue;
        }
        let recorded = recorded.get_or_insert_with(|| recorded_pairs(q, visible));
        let near = |f: &usize| f + FARTHEST >= from && *f <= to + FARTHEST;
        let before = seen[..k].iter().rev().take(SIDE).copied().filter(near);
        let after = seen[k..].iter().take(SIDE).copied().filter(near);
        let (mut around, after): (Vec<_>, Vec<_>) = (before.collect(), after.collect());
        around.reverse();
        // Pairs of neighbouring frames: all, and those that show motion of a recording.
        let pairs = |side: &[usize]| {
            let all = || side.windows(2).filter(|p| p[1] == p[0] + 1);
            (all().count(), all().filter(|p| recorded[p[0]]).count())
        };
        let moves = |(all, moving): (usize, usize)| 2 * moving > all;
        let (before, ahead) = (pairs(&around), pairs(&after));
        // Of one frame alone nobody knows whether it was typed; after a few frames this hardly matters.
        let alone = ahead.0 == 0 && to - from <= SHORT + 1;
        if moves(before) && (moves(ahead) || alone) && before.1 + ahead.1 >= MOVING {
            around.extend(after);
            found.push(Dropout { from, to, around });
        }
    }
    found
}

/// Whether a joint moves from a frame to the next one as in a recording: both are visible, and neither rest nor a
/// straight line nor a cubic, which people type, leads through them. Other curves count as recorded.
fn recorded_pairs(q: &[f64], visible: &[bool]) -> Vec<bool> {
    let mut recorded: Vec<bool> = visible.windows(2).map(|p| p[0] && p[1]).collect();
    // Whether frames are at rest, on a line and on a cubic; `None` where some are hidden.
    let windows = |order: usize| -> Vec<Option<bool>> {
        let all = (0..q.len().saturating_sub(order)).map(|from| from..=from + order);
        let seen = |frames: &RangeInclusive<usize>| visible[frames.clone()].iter().all(|v| *v);
        all.map(|frames| seen(&frames).then(|| vanishes(&q[frames], order))).collect()
    };
    for order in [1, 2, 4] {
        let mut lies = windows(order);
        if order == 4 {
            leave_crossings(&mut lies);
        }
        for (from, _) in lies.iter().enumerate().filter(|(_, lies)| **lies == Some(true)) {
            recorded[from..from + order].fill(false);
        }
    }
    recorded
}

/// Leaves out windows that lie on a cubic by chance; see [`CUBICS`].
fn leave_crossings(lies: &mut [Option<bool>]) {
    let all = lies.to_vec();
    let mut from = 0;
    for run in all.chunk_by(|a, b| (*a == Some(true)) == (*b == Some(true))) {
        let range = from..from + run.len();
        from = range.end;
        if run[0] != Some(true) || run.len() >= CUBICS {
            continue;
        }
        let near =
            &all[range.start.saturating_sub(FARTHEST)..(range.end + FARTHEST).min(all.len())];
        let (seen, on) =
            near.iter().flatten().fold((0, 0), |(n, on), l| (n + 1, on + u32::from(*l)));
        if f64::from(on) < CUBIC_SHARE * f64::from(seen) {
            lies[range].fill(Some(false));
        }
    }
}

/// Whether the difference of this order, of as many values and one, is only what rounding leaves.
fn vanishes(values: &[f64], order: usize) -> bool {
    let mut left = values.to_vec();
    for _ in 0..order {
        left = left.windows(2).map(|p| p[1] - p[0]).collect();
    }
    let largest = values.iter().fold(0.0, |most: f64, q| most.max(q.abs()));
    let rounding = if order == 1 { 0.0 } else { f64::from(1 << order) * ROUNDING * largest };
    left[0].abs() <= rounding
}

impl Dropout {
    /// The most likely motion of these joints in it.
    fn fill(&self, q: &[f64], dim: usize, joints: &[usize]) -> Vec<(usize, f64)> {
        let processes: Vec<_> = COVARIANCES.iter().filter_map(|c| self.process(c)).collect();
        let hidden = self.from + 1..self.to;
        let mut filled = Vec::with_capacity(joints.len() * hidden.len());
        for &j in joints {
            let at = |f: usize| q[f * dim + j];
            let start = at(self.around[0]);
            let moved = DVector::from_iterator(
                self.around.len() - 1,
                self.around[1..].iter().map(|&f| at(f) - start),
            );
            let means: Vec<_> = processes.iter().map(|p| p.mean(&moved)).collect();
            let most = means.iter().map(|m| m.0).fold(f64::NEG_INFINITY, f64::max);
            let weights: Vec<f64> = means.iter().map(|m| (m.0 - most).exp()).collect();
            let all: f64 = weights.iter().sum();
            let seen = || self.around.iter().map(|&f| at(f));
            let (low, high) =
                (seen().fold(f64::INFINITY, f64::min), seen().fold(f64::NEG_INFINITY, f64::max));
            let beyond = BEYOND * (high - low);
            for (row, f) in hidden.clone().enumerate().filter(|_| !means.is_empty()) {
                let sum: f64 = weights.iter().zip(&means).map(|(w, m)| w * m.1[row]).sum();
                let value = (start + sum / all).clamp(low - beyond, high + beyond);
                filled.push((f * dim + j, value));
            }
        }
        filled
    }

    /// What one covariance says; `None` if its equations are not well posed.
    fn process(&self, covariance: &Covariance) -> Option<Process> {
        let start = self.around[0];
        let at: Vec<usize> = self.around[1..].iter().map(|f| f - start).collect();
        let known = DMatrix::from_fn(at.len(), at.len(), |r, c| {
            covariance.of(at[r], at[c]) + if r == c { JITTER } else { 0.0 }
        });
        let with = |f: usize| {
            DVector::from_iterator(at.len(), at.iter().map(|&a| covariance.of(f - start, a)))
        };
        let inside = (self.from + 1..self.to).map(with).collect();
        Some(Process { known: known.cholesky()?, inside })
    }
}

/// A process given when a joint is seen, but not where.
struct Process {
    /// The covariance of the positions around the dropout.
    known: Cholesky<f64, Dyn>,
    /// That of each position inside with them.
    inside: Vec<DVector<f64>>,
}

impl Process {
    /// The logarithm of how likely these positions are, and the mean of those inside. The variance is the most likely one.
    fn mean(&self, moved: &DVector<f64>) -> (f64, Vec<f64>) {
        let solved = self.known.solve(moved);
        let n = moved.len() as f64;
        let variance = (solved.dot(moved) / n).max(f64::MIN_POSITIVE);
        let size: f64 = self.known.l_dirty().diagonal().iter().map(|d| d.ln()).sum();
        let means = self.inside.iter().map(|with| with.dot(&solved)).collect();
        (-0.5 * n * variance.ln() - size, means)
    }
}

/// The covariance of two positions of a joint relative to a start, for speeds of variance 1.
struct Covariance(Vec<f64>);

impl Covariance {
    /// Speeds whose covariance after `k` frames is `speeds(k)`.
    fn of_sums(speeds: impl Fn(f64) -> f64) -> Covariance {
        let by_lag: Vec<f64> = (0..SPAN).map(|k| speeds(k as f64)).collect();
        let mut sums = vec![0.0; SPAN * SPAN];
        for r in 1..SPAN {
            for c in 1..SPAN {
                let (up, left) = ((r - 1) * SPAN + c, r * SPAN + c - 1);
                sums[r * SPAN + c] = sums[up] + sums[left] - sums[up - 1] + by_lag[r.abs_diff(c)];
            }
        }
        Covariance(sums)
    }

    /// Of the positions `a` and `b` frames after the start.
    fn of(&self, a: usize, b: usize) -> f64 {
        self.0[a * SPAN + b]
    }
}

/// Matérn covariances of three degrees of smoothness, with five lengths in frames each.
static COVARIANCES: LazyLock<Vec<Covariance>> = LazyLock::new(|| {
    let rough = |x: f64| (-x).exp();
    let smooth = |x: f64| (1.0 + 3_f64.sqrt() * x) * (-3_f64.sqrt() * x).exp();
    let smoother =
        |x: f64| (1.0 + 5_f64.sqrt() * x + 5.0 / 3.0 * x * x) * (-5_f64.sqrt() * x).exp();
    let kinds: [&dyn Fn(f64) -> f64; 3] = [&rough, &smooth, &smoother];
    let lengths = [1.5, 3.0, 6.0, 12.0, 25.0];
    let of = |kind: &dyn Fn(f64) -> f64, length: f64| Covariance::of_sums(|k| kind(k / length));
    kinds.iter().flat_map(|kind| lengths.map(|length| of(kind, length))).collect()
});

#[cfg(test)]
mod tests {
    use super::*;

    /// Two joints that swing, 90 frames, as single precision; these are hidden.
    fn swing(hidden: &[usize]) -> (Vec<f64>, Vec<f64>, Vec<bool>) {
        let at = |i: usize| {
            let (t, j) = ((i / 2) as f64, i % 2);
            let q = if j == 0 {
                (0.21 * t).sin()
            } else {
                0.3 * (0.13 * t).cos() - 0.1 * (0.4 * t).sin()
            };
            f64::from(q as f32)
        };
        let truth: Vec<f64> = (0..180).map(at).collect();
        let visible: Vec<bool> = (0..180).map(|i| !hidden.contains(&(i / 2))).collect();
        let q = truth.iter().zip(&visible).map(|(q, seen)| if *seen { *q } else { 9.0 }).collect();
        (truth, q, visible)
    }

    /// What is found for one joint with these values at all frames but the hidden ones.
    fn found(at: impl Fn(usize) -> f64, frames: usize, hidden: &[usize]) -> Vec<(usize, f64)> {
        let q: Vec<f64> = (0..frames).map(|f| f64::from(at(f) as f32)).collect();
        let visible: Vec<bool> = (0..frames).map(|f| !hidden.contains(&f)).collect();
        likely(&q, &visible, 1)
    }

    #[test]
    fn a_swing_goes_on_in_its_dropouts() {
        let hidden = [20, 21, 22, 23, 40, 42, 43, 60];
        let (truth, q, visible) = swing(&hidden);
        let found = likely(&q, &visible, 2);
        assert_eq!(found.len(), 2 * hidden.len());
        for (i, value) in found {
            assert!(!visible[i]);
            assert!((value - truth[i]).abs() < 5e-4, "{i}: {value} instead of {}", truth[i]);
        }
    }

    #[test]
    fn keys_and_holds_are_no_recording() {
        // Keys of one frame, and holds of ten.
        let rows: Vec<usize> = (0..90).filter(|f| f % 5 != 0).collect();
        let (_, q, visible) = swing(&rows);
        assert_eq!(likely(&q, &visible, 2), []);
        let pauses: Vec<usize> = (0..90).filter(|f| f % 15 >= 10).collect();
        assert_eq!(found(|f| (f / 15) as f64, 90, &pauses), []);
        // Eleven frames are too long, and how fast a joint moves at the start is not known.
        let (_, q, visible) = swing(&(30..41).collect::<Vec<_>>());
        assert_eq!(likely(&q, &visible, 2), []);
        let (_, q, visible) = swing(&[1, 2, 3]);
        assert_eq!(likely(&q, &visible, 2), []);
    }

    #[test]
    fn lines_and_cubics_are_no_recording() {
        let gap: Vec<usize> = (21..28).collect();
        let line = |f: usize| (f as f64 / 20.0).min(1.0) - (f as f64 - 28.0).max(0.0) / 20.0;
        assert_eq!(found(line, 49, &gap), []);
        let soft = |u: f64| u * u * (3.0 - 2.0 * u);
        let curves =
            |f: usize| if f < 25 { soft(f as f64 / 20.0) } else { soft((48 - f) as f64 / 20.0) };
        assert_eq!(found(curves, 49, &gap), []);
        // A line, a gap, a short hold, and a line.
        let rest = |f: usize| f.min(20) as f64 / 20.0 + f.saturating_sub(36) as f64 / 20.0;
        assert_eq!(found(rest, 57, &(21..27).collect::<Vec<_>>()), []);
    }

    #[test]
    fn a_slow_recording_crosses_cubics() {
        // Twice a period its fourth differences are smaller than rounding.
        let slow = |f: usize| 1.2 + 0.3 * (0.1 * f as f64).sin();
        for start in 12..60 {
            let gap: Vec<usize> = (start..start + 4).collect();
            assert_eq!(found(slow, 80, &gap).len(), 4, "{start}");
            // Frames are lost at other places, too.
            let mut hidden = gap.clone();
            hidden.extend([start - 8, start + 11]);
            let all = found(slow, 80, &hidden);
            for f in gap {
                let value = all.iter().find(|(place, _)| *place == f);
                let off = value.map(|(_, q)| (q - slow(f)).abs());
                assert!(off.is_some_and(|off| off < 1e-4), "{start}: {f} {off:?}");
            }
        }
        // Cubics through keys that are four to six frames apart, with the slopes of a smooth motion.
        for apart in 4..7 {
            let step = apart as f64;
            let key = |k: usize| 0.5 * (0.9 * k as f64).sin() + 0.2 * (0.37 * k as f64).cos();
            let slope = |k: usize| (key(k + 1) - key(k.saturating_sub(1))) / (2.0 * step);
            let curve = |f: usize| {
                let (k, u) = (f / apart, (f % apart) as f64 / step);
                let (u2, u3) = (u * u, u * u * u);
                (2.0 * u3 - 3.0 * u2 + 1.0) * key(k)
                    + (u3 - 2.0 * u2 + u) * step * slope(k)
                    + (3.0 * u2 - 2.0 * u3) * key(k + 1)
                    + (u3 - u2) * step * slope(k + 1)
            };
            for first in (5..14).map(|k| k * apart) {
                let gap: Vec<usize> = (first + 1..first + apart).collect();
                assert_eq!(
                    found(curve, 100, &gap),
                    [],
                    "keys {apart} frames apart, gap after {first}"
                );
            }
        }
    }

    #[test]
    fn a_key_beside_a_recording_is_not_part_of_it() {
        let wave = |f: usize| (0.3 * f as f64).sin();
        let alone: Vec<usize> = (31..36).collect();
        assert_eq!(found(wave, 37, &alone), []);
        // With frames on both sides it is part of a recording.
        assert_eq!(found(wave, 60, &alone).len(), alone.len());
        assert_eq!(found(wave, 38, &alone).len(), alone.len());
        // After a few frames it hardly matters.
        assert_eq!(found(wave, 37, &alone[1..]).len(), 4);
    }

    #[test]
    fn a_dropout_stays_near_the_range_around_it() {
        // The joint comes, turns in the gap, and goes.
        let turn = |f: usize| {
            let way = 0.15 * (f as f64 - 22.5).abs() + 0.01 * (1.3 * f as f64).sin();
            3.0 - way
        };
        let all = found(turn, 46, &(20..26).collect::<Vec<_>>());
        assert_eq!(all.len(), 6);
        let near = || (8..38).filter(|f| !(20..26).contains(f)).map(turn);
        let (low, high) = (near().fold(f64::MAX, f64::min), near().fold(f64::MIN, f64::max));
        let most = all.iter().map(|(_, q)| *q).fold(f64::MIN, f64::max);
        assert!((most - high - BEYOND * (high - low)).abs() < 1e-5, "{low} {high} {all:?}");
    }

    #[test]
    fn the_covariance_of_positions_is_that_of_summed_speeds() {
        let speeds = |k: f64| (-k / 3.0).exp();
        let covariance = Covariance::of_sums(speeds);
        let direct = |a: usize, b: usize| -> f64 {
            (0..a).flat_map(|r| (0..b).map(move |c| speeds(r.abs_diff(c) as f64))).sum()
        };
        for (a, b) in [(0, 5), (1, 1), (4, 9), (80, 33)] {
            assert!((covariance.of(a, b) - direct(a, b)).abs() < 1e-9);
        }
    }
}
