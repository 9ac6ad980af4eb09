//! Matrix products c = a b in three transpositions, each with the operation that follows it in a
//! network.

use super::device::{Device, Span};
use super::kernel::{Kernel, Step, line};
use super::units::{DEPTH, OF_SUBGROUP, SUBGROUPS, Units, tile};

/// The operation that follows the sum.
#[derive(Clone, Copy, Debug)]
pub(crate) enum End<'a> {
    /// Nothing.
    Store,
    /// A bias.
    Bias(&'a Span),
    /// A bias; the result is a factor of other products.
    Factors(&'a Span),
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
    /// Rows and columns of the result that a workgroup computes, of factors as they are rounded.
    tile: [usize; 2],
    /// The product x w, with each of the operations that follow it in the forward pass.
    forward: [Kernel; 4],
    /// The product dy w', stored as it is or multiplied by the slope of the activation.
    back: [Kernel; 2],
    /// x' dy.
    weight: Kernel,
    /// Of the tokens, which are not rounded: x w, and x' dy.
    exact: [Kernel; 2],
    fold: Kernel,
    /// A buffer that is bound where an operation does not need one.
    nothing: [Span; 3],
}

/// The most slices of a sum over rows.
pub(crate) const SLICES: usize = 64;
/// Workgroups that fill a large card.
const GROUPS: usize = 1024;

impl Product {
    pub(crate) fn new(gpu: &Device) -> Self {
        let units = gpu.units();
        let [numbers, factors, residual, gelu, back, times, weight, embed, embed_weight] =
            std::array::from_fn(|i| {
                let Kind { a_t, b_t, end, .. } = KINDS[i];
                let of =
                    [("A_T", f64::from(a_t)), ("B_T", f64::from(b_t)), ("END", f64::from(end))];
                Kernel::new(gpu, "product", &KINDS[i].source(units), &of)
            });
        Product {
            tile: units.map_or([TILE; 2], tile),
            forward: [numbers, factors, residual, gelu],
            back: [back, times],
            weight,
            exact: [embed, embed_weight],
            fold: Kernel::new(gpu, "fold", include_str!("fold.wgsl"), &[]),
            nothing: [gpu.buffer(16), gpu.buffer(16), gpu.buffer(16)],
        }
    }

    /// Embedded tokens (m, n) = x (m, k) w (k, n), with a bias, in single precision.
    pub(crate) fn embed(
        &self,
        gpu: &Device,
        [m, k, n]: [usize; 3],
        [x, w, bias]: [&Span; 3],
        c: &Span,
    ) -> Step {
        let [none, _, spare] = &self.nothing;
        let params = words([m, n / 4, k, k / 4, n / 4, k.next_multiple_of(16), 0]);
        let grid = grid([TILE; 2], m, n, 1);
        self.exact[0]
            .step(gpu, &params, &[x, w, bias, none, c, spare], grid)
            .with_work(2.0 * (m * k * n) as f64)
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
            End::Factors(bias) => (1, bias, none, spare),
            End::Residual(bias, residual) => (2, bias, residual, spare),
            End::Gelu(bias, slope) => (3, bias, none, slope),
            End::Store | End::Times(_) => unreachable!("ends of the backward pass"),
        };
        let params = words([m, n / 4, k, k / 4, n / 4, k.next_multiple_of(16), 0]);
        self.forward[kernel]
            .step(gpu, &params, &[x, w, bias, other, c, second], grid(self.tile, m, n, 1))
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
            .step(gpu, &params, &[dy, w, bias, other, dx, spare], grid(self.tile, m, k, 1))
            .with_work(2.0 * (m * k * n) as f64)
    }

    /// Slices of the sum over `rows` of a weight gradient, a function of the shape and the card.
    pub(crate) fn slices(gpu: &Device, [rows, k, n]: [usize; 3]) -> usize {
        let [tall, wide] = gpu.units().map_or([TILE; 2], tile);
        let want = GROUPS.div_ceil(k.div_ceil(tall) * n.div_ceil(wide));
        want.min(rows.div_ceil(128)).clamp(1, SLICES)
    }

    /// dw (k, n) += x' dy over the rows; `parts` takes the slices. Of tokens, in single precision.
    pub(crate) fn weight(
        &self,
        gpu: &Device,
        shape: [usize; 3],
        tokens: bool,
        [x, dy]: [&Span; 2],
        parts: &Span,
        dw: &Span,
    ) -> Vec<Step> {
        let [rows, k, n] = shape;
        let slices =
            Self::slices(gpu, shape).min((parts.bytes / (4 * k * n) as u64).max(1) as usize);
        let slice = rows.div_ceil(slices).next_multiple_of(16);
        let slices = rows.div_ceil(slice);
        let [none, bias, spare] = &self.nothing;
        let params = words([k, n / 4, rows, k / 4, n / 4, slice, usize::from(slices == 1)]);
        let to = if slices == 1 { dw } else { parts };
        let (kernel, tile) =
            if tokens { (&self.exact[1], [TILE; 2]) } else { (&self.weight, self.tile) };
        let grid = grid(tile, k, n, slices);
        let mut steps = vec![
            kernel
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

/// Rows and columns of the result that a workgroup computes in single precision.
const TILE: usize = 64;
/// Workgroups of a result of m rows and n columns.
fn grid([rows, columns]: [usize; 2], m: usize, n: usize, slices: usize) -> [u32; 3] {
    [n.div_ceil(columns) as u32, m.div_ceil(rows) as u32, slices as u32]
}

/// A kernel.
struct Kind {
    /// Whether the factors are stored transposed.
    a_t: bool,
    b_t: bool,
    /// The number of what follows the sum.
    end: u8,
    /// Whether the factors are rounded, the result, and what follows reads.
    rounded: [bool; 3],
}

const fn kind(a_t: bool, b_t: bool, end: u8, rounded: [bool; 3]) -> Kind {
    Kind { a_t, b_t, end, rounded }
}

/// All kernels, in the order of [`Product::new`].
#[rustfmt::skip]
const KINDS: [Kind; 9] = [
    kind(false, false, 1, [true, false, false]),   // the head
    kind(false, false, 1, [true, true, false]),    // queries, keys and values
    kind(false, false, 2, [true, false, false]),   // onto the residual stream
    kind(false, false, 3, [true, true, false]),    // the feed-forward layer
    kind(false, true, 0, [true, true, false]),     // back
    kind(false, true, 4, [true, true, true]),      // back through GELU
    kind(true, false, 0, [true, false, false]),    // weights
    kind(false, false, 1, [false, false, false]),  // the embedding
    kind(true, false, 0, [false, false, false]),   // its weights
];

/// The sources of all kernels.
#[cfg(test)]
pub(crate) fn sources(units: Option<Units>) -> [String; 9] {
    std::array::from_fn(|i| KINDS[i].source(units))
}

impl Kind {
    fn source(&self, units: Option<Units>) -> String {
        let number = |rounded| if rounded { "$H4$" } else { "vec4<f32>" };
        let [factor, result, other] = self.rounded.map(number);
        let kernel = match units {
            Some(units) if self.rounded[0] => self.matrices(units),
            _ => include_str!("product.wgsl").to_owned(),
        };
        [include_str!("product_ends.wgsl"), &kernel]
            .concat()
            .replace("$FACTOR$", factor)
            .replace("$C$", result)
            .replace("$OTHER$", other)
    }

    /// The kernel for matrix units. Lines are repeated here, since drivers keep a matrix in
    /// registers only if it is a variable of its own.
    fn matrices(&self, units: Units) -> String {
        let Units { side, lanes } = units;
        let [down, across] = OF_SUBGROUP;
        let threads = SUBGROUPS[0] * SUBGROUPS[1] * lanes;
        // Quads of both factors that a thread reads at once.
        let [quads_a, quads_b] = tile(units).map(|n| n * DEPTH * side / 4 / threads);
        let parts = [("a", quads_a, "row0"), ("b", quads_b, "quad0")];
        let sums = lines(down * across, |i| {
            format!("var c{}{} = $MATRIX$<f32, C>();", i / across, i % across)
        });
        let fetch = |declare: &str, k: &str| {
            parts.map(|(of, n, first)| {
                lines(n, |i| {
                    let e = format!("t + {i}u * THREADS");
                    format!("{declare}{of}{i} = part_of_{of}({e}, {first}, {k}, end);")
                })
            })
        };
        let keep = parts
            .map(|(of, n, _)| lines(n, |i| format!("keep_{of}(t + {i}u * THREADS, {of}{i});")));
        let load = |transposed: bool, role: &str, to: &str, at: &str, step: &str| {
            let function = if transposed { "coopLoad" } else { "coopLoadT" };
            format!("let {to} = {function}<$MATRIX$<f16, {role}>>(&{at}[0], 2u * {step});")
        };
        let step_a = if self.a_t { "LONG_A" } else { "SHORT" };
        let step_b = if self.b_t { "SHORT" } else { "LONG_B" };
        let left = lines(down, |i| {
            let at = format!("left[matrix_a(row + {i}u * SIDE, term)]");
            load(self.a_t, "A", &format!("x{i}"), &at, step_a)
        });
        let right = lines(across, |j| {
            let at = format!("right[matrix_b(column + {j}u * SIDE, term)]");
            let sum = lines(down, |i| format!("c{i}{j} = coopMultiplyAdd(x{i}, y{j}, c{i}{j});"));
            [load(self.b_t, "B", &format!("y{j}"), &at, step_b), sum].join("\n")
        });
        let deliver = lines(down * across, |at| {
            let (i, j) = (at / across, at % across);
            format!(
                "workgroupBarrier();\ncoopStoreT(c{i}{j}, &stage[first], SIDE / 4u);\n\
                 workgroupBarrier();\n\
                 deliver(at + {i}u * SIDE, quad + {j}u * SIDE / 4u, tile.z, first, lane);",
            )
        });
        let names = [
            ("$SUMS$", sums),
            ("$BEGIN$", fetch("var ", "begin").join("\n")),
            ("$NEXT$", fetch("", "next").join("\n")),
            ("$KEEP$", keep.join("\n")),
            ("$MULTIPLY$", [left, right].join("\n")),
            ("$DELIVER$", deliver),
            ("$MATRIX$", format!("coop_mat{side}x{side}")),
            ("$SIDE$", format!("{side}u")),
            ("$LANES$", format!("{lanes}u")),
            ("$MATRICES_DOWN$", format!("{down}u")),
            ("$MATRICES_ACROSS$", format!("{across}u")),
            ("$SUBGROUPS_DOWN$", format!("{}u", SUBGROUPS[0])),
            ("$SUBGROUPS_ACROSS$", format!("{}u", SUBGROUPS[1])),
            ("$DEPTH$", format!("{DEPTH}u")),
        ];
        let source = include_str!("product_half.wgsl").to_owned();
        names.iter().fold(source, |text, (name, value)| text.replace(name, value))
    }
}

/// A line for each number below n.
fn lines(n: usize, line: impl Fn(usize) -> String) -> String {
    (0..n).map(line).collect::<Vec<_>>().join("\n")
}

/// Parameters as the kernels read them.
pub(crate) fn words<const N: usize>(x: [usize; N]) -> [u32; N] {
    x.map(|x| u32::try_from(x).unwrap_or_else(|_| unreachable!("a size beyond 32 bits: {x}")))
}
