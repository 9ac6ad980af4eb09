//! The view of the data that a point of a sweep learns from.

use std::path::Path;

use super::value::{Combination, Value};
use crate::Error;
use robert_dataset::{self as dataset, Corruption, Dataset, Manifest, Verify};

/// Seed of the split into trained and held-out trajectories, the same for all points.
pub(super) const SPLIT_SEED: u64 = 0;
/// Share held out (the paper's 95/5).
const TEST_SHARE: f64 = 0.05;

/// Settings that make another view of the data.
pub(super) const VIEWS: [&str; 2] = ["shrink", "corrupt"];

/// The view of the data that a point learns from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct View {
    pub(super) shrink: u64,
    pub(super) corrupt: f64,
}

impl View {
    pub(super) fn of(values: &Combination) -> Result<Self, String> {
        let shrink = match values.get("shrink") {
            None => 1,
            Some(Value::Integer(k)) if *k >= 1 => *k as u64,
            Some(other) => return Err(format!("shrink = {other}: takes 1 or more")),
        };
        let corrupt = values.get("corrupt").map_or(Some(0.0), Value::number);
        match corrupt.filter(|p| (0.0..=1.0).contains(p)) {
            Some(corrupt) => Ok(View { shrink, corrupt }),
            None => Err("corrupt takes 0 to 1".into()),
        }
    }

    fn name(self, seed: u64) -> String {
        match (self.shrink, self.corrupt) {
            (1, 0.0) => "whole".into(),
            (k, 0.0) => format!("shrink-{k}"),
            (k, p) => format!("shrink-{k}-corrupt-{p}-seed-{seed}"),
        }
    }

    /// Opens the view in `out/data`, and makes it if necessary.
    fn open(self, data: &Path, out: &Path, seed: u64) -> Result<Dataset, Error> {
        let dir = out.join("data").join(self.name(seed));
        if !dir.join("manifest.json").exists() {
            let mut m = Manifest::load(data)?;
            // An existing split of the data is kept.
            if m.episodes.iter().all(|e| e.part.is_none()) {
                dataset::split(&mut m, SPLIT_SEED, TEST_SHARE)?;
            }
            if self.shrink > 1 {
                dataset::shrink(&mut m, self.shrink)?;
            }
            if self.corrupt > 0.0 {
                let how = Corruption { share: self.corrupt, per_slot: false, seed };
                dataset::corrupt(&mut m, how)?;
            }
            dataset::rebase(&mut m, &Manifest::path_of(data), &dir)?;
            Dataset::publish(m, &dir)?;
        }
        Ok(Dataset::open(&dir, Verify::Structure)?)
    }
}

/// The view of the data in `data` that a point learns from, made in `out/data` if it is not there.
///
/// # Errors
/// [`Error::Sweep`] for values that make no view, [`Error::Data`].
pub fn view(values: &Combination, seed: u64, data: &Path, out: &Path) -> Result<Dataset, Error> {
    let view = View::of(values).map_err(|why| Error::Sweep { why, path: out.to_owned() })?;
    view.open(data, out, seed)
}
