//! Evaluation, collection, fits and training.

use std::path::PathBuf;
use std::sync::Arc;

use pyo3::prelude::*;
use robert::dataset::{Dataset, Verify};
use robert::explore::{self, AgentKind, CollectConfig, Preset};
use robert::parallel::cores;
use robert::robot::PlantRange;
use robert::rollout::{
    Case, EvalConfig, InverseSettings, NEAREST_FRAMES, Start, Suite, evaluate as judge, floor,
};
use robert::train::evaluator::SuiteEvaluator;
use robert::train::hindsight::Simulated;
use robert::train::{Evaluate, Options, TrainConfig, fit as fits, train as teach};

use crate::clip::Clip;
use crate::error::{InvalidInput, raise, wrong};
use crate::jobs::listened;
use crate::policy;
use crate::robot::Robot;

fn json(value: &impl serde::Serialize) -> PyResult<String> {
    serde_json::to_string(value).map_err(|e| wrong(e.to_string()))
}

/// Clips under policies; JSON of the evaluations.
#[pyfunction]
#[pyo3(signature = (robot, clips, policies, seeds=1, plant=None, floors=true, threads=None, progress=None))]
pub(crate) fn evaluate(
    py: Python<'_>,
    robot: &Robot,
    clips: Vec<(String, PyRef<'_, Clip>)>,
    policies: Vec<String>,
    seeds: u64,
    plant: Option<&str>,
    floors: bool,
    threads: Option<usize>,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let robot = Arc::clone(&robot.inner);
    let mut cases = Vec::new();
    for (name, clip) in &clips {
        let command = clip
            .compiled(&robot)
            .map_err(|e| InvalidInput::new_err(format!("{name}: {}", e.value(py))))?;
        let (truth, floor) = (None, None);
        cases.push(Case { name: name.clone(), command, start: Start::Pose, truth, floor });
    }
    let mut suites = [Suite { name: "clips".to_owned(), cases }];
    let plant: PlantRange =
        plant.map_or_else(|| Ok(PlantRange::default()), str::parse).map_err(raise)?;
    if seeds == 0 {
        return Err(wrong("seeds must be at least 1"));
    }
    let threads = threads.unwrap_or_else(cores);
    let policies = policies
        .iter()
        .map(|p| policy::config(Some(p.as_str()), &robot))
        .collect::<PyResult<_>>()?;
    let config = EvalConfig { policies, plant, seeds: 0..seeds, threads };
    let found = listened(py, progress, |listener, cancel| {
        if floors && config.plant == PlantRange::default() {
            // A robot that iLQR cannot drive does without.
            floor::fill(&robot, suites[0].cases.iter_mut(), threads, listener, cancel).ok();
        }
        judge(&robot, &suites, &config, listener, cancel).map_err(raise)
    })?;
    json(&found)
}

/// Explores and records; JSON of what it came to.
#[pyfunction]
#[pyo3(signature = (robot, out, agents, transitions, seed=0, plants=None, threads=None, progress=None))]
pub(crate) fn collect(
    py: Python<'_>,
    robot: &Robot,
    out: PathBuf,
    agents: Vec<String>,
    transitions: u64,
    seed: u64,
    plants: Option<&str>,
    threads: Option<usize>,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let robot = Arc::clone(&robot.inner);
    let mut config = CollectConfig { transitions, seed, ..CollectConfig::new(&robot) };
    if !agents.is_empty() {
        config.agents = agents
            .iter()
            .map(|a| a.parse::<AgentKind>().map_err(|e| wrong(e.to_string())))
            .collect::<PyResult<_>>()?;
    }
    config.preset = Preset::named("url-fast").map_err(raise)?;
    config.plants = plants.map(str::parse::<PlantRange>).transpose().map_err(raise)?;
    let threads = threads.unwrap_or_else(cores);
    let done = listened(py, progress, |listener, cancel| {
        explore::collect(&robot, &config, &out, false, threads, listener, cancel).map_err(raise)
    })?;
    json(
        &serde_json::json!({"out": out, "agents": done.agents, "totals": done.manifest.totals, "manifest_sha256": done.manifest.sha256()}),
    )
}

/// What a dataset holds: shards, trajectories, names; JSON. The frames are mapped in Python.
#[pyfunction]
pub(crate) fn dataset(py: Python<'_>, path: PathBuf) -> PyResult<String> {
    let data = py.detach(|| Dataset::open(&path, Verify::Structure)).map_err(raise)?;
    let shards: Vec<&std::path::Path> = data.shards().iter().map(|s| s.path()).collect();
    json(&serde_json::json!({"manifest": data.manifest(), "shards": shards}))
}

/// Fits a policy that needs no training; JSON.
#[pyfunction]
#[pyo3(signature = (kind, data, out=None, seed=0, threads=None, progress=None))]
pub(crate) fn fit(
    py: Python<'_>,
    kind: &str,
    data: PathBuf,
    out: Option<PathBuf>,
    seed: u64,
    threads: Option<usize>,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    if !["ridge", "nearest", "mlp-inverse"].contains(&kind) {
        return Err(wrong(format!("fits are ridge, nearest and mlp-inverse, not {kind:?}")));
    }
    let data = py.detach(|| Dataset::open(&data, Verify::Full)).map_err(raise)?;
    let out = out.unwrap_or_else(|| data.path().with_file_name(format!("{kind}.safetensors")));
    let threads = threads.unwrap_or_else(cores);
    let held_out = listened(py, progress, |listener, cancel| {
        let mut fitted = match kind {
            "ridge" => fits::ridge(&data, seed, threads, &out, cancel),
            "nearest" => fits::nearest(&data, seed, NEAREST_FRAMES, &out),
            _ => {
                let settings = InverseSettings::default();
                fits::mlp_inverse(&data, seed, &settings, &out, listener, cancel)
            }
        }
        .map_err(raise)?;
        Ok(fits::held_out(&data, seed, &mut fitted).ok())
    })?;
    json(&serde_json::json!({"policy": kind, "out": out, "held_out": held_out}))
}

/// Trains a network; JSON of how the run ended.
#[pyfunction]
#[pyo3(signature = (robot, data, out, preset, settings, evaluations=10, threads=None, progress=None))]
pub(crate) fn train(
    py: Python<'_>,
    robot: &Robot,
    data: PathBuf,
    out: PathBuf,
    preset: &str,
    settings: Vec<String>,
    evaluations: u64,
    threads: Option<usize>,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let robot = Arc::clone(&robot.inner);
    let mut config = TrainConfig::preset(preset).map_err(raise)?;
    for assignment in &settings {
        config.set(assignment).map_err(raise)?;
    }
    config.check_network().map_err(raise)?;
    if out.join("config.toml").exists() {
        return Err(wrong(format!("there is a run already: {}", out.display())));
    }
    let data = py.detach(|| Dataset::open(&data, Verify::Full)).map_err(raise)?;
    data.must_be_of(&robot).map_err(raise)?;
    let threads = threads.unwrap_or_else(cores);
    let mut evaluator = SuiteEvaluator::new(Arc::clone(&robot), threads)
        .and_then(|e| e.map(|e| e.selecting(&config, &data)).transpose())
        .map_err(InvalidInput::new_err)?;
    let mut perform = Simulated { robot: Arc::clone(&robot), threads };
    let done = listened(py, progress, |listener, cancel| {
        let options = Options {
            dir: out.clone(),
            threads,
            checkpoint_secs: 600.0,
            evaluations,
            patience: 0,
            progress: listener,
            cancel,
            perform: Some(&mut perform),
            engines: None,
            linear: None,
            evaluator: evaluator.as_mut().map(|j| j as &mut dyn Evaluate),
            meta: serde_json::json!({
                "version": env!("CARGO_PKG_VERSION"),
                "threads": threads,
                "robot": robot.folder().map_or_else(|| robot.id().into(), |dir| dir.to_owned()),
            }),
        };
        teach(&data, &config, options).map_err(raise)
    })?;
    json(&serde_json::json!({"dir": out, "result": done}))
}
