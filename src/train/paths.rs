//! Paths inside a run directory, and the settings that it holds.

use std::path::{Path, PathBuf};

use super::{Error, TrainConfig};
use robert_base::{fsio, limits};

/// Settings.
pub fn config(dir: &Path) -> PathBuf {
    dir.join("config.toml")
}
/// Latest state, to resume from.
pub fn last(dir: &Path) -> PathBuf {
    dir.join("ckpt/last.safetensors")
}
/// Best model by Precision.
pub fn best(dir: &Path) -> PathBuf {
    dir.join("ckpt/best.safetensors")
}
/// Latest model, without optimiser state.
pub fn model(dir: &Path) -> PathBuf {
    dir.join("model.safetensors")
}
/// Training curves.
pub fn curves(dir: &Path) -> PathBuf {
    dir.join("curves.png")
}
/// One JSON object a line.
pub fn metrics(dir: &Path) -> PathBuf {
    dir.join("metrics.jsonl")
}
/// Robot, data and machine of the run.
pub fn meta(dir: &Path) -> PathBuf {
    dir.join("meta.json")
}

/// Reads the settings of a run directory.
///
/// # Errors
/// [`Error::Files`], [`Error::Run`].
pub fn read_config(dir: &Path) -> Result<TrainConfig, Error> {
    let path = config(dir);
    if path.try_exists().is_ok_and(|there| !there) {
        let why = "there is no run here; name a folder that robert train --out has made".to_owned();
        return Err(Error::Run { why, path: dir.to_owned() });
    }
    let bytes = fsio::read_capped(&path, limits::RUN_BYTES)?;
    let text = String::from_utf8_lossy(&bytes);
    let cfg: TrainConfig = toml::from_str(&text)
        .map_err(|e| Error::Run { why: e.message().replace('\n', " "), path: path.clone() })?;
    cfg.check()?;
    Ok(cfg)
}
