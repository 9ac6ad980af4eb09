//! A camera position from which the whole robot is seen, as large as possible.

use glam::Vec3;

use robert_render::{Camera, View};

/// Width over height of the narrowest viewport that must hold the robot, and of the widest in which
/// it must still be large. The viewport has 70 % of the page's width, so windows of 1100x640 to
/// 1600x900 are well inside.
const NARROWEST: f32 = 4.0 / 3.0;
const WIDEST: f32 = 2.7;
/// The smallest share of the widest viewport that the robot's bounds should take, if its shape
/// allows.
const LEAST: f32 = 0.12;
/// If the robot would take a larger share, the camera moves back to this one, so that the robot has
/// room to move.
const ROOMY: f32 = 0.18;
const STEP_BACK: f32 = 1.5;
/// The free share of the picture on each side.
const MARGIN: f32 = 0.04;
/// The number of directions in which the outermost points of a robot are kept. The resulting error
/// of its outline is 1 % of its size.
const DIRECTIONS: usize = 160;

/// The points that determine a framing: the outermost ones.
pub(super) fn outline(points: impl Iterator<Item = Vec3>) -> Vec<Vec3> {
    outermost(points, DIRECTIONS)
}

/// The outermost points of one body of many, in fewer directions.
pub(super) fn hull(points: impl Iterator<Item = Vec3>) -> Vec<Vec3> {
    outermost(points, DIRECTIONS / 4)
}

fn outermost(points: impl Iterator<Item = Vec3>, count: usize) -> Vec<Vec3> {
    let directions: Vec<Vec3> = (0..count)
        .map(|k| {
            // Evenly over the sphere: a spiral that turns by the golden angle.
            let z = 1.0 - (2 * k + 1) as f32 / count as f32;
            let (sin, cos) = (2.399_963_2 * k as f32).sin_cos();
            let r = (1.0 - z * z).sqrt();
            Vec3::new(r * cos, r * sin, z)
        })
        .collect();
    let mut best = vec![(f32::NEG_INFINITY, Vec3::ZERO); count];
    for p in points.filter(|p| p.is_finite()) {
        for (d, best) in directions.iter().zip(&mut best) {
            let reach = d.dot(p);
            if reach > best.0 {
                *best = (reach, p);
            }
        }
    }
    let mut found: Vec<Vec3> = best.into_iter().filter(|o| o.0.is_finite()).map(|o| o.1).collect();
    found.dedup();
    found
}

/// A camera for these points, from exactly this direction.
pub(super) fn from(view: &View, points: &[Vec3]) -> Camera {
    let view = View { margin: MARGIN, ..*view };
    let mut camera = Camera::fit(points, &view, NARROWEST);
    let back = (share(&camera, points) / ROOMY).sqrt().clamp(1.0, STEP_BACK);
    camera.eye = camera.target + (camera.eye - camera.target) * back;
    camera
}

/// A camera for these points: from this direction if they appear large enough, else from the
/// nearest direction where they do. A straight leg looks thin from the side; from a higher and
/// nearer point it fills the picture.
pub(super) fn near(view: &View, points: &[Vec3]) -> Camera {
    let mut turns: Vec<(f32, f32)> = Vec::new();
    for up in 0..=13_u8 {
        turns.extend([0.0, 30.0, -30.0, 60.0, -60.0, 90.0].map(|side| (5.0 * f32::from(up), side)));
    }
    turns.sort_by(|a, b| a.0.hypot(a.1).total_cmp(&b.0.hypot(b.1)));
    let mut best: Option<(f32, Camera)> = None;
    for (up, side) in turns {
        let elevation = view.elevation_rad + up.to_radians();
        if up > 0.0 && elevation > 75_f32.to_radians() {
            continue;
        }
        let camera = from(&view.from(view.azimuth_rad + side.to_radians(), elevation), points);
        let share = share(&camera, points);
        if share >= LEAST {
            return camera;
        }
        if best.as_ref().is_none_or(|(s, _)| share > *s) {
            best = Some((share, camera));
        }
    }
    best.map_or_else(|| from(view, points), |(_, camera)| camera)
}

/// The share of the widest viewport that the bounds of these points take.
fn share(camera: &Camera, points: &[Vec3]) -> f32 {
    let (mut low, mut high) = (glam::Vec2::INFINITY, glam::Vec2::NEG_INFINITY);
    for p in points.iter().filter_map(|p| camera.project(*p, WIDEST)) {
        (low, high) = (low.min(p), high.max(p));
    }
    let size = (high - low).max(glam::Vec2::ZERO);
    if size.is_finite() { 0.25 * size.x * size.y } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bar(size: Vec3) -> Vec<Vec3> {
        let corner = |k: u8| {
            let side = |b: u8| if k >> b & 1 == 1 { 1.0 } else { -1.0 };
            size * Vec3::new(side(0), side(1), side(2)) + Vec3::new(4.0, -1.0, 2.0)
        };
        outline((0..8).map(corner))
    }

    #[test]
    fn slender_things_are_seen_from_where_they_are_large() {
        let view = View::default();
        for size in [[0.06, 0.06, 0.8], [1.0, 0.04, 0.04], [0.03, 0.5, 0.03], [0.2, 0.3, 0.2]] {
            let points = bar(Vec3::from_array(size));
            let camera = near(&view, &points);
            assert!(share(&camera, &points) >= LEAST, "{size:?}");
            for p in &points {
                let at = camera.project(*p, NARROWEST).unwrap();
                assert!(at.abs().max_element() <= 1.0, "{size:?}: {at}");
            }
        }
    }

    #[test]
    fn what_is_large_enough_is_seen_from_where_it_was_asked_for() {
        let (view, points) = (View::default(), bar(Vec3::splat(0.3)));
        let (asked, found) = (from(&view, &points), near(&view, &points));
        assert_eq!(asked, found);
        // Stepping back makes near things shrink more than far ones: about as much as wanted.
        let seen = share(&asked, &points);
        assert!((LEAST..1.1 * ROOMY).contains(&seen), "{seen}, and has room to move");
        assert!(from(&view, &[]).eye.is_finite());
    }
}
