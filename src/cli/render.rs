//! `robert render`: a clip or a take as a picture, a film strip or a film.
//!
//! A clip is performed first (unless `--kinematic` is given); a take has been performed already. In
//! both cases a [`Motion`] is drawn: commanded and reached states, frame by frame.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::bar::Bar;
use super::failure::{Failure, Outcome};
use super::global::Global;
use super::interrupt::cancel_on_ctrl_c;
use super::perform::{PerformArgs, perform, performed_already};
use super::{input, motion, out};
use crate::clip::{Clip, Command};
use crate::exit::Exit;
use crate::fsio;
use crate::limits;
use crate::progress::{Cancel, Progress};
use crate::render::encode::{self, Film, FilmFormat, VideoWriter};
use crate::render::{
    Backend, CameraChoice, Motion, Overlay, Picture, Quality, RenderConfig, Renderer, Shot, Strip,
};
use crate::robot::Robot;
use crate::units::FPS;

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert render wave.clip.json -o wave.mp4\n  robert render wave.mcap -o wave.mp4                  a take\n  robert render fire --policy pd -o fire.gif --size 320x240\n  robert render wave.clip.json -o still.png --frames 40 --size 1280x720\n  robert render wave.clip.json -o strip.png --strip 6\n  robert render wave.clip.json -o both.gif --compare other.clip.json --overlay ghost,caption\n  robert render fire --policy robert -o both.mp4 --compare fire --compare-policy pd\n  robert render wave.clip.json -o preview.mp4 --kinematic --camera orbit\n  robert clip fmt - < wave.clip.json | robert render - -o - > still.png"
)]
pub(super) struct Args {
    /// A clip file, a take (.mcap), the name of a built-in task (`fire`), or - for stdin.
    input: String,
    /// The file to write: .png or .jpg (one picture), .mp4, .gif or .apng (a film), or - for a PNG
    /// to stdout.
    #[arg(short, long, alias = "output")]
    out: PathBuf,
    /// Frames to draw: `40`, `0..100` or `10,20,30` [default: all for a film; for a still, the last
    /// keyframe that differs from the start].
    #[arg(long)]
    frames: Option<String>,
    /// Width x height in pixels.
    #[arg(long, default_value = "640x480")]
    size: String,
    /// Camera: fit, fixed, top, orbit, follow:BODY, or the name of a camera of the model.
    #[arg(long, default_value = "fit")]
    camera: String,
    /// Overlays: ghost, error, onion, bare, trail, caption, axes, contacts; or none.
    #[arg(long, default_value = "ghost,error,trail,caption")]
    overlay: String,
    /// Draw a second clip or take beside the first.
    #[arg(long, value_name = "INPUT")]
    compare: Option<String>,
    /// Policy for the second clip [default: the same].
    #[arg(long, value_name = "P", requires = "compare")]
    compare_policy: Option<String>,
    /// Draw a strip: one picture with this many moments.
    #[arg(long, value_name = "N")]
    strip: Option<usize>,
    /// Draw the commanded poses without a simulation, and so without a policy.
    #[arg(long)]
    kinematic: bool,
    #[command(flatten)]
    perform: PerformArgs,
    /// Time against smooth edges.
    #[arg(long, value_enum, default_value_t = QualityArg::Export)]
    quality: QualityArg,
    /// What draws.
    #[arg(long, value_enum, default_value_t = RendererArg::Auto)]
    renderer: RendererArg,
    /// Print a JSON report about the written file.
    #[arg(long)]
    json: bool,
}

/// [`Quality`] as it is typed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum QualityArg {
    /// Fast.
    Preview,
    /// Four samples per pixel.
    Export,
}

/// [`Backend`] as it is typed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum RendererArg {
    /// A graphics card if there is one, else the software driver.
    Auto,
    /// A graphics card.
    Gpu,
    /// The software driver.
    Cpu,
}

