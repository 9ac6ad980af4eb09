//! Precision: the error between command and reached motion.
//!
//! The paper's figure is the mean absolute error over all unmasked frames and state
//! dimensions. The state reached after action t is compared with command t+1, without time-warping;
//! lower is better. Other figures complement this single number.

use serde::{Deserialize, Serialize};

use super::goals::Goals;

/// Error below which a hold counts as reached, rad or m.
pub(super) const REACHED: f64 = 0.05;

/// Goals closer to each other than this are equal, rad or m: the grid of the documents.
const SAME: f64 = 1e-6;

/// The figures of a rollout. Errors in rad or m.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Precision {
    /// Mean absolute error over unmasked frames and joints: the paper's Precision. `None`
    /// when nothing was commanded.
    pub precision: Option<f64>,
    /// Mean absolute error over the visible frames at which the command moves, that is, at which
    /// some joint has another goal than before. The first frame of a hold counts, its other frames
    /// do not.
    #[serde(default)]
    pub moving: Option<f64>,
    /// Mean absolute error over masked frames. If the hidden motion is known (tasks extracted from
    /// data, see [`hidden_error`]), the error is against that motion. Otherwise it is against the
    /// straight line through the gap, and only shows how direct the motion was.
    pub masked_mae: Option<f64>,
    /// 95th percentile over unmasked frames and joints.
    pub p95: Option<f64>,
    /// Largest frame mean, with its frame.
    pub worst: Option<(usize, f64)>,
    /// Mean error in the last frame of each hold.
    pub hold_end: Option<f64>,
    /// Mean frames from the start of a hold until all joints are within 0.05 rad or m.
    pub frames_late: Option<f64>,
    /// Mean |a_t - a_(t-1)| in actions: the paper's "shaking".
    pub mean_abs_du: f64,
    /// Share of actions at their bound.
    pub saturation: f64,
    /// Mean error by joint over unmasked frames.
    pub per_joint: Vec<Option<f64>>,
    /// Mean error by frame; `None` where masked. Frame 0 is the start.
    pub per_frame: Vec<Option<f64>>,
    /// Each hold: a run of three or more frames with one goal for the same joints.
    pub holds: Vec<HoldError>,
}

