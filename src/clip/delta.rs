//! The difference between two versions of a clip. It is the inverse of any edit, and the patch that
//! other tabs receive.
//!
//! There is one generic inverse instead of one per operation. The inverse of `time.delete` or of a
//! replacing paste is not an operation that a person would use, and a computed difference cannot
//! forget a field.

use std::collections::BTreeSet;

use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Map, Value};

use super::document::{Clip, Fill, Goal, Key, Marker, Mask, RobotRef, Row, Start};
use super::offset::Offset;

/// A difference. Empty parts did not change.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[derive(schemars::JsonSchema)]
pub struct Delta {
    /// Frames whose key is removed.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub keys_removed: Vec<u32>,
    /// Keys that are added or changed.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub keys_put: Vec<Key>,
    /// Poses that are removed.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub poses_removed: Vec<String>,
    /// Poses that are added or changed.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub poses_put: Vec<(String, Row)>,
    /// All offsets.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub offsets: Option<Vec<Offset>>,
    /// All mask spans.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub masks: Option<Vec<Mask>>,
    /// All markers.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub markers: Option<Vec<Marker>>,
    /// Title.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Remarks.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub notes: Option<String>,
    /// Length.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub length: Option<u32>,
    /// Default fill.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fill: Option<Fill>,
    #[allow(clippy::option_option)]
    /// Start; null removes it.
    #[serde(skip_serializing_if = "Option::is_none", deserialize_with = "present")]
    #[schemars(extend("x-null" = true))]
    pub start: Option<Option<Start>>,
}

#[allow(clippy::option_option)] // absent, null and a value are three things in a patch
fn present<'de, D: Deserializer<'de>>(d: D) -> Result<Option<Option<Start>>, D::Error> {
    Option::<Start>::deserialize(d).map(Some)
}

/// Up to this many keys are inserted one by one; more are inserted in one pass over the clip.
const FEW: usize = 8;

fn changed<T: Clone + PartialEq>(old: &T, new: &T) -> Option<T> {
    (old != new).then(|| new.clone())
}

/// The old value, if it is replaced.
fn replaced<T: Clone + PartialEq>(old: &T, new: Option<&T>) -> Option<T> {
    new.filter(|new| *new != old).map(|_| old.clone())
}

impl Delta {
    /// The difference that turns `old` into `new`. Robot and extensions are never edited and not
    /// compared.
    pub fn between(old: &Clip, new: &Clip) -> Delta {
        let mut delta = Delta {
            offsets: changed(&old.offsets, &new.offsets),
            masks: changed(&old.masks, &new.masks),
            markers: changed(&old.markers, &new.markers),
            name: changed(&old.name, &new.name),
            notes: changed(&old.notes, &new.notes),
            length: changed(&old.length, &new.length),
            fill: changed(&old.fill, &new.fill),
            start: changed(&old.start, &new.start),
            ..Delta::default()
        };
        for key in &old.keys {
            if new.key_index(key.frame).is_none() {
                delta.keys_removed.push(key.frame);
            }
        }
        for key in &new.keys {
            if old.key(key.frame) != Some(key) {
                delta.keys_put.push(key.clone());
            }
        }
        for name in old.poses.keys() {
            if !new.poses.contains_key(name) {
                delta.poses_removed.push(name.clone());
            }
        }
        for (name, row) in &new.poses {
            if old.poses.get(name) != Some(row) {
                delta.poses_put.push((name.clone(), row.clone()));
            }
        }
        delta
    }

    /// Whether nothing changed.
    pub fn is_empty(&self) -> bool {
        *self == Delta::default()
    }

    /// The inverse of the change, if `clip` is the clip before it.
    pub(super) fn inverse(&self, clip: &Clip) -> Delta {
        let mut back = Delta {
            offsets: replaced(&clip.offsets, self.offsets.as_ref()),
            masks: replaced(&clip.masks, self.masks.as_ref()),
            markers: replaced(&clip.markers, self.markers.as_ref()),
            name: replaced(&clip.name, self.name.as_ref()),
            notes: replaced(&clip.notes, self.notes.as_ref()),
            length: replaced(&clip.length, self.length.as_ref()),
            fill: replaced(&clip.fill, self.fill.as_ref()),
            start: replaced(&clip.start, self.start.as_ref()),
            ..Delta::default()
        };
        for key in &self.keys_put {
            match clip.key(key.frame) {
                None => back.keys_removed.push(key.frame),
                Some(old) if old != key => back.keys_put.push(old.clone()),
                Some(_) => {}
            }
        }
        let put: BTreeSet<u32> = self.keys_put.iter().map(|k| k.frame).collect();
        let removed = self.keys_removed.iter().filter(|f| !put.contains(f));
        back.keys_put.extend(removed.filter_map(|f| clip.key(*f).cloned()));
        back.keys_put.sort_by_key(|k| k.frame);
        for (name, row) in &self.poses_put {
            match clip.poses.get(name) {
                None => back.poses_removed.push(name.clone()),
                Some(old) if old != row => back.poses_put.push((name.clone(), old.clone())),
                Some(_) => {}
            }
        }
        let put: BTreeSet<&String> = self.poses_put.iter().map(|(name, _)| name).collect();
        let removed = self.poses_removed.iter().filter(|n| !put.contains(n));
        let old = |n: &String| Some((n.clone(), clip.poses.get(n)?.clone()));
        back.poses_put.extend(removed.filter_map(old));
        back
    }

