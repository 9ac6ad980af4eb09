//! A robot as nodes of the scene: bodies are frames, and their visible parts are children of these.

use glam::Vec3;

use super::figure::Figure;
use super::hit::hit;
use super::retained::Retained;
use super::shell;
use super::space::{self, Place, V3};
use crate::protocol::MeshFacts;
use robert_render as render;
use robert_take::viser::{Apart, Buffer, FrameProps, MeshProps, Message};

/// The selected link's outline.
pub(super) const OUTLINE: &str = "/selected";

/// Its thickness, in radii of the robot.
const SHELL: f64 = 0.008;

/// The number of error colours: a playing robot must not send a new colour for every tiny change.
const SHADES: f64 = 16.0;

/// The error at which a link is red, in sizes of the robot: as in exported pictures.
pub(super) const FULL_ERROR: f64 = 0.10;

/// A robot as nodes of the scene, and the points that the camera must show.
#[derive(Debug)]
pub(super) struct SceneNodes {
    /// Node names by body, the world first.
    pub(super) names: Vec<String>,
    /// In the home pose.
    pub(super) outline: Vec<Vec3>,
    /// By body, in its own frame: the points at which the camera looks when the body moves.
    pub(super) hulls: Vec<(usize, Vec<Vec3>)>,
    /// The radius of a ball around it, m.
    pub(super) radius: f64,
    pub(super) apart: Apart,
    /// In order of bodies.
    pub(super) meshes: Vec<MeshFacts>,
    /// Middle and radius of each, in its body's frame, m.
    pub(super) balls: Vec<(V3, f64)>,
    /// The places of the solid robot's bodies.
    pub(super) shown: Vec<Option<Place>>,
    /// Shade of each link of the command.
    pub(super) shades: Vec<u8>,
    /// The body that is outlined.
    pub(super) outlined: Option<usize>,
}

impl SceneNodes {
    /// Adds a figure to a scene that does not have it yet.
    pub(super) fn enter(&self, scene: &mut Retained, figure: Figure) {
        frames(scene, figure, &self.names);
        for (k, mesh) in self.meshes.iter().enumerate().filter(|(_, m)| m.body > 0) {
            let Some(body) = self.names.get(mesh.body) else { continue };
            let name = format!("{}/{body}/{k}", figure.root());
            scene.put(Message::create(&name, tinted(&props(mesh), figure.tint())));
        }
    }

    /// Moves a figure.
    pub(super) fn pose(
        &mut self,
        scene: &mut Retained,
        figure: Figure,
        place: impl Fn(usize) -> Option<Place>,
    ) {
        for (body, name) in self.names.iter().enumerate().skip(1) {
            let Some(place) = place(body) else { continue };
            if figure == Figure::Robot
                && let Some(shown) = self.shown.get_mut(body)
            {
                *shown = Some(place);
            }
            let node = format!("{}/{name}", figure.root());
            scene.put(Message::position(&node, place.pos));
            scene.put(Message::orientation(&node, place.quat));
        }
    }

    /// Shows the bodies of a figure that stand apart from the same bodies of others; what is not
    /// known hides nothing.
    pub(super) fn unveil(
        &self,
        scene: &mut Retained,
        figure: Figure,
        own: impl Fn(usize) -> Option<Place>,
        others: &[&dyn Fn(usize) -> Option<Place>],
    ) {
        for (body, name) in self.names.iter().enumerate().skip(1) {
            let apart = |own: &Place, other: Place| self.apart.seen(body, &other.row(), &own.row());
            let seen = own(body).is_none_or(|own| {
                others.iter().filter_map(|other| other(body)).all(|other| apart(&own, other))
            });
            scene.put(Message::visibility(&format!("{}/{name}", figure.root()), seen));
        }
    }

