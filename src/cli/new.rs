//! `robert new`: from a foreign robot's file to a policy that performs it, in one command.
//!
//! The steps are: import the file, collect random motion, fit the linear regression `ridge`,
//! which is usable at once, and train the network. Then the network, `ridge` and proportional control
//! perform trial clips. The one with the smallest error is kept in the robot's folder as its own
//! policy. The default `auto` compares it with others for each clip. Each step is the command of that
//! name with its own defaults. A stopped run continues at the step where it was.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use serde_json::{Value, json};

use super::bar::Bar;
use super::failure::{Failure, Outcome};
use super::global::Global;
use super::import::ModelFlags;
use super::interrupt::cancel_on_ctrl_c;
use super::{input, motion, out};
use crate::clip::compile;
use crate::dataset::{Dataset, Verify};
use crate::explore::{CollectConfig, begun, collect};
use crate::fsio;
use crate::net::checkpoint;
use crate::progress::{Cancel, Silent};
use crate::robot::import::{import, mark, mark_in};
use crate::robot::{PROFILE_FILE, PlantRange, Robot};
use crate::rollout::{
    Case, EvalConfig, Evaluation, PolicyConfig, PolicyName, Start, Suite, evaluate, model_path,
    shipped, tasks,
};
use crate::scratch::Scratch;
use crate::train::evaluator::SuiteEvaluator;
use crate::train::fitted_ridge::FittedRidge;
use crate::train::penalty;
use crate::train::read_config;
use crate::train::record::Record;
use crate::train::{ContactTarget, Evaluate, Options, TrainConfig, train};
use crate::units::{Unit, count};

/// Steps of the run that measures the speed of this machine.
const PROBE_STEPS: u64 = 12;
/// Differences between the last frames that `ridge` sees on a robot that drives joints without
/// damping, if it would see fewer.
const UNDAMPED_HISTORY: usize = 6;
/// The share of the given minutes for training steps; the rest is for evaluation.
const PLANNED: f64 = 0.85;
/// Seeds of the trial clips on which policies are compared. The seeds that chose penalty and
/// checkpoint are not among them, because the learned policies would look too good on those.
const CHOOSE: [u64; 2] = [2, 3];
/// Seed of the trial clips of the report.
const REPORT: u64 = 1;
/// Share of frames at a stop above which the report names a joint.
const RESTING: f64 = 0.3;
/// Share of frames with any joint at a stop above which the report says what follows.
const STOPPED: f64 = 0.5;
/// The mean error on trial clips above which the robot is not under control, rad or m.
const FAR: f64 = 0.1;
/// The number of evaluations in a row without improvement after which training ends.
const PATIENCE: u64 = 3;

/// Frames of random motion, if no other number is given.
const TRANSITIONS: u64 = 200_000;

/// As many frames as a fit needs.
fn transitions(text: &str) -> Result<u64, String> {
    const LEAST: u64 = 10_000;
    match count(text)? {
        n if n < LEAST => Err(format!("{n} is too few; at least {LEAST}")),
        n => Ok(n),
    }
}

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert new arm.urdf --out my_arm\n  robert new arm.urdf --out my_arm --package arm_description=../arm_description --minutes 5\n  robert new my_arm --out my_arm --minutes 30 --transitions 1M   (a folder of robert import)\n\nThe folder is a robot for every other command: robert studio --robot my_arm"
)]
pub(super) struct Args {
    /// The model: URDF or MJCF; or the folder that `robert import` made, which is then --out, too.
    file: PathBuf,
    /// The robot's folder; if it exists, the run in it is continued.
    #[arg(short, long)]
    out: PathBuf,
    #[command(flatten)]
    model: ModelFlags,
    /// Frames of random motion to collect, at least 10k; written as 200000, 200k or 2.5M.
    /// [default: 200k, or as many as the folder was begun with]
    #[arg(long, value_parser = transitions)]
    transitions: Option<u64>,
    /// Minutes of training on this machine; 0 stops at `ridge`.
    #[arg(long, default_value_t = 8.0, allow_negative_numbers = true)]
    minutes: f64,
    /// Preset of the network.
    #[arg(long, default_value = "quick")]
    preset: String,
    /// Seed of all random choices.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Print one JSON document at the end.
    #[arg(long)]
    json: bool,
}

