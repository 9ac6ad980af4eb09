//! A robot as nodes of the scene: bodies are frames, what is seen of them hangs below.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::Vec3;

use super::framing;
use super::retained::Retained;
use super::space::Place;
use crate::render::View;
use crate::robot;
use crate::studio::worker::{Geometry, MeshFacts, RobotFacts};
use crate::take::viser::{
    Apart, Binding, Buffer, FrameProps, GridProps, MeshProps, Message, node_name,
};

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
}

impl Actor {
    /// Everyone.
    pub(super) const ALL: [Actor; 4] = [Actor::Robot, Actor::Command, Actor::Past, Actor::Future];

    /// Its node.
    pub(super) fn root(self) -> &'static str {
        match self {
            Actor::Robot => "/robot",
            Actor::Command => "/command",
            Actor::Past => "/past",
            Actor::Future => "/future",
        }
    }

    /// sRGB and opacity in place of its own colours: blue command, green past, amber future.
    fn tint(self) -> Option<[f32; 4]> {
        match self {
            Actor::Robot => None,
            Actor::Command => Some([0.27, 0.51, 0.96, 0.3]),
            Actor::Past => Some([0.16, 0.65, 0.44, 0.18]),
            Actor::Future => Some([0.93, 0.58, 0.14, 0.18]),
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
}

/// Puts a robot on stage; what stood there before goes.
pub(super) fn build(scene: &mut Retained, geometry: &Geometry) -> Cast {
    for root in Actor::ALL.map(Actor::root).into_iter().chain(["/world", "/gizmo"]) {
        scene.remove(root);
    }
    let names: Vec<String> = geometry.bodies.iter().map(|b| node_name(b)).collect();
    for actor in Actor::ALL {
        let root = actor.root();
        scene.put(Message::create(root, FrameProps::default()));
        for name in names.iter().skip(1) {
            scene.put(Message::create(&format!("{root}/{name}"), FrameProps::default()));
        }
    }
    scene.put(Message::create("/world", FrameProps::default()));
    for (k, mesh) in geometry.meshes.iter().enumerate() {
        let props = props(mesh);
        let Some(body) = names.get(mesh.body).filter(|_| mesh.body > 0) else {
            scene.put(Message::create(&format!("/world/{k}"), props));
            continue;
        };
        for actor in Actor::ALL {
            let name = format!("{}/{body}/{k}", actor.root());
            scene.put(Message::create(&name, tinted(&props, actor.tint())));
            if actor == Actor::Robot {
                let left = vec![Binding { button: "left", modifier: None }];
                let owner = String::new();
                scene.put(Message::SetSceneNodeClickBindingsMessage {
                    name: name.clone(),
                    bindings: left.clone(),
                    owner: owner.clone(),
                });
                scene.put(Message::SetSceneNodeDragBindingsMessage { name, bindings: left, owner });
            }
        }
    }
    let outline = outline(geometry);
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
    Cast { names, by_name, outline, hulls: hulls(geometry), radius, apart }
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
fn tinted(props: &MeshProps, tint: Option<[f32; 4]>) -> MeshProps {
    let Some(rgba) = tint else { return props.clone() };
    let byte = |v: f32| (v * 255.0).round() as u8;
    MeshProps {
        color: [byte(rgba[0]), byte(rgba[1]), byte(rgba[2])],
        opacity: Some(f64::from(rgba[3])),
        side: "front",
        ..props.clone()
    }
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
    /// Moves an actor.
    pub(super) fn pose(
        &self,
        scene: &mut Retained,
        actor: Actor,
        place: impl Fn(usize) -> Option<Place>,
    ) {
        for (body, name) in self.names.iter().enumerate().skip(1) {
            let Some(place) = place(body) else { continue };
            let node = format!("{}/{name}", actor.root());
            scene.put(Message::position(&node, place.pos));
            scene.put(Message::orientation(&node, place.quat));
        }
    }

    /// Shows of the command what is elsewhere than the solid robot; all of it where either is
    /// not known.
    pub(super) fn unveil(
        &self,
        scene: &mut Retained,
        place: impl Fn(usize) -> Option<(Place, Place)>,
    ) {
        for (body, name) in self.names.iter().enumerate().skip(1) {
            let seen = place(body)
                .is_none_or(|(real, asked)| self.apart.seen(body, &real.row(), &asked.row()));
            scene.put(Message::visibility(&format!("{}/{name}", Actor::Command.root()), seen));
        }
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
            "home" | "fit" => framing::near(&view, points),
            "front" => framing::from(&view.from(0.0, 0.0), points),
            "side" => framing::from(&view.from(-FRAC_PI_2, 0.0), points),
            // Not straight down: the horizon would have no direction.
            "top" => framing::from(&view.from(-FRAC_PI_2, FRAC_PI_2 - 1e-3), points),
            _ => return false,
        };
        let [position, look_at] = [camera.eye, camera.target].map(|p| p.to_array().map(f64::from));
        let initial = true;
        scene.put(Message::SetCameraUpDirectionMessage { position: [0.0, 0.0, 1.0], initial });
        scene.put(Message::SetCameraFovMessage { fov, initial });
        scene.put(Message::SetCameraPositionMessage { position, initial });
        scene.put(Message::SetCameraLookAtMessage { look_at, initial });
        true
    }

    /// A good size for a gizmo, m.
    pub(super) fn gizmo_scale(&self) -> f64 {
        self.radius * 0.35
    }
}
