//! Edits of keys, their fills and their tangents.

use std::collections::BTreeSet;

use super::edit::{Edit, distinct};
use super::error::{Done, OpError, argument};
use crate::command::Command;
use crate::document::{Fill, Goal, Key, Row};
use crate::op::{FillSet, KeysMove, KeysPaste, KeysScale, KeysSet, KeysSparsify, TangentSet};
use crate::sparsify::superfluous;
use robert_base::limits;

impl Edit<'_> {
    pub(super) fn keys_set(&mut self, a: &KeysSet) -> Done {
        let mut key = self.clip.key(a.frame).cloned().ok_or(OpError::NoKey { frame: a.frame })?;
        match (&a.q, &a.pose) {
            (Some(_), Some(_)) => return argument("a key needs either `pose` or `q`, not both"),
            (Some(q), None) => key.goal = Goal::Q(q.clone()),
            (None, Some(pose)) => key.goal = Goal::Pose(pose.clone()),
            (None, None) => {}
        }
        if let Some(reach) = &a.reach {
            key.reach.clone_from(reach);
            // A key must say something: without its end-effector goals, what they led to.
            if reach.is_empty() && key.goal == Goal::Open {
                key.goal = Goal::Q(self.commanded(&self.command()?, a.frame));
            }
        }
        if !a.values.is_empty() {
            let mut row = self.row_of(&key)?;
            for (joint, value) in &a.values {
                let at = self.joint(joint)?;
                if let Some(slot) = row.get_mut(at) {
                    *slot = *value;
                }
            }
            // Without a value of its own, a key may still have end-effector goals.
            let says_nothing = !key.reach.is_empty() && row.iter().all(Option::is_none);
            key.goal = if says_nothing { Goal::Open } else { Goal::Q(row) };
        }
        key.hold = a.hold.unwrap_or(key.hold);
        key.fill = a.fill.unwrap_or(key.fill);
        if let Some(note) = &a.note {
            key.note.clone_from(note);
        }
        self.place(vec![key], true)
    }

    pub(super) fn keys_bake(&mut self, frames: &[u32]) -> Done {
        let command = self.command()?;
        let goals: Vec<(u32, Row)> =
            frames.iter().map(|&frame| (frame, self.solved(&command, frame))).collect();
        self.each_key(frames, |key| {
            if !key.reach.is_empty()
                && let Some((_, row)) = goals.iter().find(|g| g.0 == key.frame)
            {
                key.goal = Goal::Q(row.clone());
                key.reach.clear();
            }
        })
    }

    /// The joint values of a key after end-effector goals are solved, whether or not a mask hides
    /// them.
    pub(super) fn solved(&self, command: &Command, frame: u32) -> Row {
        let row = self.clip.key_index(frame).and_then(|i| command.key_row(i)).cloned();
        row.unwrap_or_else(|| self.commanded(command, frame))
    }

    pub(super) fn keys_move(&mut self, a: &KeysMove) -> Done {
        let mut chosen = distinct(&a.frames)?;
        if a.ripple && a.copy {
            return argument("ripple does not work with a copy; insert time first");
        }
        for &frame in &chosen {
            self.has_key(frame)?;
        }
        if a.ripple
            && let Some(&first) = chosen.first()
        {
            chosen = self.clip.keys.iter().map(|k| k.frame).filter(|&f| f >= first).collect();
        }
        let frames: Vec<u32> = chosen.into_iter().collect();
        let mut keys: Vec<Key> = if a.copy {
            frames.iter().filter_map(|&f| self.clip.key(f).cloned()).collect()
        } else {
            self.take(&frames)?
        };
        let last = keys.last().map_or(0, |k| i64::from(k.frame).saturating_add(a.df));
        if a.ripple && last >= i64::from(self.clip.length) {
            if last >= i64::from(limits::CLIP_FRAMES) {
                return Err(OpError::Outside { frame: last, length: limits::CLIP_FRAMES });
            }
            self.clip.length = last as u32 + 1;
        }
        for key in &mut keys {
            key.frame = self.shifted(i64::from(key.frame).saturating_add(a.df))?;
        }
        self.land(keys, a.replace)
    }

    pub(super) fn keys_scale(&mut self, a: &KeysScale) -> Done {
        if !(a.factor.is_finite() && a.factor > 0.0 && a.factor <= 1e6) {
            return argument(format!(
                "the factor must be above 0 and at most 1e6, not {}",
                a.factor
            ));
        }
        let mut keys = self.take(&a.frames)?;
        for key in &mut keys {
            let distance = f64::from(key.frame) - f64::from(a.pivot);
            key.frame = self.shifted((f64::from(a.pivot) + distance * a.factor).round() as i64)?;
            // A hold scales with its end, so that what was in proportion stays so.
            let end = f64::from(a.pivot) + (distance + f64::from(key.hold)) * a.factor;
            let hold = end.round() - f64::from(key.frame);
            key.hold = if key.hold > 1 {
                hold.clamp(1.0, f64::from(limits::CLIP_FRAMES)) as u32
            } else {
                1
            };
            // The curve keeps its shape: slopes are changes per second.
            for tangent in key.tangents.values_mut() {
                *tangent = tangent.map(|slope| slope / a.factor);
            }
        }
        self.land(keys, a.replace)
    }

    pub(super) fn keys_paste(&mut self, a: &KeysPaste) -> Done {
        let mut keys = a.keys.clone();
        let Some(first) = keys.iter().map(|k| k.frame).min() else {
            return argument("there is nothing to paste");
        };
        for key in &mut keys {
            key.frame = self.shifted(i64::from(a.at) + i64::from(key.frame - first))?;
        }
        if a.mirrored {
            self.mirror(&mut keys)?;
        }
        if let Some(names) = &a.joints {
            self.keep_others(&mut keys, names)?;
        }
        self.land(keys, a.replace)
    }

    /// Gives all other joints the value of the key that is at each of these frames. Without one they have none, so
    /// their holds and fills go on.
    pub(super) fn keep_others(&self, keys: &mut [Key], names: &[String]) -> Done {
        let chosen = names.iter().map(|n| self.joint(n)).collect::<Result<BTreeSet<_>, _>>()?;
        for key in keys {
            if !key.reach.is_empty() {
                return argument(
                    "end-effector goals decide over all joints; make them joint values first (keys.bake)",
                );
            }
            let there: Row = match self.clip.key(key.frame) {
                Some(old) if old.reach.is_empty() => self.row_of(old)?,
                Some(_) => self.commanded(&self.command()?, key.frame),
                None => vec![None; self.clip.dim()],
            };
            let mut row = self.row_of(key)?;
            for (j, (slot, old)) in row.iter_mut().zip(there).enumerate() {
                if !chosen.contains(&j) {
                    *slot = old;
                }
            }
            key.goal = Goal::Q(row);
            let there = self.clip.key(key.frame).map(|old| old.tangents.clone());
            let is_chosen = |joint: &String| names.contains(joint);
            key.tangents.retain(|joint, _| is_chosen(joint));
            key.tangents.extend(there.into_iter().flatten().filter(|(joint, _)| !is_chosen(joint)));
        }
        Ok(())
    }

    pub(super) fn mirror(&self, keys: &mut [Key]) -> Done {
        for key in keys {
            if !key.reach.is_empty() {
                let reason =
                    "end-effector goals have no mirror image; make them joint values first";
                return Err(OpError::Mirror { reason: reason.to_owned() });
            }
            let row = self.mirrored(&self.row_of(key)?)?;
            key.goal = Goal::Q(row);
            if let Some(table) = self.table {
                key.tangents = table.mirrored_tangents(&key.tangents);
            }
        }
        Ok(())
    }

    pub(super) fn fill_set(&mut self, a: &FillSet) -> Done {
        match &a.frames {
            None => {
                self.clip.fill = a.fill.unwrap_or(Fill::Mask);
                Ok(())
            }
            Some(frames) => self.each_key(frames, |k| k.fill = a.fill),
        }
    }

    pub(super) fn tangent_set(&mut self, a: &TangentSet) -> Done {
        let names = match &a.joints {
            Some(names) => names.clone(),
            None => self.clip.robot.joints.clone(),
        };
        for name in &names {
            self.joint(name)?;
        }
        self.each_key(&a.frames, |key| {
            for name in &names {
                match a.tangent {
                    Some(tangent) => key.tangents.insert(name.clone(), tangent),
                    None => key.tangents.remove(name),
                };
            }
        })
    }

    pub(super) fn keys_sparsify(&mut self, a: &KeysSparsify) -> Done {
        if !(a.tolerance.is_finite() && a.tolerance >= 0.0) {
            return argument(format!("the tolerance must be 0 or more, not {}", a.tolerance));
        }
        let chosen = distinct(&a.frames)?;
        for &frame in &chosen {
            self.has_key(frame)?;
        }
        let gone = superfluous(self.clip, &chosen, a.tolerance);
        if gone.is_empty() {
            return argument(format!(
                "none of these {} keys can be removed: each is farther off the line between its neighbours than the tolerance, or holds more than values",
                chosen.len(),
            ));
        }
        self.clip.keys.retain(|k| !gone.contains(&k.frame));
        Ok(())
    }
}
