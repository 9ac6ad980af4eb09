//! Training in shards: the points of a sweep, or the seeds of one setting.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime};

use robert_base::progress::Silent;
use robert_base::{fsio, json, limits};
use robert_dataset::{Dataset, Part, SHORTEST, Verify, Windows};
use robert_robot::Robot;
use robert_train::paths;
use robert_train::sweep::{Combination, Point, Reached, Sweep, Work, suites_of, view};

use super::checkpoints::Checkpoints;
use super::context::Context;
use super::draft::Draft;
use super::error::write_error;
use super::spec::Train;
use super::{Cell, Error, folder};

/// Result of a training shard.
pub(super) const RESULT: &str = "result.json";
/// The interval between two checks of a run in progress.
const LOOK: Duration = Duration::from_millis(100);

/// The folder for views of these data.
fn views(dir: &Path, data_sha256: &str) -> PathBuf {
    dir.join("data").join(format!("views-{}", data_sha256.get(..12).unwrap_or_default()))
}

/// The cells; the view of each is made and must have windows to learn from.
pub(super) fn draft(
    spec: &Train,
    robot: &Arc<Robot>,
    data: &Path,
    out: &Path,
) -> Result<Draft, Error> {
    let sweep = spec.sweep();
    let whole = Dataset::open(data, Verify::Full)?;
    whole.must_be_of(robot)?;
    let sha256 = whole.manifest().sha256();
    let root = views(out, &sha256);
    let mut draft = Draft::default();
    for &seed in &sweep.seeds {
        for values in sweep.combinations() {
            let view = view(&values, seed, data, &root)?;
            let cell = Cell::Train { values, seed };
            let refuse =
                |why: String| Error::Cell { index: draft.cells.len(), what: cell.to_string(), why };
            Windows::new(&view, SHORTEST, Part::Train, seed).map_err(|e| refuse(e.to_string()))?;
            if draft.cells.is_empty() {
                suites_of(&sweep, robot, &view).map_err(|e| refuse(e.to_string()))?;
            }
            draft.cells.push(cell);
        }
    }
    draft.inputs.insert("data".to_owned(), sha256);
    // With a path inside the plan's folder the data are found again after the folder was moved or
    // mounted elsewhere.
    draft.data = Some(data.strip_prefix(out).map_or_else(|_| data.to_owned(), Path::to_owned));
    Ok(draft)
}

/// Trains one point in `run`, from the newest checkpoint, and writes its files into `out`; returns
/// 0, because a run loses no episodes.
pub(super) fn perform(
    context: &Context,
    spec: &Train,
    values: &Combination,
    seed: u64,
    run: &Path,
    out: &Path,
    checkpoints: &Checkpoints,
) -> Result<u64, Error> {
    let sweep = spec.sweep();
    let source = context.data()?;
    let sha256 = context.plan.inputs.get("data").map_or("", String::as_str);
    let data = view(values, seed, source, &views(&context.dir, sha256))?;
    let suites = suites_of(&sweep, &context.robot, &data)?;
    let work = Work {
        data: source.to_owned(),
        out: run.to_owned(),
        threads: context.threads,
        checkpoint_secs: context.checkpoint_secs,
        engines: None,
        progress: &Silent,
        cancel: &context.cancel,
        meta: serde_json::Value::Null,
    };
    let (robot, suites) = (&context.robot, suites.as_slice());
    let point = Point { sweep: &sweep, robot, values, seed, data: &data, suites, dir: run };
    let restored = checkpoints.restore(run);
    let mut reached = reach(context, &point, &work, checkpoints);
    if restored && reached.as_ref().is_err_and(cannot_continue) {
        // A checkpoint that cannot be used must not block the shard for ever.
        std::fs::remove_dir_all(run).map_err(write_error(run))?;
        checkpoints.clear();
        reached = reach(context, &point, &work, checkpoints);
    }
    let Some(reached) = reached? else {
        return Err(Error::Stopped { index: 0 });
    };
    let mut files = vec![(paths::model(run), "model.safetensors")];
    files.push((paths::config(run), "config.toml"));
    files.push((paths::best(run), "best.safetensors"));
    for (from, name) in files.into_iter().filter(|(from, _)| from.is_file()) {
        let to = out.join(name);
        std::fs::copy(&from, &to).map_err(write_error(&to))?;
    }
    let text = json::pretty(&Reached { secs: None, ..reached });
    let path = out.join(RESULT);
    std::fs::write(&path, text).map_err(write_error(&path))?;
    Ok(0)
}

