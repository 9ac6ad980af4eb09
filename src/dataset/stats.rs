//! Statistics of frames, for the normaliser and to judge data.
//!
//! All sums are in f64, in trajectory order, on one thread, so the bits do not depend on the
//! machine. For 3 M frames of 22 joints that takes a fraction of a second.

use serde::{Deserialize, Serialize};

use super::coverage::Coverage;
use super::open::Dataset;
use super::statistics::Statistics;
use robert_base::units::CTRL_DT;

/// An action beyond this share of its range counts as saturated.
const SATURATED: f32 = 0.999;

/// Mean and standard deviation of each column.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Moments {
    /// Mean.
    pub mean: Vec<f64>,
    /// Standard deviation (population), never below 1e-8.
    pub std: Vec<f64>,
}

/// Running sums of one column set.
#[derive(Clone, Debug)]
struct Sums {
    count: u64,
    shift: Vec<f64>,
    sum: Vec<f64>,
    square: Vec<f64>,
}

impl Sums {
    fn new(dim: usize) -> Self {
        Sums { count: 0, shift: vec![0.0; dim], sum: vec![0.0; dim], square: vec![0.0; dim] }
    }

    /// Adds a row. Sums are relative to the first row, because E[x^2] - E[x]^2 would cancel for a
    /// column that hardly moves.
    fn add(&mut self, row: impl Iterator<Item = f64>) {
        if self.count == 0 {
            self.shift = row.collect();
            self.count = 1;
            return;
        }
        self.count += 1;
        for (((x, c), s), q) in row.zip(&self.shift).zip(&mut self.sum).zip(&mut self.square) {
            let d = x - c;
            *s += d;
            *q += d * d;
        }
    }

    fn moments(&self) -> Moments {
        let n = self.count.max(1) as f64;
        let mean = self.shift.iter().zip(&self.sum).map(|(c, s)| c + s / n).collect();
        let spread = |(s, q): (&f64, &f64)| (q / n - (s / n) * (s / n)).max(0.0).sqrt().max(1e-8);
        Moments { mean, std: self.sum.iter().zip(&self.square).map(spread).collect() }
    }
}

/// Moments that scale the inputs of a network to order one.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Normaliser {
    /// `s_t`, (S).
    pub qpos: Moments,
    /// `s_t` - s_{t-1}, (S).
    pub d1: Moments,
    /// s_{t+1} - 2 `s_t` + s_{t-1}, (S).
    pub d2: Moments,
    /// `a_t` in [-1, 1], (A).
    pub ctrl: Moments,
}

impl Normaliser {
    /// Fits on the trajectories at these positions (use the train part only). Differences
    /// never cross a trajectory's end.
    pub fn fit(data: &Dataset, episodes: &[usize]) -> Self {
        let (s, a) = (data.manifest().qpos_dim(), data.manifest().ctrl_dim());
        let (mut q0, mut q1, mut q2, mut u) =
            (Sums::new(s), Sums::new(s), Sums::new(s), Sums::new(a));
        for e in episodes.iter().filter_map(|&i| data.episodes().get(i)) {
            let (qpos, _, ctrl) = data.frames(e);
            ctrl.chunks_exact(a).for_each(|row| u.add(row.iter().map(|&x| f64::from(x))));
            let (mut last, mut before): (Option<&[f32]>, Option<&[f32]>) = (None, None);
            for row in qpos.chunks_exact(s) {
                q0.add(row.iter().map(|&x| f64::from(x)));
                if let Some(l) = last {
                    q1.add(row.iter().zip(l).map(|(&x, &y)| f64::from(x) - f64::from(y)));
                    if let Some(b) = before {
                        q2.add(row.iter().zip(l).zip(b).map(|((&x, &y), &z)| {
                            f64::from(x) - 2.0 * f64::from(y) + f64::from(z)
                        }));
                    }
                }
                (last, before) = (Some(row), last);
            }
        }
        Normaliser { qpos: q0.moments(), d1: q1.moments(), d2: q2.moments(), ctrl: u.moments() }
    }
}

/// Frames that quantiles are taken from.
const QUANTILE_FRAMES: usize = 40_000;

/// The usual range of each joint in these trajectories, (S), from evenly spread frames: one frame
/// of 100 is below the first number, one above the second (rad or m), and one is faster than the
/// third (rad/s or m/s).
pub fn usual(data: &Dataset, episodes: &[usize]) -> Vec<[f64; 3]> {
    let rows = || {
        let episodes = episodes.iter().filter_map(|&i| data.episodes().get(i));
        episodes.map(|e| data.frames(e).0)
    };
    usual_of(data.manifest().qpos_dim(), &rows)
}

