//! The point at which a ray meets a mesh.

use super::space::{self, Place, V3};
use crate::protocol::MeshFacts;

/// The distance along a ray to the first triangle of a mesh with this pose.
pub(super) fn hit(mesh: &MeshFacts, place: &Place, eye: V3, ray: V3) -> Option<f64> {
    // In the body's frame, where the corners are.
    let back = space::conjugate(place.quat);
    let from = space::rotate(back, space::sub(eye, place.pos));
    let along = space::rotate(back, ray);
    let (corners, _) = mesh.vertices.as_chunks::<3>();
    let at = |i: u32| corners.get(i as usize).map(|c| c.map(f64::from));
    let (faces, _) = mesh.faces.as_chunks::<3>();
    let mut best: Option<f64> = None;
    for [a, b, c] in faces {
        let (Some(a), Some(b), Some(c)) = (at(*a), at(*b), at(*c)) else { continue };
        // Möller and Trumbore, 1997.
        let (e, f) = (space::sub(b, a), space::sub(c, a));
        let p = space::cross(along, f);
        let det = space::dot(e, p);
        if det.abs() < 1e-18 {
            continue;
        }
        let s = space::sub(from, a);
        let u = space::dot(s, p) / det;
        let q = space::cross(s, e);
        let v = space::dot(along, q) / det;
        let t = space::dot(f, q) / det;
        let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0;
        if inside && best.is_none_or(|b| t < b) {
            best = Some(t);
        }
    }
    best
}
