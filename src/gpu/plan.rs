//! The dispatches of a step, recorded once for a fixed number of windows.

use super::attend::Attend;
use super::columns::Columns;
use super::device::{Device, Span};
use super::head::{Head, Wanted};
use super::kernel::Tape;
use super::norm::Norm;
use super::place::Place;
use super::product::{End, Product};
use super::round::Round;
use super::slots::{Slot, Slots};
use robert_net::params::LayerAt;
use robert_net::{Mixing, Net, NetConfig, SkipKind, WINDOW};

/// All kernels of a network.
#[derive(Debug)]
pub(crate) struct Kernels {
    product: Product,
    norm: Norm,
    attend: Attend,
    columns: Columns,
    place: Place,
    head: Head,
    round: Round,
}

/// A copy of the weights' layout on the card: weights, gradient, a moment, the average.
pub(crate) type Segments = Vec<Span>;

/// A step of `windows` windows: what it reads, what it leaves, and its dispatches.
#[derive(Debug)]
pub(crate) struct Plan {
    /// Windows at once.
    pub(crate) windows: usize,
    pub(crate) tokens: Span,
    pub(crate) info: Span,
    pub(crate) linear: Span,
    pub(crate) actions: Span,
    /// Output of the head, (R, stride), after `forward`.
    pub(crate) out: Span,
    /// Squared and focal error of each token, after `loss`.
    pub(crate) errors: Span,
    pub(crate) forward: Tape,
    pub(crate) loss: Tape,
    /// Adds to the gradient, `scale` times.
    pub(crate) backward: Tape,
    scale: Scale,
}

/// The factor of the gradient. A mean over many rows has small gradients, which would lose their
/// bits as factors of 16.
#[derive(Debug)]
struct Scale {
    value: f32,
    /// Parameters of the loss, which multiplies by it.
    words: [u32; 8],
    params: wgpu::Buffer,
}

impl Scale {
    fn new(gpu: &Device, cfg: &NetConfig, shape: [usize; 2]) -> Self {
        let words = Head::words(cfg, shape, 1.0);
        Scale { value: 1.0, words, params: gpu.uniform(&words) }
    }
}

/// The buffers of a layer that the backward pass needs.
struct Layer {
    x1: Span,
    x2: Span,
    ln1: Normed,
    qkv: Span,
    probs: Span,
    mixed: Span,
    ln2: Normed,
    slope: Span,
    act: Span,
}

struct Normed {
    y: Span,
    stats: Span,
}

/// Sizes that the card pads.
#[derive(Clone, Copy)]
struct Padded {
    rows: usize,
    width: usize,
    inputs: usize,
    outputs: usize,
}

impl Padded {
    fn new(cfg: &NetConfig, windows: usize) -> Self {
        Padded {
            rows: windows * WINDOW,
            width: cfg.width,
            inputs: cfg.inputs.next_multiple_of(4),
            outputs: cfg.outputs().next_multiple_of(4),
        }
    }
}

impl Kernels {
    pub(crate) fn new(gpu: &Device) -> Self {
        Kernels {
            product: Product::new(gpu),
            norm: Norm::new(gpu),
            attend: Attend::new(gpu),
            columns: Columns::new(gpu),
            place: Place::new(gpu),
            head: Head::new(gpu),
            round: Round::new(gpu),
        }
    }
}

/// Bytes of the activations of one window, with factors of `factor` bytes, and numbers of the
/// largest buffer of them.
pub(crate) fn per_window(cfg: &NetConfig, factor: u64) -> (u64, usize) {
    let p = Padded::new(cfg, 1);
    let (d, rows) = (p.width, p.rows);
    let attends = cfg.mixing == Mixing::Attention;
    let probs = if attends { cfg.heads * WINDOW * WINDOW } else { 0 };
    let bytes = |wide: usize, factors: usize| (4 * wide) as u64 + factor * factors as u64;
    let layer = if attends {
        bytes(rows * (2 * d + 4) + probs, rows * 14 * d)
    } else {
        bytes(rows * (d + 2), rows * 9 * d)
    };
    let ends = rows * (p.inputs + p.outputs + 2 * cfg.actions + 2 * d + 8);
    let ends = bytes(ends, rows * (7 * d + p.outputs));
    let most = [rows * 4 * d, rows * p.inputs, rows * p.outputs, rows * cfg.actions, probs];
    (cfg.layers as u64 * layer + ends, most.into_iter().max().unwrap_or_default())
}

