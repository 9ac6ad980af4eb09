//! Checkpoints of an agent in training: one state file, and replay files that are written only
//! once.
//!
//! New replay episodes are written first, then the snapshot, then the state file that names them.
//! After a kill between any two, the previous state file is there, and the run repeats the same
//! steps with the same bytes.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use safetensors::tensor::{Dtype, SafeTensors, TensorView};

use super::agent::{Agent, Ledger};
use super::error::Error;
use super::policy::Snapshot;
use super::replay::Steps;
use super::state::Field;
use robert_base::fsio;
use robert_base::limits;

/// Key of the header's metadata.
const KEY: &str = "robert";

/// Writes the new files; `nominal` is the snapshot's step.
///
/// # Errors
/// [`Error::File`], [`Error::Checkpoint`].
pub(super) fn save(agent: &mut Agent, dir: &Path, nominal: u64) -> Result<(), Error> {
    let snapshot = agent.snapshot(nominal);
    let bad = |message: String, path: &Path| Error::Checkpoint { message, path: path.to_owned() };

    let path = replay_file(dir, agent.ledger.chunks);
    let bytes = replay_bytes(agent.replay.since(agent.saved)).map_err(|m| bad(m, &path))?;
    fsio::write_atomic(&path, &bytes)?;
    agent.saved = agent.replay.begun();
    agent.ledger.chunks += 1;

    let path = Agent::snapshot_file(dir, nominal);
    let bytes = snapshot.bytes().map_err(|m| bad(m, &path))?;
    fsio::write_atomic(&path, &bytes)?;
    agent.ledger.snapshots.insert(nominal, fsio::sha256_hex(&bytes));

    let path = state_file(dir);
    let bytes = state_bytes(agent).map_err(|m| bad(m, &path))?;
    Ok(fsio::write_atomic(&path, &bytes)?)
}

/// Whether `dir` contains the snapshot of this step, unchanged.
pub(super) fn is_whole(ledger: &Ledger, dir: &Path, step: u64) -> bool {
    let path = Agent::snapshot_file(dir, step);
    match ledger.snapshots.get(&step) {
        Some(sha256) => fsio::sha256_file(&path).is_ok_and(|found| found == *sha256),
        None => Snapshot::load(&path).is_ok(),
    }
}

/// Adds the remedy to an error about an agent's file in `dir`.
pub(super) fn curable(e: Error, dir: &Path) -> Error {
    let (message, path) = match e {
        Error::Checkpoint { message, path } => (message, path),
        Error::File(fsio::Error::Read { source, path }) => {
            (format!("cannot be read ({source})"), path)
        }
        other => return other,
    };
    let message = format!("{message}; delete {} to train this agent again", dir.display());
    Error::Checkpoint { message, path }
}

/// Restores the newest checkpoint in `dir`, if there is one.
///
/// # Errors
/// [`Error::File`], [`Error::Checkpoint`].
pub(super) fn load(agent: &mut Agent, dir: &Path) -> Result<bool, Error> {
    let path = state_file(dir);
    if !path.exists() {
        return Ok(false);
    }
    let bytes = fsio::read_capped(&path, limits::SHARD_BYTES)?;
    let bad = |message: &str, path: &Path| {
        Err(Error::Checkpoint { message: message.to_owned(), path: path.to_owned() })
    };
    restore(agent, &bytes).map_err(|message| Error::Checkpoint { message, path: path.clone() })?;
    let mut steps = agent.ledger.snapshots.keys();
    if let Some(&step) = steps.find(|&&step| !is_whole(&agent.ledger, dir, step)) {
        return bad("is missing or damaged", &Agent::snapshot_file(dir, step));
    }
    for chunk in 0..agent.ledger.chunks {
        let path = replay_file(dir, chunk);
        let bytes = fsio::read_capped(&path, limits::SHARD_BYTES)?;
        let episodes = replay_episodes(&bytes)
            .map_err(|message| Error::Checkpoint { message, path: path.clone() })?;
        for e in episodes {
            agent.replay.restore(e);
        }
    }
    match agent.ledger.remembered {
        Some(n) => {
            if !agent.replay.keep_youngest(n) {
                return bad("lists more episodes than the replay files beside it contain", &path);
            }
        }
        None => agent.replay.trim(),
    }
    agent.saved = agent.replay.begun();
    Ok(true)
}

/// Removes the files that are needed only to continue training.
pub(super) fn clean(dir: &Path, chunks: u64) {
    for chunk in 0..chunks {
        // A file that cannot be removed does no harm.
        std::fs::remove_file(replay_file(dir, chunk)).ok();
    }
    std::fs::remove_file(state_file(dir)).ok();
}

fn state_file(dir: &Path) -> PathBuf {
    dir.join("state.safetensors")
}

fn replay_file(dir: &Path, chunk: u64) -> PathBuf {
    dir.join(format!("replay-{chunk:05}.safetensors"))
}

