//! The parts that `rollout` and `eval` share: the robot, the clip, and policies as they are typed.

use std::path::Path;
use std::sync::Arc;

use super::failure::{Failure, Outcome};
use super::{input, output};
use crate::clip::{Clip, Command, Invalid, parse};
use crate::exit::HasExit;
use crate::robot::{MODEL_FILE, PROFILE_FILE, Robot};
use crate::rollout::{ClipFacts as _, Guide, PolicyConfig, in_order, tasks};
use crate::take::Take;
use crate::units::Unit;

/// Suffix of the clip files.
pub(super) const CLIP_SUFFIX: &str = ".clip.json";

/// The robot of this id, or of this folder.
pub(super) fn robot(id: &str) -> Outcome<Arc<Robot>> {
    Ok(Arc::new(Robot::load(id)?))
}

/// The robot named by `--robot`, else the one that a clip or take names: a built-in one, or a robot's folder
/// of that name in the current folder.
pub(super) fn robot_for(asked: Option<&str>, own: &str) -> Outcome<Arc<Robot>> {
    let is_robot = |dir: &Path| [PROFILE_FILE, MODEL_FILE].iter().any(|f| dir.join(f).is_file());
    let stranger = Path::new(own).is_dir() && !is_robot(Path::new(own));
    match (asked, Robot::load(asked.unwrap_or(own))) {
        (None, Err(e)) if stranger || matches!(e, crate::robot::Error::Unknown { .. }) => {
            Err(Failure::invalid(format!(
                "this is for robot \"{own}\", which is not built in: give its folder with --robot DIR"
            )))
        }
        (_, loaded) => Ok(Arc::new(loaded?)),
    }
}

/// A clip from a file, the clip inside a take, or a shipped task by its name (`fire`,
/// `ur5e/reacher`).
pub(super) fn clip(text: &str, robot: Option<&str>) -> Outcome<Clip> {
    let path = Path::new(text);
    if is_take(path) {
        return clip_of(&input::take(path)?, text);
    }
    if input::exists(path) || path.extension().is_some_and(|e| e == "json") {
        return Ok(input::clip(path)?.clip);
    }
    tasks::find(text, robot).map_err(|e| {
        let exit = e.exit();
        Failure::with(exit, format!("no file {text}, and {e}"))
    })
}

/// The command of a clip, its joints in the robot's order; if it is another robot's, the error
/// begins with `text`, the clip's file or name.
pub(super) fn command(clip: &Clip, robot: &Robot, text: &str) -> Outcome<Command> {
    let command = robot.compile(clip).map_err(|e| broken(e, clip, text))?;
    in_order(robot, command).map_err(|e| Failure::with(e.exit(), format!("{text}: {e}")))
}

/// A rule that a clip breaks, with its line if the clip is in a file.
fn broken(invalid: Invalid, clip: &Clip, text: &str) -> Failure {
    let path = Path::new(text);
    let again = path.is_file().then(|| crate::clip::load(path).ok()).flatten();
    match again.filter(|parsed| parsed.clip == *clip) {
        Some(parsed) => parsed.broken(invalid).in_file(path).into(),
        None => Failure::invalid(format!("{text}: {invalid}")),
    }
}

/// An export of MJCF keyframes inside the robot's model.
pub(super) fn with_model(robot: &Robot, keys: &str) -> Outcome<String> {
    if robot.has_assets() {
        let folder = robot.folder().map_or_else(String::new, |f| format!(" ({})", f.display()));
        tracing::warn!(
            "the model refers to meshes, so keep the file in the robot's folder{folder}"
        );
    }
    let Some(text) = robot.mjcf_with_keys(keys) else {
        return Err(Failure::invalid(format!("the model of {} is not closed", robot.id())));
    };
    // A declaration must be first.
    let root = if text.starts_with("<?xml") { text.find("?>").map_or(0, |at| at + 2) } else { 0 };
    let (declaration, model) = text.split_at(root);
    Ok(format!("{declaration}{}{model}", output::WRITTEN))
}

/// The clip that a take was made from.
pub(super) fn clip_of(take: &Take, text: &str) -> Outcome<Clip> {
    let Some(clip) = &take.clip_text else {
        return Err(Failure::invalid(format!("{text}: the take contains no clip")));
    };
    let inside = format!("{text}/clip.json");
    let parsed = parse(clip.clone()).map_err(|e| e.in_file(Path::new(&inside)))?;
    Ok(parsed.clip)
}

/// Whether it is a take, by its name or its first bytes; everything else is read as a clip.
pub(super) fn is_take(path: &Path) -> bool {
    let named = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("mcap"));
    named || input::head(path, 5) == b"\x89MCAP"
}

/// Parses a policy as [`PolicyConfig`] does. The flags `guide` and `refine` apply to every policy.
pub(super) fn policy(text: &str, guide: Guide, refine: bool) -> Outcome<PolicyConfig> {
    let mut config: PolicyConfig = text.parse()?;
    if config.guide == Guide::None {
        config.guide = guide;
    }
    config.refine |= refine;
    Ok(config)
}

/// Unit of a robot's errors, for tables.
pub(super) fn unit(robot: &Robot) -> &'static str {
    let units: Vec<Unit> = robot.joints().iter().map(|j| j.unit).collect();
    match (units.contains(&Unit::Rad), units.contains(&Unit::M)) {
        (true, true) => "rad or m",
        (false, true) => "m",
        _ => "rad",
    }
}
