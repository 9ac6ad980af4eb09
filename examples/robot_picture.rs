//! Run with: cargo run --example `robot_picture` -- `shadow_hand` gun out.png
#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use robert::render::{Camera, Caption, FrameInput, Ghost, RenderConfig, Renderer, Stage, encode};
use robert::robot::Robot;

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let robot = Arc::new(Robot::builtin(&args[1]).unwrap());
    let mut stage = Stage::new(&robot).unwrap();
    let state = robot.pose(&args[2]).unwrap();
    let poses = stage.poses(&state).unwrap();
    let other = stage.poses(&robot.home()).unwrap();
    let (w, h) = (960, 720);
    let mut renderer =
        Renderer::new(RenderConfig { width: w, height: h, ..RenderConfig::default() }).unwrap();
    let camera = Camera::fit(&stage.scene().corners(&poses), &stage.view(), w as f32 / h as f32);
    let caption = Caption {
        title: format!("{}: {}", args[1], args[2]),
        line: Caption::moment(40, 2.0, Some((0.031, "rad"))),
        ..Caption::default()
    };
    let ghosts = [Ghost::command(&other)];
    let input = FrameInput {
        ghosts: if args.len() > 4 { &ghosts } else { &[] },
        caption: Some(&caption),
        sun: Some(robert::render::sun_for(&camera)),
        ..FrameInput::new(&poses, camera)
    };
    let picture = renderer.draw(stage.scene(), &input).unwrap();
    encode::save(&picture, std::path::Path::new(&args[3])).unwrap();
}
