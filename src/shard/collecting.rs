//! Collection in shards: shard K records its part of the transitions with the seed `seed + K`, as
//! `robert collect --seed` would.

use robert_base::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use robert_base::fsio;
use robert_base::progress::{Cancel, Progress, Silent};
use robert_base::scratch::Scratch;
use robert_dataset::{Dataset, SHORTEST};
use robert_explore::{CollectConfig, collect, share};
use robert_robot::Robot;

use super::context::Context;
use super::draft::{Draft, fingerprint};
use super::error::write_error;
use super::plan::SHARDS;
use super::spec::{Collect, Recording};
use super::{Cell, Error, folder};

/// The dataset in a shard's folder.
pub(super) const DATA: &str = "data";

/// The cells, each of which is checked.
pub(super) fn draft(spec: &Collect, robot: &Arc<Robot>, place: &str) -> Result<Draft, Error> {
    if spec.shards == 0
        || spec.shards > SHARDS
        || spec.seed.checked_add(spec.shards as u64).is_none()
    {
        let why = format!("shards = {}, seed = {}: too few or too large", spec.shards, spec.seed);
        return Err(Error::Spec { why, place: place.to_owned() });
    }
    let n = spec.shards as u64;
    let mut draft = Draft::default();
    for i in 0..n {
        let (seed, transitions) = (spec.seed + i, share(spec.transitions, n, i));
        let cell = Cell::Collect { seed, transitions };
        spec.config(robot, seed, transitions)?.check().map_err(|e| Error::Cell {
            index: i as usize,
            what: cell.to_string(),
            why: e.to_string(),
        })?;
        draft.cells.push(cell);
    }
    try_out(spec.config(robot, spec.seed, 0)?, robot)?;
    Ok(draft)
}

/// Records a few frames with the collectors that need no training, so that a collector that cannot
/// drive the robot is refused now and not in the queue.
fn try_out(mut config: CollectConfig, robot: &Arc<Robot>) -> Result<(), Error> {
    config.agents.retain(|a| !a.learns());
    if config.agents.is_empty() {
        return Ok(());
    }
    config.transitions = (config.agents.len() * SHORTEST) as u64;
    config.episode_frames = SHORTEST as u64;
    let temp = Scratch::new().map_err(write_error(&std::env::temp_dir()))?;
    collect(robot, &config, temp.path(), false, 1, &Silent, &Cancel::default())?;
    Ok(())
}

/// Records a part; returns the number of lost episodes.
pub(super) fn perform(
    context: &Context,
    spec: &Collect,
    seed: u64,
    transitions: u64,
    out: &Path,
) -> Result<u64, Error> {
    let config = spec.config(&context.robot, seed, transitions)?;
    let data = out.join(DATA);
    let made =
        collect(&context.robot, &config, &data, false, context.threads, &Silent, &context.cancel)?;
    // Trained agents are as large as the motion, and can be trained again from the same seed.
    let agents = data.join("agents");
    if agents.exists() {
        std::fs::remove_dir_all(&agents).map_err(write_error(&agents))?;
    }
    Ok(made.manifest.totals.dropped_broken)
}

/// Records the data of a training plan into the plan's folder, unless they are there.
pub(super) fn record(
    spec: &Recording,
    robot: &Arc<Robot>,
    out: &Path,
    progress: &dyn Progress,
) -> Result<PathBuf, Error> {
    let usual = CollectConfig::new(robot);
    let agents = spec.agents.as_ref().unwrap_or(&usual.agents);
    if let Some(agent) = agents.iter().find(|a| a.learns()) {
        let why = format!(
            "[collect] records with collectors that need no training, not {}; plan a collection of its own, or use data = \"DIR\"",
            agent.name()
        );
        return Err(Error::Spec { why, place: "agents".to_owned() });
    }
    let config = CollectConfig {
        agents: agents.clone(),
        transitions: spec.transitions,
        seed: spec.seed,
        episode_frames: spec.episode_frames,
        ..usual
    };
    let text = json::line(spec);
    let hash = fsio::sha256_hex(format!("{} {text}", fingerprint(robot)?).as_bytes());
    let dir = out.join("data").join(format!("recorded-{}", hash.get(..12).unwrap_or_default()));
    let threads = robert_base::parallel::cores();
    collect(robot, &config, &dir, true, threads, progress, &Cancel::default())?;
    Ok(dir)
}

/// Merges the parts into one dataset in `out`. `shards` are the folders of the shards, in order.
/// Only the files of motion are taken over, so that ten thousand parts are ten thousand files in
/// one folder. They are never changed in place, so hard links are enough unless `copy` is set.
pub(super) fn merge(
    shards: &[PathBuf],
    out: &Path,
    copy: bool,
) -> Result<serde_json::Value, Error> {
    let inputs: Vec<PathBuf> = shards.iter().map(|s| s.join(DATA)).collect();
    let mut manifest = robert_dataset::merge(&inputs, out, false)?;
    let folder = out.join("shards");
    std::fs::create_dir_all(&folder).map_err(write_error(&folder))?;
    for (k, entry) in manifest.shards.iter_mut().enumerate() {
        let name = PathBuf::from("shards").join(format!("{k:06}.safetensors"));
        folder::link_file(&out.join(&entry.file), &out.join(&name), copy)?;
        entry.file = name;
    }
    let made = Dataset::publish(manifest, out)?;
    Ok(serde_json::json!({ "totals": made.totals, "dataset_sha256": made.sha256() }))
}
