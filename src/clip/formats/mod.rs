//! Clips from and to other programs' files.
//!
//! Every importer produces a `Track`: frames with rows, without keys. Runs of equal rows become one
//! key with a hold, so a dense export that is read back is a clip that a person can edit, with the
//! same compiled command bit for bit.

mod command_json;
mod csv;
mod mjcf;
mod ros;
mod samples;
mod trajectory;

pub use command_json::{from_command_json, to_command_json};
pub use csv::{from_csv, motion_to_csv, to_csv};
pub use mjcf::{from_mjcf, to_mjcf};
pub use ros::{from_ros, to_ros};
pub use samples::{Sample, from_samples};
pub use trajectory::{Trajectory, TrajectoryPoint};

use std::collections::BTreeMap;

use super::command::{Command, Sight};
use super::document::{Clip, Fill, Goal, Key, RobotRef, Row, Start};
use super::error::ClipError;
use super::flaw::hint;
use super::grid::round;
use super::json::show;
use robert_base::exit::{Exit, HasExit};
use robert_base::limits;
use robert_base::units::FPS;

/// Why a command does not fit a format.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// The format lists all joints in every row.
    #[error(
        "frame {frame} has goals for some joints only, which {format} cannot express; mask the frame or use csv"
    )]
    Partial {
        /// The first such frame.
        frame: u32,
        /// The format.
        format: &'static str,
    },
    /// No frame has a goal.
    #[error("no frame has a goal; {format} needs one")]
    Empty {
        /// The format.
        format: &'static str,
    },
}

impl HasExit for ExportError {
    fn exit(&self) -> Exit {
        Exit::Invalid
    }
}

/// Frames and rows on their way to a clip.
#[derive(Clone, Debug, Default)]
pub(crate) struct Track {
    pub(crate) rows: BTreeMap<u32, Row>,
    pub(crate) names: BTreeMap<u32, String>,
    pub(crate) start: Option<Row>,
    pub(crate) length: u32,
}

impl Track {
    /// The clip of these rows.
    pub(crate) fn clip(self, robot: RobotRef, fill: Fill) -> Result<Clip, ClipError> {
        let mut clip = Clip::new(robot, self.length.max(1));
        clip.fill = fill;
        for (frame, mut row) in self.rows {
            row.iter_mut().flatten().for_each(|v| *v = round(*v));
            if row.iter().all(Option::is_none) {
                continue;
            }
            let name = self.names.get(&frame);
            if let Some(last) = clip.keys.last_mut()
                && name.is_none()
                && last.frame + last.hold == frame
                && last.goal == Goal::Q(row.clone())
            {
                last.hold += 1;
                continue;
            }
            let goal = match name {
                Some(name) => {
                    clip.poses.insert(name.clone(), row);
                    Goal::Pose(name.clone())
                }
                None => Goal::Q(row),
            };
            if clip.keys.len() >= limits::CLIP_KEYS {
                let cap = limits::CLIP_KEYS;
                return Err(ClipError::at(format!("more than {cap} different rows"), 1, 1));
            }
            clip.keys.push(Key::with(frame, goal));
        }
        if let Some(start) = self.start {
            let Some(start) = start.into_iter().collect::<Option<Vec<f64>>>() else {
                let message =
                    "the start (frame -1) has no value for some joints; it needs all or none";
                return Err(ClipError::at(message, 1, 1));
            };
            clip.start = Some(Start::Q(start));
        }
        clip.normalize();
        // Places are no longer known here; the remaining errors (a pose name, a limit) concern the
        // whole file.
        clip.validate().map_err(|e| ClipError::at(e.to_string(), 1, 1))?;
        Ok(clip)
    }
}

/// A start row is written only if it differs from the first full one.
pub(crate) fn start_differs(command: &Command) -> bool {
    let first = command.next_visible(0);
    first.is_none_or(|f| command.row(f) != command.start() || command.sight(f) != Sight::Full)
}