/// Checked values.
struct Plan {
    out: PathBuf,
    film: Option<FilmFormat>,
    frames: Option<Vec<usize>>,
    config: RenderConfig,
    camera: CameraChoice,
    overlay: Overlay,
    strip: Option<usize>,
}

/// The most moments in a strip.
const STRIP: usize = 64;
/// The most pixels of one picture: 800 MB while it is assembled.
const STILL_PX: u64 = 200_000_000;
/// Pictures in one row of a strip.
const COLUMNS: usize = 6;

pub(super) fn run(args: &Args, global: Global) -> Outcome {
    let plan = Plan::new(args)?;
    plan.check_motions(args)?;
    let cancel = cancel_on_ctrl_c();
    // The device comes first: a machine without a driver reports it before anything is simulated.
    let mut renderer = Renderer::new(plan.config)?;
    let aspect = plan.config.width as f32 / plan.config.height as f32;
    let mut shots = Vec::new();
    let second = args.second();
    let inputs = [(Some(&args.input), &args.perform), (args.compare.as_ref(), &second)];
    for (input, perform) in inputs.into_iter().filter_map(|(i, p)| Some((i?, p))) {
        let (robot, motion) = shown(input, args, perform, global)?;
        shots.push(Shot::new(&robot, motion, plan.overlay, &plan.camera, aspect)?);
        stopped(&cancel, 0)?;
    }
    Shot::share_camera(&mut shots);
    let total = shots.iter().map(|s| s.motion().frames()).max().unwrap_or(1);
    let frames = plan.wanted(total, shots.first().map_or(0, |s| s.motion().telling_frame()))?;
    if plan.film.is_none() && frames.len() > 1 {
        shots.iter_mut().for_each(Shot::be_large);
    }
    let (width, height) = renderer.size();
    if shots.iter().any(|s| s.drops_legend(width, height)) {
        tracing::warn!("{width}x{height} px are too few for the legend, which is left out");
    }
    let bar = Bar::new("render", "frames", global.quiet);
    let mut draw = |i: usize, frame: usize| {
        stopped(&cancel, i)?;
        let picture = moment(&mut shots, &mut renderer, frame)?;
        if plan.film.is_none() {
            shots.iter_mut().for_each(Shot::be_brief);
        }
        bar.tick(i as u64 + 1, frames.len() as u64, "");
        Ok(picture)
    };
    let written = match plan.film {
        Some(format) => film(&plan, format, &frames, &mut draw),
        None => still(&plan, &frames, &mut draw),
    };
    bar.finish();
    let (pictures, bytes, size) = written?;
    let adapter = renderer.adapter().0;
    if args.json {
        return out::json(&serde_json::json!({
            "path": plan.out, "frames": pictures, "bytes": bytes,
            "width": size.0, "height": size.1, "adapter": adapter,
            "precision": shots.iter().map(|s| s.motion().precision(total)).collect::<Vec<_>>(),
            "unit": shots.iter().map(|s| s.motion().unit.as_str()).collect::<Vec<_>>(),
        }));
    }
    let to_stdout = input::is_standard(&plan.out);
    let written = if to_stdout { Path::new("stdout") } else { &plan.out };
    let said = format!(
        "{}: {pictures} frame{}, {}x{} px, {} kB",
        written.display(),
        if pictures == 1 { "" } else { "s" },
        size.0,
        size.1,
        bytes.div_ceil(1000)
    );
    input::say(to_stdout, &said)
}

impl Args {
    /// Refuses options of a rollout where no rollout would have them.
    fn refuse_unused(&self) -> Outcome {
        let is_take = |input: &String| motion::is_take(Path::new(input));
        let inputs = || std::iter::once(&self.input).chain(&self.compare);
        if self.kinematic
            && let Some(take) = inputs().find(|i| is_take(i))
        {
            return Err(Failure::usage(format!("{take} is a take: --kinematic is only for clips")));
        }
        let performed = |input: &String| !self.kinematic && !is_take(input);
        let first = performed(&self.input);
        let second = self.compare.as_ref().is_some_and(performed);
        let unused = |flag: &str, input: &str| {
            if self.kinematic {
                return Failure::usage(format!("--kinematic simulates nothing: leave out {flag}"));
            }
            performed_already(input, flag)
        };
        if let (Some(_), Some(compared)) = (&self.compare_policy, &self.compare)
            && !second
        {
            return Err(unused("--compare-policy", compared));
        }
        for flag in self.perform.given() {
            let shared = flag != "--policy" || self.compare_policy.is_none();
            if !(first || (second && shared)) {
                return Err(unused(flag, &self.input));
            }
        }
        Ok(())
    }

