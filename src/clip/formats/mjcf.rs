//! MJCF `<key>`: a snapshot of qpos without joint names.
//!
//! The order is that of the model. It is written as a comment, and its length is checked when a
//! file is read. `MuJoCo` allows many keys at one time (the default is 0); those are spread out.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use super::super::command::{Command, Sight};
use super::super::document::{Clip, Fill, RobotRef, Row};
use super::super::error::ClipError;
use super::super::json::show;
use super::super::place::line_col;
use super::{ExportError, Track, frame_of, start_differs};
use robert_base::limits;
use robert_base::units::FPS;
use robert_base::xml;

/// Distance between keys without times, in frames.
const SPREAD_FRAMES: u32 = 20;

/// A command as a `<keyframe>` block: one key per frame that has a goal. A key with time -0.05
/// holds the start if it differs from the first goal.
///
/// # Errors
/// [`ExportError::Partial`], because qpos cannot leave a joint open.
pub fn to_mjcf(command: &Command) -> Result<String, ExportError> {
    let mut out = String::from("<mujoco>\n  <!-- qpos: ");
    let names = xml::in_comment(&command.joints().join(" "));
    writeln!(out, "{names} -->\n  <keyframe>").ok();
    let mut key = |name: &str, frame: i64, row: &[f32]| {
        let time = frame as f64 / f64::from(FPS);
        let q: Vec<String> = row.iter().map(f32::to_string).collect();
        writeln!(out, "    <key name=\"{name}\" time=\"{time}\" qpos=\"{}\"/>", q.join(" ")).ok();
    };
    if start_differs(command) {
        key("start", -1, command.start());
    }
    for frame in 0..command.frames() {
        match command.sight(frame) {
            Sight::Masked => {}
            Sight::Partial => return Err(ExportError::Partial { frame, format: "mjcf" }),
            Sight::Full => key(&format!("frame{frame}"), i64::from(frame), command.row(frame)),
        }
    }
    out.push_str("  </keyframe>\n</mujoco>\n");
    Ok(out)
}

/// Reads the keys of an MJCF file; `robot.joints` is the model's qpos order. Names become
/// poses, unless they are those of an export.
///
/// # Errors
/// [`ClipError::Syntax`] with line and column.
pub fn from_mjcf(text: &str, robot: &RobotRef, fill: Fill) -> Result<Clip, ClipError> {
    let tree = xml::parse(text, limits::XML_ELEMENTS)
        .map_err(|e| ClipError::at(e.message, e.line as usize, e.column as usize))?;
    let nq = robot.joints.len();
    let mut found = Vec::new();
    let mut untimed = 0;
    for node in tree.descendants().filter(|n| n.has_tag_name("key")) {
        let place = |attribute: &str| {
            let at = node.attribute_node(attribute).map_or(node.range(), |a| a.range());
            line_col(text, at.start)
        };
        let Some(qpos) = node.attribute("qpos") else { continue };
        let mut row: Row = Vec::new();
        for word in qpos.split_ascii_whitespace() {
            match word.parse::<f64>() {
                Ok(v) if v.abs() <= limits::CLIP_VALUE_MAX && row.len() < limits::MODEL_NQ => {
                    row.push(Some(v));
                }
                _ => {
                    let message = format!("\"{}\" is not a joint value", show(word));
                    let (line, col) = place("qpos");
                    return Err(ClipError::at(message, line, col));
                }
            }
        }
        if row.len() != nq {
            let (line, col) = place("qpos");
            let message = format!(
                "qpos has {} numbers, but {} has {nq} joints; is it another model?",
                row.len(),
                show(&robot.id)
            );
            return Err(ClipError::at(message, line, col));
        }
        let secs = match node.attribute("time").map(|t| t.trim().parse::<f64>()) {
            None => {
                untimed += 1;
                0.0
            }
            Some(Ok(t)) if t.is_finite() => t,
            Some(_) => {
                let (line, col) = place("time");
                return Err(ClipError::at("this time is not a number", line, col));
            }
        };
        let at = node.attribute_node("time").map_or(node.range(), |a| a.range()).start;
        found.push((secs, node.attribute("name").unwrap_or_default().to_owned(), row, at));
    }
    if found.is_empty() {
        return Err(ClipError::at("there is no <key> with a qpos", 1, 1));
    }
    let mut track = Track::default();
    let mut taken = BTreeSet::new();
    let timed = found.len() == 1 || found.iter().any(|k| k.0 != 0.0);
    for (i, (secs, name, row, at)) in found.into_iter().enumerate() {
        if timed && secs < 0.0 {
            if track.start.replace(row).is_some() {
                let (line, col) = line_col(text, at);
                return Err(ClipError::at(
                    "there are two keys before 0 s, where the start is",
                    line,
                    col,
                ));
            }
            continue;
        }
        let frame =
            if timed { frame_of(secs) } else { u32::try_from(i).ok().map(|i| i * SPREAD_FRAMES) };
        let Some(frame) = frame.filter(|f| *f < limits::CLIP_FRAMES) else {
            let (line, col) = line_col(text, at);
            return Err(ClipError::at("this time is beyond the longest clip", line, col));
        };
        if track.rows.insert(frame, row).is_some() {
            let hint = if untimed > 0 { "; a key without a time is at 0 s" } else { "" };
            let message = format!("there are two keys at {secs} s (frame {frame}){hint}");
            let (line, col) = line_col(text, at);
            return Err(ClipError::at(message, line, col));
        }
        track.length = track.length.max(frame + 1);
        let plain = name.is_empty() || name == format!("frame{frame}");
        if !plain && taken.insert(name.clone()) {
            track.names.insert(frame, name);
        }
    }
    let mut clip = track.clip(robot.clone(), fill)?;
    if !timed {
        clip.notes =
            format!("The keys had no times, so they were placed {SPREAD_FRAMES} frames apart.");
    }
    Ok(clip)
}

