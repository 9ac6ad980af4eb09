//! The natural cubic spline through points: a simple interpolation of visible frames without
//! knowledge of the robot.

/// Values and second derivatives at the knots.
pub(super) struct Spline {
    knots: Vec<(f64, f64)>,
    curve: Vec<f64>,
}

/// The twice differentiable cubic through `knots` (position, value; positions increasing) with no
/// curvature at the ends. It is a line through two knots, and constant through one.
pub(super) fn natural(knots: &[(f64, f64)]) -> Spline {
    let n = knots.len();
    let mut curve = vec![0.0; n];
    // Thomas' algorithm for the tridiagonal system of the inner second derivatives.
    let mut upper = vec![0.0; n];
    let width = |i: usize| knots[i + 1].0 - knots[i].0;
    let slope = |i: usize| (knots[i + 1].1 - knots[i].1) / width(i);
    for i in 1..n.saturating_sub(1) {
        let pivot = 2.0 * (width(i - 1) + width(i)) - width(i - 1) * upper[i - 1];
        upper[i] = width(i) / pivot;
        let right = 6.0 * (slope(i) - slope(i - 1));
        curve[i] = (right - width(i - 1) * curve[i - 1]) / pivot;
    }
    for i in (1..n.saturating_sub(1)).rev() {
        curve[i] -= upper[i] * curve[i + 1];
    }
    Spline { knots: knots.to_vec(), curve }
}

impl Spline {
    /// Its value; the first and last cubic continue beyond the ends.
    pub(super) fn at(&self, x: f64) -> f64 {
        let last = self.knots.len().saturating_sub(2);
        let i = self.knots.partition_point(|k| k.0 <= x).saturating_sub(1).min(last);
        let (Some(&(x0, y0)), Some(&(x1, y1))) = (self.knots.get(i), self.knots.get(i + 1)) else {
            return self.knots.first().map_or(0.0, |k| k.1);
        };
        let h = x1 - x0;
        let (a, b) = ((x1 - x) / h, (x - x0) / h);
        let bend = (a * a * a - a) * self.curve[i] + (b * b * b - b) * self.curve[i + 1];
        a * y0 + b * y1 + bend * h * h / 6.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passes_its_knots_and_keeps_lines() {
        let line: Vec<(f64, f64)> =
            [0.0, 1.0, 4.0, 6.0].iter().map(|&x| (x, 2.0 * x - 1.0)).collect();
        let s = natural(&line);
        for x in [0.0, 0.5, 2.0, 5.5, 6.0] {
            assert!((s.at(x) - (2.0 * x - 1.0)).abs() < 1e-12);
        }
        let knots = [(0.0, 1.0), (1.0, -1.0), (2.5, 0.5), (3.0, 0.0)];
        let s = natural(&knots);
        for (x, y) in knots {
            assert!((s.at(x) - y).abs() < 1e-12);
        }
    }

    /// Worked by hand: through (0,0), (1,1), (2,0) the curvature in the middle is -3.
    #[test]
    fn agrees_with_a_spline_by_hand() {
        let s = natural(&[(0.0, 0.0), (1.0, 1.0), (2.0, 0.0)]);
        assert!((s.at(0.5) - 0.6875).abs() < 1e-12, "{}", s.at(0.5));
        assert!((s.at(1.5) - 0.6875).abs() < 1e-12);
    }

    #[test]
    fn few_knots_are_a_line_or_a_constant() {
        assert!((natural(&[(0.0, 1.0), (2.0, 3.0)]).at(1.0) - 2.0).abs() < 1e-12);
        assert!((natural(&[(5.0, 0.25)]).at(9.0) - 0.25).abs() < 1e-12);
    }
}