    /// Options for performing the second clip.
    fn second(&self) -> PerformArgs {
        let mut second = self.perform.clone();
        if self.compare_policy.is_some() {
            second.policy.clone_from(&self.compare_policy);
        }
        second
    }
}

impl Plan {
    fn new(args: &Args) -> Outcome<Plan> {
        let film = FilmFormat::of(&args.out);
        let ending = encode::ending(&args.out);
        let to_stdout = input::is_standard(&args.out);
        if film.is_none() && !to_stdout && !["png", "jpg", "jpeg"].contains(&ending.as_str()) {
            return Err(Failure::usage(format!(
                "unknown suffix of {}: use {}, or - for a PNG to stdout",
                args.out.display(),
                encode::ENDINGS
            )));
        }
        if to_stdout && args.json {
            return Err(Failure::usage(
                "the picture and the JSON report cannot both go to stdout: name a file with -o",
            ));
        }
        if film.is_some() && args.strip.is_some() {
            return Err(Failure::usage("a strip is one picture: use the suffix .png or .jpg"));
        }
        if let Some(n) = args.strip
            && !(1..=STRIP).contains(&n)
        {
            return Err(Failure::usage(format!("--strip takes 1 to {STRIP} moments, not {n}")));
        }
        let (width, height) = size(&args.size)?;
        let beside = 1 + u32::from(args.compare.is_some());
        let cell = Picture::beside_px(width, height, beside);
        if let Some(format) = film {
            format.check_size(cell.0, cell.1).map_err(|e| {
                Failure::usage(format!("{e}: choose another --size, or the suffix .apng"))
            })?;
        }
        if !to_stdout {
            fsio::writable(&args.out)?;
        }
        let quality = match args.quality {
            QualityArg::Preview => Quality::Preview,
            QualityArg::Export => Quality::Export,
        };
        let backend = match args.renderer {
            RendererArg::Auto => Backend::Auto,
            RendererArg::Gpu => Backend::Gpu,
            RendererArg::Cpu => Backend::Cpu,
        };
        args.refuse_unused()?;
        // A typo in the second policy must show before the first clip is drawn.
        args.perform.named()?;
        args.second().named()?;
        let frames = args.frames.as_deref().map(frames).transpose()?;
        let plan = Plan {
            out: args.out.clone(),
            film,
            frames,
            config: RenderConfig { width, height, quality, backend, ..RenderConfig::default() },
            camera: CameraChoice::parse(&args.camera),
            overlay: Overlay::parse(&args.overlay)?,
            strip: args.strip,
        };
        if plan.film.is_none() {
            plan.check_still(cell)?;
        }
        Ok(plan)
    }

    /// Refuses a picture that would not fit the memory of small machines.
    fn check_still(&self, cell: (u32, u32)) -> Outcome {
        let listed = self.frames.as_ref().map_or(1, Vec::len);
        let count =
            self.strip.map_or(listed, |n| self.frames.as_ref().map_or(n, |_| n.min(listed)));
        if count > STRIP {
            return Err(Failure::usage(format!(
                "{count} frames do not fit one picture (at most {STRIP}): choose some with --strip 6, or use the suffix .mp4"
            )));
        }
        let (w, h) = Strip::px(count, COLUMNS, cell);
        if u64::from(w) * u64::from(h) > STILL_PX {
            return Err(Failure::usage(format!(
                "a picture of {w}x{h} px is too large (at most {} million pixels): choose a smaller --size or fewer moments",
                STILL_PX / 1_000_000
            )));
        }
        Ok(())
    }