/// Folders inside the robot's own.
struct Places {
    data: PathBuf,
    instant: PathBuf,
    run: PathBuf,
    model: PathBuf,
}

impl Places {
    fn of(dir: &Path) -> Self {
        Places {
            data: dir.join("data"),
            instant: dir.join("runs/instant"),
            run: dir.join("runs/robert"),
            model: shipped::path_in(dir, shipped::DEFAULT),
        }
    }
}

/// A week; a longer training is a matter for `robert train`.
const MOST_MINUTES: f64 = 7.0 * 24.0 * 60.0;

pub(super) fn run(args: &Args, global: Global) -> Outcome {
    let minutes = args.minutes;
    if !(0.0..=MOST_MINUTES).contains(&minutes) {
        return Err(Failure::usage(format!("--minutes takes 0 to {MOST_MINUTES}, not {minutes}")));
    }
    if input::is_standard(&args.file) || input::is_pipe(&args.file) {
        return Err(Failure::usage(
            "robert new reads its file again when it goes on: import the model with robert import - first, and name the robot's folder here",
        ));
    }
    let preset = TrainConfig::preset(&args.preset)?;
    let begin = Instant::now();
    let since = || begin.elapsed().as_secs_f64();
    let cancel = cancel_on_ctrl_c();
    let threads = super::global::cores();
    let say = |text: &str| {
        if !global.quiet {
            out::aside(text);
        }
    };
    let places = Places::of(&args.out);

    if args.out.join(PROFILE_FILE).is_file() {
        same_source(args)?;
        say(&format!("1 import: {} is there", args.out.display()));
    } else if args.file.join(PROFILE_FILE).is_file() {
        let folder = out::word(&args.file);
        return Err(Failure::usage(format!(
            "{folder} is the folder of an imported robot, and its policy is trained there: robert new {folder} --out {folder}"
        )));
    } else {
        say(&format!("1 import: {} to {}", args.file.display(), args.out.display()));
        let report = import(&args.model.plan(&args.file, &args.out)?)?;
        for (what, list) in [
            ("dropped", &report.dropped),
            ("assumed", &report.assumed),
            ("changed", &report.changed),
            ("warning", &report.warnings),
        ] {
            list.iter().for_each(|item| say(&format!("  {what}  {item}")));
        }
    }
    let robot = Arc::new(Robot::from_folder(&args.out)?);

    let before = begun(&places.data)?.map(|begun| begun.config.transitions);
    let config = CollectConfig {
        transitions: args.transitions.or(before).unwrap_or(TRANSITIONS),
        seed: args.seed,
        ..CollectConfig::new(&robot)
    };
    let who: Vec<&str> = config.agents.iter().map(|a| a.name()).collect();
    say(&format!("2 collect: {} frames by {}", config.transitions, who.join(", ")));
    let bar = Bar::new("collect", "steps", global.quiet);
    let resume = places.data.exists();
    let collected = collect(&robot, &config, &places.data, resume, threads, &bar, &cancel);
    bar.finish();
    // A stop is an error of the collection, which names an option that this command does not have.
    if collected.is_err() {
        go_on(&cancel)?;
    }
    collected?;
    let data = Dataset::open(&places.data, Verify::Full)?;

    describe(&data, &robot).iter().for_each(|line| say(&format!("  {line}")));

    say("3 fit: ridge, with one linear map for each length of gap");
    if !model_path(&places.instant).is_file() {
        let usual = TrainConfig {
            seed: args.seed,
            ridge_history: history(&robot),
            ..TrainConfig::preset("instant")?
        };
        let (cfg, linear) = match evaluator(&robot, threads)? {
            Some(mut judge) => {
                let bar = Bar::new("fit", "parts", global.quiet);
                let chosen = penalty::choose(&data, &usual, threads, &mut judge, &bar, &cancel);
                bar.finish();
                chosen?
            }
            None => (usual, None),
        };
        let options = options(&robot, &places.instant, threads, &Silent, &cancel, None);
        train(&data, &cfg, Options { linear: linear.as_ref(), ..options })?;
        go_on(&cancel)?;
    }
    if !places.model.is_file() {
        pack(&places.instant, &places.model)?;
    }
    let instant_secs = since();
    say(&format!(
        "  usable after {instant_secs:.0} s: robert studio --robot {}",
        out::word(&args.out)
    ));

    // A network of an earlier run in this folder counts, too.
    let mut trained = model_path(&places.run).is_file();
    if minutes > 0.0 {
        say(&format!("4 train: RoBERT, about {minutes} minutes"));
        teach(args, preset, &robot, &data, &places, threads, &cancel, global)?;
        trained = true;
    }

    let last = if args.minutes > 0.0 { 5 } else { 4 };
    say(&format!(
        "{last} compare: trial clips of seeds 2 and 3 choose, those of seed 1 are reported"
    ));
    let found = compare(&robot, &places, trained, REPORT, threads, &cancel, global)?;
    let mut choice = Vec::new();
    for seed in CHOOSE {
        choice.push(compare(&robot, &places, trained, seed, threads, &cancel, global)?);
    }
    // A run whose best step is 0 has only the linear prediction, so it is `ridge` again.
    let gained =
        trained && checkpoint::load(&model_path(&places.run), None)?.card.training.step > 0;
    if trained && !gained {
        say("  no step of training was nearer than ridge, so robert is the same policy");
    }
    // The network comes first, because it has learned more than the clips demand.
    let learned = if gained { nearest(&choice, &["robert", "ridge"]) } else { "ridge" };
    let kept = nearest(&choice, &[learned, "pd"]);
    keep(kept, learned, &places, &args.out)?;
    let error = mean_of(&choice, kept);
    if error.is_none_or(|e| e > FAR) {
        let how = error.map_or_else(
            || "fails on a trial clip".to_owned(),
            |e| format!("is {e:.2} {} away from the trial clips on average", motion::unit(&robot)),
        );
        tracing::warn!(
            "{kept}, the best policy, {how}: the robot is not under control. Its motors may be \
             too weak for it, or too few; robert import and robert robots show name what was assumed"
        );
    }
    report(args, &robot, &found, &choice, kept, [instant_secs, since()])
}

