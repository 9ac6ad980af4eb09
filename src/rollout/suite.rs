//! Many clips, many policies, all cores: the table that claims stand on.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use serde::Serialize;

use super::error::Error;
use super::policy::Policy;
use super::precision::{Precision, hidden_error};
use super::registry::{Guide, PolicyConfig, labels};
use super::run::{Rollout, RolloutConfig, Start};
use super::stats::{Interval, mean_ci95};
use crate::clip::Command;
use crate::progress::{Cancel, Progress};
use crate::robot::{PlantConfig, PlantRange, Robot};

/// One task of a suite.
#[derive(Clone, Debug)]
pub struct Case {
    /// Its name.
    pub name: String,
    /// What is commanded.
    pub command: Command,
    /// Where it begins.
    pub start: Start,
    /// The whole motion, where masks hide a known one; (frames, S), frame 0 first.
    pub truth: Option<Vec<f64>>,
}

/// Tasks that are reported together.
#[derive(Clone, Debug)]
pub struct Suite {
    /// Its name, for the result.
    pub name: String,
    /// The tasks, in the order of the table.
    pub cases: Vec<Case>,
}

/// What to evaluate.
#[derive(Clone, Debug)]
pub struct EvalConfig {
    /// The policies.
    pub policies: Vec<PolicyConfig>,
    /// Where the plant of each seed is drawn from.
    pub plant: PlantRange,
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
    /// Plant or range of plants, where it is not nominal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plant: Option<String>,
    /// Mean Precision over tasks; `None` when any task failed.
    pub precision_mean: Option<f64>,
    /// Half width of its 95 % interval over seeds.
    pub ci95: Option<f64>,
    /// One row a task.
    pub tasks: Vec<CaseResult>,
}

/// A policy that rollouts are forked from.
type Template = Mutex<Box<dyn Policy>>;

/// One rollout of an evaluation.
#[derive(Clone, Copy, Debug)]
struct Job {
    suite: usize,
    policy: usize,
    case: usize,
    seed: u64,
}

