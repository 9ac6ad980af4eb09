//! Matrix products c = a b in three transpositions, each with the operation that follows it in a
//! network.

use super::device::{Device, Span, Units};
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
    /// Rows and columns of the result that a workgroup computes.
    tile: usize,
    /// Whether gradients are scaled, for factors of 16 bits.
    scaled: bool,
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
        let units = gpu.units();
        let kernel = |a: bool, b: bool, end: f64| {
            let constants = [("A_T", f64::from(a)), ("B_T", f64::from(b)), ("END", end)];
            match units {
                None => Kernel::new(gpu, "product", &single(), &constants),
                Some(units) => Kernel::half(gpu, "product", &half(units, [a, b]), &constants),
            }
        };
        Product {
            tile: units.map_or(64, |units| 8 * units.side),
            scaled: units.is_some(),
            forward: [1.0, 2.0, 3.0].map(|end| kernel(false, false, end)),
            back: [0.0, 4.0].map(|end| kernel(false, true, end)),
            weight: kernel(true, false, 0.0),
            fold: Kernel::new(gpu, "fold", include_str!("fold.wgsl"), &[]),
            nothing: [gpu.buffer(16), gpu.buffer(16), gpu.buffer(16)],
        }
    }

    /// Factors before rounding. The loss is a mean over the rows, so that the gradient of a row is
    /// small: it would lose its bits in a number of 16.
    fn scales(&self, rows: usize, gradient: Gradient) -> [u32; 3] {
        if !self.scaled {
            return [1.0_f32.to_bits(); 3];
        }
        let scale = 16.0 * rows.next_power_of_two() as f32;
        let [a, b, rest] = match gradient {
            Gradient::None => [1.0; 3],
            Gradient::Left => [scale, 1.0, 1.0 / scale],
            Gradient::Right => [1.0, scale, 1.0 / scale],
        };
        [a.to_bits(), b.to_bits(), rest.to_bits()]
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
        let shape = words([m, n / 4, k, k / 4, n / 4, k.next_multiple_of(16), 0]);
        let params = [&shape[..], &self.scales(m, Gradient::None)].concat();
        self.forward[kernel]
            .step(gpu, &params, &[x, w, bias, other, c, second], self.tiles(m, n, 1))
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
        let shape = words([m, k / 4, n, n / 4, n / 4, n.next_multiple_of(16), 0]);
        let params = [&shape[..], &self.scales(m, Gradient::Left)].concat();
        self.back[kernel]
            .step(gpu, &params, &[dy, w, bias, other, dx, spare], self.tiles(m, k, 1))
            .with_work(2.0 * (m * k * n) as f64)
    }

    /// Slices of the sum over `rows` of a weight gradient, a function of the shape alone.
    pub(crate) fn slices([rows, k, n]: [usize; 3]) -> usize {
        let want = GROUPS.div_ceil(k.div_ceil(64) * n.div_ceil(64));
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
        let shape = words([k, n / 4, rows, k / 4, n / 4, slice, usize::from(slices == 1)]);
        let params = [&shape[..], &self.scales(rows, Gradient::Right)].concat();
        let to = if slices == 1 { dw } else { parts };
        let grid = self.tiles(k, n, slices);
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

    /// Workgroups of a result of m rows and n columns.
    fn tiles(&self, m: usize, n: usize, slices: usize) -> [u32; 3] {
        [n.div_ceil(self.tile) as u32, m.div_ceil(self.tile) as u32, slices as u32]
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

/// The factor of a product that is a gradient.
#[derive(Clone, Copy)]
enum Gradient {
    None,
    Left,
    Right,
}

/// The kernel in single precision.
pub(crate) fn single() -> String {
    [include_str!("product_ends.wgsl"), include_str!("product.wgsl")].concat()
}

/// The kernel for matrix units, with the factors stored as they are or transposed.
pub(crate) fn half(units: Units, [a_t, b_t]: [bool; 2]) -> String {
    let Units { side, lanes } = units;
    let load = |columns: bool| if columns { "coopLoad" } else { "coopLoadT" };
    let step = |long: bool| if long { "LONG" } else { "SHORT" };
    let kernel = include_str!("product_half.wgsl")
        .replace("$MATRIX$", &format!("coop_mat{side}x{side}"))
        .replace("$SIDE$", &format!("{side}u"))
        .replace("$LANES$", &format!("{lanes}u"))
        .replace("$LOAD_A$", load(a_t))
        .replace("$LOAD_B$", load(b_t))
        .replace("$STEP_A$", step(a_t))
        .replace("$STEP_B$", step(!b_t));
    [include_str!("product_ends.wgsl"), &kernel].concat()
}

/// Parameters as the kernels read them.
pub(crate) fn words<const N: usize>(x: [usize; N]) -> [u32; N] {
    x.map(|x| u32::try_from(x).unwrap_or_else(|_| unreachable!("a size beyond 32 bits: {x}")))
}
