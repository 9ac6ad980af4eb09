//! Run with: cargo run --example author_and_roll_out
//!
//! Builds a clip in code (two poses of the arm with open frames between), performs it with a
//! planner, and prints the error.

use std::sync::Arc;

use robert::clip::{Clip, Key, RobotRef, compile};
use robert::progress::Cancel;
use robert::robot::Robot;
use robert::rollout::{PolicyConfig, PolicyName, Precision, Rollout, RolloutConfig, Start};

type Failure = Box<dyn std::error::Error>;

/// From upright to the left and back to upright: 3.5 s.
fn author(robot: &Robot) -> Result<Clip, Failure> {
    let joints = robot.joints().iter();
    let reference = RobotRef {
        id: robot.id().to_owned(),
        joints: joints.map(|j| j.name.clone()).collect(),
        ..RobotRef::default()
    };
    let mut clip = Clip::new(reference, 71);
    clip.name = "lean and return".into();
    for name in ["upright", "elbow_left"] {
        let pose = robot.pose(name)?.into_iter().map(Some).collect();
        clip.poses.insert(name.to_owned(), pose);
    }
    clip.keys = vec![
        Key::posed(0, "upright"),
        Key::posed(20, "elbow_left").held(15),
        Key::posed(55, "upright").held(16),
    ];
    Ok(clip)
}

pub fn roll_out() -> Result<Precision, Failure> {
    let robot = Arc::new(Robot::builtin("ur5e")?);
    let clip = author(&robot)?;
    println!("{}", clip.to_text());

    let policy = PolicyConfig::new(PolicyName::ComputedTorque).build(&robot)?;
    let command = compile(&clip)?;
    let mut rollout =
        Rollout::new(&robot, policy, &command, Start::Pose, RolloutConfig::default())?;
    rollout.run(&Cancel::default())?;
    Ok(rollout.precision())
}

pub fn main() {
    match roll_out() {
        Ok(p) => {
            println!("Precision {:.5} rad", p.precision.unwrap_or(f64::NAN));
            for hold in &p.holds {
                println!("hold at frame {}: {:.5} rad at its end", hold.frame, hold.end_error);
            }
        }
        Err(e) => eprintln!("error: {e}"),
    }
}
