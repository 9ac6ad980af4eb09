//! The live rollout: its frames, and which of them each client has not seen yet.
//!
//! There are no queues. One store holds the frames, each with the stamp of its writing. A client
//! remembers the newest stamp that it has sent and takes what is newer. A slow browser therefore
//! gets fewer, larger updates and never falls behind, and a thousand edits during its sleep cost it
//! only their last state.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

use serde_json::Value;
use tokio::sync::watch;

use super::frame_log::FrameLog;
use super::robot_context::RobotContext;
use super::take_files::TakeFiles;
use super::takes::{Quality, Source, Take, Takes};
use super::unreached::Unreached;
use super::worker::{Frames, MotionRows, SimulationEvent, WorkerSink};
use crate::protocol::{Event, Hub, Phase, RolloutSettings, RolloutState, RolloutView, WorkerState};
use robert_clip::{Clip, Command};

/// The store; see the module.
#[derive(Debug)]
pub(crate) struct RolloutStore {
    inner: RwLock<Inner>,
    changed: watch::Sender<u64>,
    pub(super) hub: Hub,
    pub(super) files: Mutex<TakeFiles>,
    /// What was said when they were read.
    pub(super) skipped: Vec<String>,
}

#[derive(Debug, Default)]
pub(super) struct Inner {
    pub(super) robot: Option<Arc<RobotContext>>,
    settings: RolloutSettings,
    pub(super) performance: Performance,
    frames: FrameLog,
    state: RolloutState,
    state_stamp: u64,
    /// Rollouts up to this number are of another robot.
    floor: u64,
    precision: Option<Value>,
    pub(super) takes: Takes,
    worker: WorkerState,
}

/// The command that is performed.
#[derive(Debug, Default)]
pub(super) struct Performance {
    pub(super) command: Option<Arc<Command>>,
    /// The clip and the settings; `None` for a preview, which is no take.
    source: Option<(Arc<Clip>, RolloutSettings)>,
    /// Frames of the keys of the last clip, for the ghosts around the playhead.
    keys: Arc<[u32]>,
    /// Title of the last clip, for pictures.
    title: String,
    /// Poses of the document that the robot cannot hold, as far as they have been simulated.
    unreached: Vec<Unreached>,
}

/// The command that is performed, and the frames of the clip's keys.
pub(crate) type Performed = (Option<Arc<Command>>, Arc<[u32]>);
/// Achieved and commanded body transforms; (nbody, 7) each.
pub(crate) type BodyPair = (Arc<[f32]>, Arc<[f32]>);

/// Body transforms by frame; (nbody, 7) each.
pub(crate) type BodyRows = Vec<Arc<[f32]>>;

/// The changes that one client has not seen yet.
#[derive(Debug, Default)]
pub(crate) struct ClientUpdate {
    /// Its stamp from now on.
    pub(crate) seen: u64,
    /// Frames, if any are new.
    pub(crate) frames: Option<Event>,
    /// State, if it changed.
    pub(crate) state: Option<Event>,
}

impl RolloutStore {
    /// A store with the pinned takes of this folder.
    pub(super) fn open(hub: Hub, takes: PathBuf) -> Arc<RolloutStore> {
        let (files, found) = TakeFiles::open(takes);
        for said in &found.skipped {
            tracing::warn!("{said}");
        }
        let inner = Inner { takes: Takes::of(found.takes), ..Inner::default() };
        Arc::new(RolloutStore {
            inner: RwLock::new(inner),
            changed: watch::Sender::new(0),
            hub,
            files: Mutex::new(files),
            skipped: found.skipped,
        })
    }

