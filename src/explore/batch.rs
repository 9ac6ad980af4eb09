//! The input of one update.

use robert_linalg::{Real, simd};

/// Transitions over n steps: state s, action a, state s' three steps later, and the skill
/// vector that acted (empty unless the agent has skills).
#[derive(Clone, Debug, Default)]
pub(crate) struct Batch<T> {
    /// Transitions B.
    pub(crate) rows: usize,
    /// s, (B, o), scaled for the networks.
    pub(crate) obs: Vec<T>,
    /// a in [-1, 1], (B, A).
    pub(crate) action: Vec<T>,
    /// s', (B, o).
    pub(crate) next: Vec<T>,
    /// w, (B, k).
    pub(crate) skill: Vec<T>,
}

/// Rows of `a` (n) beside rows of `b` (m): (rows, n + m).
pub(crate) fn beside<T: Real>(a: &[T], n: usize, b: &[T], m: usize, out: &mut Vec<T>) {
    out.clear();
    if m == 0 {
        out.extend_from_slice(a);
        return;
    }
    out.reserve(a.len() + b.len());
    for (x, y) in a.chunks_exact(n).zip(b.chunks_exact(m)) {
        out.extend_from_slice(x);
        out.extend_from_slice(y);
    }
}

/// The last `m` columns of rows of `n + m`, added to `out` (rows, m) when `add`, else copied.
pub(crate) fn right<T: Real>(x: &[T], n: usize, m: usize, add: bool, out: &mut Vec<T>) {
    let rows = x.len() / (n + m);
    if !add {
        out.clear();
        out.resize(rows * m, T::default());
    }
    for (row, o) in x.chunks_exact(n + m).zip(out.chunks_exact_mut(m)) {
        for (o, &v) in o.iter_mut().zip(&row[n..]) {
            *o += v;
        }
    }
}

/// The first `n` columns, as [`right`].
pub(crate) fn left<T: Real>(x: &[T], n: usize, m: usize, add: bool, out: &mut Vec<T>) {
    let rows = x.len() / (n + m);
    if !add {
        out.clear();
        out.resize(rows * n, T::default());
    }
    for (row, o) in x.chunks_exact(n + m).zip(out.chunks_exact_mut(n)) {
        for (o, &v) in o.iter_mut().zip(&row[..n]) {
            *o += v;
        }
    }
}

/// Euclidean norm of each row of `a - b`, its mean, and the mean's gradient by `a`.
pub(crate) fn norm_loss<T: Real>(
    a: &[T],
    b: &[T],
    cols: usize,
    norms: &mut Vec<T>,
    grad: &mut Vec<T>,
) -> f64 {
    let rows = a.len() / cols;
    norms.clear();
    grad.clear();
    let mut sum = 0.0;
    for (x, y) in a.chunks_exact(cols).zip(b.chunks_exact(cols)) {
        let norm = simd::distance2(x, y).f64().sqrt();
        norms.push(T::of(norm));
        sum += norm;
        // At 0 the norm has no gradient; 0 is the usual choice.
        let scale = if norm > 0.0 { 1.0 / (norm * rows as f64) } else { 0.0 };
        grad.extend(x.iter().zip(y).map(|(&p, &q)| (p - q) * T::of(scale)));
    }
    sum / rows as f64
}