/// Refuses to go on in the folder of another model, or of one that was imported with other options.
fn same_source(args: &Args) -> Outcome {
    let Some(there) = mark_in(&args.out)? else { return Ok(()) };
    let (file, out) = (args.file.display(), args.out.display());
    let other = |id: &String| Robot::from_folder(&args.out).is_ok_and(|r| r.id() != id);
    if args.model.id.as_ref().is_some_and(other) {
        return Err(Failure::invalid(format!(
            "the robot in {out} has another id; choose another --out"
        )));
    }
    let folder = args.out.canonicalize().ok();
    // The folder itself, or a file in it, stands for what is in it.
    if let (Ok(source), Some(folder)) = (args.file.canonicalize(), folder)
        && source.starts_with(&folder)
    {
        if args.model.are_given() {
            return Err(Failure::usage(format!(
                "the robot in {out} is imported already, so options of the import change nothing: leave them out, or import its model again with another --out"
            )));
        }
        return Ok(());
    }
    if mark(&args.model.plan(&args.file, &args.out)?)? == there {
        return Ok(());
    }
    Err(Failure::invalid(format!(
        "{out} was made from another model than {file}, or with other options: choose another --out, or go on with the robot that is there by `robert new {out} --out {out}`"
    )))
}

/// The one of these policies with the smallest error on the trial clips of all seeds; of several
/// that are equally good, the first. A policy that fails on a clip, or did not perform, comes last.
fn nearest<'a>(choice: &[Vec<Evaluation>], names: &[&'a str]) -> &'a str {
    let mean = |name: &str| mean_of(choice, name).unwrap_or(f64::INFINITY);
    names.iter().copied().min_by(|a, b| mean(a).total_cmp(&mean(b))).unwrap_or("ridge")
}

