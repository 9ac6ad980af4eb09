//! The angles of a body's hinges from its rotation.
//!
//! MuJoCo turns a body about its hinges one after the other: `Q = R(a1, t1) R(a2, t2) R(a3, t3)`, with
//! all axes in the frame of the body. One and two angles follow from `Q` directly. Of three the middle
//! one comes first, since `a1 · Q a3` depends on it alone; it has two solutions (Paden and Kahan's
//! subproblems, Murray, Li and Sastry, 1994).

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};

/// The length below which the part of an axis across another one counts as none.
const PARALLEL: f64 = 1e-6;

/// The hinges of a body, outermost first.
#[derive(Clone, Debug)]
pub(super) struct Hinges {
    /// Unit axes in the body's frame.
    pub axes: Vec<DVec3>,
    /// Ranges of the angles, rad.
    pub ranges: Vec<[f64; 2]>,
}

impl Hinges {
    /// The most hinges of a body whose angles can be found.
    pub(super) const MOST: usize = 3;

    /// Whether the rotation determines the angles: neighbouring axes are not parallel.
    pub(super) fn are_told_apart(&self) -> bool {
        self.axes.len() <= Hinges::MOST
            && self.axes.windows(2).all(|w| w[0].cross(w[1]).length() > PARALLEL)
    }

    /// The angles that turn the body so, rad, and the rest of the rotation that no angle explains. Of
    /// several solutions the one within the ranges is taken, or else the one nearest to `last`.
    pub(super) fn angles(&self, turn: DQuat, last: &[f64]) -> (Vec<f64>, f64) {
        let found: Vec<Vec<f64>> = match self.axes[..] {
            [a] => vec![vec![about(turn, a)]],
            [a, b] => vec![of_two(turn, a, b)],
            [a, b, c] => of_three(turn, a, b, c, last).into(),
            _ => Vec::new(),
        };
        let nearest = |angles: Vec<f64>| -> Vec<f64> {
            // Of equal angles the nearest: no jump of a whole turn between frames.
            angles.iter().zip(last).map(|(t, l)| t + TAU * ((l - t) / TAU).round()).collect()
        };
        let solutions = found.into_iter().map(nearest).map(|angles| {
            let outside: f64 = angles
                .iter()
                .zip(&self.ranges)
                .map(|(t, [low, high])| (low - t).max(t - high).max(0.0))
                .sum();
            let moved: f64 = angles.iter().zip(last).map(|(t, l)| (t - l).abs()).sum();
            (outside, moved, angles)
        });
        let best = solutions.min_by(|a, b| {
            // Beyond a range by rounding is within it.
            let beyond = |x: f64| if x < 1e-3 { 0.0 } else { x };
            beyond(a.0).total_cmp(&beyond(b.0)).then(a.1.total_cmp(&b.1))
        });
        let angles = best.map_or_else(|| last.to_vec(), |(_, _, angles)| angles);
        let made = self
            .axes
            .iter()
            .zip(&angles)
            .fold(DQuat::IDENTITY, |q, (axis, t)| q * DQuat::from_axis_angle(*axis, *t));
        let left = made.inverse() * turn;
        (angles, 2.0 * left.xyz().length().min(1.0).asin())
    }
}

/// The angles about two axes.
fn of_two(turn: DQuat, a: DVec3, b: DVec3) -> Vec<f64> {
    // The second hinge does not move its own axis.
    let first = between(a, b, turn * b).unwrap_or(0.0);
    let rest = DQuat::from_axis_angle(a, -first) * turn;
    vec![first, about(rest, b)]
}

