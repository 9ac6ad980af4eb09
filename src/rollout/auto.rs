//! `auto`: chooses the policy by simulation.
//!
//! Every contender performs the clip: the learned policies and proportional control, with and
//! without the guide. The best one is used. No learned policy is best everywhere (contact,
//! unreachable poses), and a rollout takes too little time to be noticed.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use serde::{Deserialize, Serialize};

use super::error::Error;
use super::gaps::GapFigures;
use super::policy::Policy;
use super::registry::{Guide, Inference, PolicyConfig, PolicyName};
use super::run::{Rollout, RolloutConfig, Start};
use super::shipped;
use robert_base::progress::{Cancel, Progress};
use robert_clip::Command;
use robert_net::Model;
use robert_robot::{PlantConfig, Robot};

/// Penalty of unnatural motion in a gap, as rad or m of error: for each rad or m of overshoot, and
/// for each 1 by which the path, relative to the straight line, exceeds [`LONGEST_PATH`].
const GAP_WEIGHT: f64 = 0.005;
/// The penalty for each 1 by which the jerk, relative to the minimum, exceeds [`MOST_JERK`].
const JERK_WEIGHT: f64 = 1e-4;
/// Limits of natural motion inside a gap: path relative to the straight line, and jerk relative to
/// the minimum.
const LONGEST_PATH: f64 = 1.3;
const MOST_JERK: f64 = 3.0;

/// The result of one contender.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Trial {
    /// The policy, as in [`PolicyConfig::label`].
    pub policy: String,
    /// Its Precision, rad or m; `None` when it failed, or when nothing was commanded.
    pub precision: Option<f64>,
    /// Penalty of its motion inside gaps, rad or m: for overshoot, long paths and jerk. 0 if the
    /// motion is within the limits.
    pub gaps: f64,
    /// Why it failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}

/// The contenders for one robot, built once and forked for every clip.
pub struct Contenders {
    robot: Arc<Robot>,
    list: Vec<(PolicyConfig, Mutex<Box<dyn Policy>>)>,
}

impl std::fmt::Debug for Contenders {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.list.iter().map(|(p, _)| p.label())).finish()
    }
}

/// A clip that all contenders performed, with the best rollout.
#[derive(Debug)]
pub struct Chosen {
    /// The best policy.
    pub policy: PolicyConfig,
    /// Its rollout on the nominal plant.
    pub rollout: Rollout,
    /// All of them, in the order in which they were tried.
    pub tried: Vec<Trial>,
}

impl Contenders {
    /// The contenders for the request `asked` (which has the name `auto`). Its model and guide
    /// apply to all of them; refinement applies to the chosen one.
    ///
    /// # Errors
    /// As [`PolicyConfig::build`].
    pub fn new(robot: &Arc<Robot>, asked: &PolicyConfig) -> Result<Contenders, Error> {
        let list = configs(robot, asked)?
            .into_iter()
            .map(|config| Ok((config.clone(), Mutex::new(config.build(robot)?))))
            .collect::<Result<_, Error>>()?;
        Ok(Contenders { robot: Arc::clone(robot), list })
    }

    /// Their number.
    pub fn count(&self) -> usize {
        self.list.len()
    }

    /// The policies, in the order in which they are tried.
    pub fn policies(&self) -> impl Iterator<Item = &PolicyConfig> {
        self.list.iter().map(|(config, _)| config)
    }

