//! `robert export TAKE|CLIP|DATASET`: motion in other formats; a clip is performed first.

mod format;
mod learn;
mod source;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::json;

use self::format::{ActionArg, BodiesArg, Format, UrArg, VersionArg, WhatArg};
use self::source::Source;
use super::failure::{Failure, Outcome};
use super::global::Global;
use super::perform::PerformArgs;
use super::{motion, out};
use crate::robot::Robot;
use crate::take::export::{
    Export, RosOptions, TRACKING_FPS, bag, bvh, glb, lafan, ros, tracking, ur_script, usda,
};
use crate::take::viser::Recording;
use crate::take::{Take, What, html};
use crate::units::FPS;
use crate::{fsio, limits};

/// Write takes, clips that are performed first, or collected data in another format.
///
/// csv, json, mjcf and ros go to stdout unless -o names a file; the others need a file or
/// folder and take the input's name by default. Of several inputs lerobot and minari make
/// one dataset; of the other formats each input becomes a file in the folder -o. What the
/// numbers mean and which command opens the result is said on stderr.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert export wave.mcap --to csv -o wave.csv\n  robert export wave.mcap --to ros --what command > plan.yaml\n  robert export wave.mcap --to ros --goal --lead-in 2 -o wave.goal.yaml\n  robert export wave.mcap --to mjcf --with-model -o wave.xml    keyframes that load by themselves\n  robert export wave.mcap --to glb -o wave.glb                  Blender, Unreal, three.js\n  robert export ur5e/reacher --policy computed-torque --to mcap -o reacher.mcap\n  robert export ur5e/reacher ur5e/hang --to lerobot -o arm       two episodes\n  robert export wave.mcap --to html -o wave.html    a page that plays the take, offline"
)]
pub(super) struct Args {
    /// Takes (.mcap), clip files (- is stdin), names of shipped tasks, or one dataset folder.
    #[arg(required = true)]
    inputs: Vec<String>,
    /// The format.
    #[arg(long, value_enum)]
    to: Format,
    /// The file or folder to write; - is stdout.
    #[arg(short, long, value_name = "PATH")]
    out: Option<PathBuf>,
    /// The reached motion, or the command; for csv, json, mjcf, ros, bag and ur.
    #[arg(long, value_enum, default_value_t = WhatArg::Achieved)]
    what: WhatArg,
    /// Of MJCF keyframes, write the robot's model, too: a file that loads by itself.
    #[arg(long)]
    with_model: bool,
    #[command(flatten)]
    ros: RosFlags,
    #[command(flatten)]
    learn: LearnFlags,
    /// Rows a second of lafan and npz [default: lafan 20, npz 50].
    #[arg(long, value_name = "HZ", value_parser = clap::value_parser!(u32).range(1..=1000))]
    fps: Option<u32>,
    /// Order of bodies and joints in an npz file.
    #[arg(long, value_enum, default_value_t = BodiesArg::Mujoco)]
    bodies: BodiesArg,
    /// How a UR5e's program moves.
    #[arg(long, value_enum, default_value_t = UrArg::Servoj)]
    ur_move: UrArg,
    /// Other names of joints: TOML lines such as elbow_joint = "elbow_flex"; for ros, bag
    /// and lerobot.
    #[arg(long, value_name = "FILE")]
    rename: Option<PathBuf>,
    /// Of a damaged take, export the frames before the damage.
    #[arg(long)]
    recover: bool,
    /// The viser client's index.html, where it is not in this program (for html).
    #[arg(long, value_name = "FILE")]
    viser_client: Option<PathBuf>,
    /// Print a JSON report (with -o).
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    perform: PerformArgs,
}

/// For robots under ROS 2.
#[derive(clap::Args, Debug)]
struct RosFlags {
    /// Time for the way from where the robot stands to the first point, s; for ros and bag.
    #[arg(long, value_name = "SECS", default_value_t = 0.0)]
    lead_in: f64,
    /// Write the goal of a FollowJointTrajectory action (for ros).
    #[arg(long)]
    goal: bool,
    /// Torques, too: controllers without an effort interface refuse them; for ros and bag.
    #[arg(long)]
    effort: bool,
}

/// For LeRobot.
#[derive(clap::Args, Debug)]
struct LearnFlags {
    /// What the action of a LeRobot dataset is.
    #[arg(long, value_enum, default_value_t = ActionArg::Position)]
    action: ActionArg,
    /// Angles of a LeRobot dataset in degrees.
    #[arg(long)]
    degrees: bool,
    /// Layout of a LeRobot dataset.
    #[arg(long, value_enum, default_value = "3.0", value_name = "VERSION")]
    lerobot_version: VersionArg,
    /// Film each episode of a LeRobot dataset at this size: 640x480.
    #[arg(long, value_name = "WxH")]
    video: Option<String>,
    /// What was being done, for lerobot and minari [default: the clip's name].
    #[arg(long, value_name = "TEXT")]
    task: Option<String>,
}

