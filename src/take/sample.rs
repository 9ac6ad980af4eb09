//! Takes for the tests of this folder.

use std::sync::Arc;

use super::document::{Provenance, Take};
use robert_clip::{Clip, Fill, Key, RobotRef, compile};
use robert_robot::Robot;
use robert_rollout::{PolicyConfig, PolicyName, Rollout, RolloutConfig, Start};

/// Home, a held pose near it, home again; masked between.
pub(super) fn clip(robot: &Robot, frames: u32) -> Clip {
    let joints = robot.joints().iter().map(|j| j.name.clone()).collect();
    let units = robot.joints().iter().map(|j| j.unit).collect();
    let own = RobotRef {
        id: robot.id().to_owned(),
        model_sha256: Some(robot.model_sha256().to_owned()),
        joints,
        units,
        ..RobotRef::default()
    };
    let mut clip = Clip::new(own, frames);
    clip.name = format!("sample of {}", robot.id());
    let home = robot.home();
    let moved: Vec<f64> = robot
        .joints()
        .iter()
        .zip(&home)
        .enumerate()
        .map(|(i, (j, q))| {
            (q + 0.15 * ((i + 1) as f64).cos()).clamp(j.range[0].max(-9.0), j.range[1].min(9.0))
        })
        .collect();
    let third = frames / 3;
    clip.keys = vec![
        Key::new(0, &home),
        Key::new(third, &moved).held(third.max(4) / 2).filled(Fill::Linear),
        Key::new(frames - 1, &home),
    ];
    clip.normalize();
    clip
}

/// The take of [`clip`] by `pd`, with only the first `reached` frames.
pub(super) fn take(id: &str, frames: u32, reached: usize) -> (Arc<Robot>, Take) {
    let robot = Arc::new(Robot::builtin(id).unwrap());
    let clip = clip(&robot, frames);
    let command = compile(&clip).unwrap();
    let policy = PolicyConfig::new(PolicyName::Pd);
    let config = RolloutConfig { seed: 3, ..RolloutConfig::default() };
    let provenance = Provenance::new(&robot, &policy, &config).unwrap();
    let built = policy.build(&robot).unwrap();
    let mut rollout = Rollout::new(&robot, built, &command, Start::Pose, config).unwrap();
    while rollout.frame() + 1 < reached {
        rollout.step().unwrap();
    }
    let take = Take::record(&rollout, &command, Some(&clip), provenance).unwrap();
    assert_eq!(take.precision(), rollout.precision());
    (robot, take)
}
