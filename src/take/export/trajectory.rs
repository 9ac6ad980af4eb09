//! A take as a ROS 2 joint trajectory that controllers accept.

use std::collections::BTreeMap;

use super::super::document::{Take, What, row};
use super::super::error::Error;
use super::files::Export;
use robert_base::units::FPS;
use robert_clip::formats::{Trajectory, TrajectoryPoint};

/// Joint speeds below this count as standing still, rad/s or m/s.
const STILL: f64 = 1e-3;
/// Duration in which a motion that still moves at its end is brought to rest, s.
const SETTLE_SECS: f64 = 0.5;
const NANOS: f64 = 1e9;

/// Options of the file beside the points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RosOptions {
    /// Time before the first point, s, in which the robot moves there.
    pub lead_in_secs: f64,
    /// The goal of an action instead of a message.
    pub goal: bool,
    /// Whether the simulated torques are included: only for controllers with an effort interface.
    pub effort: bool,
    /// Other names for the joints.
    pub rename: BTreeMap<String, String>,
    /// Limits of the joints, if they are known; (S).
    pub ranges: Option<Vec<[f64; 2]>>,
    /// Whether a controller can command each joint, if this is known; (S). The others are left out.
    pub motorised: Option<Vec<bool>>,
}

impl RosOptions {
    fn commands(&self, joint: usize) -> bool {
        self.motorised.as_ref().is_none_or(|m| m[joint])
    }

    /// The sentence about joints that a trajectory leaves out.
    pub(super) fn left_out(&self, take: &Take) -> Option<String> {
        let names = take.robot.joints.iter().enumerate().filter(|(j, _)| !self.commands(*j));
        let names: Vec<&str> = names.map(|(_, name)| name.as_str()).collect();
        (!names.is_empty()).then(|| {
            format!(
                "Not in the trajectory, because no motor moves them directly: {}.",
                names.join(" ")
            )
        })
    }
}

/// The motion as YAML.
///
/// # Errors
/// [`Error::Export`] for a command with goals for some joints only, or for none.
pub fn ros(take: &Take, what: What, options: &RosOptions) -> Result<Export, Error> {
    let (trajectory, settles) = points(take, what, options)?;
    let (interface, kind, topic) = if options.goal {
        ("action send_goal", "control_msgs/action/FollowJointTrajectory", "follow_joint_trajectory")
    } else {
        ("topic pub --once", "trajectory_msgs/msg/JointTrajectory", "joint_trajectory")
    };
    let open = format!(
        "ros2 {interface} /joint_trajectory_controller/{topic} {kind} \"$(cat {})\"",
        Export::OUT
    );
    let first: Vec<String> =
        trajectory.points[0].positions.iter().map(|q| format!("{q:.3}")).collect();
    let mut export = Export::single(
        trajectory.to_yaml(options.goal).into_bytes(),
        trajectory.points.len(),
        open,
    )
    .says("rad, rad/s, rad/s^2 (m for slides), time from the start; the last point rests.");
    export = if options.lead_in_secs > 0.0 {
        let secs = options.lead_in_secs;
        export.says(format!("The robot has {secs} s to go to the first point."))
    } else {
        export.says("The first point is at time 0: a controller jumps there. Give --lead-in 2, or bring the robot there first.")
    };
    export = export.says(format!(
        "First point: {} at {}.",
        trajectory.joints.join(" "),
        first.join(" ")
    ));
    if let Some(names) = options.left_out(take) {
        export = export.says(names);
    }
    if let Some(moved) = settles {
        export = export.says(format!(
            "The motion still moves in its last frame: a point {SETTLE_SECS} s later, {moved:.4} rad or m on, brings it to rest."
        ));
    }
    Ok(export)
}

