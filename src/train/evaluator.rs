//! Selects checkpoints by rollouts of keyframe tasks: shipped ones, or as in the paper also tasks
//! that are extracted from held-out motion.
//!
//! The action loss is misleading: with hidden frames, networks with a lower loss were many times
//! worse in control. So the best checkpoint is the one with the best closed-loop Precision.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use super::{Evaluate, Evaluation, Select, TrainConfig};
use robert_base::progress::Cancel;
use robert_clip::{self as clip, Command};
use robert_dataset::Dataset;
use robert_linalg::{next_of, on_threads};
use robert_net::Model;
use robert_net::forward::Forwards;
use robert_robot::Robot;
use robert_rollout::{
    ClipFacts as _, Guide, Inference, Linear, Policy, Rollout, RolloutConfig, Start,
    extracted_cases, tasks, test_suites,
};

/// Suites that count for the selection; the others are for the report.
const SUITES: [&str; 2] = ["manual", "extra"];
/// Seeds of the trial clips of a robot without tasks. An arm may be calm on the clips of one seed and oscillate on those
/// of another.
const TRIAL_SEEDS: [u64; 3] = [0, 4, 5];
/// Error of a rollout that diverged, rad or m.
const BROKEN: f64 = 10.0;

/// Evaluates on tasks.
pub struct SuiteEvaluator {
    robot: Arc<Robot>,
    cases: Vec<Case>,
    select: Select,
    guide: Guide,
    inference: Inference,
    threads: usize,
    /// The card that computes the networks, and the rollouts at once that keep it busy.
    device: Option<(Arc<dyn Forwards + Send>, usize)>,
}

#[derive(Debug)]
struct Case {
    suite: String,
    name: String,
    command: Command,
    start: Start,
}

impl Case {
    fn new(robot: &Robot, suite: &str, name: &str, clip: &clip::Clip) -> Result<Case, String> {
        let command = robot.compile(clip).map_err(|e| format!("{name}: {e}"))?;
        let (suite, name) = (suite.to_owned(), name.to_owned());
        Ok(Case { suite, name, command, start: Start::Pose })
    }
}

impl std::fmt::Debug for SuiteEvaluator {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "SuiteEvaluator({}, {} tasks)", self.robot.id(), self.cases.len())
    }
}

impl SuiteEvaluator {
    /// The tasks shipped for this robot, else trial clips generated from its profile.
    ///
    /// # Errors
    /// A message, when a shipped task is damaged.
    pub fn new(robot: Arc<Robot>, threads: usize) -> Result<Option<Self>, String> {
        let mut cases = Vec::new();
        for suite in SUITES {
            let clips = match tasks::suite(robot.id(), suite) {
                Ok(clips) => clips,
                Err(tasks::TaskError::NoTasks { .. }) => break,
                Err(e) => return Err(e.to_string()),
            };
            for (name, clip) in clips {
                cases.push(Case::new(&robot, suite, &name, &clip)?);
            }
        }
        if cases.is_empty() {
            // A robot without its own tasks is evaluated on trial clips.
            for seed in TRIAL_SEEDS {
                for task in tasks::trial(&robot, seed).map_err(|e| e.to_string())? {
                    let name = format!("{}_{seed}", task.name);
                    cases.push(Case::new(&robot, task.suite, &name, &task.clip)?);
                }
            }
        }
        let select = Select::Tasks;
        Ok((!cases.is_empty()).then_some(SuiteEvaluator {
            robot,
            cases,
            select,
            guide: Guide::None,
            inference: Inference::default(),
            threads,
            device: None,
        }))
    }

    /// Lets a card compute the networks of this many rollouts at once.
    #[must_use]
    pub fn on(mut self, device: Arc<dyn Forwards + Send>, at_once: usize) -> Self {
        self.device = Some((device, at_once));
        self
    }

