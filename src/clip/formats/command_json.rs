//! The dense command as JSON, `robert-command/1`: rows by frame, null where masked.

use robert_base::json;
use serde::{Deserialize, Serialize};

use super::super::command::{Command, Sight};
use super::super::document::{Clip, Fill, RobotRef, Row};
use super::super::error::ClipError;
use super::super::grid::round;
use super::super::json::show;
use super::{Track, places};
use robert_base::limits;
use robert_base::units::FPS;

const FORMAT: &str = "robert-command/1";

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    format: String,
    robot: String,
    fps: u32,
    joints: Vec<String>,
    start: Vec<f32>,
    /// (frames, joints)
    q: Vec<Option<Vec<Option<f32>>>>,
}

/// A command as one JSON document.
pub fn to_command_json(command: &Command, robot: &str) -> String {
    let row = |t: u32| {
        (command.sight(t) != Sight::Masked).then(|| {
            command
                .row(t)
                .iter()
                .enumerate()
                .map(|(j, v)| command.sees(t, j).then_some(*v))
                .collect::<Vec<Option<f32>>>()
        })
    };
    let document = Document {
        format: FORMAT.to_owned(),
        robot: robot.to_owned(),
        fps: FPS,
        joints: command.joints().to_vec(),
        start: command.start().to_vec(),
        q: Vec::new(),
    };
    // Plain numbers and strings: serialising cannot fail.
    let empty = json::line(&document);
    let mut text = empty.trim_end_matches("]}").to_owned();
    // One line for each frame with goals, and one for each run of masked frames.
    let mut masked: Option<bool> = None;
    for t in 0..command.frames() {
        let row = row(t);
        match masked {
            None => {}
            Some(true) if row.is_none() => text.push(','),
            Some(_) => text.push_str(",\n"),
        }
        text.push_str(&json::line(&row));
        masked = Some(row.is_none());
    }
    text.push_str("]}\n");
    text
}

/// Reads such a document. Without a robot the names of the document are used.
///
/// # Errors
/// [`ClipError::Syntax`] with line and column.
pub fn from_command_json(
    text: &str,
    robot: Option<&RobotRef>,
    fill: Fill,
) -> Result<Clip, ClipError> {
    let document: Document = serde_json::from_str(text)
        .map_err(|e| ClipError::at(e.to_string(), e.line(), e.column()))?;
    let whole = |message: String| Err(ClipError::at(message, 1, 1));
    if document.format != FORMAT {
        return whole(format!("the format is \"{}\", not {FORMAT}", show(&document.format)));
    }
    if document.fps != FPS {
        return whole(format!("{} frames a second, not {FPS}", document.fps));
    }
    let dim = document.joints.len();
    let cells = document.q.len().saturating_mul(dim);
    if document.q.len() > limits::CLIP_FRAMES as usize || cells > limits::CLIP_VALUES {
        return whole(format!("{} frames of {dim} joints are too many", document.q.len()));
    }
    let own = RobotRef {
        id: document.robot.clone(),
        joints: document.joints.clone(),
        ..RobotRef::default()
    };
    let robot = robot.cloned().unwrap_or(own);
    let order = places(&document.joints, &robot, |_| (1, 1))?;
    let spread = |row: &[Option<f32>]| {
        let mut out: Row = vec![None; robot.joints.len()];
        for (&j, v) in order.iter().zip(row) {
            if let Some(slot) = out.get_mut(j) {
                *slot = v.map(near);
            }
        }
        out
    };
    if document.start.len() != dim {
        return whole(format!("{} start values for {dim} joints", document.start.len()));
    }
    let start: Vec<Option<f32>> = document.start.iter().copied().map(Some).collect();
    let mut track =
        Track { length: document.q.len() as u32, start: Some(spread(&start)), ..Track::default() };
    for (frame, row) in (0..).zip(&document.q) {
        let Some(row) = row else { continue };
        if row.len() != dim {
            return whole(format!("frame {frame}: {} values for {dim} joints", row.len()));
        }
        track.rows.insert(frame, spread(row));
    }
    track.clip(robot, fill)
}

/// The document's value nearest to an `f32`: its shortest decimal, so that 0.1 stays 0.1.
fn near(v: f32) -> f64 {
    round(v.to_string().parse().unwrap_or(f64::from(v)))
}
