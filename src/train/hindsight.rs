//! Hindsight self-correction: motion that the network reached is feasible, whatever the command
//! was.
//!
//! In rounds during training the network performs tasks extracted from its own training
//! trajectories, with some frames hidden, and reaches states that are not in the data. The reached
//! motion becomes the command, and the applied actions become the targets, which is correct by
//! construction. These trajectories are added to the data for the rest of the run (hindsight
//! relabelling, Andrychowicz et al. 2017, with dataset aggregation).

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use robert_base::progress::Cancel;
use robert_dataset::{
    Dataset, Episode, EpisodeMeta, Manifest, Part, Shard, ShardBuilder, Verify, Windows,
};
use robert_linalg::{next_of, on_threads};
use robert_net::Model;
use robert_robot::{Robot, StateJoint};
use robert_rollout::{
    EXTRACTED_FRAMES, HISTORY, Inference, Learned, Masking, Rollout, RolloutConfig, extract_task,
};

/// States of a task: history, present, commands.
pub(super) const STATES: usize = HISTORY + 1 + EXTRACTED_FRAMES;
/// Joint angle or distance beyond which a rollout is not used.
const IMPLAUSIBLE: f64 = 100.0;

/// One round of self-correction.
#[derive(Clone, Copy, Debug)]
pub struct Round<'a> {
    /// Its number, from 1.
    pub round: u64,
    /// Tasks to perform.
    pub tasks: usize,
    /// Seed of the random choices.
    pub seed: u64,
    /// Folder for the reached motion.
    pub dir: &'a Path,
}

/// Performs tasks from recorded motion with the current network.
pub trait Perform {
    /// Writes a dataset of reached trajectories, which is a function of the model, the data, the
    /// round and the seed. False if a stop was requested meanwhile; then nothing is written.
    ///
    /// # Errors
    /// A message; the run stops with it.
    fn perform(
        &mut self,
        model: &Model,
        data: &Dataset,
        job: &Round<'_>,
        cancel: &Cancel,
    ) -> Result<bool, String>;
}

/// [`Perform`] in the simulator.
#[derive(Debug)]
pub struct Simulated {
    /// The robot.
    pub robot: Arc<Robot>,
    /// Threads.
    pub threads: usize,
}

/// Folder of a round's trajectories in a run directory.
pub(super) fn folder(dir: &Path, round: u64) -> PathBuf {
    dir.join("self").join(format!("round-{round}"))
}

/// One reached trajectory: n frames.
struct Achieved {
    qpos: Vec<f32>,   // (n, S)
    qvel: Vec<f32>,   // (n, S)
    ctrl: Vec<f32>,   // (n, A)
    contact: Vec<u8>, // (n), of links with each other
}

impl Perform for Simulated {
    fn perform(
        &mut self,
        model: &Model,
        data: &Dataset,
        job: &Round<'_>,
        cancel: &Cancel,
    ) -> Result<bool, String> {
        let Round { round, tasks, seed, dir } = *job;
        let text = |e: &dyn std::fmt::Display| e.to_string();
        let policy = Inference::default().network(model.clone()).map_err(|e| text(&e))?;
        let policy = Mutex::new(policy);
        let windows = Windows::new(data, STATES, Part::Train, seed).map_err(|e| text(&e))?;
        let mut found: Vec<Result<Option<Achieved>, String>> = Vec::new();
        found.resize_with(tasks, || Ok(None));
        let queue = Mutex::new(found.iter_mut().enumerate());
        on_threads(self.threads.max(1), |_| {
            while !cancel.is_cancelled()
                && let Some((i, to)) = next_of(&queue)
            {
                let policy = policy.lock().unwrap_or_else(PoisonError::into_inner).clone();
                *to = one(&self.robot, policy, data, &windows, seed, (round << 32) + i as u64);
            }
        });
        if cancel.is_cancelled() {
            return Ok(false);
        }
        let robot = data.manifest().robot.clone();
        let mut manifest = Manifest::new(robot.clone());
        let spec = serde_json::json!({
            "self_correct": {"round": round, "tasks": tasks, "seed": seed, "step": model.card.training.step},
        });
        let sha = robert_base::fsio::sha256_hex(spec.to_string().as_bytes());
        let mut shard = ShardBuilder::new(&robot, &sha, 0);
        for (i, found) in found.into_iter().enumerate() {
            let Some(a) = found? else {
                shard.drop_broken();
                continue;
            };
            let meta = EpisodeMeta {
                agent: "self".into(),
                snapshot_step: model.card.training.step,
                seed: i as u64,
            };
            shard.push(&meta, &a.qpos, &a.qvel, &a.ctrl, &a.contact).map_err(|e| text(&e))?;
        }
        if shard.frames() == 0 {
            return Err("no rollout of the network could be used".into());
        }
        let file = PathBuf::from("shards/0.safetensors");
        let entry = shard.write(dir, &file).map_err(|e| text(&e))?;
        manifest.specs.insert(sha, spec);
        let written =
            Shard::open(&dir.join(&file), robot.joints.len(), robot.actuators.len(), None)?;
        manifest.shards.push(entry);
        let all = written.episodes();
        manifest.episodes = all
            .map(|(start, length, meta)| {
                let EpisodeMeta { agent, snapshot_step, seed } = meta;
                Episode { shard: 0, start, length, agent, snapshot_step, seed, part: None }
            })
            .collect();
        Dataset::publish(manifest, dir).map_err(|e| text(&e))?;
        Ok(true)
    }
}

