//! A take's states resampled at another rate, and their derivatives over time.

use glam::{DQuat, DVec3};

use super::super::document::Take;
use robert_base::units::FPS;

/// States at `fps` frames per second from the first to the last frame of the take, interpolated
/// linearly between frames of 1/20 s. (rows)(S)
pub(super) fn resampled(take: &Take, fps: u32) -> Vec<Vec<f64>> {
    let last = take.frames() - 1;
    let rows = last * fps as usize / FPS as usize + 1;
    (0..rows)
        .map(|r| {
            // Whole numbers, so that rows on the take's own grid are its states exactly.
            let (from, part) = (r * FPS as usize / fps as usize, r * FPS as usize % fps as usize);
            let share = part as f64 / f64::from(fps);
            let next = take.state((from + 1).min(last));
            let between = take.state(from).iter().zip(next).map(|(a, b)| a + share * (b - a));
            between.collect()
        })
        .collect()
}

/// Rows whose difference is the derivative at row `r`, and their distance in steps: central inside,
/// one-sided at the ends.
fn around(r: usize, rows: usize) -> (usize, usize) {
    (r.saturating_sub(1), (r + 1).min(rows - 1))
}

/// Time derivative of every column of `rows` that are `dt` seconds apart.
pub(super) fn gradient(rows: &[Vec<f64>], dt: f64) -> Vec<Vec<f64>> {
    (0..rows.len())
        .map(|r| {
            let (a, b) = around(r, rows.len());
            let span = (b - a).max(1) as f64 * dt;
            rows[a].iter().zip(&rows[b]).map(|(a, b)| (b - a) / span).collect()
        })
        .collect()
}

/// Linear velocities, m/s.
pub(super) fn linear(rows: &[DVec3], dt: f64) -> Vec<DVec3> {
    (0..rows.len())
        .map(|r| {
            let (a, b) = around(r, rows.len());
            (rows[b] - rows[a]) / ((b - a).max(1) as f64 * dt)
        })
        .collect()
}

/// Angular velocities in the world, rad/s.
pub(super) fn angular(rows: &[DQuat], dt: f64) -> Vec<DVec3> {
    (0..rows.len())
        .map(|r| {
            let (a, b) = around(r, rows.len());
            let turn = rows[b] * rows[a].inverse();
            // The shorter way round.
            let turn = if turn.w < 0.0 { -turn } else { turn };
            turn.to_scaled_axis() / ((b - a).max(1) as f64 * dt)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::super::sample;
    use super::*;

    #[test]
    fn rows_on_the_grid_are_the_states() {
        let (_, take) = sample::take("ur5e", 21, 21);
        let same = resampled(&take, 20);
        assert_eq!(same.len(), 21);
        assert!((0..21).all(|f| same[f] == take.state(f)));
        let fast = resampled(&take, 50);
        assert_eq!(fast.len(), 51);
        assert!((0..=10).all(|k| fast[5 * k] == take.state(2 * k)));
        let between = f64::midpoint(take.state(0)[0], take.state(1)[0]);
        let slow = resampled(&take, 40);
        assert!((slow[1][0] - between).abs() < 1e-15);
    }

    #[test]
    fn a_steady_turn_has_a_steady_velocity() {
        let axis = DVec3::new(0.6, 0.0, 0.8);
        let rows: Vec<DQuat> =
            (0..60).map(|i| DQuat::from_axis_angle(axis, 0.11 * f64::from(i))).collect();
        for w in angular(&rows, 0.02) {
            assert!((w - axis * 5.5).length() < 1e-9, "{w}");
        }
        let line: Vec<DVec3> = (0..9).map(|i| axis * f64::from(i)).collect();
        assert!(linear(&line, 0.5).iter().all(|v| (*v - axis * 2.0).length() < 1e-12));
        assert_eq!(gradient(&[vec![1.0], vec![3.0], vec![7.0]], 0.5), [[4.0], [6.0], [8.0]]);
    }
}
