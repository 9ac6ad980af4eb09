//! Batches: window w of step t is a function of the seed, t and w alone, so any thread may fill any
//! slot, and a resumed run gets the same windows.

use std::sync::{Mutex, PoisonError};

use super::TrainConfig;
use super::config::ContactTarget;
use super::pressing::Pressing;
use robert_base::rng::{Rng, Stream};
use robert_dataset::{Dataset, SHORTEST, Window, Windows};
use robert_net::Place;
use robert_net::encode::EncodeScratch;
use robert_net::{Batch, CURRENT, Encoder, WINDOW};

const _: () = assert!(SHORTEST == WINDOW, "datasets keep trajectories that fill a window");

/// Added to the seed for windows that are used only for measuring.
const MEASURE: u64 = 0x5EED;
/// The number of different counts of hidden frames that are measured in turn.
const PREFIXES: u64 = 20;

/// Fills slots of batches.
#[derive(Debug)]
pub(super) struct Source<'a> {
    data: &'a Dataset,
    encoder: &'a Encoder,
    cfg: &'a TrainConfig,
    pressing: Option<Pressing>,
    ranges: Vec<Option<[f32; 2]>>,
    /// Distance to a stop that counts as being at it, by joint; (S).
    near: Vec<f32>,
    pool: Mutex<Vec<Scratch>>,
}

/// The data of a run and the motion of its earlier rounds.
#[derive(Debug)]
pub(super) struct BatchSampler<'a> {
    /// The data.
    pub(super) source: &'a Source<'a>,
    windows: &'a Windows<'a>,
    reached: Vec<(Source<'a>, Windows<'a>)>,
}

impl<'a> BatchSampler<'a> {
    /// Rounds too short for a window are left out.
    pub(super) fn new(
        source: &'a Source<'a>,
        windows: &'a Windows<'a>,
        reached: &'a [Dataset],
    ) -> Self {
        let of = |data: &'a Dataset| {
            let all: Vec<usize> = (0..data.episodes().len()).collect();
            let windows = Windows::of(data, WINDOW, &all)?;
            Some((Source::new(data, source.encoder, source.cfg), windows))
        };
        BatchSampler { source, windows, reached: reached.iter().filter_map(of).collect() }
    }

    /// Window `w` of step `step` into a slot.
    pub(super) fn train(&self, step: u64, w: usize, slot: usize, batch: &mut Batch<f32>) {
        let cfg = self.source.cfg;
        let index = step * cfg.batch as u64 + w as u64;
        let mut rng = Rng::new(cfg.seed, Stream::Reached, index);
        if !self.reached.is_empty() && rng.uniform() < cfg.self_share {
            let round = rng.below(self.reached.len() as u64) as usize;
            if let Some((source, windows)) = self.reached.get(round) {
                return source.train(windows, step, w, slot, batch);
            }
        }
        self.source.train(self.windows, step, w, slot, batch);
    }
}

#[derive(Debug)]
struct Scratch {
    q: Vec<f32>,        // (51, S)
    actions: Vec<f32>,  // (51, A)
    visible: Vec<bool>, // (51, S)
    encode: EncodeScratch,
}

impl<'a> Source<'a> {
    pub(super) fn new(data: &'a Dataset, encoder: &'a Encoder, cfg: &'a TrainConfig) -> Self {
        let robot = &data.manifest().robot;
        Source {
            data,
            encoder,
            cfg,
            pressing: cfg.leave_pressing.then(|| Pressing::find(data, cfg.seed)),
            ranges: robot.ranges.iter().map(|r| r.map(|r| r.map(|x| x as f32))).collect(),
            near: robot.near_limit.iter().map(|&n| n as f32).collect(),
            pool: Mutex::new(Vec::new()),
        }
    }