pub(super) fn run(args: &Args, global: Global) -> Outcome {
    args.check()?;
    for input in &args.inputs {
        motion::may_write(input, args.out.as_deref())?;
    }
    let plan = Plan::new(args)?;
    if args.to.gathers() {
        return plan.gather(global);
    }
    let many = args.inputs.len() > 1;
    let mut made = Vec::new();
    for input in &args.inputs {
        let source = Source::read(input, args, global)?;
        let export = plan.export(&source)?;
        let path = match &args.out {
            Some(dir) if many => dir.join(plan.file_name(&source)),
            Some(path) => path.clone(),
            None if args.to.is_printed() && !many => PathBuf::from("-"),
            None => PathBuf::from(plan.file_name(&source)),
        };
        if path == Path::new("-") {
            say(&export, None, global);
            let Some(file) = export.files.first().filter(|_| export.folder.is_none()) else {
                return Err(Failure::usage("a folder cannot go to stdout: name it with -o"));
            };
            return out::bytes(&file.bytes);
        }
        if many && let Some(dir) = path.parent() {
            std::fs::create_dir_all(dir)
                .map_err(|source| fsio::Error::Write { source, path: dir.to_owned() })?;
        }
        let files = export.write(&path)?;
        say(&export, Some(&path), global);
        made.push(Made { source, export, path, files });
    }
    plan.report(&made)
}

/// One input, written.
struct Made {
    source: Source,
    export: Export,
    path: PathBuf,
    files: Vec<PathBuf>,
}

/// Says what the numbers mean and what opens them.
fn say(export: &Export, path: Option<&Path>, global: Global) {
    if global.quiet {
        return;
    }
    let place = path.map_or_else(|| "FILE".to_owned(), |p| p.display().to_string());
    for sentence in &export.meaning {
        eprintln!("{}", sentence.replace(Export::OUT, &place));
    }
    eprintln!("open it:  {}", export.open.replace(Export::OUT, &place));
}

impl Args {
    /// Refuses what cannot be, before any work.
    fn check(&self) -> Outcome {
        let commands = self.to.has_command() || self.to == Format::Bag;
        if What::from(self.what) == What::Command && !commands {
            return Err(Failure::usage("--what command is for csv, json, mjcf, ros, bag and ur"));
        }
        let of_ros = matches!(self.to, Format::Ros | Format::Bag);
        let lead = self.ros.lead_in;
        if !(0.0..=3600.0).contains(&lead) {
            return Err(Failure::usage(format!("--lead-in takes 0 to 3600 s, not {lead}")));
        }
        let given = [
            ("--with-model", self.with_model, self.to == Format::Mjcf, "mjcf"),
            ("--goal", self.ros.goal, self.to == Format::Ros, "ros"),
            ("--lead-in", lead > 0.0, of_ros, "ros and bag"),
            ("--effort", self.ros.effort, of_ros, "ros and bag"),
            (
                "--rename",
                self.rename.is_some(),
                of_ros || self.to == Format::Lerobot,
                "ros, bag and lerobot",
            ),
            ("--degrees", self.learn.degrees, self.to == Format::Lerobot, "lerobot"),
            ("--video", self.learn.video.is_some(), self.to == Format::Lerobot, "lerobot"),
            (
                "--fps",
                self.fps.is_some(),
                matches!(self.to, Format::Lafan | Format::Npz),
                "lafan and npz",
            ),
            ("--task", self.learn.task.is_some(), self.to.gathers(), "lerobot and minari"),
        ];
        if let Some((flag, _, _, of)) = given.iter().find(|(_, asked, fits, _)| *asked && !fits) {
            return Err(Failure::usage(format!("{flag} is for --to {}", of)));
        }
        let stdout = self.out.as_deref() == Some(Path::new("-"));
        let printed = self.out.is_none() && self.to.is_printed() && self.inputs.len() == 1;
        if self.json && (stdout || printed) {
            return Err(Failure::usage("--json prints a report on stdout: name a file with -o"));
        }
        if stdout && (self.inputs.len() > 1 || self.to.gathers() || self.to == Format::Bag) {
            return Err(Failure::usage("a folder cannot go to stdout: name it with -o"));
        }
        Ok(())
    }
}

/// What every input is written with.
struct Plan<'a> {
    args: &'a Args,
    rename: BTreeMap<String, String>,
    /// The viser client, for a page.
    client: Option<Vec<u8>>,
}

