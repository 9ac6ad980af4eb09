//! ROS 2 `trajectory_msgs/msg/JointTrajectory` as YAML.
//!
//! Every point lists all joints; masked frames are absent points. Controllers move in
//! straight or spline lines between points, so a foreign file is best read with
//! `--fill linear`; our own exports are read with `mask` and come back exactly.

use std::fmt::Write as _;

use serde::Deserialize;
use serde_json::Value;

use super::super::command::{Command, Sight};
use super::super::document::{Clip, Fill, RobotRef, Row};
use super::super::error::ClipError;
use super::{ExportError, Track, frame_of, places};
use crate::limits;

/// A command as YAML.
///
/// # Errors
/// [`ExportError::Partial`], [`ExportError::Empty`].
pub fn to_ros(command: &Command) -> Result<String, ExportError> {
    let mut out = String::from("# trajectory_msgs/msg/JointTrajectory\njoint_names:\n");
    for joint in command.joints() {
        // A JSON string is a YAML string too.
        writeln!(out, "- {}", Value::from(joint.as_str())).ok();
    }
    out.push_str("points:\n");
    let mut points = 0;
    for frame in 0..command.frames() {
        match command.sight(frame) {
            Sight::Masked => continue,
            Sight::Partial => return Err(ExportError::Partial { frame, format: "ros" }),
            Sight::Full => points += 1,
        }
        let q: Vec<String> = command.row(frame).iter().map(|v| decimal(*v)).collect();
        // 1/20 s is 50 ms: whole nanoseconds.
        let (sec, nanosec) = (frame / 20, (frame % 20) * 50_000_000);
        writeln!(
            out,
            "- positions: [{}]\n  time_from_start: {{sec: {sec}, nanosec: {nanosec}}}",
            q.join(", ")
        )
        .ok();
    }
    if points == 0 {
        return Err(ExportError::Empty { format: "ros" });
    }
    Ok(out)
}

/// ROS parsers want floats to look like floats.
fn decimal(v: f32) -> String {
    let text = v.to_string();
    if text.contains('.') { text } else { format!("{text}.0") }
}

#[derive(Deserialize)]
#[serde(untagged)]
enum File {
    Goal { trajectory: Trajectory },
    Bare(Trajectory),
}

#[derive(Deserialize)]
struct Trajectory {
    joint_names: Vec<String>,
    points: Vec<Point>,
}

#[derive(Deserialize)]
struct Point {
    positions: Vec<f64>,
    time_from_start: Duration,
}

#[derive(Deserialize)]
struct Duration {
    #[serde(alias = "secs")]
    sec: i64,
    #[serde(alias = "nsecs", default)]
    nanosec: u32,
}

/// Reads a JointTrajectory (bare, or inside an action goal's `trajectory`). Without a robot
/// its own joint names are taken. Velocities and efforts are left out: a clip has none.
///
/// # Errors
/// [`ClipError::Syntax`] with line and column.
pub fn from_ros(text: &str, robot: Option<&RobotRef>, fill: Fill) -> Result<Clip, ClipError> {
    // A stream of documents, or ROS' trailing separator: take the first.
    let text = text.trim_start_matches('\u{feff}');
    let file: File = serde_saphyr::from_str(text).map_err(|e| {
        let (line, col) = e.location().map_or((1, 1), |l| (l.line() as usize, l.column() as usize));
        let first = e.to_string();
        let first = first.lines().next().unwrap_or_default().to_owned();
        ClipError::at(format!("not a JointTrajectory: {first}"), line.max(1), col.max(1))
    })?;
    let (File::Goal { trajectory } | File::Bare(trajectory)) = file;
    let dim = trajectory.joint_names.len();
    if dim == 0 || dim > limits::JOINTS {
        return Err(ClipError::at(format!("{dim} joint names"), 1, 1));
    }
    if trajectory.points.len().saturating_mul(dim) > limits::CLIP_VALUES {
        return Err(ClipError::at(format!("{} points", trajectory.points.len()), 1, 1));
    }
    let own = RobotRef {
        id: "unknown".to_owned(),
        joints: trajectory.joint_names.clone(),
        ..RobotRef::default()
    };
    let robot = robot.cloned().unwrap_or(own);
    let order = places(&trajectory.joint_names, &robot, |_| (1, 1))?;
    let mut track = Track::default();
    for (i, point) in trajectory.points.iter().enumerate() {
        // The YAML tree has no positions any more; the point's number finds it.
        let fault = |what: String| ClipError::at(format!("point {i}: {what}"), 1, 1);
        if point.positions.len() != dim {
            return Err(fault(format!("{} positions for {dim} joints", point.positions.len())));
        }
        let time = &point.time_from_start;
        let secs = time.sec as f64 + f64::from(time.nanosec) * 1e-9;
        let frame = frame_of(secs).ok_or_else(|| fault(format!("{secs} s is outside a clip")))?;
        let mut row: Row = vec![None; robot.joints.len()];
        for (&j, v) in order.iter().zip(&point.positions) {
            if !v.is_finite() || v.abs() > limits::CLIP_VALUE_MAX {
                return Err(fault(format!("{v} is no joint value")));
            }
            if let Some(slot) = row.get_mut(j) {
                *slot = Some(*v);
            }
        }
        if track.rows.insert(frame, row).is_some() {
            return Err(fault(format!("a second point within frame {frame} (20 a second)")));
        }
        track.length = track.length.max(frame + 1);
    }
    if track.rows.is_empty() {
        return Err(ClipError::at("no points", 1, 1));
    }
    track.clip(robot, fill)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn foreign_files_are_read() {
        let text = "trajectory:\n  header: {frame_id: base}\n  joint_names: [b, a]\n  points:\n  \
                    - positions: [1.0, 2]\n    velocities: [0.0, 0.0]\n    time_from_start: {sec: 0, nanosec: 500000000}\n  \
                    - {positions: [3.0, 4.0], time_from_start: {secs: 2, nsecs: 0}}\n";
        let joints = vec!["a".to_owned(), "b".to_owned()];
        let robot = RobotRef { id: "r".into(), joints, ..RobotRef::default() };
        let clip = from_ros(text, Some(&robot), Fill::Linear).unwrap();
        let rows: Vec<_> =
            clip.keys.iter().map(|k| (k.frame, clip.row(k).unwrap().clone())).collect();
        assert_eq!(rows, [(10, vec![Some(2.0), Some(1.0)]), (40, vec![Some(4.0), Some(3.0)])]);
    }

    #[test]
    fn hostile_yaml_is_refused() {
        let mut bomb = String::from("a: &a [x,x,x,x,x,x,x,x,x]\n");
        for (p, c) in ('a'..='g').zip('b'..='h') {
            let refs = vec![format!("*{p}"); 9].join(",");
            writeln!(bomb, "{c}: &{c} [{refs}]").unwrap();
        }
        bomb.push_str("joint_names: *h\npoints: []\n");
        for text in [
            bomb.as_str(),
            "",
            "joint_names: [a]\npoints: [{positions: [.nan], time_from_start: {sec: 1}}]",
            "joint_names: [a]\npoints: [{positions: [1, 2], time_from_start: {sec: 1}}]",
            "joint_names: [a]\npoints: [{positions: [1], time_from_start: {sec: -1}}]",
            "joint_names: [a]\npoints: [{positions: [1], time_from_start: {sec: 99999999}}]",
            "joint_names: []\npoints: []",
            "- [",
        ] {
            assert!(from_ros(text, None, Fill::Mask).is_err(), "{text}");
        }
        assert!(from_ros(&"[".repeat(100_000), None, Fill::Mask).is_err());
    }
}
