//! Dropouts: short gaps in recorded motion, and the most likely motion in them.
//!
//! Between two typed keys anything may happen. Where a few frames of a recording are missing, the frames around them
//! tell how fast the joint moved and how soon its speed changes. So the speed of a joint counts as a Gaussian process,
//! and its position as the sum (Rasmussen and Williams 2006, chapters 2, 4 and 5). The motion in a dropout is the mean of
//! several such processes, given the frames around it, each weighted by how likely it makes these frames.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use nalgebra::DMatrix;

/// Frames of the longest dropout.
const LONGEST: usize = 10;
/// Visible frames on each side that are looked at, and the farthest of them from the dropout.
const SIDE: usize = 12;
const FARTHEST: usize = 40;
/// Fewest pairs of neighbouring frames around a dropout that must show motion.
const MOVING: usize = 4;
/// Frames that a covariance spans.
const SPAN: usize = 2 * FARTHEST + LONGEST + 2;
/// What is added to the variance of each position, as a share of that of a step. It keeps the equations well posed.
const JITTER: f64 = 1e-6;

/// A gap of a joint, and the visible frames around it.
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
        for dropout in dropouts(q, visible, dim, j) {
            found.entry(dropout).or_default().push(j);
        }
    }
    let all = found.iter().flat_map(|(dropout, joints)| dropout.fill(q, dim, joints));
    all.collect()
}

/// The dropouts of joint `j`.
fn dropouts(q: &[f64], visible: &[bool], dim: usize, j: usize) -> Vec<Dropout> {
    let seen: Vec<usize> = (0..visible.len() / dim).filter(|f| visible[f * dim + j]).collect();
    let is_dropout = |k: &usize| {
        let hidden = seen[k + 1] - seen[*k] - 1;
        // How fast it moves at the start of a clip is not known.
        (1..=LONGEST).contains(&hidden) && *k > 0
    };
    let places = (0..seen.len().saturating_sub(1)).filter(is_dropout);
    places
        .filter_map(|k| {
            let (from, to) = (seen[k], seen[k + 1]);
            let before = &seen[(k + 1).saturating_sub(SIDE)..=k];
            let after = &seen[k + 1..(k + 1 + SIDE).min(seen.len())];
            let near = |f: &&usize| **f + FARTHEST >= from && **f <= to + FARTHEST;
            let around: Vec<usize> = before.iter().chain(after).filter(near).copied().collect();
            let pairs = || around.windows(2).filter(|p| p[1] == p[0] + 1);
            let rests = |p: &&[usize]| q[p[0] * dim + j].to_bits() == q[p[1] * dim + j].to_bits();
            // A joint that a person lets rest does so exactly; one that was recorded never does.
            let (resting, all) = (pairs().filter(rests).count(), pairs().count());
            (all >= MOVING + resting && all > 2 * resting).then_some(Dropout { from, to, around })
        })
        .collect()
}

impl Dropout {
    /// The most likely motion of these joints in it.
    fn fill(&self, q: &[f64], dim: usize, joints: &[usize]) -> Vec<(usize, f64)> {
        let start = self.around[0];
        let at: Vec<usize> = self.around[1..].iter().map(|f| f - start).collect();
        let way = |f: usize, j: usize| q[f * dim + j] - q[start * dim + j];
        let moved = DMatrix::from_fn(at.len(), joints.len(), |r, c| way(at[r] + start, joints[c]));
        let mut means = Vec::new();
        for covariance in COVARIANCES.iter() {
            let known = DMatrix::from_fn(at.len(), at.len(), |r, c| {
                covariance.of(at[r], at[c]) + if r == c { JITTER } else { 0.0 }
            });
            let Some(factor) = known.cholesky() else { continue };
            let solved = factor.solve(&moved);
            let n = at.len() as f64;
            let size = factor.l_dirty().diagonal().map(f64::ln).sum();
            // Each joint has a variance of its own, the most likely one.
            let log_likelihood = (0..joints.len()).map(|c| {
                let variance = solved.column(c).dot(&moved.column(c)) / n;
                -0.5 * n * variance.max(f64::MIN_POSITIVE).ln() - size
            });
            let inside = DMatrix::from_fn(self.to - self.from - 1, at.len(), |r, c| {
                covariance.of(self.from + 1 + r - start, at[c])
            });
            means.push((log_likelihood.sum::<f64>(), inside * solved));
        }
        let most = means.iter().map(|m| m.0).fold(f64::NEG_INFINITY, f64::max);
        let weight = |log_likelihood: f64| (log_likelihood - most).exp();
        let all: f64 = means.iter().map(|m| weight(m.0)).sum();
        let value = |r: usize, c: usize| {
            let mean: f64 = means.iter().map(|m| weight(m.0) * m.1[(r, c)]).sum();
            q[start * dim + joints[c]] + mean / all
        };
        let rows = 0..if means.is_empty() { 0 } else { self.to - self.from - 1 };
        let each = rows.flat_map(|r| (0..joints.len()).map(move |c| (r, c)));
        each.map(|(r, c)| ((self.from + 1 + r) * dim + joints[c], value(r, c))).collect()
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

    /// Two joints that swing, 90 frames; these are hidden.
    fn swing(hidden: &[usize]) -> (Vec<f64>, Vec<f64>, Vec<bool>) {
        let at = |i: usize| {
            let (t, j) = ((i / 2) as f64, i % 2);
            if j == 0 { (0.21 * t).sin() } else { 0.3 * (0.13 * t).cos() - 0.1 * (0.4 * t).sin() }
        };
        let truth: Vec<f64> = (0..180).map(at).collect();
        let visible: Vec<bool> = (0..180).map(|i| !hidden.contains(&(i / 2))).collect();
        let q = truth.iter().zip(&visible).map(|(q, seen)| if *seen { *q } else { 9.0 }).collect();
        (truth, q, visible)
    }

    #[test]
    fn a_swing_goes_on_in_its_dropouts() {
        let hidden = [20, 21, 22, 23, 40, 42, 43, 60];
        let (truth, q, visible) = swing(&hidden);
        let found = likely(&q, &visible, 2);
        assert_eq!(found.len(), 2 * hidden.len());
        for (i, value) in found {
            assert!(!visible[i]);
            assert!((value - truth[i]).abs() < 2e-4, "{i}: {value} instead of {}", truth[i]);
        }
    }

    #[test]
    fn a_gap_of_typed_keys_is_none() {
        // Keys of one frame, holds of ten, and a gap at the start.
        let rows: Vec<usize> = (0..90).filter(|f| f % 5 != 0).collect();
        let (_, q, visible) = swing(&rows);
        assert_eq!(likely(&q, &visible, 2), []);
        let held: Vec<f64> = (0..180).map(|i| (i / 2 / 15) as f64).collect();
        let visible: Vec<bool> = (0..180).map(|i| (i / 2) % 15 < 10).collect();
        assert_eq!(likely(&held, &visible, 2), []);
        let (_, q, visible) = swing(&[1, 2, 3]);
        assert_eq!(likely(&q, &visible, 2), []);
        // Eleven frames are too long.
        let (_, q, visible) = swing(&(30..41).collect::<Vec<_>>());
        assert_eq!(likely(&q, &visible, 2), []);
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
