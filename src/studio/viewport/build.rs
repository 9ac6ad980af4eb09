//! Puts a robot into the scene.

use glam::Vec3;

use super::figure::Figure;
use super::framing;
use super::overlays::Look;
use super::retained::Retained;
use super::scene_nodes::{OUTLINE, SceneNodes, frames, props, tinted};
use super::space::{self, Place, V3};
use crate::protocol::{Geometry, MeshFacts};
use robert_take::viser::{Apart, Binding, FrameProps, GridProps, MeshProps, Message, node_name};

/// Puts a robot into the scene and removes the one before.
pub(super) fn build(scene: &mut Retained, geometry: Geometry, look: Look) -> SceneNodes {
    for root in Figure::ALL.map(Figure::root).into_iter().chain(["/world", "/gizmo", OUTLINE]) {
        scene.remove(root);
    }
    let names: Vec<String> = geometry.bodies.iter().map(|b| node_name(b)).collect();
    for figure in Figure::FROM_THE_START {
        frames(scene, figure, &names);
    }
    scene.put(Message::create("/world", FrameProps::default()));
    for (k, mesh) in geometry.meshes.iter().enumerate() {
        let props = props(mesh);
        let solid = MeshProps { cast_shadow: props.opacity.is_none(), ..props.clone() };
        let Some(body) = names.get(mesh.body).filter(|_| mesh.body > 0) else {
            // A floor or a table of the model's own.
            let props = MeshProps { receive_shadow: true, ..solid };
            scene.put(Message::create(&format!("/world/{k}"), props));
            continue;
        };
        for figure in Figure::FROM_THE_START {
            let name = format!("{}/{body}/{k}", figure.root());
            let props = if figure == Figure::Robot { &solid } else { &props };
            scene.put(Message::create(&name, tinted(props, figure.tint())));
            if figure == Figure::Robot {
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
                // Alt pulls the fingertip or end effector, Shift moves finely.
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
    scene.put(Message::create("/floor", ground(radius, look)));
    scene.put(Message::position("/floor", [0.0, 0.0, floor - 1e-3]));
    let corners =
        geometry.meshes.iter().filter(|m| m.body > 0).flat_map(|mesh| {
            mesh.vertices.as_chunks::<3>().0.iter().map(|corner| (mesh.body, corner))
        });
    let apart = Apart::new(names.len(), corners, 2.0 * radius);
    let hulls = hulls(&geometry);
    let bodies = names.len();
    let balls = geometry.meshes.iter().map(ball).collect();
    SceneNodes {
        names,
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

/// The ground: a plane under a grid whose squares suit the robot's size. It is lost in the background
/// far from the robot.
fn ground(radius: f64, look: Look) -> GridProps {
    // The power of ten below the robot's size, and its half where that is nearer.
    let ten = 10_f64.powf((radius.max(1e-3)).log10().floor());
    let section = if radius > 5.0 * ten { 5.0 * ten } else { ten };
    let (plane, line, shadow) = if look.dark {
        ([44, 50, 60], [104, 114, 128], 0.62)
    } else {
        ([226, 231, 237], [150, 160, 172], 0.34)
    };
    GridProps {
        cell_color: line,
        cell_size: section / 5.0,
        cell_thickness: 0.35,
        section_color: line,
        section_size: section,
        section_thickness: 0.8,
        fade_distance: 16.0 * radius,
        fade_strength: 2.2,
        shadow_opacity: if look.shadows { shadow } else { 0.0 },
        plane_color: plane,
        plane_opacity: 0.85,
        ..GridProps::default()
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
    a[k].min(b[k])
}

/// The scene before any robot is loaded.
pub(super) fn empty(scene: &mut Retained) {
    scene.put(Message::z_up());
    scene.put(Message::visibility("/WorldAxes", false));
    dress(scene, Look::default(), None);
}

/// Ground and light as pages want them; the ground suits a robot of this radius, m.
pub(super) fn dress(scene: &mut Retained, look: Look, radius: Option<f64>) {
    scene.put(Message::EnableLightsMessage { enabled: true, cast_shadow: look.shadows });
    if let Some(radius) = radius {
        scene.put(Message::create("/floor", ground(radius, look)));
    }
    scene.put(Message::ThemeConfigurationMessage {
        titlebar_content: None,
        control_layout: "floating",
        control_width: "small",
        show_logo: false,
        show_share_button: false,
        dark_mode: look.dark,
        colors: None,
    });
}

/// The outermost points of each moving body, in its own frame.
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
                let p = place?.point([0, 1, 2].map(|k| f64::from(corner[k])));
                Some(Vec3::from_array(p.map(|v| v as f32)))
            })
        }))
    };
    let found = [of(true), of(false)].into_iter().find(|o| !o.is_empty());
    found.unwrap_or_else(|| vec![Vec3::splat(-0.5), Vec3::splat(0.5)])
}
