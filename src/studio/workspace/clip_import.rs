//! Reads clips of any supported format.

use std::path::Path;

use serde::Deserialize;

use crate::protocol::FileKind;
use robert_clip as clip;
use robert_clip::formats::{from_command_json, from_csv, from_mjcf, from_ros};
use robert_clip::{Clip, ClipError, Fill, RobotRef};

/// A clip of any format. Between imported keys there is no goal, as with `robert clip convert`.
///
/// # Errors
/// [`ClipError`] with line and column.
pub(crate) fn read(
    kind: FileKind,
    bytes: Vec<u8>,
    robot: Option<&RobotRef>,
) -> Result<Clip, ClipError> {
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
        FileKind::Clip => clip::parse_bytes(bytes).map(|p| p.clip),
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
