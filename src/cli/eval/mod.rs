//! `robert eval`: compares policies on suites of clips, in one table per suite.

mod args;
mod rows;
mod suites;
mod table;

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use serde::Serialize;

pub(super) use self::args::Args;

use self::rows::{errors_csv, rows_csv};
use self::suites::suites;
use self::table::table;
use super::bar::Bar;
use super::failure::{Failure, Outcome};
use super::global::Global;
use super::interrupt::cancel_on_ctrl_c;
use super::{input, motion, out, output, plot};
use crate::clip::Sight;
use crate::exit::Exit;
use crate::fsio;
use crate::gpu::{self, GpuForwards};
use crate::net::forward::Forwards;
use crate::progress::Cancel;
use crate::robot::{PlantRange, Robot};
use crate::rollout::{self, EvalConfig, Evaluation, PolicyConfig, Suite, evaluate_on, floor};

/// Rollouts at once with a card, unless --threads says otherwise.
pub(super) const AT_ONCE: usize = 64;

/// The document of `--json`.
#[derive(Debug, Serialize)]
struct Report<'a> {
    robot: &'a str,
    unit: &'static str,
    plant: PlantRange,
    seeds: u64,
    threads: usize,
    /// The graphics card, if one computed the networks.
    #[serde(skip_serializing_if = "Option::is_none")]
    device: Option<&'a str>,
    wall_secs: f64,
    /// Whether rollouts are missing, because the evaluation was interrupted.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    interrupted: bool,
    suites: Vec<SuiteFacts>,
    results: &'a [Evaluation],
}

/// Figures about the commands of a suite.
#[derive(Debug, Serialize)]
struct SuiteFacts {
    name: String,
    tasks: usize,
    /// Share of commanded frames with a joint near a limit, where torque cannot be inferred from
    /// positions.
    near_limit_share: f64,
}

impl SuiteFacts {
    fn of(suite: &Suite, robot: &Robot) -> SuiteFacts {
        let (mut near, mut all) = (0_u32, 0_u32);
        for command in suite.cases.iter().map(|c| &c.command) {
            for f in (1..command.frames()).filter(|f| command.sight(*f) == Sight::Full) {
                let q: Vec<f64> = command.row(f).iter().map(|v| f64::from(*v)).collect();
                near += u32::from(!robot.near_limits(&q).is_empty());
                all += 1;
            }
        }
        let near_limit_share = f64::from(near) / f64::from(all.max(1));
        SuiteFacts { name: suite.name.clone(), tasks: suite.cases.len(), near_limit_share }
    }
}

