//! Shared by the clip commands: reading files, finding robots, writing files.

use std::path::{Path, PathBuf};

use crate::cli::failure::{Failure, Outcome};
use crate::cli::{input, out};
use crate::clip::{Clip, Command, Fill, JointTable, Parsed, RobotRef, compile_for};
use crate::robot::Robot;
use crate::rollout::ClipFacts;
use crate::units::CTRL_DT;

/// Reads a clip; `-` is stdin.
pub(super) fn load(path: &Path) -> Result<Parsed, Failure> {
    input::clip(path)
}

/// Loads a robot by its id or its folder.
pub(super) fn robot(id: &str) -> Result<Robot, Failure> {
    Ok(Robot::load(id)?)
}

/// The robot named on the command line, else the clip's own if it is known here.
pub(super) fn robot_of(clip: &Clip, asked: Option<&str>) -> Result<Option<Robot>, Failure> {
    match asked {
        Some(id) => robot(id).map(Some),
        None => match Robot::load(&clip.robot.id) {
            Err(crate::robot::Error::Unknown { .. }) => Ok(None),
            loaded => Ok(Some(loaded?)),
        },
    }
}

/// The joint table of a clip: the robot's, or if the robot is not known, only the facts that the
/// clip contains.
pub(super) fn joint_table(clip: &Clip, robot: Option<&Robot>) -> JointTable {
    robot.map_or_else(|| JointTable::from_clip(clip), ClipFacts::joint_table)
}

/// Compiles a clip with the requested robot, or else with its own if that is known here.
pub(super) fn compiled(clip: &Clip, asked: Option<&str>) -> Result<Command, Failure> {
    let robot = robot_of(clip, asked)?;
    compile_for(clip, Some(&joint_table(clip, robot.as_ref()))).map_err(Failure::invalid)
}

/// Robot and joint order for a file that does not contain them.
pub(super) fn reference(
    robot_id: Option<&str>,
    like: Option<&PathBuf>,
) -> Result<Option<RobotRef>, Failure> {
    match (robot_id, like) {
        (Some(id), _) => Ok(Some(robot(id)?.clip_ref())),
        (None, Some(path)) => Ok(Some(load(path)?.clip.robot)),
        (None, None) => Ok(None),
    }
}

/// Writes a clip to a file, or its text to stdout.
pub(super) fn deliver(clip: &Clip, out: Option<&Path>, force: bool) -> Outcome {
    // Names come from options and other files; a clip that no command reads again is not written.
    clip.validate().map_err(|e| Failure::invalid(e.to_string()))?;
    let Some(path) = out else { return out::line(clip.to_text().trim_end()) };
    if !force && !input::is_standard(path) && path.exists() {
        let path = path.display();
        return Err(Failure::usage(format!("{path} exists; --force overwrites it")));
    }
    input::write_clip(path, clip)?;
    if !input::is_standard(path) {
        let secs = f64::from(clip.length) * CTRL_DT;
        tracing::info!("{}: {secs:.2} s, {} keys", path.display(), clip.keys.len());
    }
    Ok(())
}

pub(super) fn fill_word(word: &str) -> Result<Fill, String> {
    Fill::from_word(word).ok_or_else(|| "one of mask, linear, cubic, hold".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fills_are_words_of_the_format() {
        assert_eq!(fill_word("cubic"), Ok(Fill::Cubic));
        assert!(fill_word("spline").is_err());
    }
}
