//! Finds the geom at a pixel, by a ray through the drawn triangles.

use glam::{Vec2, Vec3};

use super::camera::Camera;
use super::prims::{Prim, Triangles};
use super::scene::{Pose, Scene, Shape};

/// The nearest geom at `at` (-1 to 1, y up); `None` for the floor or the sky.
pub(super) fn geom_at(
    scene: &Scene,
    poses: &[Pose],
    camera: &Camera,
    at: Vec2,
    aspect: f32,
) -> Option<usize> {
    let (origin, ray) = camera.ray(at, aspect);
    let (ball, cylinder) = (Prim::Ball.triangles(), Prim::Cylinder.triangles());
    let cube = Prim::Box.triangles();
    let mut nearest: Option<(f32, usize)> = None;
    for (i, (geom, pose)) in scene.geoms().iter().zip(poses).enumerate() {
        if !geom.is_visible() {
            continue;
        }
        let (triangles, half_length) = match geom.shape {
            Shape::Sphere { .. } | Shape::Ellipsoid { .. } => (&ball, 0.0),
            Shape::Capsule { half_length, .. } => (&ball, half_length),
            Shape::Cylinder { .. } => (&cylinder, 0.0),
            Shape::Box { .. } => (&cube, 0.0),
            Shape::Plane { .. } => continue,
            Shape::Mesh { mesh } => match scene.meshes().get(mesh) {
                Some(m) => (&m.triangles, 0.0),
                None => continue,
            },
        };
        // The ray in the geom's own frame; its length is kept, so distances can be compared.
        let back = pose.rot.transpose();
        let (o, d) = (back * (origin - pose.pos), back * ray);
        if let Some(t) = first_hit(triangles, geom.shape.radii(), half_length, o, d)
            && nearest.is_none_or(|(n, _)| t < n)
        {
            nearest = Some((t, i));
        }
    }
    nearest.map(|(_, i)| i)
}

/// First intersection of a ray with triangles that are scaled as in the shader (Möller and
/// Trumbore, 1997).
fn first_hit(t: &Triangles, size: Vec3, half_length: f32, o: Vec3, d: Vec3) -> Option<f32> {
    let point = |i: u32| {
        let p = t.vertices.get(i as usize).map_or([0.0; 4], |v| v.p);
        Vec3::new(p[0], p[1], p[2]) * size + Vec3::Z * (p[3] * half_length)
    };
    let hit = |f: &[u32; 3]| {
        let [a, b, c] = f.map(point);
        let (ab, ac) = (b - a, c - a);
        let p = d.cross(ac);
        let det = ab.dot(p);
        if det.abs() < 1e-20 {
            return None;
        }
        let from = o - a;
        let u = from.dot(p) / det;
        let q = from.cross(ab);
        let v = d.dot(q) / det;
        let far = ac.dot(q) / det;
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && far > 0.0).then_some(far)
    };
    t.indices.as_chunks::<3>().0.iter().filter_map(hit).min_by(f32::total_cmp)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Geom, Lens, View};

    #[test]
    fn the_nearest_thing_under_the_pixel_is_found() {
        let geom = |shape| Geom { name: String::new(), body: 1, shape, rgba: [1.0; 4] };
        let capsule = Shape::Capsule { radius: 0.05, half_length: 0.4 };
        let geoms = vec![
            geom(Shape::Box { half: Vec3::splat(0.3) }),
            geom(capsule),
            Geom { rgba: [0.0; 4], ..geom(Shape::Sphere { radius: 2.0 }) },
        ];
        let scene = Scene::new(geoms, vec![], None).unwrap();
        // The eye is on +x, the capsule stands before the box, what is invisible around all.
        let poses = [Pose::IDENTITY, Pose::at(1.0, 0.0, 0.0), Pose::IDENTITY];
        for lens in [Lens::Perspective { fov_y_rad: 0.5 }, Lens::Orthographic { height: 2.0 }] {
            let camera =
                Camera::orbit(Vec3::ZERO, 4.0, &View { lens, ..View::default().from(0.0, 0.0) });
            let at = |p: Vec3| {
                let at = camera.project(p, 1.5).unwrap();
                geom_at(&scene, &poses, &camera, at, 1.5)
            };
            assert_eq!(at(Vec3::ZERO), Some(1), "{lens:?}");
            assert_eq!(at(Vec3::new(1.0, 0.0, 0.42)), Some(1), "its cap");
            assert_eq!(at(Vec3::new(0.3, 0.2, 0.1)), Some(0));
            assert_eq!(at(Vec3::new(0.0, 0.9, 0.9)), None);
        }
    }
}