pub(super) fn run(args: &Args, global: Global) -> Outcome {
    if args.json && args.takes_stdout() {
        return Err(Failure::usage("--json writes to stdout, so --csv and --plot need a file"));
    }
    let printed = |p: &Option<PathBuf>| p.as_deref().is_some_and(input::is_standard);
    if printed(&args.csv) && printed(&args.plot) {
        return Err(Failure::usage("--csv and --plot cannot both go to stdout"));
    }
    let policies: Vec<PolicyConfig> =
        args.policy.iter().map(|p| args.conditions.policy(p)).collect::<Outcome<_>>()?;
    let plant = args.conditions.plant()?;
    if let Some(x) = args.max_precision.filter(|x| !(x.is_finite() && *x >= 0.0)) {
        return Err(Failure::usage(format!("--max-precision takes 0 or more, not {x}")));
    }
    if let Some(path) = &args.plot {
        plot::may_save(path)?;
    }
    if let Some(path) = &args.csv {
        output::may_create(path)?;
    }
    if let Some(dir) = &args.out {
        output::may_be_folder(dir)?;
    }
    let (robot, mut suites) = suites(args)?;
    let threads = args.threads.count();
    let config = EvalConfig { policies, plant, seeds: 0..args.seeds, threads };

    let cancel = cancel_on_ctrl_c();
    // Another plant has other floors. If iLQR takes part, its own figures are the floor.
    let wanted = !args.no_floor && plant == PlantRange::default();
    let wanted = wanted && !config.policies.contains(&PolicyConfig::floor());
    let in_floors = wanted && !floors(&robot, &mut suites, threads, global, &cancel);
    // After an interruption nothing is evaluated, so no graphics card is needed.
    let (config, device) =
        if in_floors { (config, None) } else { on_device(args, config, &suites)? };
    let bar = Bar::new("eval", "frames", global.quiet);
    let begin = Instant::now();
    let forwards = device.as_ref().map(|d| d as &dyn Forwards);
    let evaluated = evaluate_on(&robot, &suites, &config, forwards, &bar, &cancel);
    bar.finish();
    for note in device.as_ref().map(GpuForwards::notes).into_iter().flatten() {
        tracing::warn!("{note}");
    }
    let evaluated = evaluated?;
    let whole = evaluated.is_whole();
    let interrupted = || {
        let why = if in_floors {
            "interrupted while the floors were measured, before the policies (--no-floor leaves floors out)".to_owned()
        } else {
            format!(
                "interrupted after {} of {} rollouts; the others have no figures, and a mean needs all of its tasks",
                evaluated.finished, evaluated.wanted
            )
        };
        Failure::with(Exit::Interrupted, why)
    };
    // No figures for tables and files. The document still says what was asked for, and the floors.
    let is_empty = evaluated.finished == 0;
    if is_empty && !args.json {
        return Err(interrupted());
    }

    let report = Report {
        robot: robot.id(),
        unit: motion::unit(&robot),
        plant,
        seeds: args.seeds,
        threads: config.threads,
        device: device.as_ref().map(|d| d.gpu().name()),
        wall_secs: begin.elapsed().as_secs_f64(),
        interrupted: !whole,
        suites: suites.iter().map(|s| SuiteFacts::of(s, &robot)).collect(),
        results: &evaluated.results,
    };
    // An interrupted evaluation must not take the place of a complete one.
    let free = |path: &Path| {
        let free = whole || !is_empty && (input::is_standard(path) || !path.exists());
        if !free {
            let now = if path.exists() { "stays as it was" } else { "is not written" };
            tracing::warn!("{} {now}", path.display());
        }
        free
    };
    if let Some(path) = args.csv.as_ref().filter(|path| free(path)) {
        input::write(path, &rows_csv(report.results)?)?;
    }
    if let Some(dir) = args.out.as_ref().filter(|dir| free(&dir.join("results.json"))) {
        let json = serde_json::to_vec_pretty(&report).map_err(io::Error::other)?;
        fsio::write_atomic(&dir.join("results.json"), &json)?;
        fsio::write_atomic(&dir.join("results.csv"), &rows_csv(report.results)?)?;
        fsio::write_atomic(&dir.join("errors.csv"), &errors_csv(report.results)?)?;
    }
    if let Some(path) = args.plot.as_ref().filter(|path| free(path)) {
        let value = serde_json::to_value(&report).map_err(io::Error::other)?;
        let title = format!("{}: Precision, lower is better", robot.id());
        plot::save(&plot::of_evaluation(&title, value)?, path)?;
    }
    if args.json {
        out::json(&report)?;
    } else {
        let tables: Vec<String> =
            suites.iter().map(|s| table(&robot, &s.name, plant, report.results)).collect();
        input::say(args.takes_stdout(), &tables.join("\n\n"))?;
    }
    if !whole {
        return Err(interrupted());
    }
    match args.max_precision {
        Some(limit) => check(report.results, limit, report.unit),
        None => Ok(()),
    }
}

/// Opens the requested graphics card. With a card, enough rollouts run at once to keep it busy.
/// Without one, a line says why, and the processor computes.
fn on_device(
    args: &Args,
    config: EvalConfig,
    suites: &[Suite],
) -> Outcome<(EvalConfig, Option<GpuForwards>)> {
    let cases: usize = suites.iter().map(|s| s.cases.len()).sum();
    let rollouts = cases * config.policies.len() * args.seeds as usize;
    let at_once = args.threads.threads.unwrap_or(AT_ONCE);
    match args.device.forwards(at_once.min(rollouts)) {
        Ok(None) => Ok((config, None)),
        Ok(device) => Ok((EvalConfig { threads: at_once, ..config }, device)),
        // A number that no card has is a mistake on the command line; a missing card is not.
        Err(e @ gpu::Error::Number { .. }) => Err(e.into()),
        Err(e) => {
            tracing::warn!("the processor performs: {e}");
            Ok((config, None))
        }
    }
}

/// Measures the floor of every clip; false if this was interrupted. A robot that iLQR cannot drive has none.
fn floors(
    robot: &Arc<Robot>,
    suites: &mut [Suite],
    threads: usize,
    global: Global,
    cancel: &Cancel,
) -> bool {
    let bar = Bar::new("floor", "frames", global.quiet);
    // Tasks from recorded motion are compared with the recording instead.
    let clips = suites.iter_mut().flat_map(|s| &mut s.cases).filter(|c| c.truth.is_none());
    let filled = floor::fill(robot, clips, threads, &bar, cancel);
    bar.finish();
    match filled {
        Err(rollout::Error::Cancelled { .. }) => return false,
        Err(e) => tracing::warn!("there are no floors to compare with: {e}"),
        Ok(()) => {}
    }
    true
}

/// Fails with exit code 4 if a mean is above the limit or missing.
fn check(results: &[Evaluation], limit: f64, unit: &str) -> Outcome {
    let missed: Vec<String> = results
        .iter()
        .filter(|r| r.precision_mean.is_none_or(|p| p > limit))
        .map(|r| {
            let got = r.precision_mean.map_or_else(|| "failed".to_owned(), |p| format!("{p:.5}"));
            format!("{} on {}: {got}", r.policy, r.suite)
        })
        .collect();
    if missed.is_empty() {
        return Ok(());
    }
    let message = format!("Precision above {limit} {unit}: {}", missed.join("; "));
    Err(Failure::with(Exit::Threshold, message))
}
