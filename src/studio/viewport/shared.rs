//! The scene as it is now, shared between the stage and its clients.

use std::sync::{Mutex, PoisonError};

use tokio::sync::watch;

use super::retained::Retained;
use crate::protocol::Pin;
use robert_take::viser::Message;

/// The scene, the locked joints, and the pinned sites.
#[derive(Debug)]
pub(super) struct Shared {
    scene: Mutex<Retained>,
    changed: watch::Sender<u64>,
    locked: Mutex<Vec<String>>,
    pins: Mutex<Vec<Pin>>,
}

impl Shared {
    /// Nothing in it.
    pub(super) fn new() -> Shared {
        let changed = watch::Sender::new(0);
        let (locked, pins) = (Mutex::default(), Mutex::default());
        Shared { scene: Mutex::default(), changed, locked, pins }
    }

    /// Changes the scene, and notifies clients if anything is new.
    pub(super) fn edit<T>(&self, change: impl FnOnce(&mut Retained) -> T) -> T {
        let (result, stamp) = {
            let mut scene = self.scene.lock().unwrap_or_else(PoisonError::into_inner);
            let result = change(&mut scene);
            (result, scene.stamp())
        };
        self.changed.send_if_modified(|known| {
            let newer = *known < stamp;
            *known = stamp;
            newer
        });
        result
    }

    /// Wakes whenever the scene has changed.
    pub(super) fn watch(&self) -> watch::Receiver<u64> {
        self.changed.subscribe()
    }

    /// The messages since a stamp, and the stamp from now on.
    pub(super) fn since(&self, seen: u64) -> (Vec<Message>, u64) {
        self.scene.lock().unwrap_or_else(PoisonError::into_inner).since(seen)
    }

    /// Joints that are locked: no drag moves them.
    pub(super) fn locked(&self) -> Vec<String> {
        self.locked.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Sites that inverse kinematics keeps in place.
    pub(super) fn pins(&self) -> Vec<Pin> {
        self.pins.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Sets the sites that inverse kinematics keeps in place.
    pub(super) fn set_pins(&self, pins: Vec<Pin>) {
        *self.pins.lock().unwrap_or_else(PoisonError::into_inner) = pins;
    }

    /// Sets the joints that stay fixed.
    pub(super) fn set_locked(&self, joints: Vec<String>) {
        *self.locked.lock().unwrap_or_else(PoisonError::into_inner) = joints;
    }
}
