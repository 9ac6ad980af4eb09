//! Frames in which the robot presses instead of moving, found in the data.
//!
//! A joint that is held by a stop, by another link or by dry friction hides how strongly it is
//! driven: actions that differ widely lead to the same motion. Contact is recorded at the end of a
//! frame, so touch within a frame is not seen. On hands with stiff position servos a few percent of
//! such frames spoil every fit by least squares, because their actions are far from all others.
//!
//! The action is fitted as a linear function of the positions before, at and after a frame. The fit
//! is repeated on the half of the frames that it explains best (least trimmed squares, Rousseeuw and
//! Van Driessen 2006). Frames far away from the last fit are those that press.

use robert_base::rng::{Rng, Stream};
use robert_dataset::{Dataset, Part};
use robert_linalg::{Init, Mat, MatMut, gemm};
use robert_net::ridge::{cholesky, solve};

/// Frames for the fit.
const SAMPLES: usize = 20_000;
/// The least number of frames for each feature.
const FOR_EACH: usize = 4;
/// Fits, each on the best half of the one before.
const ROUNDS: usize = 5;
/// Ridge penalty for each frame, with features of variance 1.
const PENALTY: f64 = 1e-6;
/// Distance from the fit beyond which a frame presses, in standard deviations of the best half.
const FAR: f64 = 12.0;
/// The least standard deviation that counts, in actions from -1 to 1.
const LEAST: f64 = 1e-3;

/// Which frames of a dataset press.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Pressing {
    /// By trajectory and frame.
    frames: Vec<Vec<bool>>,
}

impl Pressing {
    /// Looks through all trajectories, with a fit to those of the training part.
    pub(super) fn find(data: &Dataset, seed: u64) -> Pressing {
        let none = |e| vec![false; data.self_contact(e).len()];
        let Some(fit) = Fit::new(data, seed) else {
            return Pressing { frames: data.episodes().iter().map(none).collect() };
        };
        let frames = data
            .episodes()
            .iter()
            .map(|e| {
                let (q, _, actions) = data.frames(e);
                let count = data.self_contact(e).len();
                let mut features = vec![0.0; fit.inputs()];
                let presses = |t| {
                    t + 1 < count && {
                        fit.features(q, t, &mut features);
                        fit.distance(&features, &actions[t * fit.actions..]) > FAR
                    }
                };
                (0..count).map(presses).collect()
            })
            .collect();
        Pressing { frames }
    }

    /// Whether a trajectory of the dataset presses at this frame.
    pub(super) fn at(&self, episode: usize, frame: usize) -> bool {
        self.frames.get(episode).and_then(|flags| flags.get(frame)).is_some_and(|&on| on)
    }

    /// The share of frames that press.
    pub(super) fn share(&self) -> f64 {
        let all: usize = self.frames.iter().map(Vec::len).sum();
        let on: usize = self.frames.iter().flatten().filter(|on| **on).count();
        on as f64 / all.max(1) as f64
    }
}

/// The action as a linear function of positions.
struct Fit {
    state: usize,
    actions: usize,
    /// Inverse standard deviation of each feature.
    scale: Vec<f64>,
    /// (inputs, A).
    weights: Vec<f64>,
    /// Standard deviation of each action in the best half.
    spread: Vec<f64>,
}

impl Fit {
    /// `None` without enough frames.
    fn new(data: &Dataset, seed: u64) -> Option<Fit> {
        let facts = robert_rollout::facts(&data.manifest().robot);
        let (s, a) = (facts.joints.len(), facts.actions);
        let mut fit = Fit {
            state: s,
            actions: a,
            scale: vec![1.0; 3 * s + 1],
            weights: Vec::new(),
            spread: vec![LEAST; a],
        };
        let f = fit.inputs();
        let (mut x, mut y) = (Vec::new(), Vec::new());
        let part = data.part(Part::Train, seed);
        for index in 0..10 * SAMPLES as u64 {
            if part.is_empty() || y.len() == SAMPLES * a {
                break;
            }
            let mut rng = Rng::new(seed, Stream::Fit, index);
            let e = &data.episodes()[part[rng.below(part.len() as u64) as usize]];
            let count = data.self_contact(e).len();
            if count < 2 {
                continue;
            }
            let t = rng.below(count as u64 - 1) as usize;
            if data.self_contact(e)[t] != 0 {
                continue;
            }
            let (q, _, actions) = data.frames(e);
            x.resize(x.len() + f, 0.0);
            let from = x.len() - f;
            fit.features(q, t, &mut x[from..]);
            y.extend(actions[t * a..(t + 1) * a].iter().map(|&u| f64::from(u)));
        }
        let rows = y.len() / a.max(1);
        if rows < FOR_EACH * f {
            return None;
        }
        for k in 0..f {
            let column = || x.iter().skip(k).step_by(f);
            let mean = column().sum::<f64>() / rows as f64;
            let square = column().map(|v| (v - mean).powi(2)).sum::<f64>() / rows as f64;
            // The constant, and joints that never move, keep their scale.
            if square > 1e-18 {
                fit.scale[k] = 1.0 / square.sqrt();
            }
        }
        x.chunks_exact_mut(f)
            .for_each(|row| row.iter_mut().zip(&fit.scale).for_each(|(x, scale)| *x *= scale));
        let mut kept: Vec<usize> = (0..rows).collect();
        let mut off = vec![0.0; rows * a];
        for _ in 0..ROUNDS {
            fit.weights = least_squares(&x, &y, f, a, &kept)?;
            off.iter_mut().zip(&y).for_each(|(off, y)| *off = -y);
            let weights = Mat::new(&fit.weights, f, a);
            gemm(MatMut::new(&mut off, rows, a), Init::Add, Mat::new(&x, rows, f), weights);
            let usual: Vec<f64> = (0..a)
                .map(|j| median(off.iter().skip(j).step_by(a).map(|v| v.abs()).collect()))
                .collect();
            let score = |row: usize| {
                let each = off[row * a..(row + 1) * a].iter().zip(&usual);
                each.map(|(off, usual)| off.abs() / usual.max(LEAST)).fold(0.0, f64::max)
            };
            let scores: Vec<f64> = (0..rows).map(score).collect();
            let middle = median(scores.clone());
            kept = (0..rows).filter(|&row| scores[row] <= middle).collect();
        }
        for (j, spread) in fit.spread.iter_mut().enumerate() {
            // Of a normal distribution the median distance is .6745 standard deviations.
            let near = kept.iter().map(|&row| off[row * a + j].abs()).collect();
            *spread = (median(near) / 0.6745).max(LEAST);
        }
        Some(fit)
    }