/// Numbers for the slices of sums, at most `most` of them.
pub(crate) fn parts(gpu: &Device, cfg: &NetConfig, windows: usize, most: usize) -> usize {
    let p = Padded::new(cfg, windows);
    let (d, rows) = (p.width, p.rows);
    let slices = [[p.inputs, d], [d, p.outputs], [d, d], [d, 3 * d], [d, 4 * d], [4 * d, d]]
        .map(|[k, n]| Product::slices(gpu, [rows, k, n]) * k * n);
    let sums = [
        Columns::parts(rows, 4 * d),
        Columns::parts(rows, p.outputs),
        Columns::parts(windows, WINDOW * d),
    ];
    let sums = sums.into_iter().max().unwrap_or_default();
    slices.into_iter().max().unwrap_or_default().min(most).max(sums)
}

impl Plan {
    /// Allocates the activations and records the dispatches; `most` numbers fit in a binding.
    pub(crate) fn new(
        gpu: &Device,
        kernels: &Kernels,
        net: &Net<f32>,
        slots: &Slots,
        [weights, grads]: [&Segments; 2],
        [windows, most]: [usize; 2],
        scale: f32,
    ) -> Self {
        let cfg = &net.cfg;
        let p = Padded::new(cfg, windows);
        let (rows, d) = (p.rows, p.width);
        let numbers = |n: usize| gpu.buffer(4 * n as u64);
        let centres = numbers(net.centres.len());
        gpu.write(&centres, &net.centres);
        let mut plan = Plan::empty(gpu, cfg, windows);
        let last = Normed { y: gpu.factors(rows * d), stats: numbers(rows * 2) };
        let rounded = plan.round_weights(gpu, kernels, slots, weights);
        let on = [weights, &rounded];
        let (layers, end) = plan.record_forward(gpu, kernels, net, slots, on, &last);
        plan.rescale(gpu, scale);
        let wanted = Wanted {
            actions: &plan.actions,
            linear: &plan.linear,
            centres: &centres,
            info: &plan.info,
        };
        let to = [&plan.out, &plan.errors];
        plan.loss.push(kernels.head.loss(gpu, &plan.scale.params, rows, wanted, to));
        // Products of 32-bit factors take the gradients as they are.
        let rounded_copy = |n: usize| gpu.factors(if gpu.units().is_some() { n } else { 0 });
        let back = Backward {
            gpu,
            kernels,
            slots,
            weights,
            rounded: &rounded,
            grads,
            parts: numbers(parts(gpu, cfg, windows, most)),
            d_stream: numbers(rows * d),
            d_rounded: rounded_copy(rows * d),
            d_out: rounded_copy(rows * p.outputs),
            d_small: gpu.factors(rows * d),
            d_wide: gpu.factors(rows * 4 * d),
            p,
        };
        back.record(&mut plan, net, &layers, &last, &end);
        plan
    }

    /// As [`Plan::new`] without loss and gradients, for rollouts.
    pub(crate) fn forward_only(
        gpu: &Device,
        kernels: &Kernels,
        net: &Net<f32>,
        slots: &Slots,
        weights: &Segments,
        windows: usize,
    ) -> Self {
        let Padded { rows, width, .. } = Padded::new(&net.cfg, windows);
        let numbers = |n: usize| gpu.buffer(4 * n as u64);
        let mut plan = Plan::empty(gpu, &net.cfg, windows);
        let last = Normed { y: gpu.factors(rows * width), stats: numbers(rows * 2) };
        let rounded = plan.round_weights(gpu, kernels, slots, weights);
        plan.record_forward(gpu, kernels, net, slots, [weights, &rounded], &last);
        plan
    }

    /// What goes to the card and comes back, without dispatches.
    fn empty(gpu: &Device, cfg: &NetConfig, windows: usize) -> Self {
        let p = Padded::new(cfg, windows);
        let numbers = |n: usize| gpu.buffer(4 * n as u64);
        let skips = cfg.skip != SkipKind::Off;
        Plan {
            windows,
            tokens: numbers(p.rows * p.inputs),
            info: numbers(p.rows * 4),
            linear: numbers(if skips { p.rows * cfg.actions } else { 0 }),
            actions: numbers(p.rows * cfg.actions),
            out: numbers(p.rows * p.outputs),
            errors: numbers(p.rows * 2),
            forward: Tape::default(),
            loss: Tape::default(),
            backward: Tape::default(),
            scale: Scale::new(gpu, cfg, [p.rows, p.outputs]),
        }
    }