/// The mean error of a policy on the trial clips of all seeds; `None` if it failed on one.
fn mean_of(choice: &[Vec<Evaluation>], name: &str) -> Option<f64> {
    let one = |found: &Vec<Evaluation>| {
        let own = found.iter().find(|e| e.policy == name);
        own.filter(|e| e.tasks.iter().all(|t| t.precision.is_some()))?.precision_mean
    };
    let all: Option<Vec<f64>> = choice.iter().map(one).collect();
    all.map(|all| all.iter().sum::<f64>() / all.len() as f64)
}

/// Makes the policy `kept` the robot's own, and the run of the best `learned` one its model.
/// Proportional control has no model file, so a file in the folder names it as the policy to use.
fn keep(kept: &str, learned: &str, places: &Places, out: &Path) -> Outcome {
    pack(if learned == "robert" { &places.run } else { &places.instant }, &places.model)?;
    let choice = shipped::choice_in(out);
    if kept == "pd" {
        fsio::write_atomic(&choice, b"pd\n")?;
    } else if choice.is_file() {
        std::fs::remove_file(&choice)?;
    }
    Ok(())
}

/// Sentences about the quality of the data: lost episodes, where joints rest, how much of their
/// range was visited.
fn describe(data: &Dataset, robot: &Robot) -> Vec<String> {
    let manifest = data.manifest();
    let (broken, short) = manifest
        .shards
        .iter()
        .fold((0, 0), |(b, s), shard| (b + shard.dropped_broken, s + shard.dropped_short));
    let found = &manifest.statistics;
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let mut lines = vec![format!(
        "{} frames; {broken} episodes broken, {short} too short; a joint at a stop in {}, self-contact in {}; {} of the coarse cells seen",
        manifest.totals.frames,
        percent(found.near_limit_any),
        percent(found.self_contact),
        percent(found.coverage),
    )];
    let resting: Vec<String> = robot
        .joints()
        .iter()
        .zip(&found.near_limit)
        .filter(|(_, share)| **share > RESTING)
        .map(|(j, share)| format!("{} {}", j.name, percent(*share)))
        .collect();
    if !resting.is_empty() {
        lines.push(format!(
            "at a stop, where torque cannot be read from positions: {}",
            resting.join(", ")
        ));
    } else if found.near_limit_any > STOPPED {
        lines.push(
            "some joint is at a stop in most frames, where torque cannot be read from positions: ridge and robert \
             may be worse than pd"
                .to_owned(),
        );
    }
    lines
}

/// Differences between the last frames that `ridge` sees; 0 is what is usual for the robot,
/// which is more than [`UNDAMPED_HISTORY`] if it has an endless slide.
fn history(robot: &Robot) -> usize {
    let endless = robot.joints().iter().any(|j| j.unbounded && j.unit == Unit::M);
    if robot.drives_undamped_joints() && !endless { UNDAMPED_HISTORY } else { 0 }
}

