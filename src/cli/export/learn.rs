//! Datasets for learning, made of several takes or of collected data.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::json;

use super::format::{ActionArg, Format, VersionArg};
use super::plan::{Plan, say};
use super::source::Source;
use crate::cli::bar::Bar;
use crate::cli::failure::{Failure, Outcome};
use crate::cli::global::Global;
use crate::cli::{motion, out};
use crate::dataset::{Dataset, Verify};
use crate::progress::Progress as _;
use crate::render::{CameraChoice, Motion, Overlay, Picture, RenderConfig, Renderer, Shot};
use crate::robot::Robot;
use crate::take::export::{
    Episode, Export, Films, LeRobotAction, LeRobotOptions, LeRobotVersion, lerobot, minari,
};
use crate::units::FPS;

/// Overlays of a film for learning: nothing but the robot.
const BARE: &str = "none";

impl Plan<'_> {
    /// All inputs as one dataset.
    pub(super) fn gather(&self, global: Global) -> Outcome {
        let args = self.args;
        let folder = |input: &String| Path::new(input).is_dir();
        let (export, title) = match &args.inputs[..] {
            [one] if folder(one) => (self.collected(Path::new(one))?, one.clone()),
            inputs if inputs.iter().any(folder) => {
                return Err(Failure::usage("give one dataset folder, or takes and clips"));
            }
            inputs => {
                let sources = inputs
                    .iter()
                    .map(|i| Source::read(i, args, global))
                    .collect::<Outcome<Vec<_>>>()?;
                (self.performed(&sources, global)?, sources[0].title.clone())
            }
        };
        let stem =
            Path::new(&title).file_name().map_or(title.clone(), |n| n.to_string_lossy().into());
        let default = || PathBuf::from(format!("{stem}.{}", args.to.suffix()));
        let path = args.out.clone().unwrap_or_else(default);
        let files = export.write(&path)?;
        say(&export, Some(&path), global);
        if args.json {
            return out::json(&json!({
                "out": path,
                "format": args.to.name(),
                "files": files,
                "frames": export.frames,
                "bytes": export.bytes(),
            }));
        }
        let (frames, bytes) = (export.frames, export.bytes());
        out::line(&format!("{}: {frames} frames, {bytes} bytes", path.display()))
    }

    fn options(&self, robot: Option<&Arc<Robot>>) -> Outcome<LeRobotOptions> {
        let learn = &self.args.learn;
        Ok(LeRobotOptions {
            version: learn.lerobot_version.unwrap_or(VersionArg::V3).into(),
            action: match learn.action {
                None | Some(ActionArg::Position) => LeRobotAction::Position,
                Some(ActionArg::Torque) => LeRobotAction::Torque,
            },
            degrees: learn.degrees,
            rename: self.rename.clone(),
            motorised: robot.map(|r| r.motorised()).transpose()?,
        })
    }

    /// Trajectories of a dataset.
    fn collected(&self, path: &Path) -> Outcome<Export> {
        if self.args.learn.video.is_some() {
            return Err(Failure::usage("--video is for takes and clips, a dataset has no poses"));
        }
        let data = Dataset::open(path, Verify::Structure)?;
        let named = |mut e: Episode| {
            if let Some(task) = &self.args.learn.task {
                e.task.clone_from(task);
            }
            e
        };
        let episodes = Episode::of_dataset(&data).map(named);
        if self.args.to == Format::Lerobot {
            let episodes: Vec<Episode> = episodes.collect();
            let recorded = &data.manifest().robot;
            let robot = motion::robot_for(self.args.perform.robot.as_deref(), &recorded.id).ok();
            let robot = robot.filter(|r| r.joints().iter().map(|j| &j.name).eq(&recorded.joints));
            return Ok(lerobot(&episodes, None, &self.options(robot.as_ref())?)?);
        }
        let name = path.file_name().map_or("data".into(), |n| n.to_string_lossy());
        let mut agents: Vec<&str> = data.episodes().iter().map(|e| e.agent.as_str()).collect();
        agents.sort_unstable();
        agents.dedup();
        Ok(minari(episodes, &name, &agents.join(", "))?)
    }

    /// Takes.
    fn performed(&self, sources: &[Source], global: Global) -> Outcome<Export> {
        let task = |s: &Source| self.args.learn.task.clone().unwrap_or_else(|| s.task());
        let episodes: Vec<Episode> =
            sources.iter().map(|s| Episode::of_take(&s.take, &task(s))).collect();
        if self.args.to == Format::Lerobot {
            let size = self.args.learn.video.as_deref().map(size).transpose()?;
            let options = self.options(sources[0].robot.as_ref().ok())?;
            let films = size.map(|s| films(sources, options.version, s, global)).transpose()?;
            return Ok(lerobot(&episodes, films, &options)?);
        }
        let policy = sources[0].take.provenance.policy.clone();
        Ok(minari(episodes.into_iter(), &sources[0].title, &policy)?)
    }
}

/// Films all takes with one camera and without overlays.
fn films(
    sources: &[Source],
    version: LeRobotVersion,
    size: (u32, u32),
    global: Global,
) -> Outcome<Films> {
    let (width, height) = size;
    let config = RenderConfig { width, height, ..RenderConfig::default() };
    let mut renderer = Renderer::new(config)?;
    let mut shots = Vec::new();
    for source in sources {
        let take = &source.take;
        let motion = Motion {
            name: source.title.clone(),
            performer: Some(take.provenance.policy.clone()),
            fps: f64::from(FPS),
            commanded: Vec::new(),
            achieved: (0..take.frames()).map(|f| take.state(f).to_vec()).collect(),
            keys: Vec::new(),
            unit: String::new(),
        };
        let aspect = width as f32 / height as f32;
        let overlay = Overlay::parse(BARE)?;
        shots.push(Shot::new(source.robot()?, motion, overlay, &CameraChoice::Fit, aspect)?);
    }
    Shot::share_camera(&mut shots);
    let frames: Vec<usize> = sources.iter().map(|s| s.take.frames()).collect();
    let total: usize = frames.iter().sum();
    let bar = Bar::new("film", "frames", global.quiet);
    let mut drawn = 0;
    let films = Films::draw(version, &frames, size, |episode, frame| -> Outcome<Picture> {
        drawn += 1;
        bar.tick(drawn, total as u64, "");
        Ok(shots[episode].draw(&mut renderer, frame)?)
    });
    bar.finish();
    films
}

/// `640x480`.
fn size(text: &str) -> Outcome<(u32, u32)> {
    let parsed = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    parsed.ok_or_else(|| Failure::usage(format!("--video takes WIDTHxHEIGHT, not {text:?}")))
}
