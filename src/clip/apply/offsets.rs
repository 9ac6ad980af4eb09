//! Edits of offsets.

use std::collections::BTreeMap;

use super::edit::{Edit, distinct, refuse};
use super::error::{Done, OpError, argument};
use crate::compile::compile_for;
use crate::document::{Clip, Key};
use crate::grid::round;
use crate::offset::{FADE_FRAMES, Offset, total};
use crate::op::{OffsetsMove, OffsetsSet};

impl Edit<'_> {
    pub(super) fn offsets_set(&mut self, a: &OffsetsSet) -> Done {
        for joint in a.add.keys() {
            self.joint(joint)?;
        }
        let offsets = &mut self.clip.offsets;
        let old = offsets.iter().position(|o| o.frame == a.frame).map(|i| offsets.remove(i));
        if old.is_none() && a.add.values().all(Option::is_none) {
            return argument(format!(
                "there is no offset at frame {}; a new one needs `add`",
                a.frame
            ));
        }
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
        let clip = &*self.clip;
        let (added, dim) = (total(&baked, &clip.robot.joints, clip.length), clip.dim());
        let chosen = changed(clip, &baked);
        self.dense(&command, command.tracks(), chosen, |frame, joint, own| match own {
            // A goal is rounded to single precision; what leads to it and away is not.
            Some(value) => value + added[frame as usize * dim + joint],
            None => f64::from(command.row(frame)[joint]),
        })
    }
}

/// Whether these offsets change each key, or what it commands up to the next key.
fn changed(clip: &Clip, offsets: &[Offset]) -> Vec<bool> {
    // The postures that end-effector goals are solved near depend on all keys.
    if clip.keys.iter().any(|k| !k.reach.is_empty()) {
        return vec![true; clip.keys.len()];
    }
    let next = |i: usize| clip.keys.get(i + 1).map_or(clip.length, |k| k.frame);
    // What leads to the next key changes with the next key.
    let last = |i: usize| next(i) + u32::from(i + 1 < clip.keys.len());
    let meets = |(i, key): (usize, &Key)| {
        let mut spans = offsets.iter().map(|o| o.span(clip.length));
        spans.any(|s| s.start < last(i) && s.end > key.frame)
    };
    clip.keys.iter().enumerate().map(meets).collect()
}
