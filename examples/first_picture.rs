//! Run with: cargo run --example `first_picture` -- out.png
//!
//! Draws one of each shape with the ghost of a command, without the simulator.

#![allow(clippy::unwrap_used)]

use glam::{Mat3, Vec3};
use robert::render::{
    Camera, Caption, Floor, FrameInput, Geom, Ghost, Pose, RenderConfig, Renderer, Scene, Shape,
    View, encode,
};

fn main() {
    let path = std::env::args().nth(1).unwrap_or_else(|| "first_picture.png".into());
    let shapes = [
        Shape::Sphere { radius: 0.1 },
        Shape::Capsule { radius: 0.05, half_length: 0.1 },
        Shape::Ellipsoid { radii: Vec3::new(0.12, 0.07, 0.05) },
        Shape::Cylinder { radius: 0.07, half_length: 0.09 },
        Shape::Box { half: Vec3::new(0.06, 0.09, 0.08) },
    ];
    let colors =
        [[0.9, 0.9, 0.9], [0.2, 0.22, 0.25], [0.75, 0.2, 0.15], [0.2, 0.5, 0.75], [0.9, 0.6, 0.1]];
    let geoms: Vec<Geom> = shapes
        .iter()
        .zip(colors)
        .map(|(shape, c)| Geom {
            name: String::new(),
            body: 0,
            shape: *shape,
            rgba: [c[0], c[1], c[2], 1.0],
        })
        .collect();
    let poses: Vec<Pose> = (0..5).map(|i| Pose::at(0.3 * i as f32 - 0.6, 0.0, 0.16)).collect();
    let turned: Vec<Pose> = poses
        .iter()
        .map(|p| Pose { pos: p.pos + Vec3::new(0.02, -0.1, 0.1), rot: Mat3::from_rotation_x(0.8) })
        .collect();
    let scene = Scene::new(geoms, vec![], Some(Floor { z: 0.0 })).unwrap();
    let mut renderer =
        Renderer::new(RenderConfig { width: 960, height: 540, ..RenderConfig::default() }).unwrap();
    let camera = Camera::fit(&scene.corners(&poses), &View::default(), 960.0 / 540.0);
    let caption = Caption {
        title: "one of each".into(),
        line: Caption::moment(40, 2.0, Some((0.031, "rad"))),
        ..Caption::default()
    };
    let input = FrameInput {
        ghosts: &[Ghost::command(&turned)],
        caption: Some(&caption),
        ..FrameInput::new(&poses, camera)
    };
    let picture = renderer.draw(&scene, &input).unwrap();
    encode::save(&picture, std::path::Path::new(&path)).unwrap();
    println!("{path}: {}", renderer.adapter().0);
}
