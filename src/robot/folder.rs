//! Loads a robot from a folder that was imported or made by hand.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use super::profile::Written;
use super::{Assets, Error, MODEL_FILE, PROFILE_FILE, Robot, builtin, check, preparse};
use robert_base::{fsio, limits};

impl Robot {
    /// A robot by its id, or from a folder that contains `robot.xml` and, optionally,
    /// `profile.toml`.
    ///
    /// A folder is foreign data: it is read within limits, compiled in a child process first, and
    /// must not refer to files outside it.
    ///
    /// # Errors
    /// Every variant of [`Error`] with a file.
    pub fn load(id_or_dir: &str) -> Result<Robot, Error> {
        if builtin::find(id_or_dir).is_some() {
            return Robot::builtin(id_or_dir);
        }
        let path = Path::new(id_or_dir);
        if path.is_dir() {
            return Robot::from_folder(path);
        }
        if path.is_file() {
            let message = format!(
                "this is a file, not a robot folder; make a folder from it: robert import {id_or_dir} --out DIR"
            );
            return Err(Error::Unfit { message, path: path.to_owned() });
        }
        Err(super::unknown(id_or_dir))
    }

    /// A robot from a folder; see [`Robot::load`].
    ///
    /// # Errors
    /// As [`Robot::load`].
    pub fn from_folder(dir: &Path) -> Result<Robot, Error> {
        let profile = dir.join(PROFILE_FILE);
        let written = if profile.is_file() {
            let bytes = fsio::read_capped(&profile, limits::SETTINGS_BYTES)?;
            Written::parse(&String::from_utf8_lossy(&bytes), &profile)?
        } else {
            Written::default()
        };
        let id = id_of(dir);
        let model = written.model.clone().unwrap_or_else(|| MODEL_FILE.to_owned());
        if model.starts_with("builtin:") {
            let xml = super::builtin_model(&model, &profile)?;
            return Robot::assemble(written, xml, Assets::new(), &id, &profile, Some(dir.into()));
        }
        if model.contains(['/', '\\']) || model.starts_with("..") {
            let message = format!("model is \"{model}\"; it must be a file of this folder");
            return Err(Error::Mismatch { message, path: profile });
        }
        let path = dir.join(&model);
        let project = preparse::read(&path, Some(dir), preparse::MissingFiles::Refuse)?;
        if project.format == preparse::Format::Urdf {
            let message = format!(
                "this is a URDF; make a robot from it: robert import {} --out DIR",
                path.display()
            );
            return Err(Error::Unfit { message, path });
        }
        let assets = read_assets(&project)?;
        let print = super::fingerprint(&project.xml, &assets);
        if !known_good(&print) {
            check::compile(&path, &check::executable()?, check::STEPS)?;
            remember(print);
        }
        let at = if profile.is_file() { profile } else { path };
        Robot::assemble(written, &project.xml, assets, &id, &at, Some(dir.into()))
            .map_err(|e| located(e, &at))
    }
}

/// Adds the file name to simulator errors of the in-memory model.
fn located(e: Error, path: &Path) -> Error {
    match e {
        Error::Simulator(e) => Error::Simulator(e.at(path)),
        other => other,
    }
}

/// Contents of the files that a model refers to, by their plain names.
pub(super) fn read_assets(project: &preparse::Project) -> Result<Assets, Error> {
    let mut assets = Assets::new();
    for a in &project.assets {
        let name = file_name(&a.path);
        if assets.iter().any(|(n, _)| n.eq_ignore_ascii_case(&name)) {
            let message = format!(
                "two files have the name \"{name}\" (ignoring case and folders); rename one, or use robert import"
            );
            return Err(Error::Unfit { message, path: project.path.clone() });
        }
        assets.push((name, fsio::read_capped(&a.path, robert_base::limits::MESH_BYTES)?));
    }
    Ok(assets)
}

fn file_name(path: &Path) -> String {
    path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
}

/// An id made from a folder's name.
pub(super) fn id_of(dir: &Path) -> String {
    let full: PathBuf = dir.canonicalize().unwrap_or_else(|_| dir.to_owned());
    let name = file_name(&full).to_lowercase();
    let id: String = name
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' })
        .take(64)
        .collect();
    if id.trim_matches('_').is_empty() { "robot".to_owned() } else { id }
}

/// Fingerprints of models that compiled in a child of this process.
static GOOD: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());

fn known_good(print: &str) -> bool {
    GOOD.lock().unwrap_or_else(PoisonError::into_inner).contains(print)
}

fn remember(print: String) {
    GOOD.lock().unwrap_or_else(PoisonError::into_inner).insert(print);
}