fn state_bytes(agent: &mut Agent) -> Result<Vec<u8>, String> {
    let mut reals: BTreeMap<String, Vec<f32>> = BTreeMap::new();
    let mut doubles: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    let mut counts: BTreeMap<String, Vec<u64>> = BTreeMap::new();
    agent.keep(&mut |name, field| match field {
        Field::Reals(v) => drop(reals.insert(name.to_owned(), v.clone())),
        Field::Doubles(v) => drop(doubles.insert(name.to_owned(), v.to_vec())),
        Field::Count(v) => drop(counts.insert(name.to_owned(), vec![*v])),
    });
    counts.insert("coverage".to_owned(), agent.coverage.words());
    let mut views = Vec::new();
    for (name, v) in &reals {
        views.push((name, tensor(Dtype::F32, v)?));
    }
    for (name, v) in &doubles {
        views.push((name, tensor(Dtype::F64, v)?));
    }
    for (name, v) in &counts {
        views.push((name, tensor(Dtype::U64, v)?));
    }
    let json = serde_json::to_string(&agent.ledger).map_err(|e| e.to_string())?;
    safetensors::serialize(views, Some(HashMap::from([(KEY.to_owned(), json)])))
        .map_err(|e| e.to_string())
}

fn tensor<T: bytemuck::NoUninit>(dtype: Dtype, v: &[T]) -> Result<TensorView<'_>, String> {
    TensorView::new(dtype, vec![v.len()], bytemuck::cast_slice(v)).map_err(|e| e.to_string())
}

fn restore(agent: &mut Agent, bytes: &[u8]) -> Result<(), String> {
    let (_, meta) = SafeTensors::read_metadata(bytes).map_err(|e| e.to_string())?;
    let json = meta.metadata().as_ref().and_then(|m| m.get(KEY));
    let json = json.ok_or("the header has no \"robert\" entry")?;
    let ledger: Ledger = serde_json::from_str(json).map_err(|e| e.to_string())?;
    let file = SafeTensors::deserialize(bytes).map_err(|e| e.to_string())?;
    let mut problem = None;
    agent.keep(&mut |name, field| {
        let done = match field {
            Field::Reals(v) => read::<f32>(&file, name, Dtype::F32, v.len()).map(|x| *v = x),
            Field::Doubles(v) => {
                read::<f64>(&file, name, Dtype::F64, v.len()).map(|x| v.copy_from_slice(&x))
            }
            Field::Count(v) => read::<u64>(&file, name, Dtype::U64, 1).map(|x| *v = x[0]),
        };
        if let Err(message) = done {
            problem.get_or_insert(message);
        }
    });
    if let Some(message) = problem {
        return Err(message);
    }
    let words = agent.coverage.words().len();
    agent.coverage.restore(&read::<u64>(&file, "coverage", Dtype::U64, words)?);
    agent.ledger = ledger;
    agent.restored();
    Ok(())
}

fn read<T: bytemuck::AnyBitPattern + bytemuck::NoUninit>(
    file: &SafeTensors<'_>,
    name: &str,
    dtype: Dtype,
    len: usize,
) -> Result<Vec<T>, String> {
    let t = file.tensor(name).map_err(|e| e.to_string())?;
    let values: Vec<T> = bytemuck::pod_collect_to_vec(t.data());
    if t.dtype() != dtype || values.len() != len {
        return Err(format!("tensor \"{name}\" is not {len} values of {dtype:?}"));
    }
    Ok(values)
}

fn replay_bytes(episodes: &[Steps]) -> Result<Vec<u8>, String> {
    let join = |f: fn(&Steps) -> &[f32]| -> Vec<f32> {
        episodes.iter().flat_map(|e| f(e).iter().copied()).collect()
    };
    let (obs, action, skill) = (join(|e| &e.obs), join(|e| &e.action), join(|e| &e.skill));
    let lengths: Vec<u64> = episodes
        .iter()
        .flat_map(|e| [e.obs.len() as u64, e.action.len() as u64, e.skill.len() as u64])
        .collect();
    let views = [
        ("action", tensor(Dtype::F32, &action)?),
        ("lengths", tensor(Dtype::U64, &lengths)?),
        ("obs", tensor(Dtype::F32, &obs)?),
        ("skill", tensor(Dtype::F32, &skill)?),
    ];
    safetensors::serialize(views, None).map_err(|e| e.to_string())
}

fn replay_episodes(bytes: &[u8]) -> Result<Vec<Steps>, String> {
    let file = SafeTensors::deserialize(bytes).map_err(|e| e.to_string())?;
    let floats = |name: &str| -> Result<Vec<f32>, String> {
        let t = file.tensor(name).map_err(|e| e.to_string())?;
        Ok(bytemuck::pod_collect_to_vec(t.data()))
    };
    let (obs, action, skill) = (floats("obs")?, floats("action")?, floats("skill")?);
    let t = file.tensor("lengths").map_err(|e| e.to_string())?;
    let lengths: Vec<u64> = bytemuck::pod_collect_to_vec(t.data());
    let (mut o, mut a, mut k) = (0, 0, 0);
    let mut episodes = Vec::new();
    for l in lengths.chunks_exact(3) {
        let cut = |from: &[f32], at: &mut usize, n: u64| {
            let end = at.saturating_add(n as usize);
            let piece = from.get(*at..end).map(<[f32]>::to_vec);
            *at = end;
            piece.ok_or_else(|| "lengths exceed the data".to_owned())
        };
        let &[no, na, nk] = l else { continue };
        episodes.push(Steps {
            obs: cut(&obs, &mut o, no)?,
            action: cut(&action, &mut a, na)?,
            skill: cut(&skill, &mut k, nk)?,
        });
    }
    Ok(episodes)
}

