//! The open document as clients see it.

use super::actor::SessionActor;
use crate::protocol::{DocumentView, Findings, History, policies};
use robert_clip::{Clip, JointTable, RobotRef};

impl SessionActor {
    /// The facts about the robot that are known, with the masks that the current policy accepts.
    pub(super) fn table(&self) -> JointTable {
        let clip = || self.shown.as_ref().map(|d| JointTable::from_clip(d.clip()));
        let known = self.simulation.robot().map(|r| r.table.clone()).or_else(clip);
        let mut table = known.unwrap_or_else(|| JointTable::from_clip(&nothing()));
        table.granularity = self.choice.granularity;
        table
    }

    pub(super) fn view(&self) -> DocumentView {
        let Some(shown) = &self.shown else {
            return DocumentView {
                opened: self.opened,
                rev: 0,
                clip: serde_json::Value::Null,
                path: None,
                dirty: false,
                history: History::default(),
                table: self.table(),
                restored: None,
                findings: Findings::default(),
                policies: Vec::new(),
            };
        };
        DocumentView {
            opened: self.opened,
            rev: shown.version.rev,
            clip: shown.clip().to_json(),
            path: shown.path.as_ref().map(|p| p.display().to_string()),
            dirty: shown.dirty,
            history: shown.history.clone(),
            table: self.table().in_order_of(shown.clip()),
            restored: shown.restored.clone(),
            findings: self.findings().0,
            policies: policies(&self.offers()),
        }
    }
}

/// A clip of no robot.
pub(super) fn nothing() -> Clip {
    Clip::new(RobotRef::default(), 2)
}