    /// Its approximate size in bytes.
    pub(super) fn weight(&self) -> usize {
        let goal = |goal: &Goal| match goal {
            Goal::Pose(name) => name.len(),
            Goal::Q(row) => 16 * row.len(),
            Goal::Open => 0,
        };
        let keys = self.keys_put.iter().map(|k| {
            goal(&k.goal) + 64 * k.tangents.len() + 128 * k.reach.len() + k.note.len() + 48
        });
        let poses = self.poses_put.iter().map(|(name, row)| name.len() + 16 * row.len() + 48);
        let joints = |m: &Mask| m.joints.as_ref().map_or(0, Vec::len);
        let masks = self.masks.iter().flatten().map(|m| 64 + 32 * joints(m));
        let texts = [&self.name, &self.notes].into_iter().flatten().map(String::len);
        let removed = 8 * self.keys_removed.len() + 48 * self.poses_removed.len();
        let markers = 48 * self.markers.as_ref().map_or(0, Vec::len);
        let offsets = self.offsets.iter().flatten().map(|o| 64 + 64 * o.add.len());
        keys.chain(poses).chain(masks).chain(offsets).chain(texts).sum::<usize>()
            + removed
            + markers
            + 64
    }

    /// Applies the change. The keys of `clip` stay in order.
    pub(super) fn put(&self, clip: &mut Clip) {
        if self.keys_put.len() + self.keys_removed.len() <= FEW {
            for frame in &self.keys_removed {
                if let Some(at) = clip.key_index(*frame) {
                    clip.keys.remove(at);
                }
            }
            for key in &self.keys_put {
                match clip.keys.binary_search_by_key(&key.frame, |k| k.frame) {
                    Ok(at) => clip.keys.splice(at..=at, [key.clone()]).for_each(drop),
                    Err(at) => clip.keys.insert(at, key.clone()),
                }
            }
        } else {
            let put: BTreeSet<u32> = self
                .keys_put
                .iter()
                .map(|k| k.frame)
                .chain(self.keys_removed.iter().copied())
                .collect();
            clip.keys.retain(|k| !put.contains(&k.frame));
            clip.keys.extend(self.keys_put.iter().cloned());
            clip.keys.sort_by_key(|k| k.frame);
        }
        for name in &self.poses_removed {
            clip.poses.remove(name);
        }
        clip.poses.extend(self.poses_put.iter().cloned());
        let set = |slot: &mut String, value: &Option<String>| {
            if let Some(value) = value {
                slot.clone_from(value);
            }
        };
        set(&mut clip.name, &self.name);
        set(&mut clip.notes, &self.notes);
        if let Some(offsets) = &self.offsets {
            clip.offsets.clone_from(offsets);
        }
        if let Some(masks) = &self.masks {
            clip.masks.clone_from(masks);
        }
        if let Some(markers) = &self.markers {
            clip.markers.clone_from(markers);
        }
        if let Some(length) = self.length {
            clip.length = length;
        }
        if let Some(fill) = self.fill {
            clip.fill = fill;
        }
        if let Some(start) = &self.start {
            clip.start.clone_from(start);
        }
    }
}

/// Differences that no edit can make, for `robert clip diff`.
#[derive(Clone, Debug, PartialEq)]
pub struct Foreign {
    /// The other robot.
    pub robot: Option<RobotRef>,
    /// The other extensions.
    pub x: Option<Map<String, Value>>,
}

impl Foreign {
    /// The differences that [`Delta::between`] leaves out.
    pub fn between(old: &Clip, new: &Clip) -> Foreign {
        Foreign { robot: changed(&old.robot, &new.robot), x: changed(&old.x, &new.x) }
    }
}
