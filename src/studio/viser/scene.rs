//! A robot as nodes of the scene: bodies are frames, what is seen of them hangs below.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::Vec3;

use super::framing;
use super::look;
use super::retained::Retained;
use super::shell;
use super::space::{self, Place, V3};
use crate::render::{self, View};
use crate::robot;
use crate::studio::worker::{Geometry, MeshFacts, RobotFacts};
use crate::take::viser::{
    Apart, Binding, Buffer, FrameProps, GridProps, MeshProps, Message, node_name,
};

/// The selected link's outline.
pub(super) const OUTLINE: &str = "/selected";
/// Thickness of it, in radii of the robot.
const SHELL: f64 = 0.008;
/// Shades of error: a playing robot must not send a colour for every hair's breadth.
const SHADES: f64 = 16.0;
/// Error of a link that is red, in sizes of the robot: as in exported pictures.
const FULL_ERROR: f64 = 0.10;

/// One of the robots on stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Actor {
    /// What was achieved, solid.
    Robot,
    /// What is commanded, translucent.
    Command,
    /// The key before.
    Past,
    /// The key after.
    Future,
    /// A take to compare with.
    Beside,
}

impl Actor {
    /// Everyone.
    pub(super) const ALL: [Actor; 5] =
        [Actor::Robot, Actor::Command, Actor::Past, Actor::Future, Actor::Beside];
    /// Those who are on stage from the start; the take beside enters when it is called.
    const CAST: [Actor; 4] = [Actor::Robot, Actor::Command, Actor::Past, Actor::Future];

    /// Its node.
    pub(super) fn root(self) -> &'static str {
        match self {
            Actor::Robot => "/robot",
            Actor::Command => "/command",
            Actor::Past => "/past",
            Actor::Future => "/future",
            Actor::Beside => "/beside",
        }
    }

    /// sRGB and opacity in place of its own colours: blue command, green past, amber future,
    /// magenta take beside.
    fn tint(self) -> Option<([u8; 3], f64)> {
        match self {
            Actor::Robot => None,
            Actor::Command => Some((render::error_color(0.0), 0.3)),
            Actor::Past => Some(([41, 166, 112], 0.18)),
            Actor::Future => Some(([237, 148, 36], 0.18)),
            Actor::Beside => Some(([201, 79, 168], 0.45)),
        }
    }
}

/// Names of the bodies on stage, and what the camera must hold.
#[derive(Debug)]
pub(super) struct Cast {
    /// Node names by body, the world first.
    names: Vec<String>,
    by_name: BTreeMap<String, usize>,
    /// In the home pose.
    outline: Vec<Vec3>,
    /// By body, in its own frame: what to look at where it moves.
    hulls: Vec<(usize, Vec<Vec3>)>,
    /// Of a ball around it, m.
    radius: f64,
    apart: Apart,
    /// In order of bodies.
    meshes: Vec<MeshFacts>,
    /// Middle and radius of each, in its body's frame, m.
    balls: Vec<(V3, f64)>,
    /// Where the bodies of the solid robot are.
    shown: Vec<Option<Place>>,
    /// Shade of each link of the command.
    shades: Vec<u8>,
    /// The body that is outlined.
    outlined: Option<usize>,
}

