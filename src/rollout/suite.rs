//! Evaluates many clips with many policies on all cores.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use serde::Serialize;

use super::auto::Contenders;
use super::error::Error;
use super::gaps::{GapFigures, cubic_error};
use super::jam::{self, Off};
use super::policy::Policy;
use super::policy_config::{PolicyConfig, labels};
use super::precision::{Precision, hidden_error};
use super::run::{Rollout, RolloutConfig};
use super::start::Start;
use super::stats::{Interval, mean_ci95};
use robert_base::parallel;
use robert_base::progress::{Cancel, Progress, Silent};
use robert_clip::Command;
use robert_net::forward::Forwards;
use robert_robot::{PlantConfig, PlantRange, Robot};

/// The result of iLQR on a clip.
#[derive(Clone, Debug, PartialEq)]
pub struct Floor {
    /// Its Precision, rad or m.
    pub precision: f64,
    /// The frames at which iLQR is more than .02 off. A policy that is off there too has not
    /// jammed.
    pub off: Vec<Off>,
}

/// One task of a suite.
#[derive(Clone, Debug)]
pub struct Case {
    /// Its name.
    pub name: String,
    /// Its command.
    pub command: Command,
    /// Its start.
    pub start: Start,
    /// The complete motion, if masks hide a known one; (frames, S), frame 0 first.
    pub truth: Option<Vec<f64>>,
    /// The result of iLQR, if it is known beforehand; see [`super::floor`].
    pub floor: Option<Floor>,
}

/// Tasks that are reported together.
#[derive(Clone, Debug)]
pub struct Suite {
    /// Its name.
    pub name: String,
    /// The tasks, in the order of the table.
    pub cases: Vec<Case>,
}

/// The settings of an evaluation.
#[derive(Clone, Debug)]
pub struct EvalConfig {
    /// The policies.
    pub policies: Vec<PolicyConfig>,
    /// The range of plants; each seed draws one.
    pub plant: PlantRange,
    /// The seeds.
    pub seeds: Range<u64>,
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
    /// Precision of iLQR on the same clip and the nominal plant; `None` if unknown.
    pub floor: Option<f64>,
    /// (Precision - floor) / floor; `None` also if the floor is below a hundred-thousandth, which
    /// nobody can see.
    pub excess: Option<f64>,
    /// Error over the frames at which the command moves.
    pub moving: Option<f64>,
    /// The quality of the motion inside gaps, first seed; `None` if nothing is masked.
    pub gap: Option<GapFigures>,
    /// Joints that stay far from reachable goals, first seed; `None` if the floor is unknown.
    pub jams: Option<Vec<Jam>>,
    /// Error on masked frames.
    pub masked_mae: Option<f64>,
    /// 95th percentile of the error.
    pub p95: Option<f64>,
    /// Error in the last frame of each hold.
    pub hold_end: Option<f64>,
    /// Frames until a hold is reached.
    pub frames_late: Option<f64>,
    /// Mean change of action per frame; `None` if it failed.
    pub mean_abs_du: Option<f64>,
    /// The policy that `auto` chose, first seed; `None` for other policies.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub chosen: Option<String>,
    /// Wall time of one rollout, seconds; for `auto` with all that it tried.
    pub wall_secs: f64,
    /// Control steps of one rollout.
    pub frames: usize,
    /// Why it failed, if it did.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// Mean error by frame of the first seed.
    #[serde(skip)]
    pub per_frame: Vec<Option<f64>>,
    /// Frames where joints have not reached their goals ([`jam::NEAR`]), first seed.
    #[serde(skip)]
    off: Vec<Off>,
    /// Frames at which joints are far from their goals ([`jam::FAR`]), first seed.
    #[serde(skip)]
    far: Vec<Off>,
}

/// A joint that is more than .05 off for a second or longer where iLQR is within .02.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Jam {
    /// The joint.
    pub joint: String,
    /// First frame.
    pub from: usize,
    /// First frame after.
    pub to: usize,
}

impl CaseResult {
    /// This result as the floor of others.
    pub(super) fn as_floor(&self) -> Option<Floor> {
        Some(Floor { precision: self.precision?, off: self.off.clone() })
    }

