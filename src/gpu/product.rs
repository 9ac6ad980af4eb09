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
        self.exact[0].step(gpu, &params, &[x, w, bias, none, c, spare], grid)
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
/// Matrices of a subgroup down and across, and subgroups of a workgroup down and across.
#[allow(non_snake_case)]
fn SHAPE() -> [usize; 7] {
    let text = std::env::var("TILE_SHAPE").unwrap_or_else(|_| "2,4,4,2,2,1,2".into());
    let all: Vec<usize> = text.split(',').map(|n| n.parse().unwrap()).collect();
    all.try_into().unwrap()
}

/// Rows and columns of the result that a workgroup computes on matrix units.
fn tile(units: Units) -> [usize; 2] {
    let [down, across, groups_down, groups_across, ..] = SHAPE();
    [down * groups_down * units.side, across * groups_across * units.side]
}

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
const KINDS: [Kind; 9] = [
    kind(false, false, 1, [true, false, false]),
    kind(false, false, 1, [true, true, false]),
    kind(false, false, 2, [true, false, false]),
    kind(false, false, 3, [true, true, false]),
    kind(false, true, 0, [true, true, false]),
    kind(false, true, 4, [true, true, true]),
    kind(true, false, 0, [true, false, false]),
    kind(false, false, 1, [false, false, false]),
    kind(true, false, 0, [false, false, false]),
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
        let [down, across, groups_down, groups_across, depth, buffers, staged] = SHAPE();
        let threads = groups_down * groups_across * lanes;
        // Quads of both factors that a thread reads at once.
        let [quads_a, quads_b] = tile(units).map(|n| n * depth * side / 4 / threads);
        let lines = |n: usize, line: &dyn Fn(usize) -> String| -> String {
            (0..n).map(line).collect::<Vec<_>>().join("\n")
        };
        let all = |x: [String; 2]| x.join("\n");
        let sums = lines(down * across, &|i| {
            format!("var c{}{} = $MATRIX$<f32, C>();", i / across, i % across)
        });
        let fetch = |begin: &str, k: &str| {
            all([("a", quads_a, "row0"), ("b", quads_b, "quad0")].map(|(of, n, from)| {
                lines(n, &|i| {
                    let e = format!("t + {i}u * THREADS");
                    format!("{begin}{of}{i} = part_of_{of}({e}, {from}, {k}, end);")
                })
            }))
        };
        let place = |to: &str| {
            all([("a", quads_a), ("b", quads_b)].map(|(of, n)| {
                lines(n, &|i| format!("keep_{of}(t + {i}u * THREADS, {to}, {of}{i});"))
            }))
        };
        let (long_a, long_b) = (self.a_t, !self.b_t);
        let load = |long, columns| {
            let step = if long { columns } else { "SHORT" };
            move |turned: bool, which: &str, to: &str, at: String| {
                let function = if turned { "coopLoad" } else { "coopLoadT" };
                format!("let {to} = {function}<$MATRIX$<f16, {which}>>(&{at}[0], 2u * {step});")
            }
        };
        let (load_a, load_b) = (load(long_a, "LONG_A"), load(long_b, "LONG_B"));
        let left = lines(down, &|i| {
            let at = format!("left[matrix_a(row + {i}u * SIDE, term, now)]");
            load_a(self.a_t, "A", &format!("x{i}"), at)
        });
        let right = lines(across, &|j| {
            let at = format!("right[matrix_b(column + {j}u * SIDE, term, now)]");
            let y = load_b(self.b_t, "B", &format!("y{j}"), at);
            let sum = lines(down, &|i| format!("c{i}{j} = coopMultiplyAdd(x{i}, y{j}, c{i}{j});"));
            all([y, sum])
        });
        let deliver = lines(down * across / staged, &|at| {
            let (i, j) = (at / (across / staged), staged * (at % (across / staged)));
            let stores = lines(staged, &|s| {
                format!("coopStoreT(c{i}{}, &stage[first + {s}u * SIDE / 4u], WIDE);", j + s)
            });
            format!(
                "workgroupBarrier();\n{stores}\nworkgroupBarrier();\n\
                 deliver(at + {i}u * SIDE, quad + {j}u * SIDE / 4u, tile.z, first, lane);",
            )
        });
        let multiply = format!(
            "for (var term = 0u; term < DEPTH; term += SIDE) {{\n{}\n}}",
            all([left, right])
        );
        let next = fetch("", "next");
        let looped = if buffers == 1 {
            format!(
                "for (var k0 = begin; k0 < end; k0 += DEPTH) {{\n{}\nworkgroupBarrier();\n\
                let next = k0 + DEPTH;\n{next}\nlet now = 0u;\n{multiply}\nworkgroupBarrier();\n}}",
                place("0u")
            )
        } else {
            format!(
                "var now = 0u;\n{}\nworkgroupBarrier();\nfor (var k0 = begin; k0 < end; k0 += DEPTH) {{\n\
                let next = k0 + DEPTH;\n{next}\n{multiply}\n{}\nnow = 1u - now;\nworkgroupBarrier();\n}}",
                place("0u"),
                place("1u - now")
            )
        };
        let size = |long: bool, rows: &str, step: &str| {
            if long { format!("DEPTH * {step}") } else { format!("{rows} * SHORT") }
        };
        include_str!("product_half.wgsl")
            .replace("$SUMS$", &sums)
            .replace("$FIRST$", &fetch("var ", "begin"))
            .replace("$LOOP$", &looped)
            .replace("$SIZE_A$", &size(long_a, "ROWS", "LONG_A"))
            .replace("$SIZE_B$", &size(long_b, "COLUMNS", "LONG_B"))
            .replace("$BUFFERS$", &format!("{buffers}u"))
            .replace("$DEPTH$", &format!("{depth}u"))
            .replace("$STAGED$", &format!("{staged}u"))
            .replace("$DELIVER$", &deliver)
            .replace("$MATRIX$", &format!("coop_mat{side}x{side}"))
            .replace("$SIDE$", &format!("{side}u"))
            .replace("$LANES$", &format!("{lanes}u"))
            .replace("$DOWN$", &format!("{down}u"))
            .replace("$ACROSS$", &format!("{across}u"))
            .replace("$GROUPS_DOWN$", &format!("{groups_down}u"))
            .replace("$GROUPS_ACROSS$", &format!("{groups_across}u"))
    }
}

/// Parameters as the kernels read them.
pub(crate) fn words<const N: usize>(x: [usize; N]) -> [u32; N] {
    x.map(|x| u32::try_from(x).unwrap_or_else(|_| unreachable!("a size beyond 32 bits: {x}")))
}
