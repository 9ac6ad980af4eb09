//! `manifest.json` of a shard: what it did, with which arithmetic, and the sha256 of its files.
//!
//! It is the same for every run of the shard, so two runs can be compared by it. Times and hosts
//! are in the logs. The last line is a checksum of the others, which detects a flipped byte
//! anywhere in the manifest.

use robert_base::json;
use std::path::Path;

use robert_base::{fsio, limits};
use serde::{Deserialize, Serialize};

use super::{Cell, Error, Machine};

/// The file in a shard's folder.
pub(super) const FILE: &str = "manifest.json";
/// Format name of this version.
const FORMAT: &str = "robert-shard/1";

/// One file of a shard.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileEntry {
    /// Path inside the shard's folder, with `/`.
    pub path: String,
    /// Size.
    pub bytes: u64,
    /// Sha-256 of its content.
    pub sha256: String,
}

/// The content of `manifest.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// `robert-shard/1`.
    pub format: String,
    /// Index of the shard.
    pub index: usize,
    /// Name of its folder.
    pub name: String,
    /// Its work.
    pub cell: Cell,
    /// The kind of arithmetic that computed it.
    pub numerics: String,
    /// Sha-256 of the program that computed it.
    pub binary_sha256: String,
    /// Episodes and rollouts that were lost because the simulation diverged.
    pub lost: u64,
    /// The files, by path.
    pub files: Vec<FileEntry>,
    /// Sha-256 of this manifest with an empty seal.
    pub seal: String,
}

impl Manifest {
    /// The manifest of the files in `dir`.
    ///
    /// # Errors
    /// [`Error::Files`].
    pub(super) fn of(
        dir: &Path,
        index: usize,
        name: &str,
        cell: &Cell,
        machine: &Machine,
        lost: u64,
    ) -> Result<Self, Error> {
        let mut paths = Vec::new();
        list(dir, dir, &mut paths)
            .map_err(|source| fsio::Error::Read { source, path: dir.to_owned() })?;
        paths.sort();
        let entry = |path: String| -> Result<FileEntry, Error> {
            let file = dir.join(&path);
            let bytes = std::fs::metadata(&file)
                .map_err(|source| fsio::Error::Read { source, path: file.clone() })?
                .len();
            Ok(FileEntry { bytes, sha256: fsio::sha256_file(&file)?, path })
        };
        let mut manifest = Manifest {
            format: FORMAT.to_owned(),
            index,
            name: name.to_owned(),
            cell: cell.clone(),
            numerics: machine.numerics.clone(),
            binary_sha256: machine.binary_sha256.clone(),
            lost,
            files: paths.into_iter().map(entry).collect::<Result<_, _>>()?,
            seal: String::new(),
        };
        manifest.seal = fsio::sha256_hex(manifest.text().as_bytes());
        Ok(manifest)
    }

    pub(super) fn text(&self) -> String {
        json::pretty(self) + "\n"
    }

    /// Reads the manifest in `dir`.
    ///
    /// # Errors
    /// What is wrong with it.
    pub(super) fn read(dir: &Path) -> Result<Self, String> {
        let bytes = fsio::read_capped(&dir.join(FILE), limits::PLAN_SHARD_BYTES)
            .map_err(|e| e.to_string())?;
        let manifest: Manifest =
            serde_json::from_slice(&bytes).map_err(|e| format!("{FILE}: {e}"))?;
        let bare = Manifest { seal: String::new(), ..manifest.clone() };
        let sealed = fsio::sha256_hex(bare.text().as_bytes()) == manifest.seal;
        if manifest.format != FORMAT || !sealed || manifest.text().as_bytes() != bytes {
            return Err(format!("{FILE} was altered"));
        }
        let inside = |f: &FileEntry| {
            Path::new(&f.path).components().all(|c| matches!(c, std::path::Component::Normal(_)))
        };
        if !manifest.files.iter().all(inside) {
            return Err(format!("{FILE} names a file outside its folder"));
        }
        Ok(manifest)
    }

    /// Reads one of the files and checks its content.
    ///
    /// # Errors
    /// What is wrong with it.
    pub(super) fn file(&self, dir: &Path, path: &str) -> Result<Vec<u8>, String> {
        let Some(entry) = self.files.iter().find(|f| f.path == path) else {
            return Err(format!("the shard has no {path}"));
        };
        let bytes = fsio::read_capped(&dir.join(path), entry.bytes).map_err(|e| e.to_string())?;
        if fsio::sha256_hex(&bytes) != entry.sha256 {
            return Err(format!("{path} was altered"));
        }
        Ok(bytes)
    }
}

/// All files under `dir`, as paths relative to `root`.
pub(super) fn list(root: &Path, dir: &Path, found: &mut Vec<String>) -> std::io::Result<()> {
    for entry in std::fs::read_dir(dir)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            list(root, &entry.path(), found)?;
        } else if let Ok(path) = entry.path().strip_prefix(root) {
            found.push(path.to_string_lossy().into_owned());
        }
    }
    Ok(())
}
