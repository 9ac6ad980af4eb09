//! The path of points between two keys with end-effector goals.

use std::collections::BTreeMap;

use robert_kinematics::shortest_turn;

use super::curve::{hermite, smooth_slope};
use super::document::{Clip, Fill};
use super::reach::Reach;

/// The keys of a clip from which points move on a path, and to which.
#[derive(Default)]
pub(super) struct Paths {
    /// By key, the key at the end of the path that begins there.
    to: Vec<Option<usize>>,
    /// By key, the key at the beginning of the path that ends there.
    from: Vec<Option<usize>>,
}

impl Paths {
    /// The paths of a clip. `next` is the first key after a key that places its points or moves a joint that moves
    /// them: a key for other joints cuts no path.
    pub(super) fn of(clip: &Clip, next: impl Fn(usize) -> Option<usize>) -> Paths {
        let mut paths =
            Paths { to: vec![None; clip.keys.len()], from: vec![None; clip.keys.len()] };
        for i in 0..clip.keys.len() {
            if let Some(n) = next(i).filter(|n| leads(clip, i, *n)) {
                (paths.to[i], paths.from[n]) = (Some(n), Some(i));
            }
        }
        paths
    }

    /// The path that begins at key `i`.
    pub(super) fn after<'a>(&'a self, clip: &'a Clip, i: usize) -> Option<Path<'a>> {
        let to = (*self.to.get(i)?)?;
        let (first, last) = (clip.full_hold(i), clip.keys.get(to)?.frame);
        Some(Path { clip, paths: self, key: i, to, first, last })
    }

    /// The path that ends at key `i`.
    pub(super) fn before<'a>(&'a self, clip: &'a Clip, i: usize) -> Option<Path<'a>> {
        self.after(clip, (*self.from.get(i)?)?)
    }
}

/// Whether two keys have goals for the same points, and the fill between them is a line or a curve.
fn leads(clip: &Clip, i: usize, n: usize) -> bool {
    let (Some(key), Some(next)) = (clip.keys.get(i), clip.keys.get(n)) else { return false };
    let curved = matches!(clip.fill_after(key), Fill::Linear | Fill::Cubic);
    let same =
        |(a, b): (&Reach, &Reach)| a.point == b.point && a.quat.is_some() == b.quat.is_some();
    let alike = !key.reach.is_empty()
        && key.reach.len() == next.reach.len()
        && key.reach.iter().zip(&next.reach).all(same);
    curved && alike && clip.full_hold(i) < next.frame
}

/// The most frames that lie on the paths of a clip. Which joints move a point is not known without the robot, so
/// every key for some joints only is taken for one that cuts no path.
pub(super) fn frames_ahead(clip: &Clip) -> usize {
    let mut frames = 0;
    let mut ends: BTreeMap<Vec<(String, bool)>, usize> = BTreeMap::new();
    // A clip that is being checked may not be sorted yet.
    let mut order: Vec<usize> = (0..clip.keys.len()).collect();
    order.sort_by_key(|n| clip.keys[*n].frame);
    for n in order {
        let key = &clip.keys[n];
        if clip.row(key).is_none_or(|row| !row.contains(&None)) && key.reach.is_empty() {
            ends.clear();
        }
        if key.reach.is_empty() {
            continue;
        }
        let points = key.reach.iter().map(|r| (format!("{:?}", r.point), r.quat.is_some()));
        let points: Vec<_> = points.collect();
        let before = ends.remove(&points);
        // Its values for all joints cut the paths of all other points.
        if clip.row(key).is_none_or(|row| !row.contains(&None)) {
            ends.clear();
        }
        ends.insert(points, n);
        if let Some(i) = before.filter(|i| leads(clip, *i, n)) {
            frames += (key.frame - clip.full_hold(i)) as usize;
        }
    }
    frames
}

/// The places of points at the frames between two keys.
pub(super) struct Path<'a> {
    clip: &'a Clip,
    paths: &'a Paths,
    /// Index of the key before it.
    pub(super) key: usize,
    /// Index of the key after it.
    pub(super) to: usize,
    /// First frame after the hold of the key before it.
    pub(super) first: u32,
    /// The frame of the key after it.
    pub(super) last: u32,
}

impl Path<'_> {
    /// The goals at a frame of it.
    pub(super) fn goals(&self, frame: u32) -> Vec<Reach> {
        let (Some(from), Some(to)) = (self.reach(self.key), self.reach(self.to)) else {
            return Vec::new();
        };
        let (begin, width) = (f64::from(self.first - 1), self.width());
        let s = (f64::from(frame) - begin) / width;
        let cubic = self.is_cubic();
        let goal = |(n, (a, b)): (usize, (&Reach, &Reach))| {
            let mut pos = [0.0; 3];
            for (axis, value) in pos.iter_mut().enumerate() {
                let (p, q) = (a.pos[axis], b.pos[axis]);
                *value = if cubic {
                    let slope = |i| self.slope(i, n, axis) * width;
                    hermite(s, p, q, slope(self.key), slope(self.to))
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

    fn reach(&self, key: usize) -> Option<&Vec<Reach>> {
        self.clip.keys.get(key).map(|k| &k.reach)
    }

    /// Frames from the last one of the hold to the next key.
    fn width(&self) -> f64 {
        f64::from(self.last) - f64::from(self.first - 1)
    }

    fn is_cubic(&self) -> bool {
        self.clip.keys.get(self.key).map(|k| self.clip.fill_after(k)) == Some(Fill::Cubic)
    }

    /// Slope of a coordinate at key `i`, m per frame, by the same rule as for joints: zero, except
    /// between two curved paths without a hold.
    fn slope(&self, i: usize, goal: usize, axis: usize) -> f64 {
        let curve = |path: Option<Path<'_>>| {
            let path = path.filter(Path::is_cubic)?;
            let (a, b) = (path.reach(path.key)?.get(goal)?, path.reach(path.to)?.get(goal)?);
            Some((path.width(), b.pos[axis] - a.pos[axis]))
        };
        let held = self.clip.keys.get(i).is_none_or(|k| self.clip.full_hold(i) != k.frame + 1);
        let (before, after) = (self.paths.before(self.clip, i), self.paths.after(self.clip, i));
        match (curve(before), curve(after)) {
            (Some((h0, way0)), Some((h1, way1))) if !held => {
                smooth_slope(h0, h1, way0 / h0, way1 / h1)
            }
            _ => 0.0,
        }
    }
}
