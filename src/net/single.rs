//! One window through the network: batch 1, as short as it can be.
//!
//! Only the tokens whose actions are used pass through the last layer's queries, outputs
//! and feed-forward part; the others give keys and values. Weights are packed once, and no
//! buffer is made in a step. With two threads each takes some of the frames: all but
//! attention goes frame by frame, so they meet once a layer, to hand over keys and values.
//! Every number is the same chain of operations either way, and so are its bits.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use super::config::{CURRENT, Mixing, NetConfig, WINDOW};
use super::mat::{Init, Mat, MatMut, Packed, gemm, gemm_packed};
use super::model::{Batch, Net, place};
use super::params::LayerAt;
use super::real::Aligned;
use super::simd::{self, PAD};

/// Frames of the first of two threads: whole tiles of rows, and the second one, which also
/// finishes the last layer, has all the frames of the command.
const FIRST: usize = 24;
/// Rounds of waiting before a thread that waits for the other lets someone else run.
const SPINS: u32 = 500;

/// Weights packed for products.
#[derive(Debug)]
pub(super) struct Panels {
    embed: Packed<f32>,
    layers: Vec<LayerPanels>,
    head: Packed<f32>,
}

#[derive(Debug, Default)]
struct LayerPanels {
    query: Packed<f32>,
    /// Keys and values.
    pair: Packed<f32>,
    out: Packed<f32>,
    up: Packed<f32>,
    down: Packed<f32>,
}

/// Buffers of one window.
#[derive(Debug)]
pub(super) struct Single {
    shares: Vec<Share>,
    /// Keys and values that each share hands to the other, for layers of even and odd
    /// number: nobody overwrites what the other may still be reading.
    handed: [Vec<Mutex<Aligned<f32>>>; 2],
    met: AtomicUsize,
}

/// Some frames of the window, and what one thread needs for them.
#[derive(Clone, Debug)]
struct Share {
    rows: Range<usize>,
    /// Tokens whose actions are used, from the current one on; 0 in a share without them.
    used: usize,
    x: Aligned<f32>,     // (rows, d), residual stream
    y: Aligned<f32>,     // (rows, d)
    query: Aligned<f32>, // (rows, d)
    pair: Aligned<f32>,  // (51, 2d), keys and values of every frame
    probs: Aligned<f32>, // (rows, PAD)
    mixed: Aligned<f32>, // (rows, d)
    wide: Aligned<f32>,  // (rows, 4d)
    act: Aligned<f32>,   // (rows, 4d)
    out: Aligned<f32>,   // (used, outputs)
    stats: Vec<[f32; 2]>,
}

impl Clone for Single {
    fn clone(&self) -> Self {
        let len = |m: &Mutex<Aligned<f32>>| m.lock().map_or(0, |x| x.len());
        let copy = |side: &Vec<Mutex<Aligned<f32>>>| {
            side.iter().map(|m| Mutex::new(Aligned::zeros(len(m)))).collect()
        };
        let [even, odd] = &self.handed;
        Single {
            shares: self.shares.clone(),
            handed: [copy(even), copy(odd)],
            met: AtomicUsize::new(0),
        }
    }
}

impl Single {
    /// Room for one window of which `used` tokens from the current one on give actions, on
    /// `threads` (1 or 2) threads.
    pub(super) fn new(cfg: &NetConfig, used: usize, threads: usize) -> Single {
        let d = cfg.width;
        let share = |rows: Range<usize>| {
            let used = if rows.end == WINDOW { used } else { 0 };
            let zeros = |cols: usize| Aligned::zeros(rows.len() * cols);
            Share {
                used,
                x: zeros(d),
                y: zeros(d),
                query: zeros(d),
                pair: Aligned::zeros(WINDOW * 2 * d),
                probs: zeros(PAD),
                mixed: zeros(d),
                wide: zeros(4 * d),
                act: zeros(4 * d),
                out: Aligned::zeros(used * cfg.outputs()),
                stats: vec![[0.0; 2]; rows.len()],
                rows,
            }
        };
        let edges: &[usize] = if threads > 1 { &[0, FIRST, WINDOW] } else { &[0, WINDOW] };
        let shares: Vec<Share> = edges.windows(2).map(|e| share(e[0]..e[1])).collect();
        let side = || {
            let handed = |s: &Share| Mutex::new(Aligned::zeros(s.rows.len() * 2 * d));
            shares.iter().map(handed).collect()
        };
        Single { handed: [side(), side()], met: AtomicUsize::new(0), shares }
    }

