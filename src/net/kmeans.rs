//! Action bins: Lloyd's k-means over whole action vectors. Rejected: one set of bins per dimension,
//! which the published parameter count excludes.

use std::sync::Mutex;

use robert_base::rng::{Rng, Stream};
use robert_linalg::{Init, Mat, MatMut, gemm, next_of, on_threads};

/// Rounds of Lloyd's algorithm.
pub const ROUNDS: usize = 50;
/// Points in one piece; its sums are added in order, whatever the threads.
const PIECE: usize = 8192;

/// `k` centres of `points`, (n, dim) row-major. Centres without points move to a random point. K =
/// 1 is the mean. Empty input gives zeros.
pub fn kmeans(points: &[f32], dim: usize, k: usize, seed: u64, threads: usize) -> Vec<f32> {
    let dim = dim.max(1);
    let n = points.len() / dim;
    let mut centres = vec![0.0_f32; k * dim];
    if n == 0 {
        return centres;
    }
    let point = |i: usize| &points[i * dim..(i + 1) * dim];
    let draw = |round: usize, c: usize| {
        let mut rng = Rng::new(seed, Stream::KMeans, (round * k + c) as u64);
        point(rng.below(n as u64) as usize)
    };
    for (c, centre) in centres.chunks_exact_mut(dim).enumerate() {
        centre.copy_from_slice(draw(0, c));
    }
    let pieces: Vec<&[f32]> = points[..n * dim].chunks(PIECE * dim).collect();
    let rounds = if k == 1 { 1 } else { ROUNDS };
    for round in 1..=rounds {
        let mut found: Vec<Vec<f64>> = vec![vec![0.0; k * (dim + 1)]; pieces.len()];
        let queue = Mutex::new(pieces.iter().zip(&mut found));
        on_threads(threads.max(1), |_| {
            while let Some((piece, sums)) = next_of(&queue) {
                assign(piece, dim, &centres, k, sums);
            }
        });
        let mut total = vec![0.0; k * (dim + 1)];
        for sums in &found {
            total.iter_mut().zip(sums).for_each(|(t, s)| *t += s);
        }
        let before = centres.clone();
        let groups = centres.chunks_exact_mut(dim).zip(total.chunks_exact(dim + 1));
        for (c, (centre, sums)) in groups.enumerate() {
            let count = sums[dim];
            if count == 0.0 {
                centre.copy_from_slice(draw(round, c));
            } else {
                centre.iter_mut().zip(sums).for_each(|(x, s)| *x = (s / count) as f32);
            }
        }
        if centres == before {
            break;
        }
    }
    centres
}

/// Adds each point to the sums of its nearest centre: dim sums and a count.
fn assign(piece: &[f32], dim: usize, centres: &[f32], k: usize, sums: &mut [f64]) {
    let rows = piece.len() / dim;
    // |x − c|² = |x|² − 2 x·c + |c|²; the first term is the same for all centres.
    let mut dots = vec![0.0_f32; rows * k];
    let (x, c) = (Mat::new(piece, rows, dim), Mat::new(centres, k, dim));
    gemm(MatMut::new(&mut dots, rows, k), Init::Zero, x, c.t());
    let norms: Vec<f32> =
        centres.chunks_exact(dim).map(|c| c.iter().map(|x| x * x).sum()).collect();
    for (point, dots) in piece.chunks_exact(dim).zip(dots.chunks_exact(k)) {
        let mut best = (0, f32::INFINITY);
        for (c, (&dot, &norm)) in dots.iter().zip(&norms).enumerate() {
            let d = norm - 2.0 * dot;
            if d < best.1 {
                best = (c, d);
            }
        }
        let to = &mut sums[best.0 * (dim + 1)..][..=dim];
        to.iter_mut().zip(point).for_each(|(s, &x)| *s += f64::from(x));
        to[dim] += 1.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clouds() -> Vec<f32> {
        let mut rng = Rng::new(8, Stream::Test, 0);
        (0..30_000)
            .flat_map(|i| {
                let middle = [[-0.8, 0.0], [0.5, 0.5], [0.3, -0.7]][i % 3];
                middle.map(|m: f64| (m + 0.05 * rng.normal()) as f32)
            })
            .collect()
    }

    #[test]
    fn finds_clouds_and_is_the_same_on_any_threads() {
        let points = clouds();
        // Some seed starts with one point in each cloud.
        let good = (0..10).any(|seed| {
            let mut c: Vec<[f32; 2]> =
                kmeans(&points, 2, 3, seed, 2).chunks(2).map(|c| [c[0], c[1]]).collect();
            c.sort_by(|a, b| a[0].total_cmp(&b[0]));
            let want = [[-0.8, 0.0], [0.3, -0.7], [0.5, 0.5]];
            c.iter()
                .zip(want)
                .all(|(c, w)| (c[0] - w[0]).abs() < 0.01 && (c[1] - w[1]).abs() < 0.01)
        });
        assert!(good);
        assert_eq!(kmeans(&points, 2, 7, 1, 1), kmeans(&points, 2, 7, 1, 3));
    }

    #[test]
    fn one_centre_is_the_mean() {
        assert_eq!(kmeans(&[1.0, 2.0, 3.0, 6.0], 2, 1, 0, 1), [2.0, 4.0]);
        assert_eq!(kmeans(&[], 2, 3, 0, 1), [0.0; 6]);
    }
}
