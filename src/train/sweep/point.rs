//! One point of a sweep.

use std::path::Path;
use std::sync::Arc;

use super::Sweep;
use super::reached::Reached;
use super::suites::perform_suites;
use super::value::Combination;
use super::work::Work;
use crate::evaluator::SuiteEvaluator;
use crate::hindsight::Simulated;
use crate::options::{Evaluate, Options};
use crate::run::train;
use crate::{Error, paths};
use robert_base::progress::Silent;
use robert_dataset::Dataset;
use robert_robot::Robot;
use robert_rollout::Suite;

/// One point of a sweep: what is trained, on which data, and what the model then performs.
#[derive(Clone, Copy, Debug)]
pub struct Point<'a> {
    /// The sweep.
    pub sweep: &'a Sweep,
    /// Its robot.
    pub robot: &'a Arc<Robot>,
    /// The values of this point.
    pub values: &'a Combination,
    /// Its seed.
    pub seed: u64,
    /// Its view of the data; see [`view`](super::view()).
    pub data: &'a Dataset,
    /// The suites that the model performs; see [`suites_of`](super::suites_of).
    pub suites: &'a [Suite],
    /// Its run directory.
    pub dir: &'a Path,
}

impl Point<'_> {
    /// Trains, or continues, and evaluates; `None` if a stop was requested.
    ///
    /// # Errors
    /// Those of training and of the evaluation.
    pub fn reach(&self, work: &Work<'_>) -> Result<Option<Reached>, Error> {
        let Point { sweep, robot, values, seed, data, suites, dir } = *self;
        let evaluations = sweep.evaluations;
        let cfg = sweep.config(values, seed)?;
        let mut perform = Simulated { robot: Arc::clone(robot), threads: work.threads };
        let mut evaluator = None;
        if evaluations > 0 {
            evaluator = SuiteEvaluator::new(Arc::clone(robot), work.threads)
                .and_then(|e| e.map(|e| e.selecting(&cfg, data)).transpose())
                .map_err(|why| Error::Evaluation { step: 0, why })?;
        }
        let options = Options {
            dir: dir.to_owned(),
            threads: work.threads,
            checkpoint_secs: work.checkpoint_secs,
            evaluations: if evaluations > 0 { evaluations } else { 4 },
            patience: 0,
            progress: &Silent,
            cancel: work.cancel,
            evaluator: evaluator.as_mut().map(|e| e as &mut dyn Evaluate),
            perform: Some(&mut perform),
            engines: work.engines,
            linear: None,
            meta: work.meta.clone(),
        };
        let done = match train(data, &cfg, options) {
            // Stopped in a fit, before the first checkpoint.
            Err(_) if work.cancel.is_cancelled() => return Ok(None),
            done => done?,
        };
        if done.interrupted || work.cancel.is_cancelled() {
            return Ok(None);
        }
        let model = if evaluations > 0 { paths::best(dir) } else { paths::model(dir) };
        let suites = match perform_suites(robot, model, suites, work) {
            // Interrupted; the next call evaluates the point.
            Err(_) if work.cancel.is_cancelled() => return Ok(None),
            found => found?,
        };
        Ok(Some(Reached {
            values: values.clone(),
            seed,
            dataset_sha256: data.manifest().sha256(),
            windows: cfg.steps * cfg.batch as u64,
            evaluations,
            suites,
            nmse_clear: done.held_out.and_then(|h| h.nmse_clear),
            secs: Some(done.secs),
        }))
    }
}