/// The figures of one hold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct HoldError {
    /// First commanded frame of the hold.
    pub frame: usize,
    /// Its length in frames.
    pub length: usize,
    /// Mean error in its last frame, rad or m.
    pub end_error: f64,
    /// Frames until all joints with a goal were within 0.05 rad or m; `None` when never.
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
        let mut moving = Mean::default();
        let mut last: Vec<f64> = match reached.get(..dim) {
            Some(start) if frames > 0 => start.to_vec(),
            _ => vec![0.0; dim],
        };
        for f in 1..frames {
            let mut frame = Mean::default();
            let mut moves = false;
            for j in 0..dim {
                let e = (reached[f * dim + j] - goals.row(f)[j]).abs();
                if goals.is_visible(f, j) {
                    frame.add(e);
                    joints[j].add(e);
                    all.push(e);
                    moves |= (goals.row(f)[j] - last[j]).abs() > SAME;
                    last[j] = goals.row(f)[j];
                } else {
                    masked.add(e);
                }
            }
            if moves {
                moving.merge(&frame);
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
            moving: moving.get(),
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

/// Mean absolute error over masked frames and joints against the motion that the mask hides;
/// `truth` and `reached` are (frames, dim), frame 0 first. `None` when nothing is masked.
pub fn hidden_error(goals: &Goals, reached: &[f64], truth: &[f64]) -> Option<f64> {
    let dim = goals.dim();
    let frames = (reached.len().min(truth.len()) / dim.max(1)).min(goals.frames());
    let mut masked = Mean::default();
    for i in dim..frames * dim {
        if !goals.is_visible(i / dim, i % dim) {
            masked.add((reached[i] - truth[i]).abs());
        }
    }
    masked.get()
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

    fn merge(&mut self, other: &Mean) {
        self.sum += other.sum;
        self.n += other.n;
    }

    fn get(&self) -> Option<f64> {
        (self.n > 0).then(|| self.sum / self.n as f64)
    }
}

/// The smallest value that at least a share `p` of the values do not exceed.
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

/// Runs of at least three frames that command one pose, of all joints or of some.
fn holds(goals: &Goals, reached: &[f64], frames: usize) -> Vec<HoldError> {
    let dim = goals.dim();
    let asked = |f: usize| (0..dim).filter(move |&j| goals.is_visible(f, j));
    let alike = |a: usize, b: usize, j: usize| (goals.row(a)[j] - goals.row(b)[j]).abs() < SAME;
    // Joints that are left free may be anywhere.
    let same = |a: usize, b: usize| {
        let both = |j: usize| goals.is_visible(b, j) && alike(a, b, j);
        asked(a).all(both) && asked(b).count() == asked(a).count()
    };
    let mut holds = Vec::new();
    let mut f = 1;
    while f < frames {
        let start = f;
        f += 1;
        if asked(start).next().is_none() {
            continue;
        }
        while f < frames && same(start, f) {
            f += 1;
        }
        // A pose that was held before, perhaps with other joints, is not a transition that could be late.
        let stays = |j: usize| goals.is_visible(start - 1, j) && alike(start - 1, start, j);
        if f - start < 3 || asked(start).all(stays) {
            continue;
        }
        let errors =
            |g: usize| asked(g).map(move |j| (reached[g * dim + j] - goals.row(g)[j]).abs());
        holds.push(HoldError {
            frame: start,
            length: f - start,
            end_error: errors(f - 1).sum::<f64>() / asked(f - 1).count() as f64,
            late_frames: (start..f).find(|&g| errors(g).all(|e| e <= REACHED)).map(|g| g - start),
        });
    }
    holds
}

#[cfg(test)]
mod tests {
    use super::*;
    use robert_clip::Command;

    /// One joint; `None` is masked.
    fn goals(rows: &[Option<f32>]) -> Goals {
        let q = rows.iter().map(|v| v.unwrap_or(0.0)).collect();
        let visible = rows.iter().map(Option::is_some).collect();
        Goals::new(&Command::from_dense(vec!["a".into()], vec![0.0], q, visible).unwrap())
    }

    fn near(a: Option<f64>, b: f64) -> bool {
        (a.unwrap() - b).abs() < 1e-12
    }

    #[test]
    fn frames_are_strictly_aligned_and_frame_0_does_not_count() {
        let g = goals(&[Some(9.0), Some(1.0), Some(2.0), Some(3.0)]);
        // The right path one frame late, which time-warping would call perfect.
        let p = Precision::measure(&g, &[0.0, 0.0, 1.0, 2.0], &[0.0; 3], 1);
        assert!(near(p.precision, 1.0), "{p:?}");
        assert_eq!(p.per_frame, [None, Some(1.0), Some(1.0), Some(1.0)]);
        assert!(near(Precision::measure(&g, &[0.0, 1.0, 2.0, 3.0], &[], 1).precision, 0.0));
        // A rollout that still runs is measured over its frames so far.
        assert!(near(Precision::measure(&g, &[0.0, 1.5], &[], 1).precision, 0.5));
    }

    #[test]
    fn masked_frames_are_left_out_and_counted_apart() {
        let g = goals(&[Some(0.0), None, None, Some(3.0), Some(3.0)]);
        let reached = [0.0, 5.0, 1.0, 3.5, 3.1];
        let p = Precision::measure(&g, &reached, &[0.0; 4], 1);
        assert!(near(p.precision, 0.3));
        assert!(near(p.p95, 0.5));
        assert_eq!(p.worst, Some((3, 0.5)));
        // The straight line goes through 1 and 2; the hidden motion went through 5 and 2.
        assert!(near(p.masked_mae, 2.5));
        assert!(near(hidden_error(&g, &reached, &[0.0, 5.0, 2.0, 3.0, 3.0]), 0.5));
        assert_eq!(hidden_error(&goals(&[Some(0.0), Some(0.0)]), &[0.0; 2], &[1.0; 2]), None);
        let all = goals(&[Some(0.0), None, None]);
        assert_eq!(Precision::measure(&all, &[0.0; 3], &[0.0; 2], 1).precision, None);
    }

    /// Arrivals count, the rest of a hold does not; the first goal is compared with frame 0.
    #[test]
    fn moving_frames_are_those_at_which_a_goal_changes() {
        let rows = [Some(0.0), Some(0.0), None, Some(1.0), Some(1.0), Some(1.0), Some(2.0), None];
        let g = goals(&rows);
        let reached = [0.0, 0.4, 0.0, 0.7, 0.9, 1.0, 1.5, 0.0];
        let p = Precision::measure(&g, &reached, &[0.0; 7], 1);
        assert!(near(p.moving, f64::midpoint(0.3, 0.5)), "{p:?}");
        assert_eq!(Precision::measure(&goals(&[Some(0.0); 4]), &[0.0; 4], &[], 1).moving, None);
    }

    #[test]
    fn holds_know_their_end_and_how_late_they_were_reached() {
        let mut rows = vec![Some(0.0), None, None];
        rows.extend([Some(1.0); 4]);
        rows.extend([None, Some(2.0), Some(2.0), Some(2.0)]);
        let g = goals(&rows);
        // Within 0.05 from the third held frame on; the second hold is never reached.
        let reached = [0.0, 0.3, 0.6, 0.8, 0.94, 0.96, 1.02, 1.3, 1.5, 1.6, 1.7];
        let p = Precision::measure(&g, &reached, &[0.0; 10], 1);
        let holds: Vec<_> = p.holds.iter().map(|h| (h.frame, h.length, h.late_frames)).collect();
        assert_eq!(holds, [(3, 4, Some(2)), (8, 3, None)]);
        assert!((p.holds[0].end_error - 0.02).abs() < 1e-9, "{p:?}");
        // A hold that was never reached counts its whole length.
        assert!(near(p.frames_late, 2.5));
        assert!((p.hold_end.unwrap() - 0.16).abs() < 1e-9);
    }

    #[test]
    fn holds_of_some_joints_are_measured_at_these() {
        let n = [false, true];
        let seen = [[true; 2], n, n, n, n, n, n, [true; 2], [true; 2], [true; 2], n, n, n].concat();
        let q: Vec<f32> = (0..13).flat_map(|f| [0.0, if f > 3 { 1.0 } else { 0.0 }]).collect();
        let command = Command::from_dense(vec!["a".into(), "b".into()], vec![0.0; 2], q, seen);
        let reached: Vec<f64> =
            (0..13).flat_map(|f| [9.0, if f > 4 { 0.98 } else { 0.0 }]).collect();
        let p = Precision::measure(&Goals::new(&command.unwrap()), &reached, &[0.0; 12], 1);
        // From frame 1 the second joint stays where it was at the start, and from frame 10 where it was
        // before. From frame 7 the first joint has a goal as well, and is far off.
        let holds: Vec<_> = p.holds.iter().map(|h| (h.frame, h.length, h.late_frames)).collect();
        assert_eq!(holds, [(4, 3, Some(1)), (7, 3, None)]);
        assert!((p.holds[0].end_error - 0.02).abs() < 1e-9, "{p:?}");
    }

    #[test]
    fn shaking_and_saturation_are_of_actions() {
        let g = goals(&[Some(0.0); 4]);
        // Two actuators, three frames: |du| = 0.5, 0.1 then 0.5, 0.3.
        let p = Precision::measure(&g, &[0.0; 4], &[1.0, 0.0, 0.5, 0.1, 0.0, -0.2], 2);
        assert!((p.mean_abs_du - 0.35).abs() < 1e-12, "{}", p.mean_abs_du);
        assert!((p.saturation - 1.0 / 6.0).abs() < 1e-12);
    }
}
