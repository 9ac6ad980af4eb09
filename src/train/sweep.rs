//! Sweeps: a grid of settings, trained and evaluated with several seeds, in one table.
//!
//! Each point has its own run directory, so a stopped sweep continues where it was, and each point
//! can be inspected like any run. Settings of the data (`shrink`, `corrupt`) are views of the same
//! shards. The held-out trajectories are fixed first and are the same for every point.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::evaluator::SuiteEvaluator;
use super::hindsight::Simulated;
use super::options::{Evaluate, Options};
use super::run::train;
use super::{Error, TrainConfig, paths};
use robert_base::progress::{Cancel, Progress, Silent};
use robert_base::units::Unit;
use robert_base::{fsio, limits};
use robert_dataset::{self as dataset, Corruption, Dataset, Manifest, Verify};
use robert_net::engine::Engines;
use robert_plot::{self as plot, Axis, Curve, Figure};
use robert_robot::{PlantRange, Robot};
use robert_rollout::{
    Case, ClipFacts as _, EvalConfig, Interval, PolicyConfig, PolicyName, Start, Suite, evaluate,
    mean_ci95, tasks, test_suites,
};

/// The most points of a grid, including seeds.
const MOST_POINTS: usize = 10_000;
/// Seed of the split into trained and held-out trajectories, the same for all points.
const SPLIT_SEED: u64 = 0;
/// Share held out (the paper's 95/5).
const TEST_SHARE: f64 = 0.05;

/// A value in a grid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Value {
    /// Whole number.
    Integer(i64),
    /// Number.
    Float(f64),
    /// Switch.
    Switch(bool),
    /// Word.
    Word(String),
}

impl std::fmt::Display for Value {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Value::Integer(x) => write!(f, "{x}"),
            Value::Float(x) => write!(f, "{x}"),
            Value::Switch(x) => write!(f, "{x}"),
            Value::Word(x) => write!(f, "{x}"),
        }
    }
}

impl std::str::FromStr for Value {
    type Err = std::convert::Infallible;

    /// The type of a text.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let number =
            || text.parse().map(Value::Integer).or_else(|_| text.parse().map(Value::Float));
        let switch = || text.parse().map(Value::Switch);
        Ok(number().or_else(|_| switch()).unwrap_or_else(|_| Value::Word(text.to_owned())))
    }
}

impl Value {
    fn number(&self) -> Option<f64> {
        match self {
            Value::Integer(x) => Some(*x as f64),
            Value::Float(x) => Some(*x),
            Value::Switch(_) | Value::Word(_) => None,
        }
    }
}

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

/// Results of sweeps without evaluations do not mention them.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn none(evaluations: &u64) -> bool {
    *evaluations == 0
}

fn default_suites() -> Vec<String> {
    ["manual", "extra", "test"].map(String::from).to_vec()
}

fn default_cases() -> usize {
    12
}

/// Settings that make another view of the data.
const VIEWS: [&str; 2] = ["shrink", "corrupt"];

/// One combination of values.
pub type Combination = BTreeMap<String, Value>;

/// The result of one point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reached {
    /// Values of this point.
    pub values: Combination,
    /// Seed.
    pub seed: u64,
    /// Sha-256 of the data's manifest.
    pub dataset_sha256: String,
    /// Windows learned from.
    pub windows: u64,
    /// Evaluations of which the best model was chosen; with 0 it is the last.
    #[serde(default, skip_serializing_if = "none")]
    pub evaluations: u64,
    /// Mean Precision by suite; `None` if a rollout diverged.
    pub suites: BTreeMap<String, Option<f64>>,
    /// Held-out action error, next frame known and away from stops and contact.
    pub nmse_clear: Option<f64>,
    /// Seconds of the last session; a shard leaves them out, so that its bits do not depend on the
    /// machine's speed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub secs: Option<f64>,
}

/// One row of the table: a combination, all seeds.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Values.
    pub values: Combination,
    /// Seeds that are done.
    pub seeds: usize,
    /// Mean and 95 % interval over seeds by suite; `None` if a rollout diverged.
    pub suites: BTreeMap<String, Option<Interval>>,
    /// Mean and 95 % interval over seeds of the held-out action error; `None` if it was not
    /// measured.
    pub nmse_clear: Option<Interval>,
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

/// The view of the data that a point learns from.
#[derive(Clone, Copy, Debug, PartialEq)]
struct View {
    shrink: u64,
    corrupt: f64,
}

