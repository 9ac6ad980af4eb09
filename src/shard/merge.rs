//! Puts the results of all shards together, or refuses and names what is not there.
//!
//! The merge opens and hashes the files instead of trusting lists of folders, because network file
//! systems may show lists that are a minute old. It writes a temporary folder and renames it, so
//! partial results never have the final name.

use robert_base::json;
use std::fs;
use std::path::{Path, PathBuf};

use robert_base::{fsio, parallel};
use serde::Serialize;

use super::error::write_error;
use super::manifest::{FileEntry, Manifest, list};
use super::survey::inspect;
use super::{Accept, Error, Plan, Spec, collecting, folder, tables, training};

/// The file that lists what a merge made, and from what. A folder with it belongs to a merge.
const FILE: &str = "merged.json";

/// The content of `merged.json`: no times and no hosts, so that equal work gives equal bytes.
#[derive(Clone, Debug, Serialize)]
pub struct Merged {
    /// Name of the plan.
    pub name: String,
    /// Kind of work.
    pub kind: &'static str,
    /// Number of shards.
    pub shards: usize,
    /// The kinds of arithmetic that computed them.
    pub numerics: Vec<String>,
    /// The programs that computed them.
    pub binary_sha256: Vec<String>,
    /// Episodes and rollouts that were lost because the simulation diverged.
    pub lost: u64,
    /// The merged result, by kind of work.
    pub summary: serde_json::Value,
    /// All other files of the folder.
    pub files: Vec<FileEntry>,
}

impl Merged {
    fn text(&self) -> String {
        json::pretty(self) + "\n"
    }

    /// Sha-256 of `merged.json`, and so of the whole set.
    pub fn sha256(&self) -> String {
        fsio::sha256_hex(self.text().as_bytes())
    }
}

/// Merges the plan in `dir` into the folder `out`. An earlier merge there is replaced. Files of
/// motion become hard links where the file system has them, unless `copy` is set; models are copied.
///
/// # Errors
/// [`Error::Incomplete`] with the indices that are missing, corrupt or foreign; then nothing is
/// written. [`Error::Occupied`] for a folder with other content.
pub fn merge(
    dir: &Path,
    plan: &Plan,
    out: &Path,
    accept: Accept,
    copy: bool,
) -> Result<Merged, Error> {
    let earlier = out.join(FILE).is_file();
    let empty = fs::read_dir(out).map_or(!out.exists(), |mut d| d.next().is_none());
    if !earlier && !empty {
        return Err(Error::Occupied { path: out.to_owned() });
    }
    let (found, manifests) = inspect(dir, plan, accept);
    if !found.left().is_empty() {
        return Err(Error::Incomplete {
            missing: found.missing(),
            corrupt: found.corrupt(),
            foreign: found.foreign(),
        });
    }
    let parent = match out.parent() {
        Some(p) if !p.as_os_str().is_empty() => p.to_owned(),
        _ => PathBuf::from("."),
    };
    fs::create_dir_all(&parent).map_err(write_error(&parent))?;
    let temporary = tempfile::Builder::new()
        .prefix(&format!("{}merge-", fsio::TEMPORARY))
        .tempdir_in(&parent)
        .map_err(write_error(&parent))?;
    let made = temporary.path().join("out");
    fs::create_dir(&made).map_err(write_error(&made))?;
    let manifests: Vec<Manifest> = manifests.into_iter().flatten().collect();
    let merged = fill(dir, plan, &manifests, &made, copy)?;
    let file = made.join(FILE);
    fs::write(&file, merged.text()).map_err(write_error(&file))?;
    folder::sync_all(&made).map_err(write_error(&made))?;
    if earlier {
        let old = temporary.path().join("old");
        fs::rename(out, &old).map_err(write_error(out))?;
    }
    fs::rename(&made, out).map_err(write_error(out))?;
    fs::File::open(&parent).and_then(|f| f.sync_all()).map_err(write_error(&parent))?;
    Ok(merged)
}

/// Writes the results of all shards into `made`.
fn fill(
    dir: &Path,
    plan: &Plan,
    manifests: &[Manifest],
    made: &Path,
    copy: bool,
) -> Result<Merged, Error> {
    let common = plan.common();
    let place = |(i, cell)| plan.parent_of(dir, i).join(Plan::name_of(&common, i, cell));
    let shards: Vec<PathBuf> = plan.cells.iter().enumerate().map(place).collect();
    let mut numerics: Vec<String> = manifests.iter().map(|m| m.numerics.clone()).collect();
    let mut builds: Vec<String> = manifests.iter().map(|m| m.binary_sha256.clone()).collect();
    let lost = manifests.iter().map(|m| m.lost).sum();
    for names in [&mut numerics, &mut builds] {
        names.sort();
        names.dedup();
    }
    let summary = match &plan.spec {
        Spec::Collect(_) => collecting::merge(&shards, made, copy)?,
        Spec::Eval(spec) => tables::evaluation(spec, &shards, manifests, made)?,
        Spec::Sweep(spec) | Spec::Train(spec) => {
            let reached = training::merge(&spec.sweep(), &shards, made)?;
            tables::training(&spec.sweep(), &reached, made)?
        }
    };
    let mut paths = Vec::new();
    list(made, made, &mut paths)
        .map_err(|source| fsio::Error::Read { source, path: made.to_owned() })?;
    paths.sort();
    Ok(Merged {
        name: plan.name.clone(),
        kind: plan.spec.kind(),
        shards: shards.len(),
        numerics,
        binary_sha256: builds,
        lost,
        summary,
        files: entries(made, &paths)?,
    })
}

/// Size and sha-256 of these files of a folder, in their order, by all cores.
fn entries(dir: &Path, paths: &[String]) -> Result<Vec<FileEntry>, Error> {
    let entry = |path: &String| -> Result<FileEntry, Error> {
        let file = dir.join(path);
        let bytes = fs::metadata(&file).map_err(write_error(&file))?.len();
        Ok(FileEntry { bytes, sha256: fsio::sha256_file(&file)?, path: path.clone() })
    };
    parallel::each(parallel::cores(), paths, |_, path| entry(path)).into_iter().collect()
}
