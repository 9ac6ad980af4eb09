//! A joint trajectory as ROS 2 controllers accept it: points with positions, velocities and
//! accelerations.
//!
//! `joint_trajectory_controller` moves in straight lines between points that have positions only,
//! and its documentation discourages this. With velocities it follows cubics, with accelerations
//! quintics. It refuses a last point with a velocity, times that do not increase, and efforts that
//! no interface claims (ros2_controllers, `validate_trajectory_msg`).

use std::fmt::Write as _;

use super::super::command::Command;
use super::ExportError;

/// Nanoseconds of a frame.
const FRAME_NANOS: u64 = 50_000_000;
/// A point gets no acceleration if a neighbouring point is farther away than this, s.
const NEAR_SECS: f64 = 0.051;

/// A point; all arrays are in the order of the joints, and empty where not given.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrajectoryPoint {
    /// Time since the start, ns.
    pub nanos: u64,
    /// rad or m.
    pub positions: Vec<f64>,
    /// rad/s or m/s.
    pub velocities: Vec<f64>,
    /// rad/s^2 or m/s^2.
    pub accelerations: Vec<f64>,
    /// N m or N.
    pub effort: Vec<f64>,
}

/// A trajectory.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trajectory {
    /// Names, in the order of the arrays.
    pub joints: Vec<String>,
    /// Points in the order of time.
    pub points: Vec<TrajectoryPoint>,
}

impl Trajectory {
    /// The frames of a command that have a goal for every joint, at rest at both ends.
    ///
    /// Velocities are those of a monotone cubic (Fritsch and Butland, 1984): between two
    /// points the motion never leaves their values, which central differences would not keep
    /// at the end of a hold.
    ///
    /// # Errors
    /// [`ExportError::Partial`], [`ExportError::Empty`].
    pub fn of_command(command: &Command) -> Result<Trajectory, ExportError> {
        Trajectory::of_joints(command, |_| true)
    }

    /// [`Trajectory::of_command`] for some of the joints.
    ///
    /// # Errors
    /// [`ExportError::Partial`], [`ExportError::Empty`].
    pub fn of_joints(
        command: &Command,
        wanted: impl Fn(usize) -> bool,
    ) -> Result<Trajectory, ExportError> {
        let joints: Vec<usize> = (0..command.dim()).filter(|j| wanted(*j)).collect();
        let mut points = Vec::new();
        for frame in 0..command.frames() {
            let goals = joints.iter().filter(|j| command.sees(frame, **j)).count();
            if goals == 0 {
                continue;
            }
            if goals < joints.len() {
                return Err(ExportError::Partial { frame, format: "ros" });
            }
            let row = command.row(frame);
            let positions = joints.iter().map(|j| plain(row[*j])).collect();
            let nanos = u64::from(frame) * FRAME_NANOS;
            points.push(TrajectoryPoint { nanos, positions, ..TrajectoryPoint::default() });
        }
        if points.is_empty() {
            return Err(ExportError::Empty { format: "ros" });
        }
        let mut trajectory = Trajectory {
            joints: joints.iter().map(|j| command.joints()[*j].clone()).collect(),
            points,
        };
        trajectory.slopes();
        trajectory.differentiate();
        Ok(trajectory)
    }

    /// Velocities from the positions.
    fn slopes(&mut self) {
        let dim = self.joints.len();
        let mut velocities = vec![vec![0.0; dim]; self.points.len()];
        for (i, w) in self.points.windows(3).enumerate() {
            let (before, after) = (secs(&w[0], &w[1]), secs(&w[1], &w[2]));
            for (j, velocity) in velocities[i + 1].iter_mut().enumerate() {
                let a = (w[1].positions[j] - w[0].positions[j]) / before;
                let b = (w[2].positions[j] - w[1].positions[j]) / after;
                if a * b > 0.0 {
                    // The harmonic mean, the nearer side weighing more.
                    let (wa, wb) = (2.0 * after + before, after + 2.0 * before);
                    *velocity = (wa + wb) / (wa / a + wb / b);
                }
            }
        }
        for (point, v) in self.points.iter_mut().zip(velocities) {
            point.velocities = v;
        }
    }

    /// Accelerations by central differences of the velocities, 0 at both ends and beside a
    /// gap.
    pub fn differentiate(&mut self) {
        let dim = self.joints.len();
        let mut accelerations = vec![vec![0.0; dim]; self.points.len()];
        for (i, w) in self.points.windows(3).enumerate() {
            if secs(&w[0], &w[1]).max(secs(&w[1], &w[2])) > NEAR_SECS {
                continue;
            }
            for (j, a) in accelerations[i + 1].iter_mut().enumerate() {
                *a = (w[2].velocities[j] - w[0].velocities[j]) / secs(&w[0], &w[2]);
            }
        }
        for (point, a) in self.points.iter_mut().zip(accelerations) {
            point.accelerations = a;
        }
    }