#[cfg(test)]
mod tests {
    use super::super::super::Goal;
    use super::*;

    fn robot() -> RobotRef {
        let joints = vec!["a".to_owned(), "b".to_owned()];
        RobotRef { id: "r".into(), joints, ..RobotRef::default() }
    }

    #[test]
    fn named_keys_without_time_become_poses_a_second_apart() {
        let text = "<mujoco><keyframe><key name='rest' qpos='0 0'/><key name='up' qpos='1 .5'/>\
                    <key qpos='2 2'/></keyframe></mujoco>";
        let clip = from_mjcf(text, &robot(), Fill::Linear).unwrap();
        assert_eq!(clip.keys.iter().map(|k| k.frame).collect::<Vec<_>>(), [0, 20, 40]);
        assert_eq!(clip.keys[1].goal, Goal::Pose("up".into()));
        assert_eq!((clip.length, clip.fill), (41, Fill::Linear));
        assert!(clip.notes.contains("20 frames apart"), "{}", clip.notes);
    }

    #[test]
    fn keys_without_time_among_others_are_at_zero() {
        let text = "<mujoco><keyframe><key qpos='0 0'/>\n<key time='.5' qpos='1 1'/>\
                    \n<key qpos='2 2'/></keyframe></mujoco>";
        let e = from_mjcf(text, &robot(), Fill::Mask).unwrap_err().to_string();
        assert!(e.starts_with("3:1: there are two keys at 0 s"), "{e}");
        assert!(e.contains("without a time"), "{e}");
        let two = text.replace("<key qpos='2 2'/>", "");
        let clip = from_mjcf(&two, &robot(), Fill::Mask).unwrap();
        assert_eq!(clip.keys.iter().map(|k| k.frame).collect::<Vec<_>>(), [0, 10]);
        assert_eq!(clip.notes, "");
    }

    #[test]
    fn wrong_size_names_both_numbers() {
        let text = "<mujoco>\n <keyframe>\n  <key qpos='1 2 3'/>\n</keyframe></mujoco>";
        let e = from_mjcf(text, &robot(), Fill::Mask).unwrap_err().to_string();
        assert!(e.starts_with("3:8: qpos has 3 numbers, but r has 2 joints"), "{e}");
    }

    #[test]
    fn hostile_xml_is_refused() {
        for text in [
            "<a>".repeat(1_000_000),
            "<mujoco><keyframe><key qpos='nan 1'/></keyframe></mujoco>".to_owned(),
            "<mujoco><keyframe><key qpos='1 1' time='1e9'/></keyframe></mujoco>".to_owned(),
            "<!DOCTYPE a [<!ENTITY b 'c'>]><a>&b;</a>".to_owned(),
            "<mujoco/>".to_owned(),
            String::new(),
        ] {
            assert!(from_mjcf(&text, &robot(), Fill::Mask).is_err());
        }
    }
}