/// Trains for the given time, with the trial clips as evaluator.
fn teach(
    args: &Args,
    preset: TrainConfig,
    robot: &Arc<Robot>,
    data: &Dataset,
    places: &Places,
    threads: usize,
    cancel: &Cancel,
    global: Global,
) -> Outcome {
    // The network's skip is the policy that was fitted before.
    let linear = FittedRidge::of(checkpoint::load(&model_path(&places.instant), None)?);
    let cfg = if places.run.join("config.toml").is_file() {
        let begun = read_config(&places.run)?;
        if (&begun.preset, begun.seed) != (&preset.preset, args.seed) {
            tracing::warn!(
                "{} was begun with --preset {} --seed {} and goes on with them; another --out trains anew",
                places.run.display(),
                begun.preset,
                begun.seed
            );
        }
        begun
    } else {
        let instant = read_config(&places.instant)?;
        let planned = TrainConfig {
            // A robot that babbles rests against itself more than one under noise.
            contact_weight: 1.0,
            contact_target: ContactTarget::Linear,
            seed: args.seed,
            ridge_history: instant.ridge_history,
            ridge_penalty: instant.ridge_penalty,
            leave_pressing: instant.leave_pressing,
            observer: instant.observer,
            ..preset
        };
        // A few steps, which are thrown away, measure the speed of this machine.
        let scratch = Scratch::new().map_err(|e| Failure::with(crate::exit::Exit::Failed, e))?;
        let probe = TrainConfig { steps: PROBE_STEPS, ..planned.clone() };
        let options = options(robot, scratch.path(), threads, &Silent, cancel, None);
        let tried = train(data, &probe, Options { linear: linear.as_ref(), ..options })?;
        go_on(cancel)?;
        let steps = args.minutes * 60.0 * PLANNED * tried.windows_per_sec / planned.batch as f64;
        TrainConfig { steps: (steps as u64).max(50), ..planned }
    };
    let before = Record::read(&places.run).map_or(0, |run| run.step);
    let mut evaluator = evaluator(robot, threads)?;
    let bar = Bar::new("train", "steps", global.quiet);
    let evaluator = evaluator.as_mut().map(|j| j as &mut dyn Evaluate);
    let options = options(robot, &places.run, threads, &bar, cancel, evaluator);
    let done = train(data, &cfg, Options { linear: linear.as_ref(), ..options });
    bar.finish();
    let done = done?;
    if done.interrupted {
        let hint =
            format!("stopped at step {} of {}; the same command goes on", done.step, done.steps);
        return Err(Failure::with(crate::exit::Exit::Interrupted, hint));
    }
    if done.step == before {
        tracing::warn!(
            "{} had ended before, at step {before}, so nothing was trained; another --out trains longer",
            places.run.display()
        );
    }
    Ok(())
}

/// Ends after Ctrl-C, before what was cut short counts as a result.
fn go_on(cancel: &Cancel) -> Outcome {
    if cancel.is_cancelled() {
        let hint = "stopped; the same command goes on";
        return Err(Failure::with(crate::exit::Exit::Interrupted, hint));
    }
    Ok(())
}

/// Performs the trial clips that choose.
fn evaluator(robot: &Arc<Robot>, threads: usize) -> Outcome<Option<SuiteEvaluator>> {
    SuiteEvaluator::new(Arc::clone(robot), threads).map_err(Failure::invalid)
}

fn options<'a>(
    robot: &Robot,
    dir: &Path,
    threads: usize,
    progress: &'a dyn crate::progress::Progress,
    cancel: &'a Cancel,
    evaluator: Option<&'a mut dyn Evaluate>,
) -> Options<'a> {
    Options {
        dir: dir.to_owned(),
        threads,
        checkpoint_secs: 60.0,
        evaluations: if evaluator.is_some() { 8 } else { 0 },
        patience: PATIENCE,
        progress,
        cancel,
        evaluator,
        perform: None,
        engines: None,
        linear: None,
        meta: json!({
            "version": env!("CARGO_PKG_VERSION"),
            "argv": std::env::args().collect::<Vec<_>>(),
            "robot": robot.folder(),
        }),
    }
}

/// A run's best model becomes the robot's own.
fn pack(run: &Path, to: &Path) -> Outcome {
    let mut model = checkpoint::load(&model_path(run), None)?;
    "made by robert new".clone_into(&mut model.card.training.notes);
    Ok(checkpoint::save_half(to, &model)?)
}

/// Evaluates both policies and proportional control on the trial clips of a seed.
fn compare(
    robot: &Arc<Robot>,
    places: &Places,
    trained: bool,
    seed: u64,
    threads: usize,
    cancel: &Cancel,
    global: Global,
) -> Outcome<Vec<Evaluation>> {
    let with = |name, path: &Path| PolicyConfig {
        model_path: Some(path.to_owned()),
        ..PolicyConfig::new(name)
    };
    let mut policies =
        vec![PolicyConfig::new(PolicyName::Pd), with(PolicyName::Ridge, &places.instant)];
    if trained {
        policies.push(with(PolicyName::Robert, &places.run));
    }
    let cases = tasks::trial(robot, seed)?
        .into_iter()
        .map(|task| {
            let command = compile(&task.clip).map_err(Failure::invalid)?;
            Ok(Case {
                name: task.name.to_owned(),
                command,
                start: Start::Pose,
                truth: None,
                floor: None,
            })
        })
        .collect::<Outcome<Vec<_>>>()?;
    let suite = Suite { name: "trial".to_owned(), cases };
    let config = EvalConfig { policies, plant: PlantRange::default(), seeds: 0..1, threads };
    let bar = Bar::new("compare", "frames", global.quiet);
    let found = evaluate(robot, &[suite], &config, &bar, cancel);
    bar.finish();
    Ok(found?)
}