    /// Head output of the tokens used, (used, outputs).
    pub(super) fn run(&mut self, net: &Net<f32>, panels: &Panels, batch: &Batch<f32>) -> &[f32] {
        self.met.store(0, Ordering::Relaxed);
        let meeting = Meeting { handed: &self.handed, met: &self.met };
        if let [share] = &mut self.shares[..] {
            share.run(0, net, panels, batch, None);
        } else {
            std::thread::scope(|scope| {
                let meeting = &meeting;
                let mut shares = self.shares.iter_mut().enumerate();
                let own = shares.next_back();
                for (i, share) in shares {
                    scope.spawn(move || share.run(i, net, panels, batch, Some(meeting)));
                }
                if let Some((i, share)) = own {
                    share.run(i, net, panels, batch, Some(meeting));
                }
            });
        }
        self.shares.last().map_or(&[], |share| &share.out)
    }
}

/// Where threads that share a window meet.
struct Meeting<'a> {
    handed: &'a [Vec<Mutex<Aligned<f32>>>; 2],
    met: &'a AtomicUsize,
}

impl Meeting<'_> {
    /// Hands over the keys and values of `share` and takes those of the others.
    fn exchange(&self, layer: usize, index: usize, share: &mut Share, width: usize) {
        let side = &self.handed[layer % 2];
        let lock = |m| Mutex::lock(m).unwrap_or_else(PoisonError::into_inner);
        let own = share.rows.start * width..share.rows.end * width;
        lock(&side[index]).copy_from_slice(&share.pair[own.clone()]);
        self.met.fetch_add(1, Ordering::AcqRel);
        let everyone = side.len() * (layer + 1);
        let mut spins = 0;
        while self.met.load(Ordering::Acquire) < everyone {
            if spins < SPINS {
                spins += 1;
                std::hint::spin_loop();
            } else {
                std::thread::yield_now();
            }
        }
        let (before, from) = share.pair.split_at_mut(own.start);
        let after = &mut from[own.len()..];
        for (i, m) in side.iter().enumerate() {
            match i.cmp(&index) {
                std::cmp::Ordering::Less => before.copy_from_slice(&lock(m)),
                std::cmp::Ordering::Equal => {}
                std::cmp::Ordering::Greater => after.copy_from_slice(&lock(m)),
            }
        }
    }
}

/// Lets nobody wait for a thread that panicked.
struct Present<'a>(Option<&'a Meeting<'a>>);

impl Drop for Present<'_> {
    fn drop(&mut self) {
        if let (true, Some(meeting)) = (std::thread::panicking(), self.0) {
            meeting.met.store(usize::MAX / 2, Ordering::Release);
        }
    }
}

impl Share {
    fn run(
        &mut self,
        index: usize,
        net: &Net<f32>,
        panels: &Panels,
        batch: &Batch<f32>,
        meeting: Option<&Meeting<'_>>,
    ) {
        let _present = Present(meeting);
        let (cfg, at, w) = (&net.cfg, &net.layout, &net.weights);
        let (d, rows, n) = (cfg.width, self.rows.clone(), self.rows.len());
        let part = |r: &Range<usize>| &w[r.clone()];
        gemm_packed(
            MatMut::new(&mut self.x, n, d),
            Init::Bias(part(&at.embed_bias)),
            Mat::new(&batch.tokens[rows.start * cfg.inputs..], n, cfg.inputs),
            &panels.embed,
        );
        let position = &part(&at.position)[rows.start * d..];
        place(cfg, &mut self.x, &batch.masked[rows.clone()], part(&at.mask), position);
        for (l, (at, p)) in at.layers.iter().zip(&panels.layers).enumerate() {
            // In the last layer only the tokens used ask, and only they go on.
            let last = l + 1 == panels.layers.len();
            let (first, count) =
                if last { (CURRENT.max(rows.start) - rows.start, self.used) } else { (0, n) };
            if cfg.mixing == Mixing::Attention {
                let [weight, bias] = [part(&at.ln1_weight), part(&at.ln1_bias)];
                simd::layer_norm(&self.x, weight, bias, &mut self.y, &mut self.stats);
                gemm_packed(
                    MatMut::new(&mut self.pair[rows.start * 2 * d..], n, 2 * d),
                    Init::Bias(&part(&at.qkv_bias)[d..]),
                    Mat::new(&self.y, n, d),
                    &p.pair,
                );
                if let Some(meeting) = meeting {
                    meeting.exchange(l, index, self, 2 * d);
                }
            }
            if count == 0 {
                return;
            }
            if cfg.mixing == Mixing::Attention {
                gemm_packed(
                    MatMut::new(&mut self.query, count, d),
                    Init::Bias(&part(&at.qkv_bias)[..d]),
                    Mat::new(&self.y[first * d..], count, d),
                    &p.query,
                );
                self.attend(cfg, count);
            }
            if first > 0 {
                self.x.copy_within(first * d..(first + count) * d, 0);
            }
            if cfg.mixing == Mixing::Attention {
                gemm_packed(
                    MatMut::new(&mut self.x, count, d),
                    Init::AddBias(part(&at.out_bias)),
                    Mat::new(&self.mixed, count, d),
                    &p.out,
                );
            }
            self.feed_forward(net, at, p, count);
        }
        let (e, x) = (self.used, &self.x[..self.used * d]);
        let y = &mut self.y[..e * d];
        simd::layer_norm(x, part(&at.norm_weight), part(&at.norm_bias), y, &mut self.stats);
        gemm_packed(
            MatMut::new(&mut self.out, e, cfg.outputs()),
            Init::Bias(part(&at.head_bias)),
            Mat::new(y, e, d),
            &panels.head,
        );
    }

