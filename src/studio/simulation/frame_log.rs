//! The frames of a rollout, each with the stamp of its writing.

use std::sync::Arc;

use super::takes::Motion;
use super::worker::Frames;

/// Frames in the order of simulation; simulating a frame again replaces it.
#[derive(Debug, Default)]
pub(super) struct FrameLog {
    /// Achieved states; (frames, S).
    pub(super) q: Vec<Vec<f32>>,
    /// Mean absolute error by frame; `None` where masked.
    pub(super) error: Vec<Option<f64>>,
    /// Achieved body transforms; (nbody, 7) a frame.
    pub(super) bodies: Vec<Arc<[f32]>>,
    /// Commanded body transforms; (nbody, 7) a frame.
    pub(super) goal_bodies: Vec<Arc<[f32]>>,
    /// The stamp of each frame's last write; never falls along the frames.
    stamps: Vec<u64>,
    stamp: u64,
    /// Seconds that the frames of this rollout took, and how many were timed.
    spent: (f64, usize),
}

impl FrameLog {
    /// The newest stamp.
    pub(super) fn stamp(&self) -> u64 {
        self.stamp
    }

    /// A new stamp for something that has just changed.
    pub(super) fn next_stamp(&mut self) -> u64 {
        self.stamp += 1;
        self.stamp
    }

    /// Another rollout is timed from here.
    pub(super) fn forget_pace(&mut self) {
        self.spent = (0.0, 0);
    }

    /// Keeps the first frames only.
    pub(super) fn truncate(&mut self, frames: usize) {
        self.q.truncate(frames);
        self.error.truncate(frames);
        self.bodies.truncate(frames);
        self.goal_bodies.truncate(frames);
        self.stamps.truncate(frames);
    }

    /// Replaces the frames from the first new one on.
    pub(super) fn extend(&mut self, frames: Frames) {
        let stamp = self.next_stamp();
        self.truncate(frames.from);
        self.stamps.extend(std::iter::repeat_n(stamp, frames.q.len()));
        self.spent.0 += frames.secs;
        if frames.secs > 0.0 {
            self.spent.1 += frames.q.len();
        }
        self.q.extend(frames.q);
        self.error.extend(frames.error);
        self.bodies.extend(frames.bodies.into_iter().map(Arc::from));
        self.goal_bodies.extend(frames.goal_bodies.into_iter().map(Arc::from));
    }

    /// The first frame that was written after a stamp.
    pub(super) fn first_after(&self, seen: u64) -> Option<usize> {
        let from = self.stamps.partition_point(|s| *s <= seen);
        (from < self.stamps.len()).then_some(from)
    }

    /// Mean over the frames after the start that have a goal.
    pub(super) fn mean_error(&self) -> Option<f64> {
        let (mut sum, mut n) = (0.0, 0_u32);
        for e in self.error.iter().skip(1).flatten() {
            sum += e;
            n += 1;
        }
        (n > 0).then(|| sum / f64::from(n))
    }

    /// Time that a simulated frame takes, milliseconds.
    pub(super) fn ms_per_frame(&self) -> Option<f64> {
        (self.spent.1 > 0).then(|| 1e3 * self.spent.0 / self.spent.1 as f64)
    }

    /// A copy of what was achieved.
    pub(super) fn motion(&self) -> Motion {
        Motion { q: self.q.clone(), error: self.error.clone(), bodies: self.bodies.clone() }
    }
}