fn report(
    args: &Args,
    robot: &Robot,
    found: &[Evaluation],
    choice: &[Vec<Evaluation>],
    kept: &str,
    [instant_secs, total_secs]: [f64; 2],
) -> Outcome {
    // A policy that was not performed, such as the network with `--minutes 0`, is there as null.
    let mut means: serde_json::Map<String, Value> = ["pd", "ridge", "robert"]
        .map(|policy| (policy.to_owned(), Value::Null))
        .into_iter()
        .collect();
    means.extend(found.iter().map(|e| (e.policy.clone(), json!(e.precision_mean))));
    if args.json {
        let results: Vec<Value> = found.iter().map(|e| json!(e)).collect();
        return out::json(&json!({
            "robot": robot.id(), "folder": args.out, "unit": motion::unit(robot),
            "instant_secs": instant_secs, "total_secs": total_secs,
            "results": results, "kept": kept, "precision": means,
            "chosen_on": found.iter().map(|e| (&e.policy, mean_of(choice, &e.policy))).collect::<BTreeMap<_, _>>(),
        }));
    }
    let unit = format!("Precision, {}", motion::unit(robot));
    let header: Vec<&str> =
        std::iter::once(unit.as_str()).chain(found.iter().map(|e| e.policy.as_str())).collect();
    let mut t = out::table(&header);
    let show = |p: Option<f64>| p.map_or_else(|| "failed".to_owned(), |p| format!("{p:.5}"));
    let rows = found.first().map_or(0, |e| e.tasks.len());
    for row in 0..rows {
        let name = found[0].tasks[row].name.clone();
        let cells = found.iter().map(|e| show(e.tasks.get(row).and_then(|t| t.precision)));
        t.add_row(std::iter::once(name).chain(cells));
    }
    let means = found.iter().map(|e| show(e.precision_mean));
    t.add_row(std::iter::once("mean".to_owned()).chain(means));
    let chose = found.iter().map(|e| show(mean_of(choice, &e.policy)));
    t.add_row(std::iter::once("mean, clips that chose".to_owned()).chain(chose));
    out::line(&t.to_string())?;
    out::line(&format!(
        "usable after {instant_secs:.0} s, done after {total_secs:.0} s; {kept} is kept as the robot's own policy, and `auto`, the default, compares it with others on each clip"
    ))?;
    out::line(&format!("draft with it:  robert studio --robot {}", out::word(&args.out)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn performed(policy: &str, precision_mean: Option<f64>) -> Evaluation {
        Evaluation {
            policy: policy.to_owned(),
            uses_model: false,
            suite: "trial".to_owned(),
            plant: None,
            precision_mean,
            ci95: None,
            excess_mean: None,
            tasks: Vec::new(),
        }
    }

    #[test]
    fn the_nearest_over_all_seeds_is_kept() {
        let seed = |robert, ridge, pd| {
            vec![
                performed("robert", robert),
                performed("ridge", Some(ridge)),
                performed("pd", Some(pd)),
            ]
        };
        let choice = [seed(Some(0.002), 0.005, 0.003), seed(Some(0.003), 0.001, 0.001)];
        assert_eq!(nearest(&choice, &["robert", "ridge"]), "robert");
        assert_eq!(nearest(&choice, &["robert", "pd"]), "pd");
        let equal = [seed(Some(0.002), 0.002, 0.003)];
        assert_eq!(nearest(&equal, &["robert", "ridge"]), "robert");
        let failed = [seed(None, 0.5, 0.6), seed(Some(0.001), 0.5, 0.6)];
        assert_eq!(nearest(&failed, &["robert", "ridge"]), "ridge");
        assert_eq!(nearest(&choice, &["nobody", "pd"]), "pd");
    }
}
