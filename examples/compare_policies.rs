//! Run with: cargo run --example compare_policies -- ur5e/front_back
//!
//! Compares two policies on one built-in task: on the robot of the file, and on one that is
//! heavier, more damped and weaker.

use std::sync::Arc;

use robert::clip::compile;
use robert::progress::Cancel;
use robert::robot::{PlantConfig, Robot};
use robert::rollout::{PolicyConfig, PolicyName, Rollout, RolloutConfig, Start, tasks};

type Failure = Box<dyn std::error::Error>;

const POLICIES: [PolicyName; 2] = [PolicyName::Pd, PolicyName::ComputedTorque];

/// Precision of both policies on each plant.
pub fn compare(task: &str) -> Result<Vec<(String, [f64; 2])>, Failure> {
    let clip = tasks::find(task, None)?;
    let command = compile(&clip)?;
    let robot = Arc::new(Robot::builtin(&clip.robot.id)?);
    let mut rows = Vec::new();
    for plant in [PlantConfig::default(), "mass=1.25,damping=1.5,gear=0.85".parse()?] {
        let mut found = [f64::NAN; 2];
        for (slot, name) in found.iter_mut().zip(POLICIES) {
            let policy = PolicyConfig::new(name).build(&robot)?;
            let config = RolloutConfig { plant, ..RolloutConfig::default() };
            let mut rollout = Rollout::new(&robot, policy, &command, Start::Pose, config)?;
            rollout.run(&Cancel::default())?;
            *slot = rollout.precision().precision.unwrap_or(f64::NAN);
        }
        rows.push((plant.to_string(), found));
    }
    Ok(rows)
}

pub fn main() {
    let task = std::env::args().nth(1).unwrap_or_else(|| "ur5e/front_back".to_owned());
    match compare(&task) {
        Ok(rows) => {
            println!("{:36} {:>16} {:>16}", "plant", POLICIES[0].as_str(), POLICIES[1].as_str());
            for (plant, [a, b]) in rows {
                println!("{plant:36} {a:16.5} {b:16.5}");
            }
        }
        Err(e) => eprintln!("error: {e}"),
    }
}
