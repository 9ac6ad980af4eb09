//! What one policy achieved on a clip, and which of several is best.

use serde::{Deserialize, Serialize};

use super::error::Error;
use super::natural::{counted, unnatural};
use super::policy_config::PolicyConfig;
use super::run::Rollout;

/// The share by which the Precision of the chosen motion may be worse than that of proportional control.
const FARTHER: f64 = 0.03;

/// The number of contenders that repeat the clip.
const RACERS: usize = 3;

/// The result of one contender.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Trial {
    /// The policy, as in [`PolicyConfig::label`].
    pub policy: String,
    /// Its Precision, rad or m; `None` when it failed, or when nothing was commanded.
    pub precision: Option<f64>,
    /// In clips with dropouts, the mean error over goals and the likely motion in dropouts, rad or m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub with_dropouts: Option<f64>,
    /// What decides beside the penalty, rad or m: the error with dropouts if there are any, else Precision, and
    /// that of joints that one actuator moves together.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) judged: Option<f64>,
    /// Penalty of its motion, rad or m: for overshoot, long paths and jerk in gaps, for a missed frame and
    /// for motion within holds. 0 if the motion is within the limits.
    pub gaps: f64,
    /// Why it failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}

impl Trial {
    /// A policy that has performed the clip.
    pub(super) fn of(policy: &PolicyConfig, rollout: &Rollout) -> Trial {
        let errors = rollout.errors();
        Trial {
            policy: policy.label(),
            precision: errors.map(|e| e.precision),
            with_dropouts: errors.and_then(|e| e.with_dropouts),
            judged: errors.map(|e| e.judged),
            gaps: counted(unnatural(rollout)),
            error: None,
        }
    }

    /// A policy that could not perform it.
    pub(super) fn failed(policy: &PolicyConfig, error: Option<&Error>) -> Trial {
        let error = error.map(ToString::to_string);
        let policy = policy.label();
        Trial { policy, precision: None, with_dropouts: None, judged: None, gaps: 0.0, error }
    }

    /// What decides: the smaller the better.
    fn score(&self) -> Option<f64> {
        Some(self.judged? + self.gaps)
    }

    /// The score of a motion whose Precision is not above `limit`.
    fn score_below(&self, limit: f64) -> Option<f64> {
        self.score().filter(|_| self.precision.is_some_and(|p| p <= limit))
    }
}

/// The contender with the smallest sum of error and penalty among the [`near`] ones; the first among
/// equals.
pub(super) fn best(tried: &[Trial]) -> Option<usize> {
    let limit = near(tried);
    let scored = tried.iter().enumerate().filter_map(|(at, t)| Some((at, t.score_below(limit)?)));
    scored.min_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(at, _)| at)
}

/// Whether a policy is better than all that were tried.
pub(super) fn leads(tried: &[Trial], trial: &Trial) -> bool {
    trial.score_below(near(tried)).is_some_and(|s| s < least(tried))
}

/// The smallest sum of error and gap penalty among the [`near`] ones, rad or m.
pub(super) fn least(tried: &[Trial]) -> f64 {
    let limit = near(tried);
    tried.iter().filter_map(|t| t.score_below(limit)).fold(f64::INFINITY, f64::min)
}

/// The largest Precision that may be chosen, rad or m. A motion that is farther from its goals than
/// proportional control is no choice, however natural it is in its gaps.
pub(super) fn near(tried: &[Trial]) -> f64 {
    let pd = tried.iter().find(|t| t.policy == "pd" || t.policy.starts_with("pd+"));
    let precision = pd.and_then(|t| t.precision).filter(|p| p.is_finite());
    precision.map_or(f64::INFINITY, |p| (1.0 + FARTHER) * p)
}

/// The contenders that repeat the clip, best first; those that are no choice as they are come last.
pub(super) fn leaders(tried: &[Trial]) -> impl Iterator<Item = usize> {
    let limit = near(tried);
    let mut scored: Vec<_> = (tried.iter().enumerate())
        .filter_map(|(at, t)| Some((t.score_below(limit).is_none(), t.score()?, at)))
        .collect();
    scored.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    scored.into_iter().map(|(.., at)| at).take(RACERS)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trial(precision: f64, gaps: f64) -> Trial {
        Trial {
            policy: "x".into(),
            precision: Some(precision),
            with_dropouts: None,
            judged: Some(precision),
            gaps,
            error: None,
        }
    }

    #[test]
    fn the_nearest_wins_unless_it_swings() {
        assert_eq!(best(&[trial(0.2, 0.0), trial(0.1, 0.01), trial(0.1, 0.02)]), Some(1));
        assert_eq!(best(&[trial(4e-4, 2e-3), trial(5e-4, 0.0), trial(5e-4, 0.0)]), Some(1));
        // Where all shake, the distance to the goals decides.
        let wild = |precision, gaps| trial(precision, counted(gaps));
        assert_eq!(best(&[wild(0.35, 0.15), wild(0.15, 0.9), wild(0.2, 5.0)]), Some(1));
        // A tendon that is far from its length outweighs a smaller Precision.
        let bent = Trial { judged: Some(0.12), ..trial(0.1, 0.0) };
        assert_eq!(best(&[bent, trial(0.11, 0.0)]), Some(1));
        let failed = Trial { precision: None, judged: None, ..trial(0.0, 0.0) };
        assert_eq!(best(&[failed.clone(), trial(0.1, 0.0)]), Some(1));
        assert_eq!(best(&[failed]), None);
    }

    #[test]
    fn contenders_that_are_too_far_away_repeat_the_clip_last() {
        let pd = Trial { policy: "pd".into(), ..trial(0.05, 0.1) };
        let tried = [trial(0.07, 0.02), pd, trial(0.08, 0.0), trial(0.049, 0.07)];
        assert_eq!(leaders(&tried).collect::<Vec<_>>(), [3, 1, 2]);
    }

    #[test]
    fn a_motion_that_is_farther_than_proportional_control_is_no_choice() {
        let pd = Trial { policy: "pd".into(), ..trial(1e-4, 5e-3) };
        // Natural in its gaps, but it leaves goals that proportional control meets.
        let smooth = trial(4e-4, 0.0);
        let tried = [trial(1e-6, 2e-3), pd, smooth.clone()];
        assert_eq!(best(&tried), Some(0));
        assert!(!leads(&tried[..2], &smooth));
        assert!(leads(&tried, &trial(1.02e-4, 0.0)));
        assert_eq!(best(&tried[2..]), Some(0), "it may be all that there is");
    }
}