#[cfg(test)]
mod tests {
    use super::super::agent::AgentKind;
    use super::super::preset::Preset;
    use super::*;
    use robert_robot::Robot;
    use std::sync::Arc;

    fn preset() -> Preset {
        Preset { hidden: 16, batch: 32, envs: 6, ..Preset::url_fast() }.lasting(1500)
    }

    fn run(agent: &mut Agent, until: u64, threads: usize) {
        while agent.ledger.step < until {
            agent.iterate(threads).unwrap();
        }
    }

    #[test]
    fn going_on_is_never_having_stopped_on_any_threads() {
        let robot = Arc::new(Robot::builtin("pointmass").unwrap());
        for kind in AgentKind::ALL.into_iter().filter(|k| k.learns()) {
            let make = || Agent::new(&robot, kind, &preset(), 4).unwrap().unwrap();
            let (a, b) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
            let mut straight = make();
            run(&mut straight, 600, 1);
            save(&mut straight, a.path(), 600).unwrap();
            run(&mut straight, 1200, 1);
            save(&mut straight, a.path(), 1200).unwrap();

            let mut first = make();
            assert!(!load(&mut first, b.path()).unwrap());
            run(&mut first, 600, 3);
            save(&mut first, b.path(), 600).unwrap();
            run(&mut first, 900, 2);
            drop(first);
            let mut second = make();
            assert!(load(&mut second, b.path()).unwrap());
            assert_eq!(second.ledger.step, 600);
            run(&mut second, 1200, 2);
            save(&mut second, b.path(), 1200).unwrap();

            for file in
                ["state.safetensors", "snapshot-000001200.safetensors", "replay-00001.safetensors"]
            {
                let read = |d: &Path| std::fs::read(d.join(file)).unwrap();
                assert!(read(a.path()) == read(b.path()), "{} {file}", kind.name());
            }
            assert!(straight.ledger.updates > 50);
            let point = straight.ledger.curve.last().unwrap();
            assert!(point.reward.is_finite() && point.coverage > 0.0, "{point:?}");
        }
    }

    #[test]
    fn a_memory_that_forgets_goes_on_alike() {
        let robot = Arc::new(Robot::builtin("pointmass").unwrap());
        // Between updates the memory grows beyond its capacity, so some episodes are dropped before
        // any checkpoint contains them.
        let small = Preset { capacity: 500, update_every: 450, ..preset() };
        let make = || Agent::new(&robot, AgentKind::Rnd, &small, 4).unwrap().unwrap();
        let (a, b) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let mut straight = make();
        for nominal in [900, 1800, 4200] {
            run(&mut straight, nominal, 1);
            save(&mut straight, a.path(), nominal).unwrap();
            let mut again = make();
            load(&mut again, b.path()).unwrap();
            run(&mut again, nominal, 2);
            save(&mut again, b.path(), nominal).unwrap();
            for file in
                ["state.safetensors".to_owned(), format!("snapshot-{nominal:09}.safetensors")]
            {
                let read = |d: &Path| std::fs::read(d.join(&file)).unwrap();
                assert!(read(a.path()) == read(b.path()), "{nominal} {file}");
            }
        }
        assert!(straight.replay.begun() > straight.replay.remembered());
    }

    #[test]
    fn damage_is_told_with_its_cure() {
        let robot = Arc::new(Robot::builtin("pointmass").unwrap());
        let make = || Agent::new(&robot, AgentKind::Rnd, &preset(), 4).unwrap().unwrap();
        let dir = tempfile::tempdir().unwrap();
        let mut agent = make();
        run(&mut agent, 600, 1);
        save(&mut agent, dir.path(), 600).unwrap();
        for file in
            ["state.safetensors", "replay-00000.safetensors", "snapshot-000000600.safetensors"]
        {
            let path = dir.path().join(file);
            let whole = std::fs::read(&path).unwrap();
            std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
            let e = curable(load(&mut make(), dir.path()).unwrap_err(), dir.path()).to_string();
            assert!(e.contains("; delete ") && e.ends_with(file), "{e}");
            if file != "state.safetensors" {
                std::fs::remove_file(&path).unwrap();
                let e = curable(load(&mut make(), dir.path()).unwrap_err(), dir.path()).to_string();
                assert!(e.contains("; delete ") && e.ends_with(file), "{e}");
            }
            std::fs::write(&path, &whole).unwrap();
        }
        assert!(load(&mut make(), dir.path()).unwrap());
    }
}
