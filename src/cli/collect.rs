//! `robert collect`: record motion by noise, babbling or exploring agents.

use std::path::PathBuf;
use std::sync::Arc;

use super::bar::Bar;
use super::failure::Outcome;
use super::global::{Global, Threads};
use super::{dataset, dataset_plot, interrupt, out, output};
use crate::explore::{AgentKind, CollectConfig, Collected, Preset, begun, collect};
use crate::plot::Theme;
use crate::robot::{PlantRange, Robot};
use crate::units::count;

/// The chart of visited states, a file in the dataset.
const COVERAGE: &str = "coverage.png";

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert collect --robot ur5e --agent noise --transitions 400k --out data/ur5e-noise\n  robert collect --robot ur5e --agent rnd,icm,apt,aps,proto --transitions 3M --out data/ur5e\n  robert collect --robot ur5e --agent rnd --agent-steps 2k --transitions 5k --out data/try\n  robert collect --robot ur5e --plants mass=0.7..1.4,damping=0.5..2,gear=0.7..1.3 --out data/many\n  robert collect --robot ur5e --agent rnd --transitions 1M --agents-from data/rnd --out data/rnd1m\n\nThe data depend on the options only, not on threads, interruptions or order. To continue a stopped\ncollection, repeat the command with --resume; --robot and --out are enough."
)]
pub(super) struct Args {
    /// Robot: id, or a folder with robot.xml.
    #[arg(long)]
    robot: String,
    /// The collectors, with equal shares: rnd, icm, apt, aps, proto, noise, babble, uniform
    /// [default: noise for a built-in robot, babble for another one that it can drive].
    #[arg(long, value_delimiter = ',')]
    agent: Vec<AgentKind>,
    /// Frames to record in total, such as 400k or 2.5M [default: 400k].
    #[arg(long, value_name = "N", value_parser = count)]
    transitions: Option<u64>,
    /// Dataset folder.
    #[arg(short, long)]
    out: PathBuf,
    /// Environment steps of training per agent [default: the preset's].
    #[arg(long, value_name = "N", value_parser = count)]
    agent_steps: Option<u64>,
    /// Sizes and schedule of the agents: url-fast, or urlb as published, which takes days on a CPU
    /// [default: url-fast].
    #[arg(long)]
    preset: Option<String>,
    /// Change one setting of the preset, as in lr=3e-4; may be repeated.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Seed of all random choices [default: 0].
    #[arg(long)]
    seed: Option<u64>,
    /// Roll out only snapshots from this first share of the training [default: .5 for the UR5e,
    /// whose agents drift to extremes, else 1].
    #[arg(long)]
    snapshots_until: Option<f64>,
    /// Draw a new plant for each recorded episode: ranges of factors on mass, damping and force.
    #[arg(long, value_name = "RANGES")]
    plants: Option<PlantRange>,
    /// Frames of a recorded episode [default: 250].
    #[arg(long, value_name = "N", value_parser = count)]
    episode_frames: Option<u64>,
    /// Use the trained agents of another collection, to record more or fewer transitions. Robot,
    /// preset, steps and seed must be the same. (With one seed the longer collection begins with
    /// the motions of the shorter one, so do not merge the two.)
    #[arg(long, value_name = "DIR")]
    agents_from: Option<PathBuf>,
    /// Continue the collection in the folder with its own options.
    #[arg(long)]
    resume: bool,
    #[command(flatten)]
    threads: Threads,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args, global: Global) -> Outcome {
    let robot = Arc::new(Robot::load(&args.robot)?);
    let config = config(args, &robot)?;
    output::may_be_folder(&args.out)?;
    let threads = args.threads.count();
    let cancel = interrupt::cancel_on_ctrl_c();
    let bar = Bar::new("collect", "steps", global.quiet || args.json);
    let done = collect(&robot, &config, &args.out, args.resume, threads, &bar, &cancel);
    bar.finish();
    let done = done?;
    let coverage = args.out.join(COVERAGE);
    dataset_plot::draw(&args.out, &coverage, &[], false, Theme::Light)?;
    if args.json {
        return json(args, config.seed, &done);
    }
    curves(&done)?;
    dataset::info(&done.manifest, false)?;
    out::line(&format!(
        "{}: training {:.0} s, roll-outs {:.0} s ({:.0} frames/s)",
        args.out.display(),
        done.train_secs,
        done.rollout_secs,
        done.rollout_frames as f64 / done.rollout_secs.max(1e-9),
    ))
}

/// The request: from the options, or from the folder if only `--resume` is given.
fn config(args: &Args, robot: &Robot) -> Outcome<CollectConfig> {
    let said = !args.agent.is_empty()
        || !args.set.is_empty()
        || args.transitions.is_some()
        || args.agent_steps.is_some()
        || args.preset.is_some()
        || args.seed.is_some()
        || args.snapshots_until.is_some()
        || args.plants.is_some()
        || args.episode_frames.is_some()
        || args.agents_from.is_some();
    if args.resume
        && !said
        && let Some(begun) = begun(&args.out)?
    {
        return Ok(begun.config);
    }
    let mut preset = Preset::named(args.preset.as_deref().unwrap_or("url-fast"))?;
    if let Some(steps) = args.agent_steps {
        preset = preset.lasting(steps);
    }
    for assignment in &args.set {
        preset.set(assignment)?;
    }
    let defaults = CollectConfig::new(robot);
    Ok(CollectConfig {
        agents: if args.agent.is_empty() { defaults.agents } else { args.agent.clone() },
        preset,
        transitions: args.transitions.unwrap_or(defaults.transitions),
        seed: args.seed.unwrap_or(defaults.seed),
        episode_frames: args.episode_frames.unwrap_or(defaults.episode_frames),
        snapshots_until: args.snapshots_until.unwrap_or(defaults.snapshots_until),
        plants: args.plants,
        agents_from: args.agents_from.clone(),
    })
}

fn json(args: &Args, seed: u64, done: &Collected) -> Outcome {
    let m = &done.manifest;
    out::json(&serde_json::json!({
        "robot": m.robot.id,
        "out": args.out,
        "seed": seed,
        "agents": done.agents,
        "train_secs": done.train_secs,
        "rollout_secs": done.rollout_secs,
        "rollout_frames": done.rollout_frames,
        "manifest_sha256": m.sha256(),
        "totals": m.totals,
        "statistics": m.statistics,
    }))
}

/// Reward, coverage and frames at stops of each agent over its training.
fn curves(done: &Collected) -> Outcome {
    let head = ["agent", "steps", "updates", "reward", "coverage", "worst joint pinned", "broken"];
    let mut table = out::table(&head);
    let mut any = false;
    for a in &done.agents {
        let (Some(first), Some(last)) = (a.curve.first(), a.curve.last()) else { continue };
        any = true;
        table.add_row([
            a.agent.name().to_owned(),
            a.steps.to_string(),
            a.updates.to_string(),
            format!("{:.3} -> {:.3}", first.reward, last.reward),
            format!("{:.1} % -> {:.1} %", first.coverage * 100.0, last.coverage * 100.0),
            format!("{:.0} % -> {:.0} %", first.pinned() * 100.0, last.pinned() * 100.0),
            a.broken.to_string(),
        ]);
    }
    if any { out::line(&table.to_string()) } else { Ok(()) }
}
