//! A key at every frame in the place of sparse ones.

use super::edit::Edit;
use super::error::{Done, argument};
use crate::command::Command;
use crate::document::{Clip, Fill, Goal, Key, Row};
use crate::grid::round;
use crate::tracks::Tracks;
use robert_base::limits;

impl Edit<'_> {
    /// Replaces some keys, and what is commanded from each up to the next key, by a key at every frame. `command`
    /// is that of the clip without masks, `tracks` are those of its keys, and `chosen` says which keys; keys that
    /// hang together with them are replaced, too. `value` gets a frame, a joint, and its value in the key at this
    /// frame; it returns what is commanded there. The command stays as it was if `value` says what it is.
    pub(super) fn dense(
        &mut self,
        command: &Command,
        tracks: &Tracks,
        chosen: Vec<bool>,
        value: impl Fn(u32, usize, Option<f64>) -> f64,
    ) -> Done {
        let clip = &mut *self.clip;
        let row = |frame: u32, own: Option<&Row>| -> Row {
            let own = |j: usize| own.and_then(|row| row[j]);
            let goal = |j| command.sees(frame, j).then(|| round(value(frame, j, own(j))));
            (0..clip.dim()).map(goal).collect()
        };
        let mut keys: Vec<Key> = Vec::new();
        // The joints with a goal in the frame before, if that one is dense.
        let mut before: Row = Vec::new();
        for (i, is_chosen) in tied(clip, tracks, chosen).into_iter().enumerate() {
            let (key, fill) = (&clip.keys[i], clip.fill_after(&clip.keys[i]));
            let next = clip.keys.get(i + 1).map_or(clip.length, |k| k.frame);
            for frame in key.frame..if is_chosen { next } else { key.frame + 1 } {
                let own = clip.row(key).filter(|_| frame == key.frame && key.reach.is_empty());
                let now = row(frame, own);
                // Without a goal there, a joint of the frame before is open from here on.
                let ends = |(a, b): (&Option<f64>, &Option<f64>)| a.is_some() && b.is_none();
                if let Some(last) = keys.last_mut().filter(|_| before.iter().zip(&now).any(ends)) {
                    last.fill = Some(Fill::Mask);
                }
                match keys.last_mut() {
                    _ if !is_chosen => {}
                    _ if now.iter().all(Option::is_none) => {}
                    Some(last)
                        if last.frame >= key.frame
                            && last.frame + last.hold == frame
                            && last.goal == Goal::Q(now.clone()) =>
                    {
                        last.hold += 1;
                    }
                    _ => keys.push(Key::with(frame, Goal::Q(now.clone())).filled(fill)),
                }
                before = now;
            }
            if !is_chosen {
                keys.push(key.clone());
                before.clear();
            } else if let Some(first) = keys.iter_mut().rev().find(|k| k.frame == key.frame) {
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

/// The chosen keys and those that hang together with them: a key within what another one commands for some joint,
/// and two that end and begin a curve of some joint, because its slope depends on both sides.
fn tied(clip: &Clip, tracks: &Tracks, mut chosen: Vec<bool>) -> Vec<bool> {
    let keys = &clip.keys;
    // Whether each key hangs together with the one before it.
    let mut tied = vec![false; keys.len()];
    for (i, key) in keys.iter().enumerate() {
        let fill = clip.fill_after(key);
        for j in (0..clip.dim()).filter(|j| tracks.has(i, *j)) {
            let end = match fill {
                Fill::Mask => tracks.hold_end(clip, i, j),
                _ => tracks.until(clip, i, j),
            };
            let inside = keys[i + 1..].iter().take_while(|k| k.frame < end).count();
            tied[i + 1..=i + inside].fill(true);
            let curve = |b: usize| clip.fill_after(&keys[b]) == Fill::Cubic;
            tied[i] |= fill == Fill::Cubic && tracks.before(i, j).is_some_and(curve);
        }
    }
    for i in 1..chosen.len() {
        chosen[i] |= chosen[i - 1] && tied[i];
    }
    for i in (1..chosen.len()).rev() {
        chosen[i - 1] |= chosen[i] && tied[i];
    }
    chosen
}
