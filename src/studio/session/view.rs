//! The open document as clients see it.

use super::actor::SessionActor;
use super::history::history;
use super::shown::Shown;
use crate::document::Document;
use crate::protocol::{DocumentView, Findings, History, policies};
use robert_clip::{Clip, JointTable, RobotRef};

impl SessionActor {
    /// The robot's joint table, with the masks that the policy in use accepts.
    pub(super) fn table(&self) -> JointTable {
        let clip = || self.document.as_ref().map(|d| JointTable::from_clip(d.clip()));
        let known = self.simulation.robot().map(|r| r.table.clone()).or_else(clip);
        let mut table = known.unwrap_or_else(|| JointTable::from_clip(&nothing()));
        table.granularity = self.choice.granularity;
        table
    }

    /// The document that readers get while this thread waits for a disk.
    pub(super) fn shown(&self) -> Shown {
        let document = self.document.as_ref();
        Shown {
            view: document.map(|_| Box::new(self.view())),
            text: document.map(Document::text),
            content: document.map(|d| (d.clip().clone(), d.command().clone())),
        }
    }

    pub(super) fn view(&self) -> DocumentView {
        let Some(document) = &self.document else {
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
            rev: document.rev(),
            clip: document.clip().to_json(),
            path: document.path().map(|p| p.display().to_string()),
            dirty: document.is_dirty(),
            history: history(document),
            table: self.table(),
            restored: document.restored().cloned(),
            findings: self.findings().0,
            policies: policies(&self.offers()),
        }
    }
}

/// A clip of no robot.
pub(super) fn nothing() -> Clip {
    Clip::new(RobotRef::default(), 2)
}
