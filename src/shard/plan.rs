//! `plan.json`: all cells, checked, with the hashes of everything that they read.

use robert_base::json;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use robert_base::{fsio, limits};
use serde::{Deserialize, Serialize};

use super::{Cell, Error, Machine, Manifest, Spec};

/// Format name of this version.
pub(super) const FORMAT: &str = "robert-shard-plan/1";
/// The file in a plan's folder.
const FILE: &str = "plan.json";
/// The number of shards from which their folders are divided into subfolders, because parallel file
/// systems are slow with many entries in one folder.
const DIVIDED: usize = 1000;
/// The most shards of a plan.
pub(super) const SHARDS: usize = 100_000;

/// The content of `plan.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// `robert-shard-plan/1`.
    pub format: String,
    /// The name for people and queues, taken from the spec.
    pub name: String,
    /// The request.
    pub spec: Spec,
    /// The kind of arithmetic that all shards use.
    pub numerics: String,
    /// Whether processes limit themselves to that kind.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub limited: bool,
    /// Sha-256 of the program that all shards use.
    pub binary_sha256: String,
    /// Dataset folder; relative to the plan's folder if it is inside.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub data: Option<PathBuf>,
    /// Sha-256 of robot, data, models and other inputs, by their kind.
    pub inputs: BTreeMap<String, String>,
    /// The work of each shard, by index.
    pub cells: Vec<Cell>,
}

/// Differences from the plan that a person allows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Accept {
    /// Other kinds of processors.
    pub any_processor: bool,
    /// Other builds of the program.
    pub any_build: bool,
}

impl Plan {
    /// Reads the plan of a folder.
    ///
    /// # Errors
    /// [`Error::Plan`], [`Error::Files`].
    pub fn load(dir: &Path) -> Result<Self, Error> {
        let path = dir.join(FILE);
        let fail = |why: String| Error::Plan { why, path: path.clone() };
        if !path.is_file() {
            return Err(fail("there is no plan; make one with robert shard plan".to_owned()));
        }
        let bytes = fsio::read_capped(&path, limits::PLAN_BYTES)?;
        let plan: Plan = serde_json::from_slice(&bytes).map_err(|e| fail(e.to_string()))?;
        if plan.format != FORMAT {
            return Err(fail(format!("format is \"{}\", not \"{FORMAT}\"", plan.format)));
        }
        Ok(plan)
    }

    /// Writes the plan into a folder.
    ///
    /// # Errors
    /// [`Error::Files`].
    pub(super) fn save(&self, dir: &Path) -> Result<(), Error> {
        let text = json::line(self) + "\n";
        Ok(fsio::write_atomic(&dir.join(FILE), text.as_bytes())?)
    }

    /// Number of shards.
    pub fn shards(&self) -> usize {
        self.cells.len()
    }

    /// The cell of an index.
    ///
    /// # Errors
    /// [`Error::Index`].
    pub fn cell(&self, index: usize) -> Result<&Cell, Error> {
        self.cells.get(index).ok_or(Error::Index { index, shards: self.shards() })
    }

    /// Hash of everything that all cells share.
    pub(super) fn common(&self) -> String {
        let shared = serde_json::json!({
            "format": self.format,
            "spec": common_spec(&self.spec),
            "numerics": self.numerics,
            "binary": self.binary_sha256,
            "inputs": self.inputs,
        });
        fsio::sha256_hex(shared.to_string().as_bytes())
    }

    /// The name of a shard's folder: the index and a hash of everything that decides its content.
    /// `common` is [`Plan::common`].
    pub(super) fn name_of(common: &str, index: usize, cell: &Cell) -> String {
        let cell = json::line(cell);
        let hash = fsio::sha256_hex(format!("{common} {cell}").as_bytes());
        let hash = hash.get(..12).unwrap_or_default();
        format!("{index:06}-{hash}")
    }

    /// The folder that contains the folder of a shard.
    pub(super) fn parent_of(&self, dir: &Path, index: usize) -> PathBuf {
        let all = dir.join("shards");
        if self.shards() > DIVIDED { all.join(format!("{:02}", index / DIVIDED)) } else { all }
    }

    /// The dataset folder.
    pub(super) fn data_in(&self, dir: &Path) -> Option<PathBuf> {
        self.data.as_ref().map(|d| dir.join(d))
    }

    /// Limits this process to the arithmetic of the plan if the plan requires it. An error for a
    /// machine or a program that would compute other bits.
    ///
    /// # Errors
    /// [`Error::Processor`], [`Error::Build`].
    pub fn admit(&self, accept: Accept) -> Result<Machine, Error> {
        if self.limited && self.numerics == "avx2" {
            robert_linalg::limit_to_avx2();
        }
        let here = Machine::here()?;
        if !accept.any_processor && here.numerics != self.numerics {
            return Err(Error::Processor { here: here.numerics, planned: self.numerics.clone() });
        }
        if !accept.any_build && here.binary_sha256 != self.binary_sha256 {
            return Err(Error::Build {
                here: here.binary_sha256,
                planned: self.binary_sha256.clone(),
            });
        }
        Ok(here)
    }

    /// Why a finished shard was not made as this plan requires; `None` if it was.
    pub(super) fn foreign(&self, manifest: &Manifest, accept: Accept) -> Option<String> {
        if !accept.any_processor && manifest.numerics != self.numerics {
            return Some(format!("computed with {}, not {}", manifest.numerics, self.numerics));
        }
        let other = !accept.any_build && manifest.binary_sha256 != self.binary_sha256;
        other.then(|| "computed by another build of the program".to_owned())
    }
}

/// The spec without the fields that only divide the work.
fn common_spec(spec: &Spec) -> serde_json::Value {
    let mut value = json::value(spec);
    if let Some(fields) = value.as_object_mut() {
        for cut in
            ["shards", "transitions", "seed", "seeds", "tasks_per_shard", "grid", "x", "title"]
        {
            fields.remove(cut);
        }
        for listed in ["policies", "data"] {
            fields.remove(listed);
        }
    }
    value
}
