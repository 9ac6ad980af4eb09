//! `robert train`: trains a policy on collected motion.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::bar::Bar;
use super::eval::AT_ONCE;
use super::failure::{Failure, Outcome};
use super::global::{Global, Threads};
use super::interrupt::cancel_on_ctrl_c;
use super::{device, motion, out, output};
use crate::dataset::{Dataset, Verify};
use crate::exit::Exit;
use crate::gpu::GpuForwards;
use crate::net::forward::Forwards;
use crate::train::evaluator::SuiteEvaluator;
use crate::train::hindsight::Simulated;
use crate::train::{
    Evaluate, Finished, Options, PRESETS, TrainConfig, began_with, began_with_evaluations,
    read_config, train,
};

/// Evaluations of a run that does not say how many.
const EVALUATIONS: u64 = 20;

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert train --robot ur5e --data data/ur5e --out runs/first\n  robert train --robot ur5e --data data/ur5e --preset instant --out runs/linear\n  robert train --robot ur5e --data data/ur5e --preset ur-small --set lr=5e-4 --out runs/b\n  robert train --resume runs/b\n  robert train --robot ur5e --data data/ur5e --preset paper-ur5e --device gpu --half"
)]
pub(super) struct Args {
    /// The robot of the data.
    #[arg(long, value_name = "ID|DIR", required_unless_present = "resume")]
    robot: Option<String>,
    /// Dataset folder.
    #[arg(long, value_name = "DIR", required_unless_present = "resume")]
    data: Option<PathBuf>,
    /// Settings to start from.
    #[arg(long, default_value = "quick", long_help = format!("Settings to start from:\n{}", presets()))]
    preset: String,
    /// Change one setting; may be repeated.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Rounds of self-correction, in which the network performs tasks from its own data and learns
    /// from the reached motion.
    #[arg(long, value_name = "N")]
    self_correct: Option<u64>,
    /// Directory for a new run [default: runs/TIME-ROBOT-PRESET].
    #[arg(short, long, value_name = "RUN")]
    out: Option<PathBuf>,
    /// Directory of a run to continue, with its own settings, robot and data.
    #[arg(long, value_name = "RUN", conflicts_with_all = ["out", "set", "preset", "self_correct"])]
    resume: Option<PathBuf>,
    #[command(flatten)]
    threads: Threads,
    #[command(flatten)]
    on: device::On,
    /// Minutes between checkpoints.
    #[arg(long, default_value_t = 2.0)]
    checkpoint_mins: f64,
    /// Number of evaluations by rollout, spread over the run; 0 keeps the last model only [default: 20, or
    /// that of the run that is continued].
    #[arg(long, value_name = "N")]
    evaluations: Option<u64>,
    /// Print one JSON document at the end.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args, global: Global) -> Outcome {
    let Plan { dir, cfg, robot: given, data, evaluations } = plan(args)?;
    let robot = motion::robot(&given)?;
    let data = Dataset::open(&data, Verify::Full)?;
    data.must_be_of(&robot)?;
    let request = args.on.request()?;
    let threads = args.threads.count();
    let selecting = |e: SuiteEvaluator| e.selecting(&cfg, &data);
    let mut evaluator = SuiteEvaluator::new(Arc::clone(&robot), threads)
        .and_then(|e| e.map(selecting).transpose())
        .map_err(Failure::invalid)?;
    // If there is no card, the engine says so.
    let device = args.on.device.forwards(AT_ONCE).ok().flatten().map(Arc::new);
    if let Some(device) = &device {
        let forwards: Arc<dyn Forwards + Send> = Arc::<GpuForwards>::clone(device);
        evaluator = evaluator.map(|e| e.on(forwards, AT_ONCE));
    }
    let mut perform = Simulated { robot: Arc::clone(&robot), threads };
    let bar = Bar::new("train", "steps", global.quiet);
    let cancel = cancel_on_ctrl_c();
    let options = Options {
        dir: dir.clone(),
        threads,
        checkpoint_secs: 60.0 * args.checkpoint_mins,
        evaluations,
        patience: 0,
        progress: &bar,
        cancel: &cancel,
        perform: Some(&mut perform),
        evaluator: evaluator.as_mut().map(|j| j as &mut dyn Evaluate),
        engines: Some(&request),
        linear: None,
        meta: serde_json::json!({
            "version": env!("CARGO_PKG_VERSION"),
            "argv": std::env::args().collect::<Vec<_>>(),
            "threads": threads,
            "robot": given,
        }),
    };
    let done = train(&data, &cfg, options);
    bar.finish();
    for note in device.iter().flat_map(|d| d.notes()) {
        tracing::warn!("in evaluations {note}");
    }
    let done = done?;
    if args.json {
        out::json(&serde_json::json!({"dir": dir, "result": done}))?;
    } else {
        out::line(&summary(&dir, &done))?;
    }
    if done.interrupted {
        let hint = format!(
            "stopped at step {}; continue: robert train --resume {}",
            done.step,
            dir.display()
        );
        return Err(Failure::with(Exit::Interrupted, hint));
    }
    Ok(())
}

