//! `robert eval`: compares policies on suites of clips, in one table per suite.

use std::fmt::Write as _;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use serde::Serialize;

use super::bar::Bar;
use super::failure::{Failure, Outcome};
use super::global::{Global, Threads};
use super::interrupt::cancel_on_ctrl_c;
use super::motion::{self, CLIP_SUFFIX};
use super::perform::{Conditions, who};
use super::{input, out, output, plot};
use crate::clip::{Clip, Sight};
use crate::dataset::{Dataset, Verify};
use crate::exit::Exit;
use crate::fsio;
use crate::gpu::{self, Choice, GpuForwards};
use crate::net::forward::Forwards;
use crate::progress::Cancel;
use crate::robot::{PlantRange, Robot};
use crate::rollout::{
    self, Case, CaseResult, EvalConfig, Evaluation, PolicyConfig, Start, Suite, evaluate_on, floor,
    mean_ci95, tasks, test_suites,
};

/// The name of the suite of single files and tasks.
const FILES: &str = "files";

/// Rollouts at once with a card, unless --threads says otherwise.
pub(super) const AT_ONCE: usize = 64;

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert eval --robot ur5e --suite manual --policy zero,pd,computed-torque,ilqr\n  robert eval --robot ur5e --suite manual -p pd,pd+guide --plant mass=1.25,damping=1.5,gear=0.85\n  robert eval --robot ur5e --suite manual -p robert:adaptive+guide --plant mass=0.7..1.4 --seeds 8\n  robert eval --suite ur5e/reacher,ur5e/swing -p auto,robert,pd\n  robert eval --suite my-clips/ --policy ilqr --max-precision 0.005 --json\n  robert eval --robot ur5e --suite manual -p pd,ilqr --seeds 4 --plant gear=0.8..1.2 --plot bars.png"
)]
pub(super) struct Args {
    /// The robot; clip files name their own.
    #[arg(long, value_name = "ID|DIR")]
    robot: Option<String>,
    /// The tasks to perform. Built-in suites: manual, extra, validation; drawn, fast, touch;
    /// drawn-final, fast-final, touch-final (together: final). Single tasks by their names (robert
    /// tasks ls). Clip files, or folders of clips.
    /// trial: five clips that are generated from the robot's limits and --data-seed. test: tasks
    /// extracted from the held-out part of --data, with no frames, a quarter and half of the frames
    /// hidden.
    #[arg(long, required = true, num_args = 1.., value_delimiter = ',')]
    suite: Vec<String>,
    /// The dataset for the suite test.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Tasks per suite extracted from data [default: 30 for the arm, 6 for others, as in the
    /// paper].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    cases: Option<u16>,
    /// Seed of the extracted tasks, of their masks, and of the split if the dataset fixes none.
    #[arg(long, default_value_t = 0, value_name = "SEED")]
    data_seed: u64,
    /// Policies; --help lists all.
    #[arg(short, long, required = true, num_args = 1.., value_delimiter = ',', long_help = who("Policies:"))]
    policy: Vec<String>,
    #[command(flatten)]
    conditions: Conditions,
    /// Use the seeds 0 to N-1; intervals are over seeds.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1000))]
    seeds: u64,
    #[command(flatten)]
    threads: Threads,
    /// The device that computes the networks: the processor, or a graphics card, whose rounding
    /// differs. With a card, 64 rollouts run at once unless --threads gives another number. `auto`
    /// uses a card if there is one. Policies with `auto` or `+refine` stay on the processor.
    /// ROBERT_GPU=software allows the software driver.
    #[arg(long, value_name = "auto|cpu|gpu[:N]", default_value_t = Choice::Cpu)]
    device: Choice,
    /// Exit with 4 if a policy's mean Precision over a suite is above this (rad or m).
    #[arg(long, value_name = "X")]
    max_precision: Option<f64>,
    /// Do not compare with iLQR, which knows the model. Its Precision is stored for built-in clips;
    /// measuring it for another clip can take seconds.
    #[arg(long)]
    no_floor: bool,
    /// Write CSV with one row per task and policy; - is stdout.
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Write results.json, results.csv and errors.csv (error per frame) to this folder.
    #[arg(short, long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write a bar chart of the Precisions with 95 % intervals, .png or .svg; - writes SVG to
    /// stdout.
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

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

impl Args {
    /// Whether an output file goes to stdout.
    fn takes_stdout(&self) -> bool {
        [&self.csv, &self.plot].into_iter().flatten().any(|p| input::is_standard(p))
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
    let (config, device) = on_device(args, config, &suites)?;
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

/// Clips with their names.
type Clips = Vec<(String, Clip)>;

/// The source of a suite's tasks.
enum Source {
    Shipped,
    Trial,
    Clips(Clips),
    Data,
}

/// The robot and its suites, every clip compiled.
fn suites(args: &Args) -> Outcome<(Arc<Robot>, Vec<Suite>)> {
    let mut files: Clips = Vec::new();
    let mut named: Vec<(String, Source)> = Vec::new();
    for text in &args.suite {
        let path = Path::new(text);
        if path.is_dir() {
            named.push((text.trim_end_matches('/').to_owned(), Source::Clips(folder(path)?)));
        } else if input::exists(path) || path.extension().is_some_and(|e| e == "json") {
            files.push((stem(path), motion::clip(text, None)?));
        } else if text == "trial" {
            named.push((text.clone(), Source::Trial));
        } else if text == "test" {
            named.push((text.clone(), Source::Data));
        } else if let Some(clip) = task(text, args.robot.as_deref())? {
            files.push(clip);
        } else {
            let name = match tasks::expand(text)[..] {
                [one] => one,
                _ => text,
            };
            named.push((name.to_owned(), Source::Shipped));
        }
    }
    if !files.is_empty() {
        named.push((FILES.to_owned(), Source::Clips(files)));
    }
    let of_clips = named.iter().find_map(|(_, s)| match s {
        Source::Clips(clips) => clips.first().map(|(_, c)| c.robot.id.clone()),
        Source::Shipped | Source::Trial | Source::Data => None,
    });
    let robot = match (&args.robot, of_clips) {
        (Some(id), _) => motion::robot(id)?,
        (None, Some(own)) => motion::robot_for(None, &own)?,
        (None, None) => {
            return Err(Failure::usage(
                "a built-in suite needs a robot: --robot pointmass, ur5e, ur5e_light or shadow_hand",
            ));
        }
    };
    for (i, (name, source)) in named.iter().enumerate() {
        one_robot(name, source, robot.id())?;
        if named.iter().take(i).any(|(other, _)| other == name) {
            return Err(Failure::usage(format!("the suite {name} is listed twice")));
        }
    }
    let mut suites = Vec::new();
    for (name, source) in named {
        let clips = match source {
            Source::Clips(clips) => clips,
            Source::Shipped => tasks::suite(robot.id(), &name)?,
            Source::Trial => {
                let trial = tasks::trial(&robot, args.data_seed)?;
                trial.into_iter().map(|t| (t.name.to_owned(), t.clip)).collect()
            }
            Source::Data => {
                suites.extend(cut_suites(args, &robot)?);
                continue;
            }
        };
        let cases = clips.into_iter().map(|c| case(&robot, c)).collect::<Outcome<Vec<_>>>()?;
        suites.push(Suite { name, cases });
    }
    Ok((robot, suites))
}

/// A built-in task by its name, `NAME` or `ROBOT/NAME`; `None` if it is the name of a suite, or of
/// nothing.
fn task(name: &str, robot: Option<&str>) -> Outcome<Option<(String, Clip)>> {
    if tasks::expand(name).iter().any(|suite| tasks::SUITES.contains(suite)) {
        return Ok(None);
    }
    let short = name.rsplit('/').next().unwrap_or(name);
    match motion::clip(name, robot) {
        Ok(clip) => Ok(Some((short.to_owned(), clip))),
        // A task was meant: it names a robot, or several robots have one of this name, or there is
        // no robot of which it could be a suite.
        Err(e) if short != name || robot.is_none() || e.sentence().contains("ROBOT/NAME") => Err(e),
        Err(_) => Ok(None),
    }
}

/// Refuses clips that were made for different robots, which cannot share a table.
fn one_robot(name: &str, source: &Source, robot: &str) -> Outcome {
    let Source::Clips(clips) = source else { return Ok(()) };
    let of = |(_, clip): &(String, Clip)| clip.robot.id.clone();
    let mut robots: Vec<String> = clips.iter().map(of).collect();
    robots.sort();
    robots.dedup();
    match (&robots[..], clips.iter().find(|c| of(c) != robot)) {
        ([_, _, ..], Some(other)) => Err(Failure::invalid(format!(
            "{} for {}, such as {} for {}: evaluate those of each robot alone",
            if name == FILES { "the clips are".to_owned() } else { format!("{name} has clips") },
            robots.join(", "),
            other.0,
            other.1.robot.id
        ))),
        _ => Ok(()),
    }
}

/// The three suites extracted from a dataset.
fn cut_suites(args: &Args, robot: &Robot) -> Outcome<Vec<Suite>> {
    let Some(path) = &args.data else {
        return Err(Failure::usage("the suite test needs recorded motion: give --data DIR"));
    };
    let data = Dataset::open(path, Verify::Structure)?;
    let count = args.cases.map_or_else(|| rollout::extracted_cases(robot.id()), usize::from);
    Ok(test_suites(robot, &data, count, args.data_seed)?)
}

/// The clips of a folder, by name.
fn folder(dir: &Path) -> Outcome<Clips> {
    let unreadable = |source| fsio::Error::Read { source, path: dir.to_owned() };
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(dir).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if path.to_string_lossy().ends_with(CLIP_SUFFIX) {
            paths.push(path);
        }
    }
    paths.sort();
    if paths.is_empty() {
        return Err(Failure::invalid(format!(
            "there is no file *{CLIP_SUFFIX} in {}",
            dir.display()
        )));
    }
    paths.iter().map(|p| Ok((stem(p), Clip::load(p)?))).collect()
}

/// The file name without its suffix.
fn stem(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.strip_suffix(CLIP_SUFFIX).unwrap_or(&name).to_owned()
}

fn case(robot: &Robot, (name, clip): (String, Clip)) -> Outcome<Case> {
    let command = motion::command(&clip, robot, &name)?;
    Ok(Case { name, command, start: Start::Pose, truth: None, floor: None })
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

/// Tasks as rows, policies as columns.
fn table(robot: &Robot, suite: &str, plant: PlantRange, results: &[Evaluation]) -> String {
    let columns: Vec<&Evaluation> = results.iter().filter(|r| r.suite == suite).collect();
    let unit = motion::unit(robot);
    let mut header = vec!["task".to_owned()];
    header.extend(
        columns.iter().map(|c| format!("{}{}", c.policy, if c.uses_model { " (m)" } else { "" })),
    );
    let floors: Vec<Option<f64>> =
        columns.first().map(|c| c.tasks.iter().map(|t| t.floor).collect()).unwrap_or_default();
    let has_floor = floors.iter().any(Option::is_some);
    header.extend(has_floor.then(|| "floor".to_owned()));
    let mut t = out::table(&header.iter().map(String::as_str).collect::<Vec<_>>());
    // What was interrupted did not fail.
    let word = |interrupted: bool| if interrupted { "-" } else { "failed" };
    let rows = columns.first().map_or(0, |c| c.tasks.len());
    for row in 0..rows {
        let values: Vec<Option<f64>> =
            columns.iter().map(|c| c.tasks.get(row).and_then(|t| t.precision)).collect();
        let cis: Vec<Option<f64>> =
            columns.iter().map(|c| c.tasks.get(row).and_then(|t| t.ci95)).collect();
        let name = columns.first().and_then(|c| c.tasks.get(row)).map_or("", |t| t.name.as_str());
        let floor = has_floor.then(|| floors.get(row).copied().flatten().map_or("-".into(), short));
        let interrupted =
            |c: &&Evaluation| c.tasks.get(row).is_some_and(CaseResult::is_interrupted);
        let missing: Vec<&str> = columns.iter().map(|c| word(interrupted(c))).collect();
        t.add_row(cells(name, &values, &cis, &missing).into_iter().chain(floor));
    }
    let means: Vec<Option<f64>> = columns.iter().map(|c| c.precision_mean).collect();
    let cis: Vec<Option<f64>> = columns.iter().map(|c| c.ci95).collect();
    let interrupted = |c: &&Evaluation| c.tasks.iter().any(CaseResult::is_interrupted);
    let missing: Vec<&str> = columns.iter().map(|c| word(interrupted(c))).collect();
    t.add_row(cells("mean", &means, &cis, &missing));
    // Figures of some tasks only cannot stand beside those of all.
    let is_whole = |c: &Evaluation| c.tasks.iter().all(|t| t.error.is_none());
    for (name, figure) in FIGURES {
        let cells: Vec<Option<String>> =
            columns.iter().map(|c| figure(c).filter(|_| is_whole(c))).collect();
        if cells.iter().any(Option::is_some) {
            let cells = cells.into_iter().map(|c| c.unwrap_or_else(|| "-".to_owned()));
            t.add_row(std::iter::once(name.to_owned()).chain(cells));
        }
    }
    let ms_per_frame = |t: &CaseResult| Some(1e3 * t.wall_secs / t.frames.max(1) as f64);
    let averages: [(&str, TaskFigure); 2] =
        [("mean |du|", |t| t.mean_abs_du), ("ms per frame", ms_per_frame)];
    for (name, figure) in averages {
        let cells = columns.iter().map(|c| average(c, figure).filter(|_| is_whole(c)));
        let cells = cells.map(|v| v.map_or_else(|| "-".to_owned(), |v| format!("{v:.3}")));
        t.add_row(std::iter::once(name.to_owned()).chain(cells));
    }
    out::right(&mut t, 1);
    let plant =
        if plant == PlantRange::default() { String::new() } else { format!(", plant {plant}") };
    let mut text = format!(
        "{} {suite}: Precision in {unit} (mean |error| over unmasked frames; lower is better){plant}\n{t}\n* best in the row",
        robot.id()
    );
    if columns.iter().any(|c| c.uses_model) {
        text.push_str("; (m) uses a model of the robot");
    }
    if has_floor {
        text.push_str("; floor: iLQR, which knows the model");
    }
    if columns.iter().any(|c| c.tasks.iter().any(|t| t.gap.is_some())) {
        text.push_str(
            "\ngaps: mean (worst); path relative to the straight line, jerk relative to the minimum, overshoot beyond its allowance",
        );
    }
    for c in &columns {
        for task in &c.tasks {
            if let Some(e) = task.error.as_ref().filter(|_| !task.is_interrupted()) {
                write!(text, "\n{} {}: {e}", c.policy, task.name).ok();
            }
        }
    }
    text
}

/// A figure of a policy that is printed below its Precisions; `None` if it was not measured.
type PolicyFigure = fn(&Evaluation) -> Option<String>;

/// A figure of a task.
type TaskFigure = fn(&CaseResult) -> Option<f64>;

const FIGURES: [(&str, PolicyFigure); 7] = [
    ("over the floor", |e| e.excess_mean.map(|x| format!("{:+.0} %", 100.0 * x))),
    ("moving", |e| mean_of(e, |t| t.moving).map(short)),
    ("gap path", |e| {
        let worst = worst_of(e, |t| t.gap.as_ref()?.path_worst.as_ref().map(|w| w.value));
        spread(mean_of(e, |t| t.gap.as_ref()?.path), worst)
    }),
    ("gap overshoot", |e| {
        e.tasks.iter().any(|t| t.gap.is_some()).then(|| {
            let worst = |by_contact: bool| {
                worst_of(e, |t| {
                    let overshoot = t.gap.as_ref()?.overshoot.as_ref()?;
                    (overshoot.by_contact == by_contact).then_some(overshoot.value)
                })
            };
            match (worst(false), worst(true)) {
                (Some(worst), _) => format!("{worst:.3}"),
                (None, Some(worst)) => format!("{worst:.3} by touch"),
                (None, None) => "none".to_owned(),
            }
        })
    }),
    ("gap jerk", |e| {
        let worst = worst_of(e, |t| t.gap.as_ref()?.jerk_worst.as_ref().map(|w| w.value));
        spread(mean_of(e, |t| t.gap.as_ref()?.jerk), worst)
    }),
    ("gap error / a cubic's", |e| {
        mean_of(e, |t| t.gap.as_ref()?.to_cubic).map(|x| format!("{x:.2}"))
    }),
    ("jams", |e| {
        let jams: Vec<usize> =
            e.tasks.iter().filter_map(|t| Some(t.jams.as_ref()?.len())).collect();
        (!jams.is_empty()).then(|| jams.iter().sum::<usize>().to_string())
    }),
];

/// Mean over the tasks that have it.
fn mean_of(e: &Evaluation, f: impl Fn(&CaseResult) -> Option<f64>) -> Option<f64> {
    let values: Vec<f64> = e.tasks.iter().filter_map(f).collect();
    mean_ci95(&values).map(|i| i.mean)
}

fn worst_of(e: &Evaluation, f: impl Fn(&CaseResult) -> Option<f64>) -> Option<f64> {
    e.tasks.iter().filter_map(f).max_by(f64::total_cmp)
}

fn spread(mean: Option<f64>, worst: Option<f64>) -> Option<String> {
    Some(format!("{:.2} ({:.2})", mean?, worst?))
}

/// A row of Precisions, with a mark at the best one; `missing` stands where there is none.
fn cells(name: &str, values: &[Option<f64>], cis: &[Option<f64>], missing: &[&str]) -> Vec<String> {
    let best = values.iter().flatten().copied().min_by(f64::total_cmp);
    let mut cells = vec![name.to_owned()];
    for ((v, ci), missing) in values.iter().zip(cis).zip(missing) {
        cells.push(match v {
            None => (*missing).to_owned(),
            Some(v) => {
                let mark = if values.len() > 1 && Some(*v) == best { "* " } else { "" };
                let ci = ci.map_or_else(String::new, |c| format!(" ±{c:.5}"));
                format!("{mark}{}{ci}", short(*v))
            }
        });
    }
    cells
}

/// Five decimals. An error that would round to zero is shown as `<0.00001`.
fn short(v: f64) -> String {
    if v > 0.0 && v < 5e-6 { "<0.00001".to_owned() } else { format!("{v:.5}") }
}

/// Mean over all tasks; `None` if one of them has none.
fn average(e: &Evaluation, f: impl Fn(&CaseResult) -> Option<f64>) -> Option<f64> {
    let values: Option<Vec<f64>> = e.tasks.iter().map(f).collect();
    values.and_then(|v| mean_ci95(&v)).map(|i| i.mean)
}

fn rows_csv(results: &[Evaluation]) -> Outcome<Vec<u8>> {
    let mut w = csv::Writer::from_writer(Vec::new());
    let head = [
        "suite",
        "task",
        "policy",
        "uses_model",
        "plant",
        "precision",
        "ci95",
        "floor",
        "excess",
        "moving",
        "gap_path",
        "gap_overshoot",
        "gap_jerk",
        "jams",
        "masked_mae",
        "p95",
        "hold_end",
        "frames_late",
        "mean_abs_du",
        "wall_secs",
        "frames",
        "error",
    ];
    w.write_record(head).map_err(io::Error::other)?;
    let cell = |v: Option<f64>| v.map_or_else(String::new, |v| v.to_string());
    for r in results {
        for t in &r.tasks {
            let ran = !t.is_interrupted();
            w.write_record([
                r.suite.clone(),
                t.name.clone(),
                r.policy.clone(),
                r.uses_model.to_string(),
                r.plant.clone().unwrap_or_default(),
                cell(t.precision),
                cell(t.ci95),
                cell(t.floor),
                cell(t.excess),
                cell(t.moving),
                cell(t.gap.as_ref().and_then(|g| g.path)),
                cell(t.gap.as_ref().and_then(|g| Some(g.overshoot.as_ref()?.value))),
                cell(t.gap.as_ref().and_then(|g| g.jerk)),
                t.jams.as_ref().map_or_else(String::new, |j| j.len().to_string()),
                cell(t.masked_mae),
                cell(t.p95),
                cell(t.hold_end),
                cell(t.frames_late),
                cell(t.mean_abs_du),
                cell(ran.then_some(t.wall_secs)),
                if ran { t.frames.to_string() } else { String::new() },
                t.error.clone().unwrap_or_default(),
            ])
            .map_err(io::Error::other)?;
        }
    }
    Ok(w.into_inner().map_err(|e| io::Error::other(e.to_string()))?)
}

fn errors_csv(results: &[Evaluation]) -> Outcome<Vec<u8>> {
    let mut w = csv::Writer::from_writer(Vec::new());
    w.write_record(["suite", "task", "policy", "frame", "error"]).map_err(io::Error::other)?;
    for r in results {
        for t in &r.tasks {
            for (frame, error) in t.per_frame.iter().enumerate() {
                let Some(error) = error else { continue };
                w.write_record([
                    &r.suite,
                    &t.name,
                    &r.policy,
                    &frame.to_string(),
                    &error.to_string(),
                ])
                .map_err(io::Error::other)?;
            }
        }
    }
    Ok(w.into_inner().map_err(|e| io::Error::other(e.to_string()))?)
}
