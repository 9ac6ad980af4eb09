//! The live rollout: frames as they come, and what each client has yet to see of them.
//!
//! No queues. Frames stand in one store, each with the stamp of its writing; a client
//! remembers the newest stamp it has sent and takes what is newer. A slow browser so gets
//! fewer, larger updates and never falls behind, and a thousand edits while it sleeps cost
//! nothing but their last state.

use std::path::Path;
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

use serde_json::Value;
use tokio::sync::watch;

use super::error::Error;
use super::hub::Hub;
use super::protocol::{Event, Phase, RolloutSettings, RolloutState, RolloutView};
use super::takes::{Take, TakeFrames, Takes, TakesView};
use super::worker::{
    Dense, Frames, MotionRows, Report, Request, RobotFacts, WorkerHandle, WorkerSink, WorkerState,
};
use crate::clip::{Clip, Command};
use crate::net::Threads;

/// The store; see the module.
#[derive(Debug)]
pub struct Live {
    inner: RwLock<Inner>,
    changed: watch::Sender<u64>,
    hub: Hub,
}

#[derive(Debug, Default)]
struct Inner {
    state: RolloutState,
    state_stamp: u64,
    settings: RolloutSettings,
    q: Vec<Vec<f32>>,
    error: Vec<Option<f64>>,
    action: Vec<Vec<f32>>,
    bodies: Vec<Arc<[f32]>>,
    goal_bodies: Vec<Arc<[f32]>>,
    /// When each frame was written; never falls along the frames.
    stamps: Vec<u64>,
    stamp: u64,
    /// Rollouts up to this one are of another robot.
    floor: u64,
    /// Time and number of the frames of this rollout.
    spent: (f64, usize),
    precision: Option<Value>,
    facts: Option<Arc<RobotFacts>>,
    command: Option<Arc<Command>>,
    keys: Arc<[u32]>,
    title: String,
    /// The clip that is performed next.
    clip: Option<Arc<Clip>>,
    /// What is performed, and with which settings; `None` for a preview, which is no take.
    performing: Option<(Arc<Clip>, RolloutSettings)>,
    takes: Takes,
    worker: WorkerState,
    /// Joints that no hand moves.
    locked: Vec<String>,
}

/// What is performed, and the frames of the clip's keys.
pub type Performed = (Option<Arc<Command>>, Arc<[u32]>);
/// Achieved and commanded body transforms; (nbody, 7) each.
pub type BodyPair = (Arc<[f32]>, Arc<[f32]>);

/// News for one client.
#[derive(Debug, Default)]
pub struct News {
    /// Its stamp from now on.
    pub seen: u64,
    /// Frames, if any are new.
    pub frames: Option<Event>,
    /// State, if it changed.
    pub state: Option<Event>,
}

impl Live {
    /// An empty store.
    pub fn new(hub: Hub) -> Arc<Live> {
        Arc::new(Live { inner: RwLock::default(), changed: watch::Sender::new(0), hub })
    }

