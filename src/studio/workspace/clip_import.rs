//! Reads clips of any supported format.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use crate::protocol::{Error, FileKind};
use robert_base::units::CTRL_DT;
use robert_clip as clip;
use robert_clip::formats::{from_command_json, from_csv, from_mjcf, from_ros};
use robert_clip::{Clip, ClipError, Fill, RobotRef};
use robert_take::Take;
use robert_take::import::{Samples, from_lafan};

/// A clip of any format. Between imported keys there is no goal, as with `robert clip convert`.
///
/// Recorded motion has a key at every frame.
///
/// # Errors
/// [`Error::Clip`] with line and column, [`Error::Request`] for recordings.
pub(crate) fn read(
    kind: FileKind,
    bytes: Vec<u8>,
    robot: Option<&RobotRef>,
    rate: f64,
    path: &Path,
) -> Result<Clip, Error> {
    let foreign = |e: robert_take::Error| Error::request(e.in_file(path).to_string());
    let read = match (kind, robot) {
        (FileKind::Take, _) => reached(&Take::from_mcap(&bytes).map_err(foreign)?),
        (FileKind::Lafan, Some(robot)) => {
            let samples = from_lafan(&bytes, &robot.joints, rate).map_err(foreign)?;
            samples.clip(robot, &BTreeMap::new(), 0.0)
        }
        _ => text(kind, bytes, robot),
    };
    Ok(read.map_err(|e| e.in_file(path))?)
}

/// The motion of a take.
fn reached(take: &Take) -> Result<Clip, ClipError> {
    let robot = RobotRef {
        id: take.robot.id.clone(),
        model_sha256: Some(take.robot.model_sha256.clone()),
        joints: take.robot.joints.clone(),
        units: take.robot.units.clone(),
        ..RobotRef::default()
    };
    let rows: Vec<Vec<f64>> = (0..take.frames()).map(|t| take.state(t).to_vec()).collect();
    let secs = (0..rows.len()).map(|t| t as f64 * CTRL_DT).collect();
    let samples = Samples { joints: robot.joints.clone(), secs, rows, degrees: false };
    samples.clip(&robot, &BTreeMap::new(), 0.0)
}

/// A clip, or a table of commands.
fn text(kind: FileKind, bytes: Vec<u8>, robot: Option<&RobotRef>) -> Result<Clip, ClipError> {
    let nobody = RobotRef::default();
    let known = robot.unwrap_or(&nobody);
    let text = |bytes: Vec<u8>| {
        String::from_utf8(bytes).map_err(|e| {
            let good = e.as_bytes().get(..e.utf8_error().valid_up_to()).unwrap_or_default();
            let line = good.split(|b| *b == b'\n').count();
            let col = good.iter().rev().take_while(|b| **b != b'\n').count() + 1;
            ClipError::at("this is not UTF-8 text", line, col)
        })
    };
    match kind {
        FileKind::Csv => from_csv(&bytes, robot, Fill::Mask),
        FileKind::Mjcf => from_mjcf(&text(bytes)?, known, Fill::Mask),
        FileKind::Ros => from_ros(&text(bytes)?, robot, Fill::Mask),
        FileKind::Clip if is_command(&bytes) => from_command_json(&text(bytes)?, None, Fill::Mask),
        _ => clip::parse_bytes(bytes).map(|p| p.clip),
    }
}

/// Whether this is a dense command (`robert-command/1`).
fn is_command(bytes: &[u8]) -> bool {
    #[derive(Deserialize)]
    struct Heading {
        format: String,
    }
    let found = serde_json::from_slice::<Heading>(bytes);
    found.is_ok_and(|h| h.format.starts_with("robert-command/"))
}

/// The name without its ending.
pub(crate) fn stem(path: &Path) -> String {
    let name = path.file_name().and_then(|n| n.to_str()).unwrap_or_default();
    name.split('.').next().unwrap_or_default().chars().take(80).collect()
}
