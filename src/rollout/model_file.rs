//! Model files: where a path leads, and whether a model is for a robot.

use std::path::{Path, PathBuf};

use super::error::Error;
use robert_net::{Model, RobotCard, checkpoint};
use robert_robot::Robot;

/// The robot in the form of a model card.
pub fn robot_card(robot: &Robot) -> RobotCard {
    RobotCard {
        id: robot.id().to_owned(),
        model_sha256: robot.model_sha256().to_owned(),
        joints: robot.joints().iter().map(|j| j.name.clone()).collect(),
        actuators: robot.actuators().iter().map(|a| a.name.clone()).collect(),
    }
}

/// The model file that a path refers to: the file itself; in a run directory the best model, or
/// else the last one; in a dataset's folder the fit.
pub fn model_path(path: &Path) -> PathBuf {
    let inside = ["ckpt/best.safetensors", "model.safetensors", "ridge.safetensors"];
    let inside = inside.map(|name| path.join(name));
    inside.into_iter().find(|p| p.exists()).unwrap_or_else(|| path.to_owned())
}

/// Run directories near a path, for error messages: those in its folder and in `runs`, as they
/// would be typed.
pub fn runs_near(path: &Path) -> Vec<String> {
    let mut folders = vec![path.parent().map_or_else(PathBuf::new, Path::to_path_buf)];
    if folders[0] != Path::new("runs") {
        folders.push(PathBuf::from("runs"));
    }
    let mut found = Vec::new();
    for folder in folders {
        let here = if folder.as_os_str().is_empty() { Path::new(".") } else { &folder };
        for entry in here.read_dir().ok().into_iter().flatten().flatten() {
            if entry.path().join("config.toml").is_file() {
                found.push(folder.join(entry.file_name()).display().to_string());
            }
        }
    }
    found.sort();
    found
}

/// Loads the model of a path and checks that it is for this robot.
///
/// # Errors
/// [`Error::Model`].
pub fn load(robot: &Robot, path: &Path) -> Result<Model, Error> {
    Ok(checkpoint::load(&model_path(path), Some(&robot_card(robot)))?)
}