    pub(super) fn read(&self) -> RwLockReadGuard<'_, Inner> {
        self.inner.read().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn write(&self) -> RwLockWriteGuard<'_, Inner> {
        self.inner.write().unwrap_or_else(PoisonError::into_inner)
    }

    /// Wakes whenever something has changed.
    pub(crate) fn watch(&self) -> watch::Receiver<u64> {
        self.changed.subscribe()
    }

    pub(super) fn notify(&self) {
        self.changed.send_modify(|n| *n += 1);
    }

    /// Sets the robot of the open document.
    pub(super) fn set_robot(&self, robot: Option<Arc<RobotContext>>) {
        {
            let mut inner = self.write();
            inner.robot = robot;
            inner.clear();
        }
        self.notify();
        self.tell_takes();
    }

    /// The robot of the open document.
    pub(crate) fn robot(&self) -> Option<Arc<RobotContext>> {
        self.read().robot.clone()
    }

    /// The settings of rollouts.
    pub(crate) fn settings(&self) -> RolloutSettings {
        self.read().settings.clone()
    }

    /// Sets how rollouts are made from now on.
    pub(super) fn set_settings(&self, settings: RolloutSettings) {
        self.write().settings = settings;
    }

    /// Begins the rollout of a command and returns its number. Without a clip it is a preview
    /// (`rev` 0).
    pub(super) fn begin(&self, rev: u64, command: &Command, clip: Option<&Clip>) -> u64 {
        let generation = {
            let mut inner = self.write();
            inner.state_stamp = inner.frames.next_stamp();
            inner.frames.forget_pace();
            inner.performance.command = Some(Arc::new(command.clone()));
            inner.performance.source = clip.map(|c| (Arc::new(c.clone()), inner.settings.clone()));
            if let Some(clip) = clip {
                clip.name.clone_into(&mut inner.performance.title);
                inner.performance.keys = clip.keys.iter().map(|k| k.frame).collect();
            }
            inner.state = RolloutState {
                generation: inner.state.generation + 1,
                rev,
                phase: Phase::Waiting,
                frames: command.frames() as usize,
                policy: inner.settings.label(),
                tried: Vec::new(),
                stage: None,
                error: None,
                ..inner.state.clone()
            };
            inner.state.generation
        };
        self.notify();
        generation
    }

    /// Rises with every change of frames and state.
    pub(crate) fn stamp(&self) -> u64 {
        self.read().frames.stamp()
    }

    /// Achieved and commanded body transforms of all simulated frames; (nbody, 7) each.
    pub(crate) fn all_bodies(&self) -> (BodyRows, BodyRows) {
        let inner = self.read();
        (inner.frames.bodies.clone(), inner.frames.goal_bodies.clone())
    }

    /// The command that is performed, and the frames of the clip's keys.
    pub(crate) fn command(&self) -> Performed {
        let inner = self.read();
        (inner.performance.command.clone(), Arc::clone(&inner.performance.keys))
    }

    /// Sets the poses of the document that the robot cannot hold.
    pub(crate) fn set_unreached(&self, poses: Vec<Unreached>) {
        let changed = {
            let known = &mut self.write().performance.unreached;
            let changed = *known != poses;
            *known = poses;
            changed
        };
        if changed {
            self.notify();
        }
    }

    /// The pose in which the robot rests when it is commanded this one at a frame, if it cannot
    /// hold it.
    pub(crate) fn rests_in(&self, frame: u32, commanded: &[f64]) -> Option<Vec<f64>> {
        let inner = self.read();
        let found = inner.performance.unreached.iter().find(|p| p.is_at(frame, commanded));
        found.map(|p| p.rests.clone())
    }

    /// Nothing is performed any more. A motion that was being improved ends with its figures.
    pub(super) fn cancel(&self) {
        {
            let mut inner = self.write();
            let simulates = matches!(inner.state.phase, Phase::Waiting | Phase::Running);
            if simulates && inner.state.stage.is_none() {
                inner.set_phase(Phase::Off, None);
            }
        }
        self.notify();
    }

    /// The simulation as it is.
    pub(crate) fn worker_state(&self) -> WorkerState {
        self.read().worker.clone()
    }

    /// Everything.
    pub(crate) fn view(&self) -> RolloutView {
        let inner = self.read();
        RolloutView {
            state: inner.state.clone(),
            q: inner.frames.q.clone(),
            error: inner.frames.error.clone(),
            precision: inner.precision.clone(),
        }
    }

    /// Whether nothing is being performed.
    pub(crate) fn rests(&self) -> bool {
        !matches!(self.read().state.phase, Phase::Waiting | Phase::Running)
    }

    /// The progress of the rollout.
    pub(crate) fn state(&self) -> RolloutState {
        self.read().state.clone()
    }

    /// Achieved and commanded body transforms at a frame; (nbody, 7) each. Beyond the simulated
    /// frames, those of the last one.
    pub(crate) fn bodies(&self, frame: usize) -> Option<BodyPair> {
        let inner = self.read();
        let frames = &inner.frames;
        let last = frames.bodies.len().checked_sub(1)?;
        let at = frame.min(last);
        Some((Arc::clone(frames.bodies.get(at)?), Arc::clone(frames.goal_bodies.get(at)?)))
    }

    /// Achieved and commanded body transforms at this number of times, spread evenly over the
    /// simulated frames; (nbody, 7) each.
    pub(crate) fn moments(&self, count: usize) -> Vec<Arc<[f32]>> {
        let inner = self.read();
        let step = inner.frames.bodies.len().div_ceil(count.max(1)).max(1);
        let some = |rows: &[Arc<[f32]>]| rows.iter().step_by(step).cloned().collect::<Vec<_>>();
        [some(&inner.frames.bodies), some(&inner.frames.goal_bodies)].concat()
    }

    /// The motion around this frame, for a picture: a stamp that identifies it, the source of the
    /// robot, and its rows. Frames that are not simulated yet show the command, and are marked so.
    /// `None` without a robot.
    pub(crate) fn motion(&self, frame: usize) -> Option<(u64, String, MotionRows)> {
        let inner = self.read();
        let robot = inner.robot.as_ref()?;
        let performance = &inner.performance;
        let command = performance.command.as_ref()?.reordered(&robot.table.names())?;
        let simulated = frame < inner.frames.q.len();
        let commanded = command.goal_rows().collect();
        let (achieved, performer) = if simulated {
            (inner.frames.q.clone(), Some(inner.state.policy.clone()))
        } else {
            let rows = (0..command.frames()).map(|f| command.interpolated(f)).collect();
            (rows, None)
        };
        let motion = MotionRows {
            name: performance.title.clone(),
            performer,
            commanded,
            achieved,
            keys: performance.keys.iter().map(|k| *k as usize).collect(),
        };
        // Twice the stamp, so that the two kinds of rows never share one.
        let stamp = 2 * inner.frames.stamp() + u64::from(simulated);
        Some((stamp, robot.source.clone(), motion))
    }

    /// The changes since a stamp.
    pub(crate) fn update(&self, seen: u64) -> ClientUpdate {
        let inner = self.read();
        let frames = inner.frames.first_after(seen).map(|from| Event::RolloutFrames {
            generation: inner.state.generation,
            from,
            q: inner.frames.q[from..].to_vec(),
            error: inner.frames.error[from..].to_vec(),
        });
        let state = (inner.state_stamp > seen).then(|| Event::RolloutState(inner.state.clone()));
        ClientUpdate { seen: inner.frames.stamp(), frames, state }
    }
}

