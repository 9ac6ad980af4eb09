//! The transformer: pre-norm encoder over 51 tokens, exact GELU, learned positions and mask
//! vector, forward and backward by hand.
//!
//! The passes are written by hand because they are short, run at the speed of their matrix
//! products, and need memory only once (an [`Arena`] per thread; a step allocates nothing).
//! Rejected: the frameworks that were tried, which were 1.5 to 2.4 times slower on a CPU or lost
//! gradients silently. The model is the pre-norm encoder of Xiong et al. 2020 with the head of
//! Behaviour Transformers (Shafiullah et al. 2022).

use super::batch::Batch;
use super::config::{Mixing, NetConfig, WINDOW};
use super::head::{self, Sums};
use super::params::Layout;
use robert_linalg::{
    Aligned, Init, Mat, MatMut, Packed, Real, gemm, gemm_packed, gemm_tiled, next_of, on_threads,
    simd::{self, PAD},
};

/// A network: sizes and weights.
#[derive(Clone, Debug)]
pub struct Net<T: Real> {
    /// Sizes.
    pub cfg: NetConfig,
    /// The place of each tensor in `weights`.
    pub layout: Layout,
    /// All weights.
    pub weights: Aligned<T>,
    /// Action-bin centres, (K, A).
    pub centres: Vec<T>,
}

impl<T: Real> Net<T> {
    /// Fresh weights around these centres; without centres all are 0.
    ///
    /// # Errors
    /// [`super::Error::Config`], [`super::Error::Shape`].
    pub fn init(cfg: NetConfig, centres: Option<Vec<T>>, seed: u64) -> Result<Self, super::Error> {
        cfg.check()?;
        let layout = Layout::new(&cfg);
        let weights = layout.init(&cfg, seed);
        let want = cfg.bins * cfg.actions;
        let centres = centres.unwrap_or_else(|| vec![T::default(); want]);
        if centres.len() != want {
            return Err(super::Error::Shape { what: "centres", want, got: centres.len() });
        }
        Ok(Net { cfg, layout, weights, centres })
    }
}

/// Weights packed for products, forward and transposed for backward.
#[derive(Clone, Debug)]
pub struct Panels<T: Real> {
    embed: Packed<T>,
    layers: Vec<LayerPanels<T>>,
    head: Packed<T>,
    head_t: Packed<T>,
}

#[derive(Clone, Debug)]
struct LayerPanels<T: Real> {
    qkv: Packed<T>,
    out: Packed<T>,
    up: Packed<T>,
    down: Packed<T>,
    qkv_t: Packed<T>,
    out_t: Packed<T>,
    up_t: Packed<T>,
    down_t: Packed<T>,
}

impl<T: Real> Panels<T> {
    /// Packs all weights of `net`.
    pub fn new(net: &Net<T>) -> Self {
        let empty = || LayerPanels {
            qkv: Packed::default(),
            out: Packed::default(),
            up: Packed::default(),
            down: Packed::default(),
            qkv_t: Packed::default(),
            out_t: Packed::default(),
            up_t: Packed::default(),
            down_t: Packed::default(),
        };
        let mut panels = Panels {
            embed: Packed::default(),
            layers: (0..net.cfg.layers).map(|_| empty()).collect(),
            head: Packed::default(),
            head_t: Packed::default(),
        };
        panels.refresh(net, 1);
        panels
    }