/// Both sets of angles about three axes.
fn of_three(turn: DQuat, a: DVec3, b: DVec3, c: DVec3, last: &[f64]) -> [Vec<f64>; 2] {
    // a · R(b, t) c = fixed + cosine cos t + sine sin t, and it equals a · Q c.
    let fixed = a.dot(b) * b.dot(c);
    let (cosine, sine) = (a.dot(c) - fixed, a.dot(b.cross(c)));
    let share = ((a.dot(turn * c) - fixed) / cosine.hypot(sine)).clamp(-1.0, 1.0);
    let (middle, spread) = (sine.atan2(cosine), share.acos());
    let of = |second: f64| {
        let carried = DQuat::from_axis_angle(b, second) * c;
        // Where the outer axes meet only the sum of both angles is known: the first one stays.
        let first = between(a, carried, turn * c).unwrap_or(last[0]);
        let rest = DQuat::from_axis_angle(b, -second) * DQuat::from_axis_angle(a, -first) * turn;
        vec![first, second, about(rest, c)]
    };
    [of(middle + spread), of(middle - spread)]
}

/// The angle of a rotation about an axis, rad.
fn about(turn: DQuat, axis: DVec3) -> f64 {
    2.0 * turn.xyz().dot(axis).atan2(turn.w)
}

/// The angle about an axis from one direction to another; `None` if one is parallel to the axis.
fn between(axis: DVec3, from: DVec3, to: DVec3) -> Option<f64> {
    let across = |v: DVec3| v - v.dot(axis) * axis;
    let (from, to) = (across(from), across(to));
    let parallel = from.length() < PARALLEL || to.length() < PARALLEL;
    (!parallel).then(|| axis.dot(from.cross(to)).atan2(from.dot(to)))
}

#[cfg(test)]
mod tests {
    use robert_base::rng::{Rng, Stream};

    use super::*;

    fn hinges(axes: &[DVec3]) -> Hinges {
        let axes: Vec<DVec3> = axes.iter().map(|a| a.normalize()).collect();
        Hinges { ranges: vec![[-1.4, 1.4]; axes.len()], axes }
    }

    fn turned(hinges: &Hinges, angles: &[f64]) -> DQuat {
        let one = |(a, t): (&DVec3, &f64)| DQuat::from_axis_angle(*a, *t);
        hinges.axes.iter().zip(angles).map(one).fold(DQuat::IDENTITY, |q, r| q * r)
    }

    #[test]
    fn angles_within_their_ranges_come_back() {
        let skew =
            [DVec3::new(1.0, 0.2, 0.0), DVec3::new(0.3, 1.0, 0.1), DVec3::new(0.0, -0.2, 1.0)];
        let sets = [&skew[..1], &skew[..2], &skew[..], &[DVec3::X, DVec3::Y, DVec3::X]];
        let mut rng = Rng::new(7, Stream::Test, 0);
        for axes in sets {
            let hinges = hinges(axes);
            assert!(hinges.are_told_apart());
            for _ in 0..200 {
                let want: Vec<f64> = axes.iter().map(|_| rng.range(0.1, 1.3)).collect();
                let (got, left) = hinges.angles(turned(&hinges, &want), &want);
                assert!(left < 1e-9, "{left}");
                for (a, b) in got.iter().zip(&want) {
                    assert!((a - b).abs() < 1e-7, "{got:?} {want:?}");
                }
            }
        }
    }

    #[test]
    fn a_rotation_that_no_angles_make_leaves_a_rest() {
        let pair = hinges(&[DVec3::X, DVec3::Y]);
        let (_, left) = pair.angles(DQuat::from_axis_angle(DVec3::Z, 0.3), &[0.0; 2]);
        assert!(left > 0.05, "{left}");
        assert!(!hinges(&[DVec3::X, DVec3::X]).are_told_apart());
        // Where the outer axes meet the rotation still comes back.
        let lock = hinges(&[DVec3::Z, DVec3::Y, DVec3::X]);
        let turn = turned(&lock, &[0.4, std::f64::consts::FRAC_PI_2, 0.3]);
        let (got, left) = lock.angles(turn, &[0.1, 1.5, 0.1]);
        assert!(left < 1e-6, "{got:?} {left}");
    }
}
