//! `robert render`: a clip as a picture, a film strip or a film.
//!
//! A clip is performed first (by `--policy`, or not at all with `--kinematic`); what is drawn is
//! a [`Motion`], commanded and achieved states frame by frame, whoever made it.

use std::path::PathBuf;
use std::sync::Arc;

use super::bar::Bar;
use super::failure::{Failure, Outcome};
use super::{motion, out};
use crate::clip::{Clip, Command, compile};
use crate::limits;
use crate::progress::{Cancel, Progress};
use crate::render::encode::{self, Film, FilmFormat, VideoWriter};
use crate::render::{
    Backend, CameraChoice, Motion, Overlay, Picture, Quality, RenderConfig, Renderer, Shot,
};
use crate::robot::Robot;
use crate::rollout::{Guide, PolicyConfig, Rollout, RolloutConfig, Start};
use crate::units::FPS;

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert render wave.clip.json -o wave.mp4\n  robert render wave.clip.json -o still.png --frames 40 --size 1280x720\n  robert render wave.clip.json -o strip.png --strip 6\n  robert render wave.clip.json -o both.gif --compare other.clip.json --overlay ghost,caption\n  robert render wave.clip.json -o preview.mp4 --kinematic --camera orbit"
)]
pub(super) struct Args {
    /// The clip: a file, or the name of a shipped task (`fire`).
    clip: String,
    /// Where to: .png, .jpg (one picture), .mp4, .gif, .apng (a film).
    #[arg(short, long)]
    output: PathBuf,
    /// Which frames: `40`, `0..100` or `10,20,30`. A still takes the last unless told.
    #[arg(long)]
    frames: Option<String>,
    /// Pixels, width x height.
    #[arg(long, default_value = "640x480")]
    size: String,
    /// fit, fixed, top, orbit, follow:BODY, or a camera of the model.
    #[arg(long, default_value = "fit")]
    camera: String,
    /// What is laid over: ghost, error, onion, trail, caption, axes, contacts; or none.
    #[arg(long, default_value = "ghost,error,trail,caption")]
    overlay: String,
    /// A second clip beside the first.
    #[arg(long)]
    compare: Option<String>,
    /// One picture of this many moments.
    #[arg(long, value_name = "N")]
    strip: Option<usize>,
    /// Who performs the clip, with +guide or +refine [default: the robot's trained policy,
    /// else computed-torque].
    #[arg(long)]
    policy: Option<String>,
    /// The robot, where it is not known by the clip's own name: an id, or a folder.
    #[arg(long, value_name = "ID|DIR")]
    robot: Option<String>,
    /// Show the commanded poses without simulating anything.
    #[arg(long)]
    kinematic: bool,
    /// Seed of the policy.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// preview (fast) or export (4 samples a pixel).
    #[arg(long, default_value = "export")]
    quality: String,
    /// auto, gpu or cpu.
    #[arg(long, default_value = "auto")]
    renderer: String,
    /// Print one JSON document about what was written.
    #[arg(long)]
    json: bool,
}

/// Checked values.
struct Plan {
    output: PathBuf,
    film: Option<FilmFormat>,
    frames: Option<Vec<usize>>,
    config: RenderConfig,
    camera: CameraChoice,
    overlay: Overlay,
    strip: Option<usize>,
    performer: Performer,
}

enum Performer {
    Nobody,
    /// Who, or the default of the robot; the seed.
    Policy(Option<PolicyConfig>, u64),
}

/// Moments in a strip at most.
const STRIP: usize = 64;
/// Pictures in one row of a strip.
const COLUMNS: usize = 6;

pub(super) fn run(args: &Args, quiet: bool) -> Outcome {
    let plan = Plan::new(args)?;
    let mut clips = vec![load(&args.clip, args.robot.as_deref())?];
    if let Some(other) = &args.compare {
        clips.push(load(other, args.robot.as_deref())?);
    }
    // The device first: a machine without a driver says so before anything is simulated.
    let mut renderer = Renderer::new(plan.config)?;
    let aspect = plan.config.width as f32 / plan.config.height as f32;
    let mut shots = Vec::new();
    for (robot, clip) in &clips {
        let motion = perform(robot, clip, &plan.performer, quiet)?;
        shots.push(Shot::new(robot, motion, plan.overlay, &plan.camera, aspect)?);
    }
    let total = shots.iter().map(|s| s.motion().frames()).max().unwrap_or(1);
    let frames = plan.wanted(total)?;
    let bar = Bar::new("render", "frames", quiet);
    let written = match plan.film {
        Some(format) => film(&plan, format, &frames, &mut shots, &mut renderer, &bar),
        None => still(&plan, &frames, &mut shots, &mut renderer, &bar),
    };
    bar.finish();
    let (pictures, bytes, size) = written?;
    let adapter = renderer.adapter().0;
    if args.json {
        return out::json(&serde_json::json!({
            "path": plan.output, "frames": pictures, "bytes": bytes,
            "width": size.0, "height": size.1, "adapter": adapter,
            "precision": shots.iter().map(|s| s.motion().precision(total)).collect::<Vec<_>>(),
        }));
    }
    out::line(&format!(
        "{}: {pictures} frame{}, {}x{} px, {} kB",
        plan.output.display(),
        if pictures == 1 { "" } else { "s" },
        size.0,
        size.1,
        bytes.div_ceil(1000)
    ))
}

