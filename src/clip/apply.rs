//! Applies an [`Op`], completely or not at all.
//!
//! The edit is made on a copy, the copy is checked as a whole, and then it replaces the clip.
//! Copying a clip of 2 000 keys takes well under a millisecond. In return no operation needs its
//! own roll-back, and the result is always valid.

use std::collections::{BTreeMap, BTreeSet};

use super::command::Command;
use super::compile::compile_for;
use super::delta::Delta;
use super::document::{Clip, Fill, Goal, Key, Marker, Mask, Row};
use super::grid::round;
use super::joints::JointTable;
use super::json::show;
use super::op::{
    Batch, ClipLength, FillSet, KeysMove, KeysPaste, KeysScale, KeysSet, KeysSparsify, MaskSet, Op,
    PoseApply, TangentSet, TimeDelete, TimeInsert,
};
use super::sparsify::superfluous;
use super::validate::{Invalid, hint};
use robert_base::exit::{Exit, HasExit};
use robert_base::limits;

/// Why an edit was refused; the clip is unchanged.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum OpError {
    /// No key at this frame.
    #[error("there is no key at frame {frame}")]
    NoKey {
        /// The frame.
        frame: u32,
    },
    /// No marker at this frame.
    #[error("there is no marker at frame {frame}")]
    NoMarker {
        /// The frame.
        frame: u32,
    },
    /// No pose of this name.
    #[error("there is no pose \"{}\"{hint}", show(.name))]
    NoPose {
        /// The name.
        name: String,
        /// A hint with the nearest name.
        hint: String,
    },
    /// A pose of this name exists.
    #[error("there is already a pose \"{}\"", show(.name))]
    PoseTaken {
        /// The name.
        name: String,
    },
    /// No joint of this name.
    #[error("there is no joint \"{}\"{hint}", show(.name))]
    NoJoint {
        /// The name.
        name: String,
        /// A hint with the nearest name.
        hint: String,
    },
    /// Keys would overwrite others.
    #[error(
        "{count} of the keys would overwrite another key (first at frame {frame}); move or delete that key first"
    )]
    Occupied {
        /// The number that was asked for.
        count: usize,
        /// The first such frame.
        frame: u32,
    },
    /// Keys or markers are beyond a new end.
    #[error("{count} keys and markers are beyond frame {length}; move or delete them first")]
    Beyond {
        /// The number that was asked for.
        count: usize,
        /// The new length.
        length: u32,
    },
    /// A key would leave the clip.
    #[error("a key would be at frame {frame}, outside the clip of {length} frames")]
    Outside {
        /// The frame.
        frame: i64,
        /// The clip's length.
        length: u32,
    },
    /// The robot has no mirror image.
    #[error("cannot mirror: {reason}")]
    Mirror {
        /// Why.
        reason: String,
    },
    /// An argument makes no sense.
    #[error("{what}")]
    Argument {
        /// The name of the value, and why it was refused.
        what: String,
    },
    /// The clip would break a rule.
    #[error(transparent)]
    Invalid(#[from] Invalid),
    /// One edit of a batch was refused.
    #[error("edit {index} ({name}): {source}")]
    InBatch {
        /// The index of the operation, from 0.
        index: usize,
        /// Its operation.
        name: &'static str,
        /// Why.
        source: Box<OpError>,
    },
}

impl HasExit for OpError {
    fn exit(&self) -> Exit {
        Exit::Invalid
    }
}

type Done = Result<(), OpError>;

fn argument<T>(what: impl Into<String>) -> Result<T, OpError> {
    Err(OpError::Argument { what: what.into() })
}

/// Applies one edit and returns the edit that undoes it. Mirroring needs the robot.
///
/// # Errors
/// [`OpError`]; the clip is then untouched.
pub fn apply(clip: &mut Clip, op: &Op, table: Option<&JointTable>) -> Result<Op, OpError> {
    let next = edited(clip, op, table)?;
    let back = Delta::between(&next, clip);
    *clip = next;
    Ok(Op::Patch(Box::new(back)))
}

