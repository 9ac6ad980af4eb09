//! The parts of a plan while it is made: cells, and hashes of what they read.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use robert_base::fsio;
use robert_robot::Robot;

use super::{Cell, Error};

/// The growing parts of a plan: cells, inputs and data.
#[derive(Debug, Default)]
pub(super) struct Draft {
    pub(super) cells: Vec<Cell>,
    pub(super) inputs: BTreeMap<String, String>,
    pub(super) data: Option<PathBuf>,
}

/// The canonical path of a folder; names of other things stay as they are.
pub(super) fn whole(text: &str) -> Result<String, Error> {
    let path = Path::new(text);
    if Robot::builtin_ids().any(|id| id == text) || !path.is_dir() {
        return Ok(text.to_owned());
    }
    let real = path
        .canonicalize()
        .map_err(|source| fsio::Error::Read { source, path: path.to_owned() })?;
    Ok(real.to_string_lossy().into_owned())
}

/// Sha-256 of a robot: its model and, for a folder, its profile.
pub(super) fn fingerprint(robot: &Robot) -> Result<String, Error> {
    let profile = robot.folder().map(|f| f.join("profile.toml")).filter(|p| p.is_file());
    let profile = profile.map(|p| fsio::sha256_file(&p)).transpose()?.unwrap_or_default();
    Ok(fsio::sha256_hex(format!("{} {profile}", robot.model_sha256()).as_bytes()))
}
