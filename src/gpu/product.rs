//! Matrix products c = a b in three transpositions, each with the operation that follows it in a
//! network.

use super::device::{Device, Span};
use super::kernel::{Kernel, Step, line};

/// The operation that follows the sum.
#[derive(Clone, Copy, Debug)]
pub(crate) enum End<'a> {
    /// Nothing.
    Store,
    /// A bias.
    Bias(&'a Span),
    /// A bias and the residual stream.
    Residual(&'a Span, &'a Span),
    /// A bias and GELU; its derivative goes to the second buffer.
    Gelu(&'a Span, &'a Span),
    /// Elementwise factors.
    Times(&'a Span),
}

/// The products of a network.
#[derive(Debug)]
pub(crate) struct Product {
    /// The product x w, with each of the operations that follow it in the forward pass.
    forward: [Kernel; 3],
    /// The product dy w', stored as it is or multiplied by the slope of the activation.
    back: [Kernel; 2],
    /// x' dy.
    weight: Kernel,
    fold: Kernel,
    /// A buffer that is bound where an operation does not need one.
    nothing: [Span; 3],
}

/// The most slices of a sum over rows.
pub(crate) const SLICES: usize = 64;
/// Workgroups that fill a large card.
const GROUPS: usize = 512;

impl Product {
    pub(crate) fn new(gpu: &Device) -> Self {
        let source = include_str!("product.wgsl");
        let kernel = |a: f64, b: f64, end: f64| {
            Kernel::new(gpu, "product", source, &[("A_T", a), ("B_T", b), ("END", end)])
        };
        Product {
            forward: [1.0, 2.0, 3.0].map(|end| kernel(0.0, 0.0, end)),
            back: [0.0, 4.0].map(|end| kernel(0.0, 1.0, end)),
            weight: kernel(1.0, 0.0, 0.0),
            fold: Kernel::new(gpu, "fold", include_str!("fold.wgsl"), &[]),
            nothing: [gpu.buffer(16), gpu.buffer(16), gpu.buffer(16)],
        }
    }

    /// c (m, n) = x (m, k) w (k, n), with a bias.
    pub(crate) fn forward(
        &self,
        gpu: &Device,
        [m, k, n]: [usize; 3],
        x: &Span,
        w: &Span,
        end: End<'_>,
        c: &Span,
    ) -> Step {
        let [none, _, spare] = &self.nothing;
        let (kernel, bias, other, second) = match end {
            End::Bias(bias) => (0, bias, none, spare),
            End::Residual(bias, residual) => (1, bias, residual, spare),
            End::Gelu(bias, slope) => (2, bias, none, slope),
            End::Store | End::Times(_) => unreachable!("ends of the backward pass"),
        };
        let params = words([m, n / 4, k, k / 4, n / 4, k.next_multiple_of(16), 0]);
        self.forward[kernel]
            .step(gpu, &params, &[x, w, bias, other, c, second], tiles(m, n, 1))
            .with_work(2.0 * (m * k * n) as f64)
    }

    /// dx (m, k) = dy (m, n) w', with w stored as (k, n).
    pub(crate) fn back(
        &self,
        gpu: &Device,
        [m, k, n]: [usize; 3],
        dy: &Span,
        w: &Span,
        end: End<'_>,
        dx: &Span,
    ) -> Step {
        let [none, bias, spare] = &self.nothing;
        let (kernel, other) = match end {
            End::Store => (0, none),
            End::Times(slope) => (1, slope),
            _ => unreachable!("ends of the forward pass"),
        };
        let params = words([m, k / 4, n, n / 4, n / 4, n.next_multiple_of(16), 0]);
        self.back[kernel]
            .step(gpu, &params, &[dy, w, bias, other, dx, spare], tiles(m, k, 1))
            .with_work(2.0 * (m * k * n) as f64)
    }

    /// Slices of the sum over `rows` of a weight gradient, a function of the shape alone.
    pub(crate) fn slices([rows, k, n]: [usize; 3]) -> usize {
        let [x, y, _] = tiles(k, n, 1);
        let want = GROUPS.div_ceil((x * y) as usize);
        want.min(rows.div_ceil(128)).clamp(1, SLICES)
    }

    /// dw (k, n) += x' dy over the rows; `parts` takes the slices.
    pub(crate) fn weight(
        &self,
        gpu: &Device,
        shape: [usize; 3],
        x: &Span,
        dy: &Span,
        parts: &Span,
        dw: &Span,
    ) -> Vec<Step> {
        let [rows, k, n] = shape;
        let slices = (Self::slices(shape)).min((parts.bytes / (4 * k * n) as u64).max(1) as usize);
        let slice = rows.div_ceil(slices).next_multiple_of(16);
        let slices = rows.div_ceil(slice);
        let [none, bias, spare] = &self.nothing;
        let params = words([k, n / 4, rows, k / 4, n / 4, slice, usize::from(slices == 1)]);
        let to = if slices == 1 { dw } else { parts };
        let grid = tiles(k, n, slices);
        let mut steps = vec![
            self.weight
                .step(gpu, &params, &[x, dy, bias, none, to, spare], grid)
                .with_work(2.0 * (rows * k * n) as f64),
        ];
        if slices > 1 {
            steps.push(self.fold(gpu, k * n / 4, slices, parts, dw));
        }
        steps
    }

    /// to += the slices of a sum, of `n` quads each.
    pub(crate) fn fold(
        &self,
        gpu: &Device,
        n: usize,
        slices: usize,
        parts: &Span,
        to: &Span,
    ) -> Step {
        self.fold.step(gpu, &words([n, slices]), &[parts, to], line(n.div_ceil(256)))
    }
}

fn tiles(m: usize, n: usize, slices: usize) -> [u32; 3] {
    [n.div_ceil(64) as u32, m.div_ceil(64) as u32, slices as u32]
}

/// Parameters as the kernels read them.
pub(crate) fn words<const N: usize>(x: [usize; N]) -> [u32; N] {
    x.map(|x| u32::try_from(x).unwrap_or_else(|_| unreachable!("a size beyond 32 bits: {x}")))
}
