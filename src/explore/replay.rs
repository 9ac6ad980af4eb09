//! Replay memory: finished and running episodes, sampled uniformly by episode, then index.
//!
//! The memory only grows or drops its oldest episodes, so a checkpoint writes every episode once.

use super::batch::Batch;
use super::ddpg::N_STEP;
use robert_base::rng::{Rng, Stream};
use robert_linalg::Real;

/// One episode: n steps and n + 1 observations.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Steps {
    /// (n + 1, o), unscaled.
    pub(crate) obs: Vec<f32>,
    /// (n, A).
    pub(crate) action: Vec<f32>,
    /// (n, k).
    pub(crate) skill: Vec<f32>,
}

/// All episodes, oldest first.
#[derive(Clone, Debug)]
pub(crate) struct Replay {
    obs: usize,
    act: usize,
    skill: usize,
    capacity: usize,
    episodes: Vec<Steps>,
    /// Episodes with at least one n-step transition, in order.
    ready: Vec<u32>,
    forgotten: usize,
    steps: usize,
}

impl Replay {
    /// For these row sizes; at most `capacity` steps are remembered.
    pub(crate) fn new(obs: usize, act: usize, skill: usize, capacity: usize) -> Self {
        Replay {
            obs,
            act,
            skill,
            capacity,
            episodes: Vec::new(),
            ready: Vec::new(),
            forgotten: 0,
            steps: 0,
        }
    }

    /// Begins an episode; returns its handle.
    pub(crate) fn begin(&mut self, first: &[f32]) -> usize {
        self.episodes.push(Steps { obs: first.to_vec(), ..Steps::default() });
        self.forgotten + self.episodes.len() - 1
    }

    /// Adds a step to an episode: the action, its skill, and the observation reached.
    pub(crate) fn push(&mut self, episode: usize, action: &[f32], skill: &[f32], obs: &[f32]) {
        let Some(at) = episode.checked_sub(self.forgotten) else { return };
        let Some(e) = self.episodes.get_mut(at) else { return };
        e.obs.extend_from_slice(obs);
        e.action.extend_from_slice(action);
        e.skill.extend_from_slice(skill);
        self.steps += 1;
        if e.action.len() == N_STEP * self.act {
            let at = at as u32;
            let place = self.ready.partition_point(|&r| r < at);
            self.ready.insert(place, at);
        }
    }

    /// Drops an episode whose simulation diverged.
    pub(crate) fn void(&mut self, episode: usize) {
        let Some(at) = episode.checked_sub(self.forgotten) else { return };
        if let Some(e) = self.episodes.get_mut(at) {
            self.steps -= e.action.len() / self.act;
            *e = Steps::default();
            self.ready.retain(|&r| r as usize != at);
        }
    }

    /// Drops whole episodes down to the capacity. Called between updates; running episodes are the
    /// newest and stay.
    pub(crate) fn trim(&mut self) {
        let mut drop = 0;
        while self.steps > self.capacity && drop + 1 < self.episodes.len() {
            self.steps -= self.episodes[drop].action.len() / self.act;
            drop += 1;
        }
        self.forget(drop);
    }

    /// Keeps the newest `n` episodes, as a checkpoint records; false if there are fewer.
    pub(crate) fn keep_youngest(&mut self, n: usize) -> bool {
        let Some(drop) = self.episodes.len().checked_sub(n) else { return false };
        let steps: usize = self.episodes.iter().take(drop).map(|e| e.action.len()).sum();
        self.steps -= steps / self.act;
        self.forget(drop);
        true
    }

    /// Drops the oldest episodes, whose steps were already subtracted.
    fn forget(&mut self, drop: usize) {
        if drop > 0 {
            self.episodes.drain(..drop);
            self.forgotten += drop;
            self.ready.retain(|&r| r as usize >= drop);
            self.ready.iter_mut().for_each(|r| *r -= drop as u32);
        }
    }

    /// Episodes in memory.
    pub(crate) fn remembered(&self) -> usize {
        self.episodes.len()
    }

    /// Whether anything can be sampled.
    pub(crate) fn is_ready(&self) -> bool {
        !self.ready.is_empty()
    }

    /// Episodes begun so far, including dropped ones.
    pub(crate) fn begun(&self) -> usize {
        self.forgotten + self.episodes.len()
    }

    /// Episodes from handle `first` on.
    pub(crate) fn since(&self, first: usize) -> &[Steps] {
        self.episodes.get(first.saturating_sub(self.forgotten)..).unwrap_or_default()
    }

    /// Restores an episode from a checkpoint.
    pub(crate) fn restore(&mut self, e: Steps) {
        let n = e.action.len() / self.act;
        if n >= N_STEP {
            self.ready.push(self.episodes.len() as u32);
        }
        self.steps += n;
        self.episodes.push(e);
    }

    /// Fills `batch` with `rows` transitions of [`N_STEP`] steps drawn from (seed, index);
    /// observations are scaled as (s - mean) * inv.
    pub(crate) fn sample<T: Real>(
        &self,
        rows: usize,
        seed: u64,
        index: u64,
        scale: &Scale,
        batch: &mut Batch<T>,
    ) {
        let mut rng = Rng::new(seed, Stream::Replay, index);
        batch.rows = rows;
        for v in [&mut batch.obs, &mut batch.action, &mut batch.next, &mut batch.skill] {
            v.clear();
        }
        for _ in 0..rows {
            let pick = rng.below(self.ready.len() as u64) as usize;
            let Some(e) = self.ready.get(pick).and_then(|&r| self.episodes.get(r as usize)) else {
                continue;
            };
            let starts = e.action.len() / self.act + 1 - N_STEP;
            let t = rng.below(starts as u64) as usize;
            scale.apply(&e.obs[t * self.obs..(t + 1) * self.obs], &mut batch.obs);
            let later = t + N_STEP;
            scale.apply(&e.obs[later * self.obs..(later + 1) * self.obs], &mut batch.next);
            let action = &e.action[t * self.act..(t + 1) * self.act];
            batch.action.extend(action.iter().map(|&x| T::of(f64::from(x))));
            let skill = &e.skill[t * self.skill..(t + 1) * self.skill];
            batch.skill.extend(skill.iter().map(|&x| T::of(f64::from(x))));
        }
    }
}