    /// Packs again after the weights changed, on this many threads.
    pub fn refresh(&mut self, net: &Net<T>, threads: usize) {
        let (cfg, at, w) = (&net.cfg, &net.layout, &net.weights);
        let (d, k) = (cfg.width, cfg.outputs());
        self.embed.pack_tiled(Mat::new(&w[at.embed_weight.clone()], cfg.inputs, d));
        let head = Mat::new(&w[at.head_weight.clone()], d, k);
        self.head.pack_tiled(head);
        self.head_t.pack_tiled(head.t());
        let pack = |(panels, at): (&mut LayerPanels<T>, &super::params::LayerAt)| {
            let pair = |to: &mut Packed<T>, to_t: &mut Packed<T>, m: Mat<'_, T>| {
                to.pack_tiled(m);
                to_t.pack_tiled(m.t());
            };
            if cfg.mixing == Mixing::Attention {
                let qkv = Mat::new(&w[at.qkv_weight.clone()], d, 3 * d);
                pair(&mut panels.qkv, &mut panels.qkv_t, qkv);
                pair(&mut panels.out, &mut panels.out_t, Mat::new(&w[at.out_weight.clone()], d, d));
            }
            pair(&mut panels.up, &mut panels.up_t, Mat::new(&w[at.up_weight.clone()], d, 4 * d));
            pair(
                &mut panels.down,
                &mut panels.down_t,
                Mat::new(&w[at.down_weight.clone()], 4 * d, d),
            );
        };
        let jobs = self.layers.iter_mut().zip(&at.layers);
        if threads <= 1 {
            jobs.for_each(pack);
            return;
        }
        let queue = std::sync::Mutex::new(jobs);
        on_threads(threads, |_| {
            while let Some(job) = next_of(&queue) {
                pack(job);
            }
        });
    }
}

/// Activations of one micro-batch, kept for the backward pass. Allocated once.
#[derive(Clone, Debug)]
pub struct Arena<T: Real> {
    count: usize,
    /// Residual stream: after the embedding, then after each half layer. (R, d)
    stream: Vec<Aligned<T>>,
    layers: Vec<LayerArena<T>>,
    last: Normed<T>,
    /// Head output, then its gradient. (R, outputs)
    pub(super) out: Aligned<T>,
    // Backward only.
    d_stream: Aligned<T>, // (R, d)
    d_small: Aligned<T>,  // (R, d)
    d_wide: Aligned<T>,   // (R, 4d)
    d_scores: Aligned<T>, // (T, PAD)
}

#[derive(Clone, Debug)]
struct Normed<T: Real> {
    y: Aligned<T>,      // (R, d)
    stats: Vec<[T; 2]>, // (R)
}

#[derive(Clone, Debug)]
struct LayerArena<T: Real> {
    ln1: Normed<T>,
    qkv: Aligned<T>,   // (R, 3d)
    probs: Aligned<T>, // (B, heads, T, PAD)
    mixed: Aligned<T>, // (R, d)
    ln2: Normed<T>,
    slope: Aligned<T>, // (R, 4d), derivative of the activation
    act: Aligned<T>,   // (R, 4d)
}

impl<T: Real> Arena<T> {
    /// Room for micro-batches of `count` windows.
    pub fn new(cfg: &NetConfig, count: usize) -> Self {
        let (d, rows) = (cfg.width, count * WINDOW);
        let normed =
            || Normed { y: Aligned::zeros(rows * d), stats: vec![[T::default(); 2]; rows] };
        let layer = || LayerArena {
            ln1: normed(),
            qkv: Aligned::zeros(rows * 3 * d),
            probs: Aligned::zeros(count * cfg.heads * WINDOW * PAD),
            mixed: Aligned::zeros(rows * d),
            ln2: normed(),
            slope: Aligned::zeros(rows * 4 * d),
            act: Aligned::zeros(rows * 4 * d),
        };
        Arena {
            count,
            stream: (0..=2 * cfg.layers).map(|_| Aligned::zeros(rows * d)).collect(),
            layers: (0..cfg.layers).map(|_| layer()).collect(),
            last: normed(),
            out: Aligned::zeros(rows * cfg.outputs()),
            d_stream: Aligned::zeros(rows * d),
            d_small: Aligned::zeros(rows * d),
            d_wide: Aligned::zeros(rows * 4 * d),
            d_scores: Aligned::zeros(WINDOW * PAD),
        }
    }
}

