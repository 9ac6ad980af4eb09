//! The robot of the open document: one copy of its facts for all readers.

use std::collections::BTreeSet;
use std::ops::Deref;

use crate::protocol::RobotFacts;
use robert_clip::Command;

/// A robot's facts, and tables derived from them.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct RobotContext(RobotFacts);

impl Deref for RobotContext {
    type Target = RobotFacts;

    fn deref(&self) -> &RobotFacts {
        &self.0
    }
}

impl RobotContext {
    /// The context that follows from the simulation's facts.
    pub(crate) fn new(facts: RobotFacts) -> RobotContext {
        RobotContext(facts)
    }

    /// The state joint of this name.
    pub(crate) fn joint(&self, name: &str) -> Option<usize> {
        self.table.joints.iter().position(|j| j.name == name)
    }

    /// The body of this name; 0 is the world.
    pub(crate) fn body(&self, name: &str) -> Option<usize> {
        self.bodies.iter().position(|b| b.name == name)
    }

    /// Whether `body` is another body or a descendant of it.
    pub(crate) fn hangs_on(&self, mut body: usize, on: usize) -> bool {
        for _ in 0..self.bodies.len() {
            if body == on {
                return true;
            }
            match self.bodies.get(body) {
                Some(fact) if body != 0 => body = fact.parent,
                _ => return false,
            }
        }
        false
    }

    /// The joint that moves a body: its own joint, else that of the nearest ancestor with one.
    /// Joints in `locked` are skipped.
    pub(crate) fn moving_joint(&self, body: usize, locked: &BTreeSet<String>) -> Option<usize> {
        let mut at = body;
        for _ in 0..self.bodies.len() {
            let body = self.bodies.get(at)?;
            let joint = body.joints.iter().rev().find(|j| !self.is_locked(**j, locked));
            if let Some(joint) = joint {
                return Some(*joint);
            }
            at = body.parent;
        }
        None
    }

    /// Whether a joint must not move, because it or a joint coupled to it is locked.
    pub(crate) fn is_locked(&self, joint: usize, locked: &BTreeSet<String>) -> bool {
        let Some(name) = self.table.joints.get(joint).map(|j| &j.name) else { return false };
        locked.contains(name)
            || self.table.followers().any(|c| {
                c.members.iter().any(|m| &m.joint == name)
                    && c.members.iter().any(|m| locked.contains(&m.joint))
            })
    }

    /// The values that follow if a joint has this one: its own, and those of the joints coupled to
    /// it.
    pub(crate) fn bound(&self, joint: usize, value: f64) -> Vec<(usize, f64)> {
        let Some(fact) = self.table.joints.get(joint) else { return Vec::new() };
        let mut values = vec![(joint, value)];
        for coupling in self.table.followers() {
            let Some(own) = coupling.members.iter().find(|m| m.joint == fact.name) else {
                continue;
            };
            let shared = (value - own.offset) / own.coef;
            let of = |m: &robert_clip::CouplingMember| {
                Some((self.joint(&m.joint)?, robert_clip::round(m.coef * shared + m.offset)))
            };
            values.extend(coupling.members.iter().filter_map(of));
        }
        values
    }

    /// The pose of a command at a frame, in state order; masks are bridged by straight lines.
    pub(crate) fn pose_at(&self, command: &Command, frame: u32) -> Option<Vec<f64>> {
        let row = command.interpolated(frame.min(command.frames().saturating_sub(1)));
        let value = |name: &String| {
            let at = command.joints().iter().position(|n| n == name)?;
            row.get(at).map(|v| f64::from(*v))
        };
        self.table.joints.iter().map(|j| value(&j.name)).collect()
    }
}
