//! The robots, collected data and training runs in the studio's folder. Read on demand; nothing
//! here is kept.

use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde_json::Value;

use crate::protocol::{BegunCard, DataCard, RunCard, Shelf};
use robert_base::fsio;
use robert_base::limits;
use robert_explore as explore;
use robert_net::checkpoint;
use robert_rollout::model_path;
use robert_train::read_config;

/// The largest number of folders that are read for one list.
const LOOKED_AT: usize = 2_000;

/// The deepest folder level at which data and runs are found.
const DEPTH: usize = 3;

/// The number of points of a run's curves that are sent.
const POINTS: usize = 400;

/// Runs and data in the studio's folder.
pub(crate) fn list(folder: &Path) -> Shelf {
    let mut runs = Vec::new();
    walk(&folder.join("runs"), DEPTH, &mut LOOKED_AT.clone(), &mut |dir| {
        dir.join("config.toml").is_file() && {
            runs.extend(run(folder, dir));
            true
        }
    });
    runs.sort_by(|a, b| b.changed_secs.cmp(&a.changed_secs).then_with(|| a.path.cmp(&b.path)));
    let (mut data, mut begun) = (Vec::new(), Vec::new());
    walk(&folder.join("data"), DEPTH, &mut LOOKED_AT.clone(), &mut |dir| {
        // It is written last, so a folder that contains it is complete.
        if dir.join("manifest.json").is_file() {
            data.extend(dataset(folder, dir));
            return true;
        }
        let request = begun_in(folder, dir);
        let there = request.is_some();
        begun.extend(request);
        there
    });
    Shelf { runs, data, begun, presets: robert_train::PRESETS.to_vec() }
}

/// The last step of the metrics of a run. Its last lines suffice; a long run has very many.
fn last_step(dir: &Path) -> Option<u64> {
    const TAIL: u64 = 65_536;
    let mut file = fsio::open_regular(&dir.join("metrics.jsonl")).ok()?;
    let from = file.metadata().ok()?.len().saturating_sub(TAIL);
    file.seek(SeekFrom::Start(from)).ok()?;
    let mut tail = Vec::new();
    file.take(TAIL).read_to_end(&mut tail).ok()?;
    let text = String::from_utf8_lossy(&tail);
    let step = |l: &str| serde_json::from_str::<Value>(l).ok()?.get("step")?.as_u64();
    text.lines().filter_map(step).max()
}

/// The metrics of a run, thinned to what a chart can show.
pub(crate) fn curves(dir: &Path) -> Vec<Value> {
    let Ok(bytes) = fsio::read_capped(&dir.join("metrics.jsonl"), limits::TABLE_BYTES) else {
        return Vec::new();
    };
    let text = String::from_utf8_lossy(&bytes);
    let all: Vec<Value> = text.lines().filter_map(|l| serde_json::from_str(l).ok()).collect();
    let (plain, rare): (Vec<Value>, Vec<Value>) =
        all.into_iter().partition(|l| l.get("loss").is_some());
    let every = plain.len().div_ceil(POINTS).max(1);
    let last = plain.len().saturating_sub(1);
    let thin = plain.into_iter().enumerate().filter(|(i, _)| i % every == 0 || *i == last);
    thin.map(|(_, l)| l).chain(rare).collect()
}

pub(super) fn folders(dir: &Path) -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = std::fs::read_dir(dir)
        .into_iter()
        .flatten()
        .take(LOOKED_AT)
        .filter_map(|e| e.ok().map(|e| e.path()))
        .filter(|p| p.is_dir())
        .collect();
    found.sort();
    found
}

/// Visits folders; folders below a found one are skipped.
fn walk(dir: &Path, depth: usize, left: &mut usize, take: &mut dyn FnMut(&Path) -> bool) {
    for dir in folders(dir) {
        if *left == 0 {
            return;
        }
        *left -= 1;
        if !take(&dir) && depth > 1 {
            walk(&dir, depth - 1, left, take);
        }
    }
}

fn relative(folder: &Path, dir: &Path) -> String {
    dir.strip_prefix(folder).unwrap_or(dir).display().to_string()
}

fn run(folder: &Path, dir: &Path) -> Option<RunCard> {
    let config = read_config(dir).ok()?;
    let model = model_path(dir);
    let card = model.is_file().then(|| checkpoint::read_card(&model).ok()).flatten();
    let changed = [dir.join("metrics.jsonl"), dir.join("config.toml")];
    let changed_secs = changed
        .iter()
        .find_map(|p| p.metadata().ok()?.modified().ok())
        .and_then(|t| t.duration_since(std::time::UNIX_EPOCH).ok())
        .map_or(0, |d| d.as_secs());
    let last = last_step(dir);
    Some(RunCard {
        path: relative(folder, dir),
        robot: card.as_ref().map(|c| c.robot.id.clone()),
        preset: config.preset.clone(),
        step: last.or(card.as_ref().map(|c| c.training.step)).unwrap_or(0),
        steps: config.steps,
        precision: card.as_ref().map(|c| c.training.precision.clone()),
        dataset_sha256: card.as_ref().map(|c| c.training.dataset_sha256.clone()),
        model: card.map(|_| relative(folder, &model)),
        changed_secs,
    })
}

/// What a list shows of a manifest. The rest is skipped: as values in memory, the shards and
/// trajectories of a large one would take gigabytes.
#[derive(Deserialize)]
struct Heading {
    robot: Recorded,
    totals: Totals,
}

#[derive(Deserialize)]
struct Recorded {
    id: String,
}

#[derive(Deserialize)]
struct Totals {
    frames: u64,
    episodes: u64,
}

fn dataset(folder: &Path, dir: &Path) -> Option<DataCard> {
    let bytes = fsio::read_capped(&dir.join("manifest.json"), limits::UPLOAD_BYTES).ok()?;
    let manifest: Heading = serde_json::from_slice(&bytes).ok()?;
    Some(DataCard {
        path: relative(folder, dir),
        robot: manifest.robot.id,
        frames: manifest.totals.frames,
        episodes: manifest.totals.episodes,
        // It is written as its canonical text, so the file's hash is the manifest's.
        sha256: fsio::sha256_hex(&bytes),
    })
}

fn begun_in(folder: &Path, dir: &Path) -> Option<BegunCard> {
    let request = explore::begun(dir).ok().flatten()?;
    Some(BegunCard {
        path: relative(folder, dir),
        robot: request.robot,
        agents: request.config.agents.iter().map(|a| a.name().to_owned()).collect(),
        transitions: request.config.transitions,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_are_listed_by_the_heading_of_their_manifest() {
        let home = tempfile::tempdir().unwrap();
        let put = |name: &str, text: &str| {
            let dir = home.path().join("data").join(name);
            std::fs::create_dir_all(&dir).unwrap();
            std::fs::write(dir.join("manifest.json"), text).unwrap();
        };
        put(
            "good",
            r#"{"robot": {"id": "r", "joints": []}, "totals": {"frames": 7, "episodes": 2,
            "shards": 1}, "episodes": [{"shard": 0}, {"shard": 1}]}"#,
        );
        put("negative", r#"{"robot": {"id": "r"}, "totals": {"frames": -7, "episodes": 2}}"#);
        put("deep", &format!(r#"{{"robot": {{"id": "r"}}, "x": {}"#, "[".repeat(100_000)));
        let data = list(home.path()).data;
        let facts: Vec<_> = data
            .iter()
            .map(|d| (d.path.as_str(), d.robot.as_str(), d.frames, d.episodes))
            .collect();
        assert_eq!(facts, [("data/good", "r", 7, 2)]);
    }
}
