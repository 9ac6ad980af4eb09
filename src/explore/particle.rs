//! Shared pieces of the intrinsic rewards: running moments and particle entropy.
//!
//! Source: the reference implementation of URLB (Laskin et al. 2021, arXiv 2110.15191);
//! the entropy estimate is that of APT (Liu and Abbeel 2021, arXiv 2103.04551), equation 5.

// Vector code must be inlined into the function that pulp compiles for the processor found.
#![allow(clippy::inline_always)]

use pulp::Arch;

use robert_linalg::{Init, Mat, MatMut, Real, gemm, simd};

/// Numbers that are compared side by side.
const BLOCK: usize = 32;

/// Running mean and variance of a stream of scalars. With batch values x of size b:
///
/// ```text
/// d = mean(x) - M;  M' = M + d b / (n + b);  n' = n + b
/// S' = (S n + Var(x) b + d^2 n b / (n + b)) / (n + b)      Var unbiased
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rms {
    /// M, S, n.
    pub(crate) state: [f64; 3],
}

impl Default for Rms {
    fn default() -> Self {
        Rms { state: [0.0, 1.0, 1e-4] }
    }
}

impl Rms {
    /// Adds a batch of two or more values.
    pub(crate) fn add<T: Real>(&mut self, x: &[T]) {
        let b = x.len() as f64;
        if b < 2.0 {
            return;
        }
        let [m, s, n] = self.state;
        let mean = x.iter().map(|v| v.f64()).sum::<f64>() / b;
        let var = x.iter().map(|v| (v.f64() - mean).powi(2)).sum::<f64>() / (b - 1.0);
        let d = mean - m;
        let all = n + b;
        self.state = [m + d * b / all, (s * n + var * b + d * d * n * b / all) / all, all];
    }

    /// Running mean.
    pub(crate) fn mean(&self) -> f64 {
        self.state[0]
    }

    /// Running standard deviation.
    pub(crate) fn std(&self) -> f64 {
        self.state[1].sqrt()
    }
}

/// Settings of the particle entropy reward.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pbe {
    /// Neighbours, the point itself included.
    pub(crate) k: usize,
    /// Subtracted from each distance before the floor at 0.
    pub(crate) clip: f64,
    /// Divide distances by their running mean.
    pub(crate) rms: bool,
}

impl Pbe {
    /// Reward of each row of `x` (rows, cols): with d the k smallest distances to rows of
    /// the batch, the row itself included,
    /// `r = log(1 + mean max(d / M - clip, 0))`, M the running mean when `rms` is on.
    pub(crate) fn reward<T: Real>(
        self,
        x: &[T],
        cols: usize,
        moments: &mut Rms,
        scratch: &mut Neighbours<T>,
        out: &mut Vec<T>,
    ) {
        let d = scratch.nearest(x, x, cols, self.k, true);
        if self.rms {
            moments.add(d);
        }
        let scale = if self.rms { 1.0 / moments.mean().max(1e-12) } else { 1.0 };
        let k = self.k.min(x.len() / cols.max(1)).max(1);
        out.clear();
        out.extend(d.chunks_exact(k).map(|row| {
            let sum: f64 = row.iter().map(|v| (v.f64() * scale - self.clip).max(0.0)).sum();
            T::of((sum / k as f64).ln_1p())
        }));
    }
}

/// Work space of nearest-neighbour searches.
#[derive(Clone, Debug, Default)]
pub(crate) struct Neighbours<T> {
    products: Vec<T>,
    norms: Vec<T>,
    /// The nearest so far, by the approximate distance, and their indices.
    row: Vec<(T, usize)>,
    found: Vec<T>,
}

impl<T: Real> Neighbours<T> {
    /// Distances of each row of `x` to its `k` nearest rows of `y`, ascending; (rows, k).
    /// With `own`, `x` is `y` and the distance of a row to itself is 0 exactly.
    ///
    /// Candidates come from |x|^2 + |y|^2 - 2 x.y (one matrix product); the k chosen are
    /// measured again by differences, since the short form cancels for near neighbours.
    pub(crate) fn nearest(&mut self, x: &[T], y: &[T], cols: usize, k: usize, own: bool) -> &[T] {
        let (rows, others) = (x.len() / cols, y.len() / cols);
        let k = k.min(others);
        self.products.resize(rows * others, T::default());
        gemm(
            MatMut::new(&mut self.products, rows, others),
            Init::Zero,
            Mat::new(x, rows, cols),
            Mat::new(y, others, cols).t(),
        );
        self.norms.clear();
        self.norms.extend(y.chunks_exact(cols).map(|r| simd::dot(r, r)));
        self.found.clear();
        let Neighbours { products, norms, row, found } = self;
        for (i, (a, p)) in x.chunks_exact(cols).zip(products.chunks_exact(others)).enumerate() {
            least(p, norms, k, row);
            let from = found.len();
            for &(_, j) in &*row {
                let b = &y[j * cols..][..cols];
                let d = if own && j == i { 0.0 } else { simd::distance2(a, b).f64() };
                found.push(T::of(d.sqrt()));
            }
            found[from..]
                .sort_unstable_by(|l, r| l.partial_cmp(r).unwrap_or(std::cmp::Ordering::Equal));
        }
        &self.found
    }
}