impl Inner {
    fn clear(&mut self) {
        self.truncate(0);
        self.precision = None;
        let title = std::mem::take(&mut self.performance.title);
        self.performance = Performance { title, ..Performance::default() };
        self.state_stamp = self.frames.next_stamp();
        // Frames of a robot that was replaced may still arrive.
        self.floor = self.state.generation;
        self.state = RolloutState { generation: self.floor + 1, ..RolloutState::default() };
    }

    fn truncate(&mut self, frames: usize) {
        self.frames.truncate(frames);
        self.state.cached_to = self.frames.q.len();
    }

    /// Keeps the finished rollout as a take, if it performed the document and not a preview.
    fn keep_take(&mut self) -> bool {
        let (Some(robot), Some(command)) = (&self.robot, &self.performance.command) else {
            return false;
        };
        let Some((clip, settings)) = self.performance.source.clone() else { return false };
        let whole = self.frames.q.len() == self.state.frames && !self.frames.q.is_empty();
        if self.state.phase != Phase::Done || !whole {
            return false;
        }
        let source = Source { robot: robot.source.clone(), clip, settings };
        self.takes.keep(Take {
            id: 0,
            name: String::new(),
            source,
            command: Arc::clone(command),
            policy: self.state.policy.clone(),
            rev: self.state.rev,
            mae: self.state.mae,
            motion: Arc::new(self.frames.motion()),
            pinned: false,
            quality: Quality::default(),
        });
        true
    }

    fn set_phase(&mut self, phase: Phase, error: Option<String>) {
        self.state_stamp = self.frames.next_stamp();
        self.state.phase = phase;
        self.state.stage = self.state.stage.filter(|_| phase == Phase::Running);
        self.state.error = error;
    }

    fn take(&mut self, frames: Frames) {
        let generation = frames.generation;
        self.frames.extend(frames);
        self.state.cached_to = self.frames.q.len();
        self.state.mae = self.frames.mean_error();
        self.state.ms_per_frame = self.frames.ms_per_frame();
        if generation == self.state.generation {
            self.goes_on();
        }
    }