/// The clip after one edit.
///
/// # Errors
/// [`OpError`].
pub fn edited(clip: &Clip, op: &Op, table: Option<&JointTable>) -> Result<Clip, OpError> {
    let mut next = clip.clone();
    next.normalize();
    let mut edit = Edit { clip: &mut next, table, depth: 0, ops: 0 };
    edit.op(op)?;
    next.normalize();
    next.validate()?;
    Ok(next)
}

struct Edit<'a> {
    clip: &'a mut Clip,
    table: Option<&'a JointTable>,
    depth: usize,
    ops: usize,
}

impl Edit<'_> {
    fn op(&mut self, op: &Op) -> Done {
        match op {
            Op::KeysAdd(a) => self.place(a.keys.clone(), a.replace),
            Op::KeysSet(a) => self.keys_set(a),
            Op::KeysMove(a) => self.keys_move(a),
            Op::KeysScale(a) => self.keys_scale(a),
            Op::KeysDelete(a) => self.take(&a.frames).map(drop),
            Op::KeysPaste(a) => self.keys_paste(a),
            Op::KeysMirror(a) => {
                let mut keys = self.take(&a.frames)?;
                self.mirror(&mut keys)?;
                self.place(keys, false)
            }
            Op::KeysHold(a) => self.each_key(&a.frames, |k| k.hold = a.hold),
            Op::KeysBake(a) => self.keys_bake(&a.frames),
            Op::KeysSparsify(a) => self.keys_sparsify(a),
            Op::MaskSet(a) => self.mask_set(a),
            Op::FillSet(a) => self.fill_set(a),
            Op::TangentSet(a) => self.tangent_set(a),
            Op::TimeInsert(a) => self.time_insert(a),
            Op::TimeDelete(a) => self.time_delete(a),
            Op::PoseSave(a) => {
                if !a.replace && self.clip.poses.contains_key(&a.name) {
                    return Err(OpError::PoseTaken { name: a.name.clone() });
                }
                self.clip.poses.insert(a.name.clone(), a.q.clone());
                Ok(())
            }
            Op::PoseApply(a) => self.pose_apply(a),
            Op::PoseRename(a) => self.pose_rename(&a.name, &a.to),
            Op::PoseDelete(a) => self.pose_delete(&a.name),
            Op::MarkersAdd(a) => {
                self.clip.markers.push(a.clone());
                Ok(())
            }
            Op::MarkersSet(a) => self.marker(a.frame).map(|m| m.name.clone_from(&a.name)),
            Op::MarkersMove(a) => self.marker(a.frame).map(|m| m.frame = a.to),
            Op::MarkersDelete(a) => {
                let gone = distinct(&a.frames)?;
                for &frame in &gone {
                    self.marker(frame)?;
                }
                self.clip.markers.retain(|m| !gone.contains(&m.frame));
                Ok(())
            }
            Op::ClipRename(a) => {
                self.clip.name.clone_from(&a.name);
                Ok(())
            }
            Op::ClipNotes(a) => {
                self.clip.notes.clone_from(&a.notes);
                Ok(())
            }
            Op::ClipLength(a) => self.clip_length(a),
            Op::ClipStart(a) => {
                self.clip.start.clone_from(&a.start);
                Ok(())
            }
            Op::Batch(a) => self.batch(a),
            Op::Patch(delta) => {
                delta.put(self.clip);
                Ok(())
            }
        }
    }

    fn batch(&mut self, batch: &Batch) -> Done {
        self.depth += 1;
        if self.depth > limits::JSON_DEPTH {
            return argument("batches are nested too deep");
        }
        for (index, op) in batch.ops.iter().enumerate() {
            self.ops += 1;
            if self.ops > limits::BATCH_OPS {
                return argument(format!("a batch of more than {} edits", limits::BATCH_OPS));
            }
            // The clip is also checked between edits, because the next edit relies on its rules
            // (rows as long as the joint list, sorted keys).
            let done = self.op(op).and_then(|()| {
                self.clip.normalize();
                Ok(self.clip.validate()?)
            });
            done.map_err(|e| OpError::InBatch { index, name: op.name(), source: Box::new(e) })?;
        }
        self.depth -= 1;
        Ok(())
    }

    /// Removes the keys at these frames and returns them.
    fn take(&mut self, frames: &[u32]) -> Result<Vec<Key>, OpError> {
        let chosen = distinct(frames)?;
        for &frame in &chosen {
            self.has_key(frame)?;
        }
        let all = std::mem::take(&mut self.clip.keys);
        let (taken, rest) = all.into_iter().partition(|k| chosen.contains(&k.frame));
        self.clip.keys = rest;
        Ok(taken)
    }

    fn has_key(&self, frame: u32) -> Done {
        if self.clip.key_index(frame).is_none() {
            return Err(OpError::NoKey { frame });
        }
        Ok(())
    }

    /// Adds keys. An existing key is replaced, or the edit is refused.
    fn place(&mut self, mut keys: Vec<Key>, replace: bool) -> Done {
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

    fn each_key(&mut self, frames: &[u32], change: impl Fn(&mut Key)) -> Done {
        for frame in distinct(frames)? {
            let index = self.clip.key_index(frame).ok_or(OpError::NoKey { frame })?;
            if let Some(key) = self.clip.keys.get_mut(index) {
                change(key);
            }
        }
        Ok(())
    }

    fn row_of(&self, key: &Key) -> Row {
        self.clip.row(key).cloned().unwrap_or_else(|| vec![None; self.clip.dim()])
    }

    fn keys_set(&mut self, a: &KeysSet) -> Done {
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
            let mut row = self.row_of(&key);
            for (joint, value) in &a.values {
                let at = self.joint(joint)?;
                if let Some(slot) = row.get_mut(at) {
                    *slot = *value;
                }
            }
            key.goal = Goal::Q(row);
        }
        key.hold = a.hold.unwrap_or(key.hold);
        key.fill = a.fill.unwrap_or(key.fill);
        if let Some(note) = &a.note {
            key.note.clone_from(note);
        }
        self.place(vec![key], true)
    }

    fn command(&self) -> Result<Command, OpError> {
        Ok(compile_for(self.clip, self.table)?)
    }

    /// The commanded row at a frame, for all joints.
    fn commanded(&self, command: &Command, frame: u32) -> Row {
        let last = self.clip.length.saturating_sub(1);
        let row = command.interpolated(frame.min(last));
        row.iter().map(|v| Some(round(f64::from(*v)))).collect()
    }

    fn keys_bake(&mut self, frames: &[u32]) -> Done {
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

    /// The values that a key is compiled to, whatever masks hide of it.
    fn solved(&self, command: &Command, frame: u32) -> Row {
        let row = self.clip.key_index(frame).and_then(|i| command.key_row(i)).cloned();
        row.unwrap_or_else(|| self.commanded(command, frame))
    }

    fn joint(&self, name: &str) -> Result<usize, OpError> {
        self.clip.joint(name).ok_or_else(|| {
            let hint = hint(name, self.clip.robot.joints.iter().map(String::as_str));
            OpError::NoJoint { name: name.to_owned(), hint }
        })
    }

    fn keys_move(&mut self, a: &KeysMove) -> Done {
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
        self.place(keys, a.replace)
    }

    fn shifted(&self, frame: i64) -> Result<u32, OpError> {
        let length = self.clip.length;
        u32::try_from(frame).ok().filter(|f| *f < length).ok_or(OpError::Outside { frame, length })
    }

    fn keys_scale(&mut self, a: &KeysScale) -> Done {
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
            // The last frame of a hold scales like any other.
            let hold = 1.0 + (f64::from(key.hold.saturating_sub(1)) * a.factor).round();
            key.hold = hold.clamp(1.0, f64::from(limits::CLIP_FRAMES)) as u32;
            // The curve keeps its shape: slopes are changes per second.
            for tangent in key.tangents.values_mut() {
                *tangent = tangent.map(|slope| slope / a.factor);
            }
        }
        self.place(keys, a.replace)
    }

    fn keys_paste(&mut self, a: &KeysPaste) -> Done {
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
        self.place(keys, a.replace)
    }

    /// Gives all other joints the value that they have at each of these frames: that of the key
    /// there, else the interpolated command.
    fn keep_others(&self, keys: &mut [Key], names: &[String]) -> Done {
        let chosen = names.iter().map(|n| self.joint(n)).collect::<Result<BTreeSet<_>, _>>()?;
        let command = self.command()?;
        for key in keys {
            if !key.reach.is_empty() {
                return argument(
                    "end-effector goals decide over all joints; make them joint values first (keys.bake)",
                );
            }
            let there: Row = match self.clip.key(key.frame) {
                Some(old) if old.reach.is_empty() => self.row_of(old),
                _ => self.commanded(&command, key.frame),
            };
            let mut row = self.row_of(key);
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

    fn mirror(&self, keys: &mut [Key]) -> Done {
        for key in keys {
            if !key.reach.is_empty() {
                let reason =
                    "end-effector goals have no mirror image; make them joint values first";
                return Err(OpError::Mirror { reason: reason.to_owned() });
            }
            let row = self.mirrored(&self.row_of(key))?;
            key.goal = Goal::Q(row);
            if let Some(table) = self.table {
                key.tangents = table.mirrored_tangents(&key.tangents);
            }
        }
        Ok(())
    }

    fn mirrored(&self, row: &Row) -> Result<Row, OpError> {
        let Some(table) = self.table else {
            return Err(OpError::Mirror { reason: "the robot is unknown here".into() });
        };
        table.mirrored(&self.clip.robot.joints, row).map_err(|reason| OpError::Mirror { reason })
    }

    fn fill_set(&mut self, a: &FillSet) -> Done {
        match &a.frames {
            None => {
                self.clip.fill = a.fill.unwrap_or(Fill::Mask);
                Ok(())
            }
            Some(frames) => self.each_key(frames, |k| k.fill = a.fill),
        }
    }

    fn tangent_set(&mut self, a: &TangentSet) -> Done {
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

    fn keys_sparsify(&mut self, a: &KeysSparsify) -> Done {
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
                "none of these {} keys can be removed: each is more than {} off the line between its neighbours, or holds more than values",
                chosen.len(),
                a.tolerance
            ));
        }
        self.clip.keys.retain(|k| !gone.contains(&k.frame));
        Ok(())
    }

    fn mask_set(&mut self, a: &MaskSet) -> Done {
        let (from, to) = (a.from, a.to);
        if from >= to || to > self.clip.length {
            let length = self.clip.length;
            return argument(format!(
                "the span {from}..{to} must be increasing and inside 0..{length}"
            ));
        }
        let chosen: Option<BTreeSet<usize>> = match &a.joints {
            None => None,
            Some(names) => Some(names.iter().map(|n| self.joint(n)).collect::<Result<_, _>>()?),
        };
        let all = self.clip.dim();
        let chosen = chosen.filter(|set| set.len() < all);
        if chosen.as_ref().is_some_and(BTreeSet::is_empty) {
            return argument("an empty joint list masks nothing");
        }
        if a.masked {
            let joints = chosen.as_ref().map(|set| self.names(set));
            self.clip.masks.push(Mask { from, to, joints });
        } else {
            let old = std::mem::take(&mut self.clip.masks);
            for mask in old {
                self.cut_mask(mask, from, to, chosen.as_ref())?;
            }
        }
        merge_masks(&mut self.clip.masks);
        Ok(())
    }

    fn names(&self, set: &BTreeSet<usize>) -> Vec<String> {
        set.iter().filter_map(|&j| self.clip.robot.joints.get(j).cloned()).collect()
    }

    /// The part of a mask that remains: everything outside `from..to`, and inside it the other
    /// joints.
    fn cut_mask(
        &mut self,
        mask: Mask,
        from: u32,
        to: u32,
        chosen: Option<&BTreeSet<usize>>,
    ) -> Done {
        if mask.to <= from || mask.from >= to {
            self.clip.masks.push(mask);
            return Ok(());
        }
        let (inner_from, inner_to) = (mask.from.max(from), mask.to.min(to));
        if let Some(chosen) = chosen {
            let mut left: BTreeSet<usize> = match &mask.joints {
                None => (0..self.clip.dim()).collect(),
                Some(names) => names.iter().map(|n| self.joint(n)).collect::<Result<_, _>>()?,
            };
            left.retain(|j| !chosen.contains(j));
            if !left.is_empty() {
                let joints = Some(self.names(&left));
                self.clip.masks.push(Mask { from: inner_from, to: inner_to, joints });
            }
        }
        for (a, b) in [(mask.from, inner_from), (inner_to, mask.to)] {
            if a < b {
                self.clip.masks.push(Mask { from: a, to: b, joints: mask.joints.clone() });
            }
        }
        Ok(())
    }

    fn time_insert(&mut self, a: &TimeInsert) -> Done {
        let TimeInsert { at, frames } = *a;
        let clip = &mut *self.clip;
        let length = u64::from(clip.length) + u64::from(frames);
        if frames == 0 || at > clip.length || length > u64::from(limits::CLIP_FRAMES) {
            return argument(format!(
                "cannot insert {frames} frames at {at} into {} (at most {} in total)",
                clip.length,
                limits::CLIP_FRAMES
            ));
        }
        let ends: Vec<u32> = (0..clip.keys.len()).map(|i| clip.hold_end(i)).collect();
        for (key, end) in clip.keys.iter_mut().zip(ends) {
            if key.frame >= at {
                key.frame += frames;
            } else if end > at {
                key.hold = end - key.frame + frames;
            } else {
                // A hold that the next key cuts short must not grow into the new frames.
                key.hold = key.hold.min(end - key.frame);
            }
        }
        let move_mark = |f: u32| if f >= at { f + frames } else { f };
        for mask in &mut clip.masks {
            mask.from = move_mark(mask.from);
            mask.to = if mask.to > at { mask.to + frames } else { mask.to };
        }
        for marker in &mut clip.markers {
            marker.frame = move_mark(marker.frame);
        }
        clip.length += frames;
        Ok(())
    }

    fn time_delete(&mut self, a: &TimeDelete) -> Done {
        let TimeDelete { from, to } = *a;
        let clip = &mut *self.clip;
        if from >= to || to > clip.length || to - from >= clip.length {
            let length = clip.length;
            return argument(format!("cannot delete frames {from}..{to} of a clip of {length}"));
        }
        let ends: Vec<u32> = (0..clip.keys.len()).map(|i| clip.hold_end(i)).collect();
        for (key, end) in clip.keys.iter_mut().zip(ends) {
            if key.frame < from {
                let lost = end.min(to).saturating_sub(from);
                key.hold = (end - key.frame - lost).max(1);
            }
        }
        let gone = |f: u32| (from..to).contains(&f);
        let moved = |f: u32| if f >= to { f - (to - from) } else { f.min(from) };
        clip.keys.retain(|k| !gone(k.frame));
        for key in &mut clip.keys {
            key.frame = moved(key.frame);
        }
        for mask in &mut clip.masks {
            (mask.from, mask.to) = (moved(mask.from), moved(mask.to));
        }
        clip.masks.retain(|m| m.from < m.to);
        merge_masks(&mut clip.masks);
        clip.markers.retain(|m| !gone(m.frame));
        for marker in &mut clip.markers {
            marker.frame = moved(marker.frame);
        }
        clip.length -= to - from;
        Ok(())
    }

    fn pose(&self, name: &str) -> Result<&Row, OpError> {
        self.clip.poses.get(name).ok_or_else(|| {
            let hint = hint(name, self.clip.poses.keys().map(String::as_str));
            OpError::NoPose { name: name.to_owned(), hint }
        })
    }

    fn pose_apply(&mut self, a: &PoseApply) -> Done {
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
                    (Some(key), _) => self.row_of(key),
                    (None, Some(c)) => {
                        c.interpolated(frame).iter().map(|v| Some(f64::from(*v))).collect()
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

    fn pose_rename(&mut self, name: &str, to: &str) -> Done {
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
        if let Some(super::Start::Pose(start)) = &mut self.clip.start
            && start == name
        {
            to.clone_into(start);
        }
        Ok(())
    }

    fn pose_delete(&mut self, name: &str) -> Done {
        let row = self.pose(name)?.clone();
        self.clip.poses.remove(name);
        for key in &mut self.clip.keys {
            if key.goal == Goal::Pose(name.to_owned()) {
                key.goal = Goal::Q(row.clone());
            }
        }
        if self.clip.start == Some(super::Start::Pose(name.to_owned())) {
            let q = row.into_iter().map(Option::unwrap_or_default).collect();
            self.clip.start = Some(super::Start::Q(q));
        }
        Ok(())
    }

    fn marker(&mut self, frame: u32) -> Result<&mut Marker, OpError> {
        let found = self.clip.markers.iter_mut().find(|m| m.frame == frame);
        found.ok_or(OpError::NoMarker { frame })
    }

    fn clip_length(&mut self, a: &ClipLength) -> Done {
        let length = a.length;
        let clip = &mut *self.clip;
        let count = clip.keys.iter().filter(|k| k.frame >= length).count()
            + clip.markers.iter().filter(|m| m.frame >= length).count();
        if count > 0 && !a.cut {
            return Err(OpError::Beyond { count, length });
        }
        clip.keys.retain(|k| k.frame < length);
        clip.markers.retain(|m| m.frame < length);
        for mask in &mut clip.masks {
            mask.to = mask.to.min(length);
        }
        clip.masks.retain(|m| m.from < m.to);
        clip.length = length;
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

fn refuse(taken: &[u32]) -> Done {
    match taken.first() {
        None => Ok(()),
        Some(&frame) => Err(OpError::Occupied { count: taken.len(), frame }),
    }
}

fn distinct(frames: &[u32]) -> Result<BTreeSet<u32>, OpError> {
    if frames.is_empty() {
        return argument("no frames are given");
    }
    Ok(frames.iter().copied().collect())
}

/// Joins spans of the same joints that touch or overlap.
fn merge_masks(masks: &mut Vec<Mask>) {
    let mut by_joints: BTreeMap<Option<Vec<String>>, Vec<(u32, u32)>> = BTreeMap::new();
    for mask in masks.drain(..) {
        by_joints.entry(mask.joints).or_default().push((mask.from, mask.to));
    }
    for (joints, mut spans) in by_joints {
        spans.sort_unstable();
        let mut joined: Vec<(u32, u32)> = Vec::new();
        for (from, to) in spans {
            match joined.last_mut() {
                Some(last) if from <= last.1 => last.1 = last.1.max(to),
                _ => joined.push((from, to)),
            }
        }
        let joints = &joints;
        masks.extend(joined.into_iter().map(|(from, to)| Mask {
            from,
            to,
            joints: joints.clone(),
        }));
    }
    masks.sort();
}
