//! A batch in the processor's memory: in the layout that the card reads, and with the error counts
//! that follow from the card's output.

use std::sync::Mutex;

use robert_linalg::{next_of, on_threads};
use robert_net::engine::Fill;
use robert_net::head::{Sums, nearest};
use robert_net::{Batch, CURRENT, NetConfig, Place, SkipKind, WINDOW};

use super::head::offset_weight;

/// Windows that a thread fills at once.
const CHUNK: usize = 8;

/// A whole batch.
#[derive(Debug, Default)]
pub(crate) struct Host {
    /// The number of the batch that is in it.
    pub(crate) index: Option<u64>,
    /// Features, rows padded to a multiple of four; (R, stride).
    pub(crate) tokens: Vec<f32>,
    /// Masked, bin, factor of the loss as bits, unused; (R).
    pub(crate) info: Vec<[u32; 4]>,
    /// The linear prediction, (R, A); empty without a skip.
    pub(crate) linear: Vec<f32>,
    /// Actions to infer, (R, A).
    pub(crate) actions: Vec<f32>,
    masked: Vec<bool>,
    place: Vec<Place>,
    factor: Vec<f64>,
}

/// Fills batches.
#[derive(Debug)]
pub(crate) struct Filler {
    cfg: NetConfig,
    centres: Vec<f32>,
    batch: usize,
    current_only: bool,
    workers: Vec<Mutex<Batch<f32>>>,
}

/// The part of a batch that a thread fills.
struct Part<'a> {
    tokens: &'a mut [f32],
    info: &'a mut [[u32; 4]],
    linear: &'a mut [f32],
    actions: &'a mut [f32],
    masked: &'a mut [bool],
    place: &'a mut [Place],
    factor: &'a mut [f64],
}

impl Filler {
    pub(crate) fn new(
        cfg: &NetConfig,
        centres: &[f32],
        batch: usize,
        threads: usize,
        current_only: bool,
    ) -> Self {
        let worker = || Mutex::new(Batch::zeros(cfg, CHUNK));
        Filler {
            cfg: cfg.clone(),
            centres: centres.to_vec(),
            batch,
            current_only,
            workers: (0..threads.max(1)).map(|_| worker()).collect(),
        }
    }

    /// Numbers in a row of tokens.
    pub(crate) fn stride(&self) -> usize {
        self.cfg.inputs.next_multiple_of(4)
    }

    /// An empty batch.
    pub(crate) fn host(&self) -> Host {
        let rows = self.batch * WINDOW;
        let skips = self.cfg.skip != SkipKind::Off;
        Host {
            index: None,
            tokens: vec![0.0; rows * self.stride()],
            info: vec![[0; 4]; rows],
            linear: vec![0.0; if skips { rows * self.cfg.actions } else { 0 }],
            actions: vec![0.0; rows * self.cfg.actions],
            masked: vec![false; rows],
            place: vec![Place::Clear; rows],
            factor: vec![0.0; rows],
        }
    }

    /// Writes batch `index`.
    pub(crate) fn fill(&self, host: &mut Host, fill: &Fill<'_>, index: u64) {
        host.index = Some(index);
        let (rows, a) = (CHUNK * WINDOW, self.cfg.actions);
        let skips = !host.linear.is_empty();
        let mut linear = host.linear.chunks_mut(rows * a);
        let parts: Vec<_> = host
            .tokens
            .chunks_mut(rows * self.stride())
            .zip(host.info.chunks_mut(rows))
            .zip(host.actions.chunks_mut(rows * a))
            .zip(host.masked.chunks_mut(rows).zip(host.place.chunks_mut(rows)))
            .zip(host.factor.chunks_mut(rows))
            .map(|((((tokens, info), actions), (masked, place)), factor)| Part {
                tokens,
                info,
                linear: if skips { linear.next().unwrap_or_default() } else { &mut [] },
                actions,
                masked,
                place,
                factor,
            })
            .collect();
        let queue = Mutex::new(parts.into_iter().enumerate());
        on_threads(self.workers.len(), |thread| {
            let mut batch =
                self.workers[thread].lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            while let Some((chunk, mut part)) = next_of(&queue) {
                batch.count = part.masked.len() / WINDOW;
                for slot in 0..batch.count {
                    fill(index, chunk * CHUNK + slot, slot, &mut batch);
                }
                self.copy(&batch, &mut part);
            }
        });
    }

    fn copy(&self, batch: &Batch<f32>, to: &mut Part<'_>) {
        let (inputs, a) = (self.cfg.inputs, self.cfg.actions);
        let rows = batch.count * WINDOW;
        let tokens = if self.current_only { 1 } else { WINDOW };
        let scale = 1.0 / (self.batch * tokens) as f64;
        for (to, from) in
            to.tokens.chunks_exact_mut(self.stride()).zip(batch.tokens.chunks_exact(inputs))
        {
            to[..inputs].copy_from_slice(from);
        }
        to.linear.copy_from_slice(&batch.linear[..to.linear.len()]);
        to.actions.copy_from_slice(&batch.actions[..rows * a]);
        to.masked.copy_from_slice(&batch.masked[..rows]);
        to.place.copy_from_slice(&batch.place[..rows]);
        for row in 0..rows {
            let counts = !self.current_only || row % WINDOW == CURRENT;
            let factor = if counts { scale * f64::from(batch.weight[row]) } else { 0.0 };
            let bin = nearest(&self.centres, &batch.actions[row * a..(row + 1) * a]);
            to.factor[row] = factor;
            // A kernel uses it as an index without a check.
            assert!(bin < self.cfg.bins, "bin {bin} of {}", self.cfg.bins);
            let masked = u32::from(batch.masked[row]);
            to.info[row] = [masked, bin as u32, (factor as f32).to_bits(), 0];
        }
    }
}

impl Host {
    /// Sums of the errors of each token, squared and focal, from the first window on.
    pub(crate) fn sums(&self, cfg: &NetConfig, errors: &[[f32; 2]]) -> Sums {
        let mut sums = Sums::default();
        let weight = offset_weight(cfg);
        for (row, (&[square, focal], factor)) in errors.iter().zip(&self.factor).enumerate() {
            let (square, focal) = (f64::from(square), f64::from(focal));
            sums.loss += factor * (weight * square + focal);
            sums.count(&self.masked, &self.place, row, square);
        }
        sums
    }
}
