//! A command and the motion that a policy reached, as pictures need them.
//!
//! Commands are rows with NaN for joints without a goal.

/// Frames ahead for which a goal is shown, as in the policy's window.
pub(super) const SIGHT_FRAMES: usize = 20;
/// Poses that differ by more than this are visibly different, rad or m.
const TELLING: f64 = 0.03;

/// A command and the reached motion, frame by frame from 0.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Motion {
    /// Title of the picture.
    pub name: String,
    /// The policy; `None` if nothing was simulated, and the states reached are those of the command.
    pub performer: Option<String>,
    /// Frames a second.
    pub fps: f64,
    /// Commanded states, NaN = no goal; (frames, S).
    pub commanded: Vec<Vec<f64>>,
    /// States reached; (frames, S).
    pub achieved: Vec<Vec<f64>>,
    /// Frames with a keyframe, ascending.
    pub keys: Vec<usize>,
    /// `rad` or `m`, for the caption.
    pub unit: String,
}

impl Motion {
    /// Frames that can be drawn.
    pub fn frames(&self) -> usize {
        self.achieved.len()
    }

    /// Precision of frames 1 to `frame`: mean absolute error over all goals; `None` before the
    /// first goal.
    pub fn precision(&self, frame: usize) -> Option<f64> {
        let (mut sum, mut count) = (0.0, 0_usize);
        let rows = self.achieved.iter().zip(&self.commanded).take(frame + 1).skip(1);
        for (a, c) in rows.flat_map(|(a, c)| a.iter().zip(c)).filter(|(_, c)| c.is_finite()) {
            sum += (a - c).abs();
            count += 1;
        }
        (count > 0).then(|| sum / count as f64)
    }

    /// The frame of a still: the last key that differs from the start (many motions end where they
    /// began), or the last frame.
    pub fn telling_frame(&self) -> usize {
        let last = self.frames().saturating_sub(1);
        let differs = |k: usize| {
            let (Some(row), Some(home)) = (self.commanded.get(k), self.achieved.first()) else {
                return false;
            };
            row.iter().zip(home).any(|(c, a)| (c - a).abs() > TELLING)
        };
        self.keys.iter().rev().copied().find(|k| *k <= last && differs(*k)).unwrap_or(last)
    }

    /// The next frame from `frame` on with a goal, within the window.
    pub(super) fn goal(&self, frame: usize) -> Option<usize> {
        let last = (frame + SIGHT_FRAMES).min(self.commanded.len().checked_sub(1)?);
        (frame..=last).find(|f| self.has_goal(*f))
    }

    /// Whether a frame without a goal shows the next one.
    pub(super) fn shows_next_goals(&self) -> bool {
        (0..self.frames()).any(|f| !self.has_goal(f) && self.goal(f).is_some())
    }

    pub(super) fn has_goal(&self, frame: usize) -> bool {
        self.commanded.get(frame).is_some_and(|c| c.iter().any(|v| v.is_finite()))
    }

    /// The command of a frame, joints without goal as reached at `now`.
    pub(super) fn command(&self, frame: usize, now: usize) -> Option<Vec<f64>> {
        let row = self.commanded.get(frame)?;
        let reached = self.achieved.get(now)?;
        Some(row.iter().zip(reached).map(|(c, a)| if c.is_finite() { *c } else { *a }).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion() -> Motion {
        let nan = f64::NAN;
        Motion {
            commanded: vec![vec![nan, nan], vec![1.0, nan], vec![nan, nan], vec![0.0, 2.0]],
            achieved: vec![vec![0.0, 0.0], vec![0.5, 9.0], vec![7.0, 7.0], vec![0.0, 1.0]],
            ..Motion::default()
        }
    }

    #[test]
    fn precision_counts_goals_only() {
        let m = motion();
        assert_eq!(m.precision(0), None);
        assert_eq!(m.precision(1), Some(0.5));
        assert_eq!(m.precision(2), Some(0.5));
        assert_eq!(m.precision(3), Some(0.5), "(0.5 + 0 + 1) / 3");
    }

    #[test]
    fn goals_are_found_ahead_and_filled_with_what_was_reached() {
        let m = motion();
        assert_eq!(m.goal(0), Some(1));
        assert_eq!(m.goal(2), Some(3));
        assert_eq!(m.command(1, 3), Some(vec![1.0, 1.0]));
        assert_eq!(Motion::default().goal(0), None);
    }

    #[test]
    fn a_still_shows_what_differs_from_the_start() {
        let nan = f64::NAN;
        let home = vec![0.0, 0.0];
        let mut m = Motion {
            commanded: vec![home.clone(), vec![0.0, nan], vec![0.0, 1.0], home.clone()],
            achieved: vec![home.clone(); 4],
            keys: vec![0, 1, 2, 3],
            ..Motion::default()
        };
        assert_eq!(m.telling_frame(), 2, "frame 3 is home again");
        m.keys = vec![0, 3];
        assert_eq!(m.telling_frame(), 3, "nothing else is commanded");
        m.keys.clear();
        m.achieved.truncate(2);
        assert_eq!(m.telling_frame(), 1);
    }
}
