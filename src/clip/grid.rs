//! The grid of the document's numbers.

/// The nearest point of the 1e-6 grid; never -0.
pub fn round(value: f64) -> f64 {
    let on_grid = (value * 1e6).round() / 1e6;
    if on_grid == 0.0 { 0.0 } else { on_grid }
}
