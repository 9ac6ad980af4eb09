//! Inference of one window, with minimal latency.
//!
//! In the last layer, queries, outputs and the feed-forward part are computed only for tokens whose
//! actions are used, a range around the current one; the other tokens give keys and values. Weights
//! are packed once, and a step allocates no buffer. With two threads each computes some of the
//! frames. Everything except attention is computed frame by frame, so the threads meet once per
//! layer to exchange keys and values. One thread and two perform the same operations on every
//! number, so the bits are equal.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use super::batch::Batch;
use super::config::{Mixing, NetConfig, WINDOW};
use super::helper_thread::{HelperThread, until};
use super::model::{Net, place};
use super::params::LayerAt;
use robert_linalg::{
    Aligned, Init, Mat, MatMut, Packed, gemm, gemm_packed,
    simd::{self, PAD},
};

/// Frames of the first of two threads: whole tiles of rows. The second thread, which also finishes
/// the last layer, has all frames of the command.
const FIRST: usize = 24;

/// More than the layers of any network.
const BROKEN: usize = usize::MAX / 2;

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
    net: Arc<Net<f32>>,
    panels: Arc<Panels>,
    /// Frames of this thread, all that are used among them.
    own: Share,
    /// Frames of the other thread, if it takes some.
    other: Option<Other>,
}

/// The other thread's frames.
#[derive(Debug)]
struct Other {
    share: Arc<Mutex<Share>>,
    meeting: Arc<Meeting>,
    /// Started when it is first needed, since most copies of a policy never need it.
    thread: Option<HelperThread>,
}

/// Some frames of the window, and what one thread needs for them.
#[derive(Clone, Debug)]
struct Share {
    rows: Range<usize>,
    /// Tokens whose actions are used; none in a share without them.
    used: Range<usize>,
    tokens: Aligned<f32>, // (rows, inputs)
    masked: Vec<bool>,
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
        let threads = 1 + usize::from(self.other.is_some());
        let used = self.own.used.clone();
        Single::new(Arc::clone(&self.net), Arc::clone(&self.panels), used, threads)
    }
}

impl Single {
    /// Room for one window of which the tokens `used`, none of them before [`FIRST`], give actions,
    /// on `threads` (1 or 2) threads.
    pub(super) fn new(
        net: Arc<Net<f32>>,
        panels: Arc<Panels>,
        used: Range<usize>,
        threads: usize,
    ) -> Single {
        assert!(used.start >= FIRST && used.end <= WINDOW, "{used:?}");
        let cfg = &net.cfg;
        // Without attention the threads have nothing to exchange and would never meet.
        if threads < 2 || cfg.mixing == Mixing::None {
            return Single { own: Share::new(cfg, 0..WINDOW, used), other: None, net, panels };
        }
        let other = Other {
            share: Arc::new(Mutex::new(Share::new(cfg, 0..FIRST, 0..0))),
            meeting: Arc::new(Meeting::new(cfg.width)),
            thread: None,
        };
        Single { own: Share::new(cfg, FIRST..WINDOW, used), other: Some(other), net, panels }
    }

    /// Head output of the tokens used, (used, outputs).
    pub(super) fn run(&mut self, batch: &Batch<f32>) -> &[f32] {
        if let Some(other) = &mut self.other
            && let Err(e) = other.ready(&self.net, &self.panels)
        {
            tracing::warn!("cannot start a second thread: {e}");
            let (net, panels) = (Arc::clone(&self.net), Arc::clone(&self.panels));
            *self = Single::new(net, panels, self.own.used.clone(), 1);
        }
        self.own.take(&self.net.cfg, batch);
        let Some(Other { share, meeting, thread: Some(thread) }) = &self.other else {
            self.own.run(&self.net, &self.panels, None);
            return &self.own.out;
        };
        share.lock().unwrap_or_else(PoisonError::into_inner).take(&self.net.cfg, batch);
        meeting.begin();
        thread.call();
        self.own.run(&self.net, &self.panels, Some(meeting));
        assert!(!meeting.broken(), "the second thread of a policy panicked");
        &self.own.out
    }
}

impl Other {
    /// Starts the thread if it does not run yet.
    fn ready(&mut self, net: &Arc<Net<f32>>, panels: &Arc<Panels>) -> std::io::Result<()> {
        if self.thread.is_none() {
            let (net, panels) = (Arc::clone(net), Arc::clone(panels));
            let (share, meeting) = (Arc::clone(&self.share), Arc::clone(&self.meeting));
            self.thread = Some(HelperThread::start(move || {
                let mut share = share.lock().unwrap_or_else(PoisonError::into_inner);
                share.run(&net, &panels, Some(&meeting));
            })?);
        }
        Ok(())
    }
}