/// Runs the network; the head's raw output is in the arena afterwards, (B, 51, outputs).
///
/// # Panics
/// When the batch is larger than the arena.
pub fn forward<T: Real>(net: &Net<T>, panels: &Panels<T>, batch: &Batch<T>, arena: &mut Arena<T>) {
    assert!(batch.count <= arena.count, "a batch larger than its arena");
    let (cfg, at, w) = (&net.cfg, &net.layout, &net.weights);
    let (d, rows) = (cfg.width, batch.count * WINDOW);
    let part = |r: &std::ops::Range<usize>| &w[r.clone()];

    debug_assert_eq!(arena.layers.len(), at.layers.len(), "the arena of another network");
    let first = &mut arena.stream[0];
    gemm_packed(
        MatMut::new(first, rows, d),
        Init::Bias(part(&at.embed_bias)),
        Mat::new(&batch.tokens, rows, cfg.inputs),
        &panels.embed,
    );
    place(cfg, first, &batch.masked, part(&at.mask), part(&at.position));

    for (l, ((at, panels), a)) in
        at.layers.iter().zip(&panels.layers).zip(&mut arena.layers).enumerate()
    {
        let [x1, x2, x3] = &mut arena.stream[2 * l..2 * l + 3] else { unreachable!() };
        let n = rows * d;

        if cfg.mixing == Mixing::Attention {
            normalise(x1, &mut a.ln1, part(&at.ln1_weight), part(&at.ln1_bias), n);
            gemm_packed(
                MatMut::new(&mut a.qkv, rows, 3 * d),
                Init::Bias(part(&at.qkv_bias)),
                Mat::new(&a.ln1.y, rows, d),
                &panels.qkv,
            );
            attend(cfg, batch.count, &a.qkv, &mut a.probs, &mut a.mixed);
            gemm_packed(
                MatMut::new(x2, rows, d),
                Init::Residual(part(&at.out_bias), x1),
                Mat::new(&a.mixed, rows, d),
                &panels.out,
            );
        } else {
            x2[..n].copy_from_slice(&x1[..n]);
        }

        normalise(x2, &mut a.ln2, part(&at.ln2_weight), part(&at.ln2_bias), n);
        gemm_packed(
            MatMut::new(&mut a.slope, rows, 4 * d),
            Init::Bias(part(&at.up_bias)),
            Mat::new(&a.ln2.y, rows, d),
            &panels.up,
        );
        simd::gelu(&mut a.slope[..4 * n], &mut a.act[..4 * n]);
        gemm_packed(
            MatMut::new(x3, rows, d),
            Init::Residual(part(&at.down_bias), x2),
            Mat::new(&a.act, rows, 4 * d),
            &panels.down,
        );
    }

    let last = &arena.stream[2 * at.layers.len()];
    normalise(last, &mut arena.last, part(&at.norm_weight), part(&at.norm_bias), rows * d);
    gemm_packed(
        MatMut::new(&mut arena.out, rows, cfg.outputs()),
        Init::Bias(part(&at.head_bias)),
        Mat::new(&arena.last.y, rows, d),
        &panels.head,
    );
}

/// Adds mask vector and positions to the embedded frames.
pub(super) fn place<T: Real>(
    cfg: &NetConfig,
    x: &mut [T],
    masked: &[bool],
    mask: &[T],
    position: &[T],
) {
    let d = cfg.width;
    for (row, (x, &masked)) in x.chunks_exact_mut(d).zip(masked).enumerate() {
        if masked && cfg.mask_replaces {
            x.copy_from_slice(mask);
        } else if masked {
            simd::add(x, mask);
        }
        let i = row % WINDOW;
        simd::add(x, &position[i * d..][..d]);
    }
}

fn normalise<T: Real>(x: &[T], to: &mut Normed<T>, weight: &[T], bias: &[T], n: usize) {
    simd::layer_norm(&x[..n], weight, bias, &mut to.y[..n], &mut to.stats);
}

/// Softmax attention of every head of every window.
pub(super) fn attend<T: Real>(
    cfg: &NetConfig,
    count: usize,
    qkv: &[T],
    probs: &mut [T],
    mixed: &mut [T],
) {
    let (d, h) = (cfg.width, cfg.width / cfg.heads);
    let scale = T::of(1.0 / (h as f64).sqrt());
    let heads = (0..count).flat_map(|b| (0..cfg.heads).map(move |i| (b, i)));
    for ((b, i), p) in heads.zip(probs.chunks_exact_mut(WINDOW * PAD)) {
        let (q, k, v) = qkv_of(qkv, b, i, d, h);
        gemm(MatMut::strided(p, WINDOW, WINDOW, PAD), Init::Zero, q, k.t());
        simd::softmax(p, WINDOW, scale);
        let to = &mut mixed[b * WINDOW * d + i * h..];
        gemm(
            MatMut::strided(to, WINDOW, h, d),
            Init::Zero,
            Mat::strided(p, WINDOW, WINDOW, PAD),
            v,
        );
    }
}

