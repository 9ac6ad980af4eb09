//! `robert bench render`: processor time of a picture.

use std::sync::Arc;
use std::time::Instant;

use serde::Serialize;

use super::clock::median;
use crate::cli::failure::{Failure, Outcome};
use crate::cli::out;
use crate::render::{
    Backend, Camera, FrameInput, Ghost, Lens, Quality, RenderConfig, Renderer, Stage, sun_for,
};
use crate::robot::Robot;

/// Frames drawn before the clock starts: the driver compiles its shaders on the first.
const WARM_UP: usize = 3;
/// Clock ticks a second of `/proc/self/stat` (fixed in Linux's interface to user space).
const TICKS: f64 = 100.0;

// Flags of a command line.
#[allow(clippy::struct_excessive_bools)]
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert bench render --json --robot shadow_hand\n  python benches/peers/render.py --robert target/release/robert   (in turns with MuJoCo's)"
)]
pub(super) struct Args {
    /// Robot: an id, or a folder with robot.xml.
    #[arg(long, default_value = "shadow_hand")]
    robot: String,
    /// Frames to measure.
    #[arg(long, default_value_t = 30)]
    frames: usize,
    /// Width of the picture, pixels.
    #[arg(long, default_value_t = 640)]
    width: u32,
    /// Height of the picture, pixels.
    #[arg(long, default_value_t = 480)]
    height: u32,
    /// Preview quality: 1 sample per pixel, shadow map of 1024.
    #[arg(long)]
    preview: bool,
    /// Also draw the ghost of the command.
    #[arg(long)]
    ghost: bool,
    /// Use the software driver only.
    #[arg(long)]
    cpu: bool,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Report {
    robot: String,
    adapter: String,
    width: u32,
    height: u32,
    samples: u32,
    shadow_px: u32,
    geoms: usize,
    frames: usize,
    /// From the call to the end of the first picture.
    first_picture_ms: f64,
    /// Processor time of all threads.
    cpu_ms_per_frame: f64,
    wall_ms_per_frame: f64,
    wall_ms_median: f64,
    /// The eye of the camera, so that another renderer can use the same view.
    eye: [f32; 3],
    target: [f32; 3],
    fov_y_deg: f32,
}

pub(super) fn run(args: &Args) -> Outcome {
    if args.frames == 0 || args.frames > 100_000 {
        return Err(Failure::usage("--frames takes 1 to 100000"));
    }
    let start = Instant::now();
    let robot = Arc::new(Robot::load(&args.robot)?);
    let mut stage = Stage::new(&robot)?;
    let config = RenderConfig {
        width: args.width,
        height: args.height,
        quality: if args.preview { Quality::Preview } else { Quality::Export },
        backend: if args.cpu { Backend::Cpu } else { Backend::Auto },
        ..RenderConfig::default()
    };
    let mut renderer = Renderer::new(config)?;
    let home = robot.home();
    let poses = stage.poses(&home)?;
    let aspect = args.width as f32 / args.height as f32;
    let camera = Camera::fit(&stage.moving_corners(&poses), &stage.view(), aspect);
    let mut frame = |i: usize| -> Outcome {
        let state = at(&home, i);
        let poses = stage.poses(&state)?;
        let behind = stage.poses(&at(&home, i + 6))?;
        let ghosts = [Ghost::command(&behind)];
        let input = FrameInput {
            ghosts: if args.ghost { &ghosts } else { &[] },
            sun: Some(sun_for(&camera)),
            ..FrameInput::new(&poses, camera)
        };
        renderer.draw(stage.scene(), &input)?;
        Ok(())
    };
    frame(0)?;
    let first = start.elapsed();
    for i in 1..WARM_UP {
        frame(i)?;
    }
    let (cpu, clock) = (process_cpu_secs(), Instant::now());
    let mut walls = Vec::with_capacity(args.frames);
    for i in 0..args.frames {
        let one = Instant::now();
        frame(WARM_UP + i)?;
        walls.push(1e3 * one.elapsed().as_secs_f64());
    }
    let per_frame = 1e3 / args.frames as f64;
    let cpu_ms = per_frame * (process_cpu_secs() - cpu);
    let wall_ms = per_frame * clock.elapsed().as_secs_f64();
    let (samples, shadow_px) = renderer.samples();
    let fov_y_deg = match camera.lens {
        Lens::Perspective { fov_y_rad } => fov_y_rad.to_degrees(),
        Lens::Orthographic { .. } => 0.0,
    };
    let report = Report {
        robot: args.robot.clone(),
        adapter: renderer.adapter().0,
        width: args.width,
        height: args.height,
        samples,
        shadow_px,
        geoms: stage.scene().geoms().len(),
        frames: args.frames,
        first_picture_ms: 1e3 * first.as_secs_f64(),
        cpu_ms_per_frame: cpu_ms,
        wall_ms_per_frame: wall_ms,
        wall_ms_median: median(&mut walls),
        eye: camera.eye.to_array(),
        target: camera.target.to_array(),
        fov_y_deg,
    };
    if args.json {
        return out::json(&report);
    }
    out::line(&format!(
        "{} {}x{} ({} samples, shadow {}) on {}: {:.1} ms processor time a frame, {:.1} ms wall ({:.1} frames/s); first picture after {:.0} ms",
        report.robot,
        report.width,
        report.height,
        samples,
        shadow_px,
        report.adapter,
        cpu_ms,
        wall_ms,
        1e3 / wall_ms,
        report.first_picture_ms
    ))
}

/// The pose of a frame: every joint swings a little about home, as the peer script does.
fn at(home: &[f64], frame: usize) -> Vec<f64> {
    let swing = |(j, q): (usize, &f64)| q + 0.15 * (0.2 * frame as f64 + j as f64).sin();
    home.iter().enumerate().map(swing).collect()
}

/// User and system time of the whole process: a software driver draws on threads of its own.
fn process_cpu_secs() -> f64 {
    let text = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The name in brackets may hold blanks; fields 14 and 15 are counted behind it.
    let rest = text.rsplit_once(") ").map_or("", |r| r.1);
    let field = |k: usize| rest.split(' ').nth(k).and_then(|f| f.parse::<f64>().ok());
    match (field(11), field(12)) {
        (Some(user), Some(system)) => (user + system) / TICKS,
        _ => 0.0,
    }
}
