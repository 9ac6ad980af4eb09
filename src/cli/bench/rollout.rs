//! `robert bench rollout`: processor time of a policy, against bare simulation of the same frames.

use std::sync::Arc;

use serde::Serialize;

use super::clock::{median, thread_cpu};
use crate::cli::failure::{Failure, Outcome};
use crate::cli::{motion, out};
use crate::clip;
use crate::mujoco::Data;
use crate::progress::Cancel;
use crate::robot::Robot;
use crate::rollout::{ClipFacts as _, Guide, PolicyConfig, Rollout, RolloutConfig, Start};
use crate::units::SUBSTEPS;

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert bench rollout --clip fire,ur5e/reacher --policy computed-torque,ilqr --json"
)]
pub(super) struct Args {
    /// Clip files or built-in tasks.
    #[arg(long, value_delimiter = ',', default_values = ["pointmass/circle", "ur5e/reacher", "shadow_hand/fire"])]
    clip: Vec<String>,
    /// Policies, with suffixes +guide and +refine.
    #[arg(long, value_delimiter = ',', default_values = ["zero", "pd", "computed-torque", "ilqr", "predictive-sampling"])]
    policy: Vec<String>,
    /// Turns; the figures are medians over them.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u16).range(1..=1000))]
    turns: u16,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
}

/// Milliseconds of processor time a frame.
#[derive(Serialize)]
struct Row {
    clip: String,
    robot: String,
    policy: String,
    frames: usize,
    ms_per_frame: f64,
    /// Time of the bare simulation of the same frames with the same controls.
    sim_ms_per_frame: f64,
    /// Time of the policy divided by that of the bare simulation, median over turns.
    ratio_to_sim: f64,
}

pub(super) fn run(args: &Args) -> Outcome {
    let policies: Vec<PolicyConfig> = args
        .policy
        .iter()
        .map(|p| motion::policy(p, Guide::None, false))
        .collect::<Outcome<_>>()?;
    let mut rows = Vec::new();
    for name in &args.clip {
        let clip = motion::clip(name, None)?;
        let robot = motion::robot_for(None, &clip.robot.id)?;
        let command = robot.compile(&clip).map_err(|e| Failure::invalid(format!("{name}: {e}")))?;
        for policy in &policies {
            let row = measure(&robot, policy, &command, usize::from(args.turns))?;
            rows.push(Row { clip: name.clone(), ..row });
        }
    }
    if args.json {
        return out::json(&serde_json::json!({ "turns": args.turns, "results": rows }));
    }
    let mut t = out::table(&["clip", "policy", "ms a frame", "bare simulation", "ratio"]);
    for r in &rows {
        t.add_row([
            r.clip.clone(),
            r.policy.clone(),
            format!("{:.3}", r.ms_per_frame),
            format!("{:.3}", r.sim_ms_per_frame),
            format!("{:.2}", r.ratio_to_sim),
        ]);
    }
    out::line(&format!("processor time, medians of {} turns\n{t}", args.turns))
}

/// Rollout and replay in turns, so that what slows the machine slows both.
fn measure(
    robot: &Arc<Robot>,
    policy: &PolicyConfig,
    command: &clip::Command,
    turns: usize,
) -> Outcome<Row> {
    let (mut rollouts, mut sims, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
    let mut frames = 0;
    for turn in 0..=turns {
        let config = RolloutConfig { guide: policy.guide, ..RolloutConfig::default() };
        let built = policy.build(robot)?;
        let mut rollout = Rollout::new(robot, built, command, Start::Pose, config)?;
        let begin = thread_cpu();
        rollout.run(&Cancel::default())?;
        let cost = (thread_cpu() - begin).as_secs_f64();
        frames = rollout.frame();
        let sim = replay(robot, &rollout)?;
        // The first turn warms caches and is not counted.
        if turn > 0 {
            rollouts.push(1e3 * cost / frames as f64);
            sims.push(1e3 * sim / frames as f64);
            ratios.push(cost / sim.max(1e-9));
        }
    }
    Ok(Row {
        clip: String::new(),
        robot: robot.id().to_owned(),
        policy: policy.label(),
        frames,
        ms_per_frame: median(&mut rollouts),
        sim_ms_per_frame: median(&mut sims),
        ratio_to_sim: median(&mut ratios),
    })
}

/// Processor seconds of stepping through a rollout's controls and nothing else.
fn replay(robot: &Arc<Robot>, rollout: &Rollout) -> Outcome<f64> {
    let dim = robot.state_dim();
    let controls: Vec<Vec<f64>> = rollout
        .actions()
        .chunks_exact(robot.action_dim())
        .map(|a| robot.ctrl_of(a))
        .collect::<Result<_, _>>()?;
    let mut data = Data::new(robot.model())?;
    robot.write_state(&mut data, &rollout.reached()[..dim])?;
    let begin = thread_cpu();
    for ctrl in &controls {
        data.set_ctrl(ctrl)?;
        data.step(SUBSTEPS)?;
    }
    let secs = (thread_cpu() - begin).as_secs_f64();
    // Another motion would be another cost.
    let end = robot.state(&data);
    let reached = &rollout.reached()[rollout.reached().len() - dim..];
    if end != reached {
        return Err(Failure::with(crate::exit::Exit::Failed, "the replay left the rollout's path"));
    }
    Ok(secs)
}