    /// Refuses frames and cameras that do not exist, before any clip is performed.
    fn check_motions(&self, args: &Args) -> Outcome {
        let robot = args.perform.robot.as_deref();
        let inputs = || std::iter::once(&args.input).chain(&args.compare);
        // Takes name their robot and have been performed.
        if inputs().any(|i| motion::is_take(Path::new(i))) {
            return Ok(());
        }
        let clips = inputs().map(|i| motion::clip(i, robot)).collect::<Outcome<Vec<_>>>()?;
        let total = clips.iter().map(|c| c.length as usize).max().unwrap_or(1);
        self.wanted(total.max(1), 0)?;
        if matches!(self.camera, CameraChoice::Named(_) | CameraChoice::Follow(_)) {
            for clip in &clips {
                self.camera.check(&motion::robot_for(robot, &clip.robot.id)?)?;
            }
        }
        Ok(())
    }

    /// The frames to draw out of `total`; a still without `--frames` shows frame `telling`.
    fn wanted(&self, total: usize, telling: usize) -> Outcome<Vec<usize>> {
        if let Some(list) = &self.frames {
            if let Some(beyond) = list.iter().find(|f| **f >= total) {
                return Err(Failure::invalid(format!(
                    "frame {beyond} is beyond the end: there are frames 0 to {}",
                    total - 1
                )));
            }
            return Ok(match self.strip {
                Some(n) if n < list.len() => moments(list.len(), n)
                    .into_iter()
                    .filter_map(|i| list.get(i).copied())
                    .collect(),
                _ => list.clone(),
            });
        }
        Ok(match (self.film, self.strip) {
            (Some(_), _) => (0..total).collect(),
            (None, Some(n)) => moments(total, n),
            (None, None) => vec![telling.min(total - 1)],
        })
    }
}

