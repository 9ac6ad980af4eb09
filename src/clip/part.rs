//! A part of a motion that can be put into a clip, once or often.

use serde::{Deserialize, Serialize};

use super::document::{Clip, Fill, Goal, Key, Marker, Mask, Row};
use super::offset::Offset;

/// Keys, offsets, masks and markers of some frames, counted from 0. Poses are written out, and each
/// key says what follows it, so that a part means the same in every clip.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Part {
    /// Joint names; rows follow this order.
    pub joints: Vec<String>,
    /// Frames.
    pub length: u32,
    /// Keys.
    pub keys: Vec<Key>,
    /// Offsets.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub offsets: Vec<Offset>,
    /// Mask spans.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub masks: Vec<Mask>,
    /// Markers.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub markers: Vec<Marker>,
}

impl Part {
    /// All of a clip, without its name, notes and start.
    pub fn of(clip: &Clip) -> Part {
        Part::between(clip, 0, clip.length)
    }

    /// The frames `from..to` of a clip whose keys are in order.
    pub fn between(clip: &Clip, from: u32, to: u32) -> Part {
        let inside = |frame: u32| (from..to).contains(&frame);
        let mut keys: Vec<Key> = Vec::new();
        for (i, key) in clip.keys.iter().enumerate().filter(|(_, k)| inside(k.frame)) {
            let goal = match (&key.goal, clip.row(key)) {
                (Goal::Pose(_), Some(row)) => Goal::Q(row.clone()),
                (goal, _) => goal.clone(),
            };
            let fill = clip.fill_after(key);
            let last = clip.keys.get(i + 1).is_none();
            // After the last key of a clip a fill keeps its value, which other keys would take from it.
            let end = if last && fill != Fill::Mask { to } else { clip.hold_end(i).min(to) };
            let (frame, hold) = (key.frame - from, (end - key.frame).max(1));
            keys.push(Key { frame, goal, hold, fill: Some(fill), ..key.clone() });
        }
        if clip.keys.last().is_some_and(|k| inside(k.frame)) {
            keep_to_the_end(&mut keys, &clip.robot.joints, to - from);
        }
        let offsets = clip.offsets.iter().filter(|o| inside(o.frame));
        let masks = clip.masks.iter().filter(|m| m.from < to && m.to > from);
        let markers = clip.markers.iter().filter(|m| inside(m.frame));
        Part {
            joints: clip.robot.joints.clone(),
            length: to - from,
            keys,
            offsets: offsets.map(|o| Offset { frame: o.frame - from, ..o.clone() }).collect(),
            masks: masks
                .map(|m| Mask {
                    from: m.from.max(from) - from,
                    to: m.to.min(to) - from,
                    joints: m.joints.clone(),
                })
                .collect(),
            markers: markers
                .map(|m| Marker {
                    frame: m.frame - from,
                    to: m.to.map(|end| end.min(to) - from),
                    name: m.name.clone(),
                })
                .collect(),
        }
    }

    /// The same part with its rows in the order of these joints.
    ///
    /// # Errors
    /// A name that only one of the two has.
    pub(super) fn ordered(&self, joints: &[String]) -> Result<Part, String> {
        let odd = self.joints.iter().find(|j| !joints.contains(j));
        let odd = odd.or_else(|| joints.iter().find(|j| !self.joints.contains(j)));
        if let Some(name) = odd {
            return Err(name.clone());
        }
        let mut part = self.clone();
        let from: Vec<usize> =
            joints.iter().filter_map(|j| self.joints.iter().position(|own| own == j)).collect();
        for key in &mut part.keys {
            if let Goal::Q(row) = &mut key.goal {
                *row = from.iter().map(|&j| row.get(j).copied().flatten()).collect::<Row>();
            }
        }
        part.joints = joints.to_vec();
        Ok(part)
    }

    /// Whether all of it lies within its frames.
    pub(super) fn is_within_its_length(&self) -> bool {
        let inside = |frame: u32| frame < self.length;
        self.keys.iter().all(|k| inside(k.frame))
            && self.offsets.iter().all(|o| inside(o.frame))
            && self.masks.iter().all(|m| m.from <= m.to && m.to <= self.length)
            && self
                .markers
                .iter()
                .all(|m| inside(m.frame) && m.to.is_none_or(|to| to <= self.length))
    }

    /// Puts the part into a clip at frame `at`. The frames from there on must be free for it.
    pub(super) fn lay(self, clip: &mut Clip, at: u32) {
        let fill = clip.fill;
        clip.keys.extend(self.keys.into_iter().map(|k| Key {
            frame: k.frame + at,
            fill: k.fill.filter(|own| *own != fill),
            ..k
        }));
        clip.offsets.extend(self.offsets.into_iter().map(|o| Offset { frame: o.frame + at, ..o }));
        clip.masks.extend(self.masks.into_iter().map(|m| Mask {
            from: m.from + at,
            to: m.to + at,
            ..m
        }));
        clip.markers.extend(self.markers.into_iter().map(|m| Marker {
            frame: m.frame + at,
            to: m.to.map(|to| to + at),
            ..m
        }));
        clip.normalize();
    }
}

/// Keeps the values of joints whose last key is not the last key of the clip, if the fill after their own key keeps
/// them to the end: keys that come later would take them from it. `length` is in frames.
fn keep_to_the_end(keys: &mut Vec<Key>, joints: &[String], length: u32) {
    let Some((end, earlier)) = keys.split_last_mut().filter(|(end, _)| end.reach.is_empty()) else {
        return;
    };
    let Goal::Q(own) = &mut end.goal else { return };
    let (mut kept, mut fill): (Row, _) = (vec![None; joints.len()], None);
    for (j, name) in joints.iter().enumerate().filter(|(j, _)| own[*j].is_none()) {
        let value = |key: &Key| match &key.goal {
            Goal::Q(row) => row.get(j).copied().flatten(),
            _ => None,
        };
        let says = |k: &&mut Key| value(k).is_some() || !k.reach.is_empty();
        let Some(last) = earlier.iter_mut().rev().find(says) else { continue };
        if last.fill == Some(Fill::Mask) || !last.reach.is_empty() {
            continue;
        }
        (kept[j], fill) = (value(last), last.fill);
        // The joint rests from there on: a slope with which it leaves had no effect.
        last.tangents.entry(name.clone()).and_modify(|t| *t = t.into_rest());
    }
    if end.frame + end.hold >= length {
        own.iter_mut().zip(kept).for_each(|(slot, value)| *slot = slot.or(value));
    } else if fill.is_some() {
        keys.push(Key { fill, ..Key::with(length - 1, Goal::Q(kept)) });
    }
}
