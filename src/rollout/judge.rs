//! What decides between two motions of a clip.
//!
//! Usually the smaller sum of Precision and the penalty for unnatural motion in gaps and a missed frame. The likely
//! motion in dropouts counts as goals do, and the length of a tendon that moves several joints counts as well
//! ([`super::ties`]). A finger that stays behind another one for a second adds little to the mean over all joints
//! and frames, but a person sees it at once. A strict judge gives the errors of joints that jam more weight, as
//! long as the usual sum stays nearly as small. A gentle judge gives jerk in gaps more weight in the same way.

use std::ops::Range;
use std::sync::Arc;

use super::goals::Goals;
use super::jam::Off;
use super::natural;
use super::run::Rollout;

/// Weight that a strict judge gives to the errors of joints that jam: a joint that comes free may cost
/// the others four fifths of what it gains.
const JAM_WEIGHT: f64 = 5.0;
/// Under a strict judge the usual sum may grow by this share, which is too little to see.
const TOLERATED_LOSS: f64 = 0.03;

/// The factor of the penalty for jerk that a gentle judge counts: a mean jerk of 4 in place of 3 may cost .004 rad.
pub(super) const GENTLY: f64 = 8.0;
/// Under a gentle judge the usual sum may grow by this share.
const GENTLE_LOSS: f64 = 0.03;

/// Compares motions; the smaller the score the better.
#[derive(Clone, Debug)]
pub(super) struct Judge {
    /// Weights of the errors, (frames, S); `None` if all are 1.
    weights: Option<Arc<[f64]>>,
    /// The largest Precision that a motion may have, rad or m.
    farthest: f64,
    /// The largest usual sum that a motion may have, rad or m.
    most: f64,
    /// The factor by which the usual sum may grow.
    growth: f64,
    /// The factor of the penalty for jerk.
    jolts: f64,
}

impl Default for Judge {
    /// The usual judge.
    fn default() -> Judge {
        let any = f64::INFINITY;
        Judge { weights: None, farthest: any, most: any, growth: any, jolts: 1.0 }
    }
}

impl Judge {
    /// The same judge, who refuses motions with a larger Precision than `farthest`, rad or m.
    pub(super) fn no_farther_than(self, farthest: f64) -> Judge {
        Judge { farthest, ..self }
    }

    /// A strict judge of motions that should lose the jams of `best`. Their usual sum stays below
    /// `most`.
    pub(super) fn strict(&self, best: &Rollout, jams: &[Off], most: f64) -> Judge {
        let (goals, d) = (best.sought(), best.goals().dim());
        let mut weights = vec![1.0; goals.frames() * d];
        for jam in jams {
            (jam.from..jam.to).for_each(|f| weights[f * d + jam.joint] = JAM_WEIGHT);
        }
        let usual = Judge { weights: None, most: f64::INFINITY, ..self.clone() };
        let least = usual.score(best).unwrap_or(f64::INFINITY);
        let most = most.min((1.0 + TOLERATED_LOSS) * least);
        Judge { weights: Some(weights.into()), most, growth: most / least, ..usual }
    }

    /// A gentle judge of motions that should lose the jolts in the gaps of one with the usual sum `least`. Their
    /// usual sum stays below `most`.
    pub(super) fn gentle(&self, least: f64, most: f64) -> Judge {
        let most = self.most.min(most).min((1.0 + GENTLE_LOSS) * least);
        Judge { most, jolts: GENTLY, ..self.clone() }
    }

    /// The usual sum of a motion, rad or m, however large it is. `None` if nothing was commanded.
    pub(super) fn usual(&self, motion: &Rollout) -> Option<f64> {
        Judge { weights: None, jolts: 1.0, ..self.clone() }.measure(motion)
    }

    /// The score of a motion, however large it is. `None` if nothing was commanded.
    pub(super) fn measure(&self, motion: &Rollout) -> Option<f64> {
        let any = f64::INFINITY;
        Judge { farthest: any, most: any, ..self.clone() }.score(motion)
    }

    /// The penalty that counts for a motion with the one `other` and that for jerk, rad or m.
    pub(super) fn penalty(&self, (other, jolts): (f64, f64)) -> f64 {
        natural::counted(other + jolts) + (self.jolts - 1.0) * jolts
    }

