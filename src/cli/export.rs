//! `robert export TAKE|CLIP`: writes takes in other formats; a clip is performed first.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::ValueEnum;
use serde_json::json;

use super::failure::{Failure, Outcome};
use super::global::Global;
use super::perform::{PerformArgs, perform};
use super::{input, motion, out};
use crate::exit::HasExit as _;
use crate::robot::Robot;
use crate::take::viser::Recording;
use crate::take::{Take, What, html};
use crate::{fsio, limits};

/// Write a take, or a clip that is performed first, in another format.
///
/// csv, json, mjcf and ros go to stdout unless -o names a file. The other formats go to a file with
/// the input's name, unless -o names another.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert export wave.mcap --to csv -o wave.csv\n  robert export wave.mcap --to ros --what command > plan.yaml\n  robert export wave.mcap --to mjcf --with-model -o wave.xml    keyframes that load by themselves\n  robert export ur5e/reacher --policy computed-torque --to mcap -o reacher.mcap\n  robert export wave.mcap --to html -o wave.html    a page that plays the take, offline"
)]
pub(super) struct Args {
    /// A take (.mcap) or clip file (- is stdin), or the name of a built-in task.
    input: String,
    /// The format.
    #[arg(long, value_enum)]
    to: Format,
    /// The file to write; - is stdout.
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Export the reached motion or the command; for csv, json, mjcf and ros.
    #[arg(long, value_enum, default_value_t = WhatArg::Achieved)]
    what: WhatArg,
    /// For MJCF keyframes: also write the robot's model, so that the file loads by itself.
    #[arg(long)]
    with_model: bool,
    /// Export the frames of a damaged take that come before the damage.
    #[arg(long)]
    recover: bool,
    /// The viser client's index.html, if this build does not contain it (for html).
    #[arg(long, value_name = "FILE")]
    viser_client: Option<PathBuf>,
    /// Print a JSON report (with -o).
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    perform: PerformArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    /// Rows of joint values: frame, time, mask, one column per joint.
    Csv,
    /// One JSON document with everything except body poses.
    Json,
    /// The take itself, for Foxglove, Lichtblick, Rerun.
    Mcap,
    /// A `<keyframe>` block: full states of the simulator; see --with-model.
    Mjcf,
    /// ROS 2 `trajectory_msgs/JointTrajectory`, YAML.
    Ros,
    /// A recording for the viser client.
    Viser,
    /// A page with client and recording inside.
    Html,
}

impl Format {
    fn is_text(self) -> bool {
        matches!(self, Format::Csv | Format::Json | Format::Mjcf | Format::Ros)
    }

    fn suffix(self) -> &'static str {
        match self {
            Format::Csv => "csv",
            Format::Json => "json",
            Format::Mcap => "mcap",
            Format::Mjcf => "xml",
            Format::Ros => "yaml",
            Format::Viser => "viser",
            Format::Html => "html",
        }
    }
}

/// [`What`] as it is typed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum WhatArg {
    /// The reached motion.
    Achieved,
    /// The command.
    Command,
}