/// Draws, masks and performs one task; `None` if the simulation diverged.
fn one(
    robot: &Arc<Robot>,
    policy: Learned,
    data: &Dataset,
    windows: &Windows<'_>,
    seed: u64,
    index: u64,
) -> Result<Option<Achieved>, String> {
    let (s, a) = (robot.state_dim(), robot.action_dim());
    let at = windows.draw(seed, index);
    let Some(episode) = data.episodes().get(at.episode) else { return Ok(None) };
    let (qpos, qvel, ctrl) = data.frames(episode);
    let rows = at.start * s..(at.start + STATES) * s;
    let (Some(q), Some(v)) = (qpos.get(rows.clone()), qvel.get(rows)) else { return Ok(None) };
    let masking = Masking::ALL[index as usize % Masking::ALL.len()];
    let joints = &data.manifest().robot.joints;
    let Some(case) = extract_task(joints, "self", q, v, masking, seed, index) else {
        return Ok(None);
    };
    let config = RolloutConfig { seed: index, ..RolloutConfig::default() };
    let mut rollout =
        Rollout::new(robot, Box::new(policy), &case.command, case.start.clone(), config)
            .map_err(|e| e.to_string())?;
    // As in collected data, a frame is in contact if its action ends in contact.
    let touched = data.self_contact(episode).get(at.start..at.start + HISTORY);
    let mut contact = touched.unwrap_or(&[0; HISTORY]).to_vec();
    while !rollout.is_done() {
        // A simulation that diverged is not used; the frames before that would be too few.
        if rollout.step().is_err() {
            return Ok(None);
        }
        contact.push(u8::from(rollout.touches_itself()));
    }
    let reached = rollout.reached();
    if reached.iter().any(|x| !x.is_finite() || x.abs() > IMPLAUSIBLE) {
        return Ok(None);
    }
    // The state after the last action has no action.
    let n = HISTORY + EXTRACTED_FRAMES;
    let mut out = Achieved {
        qpos: q[..HISTORY * s].to_vec(),
        qvel: v[..HISTORY * s].to_vec(),
        ctrl: ctrl[at.start * a..(at.start + HISTORY) * a].to_vec(),
        contact,
    };
    out.qpos.extend(reached[..EXTRACTED_FRAMES * s].iter().map(|&x| x as f32));
    for frame in 0..EXTRACTED_FRAMES {
        let Some(state) = rollout.snapshot(frame) else {
            unreachable!("a rollout keeps the state of every frame that it reached")
        };
        let of = |j: &StateJoint| state.qvel[j.dofadr] as f32;
        out.qvel.extend(robot.joints().iter().map(of));
    }
    out.ctrl.extend(rollout.actions()[..EXTRACTED_FRAMES * a].iter().map(|&x| x as f32));
    debug_assert_eq!((out.qpos.len(), out.ctrl.len(), out.contact.len()), (n * s, n * a, n));
    Ok(Some(out))
}

/// The rounds' datasets, opened, with the windows of all their trajectories.
pub(super) fn open(dir: &Path, rounds: u64) -> Result<Vec<Dataset>, robert_dataset::Error> {
    (1..=rounds).map(|r| Dataset::open(&folder(dir, r), Verify::Full)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::untrained;

    #[test]
    fn what_was_reached_in_contact_is_noted() {
        let dir = tempfile::tempdir().unwrap();
        let (robot, data, model) = untrained("ur5e", 3, &dir.path().join("data"));
        let mut simulated = Simulated { robot, threads: 2 };
        let (out, cancel) = (dir.path().join("one"), Cancel::default());
        let job = Round { round: 1, tasks: 12, seed: 0, dir: &out };
        assert!(simulated.perform(&model, &data, &job, &cancel).unwrap());

        let reached = Dataset::open(&out, Verify::Full).unwrap();
        let windows = Windows::new(&data, STATES, Part::Train, 0).unwrap();
        let (mut before, mut after) = (0, 0);
        for e in reached.episodes() {
            let flags = reached.self_contact(e);
            assert_eq!(flags.len(), HISTORY + EXTRACTED_FRAMES);
            // The history is recorded motion, and so are its flags.
            let at = windows.draw(0, (1 << 32) + e.seed);
            let source = data.self_contact(&data.episodes()[at.episode]);
            assert_eq!(flags[..HISTORY], source[at.start..at.start + HISTORY]);
            let count = |flags: &[u8]| flags.iter().filter(|&&c| c != 0).count();
            before += count(&flags[..HISTORY]);
            after += count(&flags[HISTORY..]);
        }
        assert!(before > 0 && after > 0, "{before} before, {after} after");

        let none = dir.path().join("none");
        cancel.cancel();
        let job = Round { dir: &none, ..job };
        assert!(!simulated.perform(&model, &data, &job, &cancel).unwrap());
        assert!(!none.exists(), "a round cut short leaves nothing");
    }
}