    /// Marks the rollout as running, unless it was stopped meanwhile. Frames that were already sent
    /// stay valid.
    fn goes_on(&mut self) {
        if matches!(self.state.phase, Phase::Waiting | Phase::Running) {
            self.set_phase(Phase::Running, None);
        }
    }
}

impl WorkerSink for RolloutStore {
    fn event(&self, event: SimulationEvent) {
        let mut kept = false;
        {
            let mut inner = self.write();
            let current = inner.state.generation;
            let floor = inner.floor;
            match event {
                // The worker continues from what it has simulated, whichever request led to that.
                // Its frames count even if a newer rollout has been requested meanwhile.
                SimulationEvent::Started { generation, resumed_at } if generation > floor => {
                    inner.truncate(if resumed_at == 0 { 0 } else { resumed_at + 1 });
                    inner.precision = None;
                    if generation == current {
                        inner.state.resumed_at = resumed_at;
                        inner.goes_on();
                    }
                }
                SimulationEvent::Frames(frames) if frames.generation > floor => inner.take(frames),
                SimulationEvent::Improving { generation, stage } if generation == current => {
                    inner.state.stage = Some(stage);
                    inner.goes_on();
                }
                SimulationEvent::Ended { generation, precision, choice, error }
                    if generation == current =>
                {
                    inner.precision = precision.as_ref().and_then(|p| serde_json::to_value(p).ok());
                    if let Some(p) = precision {
                        inner.state.mae = p.precision;
                    }
                    if let Some(choice) = choice {
                        let asked = inner.settings.label();
                        inner.state.policy = format!("{asked}: {}", choice.policy);
                        inner.state.tried = choice.tried;
                    }
                    let phase = if error.is_some() { Phase::Failed } else { Phase::Done };
                    inner.set_phase(phase, error);
                    kept = inner.keep_take();
                }
                _ => return,
            }
        }
        self.notify();
        if kept {
            self.tell_takes();
        }
    }

    fn state(&self, state: &WorkerState) {
        self.write().worker = state.clone();
        self.hub.send(&Event::Worker(state.clone()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn store() -> Arc<RolloutStore> {
        RolloutStore::open(Hub::new(), PathBuf::from("/nowhere"))
    }

    fn frames(generation: u64, from: usize, n: usize) -> SimulationEvent {
        let row = vec![generation as f32];
        SimulationEvent::Frames(Frames {
            generation,
            from,
            q: vec![row; n],
            error: vec![Some(0.5); n],
            bodies: vec![vec![0.0; 7]; n],
            goal_bodies: vec![vec![0.0; 7]; n],
            secs: 0.001,
        })
    }

    fn from(update: &ClientUpdate) -> Option<(usize, usize)> {
        match &update.frames {
            Some(Event::RolloutFrames { from, q, .. }) => Some((*from, q.len())),
            _ => None,
        }
    }

    #[test]
    fn frames_on_their_way_do_not_start_what_was_stopped() {
        let store = store();
        store.write().state.generation = 1;
        store.write().state.phase = Phase::Waiting;
        store.event(SimulationEvent::Started { generation: 1, resumed_at: 0 });
        store.event(frames(1, 0, 5));
        assert_eq!(store.state().phase, Phase::Running);
        store.write().set_phase(Phase::Off, None);
        store.event(frames(1, 5, 3));
        store.event(SimulationEvent::Started { generation: 1, resumed_at: 8 });
        let state = store.state();
        assert_eq!((state.phase, state.cached_to), (Phase::Off, 8));
    }

    #[test]
    fn a_sleeping_client_gets_exactly_what_changed() {
        let store = store();
        store.write().state.generation = 1;
        store.event(frames(1, 0, 50));
        let awake = store.update(0);
        assert_eq!(from(&awake), Some((0, 50)));
        assert_eq!(from(&store.update(awake.seen)), None);
        // Two edits while it slept: one went back to 30, the next only to 40.
        store.write().state.generation = 2;
        store.event(frames(2, 30, 5));
        store.write().state.generation = 3;
        store.event(frames(3, 33, 27));
        assert_eq!(from(&store.update(awake.seen)), Some((30, 30)));
        assert_eq!(store.state().cached_to, 60);
        store.set_robot(None);
        store.event(frames(3, 0, 9)); // of the robot before
        assert_eq!(store.state().cached_to, 0);
        assert!(store.update(store.update(0).seen).state.is_none());
    }
}