/// The trajectory. If it still moves at the end and is brought to rest, also the longest distance
/// that a joint moves meanwhile.
pub(super) fn points(
    take: &Take,
    what: What,
    options: &RosOptions,
) -> Result<(Trajectory, Option<f64>), Error> {
    let mut settles = None;
    let commanded: Vec<usize> = (0..take.state_dim()).filter(|j| options.commands(*j)).collect();
    let mut trajectory = match what {
        What::Command => Trajectory::of_joints(&take.command, |j| options.commands(j))?,
        What::Achieved => {
            let mut reached = reached(take, &commanded, options.effort);
            let ranges = options.ranges.as_ref();
            let ranges: Option<Vec<[f64; 2]>> =
                ranges.map(|all| commanded.iter().map(|j| all[*j]).collect());
            settles = settle(&mut reached, ranges.as_deref());
            reached.differentiate();
            reached
        }
    };
    trajectory.delay((options.lead_in_secs * NANOS).round() as u64);
    for joint in &mut trajectory.joints {
        if let Some(name) = options.rename.get(joint) {
            joint.clone_from(name);
        }
    }
    Ok((trajectory, settles))
}

/// A point a frame, of these joints.
fn reached(take: &Take, joints: &[usize], effort: bool) -> Trajectory {
    let dim = take.state_dim();
    let of = |values: &[f64]| -> Vec<f64> { joints.iter().map(|j| values[*j]).collect() };
    let points = (0..take.frames()).map(|f| TrajectoryPoint {
        nanos: f as u64 * (NANOS as u64 / u64::from(FPS)),
        positions: of(take.state(f)),
        velocities: of(row(&take.velocity, f, dim)),
        accelerations: Vec::new(),
        effort: match (effort, row(&take.effort, f, dim)) {
            (false, _) => Vec::new(),
            // The last frame ends the motion: no torque follows.
            (true, []) => vec![0.0; joints.len()],
            (true, torque) => of(torque),
        },
    });
    let names = joints.iter().map(|j| take.robot.joints[*j].clone());
    Trajectory { joints: names.collect(), points: points.collect() }
}