    /// Whether an interruption prevented one of its rollouts.
    pub fn is_interrupted(&self) -> bool {
        self.error.as_deref() == Some(INTERRUPTED)
    }

    fn compare(&mut self, robot: &Robot, floor: Option<&Floor>) {
        let Some(floor) = floor else { return };
        self.floor = Some(floor.precision);
        // What failed has no figures: no jams would be a good one.
        if self.error.is_some() {
            return;
        }
        self.excess = excess(self.precision, floor.precision);
        let named =
            |o: Off| Jam { joint: robot.joints()[o.joint].name.clone(), from: o.from, to: o.to };
        self.jams = Some(jam::jams(&self.far, &floor.off).into_iter().map(named).collect());
    }
}

/// The smallest floor of which an excess is a share, rad or m.
const LEAST_FLOOR: f64 = 1e-5;

/// The excess relative to the floor; `None` if the floor is almost zero.
fn excess(precision: Option<f64>, floor: f64) -> Option<f64> {
    precision.filter(|_| floor > LEAST_FLOOR).map(|p| (p - floor) / floor)
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
    /// Plant or range of plants, if it is not nominal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plant: Option<String>,
    /// Mean Precision over tasks; `None` when any task failed.
    pub precision_mean: Option<f64>,
    /// Half width of its 95 % interval over seeds.
    pub ci95: Option<f64>,
    /// Excess of the mean over the mean of the floors; `None` when one of them is unknown.
    pub excess_mean: Option<f64>,
    /// One row per task.
    pub tasks: Vec<CaseResult>,
}

/// The source of the forked policies.
enum Template {
    One(Mutex<Box<dyn Policy>>),
    /// The best of several, clip by clip.
    Auto(Contenders),
}

impl Template {
    fn new(robot: &Arc<Robot>, policy: &PolicyConfig) -> Result<Template, Error> {
        if policy.is_tried() {
            return Ok(Template::Auto(Contenders::new(robot, policy)?));
        }
        Ok(Template::One(Mutex::new(policy.build(robot)?)))
    }

    fn on(&self, device: &dyn Forwards) {
        if let Template::One(policy) = self {
            policy.lock().unwrap_or_else(PoisonError::into_inner).on(device);
        }
    }

    fn uses_model(&self) -> bool {
        match self {
            Template::One(policy) => {
                policy.lock().unwrap_or_else(PoisonError::into_inner).uses_model()
            }
            Template::Auto(_) => true,
        }
    }

    /// The rollout of a case at its beginning, and the policy that was chosen for it, if any was.
    fn rollout(
        &self,
        robot: &Arc<Robot>,
        asked: &PolicyConfig,
        case: &Case,
        (seed, plant): (u64, PlantConfig),
        cancel: &Cancel,
    ) -> Result<(Rollout, Option<String>), Error> {
        let (command, start) = (&case.command, &case.start);
        match self {
            Template::One(policy) => {
                let forked = policy.lock().unwrap_or_else(PoisonError::into_inner).fork();
                let policy = forked.map_or_else(|| asked.build(robot), Ok)?;
                let config = RolloutConfig { seed, guide: asked.guide, plant };
                Ok((Rollout::new(robot, policy, command, start.clone(), config)?, None))
            }
            Template::Auto(all) => {
                let chosen = all.perform(command, start, seed, 1, &Silent, cancel)?;
                let label = chosen.policy.label();
                Ok((chosen.again(command, start, seed, plant)?, Some(label)))
            }
        }
    }
}

/// One rollout of an evaluation.
#[derive(Clone, Copy, Debug)]
struct Job {
    suite: usize,
    policy: usize,
    case: usize,
    seed: u64,
}

/// The results of an evaluation, and whether they are complete.
#[derive(Debug)]
pub struct Evaluated {
    /// One result per suite and policy, in that order. A rollout that an interruption prevented is a failure in
    /// its row, called [`INTERRUPTED`].
    pub results: Vec<Evaluation>,
    /// Rollouts that were finished.
    pub finished: usize,
    /// Rollouts that were wanted.
    pub wanted: usize,
}

impl Evaluated {
    /// Whether every rollout was finished.
    pub fn is_whole(&self) -> bool {
        self.finished == self.wanted
    }
}

