//! Tasks extracted from recorded motion: the `test` suites.
//!
//! A task consists of 111 states of a held-out trajectory: 30 of history, the state where the
//! rollout begins (with its true velocity), and 80 commands. It is feasible by construction, and
//! the motion behind its masks is known.

use super::error::Error;
use super::start::Start;
use super::suite::{Case, Suite};
use super::window::HISTORY;
use robert_base::rng::{Rng, Stream};
use robert_clip::Command;
use robert_dataset::{Dataset, Part, Windows};
use robert_robot::Robot;

/// Commands of a task.
pub const EXTRACTED_FRAMES: usize = 80;

/// Tasks of a suite, by robot, as many as in the paper.
pub fn extracted_cases(robot: &str) -> usize {
    if robot.starts_with("ur5e") { 30 } else { 6 }
}

/// States of a task.
const STATES: usize = HISTORY + 1 + EXTRACTED_FRAMES;

/// The hidden part of a task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Masking {
    /// Nothing.
    None,
    /// A quarter of the commands.
    Low,
    /// Half of the commands, as in the paper.
    High,
}

impl Masking {
    /// All, in the order of tables.
    pub const ALL: [Masking; 3] = [Masking::None, Masking::Low, Masking::High];

    /// The suite with this masking.
    pub fn suite(self) -> &'static str {
        match self {
            Masking::None => "test",
            Masking::Low => "test_low_mask",
            Masking::High => "test_high_mask",
        }
    }

    /// Hidden commands of [`EXTRACTED_FRAMES`].
    fn hidden(self) -> usize {
        match self {
            Masking::None => 0,
            Masking::Low => EXTRACTED_FRAMES / 4,
            Masking::High => EXTRACTED_FRAMES / 2,
        }
    }
}

/// One task from 111 consecutive states: `qpos` and `qvel` are (111, S) in the order of
/// `joints`. Which commands are hidden is a function of (seed, index); the last never is.
/// `None` when the lengths disagree.
pub fn extract_task(
    joints: &[String],
    name: &str,
    qpos: &[f32],
    qvel: &[f32],
    masking: Masking,
    seed: u64,
    index: u64,
) -> Option<Case> {
    let dim = joints.len();
    if qpos.len() != STATES * dim || qvel.len() != STATES * dim {
        return None;
    }
    let wide = |v: &[f32]| v.iter().map(|&x| f64::from(x)).collect::<Vec<f64>>();
    let (history, rest) = qpos.split_at(HISTORY * dim);
    let velocity = qvel.get(HISTORY * dim..(HISTORY + 1) * dim)?;
    let mut visible = vec![true; rest.len()];
    let hidden = Rng::new(seed, Stream::Mask, index).subset(masking.hidden(), EXTRACTED_FRAMES - 1);
    for command in hidden {
        visible.get_mut((command + 1) * dim..(command + 2) * dim)?.fill(false);
    }
    let state = rest.get(..dim)?;
    Some(Case {
        name: name.to_owned(),
        command: Command::from_dense(joints.to_vec(), state.to_vec(), rest.to_vec(), visible)?,
        start: Start::Recorded {
            history: wide(history),
            state: wide(state),
            velocity: wide(velocity),
        },
        truth: Some(wide(rest)),
        floor: None,
    })
}

