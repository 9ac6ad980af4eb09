//! Robots that can be chosen: those of the program and of the user's folders.

use std::path::{Path, PathBuf};

use super::runs::folders;
use crate::protocol::RobotCard;
use robert_robot as robot;
use robert_robot::{MODEL_FILE, Robot};
use robert_rollout::shipped;

/// Robots in the program, then those in the studio's folder and in the state folder.
pub(crate) fn cards(folder: &Path, state_dir: &Path) -> Vec<RobotCard> {
    let mut cards: Vec<RobotCard> = Robot::builtin_ids()
        .map(|id| RobotCard {
            id: id.to_owned(),
            source: id.to_owned(),
            builtin: true,
            models: shipped::names(id),
        })
        .collect();
    for dir in homes(folder, state_dir) {
        for dir in folders(&dir) {
            let Some(id) = dir.file_name().and_then(|n| n.to_str()).map(str::to_owned) else {
                continue;
            };
            if dir.join(MODEL_FILE).is_file() && cards.iter().all(|c| c.id != id) {
                let source = dir.display().to_string();
                let models = shipped::names_in(&dir);
                cards.push(RobotCard { id, source, builtin: false, models });
            }
        }
    }
    cards
}

/// The folders that may contain the user's own robots.
fn homes(folder: &Path, state_dir: &Path) -> [PathBuf; 3] {
    [folder.join("robots"), folder.to_owned(), state_dir.join("robots")]
}

/// Whether a robot of this id comes with the program.
pub(crate) fn is_builtin(id: &str) -> bool {
    Robot::builtin_ids().any(|b| b == id)
}

/// The source from which a robot of this id is loaded: the program, or a folder beside us.
pub(crate) fn source(id: &str, folder: &Path, state_dir: &Path) -> Option<String> {
    if is_builtin(id) {
        return Some(id.to_owned());
    }
    let mut dirs = homes(folder, state_dir).into_iter().map(|home| home.join(id));
    let dir = dirs.find(|dir| robot::valid_id(id) && dir.join(MODEL_FILE).is_file());
    dir.map(|dir| dir.display().to_string())
}