    /// Rolls out all contenders on the nominal plant, on `threads` threads, and chooses the best.
    /// The result does not depend on the number of threads.
    ///
    /// # Errors
    /// An error that keeps the first contender from starting (a clip for another robot),
    /// the error of the first one if all fail, and [`Error::Cancelled`].
    pub fn perform(
        &self,
        command: &Command,
        start: &Start,
        seed: u64,
        threads: usize,
        progress: &dyn Progress,
        cancel: &Cancel,
    ) -> Result<Chosen, Error> {
        let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let frames = self.list.len() as u64 * u64::from(command.frames().saturating_sub(1));
        let work = || {
            let mut mine = Vec::new();
            loop {
                let at = next.fetch_add(1, Ordering::Relaxed);
                let Some((config, _)) = self.list.get(at) else { return mine };
                let tick = || {
                    let n = done.fetch_add(1, Ordering::Relaxed) + 1;
                    progress.tick(n as u64, frames, &config.label());
                };
                mine.push((at, self.one(at, command, start, seed, &tick, cancel)));
            }
        };
        let mut all: Vec<_> = std::thread::scope(|scope| {
            let helpers: Vec<_> =
                (1..threads.min(self.list.len())).map(|_| scope.spawn(work)).collect();
            let mut all = work();
            for helper in helpers {
                let part = helper.join();
                all.extend(part.unwrap_or_else(|panic| std::panic::resume_unwind(panic)));
            }
            all
        });
        all.sort_by_key(|(at, _)| *at);
        if cancel.is_cancelled() {
            return Err(Error::Cancelled { frame: 0 });
        }
        self.nearest(all.into_iter().map(|(_, result)| result))
    }

    fn one(
        &self,
        at: usize,
        command: &Command,
        start: &Start,
        seed: u64,
        tick: &dyn Fn(),
        cancel: &Cancel,
    ) -> Result<Rollout, Error> {
        let (config, template) = &self.list[at];
        let fork = template.lock().unwrap_or_else(PoisonError::into_inner).fork();
        let policy = fork.map_or_else(|| config.build(&self.robot), Ok)?;
        let own = RolloutConfig { seed, guide: config.guide, plant: PlantConfig::default() };
        let mut rollout = Rollout::new(&self.robot, policy, command, start.clone(), own)?;
        while !cancel.is_cancelled() && rollout.step()?.is_some() {
            tick();
        }
        Ok(rollout)
    }

    fn nearest(&self, all: impl Iterator<Item = Result<Rollout, Error>>) -> Result<Chosen, Error> {
        let mut tried = Vec::with_capacity(self.list.len());
        let mut rollouts = Vec::with_capacity(self.list.len());
        let mut first_error = None;
        for ((config, _), result) in self.list.iter().zip(all) {
            let policy = config.label();
            match result {
                Ok(rollout) => {
                    let precision = rollout.precision().precision;
                    let gaps = unnatural(&rollout);
                    tried.push(Trial { policy, precision, gaps, error: None });
                    rollouts.push(Some(rollout));
                }
                Err(e) => {
                    let error = Some(e.to_string());
                    tried.push(Trial { policy, precision: None, gaps: 0.0, error });
                    first_error.get_or_insert(e);
                    rollouts.push(None);
                }
            }
        }
        let performed = rollouts.iter().position(Option::is_some);
        match (best(&tried).or(performed), first_error) {
            (Some(at), _) => match rollouts.swap_remove(at) {
                Some(rollout) => Ok(Chosen { policy: self.list[at].0.clone(), rollout, tried }),
                None => unreachable!("the best has been performed"),
            },
            (None, Some(e)) => Err(e),
            (None, None) => unreachable!("there is always a contender"),
        }
    }
}

/// The contender with the smallest sum of error and gap penalty; the first among equals.
pub(super) fn best(tried: &[Trial]) -> Option<usize> {
    let scored = tried.iter().enumerate().filter_map(|(at, t)| Some((at, t.precision? + t.gaps)));
    scored.min_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(at, _)| at)
}

pub(super) fn unnatural(rollout: &Rollout) -> f64 {
    let names: Vec<String> = rollout.robot().joints().iter().map(|j| j.name.clone()).collect();
    let gap = GapFigures::measure(rollout.goals(), rollout.states(), &names).unwrap_or_default();
    let swing = gap.overshoot.map_or(0.0, |o| o.value);
    let detour = gap.path.map_or(0.0, |p| (p - LONGEST_PATH).max(0.0));
    let jolts = gap.jerk.map_or(0.0, |j| (j - MOST_JERK).max(0.0));
    GAP_WEIGHT * (swing + detour) + JERK_WEIGHT * jolts
}

