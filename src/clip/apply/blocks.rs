//! Edits of blocks: motions that follow each other in one clip.
//!
//! A block is a marker with an end; its motion consists of ordinary keys. Rejected: a sequence that
//! names other files. It breaks when one of them is moved or changed, and no other tool could read
//! it.

use std::collections::BTreeMap;

use super::edit::Edit;
use super::error::{Done, OpError, argument};
use crate::command::Command;
use crate::compile::compile_for;
use crate::document::{Clip, Fill, Goal, Key, Marker, Row};
use crate::grid::round;
use crate::json::show;
use crate::op::{BlocksDelete, BlocksInsert, BlocksOrder, BlocksRepeat, TimeDelete, TimeInsert};
use crate::part::Part;
use crate::tangent::Tangent;
use robert_base::limits;
use robert_base::units::CTRL_DT;

/// Below this speed a joint rests, rad/s or m/s.
const REST: f64 = 1e-3;

impl Edit<'_> {
    pub(super) fn blocks_insert(&mut self, a: &BlocksInsert) -> Done {
        if a.part.length == 0 || a.at > self.clip.length {
            return argument("a block has at least one frame and begins inside the clip");
        }
        if !a.part.is_within_its_length() {
            return argument(
                "a key, a mask, an offset or a marker of the block lies beyond its end",
            );
        }
        let wide = a.part.joints.len();
        let odd = |key: &&Key| matches!(&key.goal, Goal::Q(row) if row.len() != wide);
        if let Some(key) = a.part.keys.iter().find(odd) {
            let frame = key.frame;
            return argument(format!(
                "the block's key at frame {frame} does not have a value for each of its {wide} joints"
            ));
        }
        let part = a.part.ordered(&self.clip.robot.joints).or_else(|name| {
            argument(format!("only one of the two motions has a joint \"{}\"", show(&name)))
        })?;
        let around = |m: &&Marker| m.frame < a.at && m.to.is_some_and(|to| a.at < to);
        let at = self.clip.markers.iter().find(around).and_then(|m| m.to).unwrap_or(a.at);
        let is_last = at == self.clip.length;
        let has_before = self.clip.keys.iter().any(|k| k.frame < at);
        let has_after = self.clip.keys.iter().any(|k| k.frame >= at) || !is_last;
        let lead = if has_before { a.blend } else { 0 };
        let trail = if has_after { a.blend } else { 0 };
        self.split(at)?;
        // Saturating: a part that is too long makes the clip too long, which is refused.
        let frames = part.length.saturating_add(lead).saturating_add(trail);
        self.time_insert(&TimeInsert { at, frames })?;
        let (from, length) = (at + lead, part.length);
        part.lay(self.clip, from);
        let marker = Marker { frame: from, to: Some(from + length), name: a.name.clone() };
        self.clip.markers.retain(|m| m.frame != from);
        self.clip.markers.push(marker);
        self.clip.normalize();
        self.clip.validate()?;
        self.blend_at(from, lead)?;
        self.blend_at(from + length + trail, trail)
    }

    /// Makes a key on both sides of `at` for the joints that are commanded there, so that nothing leads from one
    /// side to the other.
    fn split(&mut self, at: u32) -> Done {
        let Some(before) = at.checked_sub(1) else { return Ok(()) };
        let bare = Clip { offsets: Vec::new(), masks: Vec::new(), ..self.clip.clone() };
        let command = compile_for(&bare, self.table)?;
        let (clip, tracks) = (&*self.clip, command.tracks());
        let Some(i) = clip.keys.partition_point(|k| k.frame <= before).checked_sub(1) else {
            return Ok(());
        };
        let sees = |frame: u32, j: usize| frame < clip.length && command.sees(frame, j);
        let held = |j: usize| tracks.has(i, j) && tracks.hold_end(clip, i, j) > before;
        let is_held = (0..clip.dim()).all(|j| held(j) || !sees(before, j));
        // How each joint goes on that passes `at`: its fill, and what is left of its hold.
        let here = clip.key_index(at);
        let passes = |j: &usize| {
            sees(before, *j) && sees(at, *j) && !here.is_some_and(|k| tracks.has(k, *j))
        };
        let way = |j: usize| {
            let k = tracks.last(i, j)?;
            let rest = clip.full_hold(k).saturating_sub(at).max(1);
            Some((clip.fill_after(&clip.keys[k]), rest))
        };
        let mut ways = (0..clip.dim()).filter(passes).filter_map(way);
        let first = ways.next();
        // One key cannot say that joints are held and filled in different ways.
        let is_mixed = first.is_some() && (here.is_some() || ways.any(|way| Some(way) != first));
        let fill = clip.fill_after(&clip.keys[i]);
        let mut keys = Vec::new();
        if !is_held {
            // A joint that is open at `at` is not led there: its hold or fill ends before.
            let goes_on = |j: usize| {
                let keeps = || way(j).is_some_and(|(fill, _)| fill != Fill::Mask);
                sees(at, j) || (at >= clip.length && keeps())
            };
            keys.extend(self.key_of(&command, before, fill, before.checked_sub(1), goes_on));
        }
        let (fill, hold) = if is_mixed { (Fill::Hold, 1) } else { first.unwrap_or((fill, 1)) };
        let key = self.key_of(&command, at, fill, Some(at + 1).filter(|_| hold == 1), |_| true);
        keys.extend(key.map(|key| if here.is_none() { key.held(hold) } else { key }));
        // A joint that rests after its last key gets another one: a slope with which it leaves had no effect.
        let resting = (0..clip.dim()).filter(|j| sees(before, *j) && tracks.next(i, *j).is_none());
        let resting: Vec<(usize, String)> = resting
            .filter_map(|j| Some((tracks.last(i, j)?, clip.robot.joints[j].clone())))
            .collect();
        for (k, joint) in resting {
            self.clip.keys[k].tangents.entry(joint).and_modify(|t| *t = t.into_rest());
        }
        self.place(keys, true)?;
        if is_mixed {
            // With this fill all keys that its joints pass hang together with it.
            self.clip
                .keys
                .iter_mut()
                .filter(|k| k.frame == at)
                .for_each(|k| k.fill = Some(Fill::Hold));
            let bare = Clip { offsets: Vec::new(), masks: Vec::new(), ..self.clip.clone() };
            let tracks = compile_for(&bare, self.table)?.tracks().clone();
            let chosen = self.clip.keys.iter().map(|k| k.frame == at).collect();
            self.dense(&command, &tracks, chosen, |frame, joint, own| {
                own.unwrap_or_else(|| f64::from(command.row(frame)[joint]))
            })?;
        }
        Ok(())
    }

    /// The key at a frame with the values of the `wanted` joints that are commanded there, with this fill if it is
    /// new; none if there is nothing to add.
    fn key_of(
        &self,
        command: &Command,
        frame: u32,
        fill: Fill,
        beside: Option<u32>,
        wanted: impl Fn(usize) -> bool,
    ) -> Option<Key> {
        if frame >= self.clip.length {
            return None;
        }
        let old = self.clip.key(frame);
        let own = old.and_then(|key| self.clip.row(key));
        let value = |j: usize| {
            let is_seen = command.sees(frame, j) && wanted(j);
            let seen = || is_seen.then(|| round(f64::from(command.row(frame)[j])));
            own.and_then(|row| row[j]).or_else(seen)
        };
        let row: Row = (0..self.clip.dim()).map(value).collect();
        // End-effector goals decide over the joints.
        if old.is_some_and(|key| !key.reach.is_empty())
            || own == Some(&row)
            || row.iter().all(Option::is_none)
        {
            return None;
        }
        let mut key = old.cloned().unwrap_or_else(|| Key::with(frame, Goal::Open).filled(fill));
        key.goal = Goal::Q(row);
        if fill == Fill::Cubic {
            let mut slopes = self.slopes(command, frame, beside);
            slopes.extend(std::mem::take(&mut key.tangents));
            key.tangents = slopes;
        }
        Some(key)
    }

    /// Makes a smooth curve over the `blend` frames before `to`. It leads from the last key before
    /// those frames to the first key at `to` or later of each joint, and keeps the speed of the motion at both
    /// ends. A joint without a value in that last key stays as it was.
    fn blend_at(&mut self, to: u32, blend: u32) -> Done {
        let next = self.clip.keys.partition_point(|k| k.frame < to);
        let (Some(i), true) = (next.checked_sub(1), blend > 0 && next < self.clip.keys.len())
        else {
            return Ok(());
        };
        let command = self.command()?;
        let (clip, tracks) = (&*self.clip, command.tracks());
        let mut leaving = BTreeMap::new();
        let mut arriving: BTreeMap<usize, BTreeMap<String, Tangent>> = BTreeMap::new();
        for (j, name) in clip.robot.joints.iter().enumerate().filter(|(j, _)| tracks.has(i, *j)) {
            let Some(n) = tracks.next(i, j) else { continue };
            let (last, first) = (tracks.hold_end(clip, i, j) - 1, clip.keys[n].frame);
            // What is held rests.
            let is_held = |k: usize| tracks.hold_end(clip, k, j) > clip.keys[k].frame + 1;
            let before = last.checked_sub(1).filter(|_| !is_held(i));
            let after = Some(first + 1).filter(|_| !is_held(n));
            leaving.insert(name.clone(), slope(&command, j, last, before));
            let there = arriving.entry(n).or_default();
            there.insert(name.clone(), slope(&command, j, first, after));
        }
        self.clip.keys[i].fill = Some(Fill::Cubic);
        self.clip.keys[i].tangents.extend(leaving);
        for (n, slopes) in arriving {
            self.clip.keys[n].tangents.extend(slopes);
        }
        Ok(())
    }

    /// The slopes of the joints that have a goal at this frame, as [`slope`] measures them.
    fn slopes(
        &self,
        command: &Command,
        frame: u32,
        beside: Option<u32>,
    ) -> BTreeMap<String, Tangent> {
        let joints = self.clip.robot.joints.iter().enumerate();
        let seen = joints.filter(|(j, _)| command.sees(frame, *j));
        seen.map(|(j, name)| (name.clone(), slope(command, j, frame, beside))).collect()
    }

    /// All blocks in order; they do not overlap.
    fn blocks(&self) -> Result<Vec<(u32, u32)>, OpError> {
        let blocks: Vec<(u32, u32)> =
            self.clip.markers.iter().filter_map(|m| m.to.map(|to| (m.frame, to))).collect();
        match blocks.windows(2).find(|pair| pair[0].1 > pair[1].0) {
            Some(pair) => argument(format!(
                "the block at frame {} begins inside the one at frame {}",
                pair[1].0, pair[0].0
            )),
            None => Ok(blocks),
        }
    }

    fn block(&self, frame: u32) -> Result<(u32, u32), OpError> {
        match self.blocks()?.into_iter().find(|b| b.0 == frame) {
            Some(block) => Ok(block),
            None => argument(format!("no block begins at frame {frame}")),
        }
    }

    pub(super) fn blocks_repeat(&mut self, a: &BlocksRepeat) -> Done {
        let (from, to) = self.block(a.frame)?;
        let mut part = Part::between(self.clip, from, to);
        let own = part.markers.iter().position(|m| m.frame == 0).map(|i| part.markers.remove(i));
        let name = own.map(|m| m.name).unwrap_or_default();
        self.blocks_insert(&BlocksInsert { at: to, name, part, blend: a.blend })
    }

    /// Removes a block with its time, and the blend that leads to it.
    pub(super) fn blocks_delete(&mut self, a: &BlocksDelete) -> Done {
        let (from, to) = self.block(a.frame)?;
        let before = self.clip.keys.partition_point(|k| k.frame < from);
        let held = (0..before).map(|i| self.clip.hold_end(i)).max();
        let begin = held.map_or(from, |end| end.min(from));
        self.time_delete(&TimeDelete { from: begin, to })
    }

    /// Changes the order of blocks. Frames between blocks stay where they are.
    pub(super) fn blocks_order(&mut self, a: &BlocksOrder) -> Done {
        let blocks = self.blocks()?;
        let mut sorted = a.frames.clone();
        sorted.sort_unstable();
        if !sorted.iter().eq(blocks.iter().map(|b| &b.0)) {
            return argument("the new order must name the first frame of every block once");
        }
        let (Some(&(begin, _)), Some(&(_, end))) = (blocks.first(), blocks.last()) else {
            return argument("there are no blocks");
        };
        let clip = &mut *self.clip;
        let parts: Vec<Part> =
            blocks.iter().map(|&(from, to)| Part::between(clip, from, to)).collect();
        let gaps: Vec<Part> =
            blocks.windows(2).map(|pair| Part::between(clip, pair[0].1, pair[1].0)).collect();
        // How one leads to the next belongs to the place.
        let fills: Vec<Option<Fill>> =
            parts.iter().map(|p| p.keys.last().and_then(|k| k.fill)).collect();
        let inside = |frame: u32| (begin..end).contains(&frame);
        clip.keys.retain(|k| !inside(k.frame));
        clip.offsets.retain(|o| !inside(o.frame));
        clip.markers.retain(|m| !inside(m.frame));
        let masks = std::mem::take(&mut clip.masks);
        for mask in masks {
            for (from, to) in [(mask.from, mask.to.min(begin)), (mask.from.max(end), mask.to)] {
                if from < to {
                    clip.masks.push(crate::document::Mask {
                        from,
                        to,
                        joints: mask.joints.clone(),
                    });
                }
            }
        }
        let mut at = begin;
        let mut gaps = gaps.into_iter();
        for (frame, fill) in a.frames.iter().zip(fills) {
            let Some(i) = blocks.iter().position(|b| b.0 == *frame) else { continue };
            let mut part = parts[i].clone();
            if let (Some(last), Some(fill)) = (part.keys.last_mut(), fill) {
                last.fill = Some(fill);
            }
            for piece in [Some(part), gaps.next()].into_iter().flatten() {
                let length = piece.length;
                piece.lay(clip, at);
                at += length;
            }
        }
        super::masks::merge_masks(&mut clip.masks);
        Ok(())
    }
}

/// The speed of a joint at this frame, measured from a neighbouring frame; 0 if there is none.
fn slope(command: &Command, joint: usize, frame: u32, beside: Option<u32>) -> Tangent {
    let other = beside.filter(|o| command.sees(frame, joint) && command.sees(*o, joint));
    let Some(other) = other else { return Tangent::FLAT };
    let step = f64::from(command.row(frame)[joint]) - f64::from(command.row(other)[joint]);
    let speed = step / (f64::from(frame) - f64::from(other)) / CTRL_DT;
    let most = limits::CLIP_VALUE_MAX;
    if speed.abs() > REST { Tangent::Slope(round(speed.clamp(-most, most))) } else { Tangent::FLAT }
}