    /// The tasks that a run selects by, and how the network performs them: with [`Select::Extracted`]
    /// the suite `manual`, or else the trial clips, and tasks extracted from the held-out part of
    /// `data`, drawn by the seed of the run.
    ///
    /// # Errors
    /// A message, when the data have no held-out trajectory that is long enough.
    pub fn selecting(mut self, cfg: &TrainConfig, data: &Dataset) -> Result<Self, String> {
        cfg.check().map_err(|e| e.to_string())?;
        self.select = cfg.select;
        if let Some(policy) = cfg.selecting_policy() {
            (self.guide, self.inference) = (policy.guide, policy.inference);
        }
        if cfg.select == Select::Extracted {
            self.cases.retain(|c| c.suite != "extra");
            let count = extracted_cases(self.robot.id());
            let suites = test_suites(&self.robot, data, count, cfg.seed).map_err(|e| {
                format!("select=extracted: {e}; or choose by shipped tasks: --set select=tasks")
            })?;
            for suite in suites {
                self.cases.extend(suite.cases.into_iter().map(|case| Case {
                    suite: suite.name.clone(),
                    name: case.name,
                    command: case.command,
                    start: case.start,
                }));
            }
        }
        Ok(self)
    }
}

impl Evaluate for SuiteEvaluator {
    fn evaluate(&mut self, model: &Model, cancel: &Cancel) -> Result<Option<Evaluation>, String> {
        let mut policy = self.inference.network(model.clone()).map_err(|e| e.to_string())?;
        let mut threads = self.threads;
        if let Some((device, at_once)) = &self.device {
            policy.on(&**device);
            if policy.is_on_device() {
                threads = threads.max(*at_once);
            }
        }
        self.all(policy, threads, cancel)
    }

    fn evaluate_linear(
        &mut self,
        model: &Model,
        cancel: &Cancel,
    ) -> Result<Option<Evaluation>, String> {
        if self.inference != Inference::default() {
            // An untrained network gives the linear prediction, and it can be used in the same way.
            return self.evaluate(model, cancel);
        }
        let policy = Linear::new(model.encoder.clone()).map_err(|e| e.to_string())?;
        self.all(policy.with_card(&model.card), self.threads, cancel)
    }
}