/// The list of contenders. With a model: the network alone, with the guide, and filling the gaps
/// itself; the linear prediction alone and with the guide; proportional control. Without a model:
/// policies that need no data.
pub(super) fn configs(robot: &Robot, asked: &PolicyConfig) -> Result<Vec<PolicyConfig>, Error> {
    let of = |name, guide| PolicyConfig { name, guide, refine: false, ..asked.clone() };
    let plain = |name| PolicyConfig { model_path: None, ..of(name, asked.guide) };
    let guides: &[Guide] = match asked.guide {
        Guide::None => &[Guide::None, Guide::Linear],
        Guide::Linear => &[Guide::Linear],
    };
    let mut list = Vec::new();
    if asked.model_path.is_some() || shipped::has_default(robot) {
        let model: Arc<Model> =
            PolicyConfig { name: PolicyName::Robert, ..asked.clone() }.model(robot)?;
        list.extend(guides.iter().map(|&g| of(PolicyName::Robert, g)));
        if asked.guide == Guide::None && model.card.reach.is_some() {
            let inference = Inference { masks: true, ..asked.inference };
            list.push(PolicyConfig { inference, ..of(PolicyName::Robert, Guide::None) });
        }
        if model.encoder.ridge.is_some() {
            let inference = Inference::default();
            let ridge = |g| PolicyConfig { inference, ..of(PolicyName::Ridge, g) };
            list.extend(guides.iter().map(|&g| ridge(g)));
        }
        list.push(PolicyConfig { inference: Inference::default(), ..plain(PolicyName::Pd) });
    } else {
        list.extend([PolicyName::ComputedTorque, PolicyName::Pd].map(plain));
    }
    Ok(list)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tasks;
    use robert_base::progress::Silent;
    use robert_clip::compile;

    fn trial(precision: f64, gaps: f64) -> Trial {
        Trial { policy: "x".into(), precision: Some(precision), gaps, error: None }
    }

    #[test]
    fn the_nearest_wins_unless_it_swings() {
        assert_eq!(best(&[trial(0.2, 0.0), trial(0.1, 0.01), trial(0.1, 0.02)]), Some(1));
        assert_eq!(best(&[trial(4e-4, 2e-3), trial(5e-4, 0.0), trial(5e-4, 0.0)]), Some(1));
        let failed = Trial { precision: None, ..trial(0.0, 0.0) };
        assert_eq!(best(&[failed.clone(), trial(0.1, 0.0)]), Some(1));
        assert_eq!(best(&[failed]), None);
    }

    #[test]
    fn the_choice_is_no_worse_than_any_and_the_same_on_any_number_of_threads() {
        let clip = tasks::find("pointmass/star", None).unwrap();
        let robot = Arc::new(Robot::builtin("pointmass").unwrap());
        let command = compile(&clip).unwrap();
        let asked = PolicyConfig::new(PolicyName::Auto);
        let contenders = Contenders::new(&robot, &asked).unwrap();
        let labels: Vec<String> = contenders.policies().map(PolicyConfig::label).collect();
        assert!(labels.contains(&"robert".to_owned()) && labels.contains(&"pd".to_owned()));
        let run = |threads| {
            let (start, cancel) = (Start::Pose, Cancel::default());
            contenders.perform(&command, &start, 0, threads, &Silent, &cancel).unwrap()
        };
        let (one, two) = (run(1), run(2));
        assert_eq!(one.rollout.actions(), two.rollout.actions());
        assert_eq!(one.tried, two.tried);
        let own = one.tried.iter().find(|t| t.policy == one.policy.label()).unwrap();
        assert_eq!(own.precision, one.rollout.precision().precision);
        let score = |t: &Trial| t.precision.unwrap() + t.gaps;
        assert!(one.tried.iter().all(|t| score(own) <= score(t)));
    }
}
