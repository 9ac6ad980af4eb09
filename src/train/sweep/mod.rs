//! Sweeps: a grid of settings, trained and evaluated with several seeds, in one table.
//!
//! Each point has its own run directory, so a stopped sweep continues where it was, and each point
//! can be inspected like any run. Settings of the data (`shrink`, `corrupt`) are views of the same
//! shards. The held-out trajectories are fixed first and are the same for every point.

mod figure;
mod point;
mod reached;
mod row;
mod suites;
mod value;
mod view;
mod work;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::{Error, TrainConfig};
use reached::none;
use robert_base::{fsio, limits};
use view::{VIEWS, View};

pub use figure::figure;
pub use point::Point;
pub use reached::Reached;
pub use row::{Row, rows};
pub use suites::suites_of;
pub use value::{Combination, Value, slug};
pub use view::view;
pub use work::Work;

/// The most points of a grid, including seeds.
const MOST_POINTS: usize = 10_000;

/// The content of a sweep file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sweep {
    /// Title of the table and the charts.
    pub title: String,
    /// Robot id or folder.
    pub robot: String,
    /// Dataset folder; the command line may name another.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub data: Option<PathBuf>,
    /// Preset that the points start from.
    pub preset: String,
    /// Settings of all points, which override the preset.
    #[serde(default)]
    pub set: BTreeMap<String, Value>,
    /// Values by setting; every combination is a point. `shrink` (keep every k-th
    /// trajectory) and `corrupt` (share of trajectories overwritten) are views of the data.
    pub grid: BTreeMap<String, Vec<Value>>,
    /// Seeds of every point.
    pub seeds: Vec<u64>,
    /// Setting on the x axis of the charts; must be in the grid.
    pub x: String,
    /// Suites that the model of each point performs: shipped ones, and `test` (extracted from
    /// held-out trajectories: unmasked, a quarter and half of the frames hidden).
    #[serde(default = "default_suites")]
    pub suites: Vec<String>,
    /// Tasks per suite extracted from data.
    #[serde(default = "default_cases")]
    pub cases: usize,
    /// Evaluations by rollout during each run, of which the best model counts; with 0 the last does,
    /// because evaluations take longer than small points.
    #[serde(default, skip_serializing_if = "none")]
    pub evaluations: u64,
}

fn default_suites() -> Vec<String> {
    ["manual", "extra", "test"].map(String::from).to_vec()
}

fn default_cases() -> usize {
    12
}

impl Sweep {
    /// Reads and checks a sweep file; `set` (`key=value`) overrides settings of all its points.
    ///
    /// # Errors
    /// [`Error::Files`], [`Error::Sweep`], those of the settings.
    pub fn load(path: &Path, set: &[String]) -> Result<Self, Error> {
        let bytes = fsio::read_capped(path, limits::SETTINGS_BYTES)?;
        let text = String::from_utf8_lossy(&bytes);
        let fail = |why: String| Error::Sweep { why, path: path.to_owned() };
        let mut sweep: Sweep =
            toml::from_str(&text).map_err(|e| fail(e.to_string().trim().replace('\n', " ")))?;
        for assignment in set {
            let Some((key, value)) = assignment.split_once('=') else {
                let why = "expected key=value".to_owned();
                return Err(Error::Setting { setting: assignment.clone(), why });
            };
            let Ok(value) = value.trim().parse();
            sweep.set.insert(key.trim().to_owned(), value);
        }
        if !sweep.grid.contains_key(&sweep.x) {
            let known: Vec<_> = sweep.grid.keys().map(String::as_str).collect();
            return Err(fail(format!(
                "x = {:?} is not in the grid ({})",
                sweep.x,
                known.join(", ")
            )));
        }
        sweep.check(path)?;
        Ok(sweep)
    }

    /// Checks the settings of every point; `path` is the file that they come from.
    ///
    /// # Errors
    /// [`Error::Sweep`], those of the settings.
    pub fn check(&self, path: &Path) -> Result<(), Error> {
        let (sweep, fail) = (self, |why: String| Error::Sweep { why, path: path.to_owned() });
        if sweep.seeds.is_empty() {
            return Err(fail("seeds is empty".into()));
        }
        if let Some((key, _)) = sweep.grid.iter().find(|(_, v)| v.is_empty()) {
            return Err(fail(format!("grid.{key} is empty")));
        }
        for key in VIEWS {
            if sweep.set.contains_key(key) {
                return Err(fail(format!("{key} belongs in [grid]; one value is enough there")));
            }
        }
        if sweep.set.contains_key("seed") || sweep.grid.contains_key("seed") {
            return Err(fail("seed is not a setting here: list the seeds in seeds = [...]".into()));
        }
        let mut distinct = sweep.seeds.clone();
        distinct.sort_unstable();
        distinct.dedup();
        if distinct.len() < sweep.seeds.len() {
            return Err(fail("a seed appears twice".into()));
        }
        let lengths = sweep.grid.values().map(Vec::len);
        let count = lengths.fold(sweep.seeds.len(), usize::saturating_mul);
        if count > MOST_POINTS {
            return Err(fail(format!("{count} points; at most {MOST_POINTS} are allowed")));
        }
        for values in sweep.combinations() {
            sweep.config(&values, 0)?;
            View::of(&values).map_err(fail)?;
        }
        Ok(())
    }

    /// Every combination of the grid, the last setting turning fastest.
    pub fn combinations(&self) -> Vec<Combination> {
        let mut all = vec![Combination::new()];
        for (key, values) in &self.grid {
            let each = |c: &Combination| {
                let with = |v: &Value| {
                    let mut c = c.clone();
                    c.insert(key.clone(), v.clone());
                    c
                };
                values.iter().map(with).collect::<Vec<_>>()
            };
            all = all.iter().flat_map(each).collect();
        }
        all
    }

