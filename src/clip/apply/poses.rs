//! Edits of named poses.

use std::collections::BTreeSet;

use super::edit::{Edit, distinct};
use super::error::{Done, OpError, argument};
use crate::document::{Goal, Key, Row, Start};
use crate::flaw::hint;
use crate::op::PoseApply;

impl Edit<'_> {
    pub(super) fn pose(&self, name: &str) -> Result<&Row, OpError> {
        self.clip.poses.get(name).ok_or_else(|| {
            let hint = hint(name, self.clip.poses.keys().map(String::as_str));
            OpError::NoPose { name: name.to_owned(), hint }
        })
    }

    pub(super) fn pose_apply(&mut self, a: &PoseApply) -> Done {
        if !(0.0..=1.0).contains(&a.blend) {
            return argument(format!("the blend must be 0 to 1, not {}", a.blend));
        }
        let mut pose = self.pose(&a.name)?.clone();
        if a.mirrored {
            pose = self.mirrored(&pose)?;
        }
        if let Some(names) = &a.joints {
            let chosen = names.iter().map(|n| self.joint(n)).collect::<Result<BTreeSet<_>, _>>()?;
            for (j, slot) in pose.iter_mut().enumerate() {
                if !chosen.contains(&j) {
                    *slot = None;
                }
            }
        }
        let whole = a.blend == 1.0 && !a.mirrored && a.joints.is_none();
        let frames = distinct(&a.frames)?;
        let bare = frames.iter().any(|&f| self.clip.key(f).is_none());
        let command = if bare && !whole { Some(self.command()?) } else { None };
        let mut keys = Vec::new();
        for frame in frames {
            let old = self.clip.key(frame).cloned();
            let goal = if whole {
                Goal::Pose(a.name.clone())
            } else {
                let there: Row = match (&old, &command) {
                    (Some(key), _) => self.row_of(key)?,
                    // Other joints have no value, so their holds and fills go on.
                    (None, Some(c)) => {
                        let there = c.interpolated(frame).into_iter().zip(&pose);
                        there.map(|(v, p)| p.map(|_| f64::from(v))).collect()
                    }
                    (None, None) => vec![None; self.clip.dim()],
                };
                Goal::Q(there.iter().zip(&pose).map(|(o, p)| mixed(*o, *p, a.blend)).collect())
            };
            keys.push(match old {
                Some(key) => Key { goal, ..key },
                None => Key::with(frame, goal),
            });
        }
        self.place(keys, true)
    }

    pub(super) fn pose_rename(&mut self, name: &str, to: &str) -> Done {
        let row = self.pose(name)?.clone();
        if self.clip.poses.contains_key(to) {
            return Err(OpError::PoseTaken { name: to.to_owned() });
        }
        self.clip.poses.remove(name);
        self.clip.poses.insert(to.to_owned(), row);
        for key in &mut self.clip.keys {
            if key.goal == Goal::Pose(name.to_owned()) {
                key.goal = Goal::Pose(to.to_owned());
            }
        }
        if let Some(Start::Pose(start)) = &mut self.clip.start
            && start == name
        {
            to.clone_into(start);
        }
        Ok(())
    }

    pub(super) fn pose_delete(&mut self, name: &str) -> Done {
        let row = self.pose(name)?.clone();
        self.clip.poses.remove(name);
        for key in &mut self.clip.keys {
            if key.goal == Goal::Pose(name.to_owned()) {
                key.goal = Goal::Q(row.clone());
            }
        }
        if self.clip.start == Some(Start::Pose(name.to_owned())) {
            let q = row.into_iter().map(Option::unwrap_or_default).collect();
            self.clip.start = Some(Start::Q(q));
        }
        Ok(())
    }
}

fn mixed(old: Option<f64>, pose: Option<f64>, blend: f64) -> Option<f64> {
    match (old, pose) {
        (Some(o), Some(p)) => Some(o + blend * (p - o)),
        (None, p) => p,
        (o, None) => o,
    }
}