/// `n` of `total` frames at equal distances, the last among them.
fn moments(total: usize, n: usize) -> Vec<usize> {
    (0..n).map(|i| (i + 1) * (total - 1) / n.max(1)).collect()
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

/// Ctrl-C between two pictures leaves no incomplete file.
fn stopped(cancel: &Cancel, drawn: usize) -> Outcome {
    if !cancel.is_cancelled() {
        return Ok(());
    }
    Err(Failure::with(
        Exit::Interrupted,
        format!("stopped after {drawn} pictures; nothing was written"),
    ))
}

/// The motion of one input, and its robot.
fn shown(
    input: &str,
    args: &Args,
    by: &PerformArgs,
    global: Global,
) -> Outcome<(Arc<Robot>, Motion)> {
    if motion::is_take(Path::new(input)) {
        return recorded(input, args);
    }
    if !args.kinematic {
        let mut done = perform(input, by, global)?;
        if let Some(e) = done.broke.take() {
            return Err(e.into());
        }
        let dim = done.robot.state_dim();
        let rows = done.rollout.reached().chunks_exact(dim).map(<[f64]>::to_vec).collect();
        let motion =
            of_clip(&done.clip, &done.command, rows, Some(done.policy.label()), &done.robot);
        return Ok((done.robot, motion));
    }
    let clip = motion::clip(input, args.perform.robot.as_deref())?;
    let robot = motion::robot_for(args.perform.robot.as_deref(), &clip.robot.id)?;
    let command = motion::command(&clip, &robot, input)?;
    let rows = command.filled().chunks_exact(command.dim().max(1)).map(wide).collect();
    let motion = of_clip(&clip, &command, rows, None, &robot);
    Ok((robot, motion))
}

/// A take, as it was performed.
fn recorded(input: &str, args: &Args) -> Outcome<(Arc<Robot>, Motion)> {
    let take = input::take(Path::new(input))?;
    let robot = motion::robot_for(args.perform.robot.as_deref(), &take.robot.id)?;
    take.check_robot(&robot)?;
    let clip = match &take.clip_text {
        Some(_) => Some(motion::clip_of(&take, input)?),
        None => None,
    };
    let rows = (0..take.frames()).map(|f| take.state(f).to_vec()).collect();
    Ok((
        Arc::clone(&robot),
        Motion {
            name: clip.as_ref().map_or_else(String::new, |c| c.name.clone()),
            performer: Some(take.provenance.policy.clone()),
            fps: f64::from(FPS),
            commanded: commanded(&take.command),
            achieved: rows,
            keys: clip.map_or_else(Vec::new, |c| c.keys.iter().map(|k| k.frame as usize).collect()),
            unit: motion::unit(&robot).to_owned(),
        },
    ))
}

fn of_clip(
    clip: &Clip,
    command: &Command,
    achieved: Vec<Vec<f64>>,
    performer: Option<String>,
    robot: &Robot,
) -> Motion {
    Motion {
        name: clip.name.clone(),
        performer,
        fps: f64::from(FPS),
        commanded: commanded(command),
        achieved,
        keys: clip.keys.iter().map(|k| k.frame as usize).collect(),
        unit: motion::unit(robot).to_owned(),
    }
}

fn wide(row: &[f32]) -> Vec<f64> {
    row.iter().map(|v| f64::from(*v)).collect()
}

fn commanded(command: &Command) -> Vec<Vec<f64>> {
    command.goal_rows().map(|row| wide(&row)).collect()
}

fn moment(shots: &mut [Shot], renderer: &mut Renderer, frame: usize) -> Outcome<Picture> {
    let mut pictures = Vec::with_capacity(shots.len());
    for shot in shots {
        pictures.push(shot.draw(renderer, frame)?);
    }
    match <[Picture; 1]>::try_from(pictures) {
        Ok([only]) => Ok(only),
        Err(several) => Ok(Picture::beside(&several)?),
    }
}

type Done = (u64, u64, (u32, u32));

/// Draws the i-th picture, of a frame.
type Draw<'a> = &'a mut dyn FnMut(usize, usize) -> Outcome<Picture>;

fn still(plan: &Plan, frames: &[usize], draw: Draw<'_>) -> Outcome<Done> {
    let mut strip: Option<Strip> = None;
    for (i, frame) in frames.iter().enumerate() {
        let picture = draw(i, *frame)?;
        let cell = (picture.width, picture.height);
        strip.get_or_insert_with(|| Strip::new(frames.len(), COLUMNS, cell)).put(i, &picture);
    }
    let Some(strip) = strip else { return Err(Failure::usage("no frames to draw")) };
    let picture = strip.finish();
    let bytes = if input::is_standard(&plan.out) {
        let png = encode::png(&picture)?;
        out::bytes(&png)?;
        png.len() as u64
    } else {
        encode::save(&picture, &plan.out)?;
        std::fs::metadata(&plan.out)?.len()
    };
    Ok((frames.len() as u64, bytes, (picture.width, picture.height)))
}

fn film(plan: &Plan, format: FilmFormat, frames: &[usize], draw: Draw<'_>) -> Outcome<Done> {
    let mut writer = None;
    let mut size = (0, 0);
    for (i, frame) in frames.iter().enumerate() {
        let picture = draw(i, *frame)?;
        size = (picture.width, picture.height);
        let film =
            Film { format, fps: FPS, width: size.0, height: size.1, frames: frames.len() as u32 };
        let writer = match &mut writer {
            Some(w) => w,
            None => writer.insert(VideoWriter::create(&plan.out, film)?),
        };
        writer.push(picture)?;
    }
    let Some(writer) = writer else { return Err(Failure::usage("no frames to draw")) };
    let written = writer.finish()?;
    Ok((written.frames, written.bytes, size))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_end_with_the_last_frame() {
        assert_eq!(moments(21, 4), [5, 10, 15, 20]);
        assert_eq!(moments(100, 6), [16, 33, 49, 66, 82, 99]);
        assert_eq!(moments(1, 3), [0, 0, 0]);
    }

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