fn qkv_of<T: Real>(
    qkv: &[T],
    window: usize,
    head: usize,
    d: usize,
    h: usize,
) -> (Mat<'_, T>, Mat<'_, T>, Mat<'_, T>) {
    let at = |part: usize| {
        let from = &qkv[window * WINDOW * 3 * d + part * d + head * h..];
        Mat::strided(from, WINDOW, h, 3 * d)
    };
    (at(0), at(1), at(2))
}

/// Loss of the batch after [`forward`], without a gradient.
pub fn score<T: Real>(
    net: &Net<T>,
    batch: &Batch<T>,
    arena: &mut Arena<T>,
    scale: f64,
    current_only: bool,
) -> Sums {
    let out = &mut arena.out[..batch.count * WINDOW * net.cfg.outputs()];
    head::loss(&net.cfg, &net.centres, batch, out, scale, current_only)
}

/// Loss of the batch and its gradient, added to `grads` (laid out as the weights).
///
/// `scale` is the factor of each token's loss, 1 over the tokens of the whole step.
pub fn backward<T: Real>(
    net: &Net<T>,
    panels: &Panels<T>,
    batch: &Batch<T>,
    arena: &mut Arena<T>,
    grads: &mut [T],
    scale: f64,
    current_only: bool,
) -> Sums {
    let (cfg, at, w) = (&net.cfg, &net.layout, &net.weights);
    let (d, rows, k) = (cfg.width, batch.count * WINDOW, cfg.outputs());
    let n = rows * d;
    let sums =
        head::loss(cfg, &net.centres, batch, &mut arena.out[..rows * k], scale, current_only);

    let d_out = &arena.out[..rows * k];
    weight_grad(grads, &at.head_weight, &at.head_bias, &arena.last.y, d_out, rows, d, k);
    gemm_packed(
        MatMut::new(&mut arena.d_small, rows, d),
        Init::Zero,
        Mat::new(d_out, rows, k),
        &panels.head_t,
    );
    let dx = &mut arena.d_stream[..n];
    dx.fill(T::default());
    let Some(last) = arena.stream.last() else { return sums };
    normalise_back(
        &arena.d_small[..n],
        &last[..n],
        &arena.last.stats,
        w,
        &at.norm_weight,
        &at.norm_bias,
        dx,
        grads,
    );

    for (l, ((at, panels), a)) in
        at.layers.iter().zip(&panels.layers).zip(&mut arena.layers).enumerate().rev()
    {
        let (x1, x2) = (&arena.stream[2 * l][..n], &arena.stream[2 * l + 1][..n]);

        // Feed-forward half: dx is the gradient of its output and of its residual.
        weight_grad(grads, &at.down_weight, &at.down_bias, &a.act, dx, rows, 4 * d, d);
        gemm_packed(
            MatMut::new(&mut arena.d_wide, rows, 4 * d),
            Init::Times(&a.slope),
            Mat::new(dx, rows, d),
            &panels.down_t,
        );
        let wide = &arena.d_wide[..4 * n];
        weight_grad(grads, &at.up_weight, &at.up_bias, &a.ln2.y, wide, rows, d, 4 * d);
        gemm_packed(
            MatMut::new(&mut arena.d_small, rows, d),
            Init::Zero,
            Mat::new(wide, rows, 4 * d),
            &panels.up_t,
        );
        let small = &arena.d_small[..n];
        normalise_back(small, x2, &a.ln2.stats, w, &at.ln2_weight, &at.ln2_bias, dx, grads);

        if cfg.mixing == Mixing::None {
            continue;
        }
        // Attention half.
        weight_grad(grads, &at.out_weight, &at.out_bias, &a.mixed, dx, rows, d, d);
        gemm_packed(
            MatMut::new(&mut arena.d_small, rows, d),
            Init::Zero,
            Mat::new(dx, rows, d),
            &panels.out_t,
        );
        let d_qkv = &mut arena.d_wide[..3 * n];
        attend_back(cfg, batch.count, &a.qkv, &a.probs, &arena.d_small, d_qkv, &mut arena.d_scores);
        weight_grad(grads, &at.qkv_weight, &at.qkv_bias, &a.ln1.y, d_qkv, rows, d, 3 * d);
        gemm_packed(
            MatMut::new(&mut arena.d_small, rows, d),
            Init::Zero,
            Mat::new(d_qkv, rows, 3 * d),
            &panels.qkv_t,
        );
        let small = &arena.d_small[..n];
        normalise_back(small, x1, &a.ln1.stats, w, &at.ln1_weight, &at.ln1_bias, dx, grads);
    }

    // Embedding: positions and mask vector see the gradient first.
    for (row, (dx, &masked)) in dx.chunks_exact_mut(d).zip(&batch.masked).enumerate() {
        let i = row % WINDOW;
        simd::add(&mut grads[at.position.clone()][i * d..][..d], dx);
        if masked {
            simd::add(&mut grads[at.mask.clone()], dx);
            if cfg.mask_replaces {
                dx.fill(T::default());
            }
        }
    }
    let (inputs, tokens) = (cfg.inputs, &batch.tokens);
    weight_grad(grads, &at.embed_weight, &at.embed_bias, tokens, dx, rows, inputs, d);
    sums
}

