//! The built-in trained policies, `assets/models/ROBOT/NAME.safetensors`, and those in a robot's
//! own folder, `DIR/models/NAME.safetensors`, which take precedence.
//!
//! A robot's default is the model called [`DEFAULT`]. Other models serve other purposes (the
//! network as published, a model for unknown plants). The card of each contains its training data
//! and its figures.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use super::error::Error;
use super::model_file::robot_card;
use robert_base::fsio;
use robert_net::{Card, Model, checkpoint};
use robert_robot::Robot;

#[derive(rust_embed::RustEmbed)]
#[folder = "assets/models/"]
struct Files;

/// Name of a robot's default model.
pub const DEFAULT: &str = "robert";

/// A built-in model.
#[derive(Clone, Debug)]
pub struct ShippedModel {
    /// Robot that it drives.
    pub robot: String,
    /// Name: `robert`, `faithful`, ...
    pub name: String,
    /// Bytes of the file.
    pub bytes: u64,
    /// Its card.
    pub card: Card,
}

/// All built-in models, by robot and name.
///
/// # Errors
/// [`Error::Model`] when a file is damaged.
pub fn all() -> Result<Vec<ShippedModel>, Error> {
    let mut found = Vec::new();
    for path in Files::iter() {
        let Some((robot, name)) = split(&path) else { continue };
        let Some(file) = Files::get(&path) else { continue };
        found.push(ShippedModel {
            robot: robot.to_owned(),
            name: name.to_owned(),
            bytes: file.data.len() as u64,
            card: checkpoint::card(&file.data, Path::new(path.as_ref()))?,
        });
    }
    found.sort_by(|a, b| (&a.robot, &a.name).cmp(&(&b.robot, &b.name)));
    Ok(found)
}

/// Path of a model in a robot's folder.
pub fn path_in(dir: &Path, name: &str) -> PathBuf {
    dir.join("models").join(format!("{name}.safetensors"))
}

/// The file in a robot's folder that names its default policy, if that is not its model: a
/// name that `--policy` takes.
pub fn choice_in(dir: &Path) -> PathBuf {
    dir.join("models").join("default.txt")
}

/// Names of the built-in models of a robot; empty if it has none.
pub fn names(robot: &str) -> Vec<String> {
    let mut names: Vec<String> = Files::iter()
        .filter_map(|path| split(&path).filter(|(r, _)| *r == robot).map(|(_, n)| n.to_owned()))
        .collect();
    names.sort();
    names
}

/// Names of all models for this robot: those in its folder and the built-in ones.
pub fn of(robot: &Robot) -> Vec<String> {
    let mut found = names(robot.id());
    found.extend(robot.folder().map(names_in).unwrap_or_default());
    found.sort();
    found.dedup();
    found
}

/// Names of the models in a robot's folder.
pub fn names_in(dir: &Path) -> Vec<String> {
    let mut found = Vec::new();
    for entry in dir.join("models").read_dir().ok().into_iter().flatten().flatten() {
        let path = entry.path();
        if path.extension().is_some_and(|e| e == "safetensors")
            && let Some(name) = path.file_stem().and_then(|n| n.to_str())
        {
            found.push(name.to_owned());
        }
    }
    found.sort();
    found
}

/// A model of this robot by name; `None` if there is none. A folder's robot may have the name of a
/// built-in one; it gets the built-in models only if it is the same robot. Built-in models are
/// parsed once per process.
///
/// # Errors
/// [`Error::Model`]: a file in the robot's folder that is damaged, or was trained for another
/// version of the robot.
pub fn get(robot: &Robot, name: &str) -> Result<Option<Arc<Model>>, Error> {
    type Parsed = Mutex<BTreeMap<String, Arc<Model>>>;
    static PARSED: OnceLock<Parsed> = OnceLock::new();
    if let Some(own) = robot.folder().map(|dir| path_in(dir, name)).filter(|p| p.is_file()) {
        return Ok(Some(Arc::new(checkpoint::load(&own, Some(&robot_card(robot)))?)));
    }
    let path = format!("{}/{name}.safetensors", robot.id());
    let parsed = PARSED.get_or_init(Mutex::default);
    let known = parsed.lock().unwrap_or_else(PoisonError::into_inner).get(&path).cloned();
    let model = match (known, Files::get(&path)) {
        (Some(model), _) => model,
        (None, None) => return Ok(None),
        (None, Some(file)) => Arc::new(checkpoint::parse(&file.data, Path::new(&path), None)?),
    };
    parsed.lock().unwrap_or_else(PoisonError::into_inner).insert(path.clone(), model.clone());
    match checkpoint::same_robot(&model.card.robot, &robot_card(robot), Path::new(&path)) {
        Err(_) if robot.folder().is_some() => Ok(None),
        same => Ok(same.map(|()| Some(model))?),
    }
}

/// Sha-256 of the file that [`get`] would use; `None` if there is no such model.
///
/// # Errors
/// [`Error::Model`].
pub fn sha256(robot: &Robot, name: &str) -> Result<Option<String>, Error> {
    if let Some(own) = robot.folder().map(|dir| path_in(dir, name)).filter(|p| p.is_file()) {
        return Ok(Some(fsio::sha256_file(&own).map_err(robert_net::Error::from)?));
    }
    if get(robot, name)?.is_none() {
        return Ok(None);
    }
    let file = Files::get(&format!("{}/{name}.safetensors", robot.id()));
    Ok(file.map(|f| fsio::sha256_hex(&f.data)))
}

/// Whether there is a default model for this robot.
///
/// # Errors
/// As [`get`]: a model that is damaged, or of another robot, is an error and not a missing one.
pub fn has_default(robot: &Robot) -> Result<bool, Error> {
    Ok(get(robot, DEFAULT)?.is_some())
}

fn split(path: &str) -> Option<(&str, &str)> {
    path.strip_suffix(".safetensors")?.split_once('/')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shipped_model_drives_its_robot() {
        for found in all().unwrap() {
            let robot = Robot::builtin(&found.robot).unwrap();
            let model = get(&robot, &found.name).unwrap().unwrap();
            assert_eq!(model.card, found.card);
            assert!(names(&found.robot).contains(&found.name));
        }
    }

    #[test]
    fn what_is_not_there_is_nothing() {
        let robot = Robot::builtin("pointmass").unwrap();
        assert!(get(&robot, "no_such_model").unwrap().is_none());
        assert!(get(&robot, "../clips/suites").unwrap().is_none());
        assert!(names("nobody").is_empty());
    }
}