    fn read(&self) -> RwLockReadGuard<'_, Inner> {
        self.inner.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn write(&self) -> RwLockWriteGuard<'_, Inner> {
        self.inner.write().unwrap_or_else(PoisonError::into_inner)
    }

    /// Wakes whenever there is news.
    pub fn watch(&self) -> watch::Receiver<u64> {
        self.changed.subscribe()
    }

    fn notify(&self) {
        self.changed.send_modify(|n| *n += 1);
    }

    /// The robot of the open document.
    pub fn set_facts(&self, facts: Option<Arc<RobotFacts>>) {
        {
            let mut inner = self.write();
            inner.facts = facts;
            inner.clear();
        }
        self.notify();
        self.tell_takes();
    }

    /// The robot of the open document.
    pub fn facts(&self) -> Option<Arc<RobotFacts>> {
        self.read().facts.clone()
    }

    /// Joints that no hand moves.
    pub fn locked(&self) -> Vec<String> {
        self.read().locked.clone()
    }

    /// Joints that no hand moves from now on.
    pub fn set_locked(&self, joints: Vec<String>) {
        self.write().locked = joints;
    }

    /// How rollouts are made.
    pub fn settings(&self) -> RolloutSettings {
        self.read().settings.clone()
    }

    /// Changes how rollouts are made; a model's path counts from `folder`.
    pub fn set_settings(&self, settings: RolloutSettings, worker: &WorkerHandle, folder: &Path) {
        self.write().settings = settings.clone();
        let mut policy = settings.config();
        // One rollout at a time, and somebody waits for it.
        policy.inference.threads = Threads::Faster;
        // What is no file here is the name of a model that comes with the program or the robot.
        let full = |p: String| Some(folder.join(&p)).filter(|f| f.exists()).unwrap_or(p.into());
        policy.model_path = settings.model_path.map(full);
        worker.tell(Request::Policy { policy, seed: settings.seed });
    }

    /// Performs a command; `rev` 0 is a preview.
    pub fn perform(&self, rev: u64, command: &Command, worker: &WorkerHandle) {
        let generation = {
            let mut inner = self.write();
            inner.stamp += 1;
            inner.state_stamp = inner.stamp;
            inner.spent = (0.0, 0);
            inner.command = Some(Arc::new(command.clone()));
            inner.performing = inner.clip.take().map(|clip| (clip, inner.settings.clone()));
            inner.state = RolloutState {
                generation: inner.state.generation + 1,
                rev,
                phase: Phase::Waiting,
                frames: command.frames() as usize,
                policy: inner.settings.label(),
                error: None,
                ..inner.state.clone()
            };
            inner.state.generation
        };
        worker.tell(Request::Perform { generation, command: Dense::of(command) });
        self.notify();
    }

    /// The clip that is performed next: its title, for pictures, the frames of its keys, for the
    /// ghosts around the playhead, and all of it, for the take.
    pub fn set_clip(&self, clip: &Clip) {
        let mut inner = self.write();
        clip.name.clone_into(&mut inner.title);
        inner.keys = clip.keys.iter().map(|k| k.frame).collect();
        inner.clip = Some(Arc::new(clip.clone()));
    }

    /// Takes of the open robot.
    pub fn takes(&self) -> TakesView {
        let inner = self.read();
        let robot = inner.facts.as_ref().map(|f| f.source.as_str());
        inner.takes.view(robot, inner.command.as_deref())
    }

    /// The motion of a take.
    pub fn take_frames(&self, id: u64) -> Option<TakeFrames> {
        let inner = self.read();
        let take = inner.takes.get(id)?;
        Some(TakeFrames { q: take.q.clone(), error: take.error.clone() })
    }

    /// What a take was performed from, to perform it once more.
    pub fn take_source(&self, id: u64) -> Option<(Arc<Clip>, RolloutSettings)> {
        let inner = self.read();
        let take = inner.takes.get(id)?;
        Some((Arc::clone(&take.clip), take.settings.clone()))
    }

    /// Changes takes and tells everyone.
    ///
    /// # Errors
    /// The refusal.
    pub(super) fn change_takes(
        &self,
        change: impl FnOnce(&mut Takes) -> Result<(), Error>,
    ) -> Result<(), Error> {
        change(&mut self.write().takes)?;
        self.notify();
        self.tell_takes();
        Ok(())
    }

    fn tell_takes(&self) {
        self.hub.send(&Event::Takes(self.takes()));
    }

    /// Body transforms at a frame of the take that stands beside; beyond its end the last. One
    /// row of (nbody, 7).
    pub fn beside(&self, frame: usize) -> Option<Arc<[f32]>> {
        let inner = self.read();
        let take = inner.takes.beside(&inner.facts.as_ref()?.source)?;
        take.bodies.get(frame).or(take.bodies.last()).cloned()
    }

    /// The command that is performed, and the frames of the clip's keys.
    pub fn command(&self) -> Performed {
        let inner = self.read();
        (inner.command.clone(), Arc::clone(&inner.keys))
    }

    /// Stops performing.
    pub fn cancel(&self, worker: &WorkerHandle) {
        worker.tell(Request::Stop);
        {
            let mut inner = self.write();
            if matches!(inner.state.phase, Phase::Waiting | Phase::Running) {
                inner.set_phase(Phase::Off, None);
            }
        }
        self.notify();
    }

    /// The simulation as it is.
    pub fn worker_state(&self) -> WorkerState {
        self.read().worker.clone()
    }

    /// Everything.
    pub fn view(&self) -> RolloutView {
        let inner = self.read();
        RolloutView {
            state: inner.state.clone(),
            q: inner.q.clone(),
            error: inner.error.clone(),
            precision: inner.precision.clone(),
        }
    }

    /// Whether nothing is being performed.
    pub fn rests(&self) -> bool {
        !matches!(self.read().state.phase, Phase::Waiting | Phase::Running)
    }

    /// How far it is.
    pub fn state(&self) -> RolloutState {
        self.read().state.clone()
    }

    /// Achieved and commanded body transforms at a frame; (nbody, 7) each. Beyond what has
    /// been simulated the last frame there is.
    pub fn bodies(&self, frame: usize) -> Option<BodyPair> {
        let inner = self.read();
        let last = inner.bodies.len().checked_sub(1)?;
        let at = frame.min(last);
        Some((Arc::clone(inner.bodies.get(at)?), Arc::clone(inner.goal_bodies.get(at)?)))
    }

    /// Achieved and commanded body transforms at so many moments, evenly over what has been
    /// simulated; (nbody, 7) each.
    pub fn moments(&self, count: usize) -> Vec<Arc<[f32]>> {
        let inner = self.read();
        let step = inner.bodies.len().div_ceil(count.max(1)).max(1);
        let some = |rows: &[Arc<[f32]>]| rows.iter().step_by(step).cloned().collect::<Vec<_>>();
        [some(&inner.bodies), some(&inner.goal_bodies)].concat()
    }

    /// Achieved state of a frame.
    pub fn reached(&self, frame: usize) -> Option<Vec<f32>> {
        self.read().q.get(frame).cloned()
    }

    /// The motion that has this frame, for a picture: a stamp that is its own, where the robot
    /// is loaded from, and its rows. What is not simulated yet is laid out as commanded, and
    /// says so. `None` without a robot.
    pub fn motion(&self, frame: usize) -> Option<(u64, String, MotionRows)> {
        let inner = self.read();
        let facts = inner.facts.as_ref()?;
        let names = facts.table.names();
        let command = inner.command.as_ref()?.reordered(&names)?;
        let simulated = frame < inner.q.len();
        let commanded = (0..command.frames())
            .map(|f| {
                let row = command.row(f).iter().enumerate();
                row.map(|(j, v)| if command.sees(f, j) { *v } else { f32::NAN }).collect()
            })
            .collect();
        let (achieved, performer) = if simulated {
            (inner.q.clone(), inner.state.policy.clone())
        } else {
            let rows = (0..command.frames()).map(|f| command.interpolated(f)).collect();
            (rows, "not simulated".to_owned())
        };
        let motion = MotionRows {
            name: inner.title.clone(),
            performer,
            commanded,
            achieved,
            keys: inner.keys.iter().map(|k| *k as usize).collect(),
        };
        // Twice the stamp, so that the two kinds of rows never share one.
        let stamp = 2 * inner.stamp + u64::from(simulated);
        Some((stamp, facts.source.clone(), motion))
    }

    /// What a client that has seen everything up to a stamp has missed.
    pub fn news(&self, seen: u64) -> News {
        let inner = self.read();
        let from = inner.stamps.partition_point(|s| *s <= seen);
        let frames = (from < inner.stamps.len()).then(|| Event::RolloutFrames {
            generation: inner.state.generation,
            from,
            q: inner.q.get(from..).unwrap_or_default().to_vec(),
            error: inner.error.get(from..).unwrap_or_default().to_vec(),
        });
        let state = (inner.state_stamp > seen).then(|| Event::RolloutState(inner.state.clone()));
        News { seen: inner.stamp, frames, state }
    }
}