    /// Settings of one point.
    ///
    /// # Errors
    /// [`Error::Preset`], [`Error::Setting`].
    pub fn config(&self, values: &Combination, seed: u64) -> Result<TrainConfig, Error> {
        let mut cfg = TrainConfig::preset(&self.preset)?;
        let own = values.iter().filter(|(k, _)| !VIEWS.contains(&k.as_str()));
        for (key, value) in self.set.iter().chain(own) {
            cfg.set(&format!("{key}={value}"))?;
        }
        cfg.set(&format!("seed={seed}"))?;
        cfg.check_network()?;
        Ok(cfg)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use robert_base::units::Unit;

    const TEXT: &str = r#"
        title = "masks"
        robot = "pointmass"
        preset = "pm-tiny"
        seeds = [0, 1, 2]
        x = "mask"
        [set]
        steps = 20
        lr = 2e-3
        [grid]
        mask = ["cl", "none"]
        shrink = [1, 10]
    "#;

    fn load(text: &str) -> Result<Sweep, Error> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("s.toml");
        std::fs::write(&path, text).unwrap();
        Sweep::load(&path, &[])
    }

    #[test]
    fn a_grid_is_every_combination() {
        let s = load(TEXT).unwrap();
        let all = s.combinations();
        assert_eq!(all.len(), 4);
        let names: Vec<_> = all.iter().map(slug).collect();
        assert_eq!(names[1], "mask-cl_shrink-10");
        let cfg = s.config(&all[3], 2).unwrap();
        assert_eq!((cfg.steps, cfg.seed, cfg.lr), (20, 2, 2e-3));
        assert_eq!(cfg.mask, robert_net::mask::MaskKind::None);
        assert_eq!(View::of(&all[3]).unwrap(), View { shrink: 10, corrupt: 0.0 });
    }

    #[test]
    fn what_is_wrong_in_a_file_is_named() {
        // Their product is 2^64, which a product of whole numbers takes for 0.
        let list = format!("[{}]", "1, ".repeat(1 << 16));
        let huge =
            ["lr", "batch", "heads", "width"].map(|key| format!("{key} = {list}\n")).concat();
        for (from, to, what) in [
            ("seeds = [0, 1, 2]", "seeds = []", "seeds"),
            ("seeds = [0, 1, 2]", "seeds = [1, 1]", "twice"),
            ("x = \"mask\"", "x = \"bins\"", "bins"),
            ("mask = [\"cl\", \"none\"]", "mask = [\"cl\", \"all\"]", "mask=all"),
            ("shrink = [1, 10]", "shrink = [0]", "shrink"),
            ("shrink = [1, 10]", "corrupt = [1.5]", "corrupt"),
            ("steps = 20", "stpes = 20", "stpes"),
            ("preset = \"pm-tiny\"", "preset = \"pm\"", "pm-plus"),
            ("shrink = [1, 10]", "seed = [1, 2]", "seeds = ["),
            ("steps = 20", "seed = 20", "seeds = ["),
            ("steps = 20", "heads = 5", "heads"),
            ("steps = 20", "preset = \"quick\"", "preset"),
            ("title = \"masks\"", "titel = \"masks\"", "titel"),
            ("shrink = [1, 10]", &huge, "points; at most 10000"),
        ] {
            assert!(TEXT.contains(from));
            let e = load(&TEXT.replace(from, to)).unwrap_err().to_string();
            assert!(e.contains(what), "{e}");
        }
    }

    #[test]
    fn shipped_sweeps_are_in_order() {
        let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/sweeps");
        let mut names = Vec::new();
        for entry in std::fs::read_dir(dir).unwrap() {
            let path = entry.unwrap().path();
            let set = ["steps=7".to_owned(), "lr=1e-2".to_owned()];
            let sweep = Sweep::load(&path, &set).unwrap();
            assert_eq!(sweep.seeds.len(), 3, "an interval needs three");
            let cfg = sweep.config(&sweep.combinations()[0], 0).unwrap();
            assert_eq!((cfg.steps, cfg.lr), (7, 1e-2));
            names.push(path.file_stem().unwrap().to_string_lossy().into_owned());
        }
        names.sort();
        let on_the_hand = ["hand-action-bins", "hand-corruption", "hand-masking"];
        assert_eq!(names[..2], ["action-bins", "corruption"]);
        assert_eq!(names[2..5], on_the_hand);
        assert_eq!(names[5..], ["masking", "scaling"]);
    }

    #[test]
    fn rows_are_means_over_seeds() {
        let s = load(TEXT).unwrap();
        let all = s.combinations();
        let reached = |values: &Combination, seed, p: Option<f64>| Reached {
            values: values.clone(),
            seed,
            dataset_sha256: String::new(),
            windows: 1,
            evaluations: 0,
            suites: [("manual".to_owned(), p)].into(),
            nmse_clear: Some(0.1),
            secs: Some(1.0),
        };
        let found = [
            reached(&all[0], 0, Some(1.0)),
            reached(&all[0], 1, Some(2.0)),
            reached(&all[0], 2, Some(3.0)),
            reached(&all[1], 0, Some(5.0)),
            reached(&all[1], 1, None),
        ];
        let rows = rows(&all, &found);
        assert_eq!(rows.len(), 2);
        let first = rows[0].suites["manual"].unwrap();
        assert_eq!((first.mean, first.n), (2.0, 3));
        assert!((first.ci95.unwrap() - 4.303 / 3.0_f64.sqrt()).abs() < 1e-12);
        assert!(rows[1].suites["manual"].is_none(), "a rollout that broke is no number");
        let figure = figure(&s, Unit::M, &rows).unwrap();
        assert!(figure.svg().unwrap().contains("shrink 10"));
    }
}