impl Plan<'_> {
    fn new(args: &Args) -> Outcome<Plan<'_>> {
        // Before any work: the page may be missing.
        let client = match (args.to, &args.viser_client) {
            (Format::Html, Some(path)) => Some(fsio::read_capped(path, limits::MESH_BYTES)?),
            (Format::Html, None) => Some(html::client()?),
            _ => None,
        };
        let rename = args.rename.as_deref().map(names).transpose()?.unwrap_or_default();
        Ok(Plan { args, rename, client })
    }

    fn file_name(&self, source: &Source) -> String {
        format!("{}.{}", source.title, self.args.to.suffix())
    }

    fn ros_options(&self, robot: Option<&Arc<Robot>>) -> RosOptions {
        let flags = &self.args.ros;
        RosOptions {
            lead_in_secs: flags.lead_in,
            goal: flags.goal,
            effort: flags.effort,
            rename: self.rename.clone(),
            ranges: robot.map(|r| r.joints().iter().map(|j| j.range).collect()),
        }
    }

    /// One input in the format.
    fn export(&self, source: &Source) -> Outcome<Export> {
        let (args, take) = (self.args, &source.take);
        let what = What::from(args.what);
        let known = source.robot.as_ref().ok();
        Ok(match args.to {
            Format::Glb => glb(take, source.robot()?, &source.title)?,
            Format::Bvh => bvh(take, source.robot()?)?,
            Format::Usda => usda(take, source.robot()?)?,
            Format::Lafan => lafan(take, source.robot()?, args.fps.unwrap_or(FPS))?,
            Format::Npz => {
                let fps = args.fps.unwrap_or(TRACKING_FPS);
                tracking(take, source.robot()?, fps, args.bodies.into())?
            }
            Format::Ros => ros(take, what, &self.ros_options(known))?,
            Format::Bag => bag(take, what, &self.ros_options(known))?,
            Format::Ur => ur_script(take, what, args.ur_move.into(), &source.title)?,
            _ => self.own(source, what)?,
        })
    }

    /// The formats that are one file of our own making.
    fn own(&self, source: &Source, what: What) -> Outcome<Export> {
        let take = &source.take;
        let out = Export::OUT;
        let (bytes, meaning, open) = match self.args.to {
            Format::Csv => (
                take.to_csv(what).into_bytes(),
                "A row a frame: frame, time (s), 1 where masked, joints (rad, or m).",
                format!("python -c \"import pandas; print(pandas.read_csv('{out}'))\""),
            ),
            Format::Json => (
                take.to_json(what).into_bytes(),
                "Positions in rad or m, velocities in rad/s or m/s, efforts in N m or N; null is masked.",
                format!("python -m json.tool {out}"),
            ),
            Format::Mjcf => {
                let keys = take.to_mjcf(what)?;
                let text = if self.args.with_model {
                    motion::with_model(source.robot()?, &keys)?
                } else {
                    keys
                };
                (
                    text.into_bytes(),
                    "A key a frame: qpos and qvel of the simulator, controls in N m or N.",
                    format!("python -m mujoco.viewer --mjcf={out}"),
                )
            }
            Format::Viser => (
                Recording::of(take, source.robot()?)?.to_bytes()?,
                "A recording of the scene, for the viser client.",
                format!(
                    "python -c \"import viser; print(viser.__version__)\"  # its client plays {out}"
                ),
            ),
            Format::Html => {
                let recording = Recording::of(take, source.robot()?)?.to_bytes()?;
                let client = self.client.clone().unwrap_or_default();
                (
                    html::page(&client, &source.title, &recording)?,
                    "A page with the recording inside; it needs no network.",
                    format!("xdg-open {out}"),
                )
            }
            _ => (
                self.take_file(take, &source.robot)?,
                "The take: joint states, transforms and figures, for Foxglove, Lichtblick and Rerun.",
                format!("rerun {out}"),
            ),
        };
        Ok(Export::single(bytes, take.frames(), open).says(meaning))
    }

    fn take_file(&self, take: &Take, robot: &Outcome<Arc<Robot>>) -> Outcome<Vec<u8>> {
        if let Ok(robot) = robot {
            return Ok(take.to_mcap(Some(&take.scene(robot)?))?);
        }
        tracing::warn!(
            "robot {} is not known here: no geometry in the take; give it with --robot",
            take.robot.id
        );
        Ok(take.to_mcap(None)?)
    }

    /// The line, or the JSON document, about what was written.
    fn report(&self, made: &[Made]) -> Outcome {
        if !self.args.json {
            for m in made {
                let (frames, bytes) = (m.export.frames, m.export.bytes());
                out::line(&format!("{}: {frames} frames, {bytes} bytes", m.path.display()))?;
            }
            return Ok(());
        }
        let frames: usize = made.iter().map(|m| m.export.frames).sum();
        let bytes: usize = made.iter().map(|m| m.export.bytes()).sum();
        let files: Vec<&PathBuf> = made.iter().flat_map(|m| &m.files).collect();
        let mut report = json!({
            "format": self.args.to.suffix(),
            "files": files,
            "frames": frames,
            "bytes": bytes,
        });
        if let [m] = made {
            let precision = m.source.take.precision();
            report["out"] = json!(m.path);
            report["robot"] = json!(m.source.take.robot.id);
            report["policy"] = json!(m.source.take.provenance.policy);
            report["precision"] = json!(precision.precision);
            report["masked_mae"] = json!(precision.masked_mae);
            report["frames_reached"] = json!(m.source.take.frames());
        }
        out::json(&report)
    }
}

/// A table of other names.
fn names(path: &Path) -> Outcome<BTreeMap<String, String>> {
    let text = String::from_utf8(fsio::read_capped(path, limits::CLIP_BYTES)?)
        .map_err(|e| Failure::invalid(format!("{}: {e}", path.display())))?;
    toml::from_str(&text).map_err(|e| Failure::invalid(format!("{}: {e}", path.display())))
}