    /// Softmax attention of the first `count` queries over all frames, into `mixed`.
    fn attend(&mut self, cfg: &NetConfig, count: usize) {
        let (d, h) = (cfg.width, cfg.width / cfg.heads);
        let scale = 1.0 / (h as f32).sqrt();
        for i in 0..cfg.heads {
            let keys = Mat::strided(&self.pair[i * h..], WINDOW, h, 2 * d);
            let values = Mat::strided(&self.pair[d + i * h..], WINDOW, h, 2 * d);
            let q = Mat::strided(&self.query[i * h..], count, h, d);
            let p = &mut self.probs[..count * PAD];
            gemm(MatMut::strided(p, count, WINDOW, PAD), Init::Zero, q, keys.t());
            simd::softmax(p, WINDOW, scale);
            let p = Mat::strided(p, count, WINDOW, PAD);
            let to = MatMut::strided(&mut self.mixed[i * h..], count, h, d);
            gemm(to, Init::Zero, p, values);
        }
    }

    /// The feed-forward half of a layer for the first `count` rows.
    fn feed_forward(&mut self, net: &Net<f32>, at: &LayerAt, p: &LayerPanels, count: usize) {
        let (d, w) = (net.cfg.width, &net.weights);
        let part = |r: &Range<usize>| &w[r.clone()];
        let Share { x, y, wide, act, stats, .. } = self;
        let (x, y) = (&mut x[..count * d], &mut y[..count * d]);
        let (wide, act) = (&mut wide[..count * 4 * d], &mut act[..count * 4 * d]);
        simd::layer_norm(x, part(&at.ln2_weight), part(&at.ln2_bias), y, stats);
        let up = Init::Bias(part(&at.up_bias));
        gemm_packed(MatMut::new(wide, count, 4 * d), up, Mat::new(y, count, d), &p.up);
        simd::gelu(wide, act);
        let down = Init::AddBias(part(&at.down_bias));
        gemm_packed(MatMut::new(x, count, d), down, Mat::new(act, count, 4 * d), &p.down);
    }
}

impl Panels {
    /// Packs the weights of `net`.
    pub(super) fn new(net: &Net<f32>) -> Self {
        let (cfg, at, w) = (&net.cfg, &net.layout, &net.weights);
        let d = cfg.width;
        let pack = |r: &Range<usize>, rows: usize, cols: usize| {
            Packed::new(Mat::new(&w[r.clone()], rows, cols))
        };
        let layer = |at: &LayerAt| {
            let all = &w[at.qkv_weight.clone()];
            let attention = if cfg.mixing == Mixing::Attention {
                LayerPanels {
                    query: Packed::new(Mat::strided(all, d, d, 3 * d)),
                    pair: Packed::new(Mat::strided(&all[d..], d, 2 * d, 3 * d)),
                    out: pack(&at.out_weight, d, d),
                    ..LayerPanels::default()
                }
            } else {
                LayerPanels::default()
            };
            LayerPanels {
                up: pack(&at.up_weight, d, 4 * d),
                down: pack(&at.down_weight, 4 * d, d),
                ..attention
            }
        };
        Panels {
            embed: pack(&at.embed_weight, cfg.inputs, d),
            layers: at.layers.iter().map(layer).collect(),
            head: pack(&at.head_weight, d, cfg.outputs()),
        }
    }
}
