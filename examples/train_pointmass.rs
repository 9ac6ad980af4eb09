//! Run with `cargo run --release --example train_pointmass -- data/pointmass`
//!
//! Trains a tiny policy on a collected dataset and uses it from a control loop of its own.

use std::path::Path;

use robert::dataset::{Dataset, Verify};
use robert::net::{CURRENT, Policy, PolicyConfig, WINDOW, checkpoint};
use robert::progress::{Cancel, Silent};
use robert::train::{Options, TrainConfig, run::paths, train};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let data = std::env::args().nth(1).ok_or("give a dataset folder")?;
    let data = Dataset::open(Path::new(&data), Verify::Full)?;
    let mut cfg = TrainConfig::preset("pm-tiny")?;
    cfg.set("batch=64")?;
    cfg.set("steps=1000")?;
    let cancel = Cancel::default();
    let options = Options {
        dir: "runs/example".into(),
        threads: 2,
        checkpoint_secs: 30.0,
        evaluations: 4,
        progress: &Silent,
        cancel: &cancel,
        judge: None,
        perform: None,
        meta: serde_json::Value::Null,
    };
    let done = train(&data, &cfg, options)?;
    println!("{} windows/s, {:?}", done.windows_per_sec.round(), done.held_out);

    // One step of a control loop: 30 frames of history, now, and one goal 10 frames ahead.
    let model = checkpoint::load(&paths::model(Path::new("runs/example")), None)?;
    let joints = model.card.robot.joints.len();
    let mut policy = Policy::new(model.net, model.encoder, PolicyConfig::default())?;
    let mut q = vec![0.0; WINDOW * joints];
    let mut visible = vec![true; WINDOW * joints];
    visible[(CURRENT + 1) * joints..].fill(false);
    let goal = (CURRENT + 10) * joints..(CURRENT + 11) * joints;
    q[goal.clone()].fill(0.2);
    visible[goal].fill(true);
    println!("apply {:?}", policy.act(&q, &visible, 0));
    Ok(())
}
