//! Many clips, many policies, all cores: the table that claims stand on.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use serde::Serialize;

use super::error::Error;
use super::plant::PlantConfig;
use super::precision::Precision;
use super::registry::PolicyConfig;
use super::run::{Rollout, RolloutConfig, Start};
use super::stats::mean_ci95;
use crate::clip::Command;
use crate::progress::{Cancel, Progress};
use crate::robot::Robot;

/// One task of a suite.
#[derive(Clone, Debug)]
pub struct Case {
    /// Its name.
    pub name: String,
    /// What is commanded.
    pub command: Command,
    /// Where it begins.
    pub start: Start,
}

/// What to evaluate.
#[derive(Clone, Debug)]
pub struct EvalConfig {
    /// Name of the suite, for the result.
    pub suite: String,
    /// The policies.
    pub policies: Vec<PolicyConfig>,
    /// The plant.
    pub plant: PlantConfig,
    /// Seeds 0..n.
    pub seeds: u64,
    /// Worker threads.
    pub threads: usize,
}

/// One task under one policy, the mean over seeds.
#[derive(Clone, Debug, Serialize)]
pub struct CaseResult {
    /// Task.
    pub name: String,
    /// Precision, rad or m; `None` when the rollout failed or nothing was commanded.
    pub precision: Option<f64>,
    /// Half width of the 95 % interval over seeds.
    pub ci95: Option<f64>,
    /// Error on masked frames.
    pub masked_mae: Option<f64>,
    /// 95th percentile of the error.
    pub p95: Option<f64>,
    /// Error in the last frame of each hold.
    pub hold_end: Option<f64>,
    /// Frames until a hold is reached.
    pub frames_late: Option<f64>,
    /// Mean change of action a frame.
    pub mean_abs_du: f64,
    /// Wall time of one rollout, seconds.
    pub wall_secs: f64,
    /// Control steps of one rollout.
    pub frames: usize,
    /// Why it failed, where it did.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// Mean error by frame of the first seed.
    #[serde(skip)]
    pub per_frame: Vec<Option<f64>>,
}

/// One policy over a suite.
#[derive(Clone, Debug, Serialize)]
pub struct Evaluation {
    /// Policy.
    pub policy: String,
    /// Whether it used a model of the robot.
    pub uses_model: bool,
    /// Suite.
    pub suite: String,
    /// Plant, where it is not nominal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plant: Option<String>,
    /// Mean Precision over tasks; `None` when any task failed.
    pub precision_mean: Option<f64>,
    /// Half width of its 95 % interval over seeds.
    pub ci95: Option<f64>,
    /// One row a task.
    pub tasks: Vec<CaseResult>,
}