/// Scaling of observations: running mean and standard deviation, or none.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Scale {
    /// Whether it scales at all.
    pub(crate) on: bool,
    /// Count, then means, then sums of squared deviations: (1 + 2 o).
    pub(crate) state: Vec<f64>,
    mean: Vec<f32>,
    inv: Vec<f32>,
}

impl Scale {
    /// For `obs` columns.
    pub(crate) fn new(obs: usize, on: bool) -> Self {
        Scale { on, state: vec![0.0; 1 + 2 * obs], mean: vec![0.0; obs], inv: vec![1.0; obs] }
    }

    /// Adds one observation (Welford 1962).
    pub(crate) fn add(&mut self, obs: &[f32]) {
        let o = self.mean.len();
        self.state[0] += 1.0;
        let n = self.state[0];
        let (mean, square) = self.state[1..].split_at_mut(o);
        for ((m, s), &x) in mean.iter_mut().zip(square).zip(obs) {
            let d = f64::from(x) - *m;
            *m += d / n;
            *s += d * (f64::from(x) - *m);
        }
    }

    /// Applies the added observations; called at fixed points, so that a batch has one scaling.
    pub(crate) fn refresh(&mut self) {
        if !self.on || self.state[0] < 2.0 {
            return;
        }
        let o = self.mean.len();
        let n = self.state[0];
        for j in 0..o {
            self.mean[j] = self.state[1 + j] as f32;
            self.inv[j] = (1.0 / (self.state[1 + o + j] / n).sqrt().max(1e-3)) as f32;
        }
    }

    /// Mean and 1 / standard deviation in use, (o) each.
    pub(crate) fn in_use(&self) -> (&[f32], &[f32]) {
        (&self.mean, &self.inv)
    }

    /// Appends a scaled row.
    pub(crate) fn apply<T: Real>(&self, obs: &[f32], out: &mut Vec<T>) {
        out.extend(
            obs.iter()
                .zip(&self.mean)
                .zip(&self.inv)
                .map(|((&x, &m), &s)| T::of(f64::from((x - m) * s))),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(lengths: &[usize], capacity: usize) -> Replay {
        let mut r = Replay::new(1, 1, 0, capacity);
        for (i, &n) in lengths.iter().enumerate() {
            let e = r.begin(&[i as f32 * 100.0]);
            for t in 0..n {
                r.push(e, &[t as f32], &[], &[i as f32 * 100.0 + t as f32 + 1.0]);
            }
        }
        r
    }

    #[test]
    fn transitions_are_three_steps_of_one_episode() {
        let r = filled(&[5, 2, 3, 40], 1000);
        let mut b = Batch::<f64>::default();
        let mut seen = std::collections::BTreeMap::new();
        for i in 0..300 {
            r.sample(8, 1, i, &Scale::new(1, false), &mut b);
            for ((s, n), a) in b.obs.iter().zip(&b.next).zip(&b.action) {
                assert_eq!(n - s, 3.0);
                assert_eq!(s % 100.0, *a);
                *seen.entry((s / 100.0) as u32).or_insert(0) += 1;
            }
        }
        // Uniform by episode; the one with two steps has no transition.
        assert_eq!(seen.keys().copied().collect::<Vec<_>>(), [0, 2, 3]);
        assert!(seen.values().all(|&n: &i32| (700..900).contains(&n)), "{seen:?}");
    }

    #[test]
    fn oldest_are_forgotten_and_broken_never_sampled() {
        let mut r = filled(&[10, 10, 10], 25);
        r.trim();
        assert_eq!((r.begun(), r.since(0).len(), r.steps), (3, 2, 20));
        r.void(2);
        let mut b = Batch::<f32>::default();
        r.sample(50, 1, 0, &Scale::new(1, false), &mut b);
        assert!(b.obs.iter().all(|&s| (100.0..200.0).contains(&s)));
        r.push(0, &[0.0], &[], &[0.0]);
        assert_eq!(r.steps, 10);
    }

    #[test]
    fn the_youngest_are_what_trimming_leaves() {
        let (mut a, mut b) = (filled(&[10, 2, 10, 10], 25), filled(&[10, 2, 10, 10], 25));
        a.trim();
        assert_eq!(a.remembered(), 3);
        assert!(b.keep_youngest(3));
        assert_eq!((a.steps, a.begun(), &a.ready), (b.steps, b.begun(), &b.ready));
        assert_eq!(a.since(0), b.since(0));
        assert!(!b.keep_youngest(4));
    }

    #[test]
    fn scale_is_mean_and_deviation() {
        let mut s = Scale::new(1, true);
        for x in [1.0, 3.0, 5.0, 7.0_f32] {
            s.add(&[x]);
        }
        let mut out = Vec::<f64>::new();
        s.apply(&[4.0], &mut out);
        assert_eq!(out, [4.0]);
        s.refresh();
        s.apply(&[4.0, 6.0][..1], &mut out);
        s.apply(&[4.0 + 5.0_f32.sqrt()], &mut out);
        assert!(out[1].abs() < 1e-6 && (out[2] - 1.0).abs() < 1e-6, "{out:?}");
    }
}