/// Rolls every case out under every policy and seed, on all cores. One result for each
/// suite and policy, in that order; they do not depend on the number of threads.
///
/// # Errors
/// The first error that the user can fix (a policy that cannot be built, a clip for
/// another robot), and [`Error::Cancelled`]. A rollout that diverges is a result, with its
/// reason in the row.
pub fn evaluate(
    robot: &Arc<Robot>,
    suites: &[Suite],
    config: &EvalConfig,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<Vec<Evaluation>, Error> {
    // Built once: a model file is read, checked and packed for all its rollouts together.
    let templates =
        config.policies.iter().map(|p| p.build(robot)).collect::<Result<Vec<_>, _>>()?;
    let uses_model: Vec<bool> = templates.iter().map(|t| t.uses_model()).collect();
    let templates: Vec<Template> = templates.into_iter().map(Mutex::new).collect();
    let seeds = config.seeds.max(1);
    let mut jobs = Vec::new();
    for (suite, cases) in suites.iter().map(|s| s.cases.len()).enumerate() {
        for policy in 0..config.policies.len() {
            for case in 0..cases {
                jobs.extend((0..seeds).map(|seed| Job { suite, policy, case, seed }));
            }
        }
    }
    let labels = labels(&config.policies);
    let found = all(robot, suites, config, &templates, &labels, &jobs, progress, cancel)?;
    let mut outcomes = found.into_iter();

    let mut results = Vec::new();
    for suite in suites {
        for (policy, &uses_model) in labels.iter().zip(&uses_model) {
            let by_case: Vec<Vec<Outcome>> = suite
                .cases
                .iter()
                .map(|_| outcomes.by_ref().take(seeds as usize).collect())
                .collect();
            let interval = over_seeds(&by_case, seeds as usize);
            results.push(Evaluation {
                policy: policy.clone(),
                uses_model,
                suite: suite.name.clone(),
                plant: (config.plant != PlantRange::default()).then(|| config.plant.to_string()),
                precision_mean: interval.map(|i| i.mean),
                ci95: interval.and_then(|i| i.ci95),
                tasks: suite.cases.iter().zip(&by_case).map(|(c, o)| summarise(c, o)).collect(),
            });
        }
    }
    Ok(results)
}

/// The outcomes of the jobs, in their order.
fn all(
    robot: &Arc<Robot>,
    suites: &[Suite],
    config: &EvalConfig,
    templates: &[Template],
    labels: &[String],
    jobs: &[Job],
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<Vec<Outcome>, Error> {
    let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
    // An error on one thread ends the others at their next frame.
    let stop = Cancel::default();
    let work = || -> Result<Vec<(usize, Outcome)>, Error> {
        let mut mine = Vec::new();
        loop {
            let at = next.fetch_add(1, Ordering::Relaxed);
            let Some(job) = jobs.get(at) else { return Ok(mine) };
            let case = &suites[job.suite].cases[job.case];
            let policy = &config.policies[job.policy];
            let forked = {
                let template = templates[job.policy].lock();
                template.unwrap_or_else(PoisonError::into_inner).fork()
            };
            let built = forked.map_or_else(|| policy.build(robot), Ok);
            let outcome = built
                .and_then(|built| {
                    let guided = (built, policy.guide);
                    one(
                        robot,
                        guided,
                        case,
                        job.seed,
                        config.plant.draw(job.seed),
                        &[cancel, &stop],
                    )
                })
                .inspect_err(|_| stop.cancel())?;
            mine.push((at, outcome));
            let n = done.fetch_add(1, Ordering::Relaxed) + 1;
            let note = format!("{} {}", labels[job.policy], case.name);
            progress.tick(n as u64, jobs.len() as u64, &note);
        }
    };
    let finished: Vec<_> = std::thread::scope(|scope| {
        let threads = config.threads.clamp(1, jobs.len().max(1));
        let handles: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        handles
            .into_iter()
            .map(|h| h.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
            .collect()
    });
    let mut outcomes = Vec::with_capacity(jobs.len());
    let mut error: Option<Error> = None;
    for part in finished {
        match part {
            Ok(part) => outcomes.extend(part),
            // The cause, not the threads that it stopped.
            Err(e) if matches!(error, None | Some(Error::Cancelled { .. })) => error = Some(e),
            Err(_) => {}
        }
    }
    if let Some(e) = error {
        return Err(e);
    }
    outcomes.sort_by_key(|(at, _)| *at);
    Ok(outcomes.into_iter().map(|(_, o)| o).collect())
}

/// Mean over tasks, with the interval over seeds: each seed gives one mean. `None` when a
/// rollout failed or had no goal.
fn over_seeds(by_case: &[Vec<Outcome>], seeds: usize) -> Option<Interval> {
    let by_seed: Option<Vec<f64>> = (0..seeds)
        .map(|s| {
            let each: Option<Vec<f64>> =
                by_case.iter().map(|o| o.get(s)?.precision.as_ref()?.precision).collect();
            mean_ci95(&each?).map(|i| i.mean)
        })
        .collect();
    mean_ci95(&by_seed?)
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
    (policy, guide): (Box<dyn Policy>, Guide),
    case: &Case,
    seed: u64,
    plant: PlantConfig,
    stops: &[&Cancel],
) -> Result<Outcome, Error> {
    let config = RolloutConfig { seed, guide, plant };
    let mut rollout = Rollout::new(robot, policy, &case.command, case.start.clone(), config)?;
    let begin = std::time::Instant::now();
    let result = loop {
        if stops.iter().any(|c| c.is_cancelled()) {
            break Err(Error::Cancelled { frame: rollout.frame() });
        }
        match rollout.step() {
            Ok(Some(_)) => {}
            Ok(None) => break Ok(()),
            Err(e) => break Err(e),
        }
    };
    let wall_secs = begin.elapsed().as_secs_f64();
    let frames = rollout.frame();
    match result {
        Ok(()) => {
            let mut precision = rollout.precision();
            if let Some(truth) = &case.truth {
                precision.masked_mae = hidden_error(rollout.goals(), rollout.reached(), truth);
            }
            Ok(Outcome { precision: Some(precision), error: None, wall_secs, frames })
        }
        Err(e @ (Error::Simulation { .. } | Error::BadAction { .. })) => {
            Ok(Outcome { precision: None, error: Some(e.to_string()), wall_secs, frames })
        }
        Err(e) => Err(e),
    }
}

fn summarise(case: &Case, outcomes: &[Outcome]) -> CaseResult {
    let failed = outcomes.iter().find_map(|o| o.error.clone());
    let done: Vec<&Precision> = outcomes.iter().filter_map(|o| o.precision.as_ref()).collect();
    let mean = |f: &dyn Fn(&Precision) -> Option<f64>| {
        let values: Option<Vec<f64>> = done.iter().map(|p| f(p)).collect();
        values.and_then(|v| mean_ci95(&v))
    };
    let precision = if failed.is_some() { None } else { mean(&|p| p.precision) };
    let failed = failed.or_else(|| {
        let why = "nothing to measure: the clip asks for nothing after frame 0";
        precision.is_none().then(|| why.to_owned())
    });
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