    /// The factor of the gradient.
    pub(crate) fn scale(&self) -> f32 {
        self.scale.value
    }

    /// Changes the factor of the gradient.
    pub(crate) fn rescale(&mut self, gpu: &Device, scale: f32) {
        self.scale.value = scale;
        self.scale.words[7] = scale.to_bits();
        gpu.queue.write_buffer(&self.scale.params, 0, bytemuck::cast_slice(&self.scale.words));
    }

    /// The weights as factors of products, renewed in each forward pass.
    fn round_weights(
        &mut self,
        gpu: &Device,
        kernels: &Kernels,
        slots: &Slots,
        weights: &Segments,
    ) -> Segments {
        let all = weights.iter().zip(&slots.segments);
        all.map(|(w, &n)| kernels.round.new_copy(gpu, n, w, &mut self.forward)).collect()
    }

    fn record_forward(
        &mut self,
        gpu: &Device,
        kernels: &Kernels,
        net: &Net<f32>,
        slots: &Slots,
        [weights, rounded]: [&Segments; 2],
        last: &Normed,
    ) -> (Vec<Layer>, Span) {
        let (cfg, at) = (&net.cfg, &net.layout);
        let p = Padded::new(cfg, self.windows);
        let (rows, d) = (p.rows, p.width);
        let numbers = |n: usize| gpu.buffer(4 * n as u64);
        let weight = |range: &_| span(weights, slots.of(range), 4);
        let factor = |range: &_| span(rounded, slots.of(range), gpu.factor_bytes());
        let normed = || Normed { y: gpu.factors(rows * d), stats: numbers(rows * 2) };
        let Kernels { product, norm, attend, place, .. } = kernels;
        let tape = &mut self.forward;

        let first = numbers(rows * d);
        let on = [&self.tokens, &weight(&at.embed_weight), &weight(&at.embed_bias)];
        tape.push(product.embed(gpu, [rows, p.inputs, d], on, &first));
        let places = [&weight(&at.mask), &weight(&at.position), &self.info];
        tape.push(place.forward(gpu, [rows, d], cfg.mask_replaces, places, &first));

        let mut stream = first;
        let mut layers = Vec::with_capacity(cfg.layers);
        let attends = cfg.mixing == Mixing::Attention;
        for at in &at.layers {
            let x1 = stream;
            let small = |n: usize| numbers(if attends { n } else { 0 });
            let factors = |n: usize| gpu.factors(if attends { n } else { 0 });
            let layer = Layer {
                x2: if attends { numbers(rows * d) } else { x1.clone() },
                ln1: Normed { y: factors(rows * d), stats: small(rows * 2) },
                qkv: factors(rows * 3 * d),
                probs: small(self.windows * cfg.heads * WINDOW * WINDOW),
                mixed: factors(rows * d),
                ln2: normed(),
                slope: gpu.factors(rows * 4 * d),
                act: gpu.factors(rows * 4 * d),
                x1,
            };
            if attends {
                let ln = [&weight(&at.ln1_weight), &weight(&at.ln1_bias)];
                let Normed { y, stats } = &layer.ln1;
                tape.push(norm.forward(gpu, [rows, d], &layer.x1, ln, y, stats));
                let end = End::Factors(&weight(&at.qkv_bias));
                let w = &factor(&at.qkv_weight);
                tape.push(product.forward(gpu, [rows, d, 3 * d], y, w, end, &layer.qkv));
                let shape = [self.windows, cfg.heads, d];
                tape.push(attend.forward(gpu, shape, &layer.qkv, &layer.probs, &layer.mixed));
                let end = End::Residual(&weight(&at.out_bias), &layer.x1);
                let w = &factor(&at.out_weight);
                tape.push(product.forward(gpu, [rows, d, d], &layer.mixed, w, end, &layer.x2));
            }
            let ln = [&weight(&at.ln2_weight), &weight(&at.ln2_bias)];
            let Normed { y, stats } = &layer.ln2;
            tape.push(norm.forward(gpu, [rows, d], &layer.x2, ln, y, stats));
            let end = End::Gelu(&weight(&at.up_bias), &layer.slope);
            let w = &factor(&at.up_weight);
            tape.push(product.forward(gpu, [rows, d, 4 * d], y, w, end, &layer.act));
            let x3 = numbers(rows * d);
            let end = End::Residual(&weight(&at.down_bias), &layer.x2);
            let w = &factor(&at.down_weight);
            tape.push(product.forward(gpu, [rows, 4 * d, d], &layer.act, w, end, &x3));
            layers.push(layer);
            stream = x3;
        }

        let ln = [&weight(&at.norm_weight), &weight(&at.norm_bias)];
        tape.push(norm.forward(gpu, [rows, d], &stream, ln, &last.y, &last.stats));
        let end = End::Bias(&weight(&at.head_bias));
        let w = &factor(&at.head_weight);
        tape.push(product.forward(gpu, [rows, d, p.outputs], &last.y, w, end, &self.out));
        (layers, stream)
    }
}