    /// Window `w` of step `step` into a slot.
    fn train(
        &self,
        windows: &Windows<'_>,
        step: u64,
        w: usize,
        slot: usize,
        batch: &mut Batch<f32>,
    ) {
        let index = step * self.cfg.batch as u64 + w as u64;
        let progress = step as f64 / self.cfg.steps as f64;
        self.fill(windows, self.cfg.seed, index, slot, batch, |visible, s| {
            let mut rng = Rng::new(self.cfg.seed, Stream::Mask, index);
            self.cfg.mask.draw(progress, self.cfg.mask_granularity, s, &mut rng, visible);
        });
        if self.cfg.contact_target == ContactTarget::Linear && !batch.linear.is_empty() {
            let a = self.encoder.tokens.facts().actions;
            let at = windows.draw(self.cfg.seed, index);
            for i in (0..WINDOW).filter(|&i| self.touches(at, i)) {
                let row = (slot * WINDOW + i) * a..(slot * WINDOW + i + 1) * a;
                batch.actions[row.clone()].copy_from_slice(&batch.linear[row]);
            }
        }
    }

    /// A window to measure on: the first w mod 20 command frames are hidden.
    pub(super) fn measure(
        &self,
        windows: &Windows<'_>,
        w: u64,
        slot: usize,
        batch: &mut Batch<f32>,
    ) {
        self.fill(windows, self.cfg.seed ^ MEASURE, w, slot, batch, |visible, s| {
            visible.fill(true);
            let hidden = (w % PREFIXES) as usize;
            visible[(CURRENT + 1) * s..(CURRENT + 1 + hidden) * s].fill(false);
        });
    }

    fn fill(
        &self,
        windows: &Windows<'_>,
        seed: u64,
        index: u64,
        slot: usize,
        batch: &mut Batch<f32>,
        mask: impl FnOnce(&mut [bool], usize),
    ) {
        let (s, a) = (self.encoder.tokens.state(), self.encoder.tokens.facts().actions);
        let lend = || self.pool.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut scratch = lend().unwrap_or_else(|| Scratch {
            q: vec![0.0; WINDOW * s],
            actions: vec![0.0; WINDOW * a],
            visible: vec![true; WINDOW * s],
            encode: self.encoder.scratch(),
        });
        let Scratch { q, actions, visible, encode } = &mut scratch;
        windows.fill(seed, index, q, actions);
        mask(visible, s);
        self.encoder.encode(q, visible, &actions[..CURRENT * a], encode, batch, slot);
        batch.actions[slot * WINDOW * a..(slot + 1) * WINDOW * a].copy_from_slice(actions);
        let at = windows.draw(seed, index);
        for i in 0..WINDOW {
            let stopped = self.near_stop(&q[i * s..(i + 1) * s]);
            let touching = self.touches(at, i);
            let row = slot * WINDOW + i;
            let told = self.encoder.sees_actions() && i < CURRENT;
            batch.place[row] = match (told, stopped, touching) {
                (true, ..) => Place::Told,
                (false, true, _) => Place::Stop,
                (false, false, true) => Place::Contact,
                (false, false, false) => Place::Clear,
            };
            let weight = |on: bool, w: f64| if on { w } else { 1.0 };
            batch.weight[row] = (weight(stopped, self.cfg.stop_weight)
                * weight(touching, self.cfg.contact_weight)
                * weight(told, 0.0)) as f32;
        }
        self.pool.lock().unwrap_or_else(PoisonError::into_inner).push(scratch);
    }

    /// Whether the robot touches itself in frame `i` of a window, or presses.
    fn touches(&self, at: Window, i: usize) -> bool {
        let seen = self.data.self_contact(&self.data.episodes()[at.episode]);
        seen.get(at.start + i).is_some_and(|&c| c != 0)
            || self.pressing.as_ref().is_some_and(|p| p.at(at.episode, at.start + i))
    }

    fn near_stop(&self, q: &[f32]) -> bool {
        q.iter()
            .zip(&self.ranges)
            .zip(&self.near)
            .any(|((&x, range), near)| range.is_some_and(|[lo, hi]| x < lo + near || x > hi - near))
    }
}