impl Plan {
    fn new(args: &Args) -> Outcome<Plan> {
        let film = FilmFormat::of(&args.output);
        let ending = encode::ending(&args.output);
        if film.is_none() && !["png", "jpg", "jpeg"].contains(&ending.as_str()) {
            return Err(Failure::usage(format!(
                "cannot tell the format of {}: end it in {}",
                args.output.display(),
                encode::ENDINGS
            )));
        }
        if film.is_some() && args.strip.is_some() {
            return Err(Failure::usage("a strip is one picture: end the output in .png or .jpg"));
        }
        if let Some(n) = args.strip
            && !(1..=STRIP).contains(&n)
        {
            return Err(Failure::usage(format!("--strip takes 1 to {STRIP} moments, not {n}")));
        }
        let (width, height) = size(&args.size)?;
        let quality = match args.quality.as_str() {
            "preview" => Quality::Preview,
            "export" => Quality::Export,
            other => return Err(unknown("quality", other, "preview, export")),
        };
        let backend = match args.renderer.as_str() {
            "auto" => Backend::Auto,
            "gpu" => Backend::Gpu,
            "cpu" => Backend::Cpu,
            other => return Err(unknown("renderer", other, "auto, gpu, cpu")),
        };
        let performer = if args.kinematic {
            Performer::Nobody
        } else {
            let policy = args.policy.as_ref();
            let policy = policy.map(|p| motion::policy(p, Guide::None, false)).transpose()?;
            Performer::Policy(policy, args.seed)
        };
        Ok(Plan {
            output: args.output.clone(),
            film,
            frames: args.frames.as_deref().map(frames).transpose()?,
            config: RenderConfig { width, height, quality, backend, ..RenderConfig::default() },
            camera: CameraChoice::parse(&args.camera),
            overlay: Overlay::parse(&args.overlay)?,
            strip: args.strip,
            performer,
        })
    }

    /// The frames to draw out of `total`.
    fn wanted(&self, total: usize) -> Outcome<Vec<usize>> {
        if let Some(list) = &self.frames {
            if let Some(beyond) = list.iter().find(|f| **f >= total) {
                return Err(Failure::invalid(format!(
                    "frame {beyond} is beyond the clip: it has frames 0 to {}",
                    total - 1
                )));
            }
            return Ok(list.clone());
        }
        Ok(match (self.film, self.strip) {
            (Some(_), _) => (0..total).collect(),
            (None, Some(n)) => (0..n).map(|i| (i + 1) * (total - 1) / n.max(1)).collect(),
            (None, None) => vec![total - 1],
        })
    }
}

fn unknown(what: &str, word: &str, known: &str) -> Failure {
    Failure::usage(format!("no {what} named {word:?}; there are: {known}"))
}

/// `640x480`.
fn size(text: &str) -> Outcome<(u32, u32)> {
    let parsed = text
        .split_once('x')
        .and_then(|(w, h)| Some((w.trim().parse().ok()?, h.trim().parse().ok()?)));
    parsed.ok_or_else(|| Failure::usage(format!("--size takes WIDTHxHEIGHT, not {text:?}")))
}

/// `40`, `0..100` (without its end), `10,20,30`.
fn frames(text: &str) -> Outcome<Vec<usize>> {
    let bad = || Failure::usage(format!("--frames takes 40, 0..100 or 10,20,30, not {text:?}"));
    let number = |t: &str| t.trim().parse::<usize>().map_err(|_not_a_number| bad());
    if let Some((from, to)) = text.split_once("..") {
        let (from, to) = (number(from)?, number(to)?);
        if from >= to || to > limits::CLIP_FRAMES as usize {
            return Err(bad());
        }
        return Ok((from..to).collect());
    }
    text.split(',').map(number).collect()
}

fn load(text: &str, robot: Option<&str>) -> Outcome<(Arc<Robot>, Clip)> {
    let clip = motion::clip(text, robot)?;
    Ok((motion::robot(robot.unwrap_or(&clip.robot.id))?, clip))
}