/// `count` tasks for each masking from the held-out trajectories of a dataset. The result is a
/// function of (dataset, count, seed); the three suites come from different places.
///
/// # Errors
/// [`Error::Joints`] for another robot's data, [`Error::Dataset`] if no held-out
/// trajectory has 111 frames.
pub fn test_suites(
    robot: &Robot,
    data: &Dataset,
    count: usize,
    seed: u64,
) -> Result<Vec<Suite>, Error> {
    let joints = &data.manifest().robot.joints;
    if !robot.joints().iter().map(|j| &j.name).eq(joints) {
        return Err(Error::Joints {
            robot: robot.id().to_owned(),
            got: joints.len(),
            want: robot.state_dim(),
            hint: "the dataset is from another robot".into(),
        });
    }
    let windows = Windows::new(data, STATES, Part::Test, seed)?;
    let dim = joints.len();
    let mut suites = Vec::new();
    for (set, masking) in (0_u64..).zip(Masking::ALL) {
        let mut cases = Vec::with_capacity(count);
        for i in 0..count {
            let index = (set << 32) + i as u64;
            let window = windows.draw(seed, index);
            let Some(episode) = data.episodes().get(window.episode) else { continue };
            let (qpos, qvel, _) = data.frames(episode);
            let rows = window.start * dim..(window.start + STATES) * dim;
            let (Some(qpos), Some(qvel)) = (qpos.get(rows.clone()), qvel.get(rows)) else {
                continue;
            };
            let name = format!("{}_{i:02}", masking.suite());
            cases.extend(extract_task(joints, &name, qpos, qvel, masking, seed, index));
        }
        suites.push(Suite { name: masking.suite().to_owned(), cases });
    }
    Ok(suites)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::{EvalConfig, PolicyConfig, PolicyName, Rollout, RolloutConfig, evaluate};
    use robert_base::progress::{Cancel, Silent};
    use robert_robot::PlantRange;

    /// A recorded motion of the arm: 111 states and velocities.
    fn recording(robot: &Arc<Robot>) -> (Vec<String>, Vec<f32>, Vec<f32>) {
        let joints: Vec<String> = robot.joints().iter().map(|j| j.name.clone()).collect();
        let mut data = robert_mujoco::Data::new(robot.model()).unwrap();
        robot.write_state(&mut data, &robot.home()).unwrap();
        let (mut q, mut v) = (Vec::new(), Vec::new());
        for t in 0..STATES {
            q.extend(robot.state(&data).iter().map(|x| *x as f32));
            v.extend(robot.velocity(&data).iter().map(|x| *x as f32));
            let action: Vec<f64> =
                (0..robot.action_dim()).map(|a| 0.4 * (0.2 * t as f64 + a as f64).sin()).collect();
            robot.apply_action(&mut data, &action).unwrap();
            data.step(10).unwrap();
        }
        (joints, q, v)
    }

    #[test]
    fn a_piece_is_masked_as_asked_and_performed_from_its_middle() {
        let robot = Arc::new(Robot::builtin("ur5e").unwrap());
        let (joints, q, v) = recording(&robot);
        let mut last = Vec::new();
        for (masking, hidden) in Masking::ALL.into_iter().zip([0, 20, 40]) {
            let case = extract_task(&joints, "x", &q, &v, masking, 3, 7).unwrap();
            let again = extract_task(&joints, "x", &q, &v, masking, 3, 7).unwrap();
            assert!(case.command == again.command && case.start == again.start);
            let masked = (1..=80).filter(|f| !case.command.sees(*f, 0)).count();
            assert_eq!((masked, case.command.frames()), (hidden, 81));
            assert!(case.command.sees(80, 0), "the last command is always visible");
            last.push(case);
        }
        assert!(extract_task(&joints, "x", &q[5..], &v, Masking::Low, 3, 7).is_none());
        let other = extract_task(&joints, "x", &q, &v, Masking::High, 3, 8).unwrap();
        assert!(other.command != last[2].command, "another index hides other frames");

        // The rollout begins in motion, so without torque it must not stand still.
        let policy = PolicyConfig::new(PolicyName::ComputedTorque);
        let suite = Suite { name: "t".into(), cases: last.clone() };
        let config = EvalConfig {
            policies: vec![policy.clone()],
            plant: PlantRange::default(),
            seeds: 0..1,
            threads: 2,
        };
        let found = evaluate(&robot, &[suite], &config, &Silent, &Cancel::default()).unwrap();
        let tasks = &found[0].tasks;
        assert!(tasks[0].precision.unwrap() < 1e-3, "{tasks:?}");
        assert_eq!(tasks[0].masked_mae, None);
        assert!(tasks[2].masked_mae.unwrap() < 0.05, "{tasks:?}");
        let zero = PolicyConfig::new(PolicyName::Zero).build(&robot).unwrap();
        let case = &last[0];
        let config = RolloutConfig::default();
        let mut r = Rollout::new(&robot, zero, &case.command, case.start.clone(), config).unwrap();
        let first = r.step().unwrap().unwrap().reached.to_vec();
        let from: Vec<f64> = q[30 * 5..31 * 5].iter().map(|x| f64::from(*x)).collect();
        let speed: Vec<f64> = v[30 * 5..31 * 5].iter().map(|x| f64::from(*x)).collect();
        assert!((first[0] - from[0]) * speed[0] > 0.0, "{first:?} from {from:?} at {speed:?}");
    }
}