/// The `k` smallest values of norm - 2 product with their indices, ascending; equal values by
/// index.
///
/// The numbers are read in blocks. A block without a number below the worst of the k is skipped by
/// a few vector operations, and soon nearly all blocks are. Rejected: a selection algorithm, which
/// would move every number.
fn least<T: Real>(products: &[T], norms: &[T], k: usize, best: &mut Vec<(T, usize)>) {
    let two = T::of(2.0);
    best.clear();
    // The first k are the initial result, so that k are found among any numbers.
    best.extend(norms.iter().zip(products).take(k).map(|(&n, &p)| n - two * p).zip(0..));
    best.sort_by(|l, r| l.0.partial_cmp(&r.0).unwrap_or(std::cmp::Ordering::Equal));
    Arch::new().dispatch(
        #[inline(always)]
        || {
            let blocks = products.chunks(BLOCK).zip(norms.chunks(BLOCK));
            for (b, (p, n)) in blocks.enumerate() {
                let Some(&(mut worst, _)) = best.last() else { return };
                let mut any = false;
                for (p, n) in p.iter().zip(n) {
                    any |= *n - two * *p < worst;
                }
                if !any {
                    continue;
                }
                for (j, (&p, &n)) in (b * BLOCK..).zip(p.iter().zip(n)).skip_while(|(j, _)| *j < k)
                {
                    let value = n - two * p;
                    if value < worst {
                        best.pop();
                        best.insert(best.partition_point(|l| l.0 <= value), (value, j));
                        worst = best.last().map_or(value, |l| l.0);
                    }
                }
            }
        },
    );
}

#[cfg(test)]
mod tests {
    use super::super::mlp::tests::noise;
    use super::*;

    #[test]
    fn rms_by_hand() {
        let mut r = Rms::default();
        r.add(&[1.0, 3.0_f64]);
        // d = 2, n = 1e-4, b = 2, Var = 2.
        let all = 2.0001;
        assert!((r.mean() - 2.0 * 2.0 / all).abs() < 1e-12);
        let s = (1e-4 + 2.0 * 2.0 + 4.0 * 2e-4 / all) / all;
        assert!((r.state[1] - s).abs() < 1e-12);
        // Over many batches it is the pooled moment.
        let x = noise(4000, 3);
        let mut r = Rms::default();
        x.chunks(16).for_each(|c| r.add(c));
        let mean = x.iter().sum::<f64>() / 4000.0;
        assert!((r.mean() - mean).abs() < 1e-6);
        assert!((r.std() - 1.0).abs() < 0.05);
    }

    #[test]
    fn pbe_by_hand() {
        // Points 0, 1, 3 on a line, k = 2: distances (0,1), (0,1), (0,2).
        let x = [0.0, 1.0, 3.0_f64];
        let (mut out, mut s, mut m) = (Vec::new(), Neighbours::default(), Rms::default());
        Pbe { k: 2, clip: 0.0, rms: false }.reward(&x, 1, &mut m, &mut s, &mut out);
        let want = [1.5_f64.ln(), 1.5_f64.ln(), 2.0_f64.ln()];
        assert!(out.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-12), "{out:?}");
        assert_eq!(m, Rms::default());
        Pbe { k: 2, clip: 0.1, rms: true }.reward(&x, 1, &mut m, &mut s, &mut out);
        // Mean of 0 1 0 1 0 2 is 2/3 (the tiny prior moves it by 1e-5).
        let want = ((3.0 - 0.1) / 2.0_f64).ln_1p();
        assert!((out[2] - want).abs() < 1e-4, "{} {want}", out[2]);
    }

    #[test]
    fn nearest_matches_brute_force_in_f32() {
        let x: Vec<f32> = noise(60 * 37, 1).iter().map(|&v| 10.0 + v as f32 * 0.01).collect();
        let mut s = Neighbours::default();
        let got = s.nearest(&x, &x, 37, 12, true).to_vec();
        for (i, a) in x.chunks_exact(37).enumerate() {
            let mut d: Vec<f32> =
                x.chunks_exact(37).map(|b| simd::distance2(a, b).sqrt()).collect();
            d.sort_by(f32::total_cmp);
            assert_eq!(got[i * 12], 0.0);
            // The choice is made on rounded distances; the chosen ones are measured exactly.
            assert!((got[i * 12 + 11] / d[11] - 1.0).abs() < 0.2);
        }
    }

    #[test]
    fn the_least_are_those_of_a_whole_sort() {
        for n in [1, 5, 32, 33, 70, 300] {
            for k in [1, 3, 12].into_iter().filter(|k| *k <= n) {
                let (p, norms) = (noise(n, 3), noise(n, 4));
                // Rounded, so that many are equal.
                let round = |x: &f64| (x * 4.0).round() / 4.0;
                let (p, norms): (Vec<f64>, Vec<f64>) =
                    (p.iter().map(round).collect(), norms.iter().map(round).collect());
                let mut all: Vec<(f64, usize)> =
                    norms.iter().zip(&p).map(|(n, p)| n - 2.0 * p).zip(0..).collect();
                all.sort_by(|l, r| l.0.total_cmp(&r.0));
                let mut best = Vec::new();
                least(&p, &norms, k, &mut best);
                assert_eq!(best, all[..k], "{k} of {n}");
            }
        }
        let mut best = Vec::new();
        least(&[f32::NAN; 40], &[1.0; 40], 3, &mut best);
        assert_eq!(best.len(), 3);
    }
}
