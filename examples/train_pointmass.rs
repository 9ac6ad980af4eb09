//! Run with `cargo run --release --example train_pointmass -- data/pointmass`
//!
//! Trains a tiny policy on a collected dataset (`robert collect --robot pointmass
//! --transitions 300000 --out data/pointmass`), then controls the simulated robot with it in its
//! own control loop: read the state, give the network its window, apply the action.

use std::path::Path;

use robert::dataset::{Dataset, Verify};
use robert::mujoco::Data;
use robert::net::{COMMAND, CURRENT, NetPolicy, NetPolicyConfig, WINDOW, checkpoint};
use robert::progress::{Cancel, Silent};
use robert::robot::Robot;
use robert::train::{Options, TrainConfig, paths, train};
use robert::units::SUBSTEPS;

type Failure = Box<dyn std::error::Error>;

/// Frames from one goal to the next; those between have no goals.
const STRIDE: usize = 20;
/// The goals, m.
const GOALS: [[f64; 2]; 5] = [[0.1, 0.0], [0.1, 0.1], [0.0, 0.1], [-0.1, 0.0], [0.0, 0.0]];

fn main() -> Result<(), Failure> {
    let data = std::env::args().nth(1).ok_or("give a dataset folder")?;
    let run = Path::new("runs/example");
    teach(Path::new(&data), run)?;
    let model = checkpoint::load(&paths::model(run), None)?;
    let mut policy = NetPolicy::new(model.net, model.encoder, NetPolicyConfig::default())?;
    for (goal, reached) in GOALS.iter().zip(perform(&mut policy)?) {
        println!("asked for {goal:?} m, was at {reached:.4?} m");
    }
    Ok(())
}

/// Takes about a minute on two cores; a second call continues where the first ended.
fn teach(data: &Path, run: &Path) -> Result<(), Failure> {
    let data = Dataset::open(data, Verify::Full)?;
    let mut cfg = TrainConfig::preset("pm-tiny")?;
    cfg.set("batch=64")?;
    cfg.set("steps=1000")?;
    let cancel = Cancel::default();
    let options = Options {
        dir: run.to_owned(),
        threads: 2,
        checkpoint_secs: 30.0,
        evaluations: 4,
        patience: 0,
        progress: &Silent,
        cancel: &cancel,
        evaluator: None,
        perform: None,
        engines: None,
        linear: None,
        meta: serde_json::Value::Null,
    };
    let done = train(&data, &cfg, options)?;
    if done.windows_per_sec == 0.0 {
        println!("{} is already trained; remove it to train again", run.display());
    } else {
        println!("{:.0} windows/s", done.windows_per_sec);
    }
    let clear = done.held_out.and_then(|h| h.nmse_clear);
    println!("held-out action error away from stops, share of variance: {clear:.4?}");
    Ok(())
}

/// The loop. Returns where the robot was at the time of each goal.
fn perform(policy: &mut NetPolicy) -> Result<Vec<Vec<f64>>, Failure> {
    let robot = Robot::builtin("pointmass")?;
    let mut plant = Data::new(robot.model())?;
    let s = robot.state_dim();
    // The history is filled with the current state.
    let mut past = vec![robot.state(&plant); CURRENT + 1];
    let mut met = Vec::new();
    for frame in 0..STRIDE * GOALS.len() {
        let mut q = vec![0.0_f32; WINDOW * s];
        let mut visible = vec![false; WINDOW * s];
        for (to, &x) in q.iter_mut().zip(past.iter().flatten()) {
            *to = x as f32;
        }
        visible[..(CURRENT + 1) * s].fill(true);
        for ahead in 1..=COMMAND {
            let at = frame + ahead;
            let Some(goal) = GOALS.get((at / STRIDE).wrapping_sub(1)) else { continue };
            if at.is_multiple_of(STRIDE) {
                let row = (CURRENT + ahead) * s..(CURRENT + ahead + 1) * s;
                q[row.clone()].iter_mut().zip(goal).for_each(|(to, &x)| *to = x as f32);
                visible[row].fill(true);
            }
        }
        let action = policy.act(&q, &visible, frame as u64);
        let action: Vec<f64> = action.iter().map(|&a| f64::from(a).clamp(-1.0, 1.0)).collect();
        robot.apply_action(&mut plant, &action)?;
        plant.step(SUBSTEPS)?;
        past.remove(0);
        past.push(robot.state(&plant));
        if (frame + 1).is_multiple_of(STRIDE) {
            met.push(robot.state(&plant));
        }
    }
    Ok(met)
}
