//! The path of points between two keys with end-effector goals.

use robert_kinematics::shortest_turn;

use super::curve::{hermite, smooth_slope};
use super::document::{Clip, Fill, Key};
use super::reach::Reach;

/// The places of points at the frames between two keys.
pub(super) struct Path<'a> {
    clip: &'a Clip,
    /// Index of the key before it.
    key: usize,
    /// First frame after the hold of that key.
    pub(super) first: u32,
    /// The frame of the next key.
    pub(super) last: u32,
}

impl<'a> Path<'a> {
    /// The path after key `i`, if this key and the next have goals for the same points and the fill
    /// between them is a line or a curve.
    pub(super) fn after(clip: &'a Clip, i: usize) -> Option<Path<'a>> {
        let (key, next) = (clip.keys.get(i)?, clip.keys.get(i + 1)?);
        let curved = matches!(clip.fill_after(key), Fill::Linear | Fill::Cubic);
        let same =
            |(a, b): (&Reach, &Reach)| a.point == b.point && a.quat.is_some() == b.quat.is_some();
        let alike = !key.reach.is_empty()
            && key.reach.len() == next.reach.len()
            && key.reach.iter().zip(&next.reach).all(same);
        let (first, last) = (clip.hold_end(i), next.frame);
        (curved && alike && first < last).then_some(Path { clip, key: i, first, last })
    }

    /// The number of frames between the keys.
    pub(super) fn frames(&self) -> usize {
        (self.last - self.first) as usize
    }

    /// The goals at a frame of it.
    pub(super) fn goals(&self, frame: u32) -> Vec<Reach> {
        let (Some(from), Some(to)) = (self.reach(self.key), self.reach(self.key + 1)) else {
            return Vec::new();
        };
        let begin = f64::from(self.first - 1);
        let width = f64::from(self.last) - begin;
        let s = (f64::from(frame) - begin) / width;
        let cubic =
            self.clip.keys.get(self.key).map(|k| self.clip.fill_after(k)) == Some(Fill::Cubic);
        let goal = |(n, (a, b)): (usize, (&Reach, &Reach))| {
            let mut pos = [0.0; 3];
            for (axis, value) in pos.iter_mut().enumerate() {
                let (p, q) = (a.pos[axis], b.pos[axis]);
                *value = if cubic {
                    let slope = |i| self.slope(i, n, axis) * width;
                    hermite(s, p, q, slope(self.key), slope(self.key + 1))
                } else {
                    p + s * (q - p)
                };
            }
            // A turn begins and ends at rest on a curve, whatever lies beyond its keys.
            let share = if cubic { s * s * (3.0 - 2.0 * s) } else { s };
            let quat = a.quat.zip(b.quat).map(|(a, b)| shortest_turn(a, b, share));
            Reach { point: a.point.clone(), pos, quat }
        };
        from.iter().zip(to).enumerate().map(goal).collect()
    }

    fn reach(&self, key: usize) -> Option<&'a Vec<Reach>> {
        self.clip.keys.get(key).map(|k| &k.reach)
    }

    /// Slope of a coordinate at key `i`, m per frame, by the same rule as for joints: zero, except
    /// between two curved paths without a hold.
    fn slope(&self, i: usize, goal: usize, axis: usize) -> f64 {
        let clip = self.clip;
        let curve = |i: usize| {
            let path = Path::after(clip, i)?;
            let is_cubic = |k: &Key| clip.fill_after(k) == Fill::Cubic;
            let (a, b) = (clip.keys.get(i).filter(|k| is_cubic(k))?, clip.keys.get(i + 1)?);
            let width = f64::from(path.last) - f64::from(path.first - 1);
            Some((width, b.reach.get(goal)?.pos[axis] - a.reach.get(goal)?.pos[axis]))
        };
        let held = clip.keys.get(i).is_none_or(|k| clip.hold_end(i) != k.frame + 1);
        match (i.checked_sub(1).and_then(curve), curve(i)) {
            (Some((h0, way0)), Some((h1, way1))) if !held => {
                smooth_slope(h0, h1, way0 / h0, way1 / h1)
            }
            _ => 0.0,
        }
    }
}
