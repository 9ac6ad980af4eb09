//! What a pointer in a page's viewport is over.

use serde::Serialize;

use super::space::{self, Place, V3};
use super::stage::Stage;
use crate::limits;
use crate::studio::worker::MeshFacts;

/// A page's camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lens {
    /// Where it stands, m.
    pub(super) eye: V3,
    /// From its own axes (x right, y down, z ahead) to the world's.
    pub(super) turn: space::Q,
    /// Tangent of half the vertical field of view.
    pub(super) slope: f64,
    /// Width over height.
    pub(super) aspect: f64,
}

impl Lens {
    /// Where it looks.
    pub(super) fn forward(&self) -> V3 {
        space::rotate(self.turn, [0.0, 0.0, 1.0])
    }

    /// The direction of a point of the picture, 0 to 1 from the top left corner.
    fn ray(&self, [x, y]: [f64; 2]) -> V3 {
        let side = (2.0 * x - 1.0) * self.slope * self.aspect;
        space::rotate(self.turn, [side, (2.0 * y - 1.0) * self.slope, 1.0])
    }
}

/// What is under a pointer.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Hovered {
    /// The body.
    pub body: String,
    /// The joint that moves it, if one does.
    pub joint: Option<String>,
}

impl Stage {
    /// A page's camera has moved.
    pub(super) fn see(&mut self, tab: String, lens: Lens) {
        // Pages come and go; a camera that is missed is told again when it moves.
        if self.lenses.len() >= limits::CLIENTS && !self.lenses.contains_key(&tab) {
            self.lenses.pop_first();
        }
        self.lenses.insert(tab, lens);
    }

    /// What a page's pointer is over.
    pub(super) fn under(&self, tab: &str, at: [f64; 2]) -> Option<Hovered> {
        let (lens, facts) = (self.lenses.get(tab)?, self.facts.as_ref()?);
        let body = self.cast.as_ref()?.first_hit(lens.eye, lens.ray(at))?;
        let joint = self.moving_joint(facts, body, false);
        Some(Hovered {
            body: facts.bodies.get(body)?.name.clone(),
            joint: joint.and_then(|j| facts.table.joints.get(j)).map(|j| j.name.clone()),
        })
    }

    /// The body that the selection is about: its own, else the one that its joint moves, else
    /// the one that its site is on.
    pub(super) fn chosen_body(&self) -> Option<usize> {
        let facts = self.facts.as_ref()?;
        let named = self.selection.body.as_ref();
        let body = named.and_then(|name| facts.bodies.iter().position(|b| &b.name == name));
        let joint = || Some(facts.axes.get(self.selected_joint()?)?.body);
        let site = || {
            let name = self.selection.site.as_ref()?;
            Some(facts.ik_sites.iter().find(|s| &s.name == name)?.body)
        };
        body.or_else(joint).or_else(site)
    }
}

/// Distance along a ray to the first triangle of a mesh that stands at a place.
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