/// Puts a robot on stage; what stood there before goes.
pub(super) fn build(scene: &mut Retained, geometry: Geometry) -> Cast {
    for root in Actor::ALL.map(Actor::root).into_iter().chain(["/world", "/gizmo", OUTLINE]) {
        scene.remove(root);
    }
    let names: Vec<String> = geometry.bodies.iter().map(|b| node_name(b)).collect();
    for actor in Actor::CAST {
        frames(scene, actor, &names);
    }
    scene.put(Message::create("/world", FrameProps::default()));
    for (k, mesh) in geometry.meshes.iter().enumerate() {
        let props = props(mesh);
        let Some(body) = names.get(mesh.body).filter(|_| mesh.body > 0) else {
            scene.put(Message::create(&format!("/world/{k}"), props));
            continue;
        };
        for actor in Actor::CAST {
            let name = format!("{}/{body}/{k}", actor.root());
            scene.put(Message::create(&name, tinted(&props, actor.tint())));
            if actor == Actor::Robot {
                let owner = String::new();
                let bound = |modifiers: &[Option<&'static str>]| {
                    let left = |modifier: &_| Binding { button: "left", modifier: *modifier };
                    modifiers.iter().map(left).collect()
                };
                scene.put(Message::SetSceneNodeClickBindingsMessage {
                    name: name.clone(),
                    bindings: bound(&[None]),
                    owner: owner.clone(),
                });
                // Alt pulls the fingertip or end effector, Shift is fine.
                let bindings = bound(&[None, Some("alt"), Some("shift"), Some("alt+shift")]);
                scene.put(Message::SetSceneNodeDragBindingsMessage { name, bindings, owner });
            }
        }
    }
    let outline = outline(&geometry);
    let low = outline.iter().fold(Vec3::INFINITY, |a, p| a.min(*p));
    let high = outline.iter().fold(Vec3::NEG_INFINITY, |a, p| a.max(*p));
    let radius = f64::from(0.5 * low.distance(high)).clamp(1e-3, 1e3);
    let floor = f64::from(low.z).min(0.0);
    scene.put(Message::create("/floor", GridProps { shadow_opacity: 0.0, ..GridProps::default() }));
    scene.put(Message::position("/floor", [0.0, 0.0, floor - 1e-3]));
    let by_name = names.iter().enumerate().map(|(i, n)| (n.clone(), i)).collect();
    let corners =
        geometry.meshes.iter().filter(|m| m.body > 0).flat_map(|mesh| {
            mesh.vertices.as_chunks::<3>().0.iter().map(|corner| (mesh.body, corner))
        });
    let apart = Apart::new(names.len(), corners, 2.0 * radius);
    let hulls = hulls(&geometry);
    let bodies = names.len();
    let balls = geometry.meshes.iter().map(ball).collect();
    Cast {
        names,
        by_name,
        outline,
        hulls,
        radius,
        apart,
        meshes: geometry.meshes,
        balls,
        shown: vec![None; bodies],
        shades: vec![0; bodies],
        outlined: None,
    }
}

/// A ball around a mesh, in its body's frame.
fn ball(mesh: &MeshFacts) -> (V3, f64) {
    let corners = || mesh.vertices.as_chunks::<3>().0.iter().map(|c| c.map(f64::from));
    let low = corners().fold([f64::INFINITY; 3], |a, p| [0, 1, 2].map(|k: usize| min(a, p, k)));
    let high = corners().fold([f64::NEG_INFINITY; 3], |a, p| {
        [0, 1, 2].map(|k: usize| -min(space::scale(a, -1.0), space::scale(p, -1.0), k))
    });
    let middle = space::scale(space::add(low, high), 0.5);
    let radius = corners().map(|p| space::norm(space::sub(p, middle))).fold(0.0, f64::max);
    (middle, radius)
}

fn min(a: V3, b: V3, k: usize) -> f64 {
    let at = |v: V3| v.get(k).copied().unwrap_or(0.0);
    at(a).min(at(b))
}

/// The bodies of an actor, still without anything to see.
fn frames(scene: &mut Retained, actor: Actor, names: &[String]) {
    let root = actor.root();
    scene.put(Message::create(root, FrameProps::default()));
    for name in names.iter().skip(1) {
        scene.put(Message::create(&format!("{root}/{name}"), FrameProps::default()));
    }
}

/// What is there before any robot.
pub(super) fn empty(scene: &mut Retained, dark: bool) {
    scene.put(Message::z_up());
    scene.put(Message::visibility("/WorldAxes", false));
    scene.put(Message::EnableLightsMessage { enabled: true, cast_shadow: false });
    theme(scene, dark);
}

/// Light or dark page.
pub(super) fn theme(scene: &mut Retained, dark: bool) {
    scene.put(Message::ThemeConfigurationMessage {
        titlebar_content: None,
        control_layout: "floating",
        control_width: "small",
        show_logo: false,
        show_share_button: false,
        dark_mode: dark,
        colors: None,
    });
}