/// Whether a run cannot be continued from its checkpoint. A full disk, say, is no reason to begin again.
fn cannot_continue(error: &Error) -> bool {
    use robert_net::Error as Model;
    use robert_train::Error as Of;
    let model = |e: &Model| {
        matches!(
            e,
            Model::File { .. } | Model::Shape { .. } | Model::Robot { .. } | Model::NoModel { .. }
        )
    };
    match error {
        Error::Train(Of::Run { .. } | Of::Setting { .. }) => true,
        Error::Train(Of::Net(e)) => model(e),
        _ => false,
    }
}

/// Trains while another thread publishes every new checkpoint.
fn reach(
    context: &Context,
    point: &Point<'_>,
    work: &Work<'_>,
    checkpoints: &Checkpoints,
) -> Result<Option<Reached>, Error> {
    let (every, dir) = (context.checkpoint_secs, point.dir);
    let ended = AtomicBool::new(false);
    // The file is replaced at every checkpoint, so a new time means a new checkpoint.
    let stamp = || std::fs::metadata(paths::last(dir)).and_then(|m| m.modified()).ok();
    let weights = || fsio::sha256_file(&paths::model(dir)).ok();
    let (begun, before) = (stamp(), weights());
    // A copy that fails, on a full disk say, costs time after an interruption. It must not cost the training.
    let publish = || {
        let published = checkpoints.publish(dir);
        if let Err(e) = &published {
            tracing::warn!("a checkpoint was not copied: {e}");
        }
        published.is_ok()
    };
    let (found, seen) = std::thread::scope(|scope| {
        let watch = scope.spawn(|| -> Option<SystemTime> {
            let (mut seen, mut since) = (begun, Instant::now());
            while !ended.load(Ordering::Relaxed) {
                std::thread::sleep(LOOK);
                let now = stamp();
                if since.elapsed().as_secs_f64() >= every && now != seen {
                    seen = if publish() { now } else { seen };
                    since = Instant::now();
                }
            }
            seen
        });
        let found = point.reach(work);
        ended.store(true, Ordering::Relaxed);
        let seen = watch.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        (found, seen)
    });
    let found = found?;
    if found.is_none() && stamp() != seen {
        publish();
    }
    // One and the same step has the same weights, however often it is saved.
    if weights() != before {
        context.advance();
    }
    Ok(found)
}

/// The models and results of all points in `out`, in the order of the cells.
pub(super) fn merge(sweep: &Sweep, shards: &[PathBuf], out: &Path) -> Result<Vec<Reached>, Error> {
    let mut found = Vec::with_capacity(shards.len());
    for shard in shards {
        let path = shard.join(RESULT);
        let bytes = fsio::read_capped(&path, limits::SETTINGS_BYTES)?;
        let reached: Reached = serde_json::from_slice(&bytes)
            .map_err(|e| Error::Plan { why: e.to_string(), path: path.clone() })?;
        let mut place = out.join("points");
        if !sweep.grid.is_empty() {
            place.push(robert_train::sweep::slug(&reached.values));
        }
        place.push(format!("seed-{}", reached.seed));
        folder::copy(shard, &place)?;
        // This file describes how the shard was made, and is left out of the merge.
        std::fs::remove_file(place.join(super::manifest::FILE)).ok();
        found.push(reached);
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_cannot_be_read_begins_again() {
        let full =
            || fsio::Error::Write { source: std::io::Error::other("full"), path: "x".into() };
        let damaged = robert_net::Error::File { why: "cut off".to_owned(), path: "x".into() };
        assert!(cannot_continue(&Error::Train(robert_train::Error::Net(damaged))));
        let of_net = robert_train::Error::Net(robert_net::Error::Files(full()));
        let of_train = robert_train::Error::Files(full());
        for e in [Error::Train(of_net), Error::Train(of_train), Error::Files(full())] {
            assert!(!cannot_continue(&e), "{e}");
        }
    }
}
