//! ROS 2 `trajectory_msgs/msg/JointTrajectory` as YAML.
//!
//! Every point lists all joints; masked frames have no points. Controllers interpolate between
//! points, so a foreign file is best read with `--fill linear`. Our own exports are read with
//! `mask` and come back exactly.

use serde::Deserialize;
use serde_saphyr::{Location, MessageFormatter as _, Spanned, UserMessageFormatter};

use super::super::command::Command;
use super::super::document::{Clip, Fill, RobotRef, Row};
use super::super::error::ClipError;
use super::trajectory::Trajectory;
use super::{ExportError, Track, frame_of, places};
use robert_base::limits;

/// A command as YAML, with the velocities and accelerations that controllers want.
///
/// # Errors
/// [`ExportError::Partial`], [`ExportError::Empty`].
pub fn to_ros(command: &Command) -> Result<String, ExportError> {
    Ok(Trajectory::of_command(command)?.to_yaml(false))
}

/// A message, or an action goal that holds one. Not an untagged enum: that would lose the
/// places that errors need.
#[derive(Deserialize)]
struct File {
    trajectory: Option<Goal>,
    joint_names: Option<JointNames>,
    points: Option<Vec<Spanned<Point>>>,
}

type JointNames = Spanned<Vec<Spanned<String>>>;

#[derive(Deserialize)]
struct Goal {
    joint_names: JointNames,
    points: Vec<Spanned<Point>>,
}

#[derive(Deserialize)]
struct Point {
    positions: Vec<Spanned<f64>>,
    time_from_start: Spanned<Duration>,
}

#[derive(Deserialize)]
struct Duration {
    #[serde(alias = "secs")]
    sec: i64,
    #[serde(alias = "nsecs", default)]
    nanosec: u32,
}

/// An error at a place of the YAML.
fn fault(message: impl Into<String>, at: Location) -> ClipError {
    ClipError::at(message, (at.line() as usize).max(1), (at.column() as usize).max(1))
}

/// The message of the YAML reader in the terms of this format.
fn unreadable(e: &serde_saphyr::Error) -> ClipError {
    let mut text = UserMessageFormatter.format_message(e.without_snippet()).into_owned();
    for (internal, word) in [
        ("invalid floating point", "expected a number"),
        ("invalid i64", "expected a whole number"),
        ("invalid u32", "expected a whole number from 0"),
        ("f64", "a number"),
        ("i64", "a whole number"),
        ("u32", "a whole number from 0"),
        ("struct Point", "a mapping with positions and time_from_start"),
        ("struct Duration", "a mapping with sec and nanosec"),
        ("struct File", "a mapping with joint_names and points"),
    ] {
        text = text.replace(internal, word);
    }
    fault(format!("not a JointTrajectory: {text}"), e.location().unwrap_or(Location::UNKNOWN))
}