/// Adds xᵀ dy to a weight and the column sums of dy to its bias.
fn weight_grad<T: Real>(
    grads: &mut [T],
    weight: &std::ops::Range<usize>,
    bias: &std::ops::Range<usize>,
    x: &[T],
    dy: &[T],
    rows: usize,
    inputs: usize,
    outputs: usize,
) {
    gemm_tiled(
        MatMut::new(&mut grads[weight.clone()], inputs, outputs),
        Init::Add,
        Mat::new(x, rows, inputs).t(),
        Mat::new(dy, rows, outputs),
    );
    simd::add_columns(&dy[..rows * outputs], &mut grads[bias.clone()]);
}

fn normalise_back<T: Real>(
    dy: &[T],
    x: &[T],
    stats: &[[T; 2]],
    w: &[T],
    weight: &std::ops::Range<usize>,
    bias: &std::ops::Range<usize>,
    dx: &mut [T],
    grads: &mut [T],
) {
    // The layout puts a norm's bias after its weight.
    let (low, high) = grads.split_at_mut(bias.start);
    let (d_weight, d_bias) = (&mut low[weight.clone()], &mut high[..bias.len()]);
    simd::layer_norm_back(dy, x, stats, &w[weight.clone()], dx, d_weight, d_bias);
}

fn attend_back<T: Real>(
    cfg: &NetConfig,
    count: usize,
    qkv: &[T],
    probs: &[T],
    d_mixed: &[T],
    d_qkv: &mut [T],
    d_scores: &mut [T],
) {
    let (d, h) = (cfg.width, cfg.width / cfg.heads);
    let scale = T::of(1.0 / (h as f64).sqrt());
    let heads = (0..count).flat_map(|b| (0..cfg.heads).map(move |i| (b, i)));
    for ((b, i), p) in heads.zip(probs.chunks_exact(WINDOW * PAD)) {
        let (q, k, v) = qkv_of(qkv, b, i, d, h);
        let dy = Mat::strided(&d_mixed[b * WINDOW * d + i * h..], WINDOW, h, d);
        let to = |part: usize| b * WINDOW * 3 * d + part * d + i * h;
        let weights = Mat::strided(p, WINDOW, WINDOW, PAD);
        gemm(MatMut::strided(&mut d_qkv[to(2)..], WINDOW, h, 3 * d), Init::Zero, weights.t(), dy);
        gemm(MatMut::strided(d_scores, WINDOW, WINDOW, PAD), Init::Zero, dy, v.t());
        simd::softmax_back(p, d_scores, scale);
        let scores = Mat::strided(d_scores, WINDOW, WINDOW, PAD);
        gemm(MatMut::strided(&mut d_qkv[to(0)..], WINDOW, h, 3 * d), Init::Zero, scores, k);
        gemm(MatMut::strided(&mut d_qkv[to(1)..], WINDOW, h, 3 * d), Init::Zero, scores.t(), q);
    }
}