/// Why a rollout has no figures after an interruption.
pub const INTERRUPTED: &str = "interrupted";

/// Rolls out every case with every policy and seed, on all cores. There is one result per suite and
/// policy, in that order. The results do not depend on the number of threads.
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
    let all = evaluate_on(robot, suites, config, None, progress, cancel)?;
    if !all.is_whole() {
        return Err(Error::Cancelled { frame: 0 });
    }
    Ok(all.results)
}

/// As [`evaluate`], with the networks of trained policies on a device. The device computes the
/// windows of all rollouts that run at once, so more threads than cores are useful. `auto` and
/// refined policies stay with the processor. What was finished before an interruption is kept.
///
/// # Errors
/// As [`evaluate`], but for [`Error::Cancelled`].
pub fn evaluate_on(
    robot: &Arc<Robot>,
    suites: &[Suite],
    config: &EvalConfig,
    device: Option<&dyn Forwards>,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<Evaluated, Error> {
    // Built once: a model file is read, checked and packed for all its rollouts together.
    let templates: Vec<Template> =
        config.policies.iter().map(|p| Template::new(robot, p)).collect::<Result<_, _>>()?;
    if let Some(device) = device {
        templates.iter().for_each(|t| t.on(device));
    }
    let uses_model: Vec<bool> = templates.iter().map(Template::uses_model).collect();
    let seeds = (config.seeds.end - config.seeds.start) as usize;
    assert!(seeds > 0, "an evaluation needs a seed");
    let mut jobs = Vec::new();
    for (suite, cases) in suites.iter().map(|s| s.cases.len()).enumerate() {
        for policy in 0..config.policies.len() {
            for case in 0..cases {
                jobs.extend(config.seeds.clone().map(|seed| Job { suite, policy, case, seed }));
            }
        }
    }
    let labels = labels(&config.policies);
    let found = all(robot, suites, config, &templates, &labels, &jobs, progress, cancel)?;
    let wanted = found.len();
    let finished = found.iter().flatten().count();
    let interrupted = || Outcome { error: Some(INTERRUPTED.to_owned()), ..Outcome::default() };
    let mut outcomes = found.into_iter().map(|one| one.unwrap_or_else(interrupted));

    let nominal = config.plant == PlantRange::default();
    let ilqr = config.policies.iter().position(|p| nominal && *p == PolicyConfig::floor());
    let mut results = Vec::new();
    for suite in suites {
        let first = results.len();
        for (policy, &uses_model) in labels.iter().zip(&uses_model) {
            let by_case: Vec<Vec<Outcome>> =
                suite.cases.iter().map(|_| outcomes.by_ref().take(seeds).collect()).collect();
            let interval = over_seeds(&by_case, seeds);
            results.push(Evaluation {
                policy: policy.clone(),
                uses_model,
                suite: suite.name.clone(),
                plant: (!nominal).then(|| config.plant.to_string()),
                precision_mean: interval.map(|i| i.mean),
                ci95: interval.and_then(|i| i.ci95),
                excess_mean: None,
                tasks: suite.cases.iter().zip(&by_case).map(|(c, o)| summarise(c, o)).collect(),
            });
        }
        let of_suite = &mut results[first..];
        if nominal {
            against_floors(robot, suite, ilqr, of_suite);
        }
    }
    Ok(Evaluated { results, finished, wanted })
}

/// Sets the figures relative to the floors: those of this run if iLQR is one of the policies, else
/// those of the cases. A plant other than the nominal one has unknown floors.
fn against_floors(robot: &Robot, suite: &Suite, ilqr: Option<usize>, results: &mut [Evaluation]) {
    let floors: Vec<Option<Floor>> = match ilqr.and_then(|i| results.get(i)) {
        Some(own) => own.tasks.iter().map(CaseResult::as_floor).collect(),
        None => suite.cases.iter().map(|c| c.floor.clone()).collect(),
    };
    let each: Option<Vec<f64>> = floors.iter().map(|f| Some(f.as_ref()?.precision)).collect();
    let mean = each.and_then(|f| mean_ci95(&f)).map(|i| i.mean);
    for result in results {
        for (task, floor) in result.tasks.iter_mut().zip(&floors) {
            task.compare(robot, floor.as_ref());
        }
        result.excess_mean = mean.and_then(|m| excess(result.precision_mean, m));
    }
}

/// The outcomes of the jobs, in their order; `None` of those that an interruption prevented. Those with a search
/// take much longer. They come last, as a part with its own progress, so that the time left can be told.
fn all(
    robot: &Arc<Robot>,
    suites: &[Suite],
    config: &EvalConfig,
    templates: &[Template],
    labels: &[String],
    jobs: &[Job],
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<Vec<Option<Outcome>>, Error> {
    let (search, direct): (Vec<usize>, Vec<usize>) =
        (0..jobs.len()).partition(|&at| config.policies[jobs[at].policy].is_tried());
    let mut outcomes: Vec<Option<Outcome>> = jobs.iter().map(|_| None).collect();
    let has_both = !direct.is_empty() && !search.is_empty();
    for (what, part) in [("perform", direct), ("search", search)] {
        if part.is_empty() || cancel.is_cancelled() {
            continue;
        }
        if has_both {
            progress.phase(what, "frames");
        }
        let found = some(robot, suites, config, templates, labels, (jobs, &part), progress, cancel);
        found?.into_iter().for_each(|(at, one)| outcomes[at] = Some(one));
    }
    Ok(outcomes)
}

/// The outcomes of some jobs that were finished, each with its place among all. Progress counts frames.
fn some(
    robot: &Arc<Robot>,
    suites: &[Suite],
    config: &EvalConfig,
    templates: &[Template],
    labels: &[String],
    (jobs, part): (&[Job], &[usize]),
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<Vec<(usize, Outcome)>, Error> {
    let case = |job: &Job| &suites[job.suite].cases[job.case];
    let frames = |at: usize| u64::from(case(&jobs[at]).command.frames());
    let total = part.iter().map(|&at| frames(at)).sum();
    let (next, done) = (AtomicUsize::new(0), AtomicU64::new(0));
    // An error on one thread stops the others at their next frame, or at the end of the trials of `auto`.
    let stop = Cancel::default();
    let work = || -> Result<Vec<(usize, Outcome)>, Error> {
        let mut mine = Vec::new();
        loop {
            let Some(&at) = part.get(next.fetch_add(1, Ordering::Relaxed)) else { return Ok(mine) };
            let job = &jobs[at];
            let case = case(job);
            let policy = &config.policies[job.policy];
            let drawn = (job.seed, config.plant.draw(job.seed));
            let mut begin = std::time::Instant::now();
            let done_one = templates[job.policy]
                .rollout(robot, policy, case, drawn, cancel)
                .and_then(|(rollout, chosen)| {
                    if chosen.is_none() {
                        // To build a policy is no part of its motion.
                        begin = std::time::Instant::now();
                    }
                    Ok((one(rollout, case, &[cancel, &stop])?, chosen))
                });
            let (mut outcome, chosen) = match done_one {
                Err(Error::Cancelled { .. }) => return Ok(mine),
                other => other.inspect_err(|_| stop.cancel())?,
            };
            // Nor do its figures belong to it.
            outcome.wall_secs = begin.elapsed().as_secs_f64() - outcome.measuring_secs;
            outcome.chosen = chosen;
            mine.push((at, outcome));
            let n = done.fetch_add(frames(at), Ordering::Relaxed) + frames(at);
            progress.tick(n, total, &format!("{} {}", labels[job.policy], case.name));
        }
    };
    let finished = parallel::on_threads(config.threads.min(part.len()), work);
    let mut outcomes = Vec::with_capacity(part.len());
    for part in finished {
        outcomes.extend(part?);
    }
    Ok(outcomes)
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

#[derive(Clone, Debug, Default)]
struct Outcome {
    precision: Option<Precision>,
    gap: Option<GapFigures>,
    off: Vec<Off>,
    far: Vec<Off>,
    error: Option<String>,
    chosen: Option<String>,
    wall_secs: f64,
    measuring_secs: f64,
    frames: usize,
}

fn one(mut rollout: Rollout, case: &Case, stops: &[&Cancel]) -> Result<Outcome, Error> {
    let stopped = || stops.iter().any(|c| c.is_cancelled());
    let result = loop {
        if stopped() {
            break Err(Error::Cancelled { frame: rollout.frame() });
        }
        match rollout.step() {
            Ok(Some(_)) => {}
            Ok(None) => break Ok(()),
            Err(e) => break Err(e),
        }
    };
    let mut outcome = Outcome { frames: rollout.frame(), ..Outcome::default() };
    match result {
        Ok(()) => {
            let begin = std::time::Instant::now();
            measure(&mut rollout, case, &mut outcome, &stopped);
            if stopped() {
                // Gaps may not have been repeated without contact.
                return Err(Error::Cancelled { frame: rollout.frame() });
            }
            outcome.measuring_secs = begin.elapsed().as_secs_f64();
            Ok(outcome)
        }
        Err(e @ (Error::Simulation { .. } | Error::BadAction { .. })) => {
            outcome.error = Some(e.to_string());
            Ok(outcome)
        }
        Err(e) => Err(e),
    }
}

fn measure(rollout: &mut Rollout, case: &Case, outcome: &mut Outcome, stopped: &dyn Fn() -> bool) {
    outcome.gap = GapFigures::of(rollout, stopped);
    let (goals, reached) = (rollout.goals(), rollout.reached());
    let mut precision = rollout.precision();
    if let (Some(truth), Start::Recorded { history, .. }) = (&case.truth, &case.start) {
        precision.masked_mae = hidden_error(goals, reached, truth);
        let cubic = cubic_error(goals, history, truth).filter(|c| *c > 0.0);
        if let Some(gap) = &mut outcome.gap {
            gap.to_cubic = precision.masked_mae.zip(cubic).map(|(error, cubic)| error / cubic);
        }
    }
    outcome.precision = Some(precision);
    outcome.off = jam::off(goals, reached, jam::NEAR);
    outcome.far = jam::off(goals, reached, jam::FAR);
}

fn summarise(case: &Case, outcomes: &[Outcome]) -> CaseResult {
    let errors = || outcomes.iter().filter_map(|o| o.error.clone());
    let failed = errors().find(|e| e != INTERRUPTED).or_else(|| errors().next());
    let ran: Vec<&Outcome> =
        outcomes.iter().filter(|o| o.error.as_deref() != Some(INTERRUPTED)).collect();
    let done: Vec<&Precision> = outcomes.iter().filter_map(|o| o.precision.as_ref()).collect();
    // A mean over the seeds that did not fail would flatter.
    let all_done = failed.is_none();
    let mean = |f: &dyn Fn(&Precision) -> Option<f64>| {
        let values: Option<Vec<f64>> = done.iter().map(|p| f(p)).collect();
        values.filter(|_| all_done).and_then(|v| mean_ci95(&v))
    };
    let precision = mean(&|p| p.precision);
    let failed = failed.or_else(|| {
        let why = "there is nothing to measure: the clip has no goals after frame 0";
        precision.is_none().then(|| why.to_owned())
    });
    CaseResult {
        name: case.name.clone(),
        precision: precision.map(|i| i.mean),
        ci95: precision.and_then(|i| i.ci95),
        floor: None,
        excess: None,
        moving: mean(&|p| p.moving).map(|i| i.mean),
        gap: outcomes.first().and_then(|o| o.gap.clone()),
        jams: None,
        masked_mae: mean(&|p| p.masked_mae).map(|i| i.mean),
        p95: mean(&|p| p.p95).map(|i| i.mean),
        hold_end: mean(&|p| p.hold_end).map(|i| i.mean),
        frames_late: mean(&|p| p.frames_late).map(|i| i.mean),
        mean_abs_du: mean(&|p| Some(p.mean_abs_du)).map(|i| i.mean),
        chosen: outcomes.first().and_then(|o| o.chosen.clone()),
        wall_secs: ran.iter().map(|o| o.wall_secs).sum::<f64>() / ran.len().max(1) as f64,
        frames: outcomes.first().map_or(0, |o| o.frames),
        error: failed,
        per_frame: done.first().map(|p| p.per_frame.clone()).unwrap_or_default(),
        off: outcomes.first().map(|o| o.off.clone()).unwrap_or_default(),
        far: outcomes.first().map(|o| o.far.clone()).unwrap_or_default(),
    }
}