/// The index of each column in the robot's joint order; every name may appear once.
pub(crate) fn places(
    columns: &[String],
    robot: &RobotRef,
    at: impl Fn(usize) -> (usize, usize),
) -> Result<Vec<usize>, ClipError> {
    let mut seen = vec![false; robot.joints.len()];
    let mut order = Vec::with_capacity(columns.len());
    for (i, name) in columns.iter().enumerate() {
        let (line, col) = at(i);
        let Some(j) = robot.joints.iter().position(|n| n == name) else {
            let hint = hint(name, robot.joints.iter().map(String::as_str));
            let message = format!("{} has no joint \"{}\"{hint}", show(&robot.id), show(name));
            return Err(ClipError::at(message, line, col));
        };
        match seen.get_mut(j) {
            Some(taken) if !*taken => *taken = true,
            _ => {
                let message = format!("joint \"{}\" appears twice", show(name));
                return Err(ClipError::at(message, line, col));
            }
        }
        order.push(j);
    }
    Ok(order)
}

/// The frame of a time in seconds; `None` beyond the longest clip.
pub(crate) fn frame_of(secs: f64) -> Option<u32> {
    let frame = (secs * f64::from(FPS)).round();
    (frame >= 0.0 && frame < f64::from(limits::CLIP_FRAMES)).then_some(frame as u32)
}

#[cfg(test)]
mod tests {
    use super::super::{Mask, compile};
    use super::*;

    fn robot() -> RobotRef {
        let joints = vec!["pan".to_owned(), "lift, \"x\"".to_owned()];
        RobotRef { id: "arm".into(), joints, ..RobotRef::default() }
    }

    fn clip() -> Clip {
        let mut clip = Clip::new(robot(), 40);
        clip.keys = vec![
            Key::new(0, &[0.1, -0.2]).held(5).filled(Fill::Cubic),
            Key::new(17, &[1.234_567, 20.5]).filled(Fill::Linear),
            Key::new(31, &[-3.0, 0.333_333]),
            Key::new(39, &[0.0, 1e-6]),
        ];
        clip.masks = vec![Mask { from: 20, to: 24, joints: None }];
        clip
    }

    /// After export and import the compiled command has the same bits.
    #[test]
    fn round_trips_are_exact() {
        let original = compile(&clip()).unwrap();
        let same = |back: Clip, what: &str| {
            let c = compile(&back).unwrap();
            assert_eq!(c.first_changed_frame(&original), None, "{what}");
            assert_eq!(c.frames(), original.frames(), "{what}");
        };
        same(from_csv(to_csv(&original).as_bytes(), Some(&robot()), Fill::Mask).unwrap(), "csv");
        let json = to_command_json(&original, "arm");
        same(from_command_json(&json, Some(&robot()), Fill::Mask).unwrap(), "json");
        let yaml = to_ros(&original).unwrap();
        same(from_ros(&yaml, Some(&robot()), Fill::Mask).unwrap(), "ros");
        let xml = to_mjcf(&original).unwrap();
        same(from_mjcf(&xml, &robot(), Fill::Mask).unwrap(), "mjcf");
    }

    #[test]
    fn an_explicit_start_survives() {
        let mut k = clip();
        k.start = Some(Start::Q(vec![0.5, 0.25]));
        let c = compile(&k).unwrap();
        let csv = from_csv(to_csv(&c).as_bytes(), Some(&robot()), Fill::Mask).unwrap();
        assert_eq!(csv.start, k.start);
        let xml = from_mjcf(&to_mjcf(&c).unwrap(), &robot(), Fill::Mask).unwrap();
        assert_eq!(xml.start, k.start);
        let json = from_command_json(&to_command_json(&c, "arm"), None, Fill::Mask).unwrap();
        assert_eq!(json.start, k.start);
    }

    #[test]
    fn partial_frames_survive_where_the_format_can_say_them() {
        let mut k = clip();
        k.masks = vec![Mask { from: 2, to: 9, joints: Some(vec!["pan".into()]) }];
        let c = compile(&k).unwrap();
        let back = from_csv(to_csv(&c).as_bytes(), Some(&robot()), Fill::Mask).unwrap();
        assert_eq!(compile(&back).unwrap().first_changed_frame(&c), None);
        assert!(matches!(to_ros(&c), Err(ExportError::Partial { frame: 2, .. })));
    }
}
