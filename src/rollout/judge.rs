//! What decides between two motions of a clip.
//!
//! Usually the smaller sum of Precision and the penalty for unnatural motion in gaps. A finger that
//! stays behind another one for a second adds little to the mean over all joints and frames, but a
//! person sees it at once. A strict judge gives the errors of joints that jam more weight, as long as
//! the usual sum stays nearly as small.

use std::sync::Arc;

use super::gaps;
use super::jam::Off;
use super::run::Rollout;
use super::window::{Goals, HISTORY};

/// Weight that a strict judge gives to the errors of joints that jam: a joint that comes free may cost
/// the others four fifths of what it gains.
const JAMS: f64 = 5.0;
/// The share by which the usual sum may grow under a strict judge, which nobody sees.
const GIVES: f64 = 0.03;

/// Compares motions; the smaller the score the better.
#[derive(Clone, Debug)]
pub(super) struct Judge {
    /// Weights of the errors, (frames, S); `None` if all are 1.
    weights: Option<Arc<[f64]>>,
    /// The largest sum of Precision and penalty that a motion may have, rad or m.
    most: f64,
}

impl Default for Judge {
    fn default() -> Judge {
        Judge { weights: None, most: f64::INFINITY }
    }
}

impl Judge {
    /// A strict judge of motions that should lose the jams of `best`. Their usual sum stays below
    /// `most`.
    pub(super) fn strict(best: &Rollout, jams: &[Off], most: f64) -> Judge {
        let (goals, d) = (best.goals(), best.goals().dim());
        let mut weights = vec![1.0; goals.frames() * d];
        for jam in jams {
            (jam.from..jam.to).for_each(|f| weights[f * d + jam.joint] = JAMS);
        }
        let least = Judge::default().score(best).unwrap_or(f64::INFINITY);
        Judge { weights: Some(weights.into()), most: most.min((1.0 + GIVES) * least) }
    }

    /// Precision with weighted errors and the penalty for unnatural motion in gaps, rad or m. `None`
    /// if nothing was commanded, or if the usual sum is too large.
    pub(super) fn score(&self, rollout: &Rollout) -> Option<f64> {
        let goals = rollout.goals();
        let (precision, penalty) = (rollout.precision().precision?, gaps::unnatural(rollout));
        let weighted = match self.weights {
            None => precision,
            Some(_) => {
                let reached = &rollout.states()[HISTORY * goals.dim()..];
                let frames = 1..goals.frames();
                frames.map(|f| self.error_at(goals, reached, f)).sum::<f64>() / commanded(goals)
            }
        };
        (precision + penalty < self.most).then_some(weighted + penalty)
    }

    /// The weight of a joint's error at a frame.
    pub(super) fn weight(&self, goals: &Goals, frame: usize, joint: usize) -> f64 {
        self.weights.as_ref().map_or(1.0, |w| w[frame * goals.dim() + joint])
    }

    /// The weighted sum of the errors of a frame; `reached` is (frames, S).
    pub(super) fn error_at(&self, goals: &Goals, reached: &[f64], f: usize) -> f64 {
        let d = goals.dim();
        let error = |j: usize| (reached[f * d + j] - goals.row(f)[j]).abs();
        let seen = (0..d).filter(|&j| goals.is_visible(f, j));
        seen.map(|j| self.weight(goals, f, j) * error(j)).sum()
    }
}

/// The number of goals. Precision is the mean error over them.
pub(super) fn commanded(goals: &Goals) -> f64 {
    let seen = |f: usize| (0..goals.dim()).filter(move |&j| goals.is_visible(f, j)).count();
    (1..goals.frames()).map(seen).sum::<usize>() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{PolicyConfig, PolicyName, RolloutConfig, Start, tasks};
    use robert_base::progress::Cancel;
    use robert_clip::compile;
    use robert_robot::Robot;

    #[test]
    fn a_strict_judge_counts_the_frames_of_a_jam_five_times() {
        let robot = Arc::new(Robot::builtin("pointmass").unwrap());
        let command = compile(&tasks::find("pointmass/star", None).unwrap()).unwrap();
        let pd = PolicyConfig::new(PolicyName::Pd).build(&robot).unwrap();
        let config = RolloutConfig::default();
        let mut rollout = Rollout::new(&robot, pd, &command, Start::Pose, config).unwrap();
        rollout.run(&Cancel::default()).unwrap();
        let usual = Judge::default().score(&rollout).unwrap();
        let jam = Off { joint: 1, from: 10, to: 40 };
        let goals = rollout.goals();
        let error = |f: usize| (rollout.reached()[2 * f + 1] - goals.row(f)[1]).abs();
        let more = 4.0 * (10..40).map(error).sum::<f64>() / commanded(goals);
        let strict = Judge::strict(&rollout, &[jam], f64::INFINITY).score(&rollout).unwrap();
        assert!(more > 0.0 && (strict - usual - more).abs() < 1e-12, "{strict} {usual} {more}");
        // What would be worse than the first motions is no choice.
        assert_eq!(Judge::strict(&rollout, &[jam], 0.9 * usual).score(&rollout), None);
    }
}