    /// Shifts all points later, so that the controller has time to move the robot to the first
    /// point.
    pub fn delay(&mut self, nanos: u64) {
        self.points.iter_mut().for_each(|p| p.nanos += nanos);
    }

    /// YAML of `trajectory_msgs/msg/JointTrajectory`, or of the goal of a
    /// `control_msgs/action/FollowJointTrajectory`.
    pub fn to_yaml(&self, goal: bool) -> String {
        let mut out = String::new();
        let pad = if goal { "  " } else { "" };
        out.push_str(if goal {
            "# control_msgs/action/FollowJointTrajectory\ntrajectory:\n"
        } else {
            "# trajectory_msgs/msg/JointTrajectory\n"
        });
        writeln!(out, "{pad}joint_names:").ok();
        for joint in &self.joints {
            // A JSON string is a YAML string too.
            writeln!(out, "{pad}- {}", serde_json::Value::from(joint.as_str())).ok();
        }
        writeln!(out, "{pad}points:").ok();
        for point in &self.points {
            writeln!(out, "{pad}- positions: {}", list(&point.positions)).ok();
            for (name, values) in [
                ("velocities", &point.velocities),
                ("accelerations", &point.accelerations),
                ("effort", &point.effort),
            ] {
                if !values.is_empty() {
                    writeln!(out, "{pad}  {name}: {}", list(values)).ok();
                }
            }
            let (sec, nanosec) = (point.nanos / 1_000_000_000, point.nanos % 1_000_000_000);
            writeln!(out, "{pad}  time_from_start: {{sec: {sec}, nanosec: {nanosec}}}").ok();
        }
        out
    }
}

fn secs(from: &TrajectoryPoint, to: &TrajectoryPoint) -> f64 {
    (to.nanos - from.nanos) as f64 * 1e-9
}

/// The number that a person would type for a single-precision one: 0.1, not 0.10000000149.
fn plain(v: f32) -> f64 {
    v.to_string().parse().unwrap_or_else(|_: std::num::ParseFloatError| f64::from(v))
}

/// ROS parsers want floats to look like floats.
fn list(values: &[f64]) -> String {
    let decimal = |v: &f64| {
        // Minus nothing is nothing.
        let text = (v + 0.0).to_string();
        if text.contains('.') { text } else { format!("{text}.0") }
    };
    format!("[{}]", values.iter().map(decimal).collect::<Vec<_>>().join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn held() -> Trajectory {
        // A hold, a gap, a straight run, a hold.
        let row = |t: usize| match t {
            0..10 => Some(0.2),
            10..30 => None,
            30..40 => Some(1.0 + 0.1 * (t - 30) as f32),
            _ => Some(1.9),
        };
        let q = (0..50).map(|t| row(t).unwrap_or(0.0)).collect();
        let visible = (0..50).map(|t| row(t).is_some()).collect();
        let command = Command::from_dense(vec!["a".into()], vec![0.2], q, visible).unwrap();
        Trajectory::of_command(&command).unwrap()
    }

    #[test]
    fn velocities_keep_holds_still_and_ends_at_rest() {
        let t = held();
        assert_eq!(t.points.len(), 30);
        let v = |i: usize| t.points[i].velocities[0];
        assert!((0..=9).all(|i| v(i) == 0.0), "a hold is still up to its last point");
        assert!((v(15) - 2.0).abs() < 1e-5, "{}", v(15));
        assert!((20..30).all(|i| v(i) == 0.0));
        assert!((t.points[0].accelerations[0], t.points[29].accelerations[0]) == (0.0, 0.0));
        assert_eq!(t.points[9].accelerations, [0.0], "no acceleration beside a gap");
        assert_eq!(t.points[10].positions, [1.0]);
        assert_eq!(t.points[12].positions, [1.2]);
    }

    #[test]
    fn yaml_says_goal_and_delay() {
        let mut t = held();
        t.delay(2_000_000_000);
        let text = t.to_yaml(true);
        assert!(text.starts_with(
            "# control_msgs/action/FollowJointTrajectory\ntrajectory:\n  joint_names:\n  - \"a\"\n"
        ));
        assert!(text.contains("  - positions: [0.2]\n    velocities: [0.0]\n    accelerations: [0.0]\n    time_from_start: {sec: 2, nanosec: 0}\n"), "{text}");
        assert!(!text.contains("-0.0,") && !text.contains("-0.0]"), "{text}");
    }
}