fn props(mesh: &MeshFacts) -> MeshProps {
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

/// The same mesh (and its bytes) in an actor's colour.
fn tinted(props: &MeshProps, tint: Option<([u8; 3], f64)>) -> MeshProps {
    let Some((color, opacity)) = tint else { return props.clone() };
    MeshProps { color, opacity: Some(opacity), side: "front", ..props.clone() }
}

/// The outermost points of each body that moves, in its own frame.
fn hulls(geometry: &Geometry) -> Vec<(usize, Vec<Vec3>)> {
    (1..geometry.bodies.len())
        .map(|body| {
            let meshes = geometry.meshes.iter().filter(|m| m.body == body);
            let corners = meshes.flat_map(|m| m.vertices.as_chunks::<3>().0);
            (body, framing::hull(corners.map(|c| Vec3::from_array(*c))))
        })
        .filter(|(_, hull)| !hull.is_empty())
        .collect()
}

/// The outermost points of the robot in its home pose; the world's own meshes (floors, tables)
/// do not count unless there is nothing else.
fn outline(geometry: &Geometry) -> Vec<Vec3> {
    let of = |own: bool| {
        let meshes = geometry.meshes.iter().filter(move |m| (m.body > 0) == own);
        framing::outline(meshes.flat_map(|mesh| {
            let place = Place::of(&geometry.home, mesh.body);
            mesh.vertices.chunks_exact(3).filter_map(move |corner| {
                let at = |k: usize| f64::from(corner.get(k).copied().unwrap_or(0.0));
                let p = place?.point([at(0), at(1), at(2)]);
                Some(Vec3::from_array(p.map(|v| v as f32)))
            })
        }))
    };
    let found = [of(true), of(false)].into_iter().find(|o| !o.is_empty());
    found.unwrap_or_else(|| vec![Vec3::splat(-0.5), Vec3::splat(0.5)])
}

impl Cast {
    /// Brings an actor on stage that was not there.
    pub(super) fn enter(&self, scene: &mut Retained, actor: Actor) {
        frames(scene, actor, &self.names);
        for (k, mesh) in self.meshes.iter().enumerate().filter(|(_, m)| m.body > 0) {
            let Some(body) = self.names.get(mesh.body) else { continue };
            let name = format!("{}/{body}/{k}", actor.root());
            scene.put(Message::create(&name, tinted(&props(mesh), actor.tint())));
        }
    }

    /// Moves an actor.
    pub(super) fn pose(
        &mut self,
        scene: &mut Retained,
        actor: Actor,
        place: impl Fn(usize) -> Option<Place>,
    ) {
        for (body, name) in self.names.iter().enumerate().skip(1) {
            let Some(place) = place(body) else { continue };
            if actor == Actor::Robot
                && let Some(shown) = self.shown.get_mut(body)
            {
                *shown = Some(place);
            }
            let node = format!("{}/{name}", actor.root());
            scene.put(Message::position(&node, place.pos));
            scene.put(Message::orientation(&node, place.quat));
        }
    }

    /// Shows of an actor what is elsewhere than the solid robot; all of it where either is not
    /// known.
    pub(super) fn unveil(
        &self,
        scene: &mut Retained,
        actor: Actor,
        place: impl Fn(usize) -> Option<(Place, Place)>,
    ) {
        for (body, name) in self.names.iter().enumerate().skip(1) {
            let seen = place(body)
                .is_none_or(|(real, asked)| self.apart.seen(body, &real.row(), &asked.row()));
            scene.put(Message::visibility(&format!("{}/{name}", actor.root()), seen));
        }
    }

    /// Colours each link of the command by how far the solid robot's is from it, as exported
    /// pictures do; plain where either is not known.
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
                    let node = format!("{}/{name}/{k}", Actor::Command.root());
                    scene.put(Message::recolor(&node, color));
                }
            }
        }
    }

    /// Outlines one body where it is, or none.
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

    /// Where a body of the solid robot is.
    pub(super) fn shown(&self, body: usize) -> Option<Place> {
        self.shown.get(body).copied().flatten()
    }

    /// The body of the solid robot that a ray meets first.
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
            if let Some(far) = look::hit(mesh, &place, eye, ray)
                && best.is_none_or(|(b, _)| far < b)
            {
                best = Some((far, mesh.body));
            }
        }
        best.map(|(_, body)| body)
    }

    /// The outermost points of a body where it is shown, or of what it carries if nothing of
    /// itself is seen.
    pub(super) fn around(&self, facts: &RobotFacts, body: usize) -> Option<Vec<Vec3>> {
        let carried = |mut b: usize| {
            while b != body && b != 0 {
                b = facts.bodies.get(b).map_or(0, |f| f.parent);
            }
            b == body
        };
        let points = |of: &dyn Fn(usize) -> bool| -> Vec<Vec3> {
            let hulls = self.hulls.iter().filter(|(b, _)| of(*b));
            hulls
                .filter_map(|(b, hull)| Some((self.shown(*b)?, hull)))
                .flat_map(|(place, hull)| {
                    hull.iter().map(move |p| {
                        let at = place.point(p.to_array().map(f64::from));
                        Vec3::from_array(at.map(|v| v as f32))
                    })
                })
                .collect()
        };
        let own = points(&|b| b == body);
        let found = if own.is_empty() { points(&carried) } else { own };
        (!found.is_empty()).then_some(found)
    }

    /// Points the camera at some points, from where the robot is usually seen.
    pub(super) fn look_at(scene: &mut Retained, facts: &RobotFacts, points: &[Vec3]) -> bool {
        let fov = facts.camera.fovy_rad.clamp(0.2, 2.0);
        let view = View::of(&robot::Camera { fovy_rad: fov, ..facts.camera });
        Self::put_camera(scene, &framing::near(&view, points), fov);
        true
    }

    fn put_camera(scene: &mut Retained, camera: &render::Camera, fov: f64) {
        let [position, look_at] = [camera.eye, camera.target].map(|p| p.to_array().map(f64::from));
        let initial = true;
        scene.put(Message::SetCameraUpDirectionMessage { position: [0.0, 0.0, 1.0], initial });
        scene.put(Message::SetCameraFovMessage { fov, initial });
        scene.put(Message::SetCameraPositionMessage { position, initial });
        scene.put(Message::SetCameraLookAtMessage { look_at, initial });
    }

    /// The body that a node of the solid robot belongs to.
    pub(super) fn body_of(&self, node: &str) -> Option<usize> {
        let name = node.strip_prefix("/robot/")?.split('/').next()?;
        self.by_name.get(name).copied()
    }

    /// The outermost points of the robot in all of these poses, (nbody, 7) each.
    fn reach(&self, poses: &[Arc<[f32]>]) -> Vec<Vec3> {
        framing::outline(poses.iter().flat_map(|bodies| {
            self.hulls.iter().flat_map(|(body, hull)| {
                let place = Place::of(bodies, *body);
                hull.iter().filter_map(move |p| {
                    let at = place?.point(p.to_array().map(f64::from));
                    Some(Vec3::from_array(at.map(|v| v as f32)))
                })
            })
        }))
    }

    /// Points the camera so that the whole robot is in view, also in these poses of its motion.
    pub(super) fn camera(
        &self,
        scene: &mut Retained,
        facts: &RobotFacts,
        preset: &str,
        poses: &[Arc<[f32]>],
    ) -> bool {
        use std::f32::consts::FRAC_PI_2;
        let fov = facts.camera.fovy_rad.clamp(0.2, 2.0);
        let view = View::of(&robot::Camera { fovy_rad: fov, ..facts.camera });
        let moved = self.reach(poses);
        let points = if moved.is_empty() { &self.outline } else { &moved };
        let camera = match preset {
            // With nothing selected all of it is.
            "home" | "fit" | "selection" => framing::near(&view, points),
            "front" => framing::from(&view.from(0.0, 0.0), points),
            "side" => framing::from(&view.from(-FRAC_PI_2, 0.0), points),
            // Not straight down: the horizon would have no direction.
            "top" => framing::from(&view.from(-FRAC_PI_2, FRAC_PI_2 - 1e-3), points),
            _ => return false,
        };
        Self::put_camera(scene, &camera, fov);
        true
    }

    /// A good size for a gizmo, m.
    pub(super) fn gizmo_scale(&self) -> f64 {
        self.radius * 0.35
    }
}