    fn inputs(&self) -> usize {
        self.scale.len()
    }

    /// One, the positions after the frame, and the ways in this frame and the one before; scaled.
    fn features(&self, q: &[f32], t: usize, to: &mut [f64]) {
        let s = self.state;
        let at = |t: usize, j: usize| f64::from(q[t * s + j]);
        to[3 * s] = 1.0;
        for j in 0..s {
            let (next, here, before) = (at(t + 1, j), at(t, j), at(t.saturating_sub(1), j));
            to[j] = next * self.scale[j];
            to[s + j] = (next - here) * self.scale[s + j];
            to[2 * s + j] = (here - before) * self.scale[2 * s + j];
        }
    }

    /// Distance of an action (A) from the fit, in standard deviations, of its farthest component.
    fn distance(&self, features: &[f64], action: &[f32]) -> f64 {
        let a = self.actions;
        let mut off: Vec<f64> = action[..a].iter().map(|&u| -f64::from(u)).collect();
        for (x, row) in features.iter().zip(self.weights.chunks_exact(a)) {
            off.iter_mut().zip(row).for_each(|(off, w)| *off += x * w);
        }
        off.iter().zip(&self.spread).map(|(off, s)| off.abs() / s).fold(0.0, f64::max)
    }
}

/// Weights (f, a) that explain these rows of `y` (rows, a) by those of `x` (rows, f).
fn least_squares(x: &[f64], y: &[f64], f: usize, a: usize, rows: &[usize]) -> Option<Vec<f64>> {
    let pick = |of: &[f64], width: usize| -> Vec<f64> {
        rows.iter().flat_map(|row| &of[row * width..(row + 1) * width]).copied().collect()
    };
    let (x, y) = (pick(x, f), pick(y, a));
    let (mut xx, mut weights) = (vec![0.0; f * f], vec![0.0; f * a]);
    let m = Mat::new(&x, rows.len(), f);
    gemm(MatMut::new(&mut xx, f, f), Init::Zero, m.t(), m);
    gemm(MatMut::new(&mut weights, f, a), Init::Zero, m.t(), Mat::new(&y, rows.len(), a));
    xx.iter_mut().step_by(f + 1).for_each(|d| *d += PENALTY * rows.len() as f64);
    cholesky(&mut xx, f).ok()?;
    solve(&xx, f, &mut weights, a);
    Some(weights)
}

/// The middle value; 0 of none.
fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() {
        return 0.0;
    }
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use robert_base::progress::{Cancel, Silent};
    use robert_dataset::Verify;
    use robert_explore::{CollectConfig, collect};
    use robert_robot::Robot;

    #[test]
    fn a_median_is_in_the_middle() {
        assert_eq!(median(vec![3.0, 9.0, 1.0]), 3.0);
        assert_eq!(median(Vec::new()), 0.0);
    }

    /// Frames whose actions were replaced by others are found, and most others are not.
    #[test]
    fn actions_that_do_not_move_the_robot_stand_out() {
        let dir = tempfile::tempdir().unwrap();
        let robot = std::sync::Arc::new(Robot::builtin("ur5e").unwrap());
        let config = CollectConfig { transitions: 5_000, ..CollectConfig::new(&robot) };
        let path = dir.path().join("data");
        collect(&robot, &config, &path, false, 1, &Silent, &Cancel::default()).unwrap();
        let data = Dataset::open(&path, Verify::Full).unwrap();
        let fit = Fit::new(&data, 0).unwrap();
        let mut features = vec![0.0; fit.inputs()];
        let (mut found, mut wrong, mut all) = (0, 0, 0);
        for e in data.episodes() {
            let (q, _, actions) = data.frames(e);
            for t in (1..data.self_contact(e).len() - 1).step_by(7) {
                fit.features(q, t, &mut features);
                let action = &actions[t * fit.actions..(t + 1) * fit.actions];
                let mut pressed = action.to_vec();
                pressed[0] += if pressed[0] > 0.0 { -0.9 } else { 0.9 };
                all += 1;
                wrong += usize::from(fit.distance(&features, action) > FAR);
                found += usize::from(fit.distance(&features, &pressed) > FAR);
            }
        }
        assert!(
            all > 500 && found * 100 > all * 95 && wrong * 100 < all * 25,
            "{found} {wrong} {all}"
        );
    }
}