/// [`usual`] of given trajectories, each (frames, S).
fn usual_of<'a, I: Iterator<Item = &'a [f32]>>(s: usize, all: &dyn Fn() -> I) -> Vec<[f64; 3]> {
    let total: usize = all().map(|rows| rows.len() / s.max(1)).sum();
    let stride = total.div_ceil(QUANTILE_FRAMES).max(1);
    let (mut places, mut speeds) = (vec![Vec::new(); s], vec![Vec::new(); s]);
    let mut index = 0_usize;
    for rows in all() {
        let mut last: Option<&[f32]> = None;
        for row in rows.chunks_exact(s.max(1)) {
            if index.is_multiple_of(stride) {
                for (j, &x) in row.iter().enumerate() {
                    let before = last.and_then(|l| l.get(j));
                    if let (Some(p), Some(v)) = (places.get_mut(j), speeds.get_mut(j)) {
                        p.push(f64::from(x));
                        v.extend(before.map(|b| (f64::from(x) - f64::from(*b)).abs() / CTRL_DT));
                    }
                }
            }
            index += 1;
            last = Some(row);
        }
    }
    let at = |values: &mut Vec<f64>, share: f64| {
        values.sort_by(f64::total_cmp);
        let last = values.len().saturating_sub(1);
        values.get((share * last as f64).round() as usize).copied().unwrap_or(0.0)
    };
    let each = places.iter_mut().zip(&mut speeds);
    each.map(|(p, v)| [at(p, 0.01), at(p, 0.99), at(v, 0.99)]).collect()
}

impl Dataset {
    /// Quality and spread of all listed frames.
    pub fn statistics(&self) -> Statistics {
        Statistics::compute(self)
    }
}

impl Statistics {
    /// Scans all listed frames once.
    pub fn compute(data: &Dataset) -> Self {
        let m = data.manifest();
        let (s, a) = (m.qpos_dim(), m.ctrl_dim());
        let mut out = Statistics {
            near_limit: vec![0.0; s],
            saturated: vec![0.0; a],
            qpos_min: vec![f64::INFINITY; s],
            qpos_max: vec![f64::NEG_INFINITY; s],
            ..Statistics::default()
        };
        let (mut position, mut velocity) = (Sums::new(s), Sums::new(s));
        let mut coverage = Coverage::new(&m.robot);
        let mut frames = 0_u64;
        for e in data.episodes() {
            let (qpos, qvel, ctrl) = data.frames(e);
            frames += e.length;
            *out.agents.entry(e.agent.clone()).or_default() += e.length;
            *out.snapshots.entry(e.snapshot_step).or_default() += 1;
            for (row, speed) in qpos.chunks_exact(s).zip(qvel.chunks_exact(s)) {
                position.add(row.iter().map(|&x| f64::from(x)));
                velocity.add(speed.iter().map(|&x| f64::from(x)));
                coverage.add(row, speed);
                let mut any = 0.0;
                for j in m.robot.near_limits(row) {
                    any = 1.0;
                    bump(&mut out.near_limit, j, true);
                }
                out.near_limit_any += any;
                for (j, &x) in row.iter().enumerate() {
                    let x = f64::from(x);
                    if let (Some(lo), Some(hi)) = (out.qpos_min.get_mut(j), out.qpos_max.get_mut(j))
                    {
                        (*lo, *hi) = (lo.min(x), hi.max(x));
                    }
                }
            }
            for row in ctrl.chunks_exact(a) {
                for (k, u) in row.iter().enumerate() {
                    bump(&mut out.saturated, k, u.abs() >= SATURATED);
                }
            }
            out.self_contact += data.self_contact(e).iter().map(|&c| f64::from(c)).sum::<f64>();
        }
        let n = frames.max(1) as f64;
        out.near_limit.iter_mut().chain(&mut out.saturated).for_each(|x| *x /= n);
        out.near_limit_any /= n;
        out.self_contact /= n;
        if frames == 0 {
            // JSON has no infinity.
            out.qpos_min.fill(0.0);
            out.qpos_max.fill(0.0);
        }
        let Moments { mean, std } = position.moments();
        (out.qpos_mean, out.qpos_std) = (mean, std);
        out.qvel_std = velocity.moments().std;
        out.coverage = coverage.share();
        out
    }
}

fn bump(counts: &mut [f64], at: usize, hit: bool) {
    if let Some(c) = counts.get_mut(at).filter(|_| hit) {
        *c += 1.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_usual_leaves_the_rare_out() {
        // There are two trajectories, and the jump between them is not a speed. One joint rises,
        // the other stands still except for a single frame.
        let rising: Vec<f32> = (0..=1000).flat_map(|k| [k as f32 / 1000.0, 0.5]).collect();
        let mut again = rising.clone();
        again[1000] = 77.0;
        again[1001] = -9.0;
        let rows = || [&rising[..], &again[..]].into_iter();
        let [up, still] = usual_of(2, &rows)[..] else { panic!() };
        assert!((up[0] - 0.01).abs() < 2e-3 && (up[1] - 0.99).abs() < 2e-3, "{up:?}");
        assert!((up[2] - 0.001 / CTRL_DT).abs() < 1e-4, "{up:?}");
        assert_eq!(still, [0.5, 0.5, 0.0]);
    }

    #[test]
    fn moments_survive_a_large_mean() {
        let mut s = Sums::new(1);
        for x in [1e9, 1e9 + 1.0, 1e9 + 2.0] {
            s.add(std::iter::once(x));
        }
        let m = s.moments();
        assert_eq!(m.mean, [1e9 + 1.0]);
        assert!((m.std[0] - (2.0_f64 / 3.0).sqrt()).abs() < 1e-12, "{m:?}");
    }
}