/// What is trained, and where.
struct Plan {
    dir: PathBuf,
    cfg: TrainConfig,
    /// As given, now or when the run began.
    robot: String,
    data: PathBuf,
    evaluations: u64,
}

fn plan(args: &Args) -> Outcome<Plan> {
    if !(args.checkpoint_mins.is_finite() && args.checkpoint_mins >= 0.0) {
        return Err(Failure::usage("--checkpoint-mins takes 0 or more"));
    }
    if let Some(dir) = &args.resume {
        let cfg = read_config(dir)?;
        let (robot, data) = began_with(dir).unzip();
        let missing = |what| {
            Failure::usage(format!("{} does not say its {what}: add --{what}", dir.display()))
        };
        return Ok(Plan {
            dir: dir.clone(),
            cfg,
            robot: args.robot.clone().or(robot).ok_or_else(|| missing("robot"))?,
            data: args.data.clone().or(data).ok_or_else(|| missing("data"))?,
            evaluations: args.evaluations.or(began_with_evaluations(dir)).unwrap_or(EVALUATIONS),
        });
    }
    let (Some(robot), Some(data)) = (args.robot.clone(), args.data.clone()) else {
        return Err(Failure::usage("--robot and --data are needed"));
    };
    let mut cfg = TrainConfig::preset(&args.preset)?;
    for assignment in &args.set {
        cfg.set(assignment)?;
    }
    if let Some(rounds) = args.self_correct {
        cfg.set(&format!("self_correct={rounds}"))?;
    }
    cfg.check_network()?;
    let dir = args.out.clone().unwrap_or_else(|| {
        let now = chrono::Utc::now().format("%Y%m%d-%H%M%S");
        let robot = Path::new(&robot).file_name().unwrap_or_default().to_string_lossy();
        PathBuf::from(format!("runs/{now}-{robot}-{}", cfg.preset))
    });
    output::may_be_folder(&dir)?;
    if dir.join("config.toml").exists() {
        return Err(Failure::usage(format!(
            "there is already a run; choose another --out, or continue it: robert train --resume {}",
            dir.display()
        )));
    }
    let evaluations = args.evaluations.unwrap_or(EVALUATIONS);
    Ok(Plan { dir, cfg, robot, data, evaluations })
}

fn summary(dir: &Path, done: &Finished) -> String {
    let mut text = if done.steps == 0 {
        "fitted the linear prediction; no network was trained".to_owned()
    } else {
        format!(
            "{} of {} steps in {:.0} s, {:.0} windows/s{}",
            done.step,
            done.steps,
            done.secs,
            done.windows_per_sec,
            done.device.as_ref().map(|d| format!(" on {d}")).unwrap_or_default()
        )
    };
    if let Some(held) = &done.held_out {
        let at = |k: usize| out::number(held.nmse_by_hidden.get(k).copied().flatten(), 3);
        let place = |x: Option<f64>| out::number(x, 4);
        let share = |i: usize| 100.0 * held.shares[i];
        write!(
            text,
            "\nheld-out action error, share of variance, next frame known: {} clear ({:.0} % of frames), {} at a stop ({:.0} %), {} in contact ({:.0} %); 4 / 16 frames hidden: {} / {}",
            place(held.nmse_clear), share(0), place(held.nmse_stop), share(1), place(held.nmse_contact), share(2), at(4), at(16)
        )
        .ok();
    }
    if let Some((step, precision)) = done.best {
        write!(text, "\nbest Precision {precision:.5} at step {step}").ok();
        if let Some(linear) = done.linear {
            write!(text, ", the linear prediction that it starts from {linear:.5}").ok();
        }
        if step == 0 && done.steps > 0 {
            text.push_str(
                ": no evaluation was better, so best.safetensors contains the linear prediction",
            );
        }
    }
    if done.skipped > 0 {
        write!(
            text,
            "\n{} steps were skipped, because their loss or gradient was not finite",
            done.skipped
        )
        .ok();
    }
    write!(text, "\nuse it: robert rollout CLIP --policy robert:{}", dir.display()).ok();
    text
}

/// Presets for help texts.
fn presets() -> String {
    let lines: Vec<_> = PRESETS.iter().map(|(name, what)| format!("  {name:16} {what}")).collect();
    lines.join("\n")
}
