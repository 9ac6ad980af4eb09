//! The difference between two versions of a clip: the inverse of any edit, and the patch
//! that the other tabs get.
//!
//! One generic inverse instead of one per operation: what undoes `time.delete` or a
//! replacing paste is not an edit a person would name, and a computed difference cannot
//! forget a field.

use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Map, Value};

use super::document::{Clip, Fill, Key, Marker, Mask, RobotRef, Row, Start};

/// A difference. Empty parts did not change.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Delta {
    /// Frames whose key goes.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub keys_removed: Vec<u32>,
    /// Keys that come or change.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub keys_put: Vec<Key>,
    /// Poses that go.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub poses_removed: Vec<String>,
    /// Poses that come or change.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub poses_put: Vec<(String, Row)>,
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
    /// Start; `Some(None)` removes it.
    #[serde(skip_serializing_if = "Option::is_none", deserialize_with = "present")]
    pub start: Option<Option<Start>>,
}

#[allow(clippy::option_option)] // absent, null and a value are three things in a patch
fn present<'de, D: Deserializer<'de>>(d: D) -> Result<Option<Option<Start>>, D::Error> {
    Option::<Start>::deserialize(d).map(Some)
}

fn changed<T: Clone + PartialEq>(old: &T, new: &T) -> Option<T> {
    (old != new).then(|| new.clone())
}

impl Delta {
    /// What turns `old` into `new`. Robot and extensions are never edited and not compared.
    pub fn between(old: &Clip, new: &Clip) -> Delta {
        let mut delta = Delta {
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

    /// Carries the change out.
    pub(super) fn put(&self, clip: &mut Clip) {
        let put: std::collections::BTreeSet<u32> = self
            .keys_put
            .iter()
            .map(|k| k.frame)
            .chain(self.keys_removed.iter().copied())
            .collect();
        if !put.is_empty() {
            clip.keys.retain(|k| !put.contains(&k.frame));
            clip.keys.extend(self.keys_put.iter().cloned());
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

/// Differences that no edit makes, for `robert clip diff`.
#[derive(Clone, Debug, PartialEq)]
pub struct Foreign {
    /// The other robot.
    pub robot: Option<RobotRef>,
    /// The other extensions.
    pub x: Option<Map<String, Value>>,
}

impl Foreign {
    /// What [`Delta::between`] leaves out.
    pub fn between(old: &Clip, new: &Clip) -> Foreign {
        Foreign { robot: changed(&old.robot, &new.robot), x: changed(&old.x, &new.x) }
    }
}