impl Inner {
    fn clear(&mut self) {
        self.truncate(0);
        self.precision = None;
        self.command = None;
        self.clip = None;
        self.performing = None;
        self.keys = Arc::default();
        self.stamp += 1;
        self.state_stamp = self.stamp;
        // A robot that is gone may still have frames on their way.
        self.floor = self.state.generation;
        self.state = RolloutState { generation: self.floor + 1, ..RolloutState::default() };
    }

    fn truncate(&mut self, frames: usize) {
        self.q.truncate(frames);
        self.error.truncate(frames);
        self.action.truncate(frames);
        self.bodies.truncate(frames);
        self.goal_bodies.truncate(frames);
        self.stamps.truncate(frames);
        self.state.cached_to = self.q.len();
    }

    /// Keeps what was just performed, if that was the document and not a preview.
    fn keep_take(&mut self) -> bool {
        let (Some(facts), Some(command)) = (&self.facts, &self.command) else { return false };
        let Some((clip, settings)) = self.performing.clone() else { return false };
        let whole = self.q.len() == self.state.frames && !self.q.is_empty();
        if self.state.phase != Phase::Done || !whole {
            return false;
        }
        self.takes.keep(Take {
            id: 0,
            name: String::new(),
            robot: facts.source.clone(),
            clip,
            command: Arc::clone(command),
            settings,
            policy: self.state.policy.clone(),
            rev: self.state.rev,
            mae: self.state.mae,
            q: self.q.clone(),
            error: self.error.clone(),
            bodies: self.bodies.clone(),
            pinned: false,
        });
        true
    }

    fn set_phase(&mut self, phase: Phase, error: Option<String>) {
        self.stamp += 1;
        self.state_stamp = self.stamp;
        self.state.phase = phase;
        self.state.error = error;
    }

