//! The track of each joint: the keys that have a value for it.
//!
//! A key says nothing about a joint that it has no value for, so the hold and the fill of a joint lead from one
//! key of its track to the next, whatever lies between them. The neighbours of all keys are found once.

use super::document::Clip;

const NONE: u32 = u32::MAX;

/// For each key and joint of a clip, the neighbouring keys that have a value for the joint. Keys are meant by
/// their index, joints by their place in the rows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tracks {
    keys: usize,
    dim: usize,
    /// The last key up to this one; (keys, dim). Empty if every key has a value for every joint.
    last: Vec<u32>,
    /// The first key after this one; likewise.
    next: Vec<u32>,
}

impl Tracks {
    /// The tracks of so many keys and joints; `has` says whether a key has a value for a joint.
    pub(super) fn of(keys: usize, dim: usize, has: impl Fn(usize, usize) -> bool) -> Tracks {
        let mut tracks = Tracks { keys, dim, ..Tracks::default() };
        if (0..keys).all(|i| (0..dim).all(|j| has(i, j))) {
            return tracks;
        }
        let mut now = vec![NONE; dim];
        for i in 0..keys {
            (0..dim).filter(|j| has(i, *j)).for_each(|j| now[j] = i as u32);
            tracks.last.extend(&now);
        }
        now.fill(NONE);
        tracks.next = vec![NONE; keys * dim];
        for i in (0..keys).rev() {
            tracks.next[i * dim..(i + 1) * dim].copy_from_slice(&now);
            (0..dim).filter(|j| has(i, *j)).for_each(|j| now[j] = i as u32);
        }
        tracks
    }

    /// The tracks of these joints.
    pub(super) fn reordered(&self, joints: &[usize]) -> Tracks {
        Tracks::of(self.keys, joints.len(), |i, j| self.has(i, joints[j]))
    }

    /// The last key up to key `i`, itself included, that has a value for the joint.
    pub fn last(&self, i: usize, joint: usize) -> Option<usize> {
        if self.last.is_empty() {
            return (i < self.keys).then_some(i);
        }
        self.last.get(i * self.dim + joint).filter(|k| **k != NONE).map(|k| *k as usize)
    }

    /// The last key before key `i` that has a value for the joint.
    pub fn before(&self, i: usize, joint: usize) -> Option<usize> {
        self.last(i.checked_sub(1)?, joint)
    }

    /// The first key after key `i` that has a value for the joint.
    pub fn next(&self, i: usize, joint: usize) -> Option<usize> {
        if self.next.is_empty() {
            return Some(i + 1).filter(|n| *n < self.keys);
        }
        self.next.get(i * self.dim + joint).filter(|k| **k != NONE).map(|k| *k as usize)
    }

    /// Whether key `i` has a value for the joint.
    pub fn has(&self, i: usize, joint: usize) -> bool {
        self.last(i, joint) == Some(i)
    }

    /// First frame at which the joint has another key after key `i`; the length of the clip if it has none.
    pub fn until(&self, clip: &Clip, i: usize, joint: usize) -> u32 {
        self.next(i, joint).and_then(|n| clip.keys.get(n)).map_or(clip.length, |n| n.frame)
    }

    /// First frame at which the hold of key `i` no longer commands the joint.
    pub fn hold_end(&self, clip: &Clip, i: usize, joint: usize) -> u32 {
        clip.full_hold(i).min(self.until(clip, i, joint))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_are_those_of_the_joint() {
        let rows = [[true, true], [false, true], [true, false], [false, true]];
        let tracks = Tracks::of(4, 2, |i, j| rows[i][j]);
        for (i, row) in rows.iter().enumerate() {
            for (j, has) in row.iter().enumerate() {
                let of_joint = |k: &usize| rows[*k][j];
                assert_eq!(tracks.has(i, j), *has);
                assert_eq!(tracks.last(i, j), (0..=i).rev().find(of_joint));
                assert_eq!(tracks.before(i, j), (0..i).rev().find(of_joint));
                assert_eq!(tracks.next(i, j), (i + 1..4).find(of_joint));
            }
        }
        let complete = Tracks::of(2, 2, |_, _| true);
        assert_eq!((complete.before(0, 1), complete.next(0, 1)), (None, Some(1)));
        assert_eq!((complete.before(1, 1), complete.next(1, 1)), (Some(0), None));
    }
}