impl View {
    fn of(values: &Combination) -> Result<Self, String> {
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

/// The folder name of a combination; other characters are replaced.
pub fn slug(values: &Combination) -> String {
    let text: Vec<String> = values.iter().map(|(k, v)| format!("{k}-{v}")).collect();
    let plain = |c: char| if c.is_ascii_alphanumeric() || "-._+".contains(c) { c } else { '_' };
    text.join("_").chars().map(plain).collect()
}

/// Options of a sweep.
pub struct Work<'a> {
    /// Dataset folder.
    pub data: PathBuf,
    /// Folder for points, table and charts.
    pub out: PathBuf,
    /// Threads.
    pub threads: usize,
    /// Seconds between checkpoints.
    pub checkpoint_secs: f64,
    /// Opens the engine that computes the steps; without it the processor does.
    pub engines: Option<&'a dyn Engines>,
    /// Receives the progress, in points.
    pub progress: &'a dyn Progress,
    /// Asks for a stop; finished points are kept.
    pub cancel: &'a Cancel,
    /// Further content of the meta.json of each run.
    pub meta: serde_json::Value,
}

impl std::fmt::Debug for Work<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Work").field("out", &self.out).finish_non_exhaustive()
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

/// One point of a sweep: what is trained, on which data, and what the model then performs.
#[derive(Clone, Copy, Debug)]
pub struct Point<'a> {
    /// The sweep.
    pub sweep: &'a Sweep,
    /// Its robot.
    pub robot: &'a Arc<Robot>,
    /// The values of this point.
    pub values: &'a Combination,
    /// Its seed.
    pub seed: u64,
    /// Its view of the data; see [`view`].
    pub data: &'a Dataset,
    /// The suites that the model performs; see [`suites_of`].
    pub suites: &'a [Suite],
    /// Its run directory.
    pub dir: &'a Path,
}

impl Point<'_> {
    /// Trains, or continues, and evaluates; `None` if a stop was requested.
    ///
    /// # Errors
    /// Those of training and of the evaluation.
    pub fn reach(&self, work: &Work<'_>) -> Result<Option<Reached>, Error> {
        let Point { sweep, robot, values, seed, data, suites, dir } = *self;
        let evaluations = sweep.evaluations;
        let cfg = sweep.config(values, seed)?;
        let mut perform = Simulated { robot: Arc::clone(robot), threads: work.threads };
        let mut evaluator = None;
        if evaluations > 0 {
            evaluator = SuiteEvaluator::new(Arc::clone(robot), work.threads)
                .and_then(|e| e.map(|e| e.selecting(cfg.select, data, cfg.seed)).transpose())
                .map_err(|why| Error::Evaluation { step: 0, why })?;
        }
        let options = Options {
            dir: dir.to_owned(),
            threads: work.threads,
            checkpoint_secs: work.checkpoint_secs,
            evaluations: if evaluations > 0 { evaluations } else { 4 },
            patience: 0,
            progress: &Silent,
            cancel: work.cancel,
            evaluator: evaluator.as_mut().map(|e| e as &mut dyn Evaluate),
            perform: Some(&mut perform),
            engines: work.engines,
            linear: None,
            meta: work.meta.clone(),
        };
        let done = match train(data, &cfg, options) {
            // Stopped in a fit, before the first checkpoint.
            Err(_) if work.cancel.is_cancelled() => return Ok(None),
            done => done?,
        };
        if done.interrupted || work.cancel.is_cancelled() {
            return Ok(None);
        }
        let model = if evaluations > 0 { paths::best(dir) } else { paths::model(dir) };
        let suites = match perform_suites(robot, model, suites, work) {
            // Interrupted; the next call evaluates the point.
            Err(_) if work.cancel.is_cancelled() => return Ok(None),
            found => found?,
        };
        Ok(Some(Reached {
            values: values.clone(),
            seed,
            dataset_sha256: data.manifest().sha256(),
            windows: cfg.steps * cfg.batch as u64,
            evaluations,
            suites,
            nmse_clear: done.held_out.and_then(|h| h.nmse_clear),
            secs: Some(done.secs),
        }))
    }
}

/// The suites of a sweep; those called `test` are extracted from the held-out part of the data.
///
/// # Errors
/// [`Error::Evaluation`] for a suite that does not exist or cannot be extracted.
pub fn suites_of(sweep: &Sweep, robot: &Arc<Robot>, data: &Dataset) -> Result<Vec<Suite>, Error> {
    let fail = |why: String| Error::Evaluation { step: 0, why };
    let mut suites = Vec::new();
    for name in &sweep.suites {
        if name == "test" {
            let cut = test_suites(robot, data, sweep.cases.max(1), SPLIT_SEED);
            suites.extend(cut.map_err(|e| fail(e.to_string()))?);
            continue;
        }
        let clips = tasks::suite(robot.id(), name).map_err(|e| fail(e.to_string()))?;
        let mut cases = Vec::new();
        for (name, clip) in clips {
            let command = robot.compile(&clip).map_err(|e| fail(format!("{name}: {e}")))?;
            cases.push(Case { name, command, start: Start::Pose, truth: None, floor: None });
        }
        suites.push(Suite { name: name.clone(), cases });
    }
    Ok(suites)
}

