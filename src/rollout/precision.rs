//! Precision: how near the reached motion came to the commanded one.
//!
//! The paper's figure is the mean absolute error over all unmasked frames and state
//! dimensions, the state reached after action t against command t+1, strictly aligned:
//! no time-warping, lower is better. One number hides much, so it comes with company.

use serde::{Deserialize, Serialize};

use super::window::Goals;

/// Error below which a hold counts as reached, rad or m.
pub(super) const REACHED: f64 = 0.05;

/// How a rollout did. Errors in rad or m.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Precision {
    /// Mean absolute error over unmasked frames and joints: the paper's Precision. `None`
    /// when nothing was commanded.
    pub precision: Option<f64>,
    /// The same over masked frames, against the straight line through the gap. Means
    /// something only where the hidden motion is known (tasks cut from data).
    pub masked_mae: Option<f64>,
    /// 95th percentile over unmasked frames and joints.
    pub p95: Option<f64>,
    /// Largest frame mean, with its frame.
    pub worst: Option<(usize, f64)>,
    /// Mean error in the last frame of each hold.
    pub hold_end: Option<f64>,
    /// Mean frames from the start of a hold until all joints are within [`REACHED`].
    pub frames_late: Option<f64>,
    /// Mean |a_t - a_(t-1)| in actions: the paper's "shaking".
    pub mean_abs_du: f64,
    /// Share of actions at their bound.
    pub saturation: f64,
    /// Mean error by joint over unmasked frames.
    pub per_joint: Vec<Option<f64>>,
    /// Mean error by frame; `None` where masked. Frame 0 is the start.
    pub per_frame: Vec<Option<f64>>,
    /// Each hold: a run of three or more visible frames with one goal.
    pub holds: Vec<HoldError>,
}

/// How one hold did.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HoldError {
    /// First commanded frame of the hold.
    pub frame: usize,
    /// Its length in frames.
    pub length: usize,
    /// Mean error in its last frame, rad or m.
    pub end_error: f64,
    /// Frames until all joints were within [`REACHED`]; `None` when never.
    pub late_frames: Option<usize>,
}

impl Precision {
    /// Measures `reached` ((frames, dim), frame 0 first) against the goals. `actions` is
    /// (frames - 1, A). Frames beyond `reached` are left out, so a rollout can be measured
    /// while it streams.
    pub fn measure(
        goals: &Goals,
        reached: &[f64],
        actions: &[f64],
        action_dim: usize,
    ) -> Precision {
        let dim = goals.dim();
        let frames = (reached.len() / dim.max(1)).min(goals.frames());
        let mut all = Vec::new();
        let mut masked = Mean::default();
        let mut joints = vec![Mean::default(); dim];
        let mut per_frame = vec![None; frames];
        let mut worst: Option<(usize, f64)> = None;
        for f in 1..frames {
            let mut frame = Mean::default();
            for j in 0..dim {
                let e = (reached[f * dim + j] - goals.row(f)[j]).abs();
                if goals.is_visible(f, j) {
                    frame.add(e);
                    joints[j].add(e);
                    all.push(e);
                } else {
                    masked.add(e);
                }
            }
            per_frame[f] = frame.get();
            if let Some(e) = frame.get().filter(|&e| worst.is_none_or(|(_, w)| e > w)) {
                worst = Some((f, e));
            }
        }
        let holds = holds(goals, reached, frames);
        let precision = (!all.is_empty()).then(|| all.iter().sum::<f64>() / all.len() as f64);
        let mut late = Mean::default();
        let mut ends = Mean::default();
        for h in &holds {
            ends.add(h.end_error);
            late.add(h.late_frames.unwrap_or(h.length) as f64);
        }
        Precision {
            precision,
            masked_mae: masked.get(),
            p95: percentile(&mut all, 0.95),
            worst,
            hold_end: ends.get(),
            frames_late: late.get(),
            mean_abs_du: mean_abs_du(actions, action_dim),
            saturation: actions.iter().filter(|a| a.abs() >= 0.999).count() as f64
                / actions.len().max(1) as f64,
            per_joint: joints.iter().map(Mean::get).collect(),
            per_frame,
            holds,
        }
    }
}

#[derive(Clone, Debug, Default)]
struct Mean {
    sum: f64,
    n: usize,
}

impl Mean {
    fn add(&mut self, v: f64) {
        self.sum += v;
        self.n += 1;
    }

    fn get(&self) -> Option<f64> {
        (self.n > 0).then(|| self.sum / self.n as f64)
    }
}

/// Smallest value that at least a share `p` does not exceed.
fn percentile(values: &mut [f64], p: f64) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let rank = (p * values.len() as f64).ceil() as usize;
    values.get(rank.saturating_sub(1)).copied()
}

fn mean_abs_du(actions: &[f64], dim: usize) -> f64 {
    if dim == 0 || actions.len() < 2 * dim {
        return 0.0;
    }
    let changes = actions.len() - dim;
    actions.iter().zip(&actions[dim..]).map(|(a, b)| (b - a).abs()).sum::<f64>() / changes as f64
}

/// Runs of at least three visible frames that ask for one pose.
fn holds(goals: &Goals, reached: &[f64], frames: usize) -> Vec<HoldError> {
    let dim = goals.dim();
    let whole = |f: usize| (0..dim).all(|j| goals.is_visible(f, j));
    let same = |a: usize, b: usize| {
        goals.row(a).iter().zip(goals.row(b)).all(|(x, y)| (x - y).abs() < 1e-6)
    };
    let mut holds = Vec::new();
    let mut f = 1;
    while f < frames {
        let start = f;
        f += 1;
        if !whole(start) {
            continue;
        }
        while f < frames && whole(f) && same(start, f) {
            f += 1;
        }
        // A pose held from the very start is no transition that could be late.
        let from_start = start == 1 && whole(0) && same(0, 1);
        if f - start < 3 || from_start {
            continue;
        }
        let errors =
            |g: usize| (0..dim).map(move |j| (reached[g * dim + j] - goals.row(g)[j]).abs());
        holds.push(HoldError {
            frame: start,
            length: f - start,
            end_error: errors(f - 1).sum::<f64>() / dim as f64,
            late_frames: (start..f).find(|&g| errors(g).all(|e| e <= REACHED)).map(|g| g - start),
        });
    }
    holds
}
