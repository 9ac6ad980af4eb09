//! Edits of time: insert frames, remove frames, change the length.

use super::edit::Edit;
use super::error::{Done, OpError, argument};
use super::masks::merge_masks;
use crate::document::{Clip, Goal, Key, Row};
use crate::op::{ClipLength, TimeDelete, TimeInsert};
use crate::tracks::Tracks;
use robert_base::limits;

impl Edit<'_> {
    pub(super) fn time_insert(&mut self, a: &TimeInsert) -> Done {
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
        end_holds(clip, at, |joint, key| joint == at && key > at);
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
            marker.to = marker.to.map(|to| if to > at { to + frames } else { to });
            marker.frame = move_mark(marker.frame);
        }
        for offset in &mut clip.offsets {
            offset.frame = move_mark(offset.frame);
        }
        clip.length += frames;
        Ok(())
    }

    pub(super) fn time_delete(&mut self, a: &TimeDelete) -> Done {
        let TimeDelete { from, to } = *a;
        let clip = &mut *self.clip;
        if from >= to || to > clip.length || to - from >= clip.length {
            let length = clip.length;
            return argument(format!("cannot delete frames {from}..{to} of a clip of {length}"));
        }
        end_holds(clip, from, |joint, key| (from..to).contains(&joint) && key > to);
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
            marker.to = marker.to.map(moved);
            marker.frame = moved(marker.frame);
        }
        clip.offsets.retain(|o| !gone(o.frame));
        for offset in &mut clip.offsets {
            offset.frame = moved(offset.frame);
        }
        clip.length -= to - from;
        Ok(())
    }

    pub(super) fn clip_length(&mut self, a: &ClipLength) -> Done {
        let length = a.length;
        let clip = &mut *self.clip;
        let count = clip.keys.iter().filter(|k| k.frame >= length).count()
            + clip.offsets.iter().filter(|o| o.frame >= length).count()
            + clip.markers.iter().filter(|m| m.frame >= length).count();
        if count > 0 && !a.cut {
            return Err(OpError::Beyond { count, length });
        }
        clip.keys.retain(|k| k.frame < length);
        clip.offsets.retain(|o| o.frame < length);
        clip.markers.retain(|m| m.frame < length);
        for marker in &mut clip.markers {
            marker.to = marker.to.map(|to| to.min(length));
        }
        for mask in &mut clip.masks {
            mask.to = mask.to.min(length);
        }
        clip.masks.retain(|m| m.from < m.to);
        clip.length = length;
        Ok(())
    }
}

/// Ends holds of single joints at frame `at` that a later key ends now, although the hold of the same key goes on for
/// other joints: a key of one frame before `at` repeats their values. `ends` gets the frames at which the hold of the
/// joint and that of the key end. A key of one frame there for others takes the values, too, if it has the same fill.
fn end_holds(clip: &mut Clip, at: u32, ends: impl Fn(u32, u32) -> bool) {
    let Some(before) = at.checked_sub(1) else { return };
    let long = |i: usize| clip.keys[i].frame < before && clip.hold_end(i) > at;
    if !(0..clip.keys.partition_point(|k| k.frame < before)).any(long) {
        return;
    }
    let tracks = Tracks::of(clip.keys.len(), clip.dim(), |i, j| clip.gives(&clip.keys[i], j));
    for i in (0..clip.keys.len()).filter(|i| long(*i)).collect::<Vec<_>>() {
        let (key, end) = (&clip.keys[i], clip.hold_end(i));
        let own = clip.row(key).filter(|_| key.reach.is_empty());
        let value = |j: usize| {
            let ended = tracks.has(i, j) && ends(tracks.hold_end(clip, i, j), end);
            own.filter(|_| ended).and_then(|row| row[j])
        };
        let row: Row = (0..clip.dim()).map(value).collect();
        if row.iter().all(Option::is_none) {
            continue;
        }
        let fill = clip.fill_after(key);
        let default = clip.fill;
        let there = clip.keys.iter_mut().find(|k| k.frame == before);
        match there.map(|k| (k.fill.unwrap_or(default) == fill && k.hold == 1, &mut k.goal)) {
            Some((true, Goal::Q(old))) => {
                old.iter_mut().zip(row).for_each(|(slot, new)| *slot = slot.or(new));
            }
            // Nothing else can be said at one frame: the hold goes on for all joints.
            Some(_) => {}
            None => {
                let own = (fill != default).then_some(fill);
                clip.keys.push(Key { fill: own, ..Key::with(before, Goal::Q(row)) });
                clip.keys.sort_by_key(|k| k.frame);
                return end_holds(clip, at, ends);
            }
        }
    }
}
