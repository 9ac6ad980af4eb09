//! The curves between keys.

/// The cubic Hermite curve from `a` to `b` at `s` (0 to 1); slopes are per whole interval.
pub(super) fn hermite(s: f64, a: f64, b: f64, da: f64, db: f64) -> f64 {
    let (s2, s3) = (s * s, s * s * s);
    a * (2.0 * s3 - 3.0 * s2 + 1.0)
        + da * (s3 - 2.0 * s2 + s)
        + b * (3.0 * s2 - 2.0 * s3)
        + db * (s3 - s2)
}

/// The slope at a key between two intervals of these widths and mean slopes, after which neither
/// curve overshoots (Fritsch and Butland 1984).
pub(super) fn smooth_slope(h0: f64, h1: f64, d0: f64, d1: f64) -> f64 {
    if d0 * d1 <= 0.0 {
        return 0.0;
    }
    let (w0, w1) = (2.0 * h1 + h0, h1 + 2.0 * h0);
    (w0 + w1) / (w0 / d0 + w1 / d1)
}