/// Rolls every case out under every policy and seed, on all cores.
///
/// # Errors
/// The first error that is the user's to mend (a policy that cannot be built, a clip for
/// another robot). A rollout that diverges is a result, with its reason in the row.
pub fn evaluate(
    robot: &Arc<Robot>,
    cases: &[Case],
    config: &EvalConfig,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<Vec<Evaluation>, Error> {
    let uses_model = config
        .policies
        .iter()
        .map(|p| p.build(robot).map(|built| built.uses_model()))
        .collect::<Result<Vec<_>, _>>()?;
    let seeds = config.seeds.max(1) as usize;
    let jobs = config.policies.len() * cases.len() * seeds;
    let next = AtomicUsize::new(0);
    let done = AtomicUsize::new(0);
    let work = || -> Result<Vec<(usize, Outcome)>, Error> {
        let mut mine = Vec::new();
        loop {
            let job = next.fetch_add(1, Ordering::Relaxed);
            if job >= jobs {
                return Ok(mine);
            }
            if cancel.is_cancelled() {
                return Err(Error::Cancelled { frame: 0 });
            }
            let (policy, rest) = (job / (cases.len() * seeds), job % (cases.len() * seeds));
            let (case, seed) = (rest / seeds, (rest % seeds) as u64);
            mine.push((
                job,
                one(robot, &config.policies[policy], &cases[case], seed, config.plant, cancel)?,
            ));
            let n = done.fetch_add(1, Ordering::Relaxed) + 1;
            progress.tick(n as u64, jobs as u64, &cases[case].name);
        }
    };
    let threads = config.threads.clamp(1, jobs.max(1));
    let mut outcomes: Vec<Option<Outcome>> = vec![None; jobs];
    let finished = std::thread::scope(|scope| {
        let handles: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        handles.into_iter().map(|h| h.join().unwrap_or(Ok(Vec::new()))).collect::<Vec<_>>()
    });
    for part in finished {
        for (job, outcome) in part? {
            outcomes[job] = Some(outcome);
        }
    }
    let mut results = Vec::new();
    for (p, policy) in config.policies.iter().enumerate() {
        let at = |case: usize| {
            let begin = (p * cases.len() + case) * seeds;
            outcomes[begin..begin + seeds].iter().flatten().collect::<Vec<_>>()
        };
        let tasks: Vec<CaseResult> =
            cases.iter().enumerate().map(|(c, case)| summarise(case, &at(c))).collect();
        // The interval is over seeds: each seed gives one mean over tasks.
        let by_seed: Vec<f64> = (0..seeds)
            .filter_map(|s| {
                let all: Option<Vec<f64>> = (0..cases.len())
                    .map(|c| at(c).get(s).and_then(|o| o.precision.as_ref()?.precision))
                    .collect();
                let all = all?;
                (!all.is_empty()).then(|| all.iter().sum::<f64>() / all.len() as f64)
            })
            .collect();
        let interval = if by_seed.len() == seeds { mean_ci95(&by_seed) } else { None };
        results.push(Evaluation {
            policy: policy.label(),
            uses_model: uses_model[p],
            suite: config.suite.clone(),
            plant: (!config.plant.is_nominal()).then(|| config.plant.to_string()),
            precision_mean: interval.map(|i| i.mean),
            ci95: interval.and_then(|i| i.ci95),
            tasks,
        });
    }
    Ok(results)
}

#[derive(Clone, Debug)]
struct Outcome {
    precision: Option<Precision>,
    error: Option<String>,
    wall_secs: f64,
    frames: usize,
}

fn one(
    robot: &Arc<Robot>,
    policy: &PolicyConfig,
    case: &Case,
    seed: u64,
    plant: PlantConfig,
    cancel: &Cancel,
) -> Result<Outcome, Error> {
    let config = RolloutConfig { seed, guide: policy.guide, plant };
    let mut rollout =
        Rollout::new(robot, policy.build(robot)?, &case.command, case.start.clone(), config)?;
    let begin = std::time::Instant::now();
    let result = rollout.run(cancel);
    let wall_secs = begin.elapsed().as_secs_f64();
    let frames = rollout.frame();
    match result {
        Ok(()) => {
            Ok(Outcome { precision: Some(rollout.precision()), error: None, wall_secs, frames })
        }
        Err(e @ (Error::Simulation { .. } | Error::BadAction { .. })) => {
            Ok(Outcome { precision: None, error: Some(e.to_string()), wall_secs, frames })
        }
        Err(e) => Err(e),
    }
}

fn summarise(case: &Case, outcomes: &[&Outcome]) -> CaseResult {
    let failed = outcomes.iter().find_map(|o| o.error.clone());
    let done: Vec<&Precision> = outcomes.iter().filter_map(|o| o.precision.as_ref()).collect();
    let mean = |f: &dyn Fn(&Precision) -> Option<f64>| {
        let values: Option<Vec<f64>> = done.iter().map(|p| f(p)).collect();
        values.and_then(|v| mean_ci95(&v))
    };
    let precision = if failed.is_some() { None } else { mean(&|p| p.precision) };
    CaseResult {
        name: case.name.clone(),
        precision: precision.map(|i| i.mean),
        ci95: precision.and_then(|i| i.ci95),
        masked_mae: mean(&|p| p.masked_mae).map(|i| i.mean),
        p95: mean(&|p| p.p95).map(|i| i.mean),
        hold_end: mean(&|p| p.hold_end).map(|i| i.mean),
        frames_late: mean(&|p| p.frames_late).map(|i| i.mean),
        mean_abs_du: mean(&|p| Some(p.mean_abs_du)).map_or(0.0, |i| i.mean),
        wall_secs: outcomes.iter().map(|o| o.wall_secs).sum::<f64>() / outcomes.len().max(1) as f64,
        frames: outcomes.first().map_or(0, |o| o.frames),
        error: failed,
        per_frame: done.first().map(|p| p.per_frame.clone()).unwrap_or_default(),
    }
}
