//! Offsets: values that are added to the command over a span, so that a few edits change dense
//! motion.
//!
//! An offset adds a value to some joints of the motion that the keys command. It grows over the
//! frames before its own frame, is held, and fades over the frames after it. Several offsets at one
//! frame are summed.
//!
//! The fade is the minimum-jerk profile 10 s^3 - 15 s^4 + 6 s^5 (Flash and Hogan, J. Neurosci. 5,
//! 1985): it has no velocity and no acceleration at both ends. It is symmetric, so two offsets
//! whose fades overlap exactly lead smoothly from one value to the other. Rejected: a second list
//! of dense frames in the file. Keys on neighbouring frames are dense motion already, and every
//! tool reads, thins, cuts and pastes them.

use std::collections::BTreeMap;
use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::grid::round;

/// Frames over which an offset grows and fades if the file does not say: half a second.
pub const FADE_FRAMES: u32 = 10;

/// Values that are added to the command around one frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Offset {
    /// The first frame at which the values are added in full.
    pub frame: u32,
    /// What is added, by joint, rad or m.
    pub add: BTreeMap<String, f64>,
    /// The number of frames over which it grows; 0 = at once.
    #[serde(rename = "in", default = "fade")]
    pub fade_in: u32,
    /// The number of frames for which the values are added in full (at least 1).
    #[serde(default = "once")]
    pub hold: u32,
    /// The number of frames over which it fades; 0 = at once.
    #[serde(rename = "out", default = "fade")]
    pub fade_out: u32,
}

fn fade() -> u32 {
    FADE_FRAMES
}

fn once() -> u32 {
    1
}

impl Offset {
    /// An offset of this joint that grows and fades over this many frames.
    pub fn new(frame: u32, joint: &str, add: f64, fade_frames: u32) -> Offset {
        let add = BTreeMap::from([(joint.to_owned(), add)]);
        Offset { frame, add, fade_in: fade_frames, hold: 1, fade_out: fade_frames }
    }

    /// The frames that it changes, in a clip of this length.
    pub fn span(&self, length: u32) -> Range<u32> {
        let from = (self.frame + 1).saturating_sub(self.fade_in.max(1));
        let to = self.full_end().saturating_add(self.fade_out.max(1) - 1);
        from.min(length)..to.min(length)
    }

    /// First frame after those at which the values are added in full.
    fn full_end(&self) -> u32 {
        self.frame.saturating_add(self.hold.max(1))
    }

    /// Its share at a frame, 0 to 1.
    pub fn weight(&self, frame: u32) -> f64 {
        let (away, fade) = if frame < self.frame {
            (self.frame - frame, self.fade_in)
        } else {
            ((frame + 1).saturating_sub(self.full_end()), self.fade_out)
        };
        if away == 0 {
            return 1.0;
        }
        if away >= fade {
            return 0.0;
        }
        let s = 1.0 - f64::from(away) / f64::from(fade);
        s * s * s * (10.0 - s * (15.0 - 6.0 * s))
    }

    /// On the document's grid.
    pub(super) fn normal(&mut self) {
        self.add.values_mut().for_each(|v| *v = round(*v));
    }

    /// Its text in the file.
    pub(super) fn text(&self) -> String {
        let quote = |text: &str| serde_json::Value::from(text).to_string();
        let add: Vec<String> =
            self.add.iter().map(|(joint, v)| format!("{}: {v}", quote(joint))).collect();
        let hold =
            if self.hold == 1 { String::new() } else { format!(", \"hold\": {}", self.hold) };
        format!(
            "{{\"frame\": {}, \"add\": {{{}}}, \"in\": {}{hold}, \"out\": {}}}",
            self.frame,
            add.join(", "),
            self.fade_in,
            self.fade_out
        )
    }
}

/// The sum of all offsets; (frames, joints). Empty if there is none.
pub(super) fn total(offsets: &[Offset], joints: &[String], length: u32) -> Vec<f64> {
    if offsets.is_empty() {
        return Vec::new();
    }
    let dim = joints.len();
    let index: BTreeMap<&str, usize> =
        joints.iter().enumerate().map(|(i, j)| (j.as_str(), i)).collect();
    let mut sum = vec![0.0; length as usize * dim];
    for offset in offsets {
        // A clip that was validated knows all joints of its offsets.
        let add: Vec<(usize, f64)> =
            offset.add.iter().map(|(joint, v)| (index[joint.as_str()], *v)).collect();
        for frame in offset.span(length) {
            let weight = offset.weight(frame);
            for (joint, value) in &add {
                sum[frame as usize * dim + joint] += weight * value;
            }
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fades_meet_without_a_dent() {
        let (a, b) = (Offset::new(20, "x", 1.0, 12), Offset::new(32, "x", 1.0, 12));
        for t in 20..=32 {
            assert!((a.weight(t) + b.weight(t) - 1.0).abs() < 1e-12, "{t}");
        }
        assert_eq!((a.weight(8), a.weight(20), a.weight(32)), (0.0, 1.0, 0.0));
        assert_eq!(a.span(100), 9..32, "the frames with a share");
        assert!((0..100).all(|t| (a.weight(t) > 0.0) == a.span(100).contains(&t)));
        let sharp = Offset { fade_in: 0, hold: 3, fade_out: 0, ..a };
        let there: Vec<u32> = (0..100).filter(|t| sharp.weight(*t) > 0.0).collect();
        assert_eq!((there, sharp.span(100)), (vec![20, 21, 22], 20..23));
        assert_eq!(sharp.span(21), 20..21, "the clip ends it");
    }
}