/// The backward pass while it is recorded.
struct Backward<'a> {
    gpu: &'a Device,
    kernels: &'a Kernels,
    slots: &'a Slots,
    weights: &'a Segments,
    /// The weights as factors of products.
    rounded: &'a Segments,
    grads: &'a Segments,
    parts: Span,
    d_stream: Span,
    /// The gradients of the stream and of the output as factors of products.
    d_rounded: Span,
    d_out: Span,
    d_small: Span,
    d_wide: Span,
    p: Padded,
}

type Range = std::ops::Range<usize>;

impl Backward<'_> {
    fn record(&self, plan: &mut Plan, net: &Net<f32>, layers: &[Layer], last: &Normed, end: &Span) {
        let (cfg, at, gpu, k) = (&net.cfg, &net.layout, self.gpu, self.kernels);
        let Padded { rows, width: d, inputs, outputs } = self.p;
        let tape = &mut plan.backward;

        let d_out = &self.rounded(tape, rows * outputs, &plan.out, &self.d_out);
        let at_head = [&at.head_weight, &at.head_bias];
        self.linear(tape, [d, outputs], [&last.y, d_out], Some(&plan.out), at_head);
        let w = &self.factor(&at.head_weight);
        let shape = [rows, d, outputs];
        tape.push(k.product.back(gpu, shape, d_out, w, End::Store, &self.d_small));
        self.normed(tape, end, &last.stats, [&at.norm_weight, &at.norm_bias], false);

        for (at, layer) in at.layers.iter().zip(layers).rev() {
            self.layer(tape, cfg, at, layer, plan.windows);
        }

        // Embedding: positions and mask vector see the gradient first.
        let dx = &self.d_stream;
        let to = &self.grad(&at.position);
        let shape = [plan.windows, WINDOW * d];
        tape.extend(k.columns.plain(gpu, &k.product, shape, dx, &self.parts, to));
        let to = &self.grad(&at.mask);
        let on = [dx, &plan.info];
        tape.extend(k.columns.masked(gpu, &k.product, [rows, d], on, &self.parts, to));
        if cfg.mask_replaces {
            tape.push(k.place.back(gpu, [rows, d], &plan.info, dx));
        }
        let to = &self.grad(&at.embed_weight);
        let on = [&plan.tokens, dx];
        let shape = [rows, inputs, d];
        tape.extend(k.product.weight(gpu, shape, true, on, &self.parts, to));
        let to = &self.grad(&at.embed_bias);
        tape.extend(k.columns.plain(gpu, &k.product, [rows, d], dx, &self.parts, to));
    }

    /// A copy as factors of products, or the numbers themselves.
    fn rounded(&self, tape: &mut Tape, n: usize, x: &Span, copy: &Span) -> Span {
        let step = self.kernels.round.copy(self.gpu, n, x, copy);
        let rounds = step.is_some();
        tape.extend(step);
        if rounds { copy.clone() } else { x.clone() }
    }

    fn layer(&self, tape: &mut Tape, cfg: &NetConfig, at: &LayerAt, l: &Layer, windows: usize) {
        let (gpu, product, d) = (self.gpu, &self.kernels.product, self.p.width);
        let rows = self.p.rows;
        let Backward { d_stream: dx, d_small: small, d_wide: wide, .. } = self;

        // Feed-forward half: dx is the gradient of its output and of its residual.
        let dy = &self.rounded(tape, rows * d, dx, &self.d_rounded);
        let at_down = [&at.down_weight, &at.down_bias];
        self.linear(tape, [4 * d, d], [&l.act, dy], Some(dx), at_down);
        let w = &self.factor(&at.down_weight);
        tape.push(product.back(gpu, [rows, 4 * d, d], dy, w, End::Times(&l.slope), wide));
        self.linear(tape, [d, 4 * d], [&l.ln2.y, wide], None, [&at.up_weight, &at.up_bias]);
        let w = &self.factor(&at.up_weight);
        tape.push(product.back(gpu, [rows, d, 4 * d], wide, w, End::Store, small));
        self.normed(tape, &l.x2, &l.ln2.stats, [&at.ln2_weight, &at.ln2_bias], true);
        if cfg.mixing == Mixing::None {
            return;
        }

        // Attention half.
        let dy = &self.rounded(tape, rows * d, dx, &self.d_rounded);
        self.linear(tape, [d, d], [&l.mixed, dy], Some(dx), [&at.out_weight, &at.out_bias]);
        let w = &self.factor(&at.out_weight);
        tape.push(product.back(gpu, [rows, d, d], dy, w, End::Store, small));
        let d_qkv = &wide.part(0, gpu.factor_bytes() * (rows * 3 * d) as u64);
        let shape = [windows, cfg.heads, d];
        tape.push(self.kernels.attend.back(gpu, shape, [&l.qkv, &l.probs, small], d_qkv));
        self.linear(tape, [d, 3 * d], [&l.ln1.y, d_qkv], None, [&at.qkv_weight, &at.qkv_bias]);
        let w = &self.factor(&at.qkv_weight);
        tape.push(product.back(gpu, [rows, d, 3 * d], d_qkv, w, End::Store, small));
        self.normed(tape, &l.x1, &l.ln1.stats, [&at.ln1_weight, &at.ln1_bias], true);
    }

    /// Gradients of a linear map (k, n) with input x and output gradient dy, both factors of
    /// products; `exact` is dy before rounding, where there is one.
    fn linear(
        &self,
        tape: &mut Tape,
        [k, n]: [usize; 2],
        on: [&Span; 2],
        exact: Option<&Span>,
        at: [&Range; 2],
    ) {
        let Kernels { product, columns, .. } = self.kernels;
        let (gpu, parts, rows) = (self.gpu, &self.parts, self.p.rows);
        let to = &self.grad(at[0]);
        tape.extend(product.weight(gpu, [rows, k, n], false, on, parts, to));
        let to = &self.grad(at[1]);
        tape.extend(match exact {
            Some(dy) => columns.plain(gpu, product, [rows, n], dy, parts, to),
            None => columns.factors(gpu, product, [rows, n], on[1], parts, to),
        });
    }

    /// A norm whose output has the gradient `d_small`: its weights', and that of its input.
    fn normed(&self, tape: &mut Tape, x: &Span, stats: &Span, at: [&Range; 2], add: bool) {
        let Kernels { product, columns, norm, .. } = self.kernels;
        let shape = [self.p.rows, self.p.width];
        let to = [&self.grad(at[0]), &self.grad(at[1])];
        let on = [&self.d_small, x, stats];
        tape.extend(columns.norm(self.gpu, product, shape, on, &self.parts, to));
        let on = [&self.d_small, x, stats, &self.weight(at[0])];
        tape.push(norm.back(self.gpu, shape, on, &self.d_stream, add));
    }

    fn weight(&self, range: &Range) -> Span {
        span(self.weights, self.slots.of(range), 4)
    }

    fn factor(&self, range: &Range) -> Span {
        span(self.rounded, self.slots.of(range), self.gpu.factor_bytes())
    }

    fn grad(&self, range: &Range) -> Span {
        span(self.grads, self.slots.of(range), 4)
    }
}

/// The part of the segments that holds a tensor.
fn span(segments: &Segments, slot: &Slot, bytes: u64) -> Span {
    segments[slot.segment].part(bytes * slot.offset as u64, bytes * slot.len() as u64)
}
