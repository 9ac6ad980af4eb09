//! Edits of offsets.

use std::collections::BTreeMap;

use super::edit::{Edit, distinct, refuse};
use super::error::{Done, OpError, argument};
use crate::compile::compile_for;
use crate::document::{Clip, Fill, Goal, Key, Row};
use crate::grid::round;
use crate::offset::{FADE_FRAMES, Offset, total};
use crate::op::{OffsetsMove, OffsetsSet};
use robert_base::limits;

impl Edit<'_> {
    pub(super) fn offsets_set(&mut self, a: &OffsetsSet) -> Done {
        for joint in a.add.keys() {
            self.joint(joint)?;
        }
        let offsets = &mut self.clip.offsets;
        let old = offsets.iter().position(|o| o.frame == a.frame).map(|i| offsets.remove(i));
        let mut offset = old.unwrap_or_else(|| Offset {
            frame: a.frame,
            add: BTreeMap::new(),
            fade_in: FADE_FRAMES,
            hold: 1,
            fade_out: FADE_FRAMES,
        });
        for (joint, value) in &a.add {
            match value.map(round).filter(|v| *v != 0.0) {
                Some(value) => offset.add.insert(joint.clone(), value),
                None => offset.add.remove(joint),
            };
        }
        offset.fade_in = a.fade_in.unwrap_or(offset.fade_in);
        offset.fade_out = a.fade_out.unwrap_or(offset.fade_out);
        offset.hold = a.hold.unwrap_or(offset.hold);
        if !offset.add.is_empty() {
            offsets.push(offset);
        }
        Ok(())
    }

    pub(super) fn offsets_take(&mut self, frames: &[u32]) -> Result<Vec<Offset>, OpError> {
        let chosen = distinct(frames)?;
        let all = &mut self.clip.offsets;
        if let Some(&frame) = chosen.iter().find(|f| !all.iter().any(|o| o.frame == **f)) {
            return argument(format!("there is no offset at frame {frame}"));
        }
        Ok(all.extract_if(.., |o| chosen.contains(&o.frame)).collect())
    }

    pub(super) fn offsets_move(&mut self, a: &OffsetsMove) -> Done {
        let mut moved = self.offsets_take(&a.frames)?;
        if a.copy {
            self.clip.offsets.extend(moved.iter().cloned());
        }
        for offset in &mut moved {
            offset.frame = self.shifted(i64::from(offset.frame).saturating_add(a.df))?;
        }
        let taken = |o: &Offset| self.clip.offsets.iter().any(|other| other.frame == o.frame);
        refuse(&moved.iter().filter(|o| taken(o)).map(|o| o.frame).collect::<Vec<_>>())?;
        self.clip.offsets.extend(moved);
        Ok(())
    }

    /// Adds offsets to the keys: every frame that they change becomes a key. The command stays as it
    /// was, bit for bit.
    pub(super) fn offsets_bake(&mut self, frames: &[u32]) -> Done {
        let baked = self.offsets_take(frames)?;
        let bare = Clip { masks: Vec::new(), offsets: baked.clone(), ..self.clip.clone() };
        let command = compile_for(&bare, self.table)?;
        let clip = &mut *self.clip;
        let added = total(&baked, &clip.robot.joints, clip.length);
        let mut keys: Vec<Key> = Vec::new();
        for (i, is_baked) in changed(clip, &baked).into_iter().enumerate() {
            let (key, fill) = (&clip.keys[i], clip.fill_after(&clip.keys[i]));
            if !is_baked {
                keys.push(key.clone());
                continue;
            }
            let next = clip.keys.get(i + 1).map_or(clip.length, |k| k.frame);
            let end = if fill == Fill::Mask { clip.hold_end(i) } else { next };
            for frame in key.frame..end {
                let own = clip.row(key).filter(|_| frame == key.frame && key.reach.is_empty());
                let value = |j: usize| match own.and_then(|row| row[j]) {
                    // A goal is rounded to single precision; what leads to it and away is not.
                    Some(value) => value + added[frame as usize * clip.dim() + j],
                    None => f64::from(command.row(frame)[j]),
                };
                let sees = |j| command.sees(frame, j).then(|| round(value(j)));
                let row: Row = (0..clip.dim()).map(sees).collect();
                match keys.last_mut() {
                    // Two keys that share no joint have nothing between them.
                    Some(last) if row.iter().all(Option::is_none) => last.fill = Some(Fill::Mask),
                    Some(last) if last.frame >= key.frame && last.goal == Goal::Q(row.clone()) => {
                        last.hold += 1;
                    }
                    _ => keys.push(Key::with(frame, Goal::Q(row)).filled(fill)),
                }
            }
            if let Some(first) = keys.iter_mut().find(|k| k.frame == key.frame) {
                first.note.clone_from(&key.note);
                first.tangents.clone_from(&key.tangents);
            }
        }
        if keys.len() > limits::CLIP_KEYS {
            return argument(format!("this would be more than {} keys", limits::CLIP_KEYS));
        }
        let default = clip.fill;
        for key in &mut keys {
            key.fill = key.fill.filter(|own| *own != default);
        }
        clip.keys = keys;
        Ok(())
    }
}

/// Whether baking these offsets changes each key, or the fill that leads from it to the next key.
fn changed(clip: &Clip, offsets: &[Offset]) -> Vec<bool> {
    // The postures that end-effector goals are solved near depend on all keys.
    if clip.keys.iter().any(|k| !k.reach.is_empty()) {
        return vec![true; clip.keys.len()];
    }
    let next = |i: usize| clip.keys.get(i + 1).map_or(clip.length, |k| k.frame);
    // What leads to the next key changes with the next key.
    let last = |i: usize| next(i) + u32::from(i + 1 < clip.keys.len());
    let meets = |i: usize, key: &Key| {
        let mut spans = offsets.iter().map(|o| o.span(clip.length));
        spans.any(|s| s.start < last(i) && s.end > key.frame)
    };
    let mut changed: Vec<bool> =
        clip.keys.iter().enumerate().map(|(i, key)| meets(i, key)).collect();
    // The slope of a curve depends on the curves beside it.
    let cubic: Vec<bool> = clip.keys.iter().map(|k| clip.fill_after(k) == Fill::Cubic).collect();
    for i in 1..changed.len() {
        changed[i] |= changed[i - 1] && cubic[i] && cubic[i - 1];
    }
    for i in (1..changed.len()).rev() {
        changed[i - 1] |= changed[i] && cubic[i] && cubic[i - 1];
    }
    changed
}
