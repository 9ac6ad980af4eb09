//! A clip under an edit, and what the edits have in common.

use std::collections::BTreeSet;

use super::error::{Done, OpError, argument};
use crate::command::Command;
use crate::compile::compile_for;
use crate::document::{Clip, Goal, Key, Row};
use crate::flaw::hint;
use crate::grid::round;
use crate::joints::JointTable;

pub(super) struct Edit<'a> {
    pub(super) clip: &'a mut Clip,
    pub(super) table: Option<&'a JointTable>,
    pub(super) depth: usize,
    pub(super) ops: usize,
}

impl Edit<'_> {
    /// Removes the keys at these frames and returns them.
    pub(super) fn take(&mut self, frames: &[u32]) -> Result<Vec<Key>, OpError> {
        let chosen = distinct(frames)?;
        for &frame in &chosen {
            self.has_key(frame)?;
        }
        let all = std::mem::take(&mut self.clip.keys);
        let (taken, rest) = all.into_iter().partition(|k| chosen.contains(&k.frame));
        self.clip.keys = rest;
        Ok(taken)
    }

    pub(super) fn has_key(&self, frame: u32) -> Done {
        if self.clip.key_index(frame).is_none() {
            return Err(OpError::NoKey { frame });
        }
        Ok(())
    }

    /// Adds keys that come from elsewhere. Where there is a key already, the edit is refused; or the new key takes its
    /// place, and joints that the new one says nothing about keep their values.
    pub(super) fn land(&mut self, mut keys: Vec<Key>, replace: bool) -> Done {
        for key in keys.iter_mut().filter(|_| replace) {
            if let Some(old) = self.clip.key(key.frame) {
                self.merge(key, old)?;
            }
        }
        self.place(keys, replace)
    }

    /// Gives a key the values and slopes of another one for joints that it says nothing about; its hold and fill stay.
    fn merge(&self, key: &mut Key, old: &Key) -> Done {
        let (mut row, before) = (self.row_of(key)?, self.row_of(old)?);
        if !key.reach.is_empty() || !row.contains(&None) {
            return Ok(());
        }
        if !old.reach.is_empty() {
            return argument(format!(
                "the end-effector goals of the key at frame {} decide over all joints; make them joint values first (keys.bake)",
                old.frame
            ));
        }
        let mut merged = false;
        for ((slot, value), joint) in row.iter_mut().zip(before).zip(&self.clip.robot.joints) {
            if slot.is_some() || value.is_none() {
                continue;
            }
            (*slot, merged) = (value, true);
            if let Some(tangent) = old.tangents.get(joint) {
                key.tangents.insert(joint.clone(), *tangent);
            }
        }
        if merged {
            key.goal = Goal::Q(row);
        }
        Ok(())
    }

    /// Adds keys. An existing key is replaced, or the edit is refused.
    pub(super) fn place(&mut self, mut keys: Vec<Key>, replace: bool) -> Done {
        keys.sort_by_key(|k| k.frame);
        let frames: BTreeSet<u32> = keys.iter().map(|k| k.frame).collect();
        let twice = keys.windows(2).filter_map(|w| match w {
            [a, b] if a.frame == b.frame => Some(a.frame),
            _ => None,
        });
        // If two of the new keys are on one frame, no choice between them would be right.
        refuse(&twice.collect::<Vec<_>>())?;
        if !replace {
            let taken: Vec<u32> =
                frames.iter().copied().filter(|&f| self.clip.key(f).is_some()).collect();
            refuse(&taken)?;
        }
        self.clip.keys.retain(|k| !frames.contains(&k.frame));
        self.clip.keys.extend(keys);
        self.clip.keys.sort_by_key(|k| k.frame);
        Ok(())
    }

    pub(super) fn each_key(&mut self, frames: &[u32], change: impl Fn(&mut Key)) -> Done {
        for frame in distinct(frames)? {
            let index = self.clip.key_index(frame).ok_or(OpError::NoKey { frame })?;
            if let Some(key) = self.clip.keys.get_mut(index) {
                change(key);
            }
        }
        Ok(())
    }

    /// The values of a key; it may come from elsewhere.
    pub(super) fn row_of(&self, key: &Key) -> Result<Row, OpError> {
        let row = match &key.goal {
            Goal::Pose(name) => self.pose(name)?,
            Goal::Q(row) => row,
            Goal::Open => return Ok(vec![None; self.clip.dim()]),
        };
        if row.len() != self.clip.dim() {
            let (has, joints) = (row.len(), self.clip.dim());
            return argument(format!("a key has {has} values, and the clip {joints} joints"));
        }
        Ok(row.clone())
    }

    pub(super) fn command(&self) -> Result<Command, OpError> {
        Ok(compile_for(self.clip, self.table)?)
    }

    /// What is commanded at a frame, for all joints.
    pub(super) fn commanded(&self, command: &Command, frame: u32) -> Row {
        let last = self.clip.length.saturating_sub(1);
        let row = command.interpolated(frame.min(last));
        row.iter().map(|v| Some(round(f64::from(*v)))).collect()
    }

    pub(super) fn joint(&self, name: &str) -> Result<usize, OpError> {
        self.clip.joint(name).ok_or_else(|| {
            let hint = hint(name, self.clip.robot.joints.iter().map(String::as_str));
            OpError::NoJoint { name: name.to_owned(), hint }
        })
    }

    pub(super) fn names(&self, set: &BTreeSet<usize>) -> Vec<String> {
        set.iter().filter_map(|&j| self.clip.robot.joints.get(j).cloned()).collect()
    }

    pub(super) fn shifted(&self, frame: i64) -> Result<u32, OpError> {
        let length = self.clip.length;
        u32::try_from(frame).ok().filter(|f| *f < length).ok_or(OpError::Outside { frame, length })
    }

    pub(super) fn mirrored(&self, row: &Row) -> Result<Row, OpError> {
        let Some(table) = self.table else {
            return Err(OpError::Mirror { reason: "the robot is unknown here".into() });
        };
        table.mirrored(&self.clip.robot.joints, row).map_err(|reason| OpError::Mirror { reason })
    }
}

pub(super) fn refuse(taken: &[u32]) -> Done {
    match taken.first() {
        None => Ok(()),
        Some(&frame) => Err(OpError::Occupied { count: taken.len(), frame }),
    }
}

pub(super) fn distinct(frames: &[u32]) -> Result<BTreeSet<u32>, OpError> {
    if frames.is_empty() {
        return argument("no frames are given");
    }
    Ok(frames.iter().copied().collect())
}