/// A model on all suites.
fn perform_suites(
    robot: &Arc<Robot>,
    model: PathBuf,
    suites: &[Suite],
    work: &Work<'_>,
) -> Result<BTreeMap<String, Option<f64>>, Error> {
    let model_path = Some(model);
    let config = EvalConfig {
        policies: vec![PolicyConfig { model_path, ..PolicyConfig::new(PolicyName::Robert) }],
        plant: PlantRange::default(),
        seeds: 0..1,
        threads: work.threads,
    };
    let results = evaluate(robot, suites, &config, &Silent, work.cancel)
        .map_err(|e| Error::Evaluation { step: 0, why: e.to_string() })?;
    Ok(results.into_iter().map(|r| (r.suite, r.precision_mean)).collect())
}

/// One row for each combination with a result, in the order of `combinations`.
pub fn rows(combinations: &[Combination], found: &[Reached]) -> Vec<Row> {
    let row = |values: &Combination| {
        let mine: Vec<&Reached> = found.iter().filter(|r| r.values == *values).collect();
        let names: Vec<&String> = mine.first().map_or_else(Vec::new, |r| r.suites.keys().collect());
        let over = |of: &dyn Fn(&Reached) -> Option<f64>| {
            let samples: Option<Vec<f64>> = mine.iter().map(|r| of(r)).collect();
            mean_ci95(&samples?)
        };
        let suites = names
            .iter()
            .map(|&n| (n.clone(), over(&|r| r.suites.get(n).copied().flatten())))
            .collect();
        let nmse_clear = over(&|r| r.nmse_clear);
        Row { values: values.clone(), seeds: mine.len(), suites, nmse_clear }
    };
    combinations.iter().map(row).filter(|r| r.seeds > 0).collect()
}

/// One panel per suite: Precision over the setting `x`, with one curve (or colour of bar) for each
/// combination of the others; bands and whiskers are 95 % intervals over seeds.
pub fn figure(sweep: &Sweep, unit: Unit, rows: &[Row]) -> Option<Figure> {
    let names: Vec<&String> = rows.first()?.suites.keys().collect();
    let xs = sweep.grid.get(&sweep.x)?;
    let numbers: Option<Vec<f64>> = xs.iter().map(Value::number).collect();
    let label = |r: &Row| {
        let others = r.values.iter().filter(|(k, _)| **k != sweep.x);
        others.map(|(k, v)| format!("{k} {v}")).collect::<Vec<_>>().join(", ")
    };
    // In the order of the grid.
    let mut lines: Vec<String> = Vec::new();
    for line in rows.iter().map(label) {
        if !lines.contains(&line) {
            lines.push(line);
        }
    }
    let at = |line: &str, x: &Value, suite: &str| {
        let row = rows.iter().find(|r| label(r) == *line && r.values.get(&sweep.x) == Some(x))?;
        *row.suites.get(suite)?
    };
    let seeds = sweep.seeds.len();
    let note = format!("{}, {seeds} seeds, bands and whiskers 95 % (Student's t)", sweep.robot);
    let panels = names.iter().map(|suite| {
        let y = Axis::new("Precision", unit.symbol());
        let figure = if let Some(numbers) = &numbers {
            let curves: Vec<Curve> = lines
                .iter()
                .map(|line| {
                    let found: Vec<(f64, Interval)> = numbers
                        .iter()
                        .zip(xs)
                        .filter_map(|(&n, x)| Some((n, at(line, x, suite)?)))
                        .collect();
                    let half = |i: &Interval| i.ci95.unwrap_or(0.0);
                    Curve {
                        name: line.clone(),
                        points: found.iter().map(|(x, i)| (*x, i.mean)).collect(),
                        ci95: found.iter().map(|(_, i)| half(i)).collect(),
                    }
                })
                .collect();
            let spread = numbers.iter().copied().fold(f64::INFINITY, f64::min);
            let most = numbers.iter().copied().fold(0.0, f64::max);
            let axis = Axis::new(&sweep.x, "");
            let axis = if spread > 0.0 && most / spread > 20.0 { axis.log() } else { axis };
            plot::curves(suite, &curves, axis, y.from_zero())
        } else {
            let groups: Vec<String> = xs.iter().map(ToString::to_string).collect();
            let bar = |i: Option<Interval>| {
                i.map_or((f64::NAN, 0.0), |i| (i.mean, i.ci95.unwrap_or(0.0)))
            };
            let sets: Vec<(String, Vec<(f64, f64)>)> = lines
                .iter()
                .map(|line| (line.clone(), xs.iter().map(|x| bar(at(line, x, suite))).collect()))
                .collect();
            plot::bars(suite, &groups, &sets, y)
        };
        figure.panels.into_iter().next().map(|p| plot::Panel { title: (*suite).clone(), ..p })
    });
    let panels: Vec<_> = panels.flatten().collect();
    // Four panels in rows of three would leave one alone.
    let columns = if panels.len() == 4 { 2 } else { panels.len().clamp(1, 3) };
    Some(Figure::grid(&sweep.title, panels, columns).panel_size(360, 260).note(&note))
}

#[cfg(test)]
mod tests {
    use super::*;

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