/// Brings the end to rest: in place if it hardly moves, otherwise by one more point, which constant
/// deceleration reaches. Returns the longest distance that a joint moves meanwhile, rad or m.
fn settle(trajectory: &mut Trajectory, ranges: Option<&[[f64; 2]]>) -> Option<f64> {
    let last = trajectory.points.last_mut()?;
    if last.velocities.iter().all(|v| v.abs() < STILL) {
        last.velocities.fill(0.0);
        return None;
    }
    let mut rest = last.clone();
    rest.nanos += (SETTLE_SECS * NANOS) as u64;
    let mut longest = 0.0_f64;
    for (j, v) in rest.velocities.iter_mut().enumerate() {
        let from = last.positions[j];
        let [low, high] = ranges.map_or([f64::NEG_INFINITY, f64::INFINITY], |r| [r[j][0], r[j][1]]);
        // A joint that is pressed beyond its stop does not have to move back.
        let to = (from + *v * SETTLE_SECS / 2.0).clamp(low.min(from), high.max(from));
        longest = longest.max((to - from).abs());
        rest.positions[j] = to;
        *v = 0.0;
    }
    rest.effort.fill(0.0);
    trajectory.points.push(rest);
    Some(longest)
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::super::super::sample;
    use super::*;

    #[derive(Deserialize)]
    struct Goal {
        trajectory: Message,
    }

    #[derive(Deserialize)]
    struct Message {
        joint_names: Vec<String>,
        points: Vec<Point>,
    }

    #[derive(Deserialize)]
    struct Point {
        positions: Vec<f64>,
        velocities: Vec<f64>,
        accelerations: Vec<f64>,
        #[serde(default)]
        effort: Vec<f64>,
        time_from_start: Time,
    }

    #[derive(Deserialize)]
    struct Time {
        sec: i64,
        nanosec: i64,
    }

    fn read(export: &Export, goal: bool) -> Message {
        let text = std::str::from_utf8(&export.files[0].bytes).unwrap();
        if goal {
            serde_saphyr::from_str::<Goal>(text).unwrap().trajectory
        } else {
            serde_saphyr::from_str(text).unwrap()
        }
    }

    /// The checks of `validate_trajectory_msg` of ros2_controllers, with its defaults.
    fn accepted(message: &Message, joints: &[String]) {
        assert!(!message.joint_names.is_empty() && !message.points.is_empty());
        assert_eq!(message.joint_names, joints, "partial goals are not allowed");
        let last = message.points.last().unwrap();
        assert!(
            last.velocities.iter().all(|v| *v == 0.0),
            "the end must rest: {:?}",
            last.velocities
        );
        let mut before = i64::MIN;
        for (i, p) in message.points.iter().enumerate() {
            let n = joints.len();
            assert_eq!(p.positions.len(), n, "point {i}");
            assert_eq!(p.velocities.len(), n, "point {i}");
            assert_eq!(p.accelerations.len(), n, "point {i}");
            assert!(p.effort.is_empty(), "no effort interface is claimed");
            assert!((0..1_000_000_000).contains(&p.time_from_start.nanosec));
            let nanos = p.time_from_start.sec * 1_000_000_000 + p.time_from_start.nanosec;
            assert!(nanos > before, "times must rise");
            before = nanos;
            let all = p.positions.iter().chain(&p.velocities).chain(&p.accelerations);
            assert!(all.into_iter().all(|v| v.is_finite()));
        }
    }

    #[test]
    fn a_controller_accepts_what_is_written() {
        for id in ["pointmass", "ur5e", "shadow_hand"] {
            for reach in [20, 45] {
                let (_, take) = sample::take(id, 45, reach);
                for what in [What::Achieved, What::Command] {
                    for goal in [false, true] {
                        let options =
                            RosOptions { lead_in_secs: 2.0, goal, ..RosOptions::default() };
                        let export = ros(&take, what, &options).unwrap();
                        assert_eq!(ros(&take, what, &options).unwrap(), export);
                        let message = read(&export, goal);
                        accepted(&message, &take.robot.joints);
                        assert_eq!(message.points[0].time_from_start.sec, 2);
                    }
                }
            }
        }
    }

    /// A cut take still moves; the point that is added brings it to rest within the limits.
    #[test]
    fn a_motion_that_is_cut_settles() {
        let (robot, take) = sample::take("ur5e", 45, 20);
        let ranges: Vec<[f64; 2]> = robot.joints().iter().map(|j| j.range).collect();
        let options = RosOptions { ranges: Some(ranges), ..RosOptions::default() };
        let export = ros(&take, What::Achieved, &options).unwrap();
        let message = read(&export, false);
        assert_eq!(message.points.len(), 21);
        assert!(export.meaning.iter().any(|m| m.contains("brings it to rest")));
        let (a, b) = (&message.points[19], &message.points[20]);
        for j in 0..5 {
            let want = a.positions[j] + a.velocities[j] * 0.25;
            assert!((b.positions[j] - want).abs() < 1e-12);
        }
        let effort = RosOptions { effort: true, ..RosOptions::default() };
        let text = ros(&take, What::Achieved, &effort).unwrap().files[0].bytes.clone();
        assert_eq!(String::from_utf8(text).unwrap().matches("effort:").count(), 21);
    }

    /// Velocities integrate to the motion: what a controller's cubics pass through.
    #[test]
    fn velocities_belong_to_the_positions() {
        let (_, take) = sample::take("ur5e", 45, 45);
        let message = read(&ros(&take, What::Achieved, &RosOptions::default()).unwrap(), false);
        let at = |p: &Point| p.time_from_start.sec as f64 + p.time_from_start.nanosec as f64 * 1e-9;
        for w in message.points.windows(2) {
            let secs = at(&w[1]) - at(&w[0]);
            for j in 0..5 {
                let moved = w[1].positions[j] - w[0].positions[j];
                let mean = f64::midpoint(w[0].velocities[j], w[1].velocities[j]) * secs;
                assert!((moved - mean).abs() < 0.01, "{moved} {mean}");
            }
        }
    }
}