    /// Colours each link of the command by its distance from the solid robot's, as exported
    /// pictures do; plain if either is unknown.
    pub(super) fn tint(
        &mut self,
        scene: &mut Retained,
        place: impl Fn(usize) -> Option<(Place, Place)>,
    ) {
        let full = (2.0 * FULL_ERROR * self.radius).max(1e-3);
        for (body, name) in self.names.iter().enumerate().skip(1) {
            let error = place(body)
                .map_or(0.0, |(real, asked)| space::norm(space::sub(real.pos, asked.pos)) / full);
            let shade = (error.min(1.0) * SHADES).round() as u8;
            let Some(known) = self.shades.get_mut(body).filter(|s| **s != shade) else { continue };
            *known = shade;
            let color = render::error_color(f64::from(shade) / SHADES);
            for (k, mesh) in self.meshes.iter().enumerate() {
                if mesh.body == body {
                    let node = format!("{}/{name}/{k}", Figure::Command.root());
                    scene.put(Message::recolor(&node, color));
                }
            }
        }
    }

    /// Outlines one body at its place, or none.
    pub(super) fn outline(
        &mut self,
        scene: &mut Retained,
        chosen: Option<usize>,
        place: impl Fn(usize) -> Option<Place>,
    ) {
        if chosen != self.outlined {
            self.outlined = chosen;
            scene.remove(OUTLINE);
            let of = self.meshes.iter().filter(|m| Some(m.body) == chosen && m.body > 0);
            if let Some(props) = shell::of(of, SHELL * self.radius) {
                scene.put(Message::create(OUTLINE, FrameProps::default()));
                scene.put(Message::create(&format!("{OUTLINE}/shell"), props));
            }
        }
        if let Some(place) = self.outlined.and_then(place) {
            scene.put(Message::position(OUTLINE, place.pos));
            scene.put(Message::orientation(OUTLINE, place.quat));
        }
    }

    /// The place of a body of the solid robot.
    pub(super) fn shown(&self, body: usize) -> Option<Place> {
        self.shown.get(body).copied().flatten()
    }

    /// The first body of the solid robot that a ray hits.
    pub(super) fn first_hit(&self, eye: V3, ray: V3) -> Option<usize> {
        let mut best: Option<(f64, usize)> = None;
        for (mesh, (middle, radius)) in self.meshes.iter().zip(&self.balls) {
            let Some(place) = self.shown(mesh.body).filter(|_| mesh.body > 0) else { continue };
            // Most links are nowhere near the ray.
            let to = space::sub(place.point(*middle), eye);
            let off = space::sub(to, space::scale(ray, space::dot(to, ray) / space::dot(ray, ray)));
            if space::norm(off) > *radius {
                continue;
            }
            if let Some(far) = hit(mesh, &place, eye, ray)
                && best.is_none_or(|(b, _)| far < b)
            {
                best = Some((far, mesh.body));
            }
        }
        best.map(|(_, body)| body)
    }

    /// The body that a node of the solid robot belongs to.
    pub(super) fn body_of(&self, node: &str) -> Option<usize> {
        let name = node.strip_prefix("/robot/")?.split('/').next()?;
        self.names.iter().position(|n| n == name)
    }

    /// A good size for a gizmo, m.
    pub(super) fn gizmo_scale(&self) -> f64 {
        self.radius * 0.35
    }
}

/// The bodies of a figure, without meshes yet.
pub(super) fn frames(scene: &mut Retained, figure: Figure, names: &[String]) {
    let root = figure.root();
    scene.put(Message::create(root, FrameProps::default()));
    for name in names.iter().skip(1) {
        scene.put(Message::create(&format!("{root}/{name}"), FrameProps::default()));
    }
}

pub(super) fn props(mesh: &MeshFacts) -> MeshProps {
    let byte =
        |k: usize| (mesh.rgba.get(k).copied().unwrap_or(0.5).clamp(0.0, 1.0) * 255.0).round() as u8;
    MeshProps {
        vertices: Buffer::f32(&mesh.vertices),
        faces: Buffer::u32(&mesh.faces),
        color: [byte(0), byte(1), byte(2)],
        opacity: (mesh.rgba[3] < 1.0).then(|| f64::from(mesh.rgba[3])),
        // Foreign meshes are not always closed.
        side: "double",
        cast_shadow: false,
        receive_shadow: false,
        ..MeshProps::default()
    }
}

/// The same mesh (and its bytes) in a figure's colour.
pub(super) fn tinted(props: &MeshProps, tint: Option<([u8; 3], f64)>) -> MeshProps {
    let Some((color, opacity)) = tint else { return props.clone() };
    MeshProps { color, opacity: Some(opacity), side: "front", ..props.clone() }
}