impl SuiteEvaluator {
    /// Evaluates all tasks; `None` if a stop was requested meanwhile.
    fn all<P: Policy + Clone + 'static>(
        &self,
        policy: P,
        threads: usize,
        cancel: &Cancel,
    ) -> Result<Option<Evaluation>, String> {
        let policy = Mutex::new(policy);
        let mut found: Vec<Result<f64, String>> = vec![Ok(BROKEN); self.cases.len()];
        let queue = Mutex::new(self.cases.iter().zip(&mut found));
        on_threads(threads.min(self.cases.len()), |_| {
            while let Some((case, to)) = next_of(&queue) {
                let policy = policy.lock().unwrap_or_else(PoisonError::into_inner).clone();
                *to = self.one(policy, case, cancel);
            }
        });
        drop(queue.into_inner().unwrap_or_else(PoisonError::into_inner));
        if cancel.is_cancelled() {
            return Ok(None);
        }
        let mut suites: BTreeMap<String, Vec<f64>> = BTreeMap::new();
        let mut all = BTreeMap::new();
        for (case, result) in self.cases.iter().zip(found) {
            let precision = result?;
            suites.entry(case.suite.clone()).or_default().push(precision);
            all.insert(format!("{}/{}", case.suite, case.name), precision);
        }
        let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len().max(1) as f64;
        let parts: Vec<f64> = match self.select {
            Select::Tasks => suites.values().map(|x| mean(x)).collect(),
            Select::Extracted => suites.values().flatten().copied().collect(),
        };
        all.extend(suites.iter().map(|(name, x)| (name.clone(), mean(x))));
        Ok(Some(Evaluation { precision: mean(&parts), suites: all }))
    }

    /// Precision of one task; meaningless after a stop.
    fn one<P: Policy + 'static>(
        &self,
        policy: P,
        case: &Case,
        cancel: &Cancel,
    ) -> Result<f64, String> {
        let text = |e: robert_rollout::Error| format!("{}: {e}", case.name);
        let start = case.start.clone();
        let config = RolloutConfig { guide: self.guide, ..RolloutConfig::default() };
        let mut rollout = Rollout::new(&self.robot, Box::new(policy), &case.command, start, config)
            .map_err(text)?;
        while !rollout.is_done() && !cancel.is_cancelled() {
            // A simulation that diverges under this policy is a result, not an error of the run.
            if rollout.step().is_err() {
                return Ok(BROKEN);
            }
        }
        Ok(rollout.precision().precision.unwrap_or(BROKEN).min(BROKEN))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::untrained;

    #[test]
    fn an_untrained_network_does_as_well_as_its_linear_prediction() {
        let dir = tempfile::tempdir().unwrap();
        let (robot, _, model) = untrained("pointmass", 0, dir.path());
        let cancel = Cancel::default();
        let mut evaluator = SuiteEvaluator::new(robot, 2).unwrap().unwrap();
        let linear = evaluator.evaluate_linear(&model, &cancel).unwrap().unwrap();
        assert!(linear.precision < BROKEN && linear.suites.len() > 2, "{linear:?}");
        let network = evaluator.evaluate(&model, &cancel).unwrap().unwrap();
        assert!((network.precision - linear.precision).abs() < 1e-6, "{network:?} {linear:?}");
        cancel.cancel();
        assert_eq!(evaluator.evaluate(&model, &cancel), Ok(None));
    }

    #[test]
    fn the_papers_selection_merges_manual_and_extracted_tasks() {
        let dir = tempfile::tempdir().unwrap();
        let (robot, data, model) = untrained("pointmass", 0, dir.path());
        let evaluator = SuiteEvaluator::new(robot, 2).unwrap().unwrap();
        let mut evaluator = evaluator
            .selecting(&TrainConfig { select: Select::Extracted, ..TrainConfig::default() }, &data)
            .unwrap();
        let found = evaluator.evaluate(&model, &Cancel::default()).unwrap().unwrap();
        let tasks: Vec<f64> =
            found.suites.iter().filter(|(k, _)| k.contains('/')).map(|(_, x)| *x).collect();
        // Fifteen shapes, and three times six extracted tasks.
        assert_eq!(tasks.len(), 33, "{:?}", found.suites.keys());
        let mean = tasks.iter().sum::<f64>() / 33.0;
        assert!((found.precision - mean).abs() < 1e-12, "{} {mean}", found.precision);
    }

    #[test]
    fn tasks_are_performed_with_the_options_that_a_run_selects_with() {
        let dir = tempfile::tempdir().unwrap();
        let (robot, data, model) = untrained("pointmass", 0, dir.path());
        let [bare, guided, ahead] = ["", "+smooth", "+ahead=1"].map(|options| {
            let cfg = TrainConfig { select_with: options.to_owned(), ..TrainConfig::default() };
            let evaluator = SuiteEvaluator::new(Arc::clone(&robot), 2).unwrap().unwrap();
            let mut evaluator = evaluator.selecting(&cfg, &data).unwrap();
            evaluator.evaluate(&model, &Cancel::default()).unwrap().unwrap().suites
        });
        // Only sparse goals have gaps.
        assert_eq!(bare["manual"].to_bits(), guided["manual"].to_bits());
        assert_ne!(bare["extra"].to_bits(), guided["extra"].to_bits());
        assert_ne!(bare["manual"].to_bits(), ahead["manual"].to_bits());
        let cfg = TrainConfig { select_with: "+refine".to_owned(), ..TrainConfig::default() };
        let evaluator = SuiteEvaluator::new(robot, 2).unwrap().unwrap();
        assert!(evaluator.selecting(&cfg, &data).unwrap_err().contains("select_with"));
    }
}
