//! The suites of a sweep, and a model on them.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use super::Sweep;
use super::view::SPLIT_SEED;
use super::work::Work;
use crate::Error;
use robert_base::progress::Silent;
use robert_dataset::Dataset;
use robert_robot::{PlantRange, Robot};
use robert_rollout::{
    Case, ClipFacts as _, EvalConfig, PolicyConfig, PolicyName, Start, Suite, evaluate, tasks,
    test_suites,
};

/// The suites of a sweep; those called `test` are extracted from the held-out part of the data.
///
/// # Errors
/// [`Error::Evaluation`] for a suite that does not exist or cannot be extracted.
pub fn suites_of(sweep: &Sweep, robot: &Arc<Robot>, data: &Dataset) -> Result<Vec<Suite>, Error> {
    let fail = |why: String| Error::Evaluation { step: 0, why };
    let mut suites = Vec::new();
    for name in &sweep.suites {
        if name == "test" {
            let cut = test_suites(robot, data, sweep.cases.max(1), SPLIT_SEED);
            suites.extend(cut.map_err(|e| fail(e.to_string()))?);
            continue;
        }
        let clips = tasks::suite(robot.id(), name).map_err(|e| fail(e.to_string()))?;
        let mut cases = Vec::new();
        for (name, clip) in clips {
            let command = robot.compile(&clip).map_err(|e| fail(format!("{name}: {e}")))?;
            cases.push(Case { name, command, start: Start::Pose, truth: None, floor: None });
        }
        suites.push(Suite { name: name.clone(), cases });
    }
    Ok(suites)
}

/// A model on all suites.
pub(super) fn perform_suites(
    robot: &Arc<Robot>,
    model: PathBuf,
    suites: &[Suite],
    work: &Work<'_>,
) -> Result<BTreeMap<String, Option<f64>>, Error> {
    let model_path = Some(model);
    let config = EvalConfig {
        policies: vec![PolicyConfig { model_path, ..PolicyConfig::new(PolicyName::Robert) }],
        plant: PlantRange::default(),
        seeds: 0..1,
        threads: work.threads,
    };
    let results = evaluate(robot, suites, &config, &Silent, work.cancel)
        .map_err(|e| Error::Evaluation { step: 0, why: e.to_string() })?;
    Ok(results.into_iter().map(|r| (r.suite, r.precision_mean)).collect())
}