    fn take(&mut self, frames: Frames) {
        self.stamp += 1;
        self.truncate(frames.from);
        let stamp = self.stamp;
        self.stamps.extend(std::iter::repeat_n(stamp, frames.q.len()));
        self.spent.0 += frames.secs;
        if frames.secs > 0.0 {
            self.spent.1 += frames.q.len();
        }
        self.q.extend(frames.q);
        self.error.extend(frames.error);
        self.action.extend(frames.action);
        self.bodies.extend(frames.bodies.into_iter().map(Arc::from));
        self.goal_bodies.extend(frames.goal_bodies.into_iter().map(Arc::from));
        self.state.cached_to = self.q.len();
        let (mut sum, mut n) = (0.0, 0_u32);
        for e in self.error.iter().skip(1).flatten() {
            sum += e;
            n += 1;
        }
        self.state.mae = (n > 0).then(|| sum / f64::from(n));
        self.state.ms_per_frame =
            (self.spent.1 > 0).then(|| 1e3 * self.spent.0 / self.spent.1 as f64);
        if frames.generation == self.state.generation {
            self.goes_on();
        }
    }

    /// It is running, unless it was stopped meanwhile: what was on its way then still counts.
    fn goes_on(&mut self) {
        if matches!(self.state.phase, Phase::Waiting | Phase::Running) {
            self.set_phase(Phase::Running, None);
        }
    }
}

impl WorkerSink for Live {
    fn report(&self, report: Report) {
        let mut kept = false;
        {
            let mut inner = self.write();
            let current = inner.state.generation;
            let floor = inner.floor;
            match report {
                // The worker goes on from what it has simulated, whoever asked for that: its
                // frames count even when a newer rollout has been asked for meanwhile.
                Report::Started { generation, resumed_at } if generation > floor => {
                    inner.truncate(if resumed_at == 0 { 0 } else { resumed_at + 1 });
                    inner.precision = None;
                    if generation == current {
                        inner.state.resumed_at = resumed_at;
                        inner.goes_on();
                    }
                }
                Report::Frames(frames) if frames.generation > floor => inner.take(frames),
                Report::Ended { generation, precision, error } if generation == current => {
                    inner.precision = precision.as_ref().and_then(|p| serde_json::to_value(p).ok());
                    if let Some(p) = precision {
                        inner.state.mae = p.precision;
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

    fn frames(generation: u64, from: usize, n: usize) -> Report {
        let row = vec![generation as f32];
        Report::Frames(Frames {
            generation,
            from,
            q: vec![row.clone(); n],
            error: vec![Some(0.5); n],
            bodies: vec![vec![0.0; 7]; n],
            goal_bodies: vec![vec![0.0; 7]; n],
            action: vec![row; n],
            secs: 0.001,
        })
    }

    fn from(news: &News) -> Option<(usize, usize)> {
        match &news.frames {
            Some(Event::RolloutFrames { from, q, .. }) => Some((*from, q.len())),
            _ => None,
        }
    }

    #[test]
    fn frames_on_their_way_do_not_start_what_was_stopped() {
        let live = Live::new(Hub::new());
        live.write().state.generation = 1;
        live.write().state.phase = Phase::Waiting;
        live.report(Report::Started { generation: 1, resumed_at: 0 });
        live.report(frames(1, 0, 5));
        assert_eq!(live.state().phase, Phase::Running);
        live.write().set_phase(Phase::Off, None);
        live.report(frames(1, 5, 3));
        live.report(Report::Started { generation: 1, resumed_at: 8 });
        let state = live.state();
        assert_eq!((state.phase, state.cached_to), (Phase::Off, 8));
    }

    #[test]
    fn a_sleeping_client_gets_exactly_what_changed() {
        let live = Live::new(Hub::new());
        live.write().state.generation = 1;
        live.report(frames(1, 0, 50));
        let awake = live.news(0);
        assert_eq!(from(&awake), Some((0, 50)));
        assert_eq!(from(&live.news(awake.seen)), None);
        // Two edits while it slept: one went back to 30, the next only to 40.
        live.write().state.generation = 2;
        live.report(frames(2, 30, 5));
        live.write().state.generation = 3;
        live.report(frames(3, 33, 27));
        assert_eq!(from(&live.news(awake.seen)), Some((30, 30)));
        assert_eq!(live.state().cached_to, 60);
        live.set_facts(None);
        live.report(frames(3, 0, 9)); // of the robot before
        assert_eq!(live.state().cached_to, 0);
        assert!(live.news(live.news(0).seen).state.is_none());
    }
}