/// The meeting point of the two threads of a window.
#[derive(Debug)]
struct Meeting {
    /// Keys and values that the threads exchange, for even and odd layers separately, so that
    /// neither overwrites values that the other still reads.
    handed: [[Mutex<Aligned<f32>>; 2]; 2],
    met: AtomicUsize,
}

impl Meeting {
    fn new(width: usize) -> Meeting {
        let room = |rows: usize| Mutex::new(Aligned::zeros(rows * 2 * width));
        let side = || [room(FIRST), room(WINDOW - FIRST)];
        Meeting { handed: [side(), side()], met: AtomicUsize::new(0) }
    }

    /// Resets it before a window.
    fn begin(&self) {
        self.met.store(0, Ordering::Release);
    }

    /// Whether the other thread panicked.
    fn broken(&self) -> bool {
        self.met.load(Ordering::Acquire) >= BROKEN
    }

    /// Gives the keys and values of `share` to the other thread and takes its own.
    fn exchange(&self, layer: usize, share: &mut Share, width: usize) {
        let [first, second] = &self.handed[layer % 2];
        let lock = |m| Mutex::lock(m).unwrap_or_else(PoisonError::into_inner);
        let edge = FIRST * width;
        let leads = share.rows.start == 0;
        let (before, after) = share.pair.split_at_mut(edge);
        let (mine, to, theirs, from) =
            if leads { (before, first, after, second) } else { (after, second, before, first) };
        lock(to).copy_from_slice(mine);
        self.met.fetch_add(1, Ordering::AcqRel);
        until(|| self.met.load(Ordering::Acquire) >= 2 * (layer + 1));
        theirs.copy_from_slice(&lock(from));
    }
}

/// Wakes the other thread when this one panics.
struct Present<'a>(Option<&'a Meeting>);

impl Drop for Present<'_> {
    fn drop(&mut self) {
        if let (true, Some(meeting)) = (std::thread::panicking(), self.0) {
            meeting.met.store(BROKEN, Ordering::Release);
        }
    }
}

impl Share {
    fn new(cfg: &NetConfig, rows: Range<usize>, used: Range<usize>) -> Share {
        let d = cfg.width;
        let zeros = |cols: usize| Aligned::zeros(rows.len() * cols);
        Share {
            tokens: zeros(cfg.inputs),
            masked: vec![false; rows.len()],
            x: zeros(d),
            y: zeros(d),
            query: zeros(d),
            pair: Aligned::zeros(WINDOW * 2 * d),
            probs: zeros(PAD),
            mixed: zeros(d),
            wide: zeros(4 * d),
            act: zeros(4 * d),
            out: Aligned::zeros(used.len() * cfg.outputs()),
            used,
            stats: vec![[0.0; 2]; rows.len()],
            rows,
        }
    }

    /// Reads its frames of a window.
    fn take(&mut self, cfg: &NetConfig, batch: &Batch<f32>) {
        let Range { start, end } = self.rows;
        self.tokens.copy_from_slice(&batch.tokens[start * cfg.inputs..end * cfg.inputs]);
        self.masked.copy_from_slice(&batch.masked[start..end]);
    }

    fn run(&mut self, net: &Net<f32>, panels: &Panels, meeting: Option<&Meeting>) {
        let _present = Present(meeting);
        let (cfg, at, w) = (&net.cfg, &net.layout, &net.weights);
        let (d, rows, n) = (cfg.width, self.rows.clone(), self.rows.len());
        let part = |r: &Range<usize>| &w[r.clone()];
        gemm_packed(
            MatMut::new(&mut self.x, n, d),
            Init::Bias(part(&at.embed_bias)),
            Mat::new(&self.tokens, n, cfg.inputs),
            &panels.embed,
        );
        let position = &part(&at.position)[rows.start * d..];
        place(cfg, &mut self.x, &self.masked, part(&at.mask), position);
        for (l, (at, p)) in at.layers.iter().zip(&panels.layers).enumerate() {
            // In the last layer only the used tokens have queries and continue.
            let last = l + 1 == panels.layers.len();
            let (first, count) = if last {
                (self.used.start.saturating_sub(rows.start), self.used.len())
            } else {
                (0, n)
            };
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
                    meeting.exchange(l, self, 2 * d);
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
        let e = self.used.len();
        let x = &self.x[..e * d];
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
