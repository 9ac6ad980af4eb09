//! Run with: cargo run --release --example policy_speed [REPEATS]
//!
//! Times in Rust what `python/tests/speed.py` times in Python: one action of the UR5e's policy, and
//! the rollout of a clip of 201 frames as a take. Prints the least and the median seconds as JSON, by the
//! wall and of the processor.

use std::sync::Arc;
use std::time::Instant;

use robert::clip::compile;
use robert::mujoco::Data;
use robert::robot::Robot;
use robert::rollout::{COMMAND, PolicyConfig, Rollout, RolloutConfig, Start, View, Window, tasks};
use robert::take::{Provenance, Take};

type Failure = Box<dyn std::error::Error>;

/// Seconds that the processor has spent on this process.
fn processor_secs() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// Least and median seconds of so many runs.
fn times(
    runs: usize,
    mut work: impl FnMut() -> Result<(), Failure>,
) -> Result<serde_json::Value, Failure> {
    let (mut wall, mut processor) = (Vec::with_capacity(runs), Vec::with_capacity(runs));
    for _ in 0..runs {
        let (begin, before) = (Instant::now(), processor_secs());
        work()?;
        processor.push(processor_secs() - before);
        wall.push(begin.elapsed().as_secs_f64());
    }
    let of = |mut found: Vec<f64>| {
        found.sort_by(f64::total_cmp);
        serde_json::json!({"least": found[0], "median": found[runs / 2]})
    };
    Ok(serde_json::json!({"wall": of(wall), "processor": of(processor)}))
}

/// The arm at home, and the command to stay there.
fn act(
    robot: &Arc<Robot>,
    config: &PolicyConfig,
    runs: usize,
) -> Result<serde_json::Value, Failure> {
    let dim = robot.state_dim();
    let home = robot.home();
    let mut policy = config.build(robot)?;
    policy.reset(0);
    let data = Data::new(robot.model())?;
    let mut window = Window::new(dim);
    let mut action = vec![0.0; robot.action_dim()];
    let mut frame = 0;
    times(runs, || {
        for row in window.history.chunks_exact_mut(dim).chain(window.command.chunks_exact_mut(dim))
        {
            row.copy_from_slice(&home);
        }
        window.current.copy_from_slice(&home);
        window.end.copy_from_slice(&home);
        window.visible = vec![true; COMMAND * dim];
        let state = data.snapshot();
        policy.act(&View { frame, window: &window, state: &state }, &mut action)?;
        frame += 1;
        Ok(())
    })
}

fn roll_out(
    robot: &Arc<Robot>,
    policy: &PolicyConfig,
    runs: usize,
) -> Result<serde_json::Value, Failure> {
    let clip = tasks::find("ur5e/reacher", None)?;
    times(runs, || {
        let command = compile(&clip)?;
        let config = RolloutConfig { guide: policy.guide, ..RolloutConfig::default() };
        let provenance = Provenance::new(robot, policy, &config)?;
        let built = policy.build(robot)?;
        let mut rollout = Rollout::new(robot, built, &command, Start::Pose, config)?;
        while rollout.step()?.is_some() {}
        Take::record(&rollout, &command, Some(&clip), provenance)?;
        Ok(())
    })
}

pub fn main() -> Result<(), Failure> {
    let repeats: usize = std::env::args().nth(1).map_or(Ok(1), |n| n.parse())?;
    let robot = Arc::new(Robot::builtin("ur5e")?);
    let policy: PolicyConfig = "robert".parse()?;
    act(&robot, &policy, 50)?;
    let report = serde_json::json!({
        "act_secs": act(&robot, &policy, 1000 * repeats)?,
        "rollout_secs": roll_out(&robot, &policy, 7 * repeats)?,
    });
    println!("{report}");
    Ok(())
}
