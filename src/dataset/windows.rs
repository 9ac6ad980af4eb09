//! Draws windows of 51 consecutive frames and copies them for training.
//!
//! Window `i` of step `t` is a function of (seed, t * B + i) alone: a uniform trajectory,
//! then a uniform start in it. Any thread may fill any part of a batch.

use super::error::Error;
use super::manifest::Part;
use super::open::Dataset;
use robert_base::rng::{Rng, Stream};

/// The place of a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Position in [`Dataset::episodes`].
    pub episode: usize,
    /// First frame within the trajectory.
    pub start: usize,
}

/// Draws windows from one part of a dataset.
#[derive(Debug)]
pub struct Windows<'a> {
    data: &'a Dataset,
    length: usize,
    /// (position in the manifest, shard, first frame, number of starts).
    spans: Vec<(usize, usize, usize, u64)>,
}

impl<'a> Windows<'a> {
    /// Windows of `length` frames from the trajectories at these positions (see
    /// [`Dataset::part`]); shorter trajectories are skipped.
    ///
    /// # Errors
    /// [`Error::Empty`] when no trajectory is long enough.
    pub fn new(
        data: &'a Dataset,
        length: usize,
        part: Part,
        split_seed: u64,
    ) -> Result<Self, Error> {
        let name = match part {
            Part::Train => "train",
            Part::Test => "test",
        };
        Self::of(data, length, &data.part(part, split_seed)).ok_or_else(|| Error::Empty {
            frames: length,
            part: name,
            path: data.path().to_owned(),
        })
    }

    /// As [`Windows::new`] for a list of trajectories; `None` if all are too short.
    pub fn of(data: &'a Dataset, length: usize, episodes: &[usize]) -> Option<Self> {
        let spans: Vec<_> = episodes
            .iter()
            .filter_map(|&i| {
                let e = data.episodes().get(i)?;
                let starts = (e.length + 1).checked_sub(length as u64).filter(|&n| n > 0)?;
                Some((i, e.shard, e.start as usize, starts))
            })
            .collect();
        (!spans.is_empty()).then_some(Windows { data, length, spans })
    }

    /// Number of distinct windows.
    pub fn total(&self) -> u64 {
        self.spans.iter().map(|s| s.3).sum()
    }

    /// Frames in one window.
    pub fn length(&self) -> usize {
        self.length
    }

    /// The window of draw `index` (= step * batch + position in the batch).
    pub fn draw(&self, seed: u64, index: u64) -> Window {
        let (episode, _, _, start) = self.locate(seed, index);
        Window { episode, start }
    }

    /// Copies the windows of draws `first ..` into `qpos` (B, 51, S) and `ctrl` (B, 51, A); the
    /// lengths of both give B.
    pub fn fill(&self, seed: u64, first: u64, qpos: &mut [f32], ctrl: &mut [f32]) {
        let m = self.data.manifest();
        let (q, u) = (self.length * m.qpos_dim(), self.length * m.ctrl_dim());
        let slots = qpos.chunks_exact_mut(q).zip(ctrl.chunks_exact_mut(u));
        for (index, (to_q, to_u)) in (first..).zip(slots) {
            let (_, shard, frame, start) = self.locate(seed, index);
            let shard = &self.data.shards()[shard];
            to_q.copy_from_slice(shard.qpos_rows(frame + start, self.length));
            to_u.copy_from_slice(shard.ctrl_rows(frame + start, self.length));
        }
    }

    /// (trajectory, shard, its first frame, start) of a draw.
    fn locate(&self, seed: u64, index: u64) -> (usize, usize, usize, usize) {
        let mut rng = Rng::new(seed, Stream::Batch, index);
        let at = rng.below(self.spans.len() as u64) as usize;
        let (episode, shard, frame, starts) = self.spans[at];
        (episode, shard, frame, rng.below(starts) as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::super::open::Verify;
    use super::super::view::tests::dataset;
    use super::*;

    #[test]
    fn windows_lie_inside_one_trajectory() {
        let dir = tempfile::tempdir().unwrap();
        dataset(dir.path(), 40, 1);
        let data = Dataset::open(dir.path(), Verify::Full).unwrap();
        let all: Vec<usize> = (0..data.episodes().len()).collect();
        let w = Windows::of(&data, 51, &all).unwrap();
        let (mut q, mut u) = (vec![0.0; 8 * 51 * 2], vec![0.0; 8 * 51]);
        w.fill(3, 16, &mut q, &mut u);
        for i in 0..8 {
            let at = w.draw(3, 16 + i as u64);
            let e = &data.episodes()[at.episode];
            let (qpos, _, ctrl) = data.frames(e);
            assert_eq!(q[i * 102..(i + 1) * 102], qpos[at.start * 2..(at.start + 51) * 2]);
            assert_eq!(u[i * 51..(i + 1) * 51], ctrl[at.start..at.start + 51]);
        }
        // The same draws in two halves are the same batch.
        let (mut q2, mut u2) = (vec![0.0; 8 * 51 * 2], vec![0.0; 8 * 51]);
        let (qa, qb) = q2.split_at_mut(3 * 102);
        let (ua, ub) = u2.split_at_mut(3 * 51);
        w.fill(3, 19, qb, ub);
        w.fill(3, 16, qa, ua);
        assert_eq!((q, u), (q2, u2));
    }

    #[test]
    fn every_start_is_drawn() {
        let dir = tempfile::tempdir().unwrap();
        dataset(dir.path(), 2, 1);
        let data = Dataset::open(dir.path(), Verify::Structure).unwrap();
        let w = Windows::of(&data, 51, &[0, 1]).unwrap();
        let mut seen = std::collections::BTreeSet::new();
        for i in 0..20_000 {
            let at = w.draw(1, i);
            seen.insert((at.episode, at.start));
        }
        assert_eq!(seen.len() as u64, w.total());
        assert!(Windows::of(&data, 500, &[0, 1]).is_none());
    }
}
