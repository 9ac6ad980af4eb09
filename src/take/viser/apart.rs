//! Decides where a ghost is shown: only where it differs from the robot.
//!
//! Two surfaces in the same place are drawn as patches of both, and a ghost that coincides with the
//! robot shows nothing.

use glam::{DQuat, DVec3};

/// The least distance of a visible ghost, as a share of the robot's size.
const SHARE: f64 = 0.003;

/// The bodies of a robot as boxes, to measure the distance between two poses.
#[derive(Clone, Debug)]
pub struct Apart {
    /// Corners of each body's bounding box in its own frame, m; `None` for invisible bodies.
    boxes: Vec<Option<[DVec3; 8]>>,
    limit_m: f64,
}

impl Apart {
    /// Boxes of bodies whose meshes have these corners (m), for a robot as large as `size_m`.
    pub fn new<'a>(
        bodies: usize,
        corners: impl Iterator<Item = (usize, &'a [f32; 3])>,
        size_m: f64,
    ) -> Apart {
        let mut ends = vec![(DVec3::INFINITY, DVec3::NEG_INFINITY); bodies];
        for (body, p) in corners {
            let p = DVec3::from_array(p.map(f64::from));
            if let Some((low, high)) = ends.get_mut(body).filter(|_| p.is_finite()) {
                (*low, *high) = (low.min(p), high.max(p));
            }
        }
        let boxed = |(low, high): (DVec3, DVec3)| {
            let pick = |up: usize, low: f64, high: f64| if up == 1 { high } else { low };
            (low.x <= high.x).then(|| {
                [0_usize, 1, 2, 3, 4, 5, 6, 7].map(|k| {
                    DVec3::new(
                        pick(k & 1, low.x, high.x),
                        pick(k >> 1 & 1, low.y, high.y),
                        pick(k >> 2, low.z, high.z),
                    )
                })
            })
        };
        Apart { boxes: ends.into_iter().map(boxed).collect(), limit_m: SHARE * size_m }
    }

    /// Whether two poses of a body (x y z in m, then w x y z) differ visibly.
    pub fn seen(&self, body: usize, a: &[f64; 7], b: &[f64; 7]) -> bool {
        let Some(Some(corners)) = self.boxes.get(body) else { return false };
        let place = |p: &[f64; 7]| {
            (DVec3::new(p[0], p[1], p[2]), DQuat::from_xyzw(p[4], p[5], p[6], p[3]).normalize())
        };
        let ((pa, qa), (pb, qb)) = (place(a), place(b));
        corners.iter().any(|c| (pa + qa * *c).distance(pb + qb * *c) > self.limit_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shift_and_a_turn_are_seen_and_agreement_is_not() {
        let corners = [[0.0_f32, 0.0, 0.0], [0.5, 0.1, 0.1]];
        let apart = Apart::new(2, corners.iter().map(|c| (1, c)), 1.0);
        let at = |x: f64, angle: f64| {
            let (sin, cos) = (0.5 * angle).sin_cos();
            [x, 0.0, 0.0, cos, 0.0, 0.0, sin]
        };
        assert!(!apart.seen(1, &at(0.0, 0.0), &at(0.0, 0.0)));
        assert!(!apart.seen(1, &at(0.0, 0.0), &at(0.002, 0.0)));
        assert!(apart.seen(1, &at(0.0, 0.0), &at(0.004, 0.0)));
        // A turn moves the far end: half a metre by 0.01 rad is 5 mm.
        assert!(apart.seen(1, &at(0.0, 0.0), &at(0.0, 0.01)));
        assert!(!apart.seen(1, &at(0.0, 0.0), &at(0.0, 0.003)));
        assert!(!apart.seen(0, &at(0.0, 0.0), &at(1.0, 0.0)), "nothing of it is seen");
        assert!(!apart.seen(7, &at(0.0, 0.0), &at(1.0, 0.0)));
    }
}