pub(super) fn run(args: &Args, global: Global) -> Outcome {
    let what = match args.what {
        WhatArg::Achieved => What::Achieved,
        WhatArg::Command => What::Command,
    };
    if what == What::Command && !args.to.is_text() {
        return Err(Failure::usage("--what command is only for csv, json, mjcf and ros"));
    }
    if args.with_model && args.to != Format::Mjcf {
        return Err(Failure::usage("--with-model is only for --to mjcf"));
    }
    let stdout = args.out.as_deref() == Some(Path::new("-"));
    if args.json && (stdout || (args.out.is_none() && args.to.is_text())) {
        return Err(Failure::usage("--json writes a report to stdout, so -o must name a file"));
    }
    motion::may_write(&args.input, args.out.as_deref())?;
    // The page may be missing, so it is read before any work.
    let client = match (args.to, &args.viser_client) {
        (Format::Html, Some(path)) => Some(fsio::read_capped(path, limits::MESH_BYTES)?),
        (Format::Html, None) => Some(html::client()?),
        _ => None,
    };
    let (take, robot) = input(args, global)?;
    let bytes = match args.to {
        Format::Csv => take.to_csv(what).into_bytes(),
        Format::Json => take.to_json(what).into_bytes(),
        Format::Mjcf if args.with_model => {
            motion::with_model(robot?.as_ref(), &take.to_mjcf(what)?)?.into_bytes()
        }
        Format::Mjcf => take.to_mjcf(what)?.into_bytes(),
        Format::Ros => take.to_ros(what)?.into_bytes(),
        Format::Mcap => {
            if let Ok(robot) = &robot {
                take.to_mcap(Some(&take.scene(robot)?))?
            } else {
                tracing::warn!(
                    "robot {} is unknown here, so the take has no geometry; name the robot with --robot",
                    take.robot.id
                );
                take.to_mcap(None)?
            }
        }
        Format::Viser => Recording::of(&take, robot?.as_ref())?.to_bytes()?,
        Format::Html => {
            let recording = Recording::of(&take, robot?.as_ref())?.to_bytes()?;
            html::page(&client.unwrap_or_default(), &title(&args.input), &recording)?
        }
    };
    let path = match &args.out {
        Some(path) if !stdout => path.clone(),
        None if !args.to.is_text() => {
            PathBuf::from(format!("{}.{}", title(&args.input), args.to.suffix()))
        }
        _ => return out::bytes(&bytes),
    };
    fsio::write_atomic(&path, &bytes)?;
    let precision = take.precision();
    if args.json {
        return out::json(&json!({
            "out": path,
            "format": args.to.suffix(),
            "bytes": bytes.len(),
            "frames": take.frames(),
            "robot": take.robot.id,
            "policy": take.provenance.policy,
            "precision": precision.precision,
            "masked_mae": precision.masked_mae,
        }));
    }
    out::line(&format!("{}: {} frames, {} bytes", path.display(), take.frames(), bytes.len()))
}

/// The take, and its robot if that is known.
fn input(args: &Args, global: Global) -> Outcome<(Take, Outcome<Arc<Robot>>)> {
    let path = Path::new(&args.input);
    if !motion::is_take(path) {
        let mut done = perform(&args.input, &args.perform, global)?;
        if let Some(e) = done.broke.take() {
            return Err(e.into());
        }
        return Ok((done.take()?, Ok(done.robot)));
    }
    args.perform.must_be_absent(&args.input)?;
    let take = if args.recover {
        let bytes = input::read(path, limits::TAKE_BYTES)?;
        let found = Take::recover_mcap(&bytes).map_err(|e| e.in_file(&input::place(path)))?;
        if let Some(damage) = found.damage {
            tracing::warn!("{}: {damage}; {} frames recovered", args.input, found.take.frames());
        }
        found.take
    } else {
        input::take(path)?
    };
    let robot = motion::robot_for(args.perform.robot.as_deref(), &take.robot.id);
    // A robot named on the command line must exist; the take's own may be unknown on this machine.
    match robot {
        Err(e) if args.perform.robot.is_some() => Err(e),
        Ok(robot) => match take.check_robot(&robot) {
            Err(e) if args.perform.robot.is_some() => Err(e.into()),
            Err(e) => Ok((take, Err(Failure::with(e.exit(), e)))),
            Ok(()) => Ok((take, Ok(robot))),
        },
        Err(e) => Ok((take, Err(e))),
    }
}

/// `dir/wave.clip.json` is `wave`, `ur5e/reacher` is `reacher`.
fn title(input: &str) -> String {
    let name = Path::new(input).file_name().map(|n| n.to_string_lossy().into_owned());
    let name = name.unwrap_or_else(|| input.to_owned());
    let stem = [motion::CLIP_SUFFIX, ".json", ".mcap"].iter().find_map(|s| name.strip_suffix(s));
    stem.unwrap_or(&name).to_owned()
}