/// Reads a JointTrajectory (bare, or inside an action goal's `trajectory`). Without a robot the
/// joint names of the file are used. Velocities and efforts are left out, because a clip has none.
///
/// # Errors
/// [`ClipError::Syntax`] with line and column.
pub fn from_ros(text: &str, robot: Option<&RobotRef>, fill: Fill) -> Result<Clip, ClipError> {
    // In a stream of documents, or with ROS' trailing separator, only the first is read.
    let text = text.trim_start_matches('\u{feff}');
    let file: File = serde_saphyr::from_str(text).map_err(|e| unreadable(&e))?;
    let (names, points) = match (file.trajectory, file.joint_names, file.points) {
        (Some(goal), ..) => (goal.joint_names, goal.points),
        (None, Some(names), Some(points)) => (names, points),
        (None, names, _) => {
            let lacks = if names.is_none() { "joint_names" } else { "points" };
            return Err(ClipError::at(format!("not a JointTrajectory: {lacks} is missing"), 1, 1));
        }
    };
    let dim = names.value.len();
    if dim == 0 || dim > limits::JOINTS {
        return Err(fault(format!("{dim} joint names"), names.referenced));
    }
    if points.len().saturating_mul(dim) > limits::CLIP_VALUES {
        return Err(fault(format!("{} points", points.len()), names.referenced));
    }
    let joints: Vec<String> = names.value.iter().map(|n| n.value.clone()).collect();
    let own = RobotRef { id: "unknown".to_owned(), joints: joints.clone(), ..RobotRef::default() };
    let robot = robot.cloned().unwrap_or(own);
    let order = places(&joints, &robot, |i| {
        let at = names.value.get(i).map_or(names.referenced, |n| n.referenced);
        (at.line() as usize, at.column() as usize)
    })?;
    let mut track = Track::default();
    for (i, Spanned { value: point, referenced: place, .. }) in points.iter().enumerate() {
        let fault = |what: String, at: Location| fault(format!("point {i}: {what}"), at);
        if point.positions.len() != dim {
            let what = format!("{} positions for {dim} joints", point.positions.len());
            return Err(fault(what, *place));
        }
        let Spanned { value: time, referenced: place, .. } = &point.time_from_start;
        let secs = time.sec as f64 + f64::from(time.nanosec) * 1e-9;
        let frame = frame_of(secs)
            .ok_or_else(|| fault(format!("{secs} s is beyond the longest clip"), *place))?;
        let mut row: Row = vec![None; robot.joints.len()];
        for (&j, Spanned { value, referenced, .. }) in order.iter().zip(&point.positions) {
            if !value.is_finite() || value.abs() > limits::CLIP_VALUE_MAX {
                return Err(fault(format!("{value} is not a joint value"), *referenced));
            }
            if let Some(slot) = row.get_mut(j) {
                *slot = Some(*value);
            }
        }
        if track.rows.insert(frame, row).is_some() {
            let what = format!("two points are in frame {frame} (20 frames per second)");
            return Err(fault(what, *place));
        }
        track.length = track.length.max(frame + 1);
    }
    if track.rows.is_empty() {
        return Err(fault("there are no points", names.referenced));
    }
    track.clip(robot, fill)
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;

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
    fn errors_have_places_and_no_internals() {
        let joints = vec!["a".to_owned(), "b".to_owned()];
        let robot = RobotRef { id: "r".into(), joints, ..RobotRef::default() };
        let point = |q: &str, t: &str| {
            format!("joint_names: [a, b]\npoints:\n- positions: {q}\n  time_from_start: {t}\n")
        };
        let time = "{sec: 0}";
        for (text, place, word) in [
            ("joint_names: [a, c]\npoints: []\n".to_owned(), "1:18: ", "has no joint \"c\""),
            (point("[1]", time), "3:3: ", "1 positions for 2 joints"),
            (point("[1, .nan]", time), "3:18: ", "not a joint value"),
            (point("[1, x]", time), "3:18: ", "a number"),
            (point("[1, 2]", "{sec: x}"), "4:26: ", "a whole number"),
            (point("[1, 2]", "{sec: -1}"), "4:20: ", "beyond the longest clip"),
            (point("3", time), "3:14: ", "not a JointTrajectory"),
            ("points: []\n".to_owned(), "1:1: ", "joint_names is missing"),
            ("joint_names: [a]\n".to_owned(), "1:1: ", "points is missing"),
            ("joint_names: [a, b]\npoints: []\n".to_owned(), "1:14: ", "there are no points"),
            ("[".to_owned(), "1:", "not a JointTrajectory"),
        ] {
            let e = from_ros(&text, Some(&robot), Fill::Mask).unwrap_err().to_string();
            assert!(e.starts_with(place) && e.contains(word), "{text}{e}");
            for internal in ["f64", "i64", "u32", "struct", "variant", "untagged", "Deserialize"] {
                assert!(!e.contains(internal), "{e}");
            }
        }
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
