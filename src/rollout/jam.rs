//! Jams: joints that stay far from their goals although the goals can be reached.
//!
//! A joint jams if its error exceeds [`FAR`] for at least [`LEAST_FRAMES`] frames while iLQR, which
//! knows the model, is within [`NEAR`] over the same frames.

use serde::{Deserialize, Serialize};

use super::goals::Goals;

/// Error of a joint that jams, rad or m.
pub(super) const FAR: f64 = 0.05;

/// Error below which the goal counts as reached by iLQR, rad or m.
pub(super) const NEAR: f64 = 0.02;

/// Least number of frames of a jam.
pub(super) const LEAST_FRAMES: usize = 20;

/// Frames `[from, to)` over which a joint is off its goals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Off {
    /// The joint, in the order of the state.
    pub joint: usize,
    /// First frame.
    pub from: usize,
    /// First frame after.
    pub to: usize,
}

/// Frames at which joints are more than `limit` off, among the frames that could be part of a jam:
/// runs of at least [`LEAST_FRAMES`] frames in which the joint has a goal. `reached` is (frames,
/// S).
pub(super) fn off(goals: &Goals, reached: &[f64], limit: f64) -> Vec<Off> {
    let dim = goals.dim();
    let frames = (reached.len() / dim).min(goals.frames());
    let mut found = Vec::new();
    for joint in 0..dim {
        for (from, to) in runs(1..frames, |f| goals.is_visible(f, joint)) {
            if to - from < LEAST_FRAMES {
                continue;
            }
            let far = |f: usize| (reached[f * dim + joint] - goals.row(f)[joint]).abs() > limit;
            found.extend(runs(from..to, far).map(|(from, to)| Off { joint, from, to }));
        }
    }
    found
}

/// The jams: runs of `far` (off by [`FAR`]) without the frames of `floor` (iLQR off by [`NEAR`]).
pub(super) fn jams(far: &[Off], floor: &[Off]) -> Vec<Off> {
    let mut found = Vec::new();
    for run in far {
        let covered =
            |f: usize| floor.iter().any(|o| o.joint == run.joint && (o.from..o.to).contains(&f));
        let pieces = runs(run.from..run.to, |f| !covered(f));
        let long = pieces.filter(|(from, to)| to - from >= LEAST_FRAMES);
        found.extend(long.map(|(from, to)| Off { from, to, ..*run }));
    }
    found
}

/// Runs `[from, to)` of frames that hold.
fn runs(
    frames: std::ops::Range<usize>,
    holds: impl Fn(usize) -> bool,
) -> impl Iterator<Item = (usize, usize)> {
    let mut f = frames.start;
    std::iter::from_fn(move || {
        f = (f..frames.end).find(|&g| holds(g))?;
        let from = f;
        f = (from..frames.end).find(|&g| !holds(g)).unwrap_or(frames.end);
        Some((from, f))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use robert_clip::Command;

    /// One joint, goal 0, visible at the frames given.
    fn goals(frames: usize, visible: impl Fn(usize) -> bool) -> Goals {
        let seen = (0..frames).map(visible).collect();
        let q = vec![0.0; frames];
        Goals::new(&Command::from_dense(vec!["a".into()], vec![0.0], q, seen).unwrap())
    }

    #[test]
    fn a_second_far_from_a_goal_in_reach_is_a_jam() {
        let g = goals(80, |_| true);
        let mut reached = vec![0.0; 80];
        reached[10..40].fill(0.06);
        reached[50..69].fill(0.2);
        let far = off(&g, &reached, FAR);
        assert_eq!(far, [Off { joint: 0, from: 10, to: 40 }, Off { joint: 0, from: 50, to: 69 }]);
        // The second is a frame too short.
        assert_eq!(jams(&far, &[]), [Off { joint: 0, from: 10, to: 40 }]);
        // If iLQR is off too, a jam cannot be recognised; the rest is one frame too short.
        assert_eq!(jams(&far, &[Off { joint: 0, from: 10, to: 21 }]), []);
        assert_eq!(jams(&far, &[Off { joint: 0, from: 15, to: 20 }]).len(), 1);
        assert_eq!(jams(&far, &[Off { joint: 1, from: 0, to: 80 }]).len(), 1);
    }

    #[test]
    fn only_what_is_commanded_for_a_second_can_jam() {
        let g = goals(60, |f| !(15..=30).contains(&f));
        let far = off(&g, &[0.5; 60], FAR);
        assert_eq!(far, [Off { joint: 0, from: 31, to: 60 }]);
    }
}
