//! The masks of training and the schedules of masks and learning rate.
//!
//! The paper hides round(19 r) of 20 frames, with r rising from 0 to 1 between 2 % and 62 % of the
//! steps, so the last third of the training contains no dense commands. The default draws the
//! number for each window up to that limit, which keeps dense commands.

use serde::{Deserialize, Serialize};

use super::config::{COMMAND, CURRENT, MaskGranularity, WINDOW};
use robert_base::rng::Rng;

/// The rule that chooses how many command frames are hidden, and which.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MaskKind {
    /// Curriculum: the same number for the whole batch, rising to 19 of 20 (the paper's).
    Cl,
    /// 3 of 20 throughout.
    Fixed15,
    /// 7 of 20.
    Fixed35,
    /// 10 of 20.
    Fixed50,
    /// 14 of 20.
    Fixed70,
    /// None hidden.
    None,
    /// For each window a number drawn uniformly from 0 to that of the curriculum.
    #[default]
    ClUniform,
    /// As many frames as `cl-uniform`, in one block; the last frame stays visible.
    ClBlock,
}

/// The most hidden frames; one stays visible, or there would be no command.
pub const MOST_HIDDEN: usize = COMMAND - 1;

/// Hidden frames by the curriculum at this share of the training.
pub fn curriculum(progress: f64) -> usize {
    let ratio = ((progress - 0.02) / 0.60).clamp(0.0, 1.0);
    (MOST_HIDDEN as f64 * ratio).round() as usize
}

impl MaskKind {
    /// Hidden frames of one window.
    fn count(self, progress: f64, rng: &mut Rng) -> usize {
        match self {
            MaskKind::Cl => curriculum(progress),
            MaskKind::Fixed15 => 3,
            MaskKind::Fixed35 => 7,
            MaskKind::Fixed50 => 10,
            MaskKind::Fixed70 => 14,
            MaskKind::None => 0,
            MaskKind::ClUniform | MaskKind::ClBlock => {
                rng.below(curriculum(progress) as u64 + 1) as usize
            }
        }
    }

    /// Writes which values of a window are visible: `visible` is (51, S).
    pub fn draw(
        self,
        progress: f64,
        granularity: MaskGranularity,
        state: usize,
        rng: &mut Rng,
        visible: &mut [bool],
    ) {
        visible.fill(true);
        // Partial poses: in every second window each joint has its own hidden frames.
        let single = granularity == MaskGranularity::Joint && rng.below(2) == 1;
        for group in 0..if single { state } else { 1 } {
            let hidden = self.count(progress, rng).min(COMMAND);
            let mut hide = |frame: usize| {
                let row = (CURRENT + 1 + frame) * state;
                let joints = if single { group..group + 1 } else { 0..state };
                visible[row..][joints].fill(false);
            };
            if self == MaskKind::ClBlock {
                let start = rng.below((COMMAND - hidden) as u64) as usize;
                (start..start + hidden).for_each(&mut hide);
            } else {
                rng.subset(hidden, COMMAND).into_iter().for_each(&mut hide);
            }
        }
    }
}

/// Learning-rate schedules.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Schedule {
    /// Warm-up over 10 %, flat to 35 %, cosine to 0.1 % at 85 % (the paper's).
    Paper,
    /// Warm-up over 3 %, cosine to 2 % at the end: short trainings.
    #[default]
    Cosine,
    /// Constant.
    Constant,
}

impl Schedule {
    /// Factor on the learning rate at this share of the training.
    pub fn factor(self, progress: f64) -> f64 {
        let half_wave = |x: f64| 0.5 * (1.0 + (std::f64::consts::PI * x).cos());
        match self {
            Schedule::Paper if progress < 0.10 => 1e-4 + (1.0 - 1e-4) * progress / 0.10,
            Schedule::Paper if progress < 0.35 => 1.0,
            Schedule::Paper if progress < 0.85 => {
                0.001 + 0.999 * half_wave((progress - 0.35) / 0.5)
            }
            Schedule::Paper => 0.001,
            Schedule::Cosine if progress < 0.03 => (progress / 0.03).max(1e-3),
            Schedule::Cosine => 0.02 + 0.98 * half_wave(((progress - 0.03) / 0.97).min(1.0)),
            Schedule::Constant => 1.0,
        }
    }
}

/// Whether every joint of history and current frame is visible, which every window requires.
pub fn past_is_visible(visible: &[bool], state: usize) -> bool {
    visible.len() == WINDOW * state && visible[..(CURRENT + 1) * state].iter().all(|&v| v)
}

#[cfg(test)]
mod tests {
    use super::*;
    use robert_base::rng::Stream;

    fn hidden(kind: MaskKind, progress: f64, index: u64) -> Vec<usize> {
        let mut visible = [true; WINDOW * 2];
        let mut rng = Rng::new(4, Stream::Mask, index);
        kind.draw(progress, MaskGranularity::State, 2, &mut rng, &mut visible);
        assert!(past_is_visible(&visible, 2));
        (0..COMMAND).filter(|f| !visible[(CURRENT + 1 + f) * 2]).collect()
    }

    #[test]
    fn numbers_of_hidden_frames() {
        assert_eq!([0.0, 0.02, 0.32, 0.62, 1.0].map(curriculum), [0, 0, 10, 19, 19]);
        for (kind, n) in [
            (MaskKind::Cl, 19),
            (MaskKind::Fixed15, 3),
            (MaskKind::Fixed35, 7),
            (MaskKind::Fixed50, 10),
            (MaskKind::Fixed70, 14),
            (MaskKind::None, 0),
        ] {
            assert!((0..50).all(|i| hidden(kind, 0.9, i).len() == n));
        }
        let counts: std::collections::BTreeSet<_> =
            (0..500).map(|i| hidden(MaskKind::ClUniform, 0.9, i).len()).collect();
        assert_eq!(counts, (0..=19).collect());
    }

    #[test]
    fn blocks_are_whole_and_leave_the_last_frame() {
        let mut latest = 0;
        for i in 0..500 {
            let frames = hidden(MaskKind::ClBlock, 1.0, i);
            assert!(frames.windows(2).all(|w| w[1] == w[0] + 1));
            assert!(!frames.contains(&(COMMAND - 1)));
            latest = latest.max(frames.last().copied().unwrap_or(0));
        }
        assert_eq!(latest, COMMAND - 2);
    }

    #[test]
    fn joints_hide_alone_when_asked() {
        let mut partial = 0;
        for i in 0..100 {
            let mut visible = [true; WINDOW * 3];
            let mut rng = Rng::new(4, Stream::Mask, i);
            MaskKind::ClUniform.draw(0.9, MaskGranularity::Joint, 3, &mut rng, &mut visible);
            assert!(past_is_visible(&visible, 3));
            let mixed = visible.chunks(3).any(|f| f.iter().any(|&v| v) && f.iter().any(|&v| !v));
            partial += usize::from(mixed);
        }
        assert!((30..70).contains(&partial), "{partial}");
    }

    #[test]
    fn the_papers_learning_rate() {
        let f = |x| Schedule::Paper.factor(x);
        assert!((f(0.0) - 1e-4).abs() < 1e-12);
        assert!((f(0.05) - 0.50005).abs() < 1e-9);
        assert_eq!(f(0.2), 1.0);
        assert!((f(0.6) - 0.5005).abs() < 1e-9);
        assert!((f(0.9) - 0.001).abs() < 1e-12);
    }
}
