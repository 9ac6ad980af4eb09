//! Shared by `bench train` and `bench infer`: sizes, floating-point work, peak.

use super::clock::process_cpu;
use crate::linalg::{Aligned, Init, Mat, MatMut, gemm, on_threads};
use crate::net::{Batch, Mixing, NetConfig, SkipKind, WINDOW};

/// Features of a token in the benchmark.
const INPUTS: usize = 64;
/// Actuators in the benchmark.
const ACTIONS: usize = 6;

/// A benchmark size.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Size {
    /// 4 layers of 128.
    S,
    /// 6 layers of 256.
    M,
    /// 6 layers of 768, the paper's.
    L,
}

/// The sizes to measure.
#[derive(clap::Args, Debug)]
pub(super) struct Sizes {
    /// Sizes: S (4 layers of 128), M (6 of 256), L (6 of 768).
    #[arg(long, value_delimiter = ',', ignore_case = true, default_values = ["S", "M", "L"])]
    size: Vec<Size>,
}

impl Sizes {
    pub(super) fn iter(&self) -> impl Iterator<Item = Size> {
        self.size.iter().copied()
    }
}

impl Size {
    pub(super) fn name(self) -> &'static str {
        match self {
            Size::S => "S",
            Size::M => "M",
            Size::L => "L",
        }
    }

    /// Windows in a training step.
    pub(super) fn batch(self) -> usize {
        if self == Size::L { 16 } else { 256 }
    }

    pub(super) fn config(self) -> NetConfig {
        let (layers, width, heads) = match self {
            Size::S => (4, 128, 4),
            Size::M => (6, 256, 8),
            Size::L => (6, 768, 6),
        };
        NetConfig {
            layers,
            width,
            heads,
            inputs: INPUTS,
            actions: ACTIONS,
            bins: 1,
            offset_weight: 10.0,
            mask_replaces: false,
            skip: SkipKind::Off,
            mixing: Mixing::Attention,
            dead_zone: 0.0,
        }
    }

    /// Operations of a forward pass of one window: products and attention.
    pub(super) fn forward_flop(self) -> f64 {
        let cfg = self.config();
        let (d, n, t) = (cfg.width as f64, cfg.layers as f64, WINDOW as f64);
        24.0 * d * d * n * t + 4.0 * t * t * d * n
    }
}

/// Best rate of large products, floating-point operations a second of processor time and
/// of wall time, all threads together. Takes about `secs`.
pub(super) fn peak(threads: usize, secs: f64) -> (f64, f64) {
    let mut best = (0.0_f64, 0.0_f64);
    for (m, k, n) in [(816, 512, 768), (768, 768, 768)] {
        let flop = 2.0 * (m * k * n) as f64;
        let rounds = (secs / 2.0 * 2e11 / flop).ceil() as usize;
        let (cpu, wall) = (process_cpu(), std::time::Instant::now());
        on_threads(threads, |_| {
            let (a, b) = (Aligned::<f32>::zeros(m * k), Aligned::<f32>::zeros(k * n));
            let mut c = Aligned::<f32>::zeros(m * n);
            for _ in 0..rounds {
                let out = MatMut::new(&mut c, m, n);
                gemm(out, Init::Zero, Mat::new(&a, m, k), Mat::new(&b, k, n));
            }
            std::hint::black_box(&c);
        });
        let work = flop * (rounds * threads) as f64;
        best.0 = best.0.max(work / (process_cpu() - cpu).as_secs_f64().max(1e-9) * threads as f64);
        best.1 = best.1.max(work / wall.elapsed().as_secs_f64().max(1e-9));
    }
    best
}

/// Fills window w with numbers that need no time to compute.
pub(super) fn fill(w: usize, slot: usize, to: &mut Batch<f32>) {
    let tokens = to.tokens.len() / (to.masked.len() / WINDOW);
    for (i, x) in to.tokens[slot * tokens..(slot + 1) * tokens].iter_mut().enumerate() {
        *x = ((w * 7919 + i * 31) % 1000) as f32 * 0.002 - 1.0;
    }
}