/// The clip performed, or only laid out.
fn perform(robot: &Arc<Robot>, clip: &Clip, performer: &Performer, quiet: bool) -> Outcome<Motion> {
    let command = compile(clip).map_err(Failure::invalid)?;
    let names: Vec<String> = robot.joints().iter().map(|j| j.name.clone()).collect();
    let command = command.reordered(&names).ok_or_else(|| {
        Failure::invalid(format!("the clip's joints are not those of {}", robot.id()))
    })?;
    let (achieved, performer) = match performer {
        Performer::Nobody => {
            let rows = (0..command.frames()).map(|f| wide(&command.interpolated(f))).collect();
            (rows, "not simulated".to_owned())
        }
        Performer::Policy(policy, seed) => {
            let policy = policy.clone().unwrap_or_else(|| PolicyConfig::default_for(robot));
            let config =
                RolloutConfig { seed: *seed, guide: policy.guide, ..RolloutConfig::default() };
            let built = policy.build(robot)?;
            let mut rollout = Rollout::new(robot, built, &command, Start::Pose, config)?;
            let bar = Bar::new("simulate", "frames", quiet);
            let cancel = Cancel::default();
            while !rollout.is_done() && !cancel.is_cancelled() {
                rollout.step()?;
                bar.tick(rollout.frame() as u64, rollout.frames() as u64, "");
            }
            bar.finish();
            let rows =
                rollout.reached().chunks_exact(robot.state_dim()).map(<[f64]>::to_vec).collect();
            (rows, policy.label())
        }
    };
    let unit = robot.joints().first().map_or("rad", |j| j.unit.symbol());
    Ok(Motion {
        name: clip.name.clone(),
        performer,
        fps: f64::from(FPS),
        commanded: commanded(&command),
        achieved,
        keys: clip.keys.iter().map(|k| k.frame as usize).collect(),
        unit: unit.to_owned(),
    })
}

fn wide(row: &[f32]) -> Vec<f64> {
    row.iter().map(|v| f64::from(*v)).collect()
}

fn commanded(command: &Command) -> Vec<Vec<f64>> {
    (0..command.frames())
        .map(|f| {
            let row = command.row(f).iter().enumerate();
            row.map(|(j, v)| if command.sees(f, j) { f64::from(*v) } else { f64::NAN }).collect()
        })
        .collect()
}

fn moment(shots: &mut [Shot], renderer: &mut Renderer, frame: usize) -> Outcome<Picture> {
    let mut pictures = Vec::with_capacity(shots.len());
    for shot in shots {
        pictures.push(shot.draw(renderer, frame)?);
    }
    Ok(Picture::beside(&pictures)?)
}

type Done = (u64, u64, (u32, u32));

fn still(
    plan: &Plan,
    frames: &[usize],
    shots: &mut [Shot],
    renderer: &mut Renderer,
    bar: &Bar,
) -> Outcome<Done> {
    let mut pictures = Vec::with_capacity(frames.len());
    for (i, frame) in frames.iter().enumerate() {
        if i >= STRIP {
            return Err(Failure::usage(format!(
                "{} frames do not fit one picture (at most {STRIP}): end the output in .mp4",
                frames.len()
            )));
        }
        pictures.push(moment(shots, renderer, *frame)?);
        bar.tick(i as u64 + 1, frames.len() as u64, "");
    }
    let picture = Picture::strip(&pictures, COLUMNS.min(pictures.len()))?;
    encode::save(&picture, &plan.output)?;
    let bytes = std::fs::metadata(&plan.output)?.len();
    Ok((pictures.len() as u64, bytes, (picture.width, picture.height)))
}

fn film(
    plan: &Plan,
    format: FilmFormat,
    frames: &[usize],
    shots: &mut [Shot],
    renderer: &mut Renderer,
    bar: &Bar,
) -> Outcome<Done> {
    let mut writer = None;
    let mut size = (0, 0);
    for (i, frame) in frames.iter().enumerate() {
        let picture = moment(shots, renderer, *frame)?;
        size = (picture.width, picture.height);
        let film =
            Film { format, fps: FPS, width: size.0, height: size.1, frames: frames.len() as u32 };
        let writer = match &mut writer {
            Some(w) => w,
            None => writer.insert(VideoWriter::create(&plan.output, film)?),
        };
        writer.push(picture)?;
        bar.tick(i as u64 + 1, frames.len() as u64, "");
    }
    let Some(writer) = writer else { return Err(Failure::usage("no frames to draw")) };
    let written = writer.finish()?;
    Ok((written.frames, written.bytes, size))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_and_frames_are_checked_as_text() {
        assert_eq!(size("640x480").unwrap(), (640, 480));
        assert!(size("640").is_err() && size("-1x4").is_err() && size("ax4").is_err());
        assert_eq!(frames("3").unwrap(), [3]);
        assert_eq!(frames("2..5").unwrap(), [2, 3, 4]);
        assert_eq!(frames("1, 9").unwrap(), [1, 9]);
        assert!(frames("5..2").is_err() && frames("a").is_err() && frames("0..99999999").is_err());
    }
}