    /// By how much the mean error may grow beyond that of a motion with this score, at most, rad or m.
    pub(super) fn patience(&self, score: f64) -> f64 {
        GENTLE_LOSS * self.most.min(score)
    }

    /// The limit for [`Judge::score_part`] of a motion that comes after `motion`.
    pub(super) fn limit(&self, motion: &Rollout, part: &Range<usize>) -> f64 {
        if self.weights.is_none() {
            return f64::INFINITY;
        }
        let usual = Judge { weights: None, ..self.clone() };
        self.growth * usual.sum(motion, part)
    }

    /// As [`Judge::score`], but of the frames of a part; the gaps are those up to its end. `None` if
    /// the usual sum is not below `limit`.
    pub(super) fn score_part(
        &self,
        motion: &Rollout,
        part: &Range<usize>,
        limit: f64,
    ) -> Option<f64> {
        let own = self.sum(motion, part);
        let usual = match self.weights {
            None => own,
            Some(_) => Judge { weights: None, ..self.clone() }.sum(motion, part),
        };
        (usual < limit).then_some(own)
    }

    /// The mean weighted error of the goals of a part, and the penalty up to its end, rad or m.
    fn sum(&self, motion: &Rollout, part: &Range<usize>) -> f64 {
        let penalty = natural::counted(natural::unnatural_until(motion, part.end));
        self.mean(motion, part) + penalty
    }

    /// The mean weighted error over the goals of these frames, with that of tied joints together.
    fn mean(&self, motion: &Rollout, frames: &Range<usize>) -> f64 {
        let (goals, reached) = (motion.sought(), motion.reached());
        let errors: f64 = frames.clone().map(|f| self.error_at(goals, reached, f)).sum();
        errors / goals.commanded(frames).max(1.0)
    }

    /// The mean weighted error and the penalty for unnatural motion in gaps, rad or m. `None`
    /// if nothing was commanded, or if Precision or the usual sum is too large.
    pub(super) fn score(&self, rollout: &Rollout) -> Option<f64> {
        let errors = rollout.errors()?;
        let penalties = natural::apart(rollout);
        let penalty = natural::counted(penalties.0 + penalties.1);
        let weighted = match self.weights {
            None => errors.judged,
            Some(_) => self.mean(rollout, &(1..rollout.sought().frames())),
        };
        (errors.precision <= self.farthest && errors.judged + penalty < self.most)
            .then_some(weighted + self.penalty(penalties))
    }

    /// The weight of a joint's error at a frame.
    pub(super) fn weight(&self, goals: &Goals, frame: usize, joint: usize) -> f64 {
        self.weights.as_ref().map_or(1.0, |w| w[frame * goals.dim() + joint])
    }

    /// The weighted sum of the errors of a frame, with that of tied joints together ([`Goals::tied_error`]);
    /// `reached` is (frames, S).
    pub(super) fn error_at(&self, goals: &Goals, reached: &[f64], f: usize) -> f64 {
        let d = goals.dim();
        let error = |j: usize| reached[f * d + j] - goals.row(f)[j];
        let seen = (0..d).filter(|&j| goals.is_visible(f, j));
        let each: f64 = seen.map(|j| self.weight(goals, f, j) * error(j).abs()).sum();
        each + goals.tied_error(reached, f)
    }
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
        let more = 4.0 * (10..40).map(error).sum::<f64>() / goals.commanded(&(1..goals.frames()));
        let judge = Judge::default();
        let strict = judge.strict(&rollout, &[jam], f64::INFINITY).score(&rollout).unwrap();
        assert!(more > 0.0 && (strict - usual - more).abs() < 1e-12, "{strict} {usual} {more}");
        // What would be worse than the first motions is no choice.
        assert_eq!(judge.strict(&rollout, &[jam], 0.9 * usual).score(&rollout), None);
        let precision = rollout.precision().precision.unwrap();
        assert!(judge.clone().no_farther_than(precision).score(&rollout).is_some());
        assert_eq!(judge.no_farther_than(0.99 * precision).score(&rollout), None);
    }
}
