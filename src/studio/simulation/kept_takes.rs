//! Reading and changing the takes that the store keeps.

use std::sync::{Arc, PoisonError};

use super::rollout_store::RolloutStore;
use super::takes::Takes;
use crate::protocol::{Error, Event, RolloutSettings, TakeFrames, TakesView};
use robert_clip::Clip;

impl RolloutStore {
    /// Takes of the open robot.
    pub(crate) fn takes(&self) -> TakesView {
        let inner = self.read();
        let robot = inner.robot.as_ref().map(|r| r.source.as_str());
        let view = inner.takes.view(robot, inner.performance.command.as_deref());
        TakesView { skipped: self.skipped.clone(), ..view }
    }

    /// The motion of a take.
    pub(crate) fn take_frames(&self, id: u64) -> Option<TakeFrames> {
        let inner = self.read();
        let take = inner.takes.get(id)?;
        Some(TakeFrames { q: take.motion.q.clone(), error: take.motion.error.clone() })
    }

    /// The clip, robot and settings that a take was performed with, to perform it again.
    pub(crate) fn take_source(&self, id: u64) -> Option<(Arc<Clip>, RolloutSettings)> {
        let inner = self.read();
        let take = inner.takes.get(id)?;
        Some((Arc::clone(&take.source.clip), take.source.settings.clone()))
    }

    /// Changes takes, also on disk, and tells all clients.
    ///
    /// # Errors
    /// The refusal, or why a pinned take is not on disk.
    pub(crate) fn change_takes(
        &self,
        change: impl FnOnce(&mut Takes) -> Result<(), Error>,
    ) -> Result<(), Error> {
        // The files are locked first: the last change is also the last that is written.
        let mut files = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        let pinned = {
            let mut inner = self.write();
            change(&mut inner.takes)?;
            inner.takes.pinned()
        };
        let written = files.keep(&pinned);
        drop(files);
        self.notify();
        self.tell_takes();
        written
    }

    pub(super) fn tell_takes(&self) {
        self.hub.send(&Event::Takes(self.takes()));
    }

    /// Body transforms at a frame of the take that is compared in the viewport, and beyond its end
    /// at its last frame. One row of (nbody, 7).
    pub(crate) fn beside(&self, frame: usize) -> Option<Arc<[f32]>> {
        let inner = self.read();
        let bodies = &inner.takes.beside(&inner.robot.as_ref()?.source)?.motion.bodies;
        bodies.get(frame).or(bodies.last()).cloned()
    }
}
