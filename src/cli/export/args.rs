//! The arguments of `robert export`.

use std::path::{Path, PathBuf};

use super::format::{ActionArg, BodiesArg, Format, UrArg, VersionArg, WhatArg};
use crate::cli::failure::{Failure, Outcome};
use crate::cli::perform::PerformArgs;
use crate::take::What;

/// Write takes, clips that are performed first, or collected data in another format.
///
/// csv, json, mjcf and ros go to stdout unless -o names a file. The other formats write a file or
/// folder, which has the input's name by default. Several inputs become one dataset with lerobot
/// and minari; with the other formats each input becomes a file in the folder -o. Stderr says what
/// the numbers mean and which command opens the result.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert export wave.mcap --to csv -o wave.csv\n  robert export wave.mcap --to ros --what command > plan.yaml\n  robert export wave.mcap --to ros --goal --lead-in 2 -o wave.goal.yaml\n  robert export wave.mcap --to mjcf --with-model -o wave.xml    keyframes that load by themselves\n  robert export wave.mcap --to glb -o wave.glb                  Blender, Unreal, three.js\n  robert export ur5e/reacher --policy computed-torque --to mcap -o reacher.mcap\n  robert export ur5e/reacher ur5e/hang --to lerobot -o arm       two episodes\n  robert export wave.mcap --to html -o wave.html    a page that plays the take, offline"
)]
pub(in crate::cli) struct Args {
    /// Takes (.mcap), clip files (- is stdin), names of built-in tasks, or one dataset folder.
    #[arg(required = true)]
    pub(super) inputs: Vec<String>,
    /// The format.
    #[arg(long, value_enum)]
    pub(super) to: Format,
    /// The file or folder to write; - is stdout.
    #[arg(short, long, value_name = "PATH")]
    pub(super) out: Option<PathBuf>,
    /// The reached motion, or the command; for csv, json, mjcf, ros, bag and ur.
    #[arg(long, value_enum, default_value_t = WhatArg::Achieved)]
    pub(super) what: WhatArg,
    /// For mjcf, also write the robot's model, so that the file loads by itself.
    #[arg(long)]
    pub(super) with_model: bool,
    #[command(flatten)]
    pub(super) ros: RosFlags,
    #[command(flatten)]
    pub(super) learn: LearnFlags,
    /// Rows per second of lafan and npz [default: lafan 20, npz 50].
    #[arg(long, value_name = "HZ", value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub(super) fps: Option<u32>,
    /// Order of bodies and joints in an npz file [default: mujoco].
    #[arg(long, value_enum)]
    pub(super) bodies: Option<BodiesArg>,
    /// The motion command of a UR5e's program [default: servoj].
    #[arg(long, value_enum)]
    pub(super) ur_move: Option<UrArg>,
    /// Rename joints: a file with TOML lines such as elbow_joint = "elbow_flex"; for ros, bag and
    /// lerobot.
    #[arg(long, value_name = "FILE")]
    pub(super) rename: Option<PathBuf>,
    /// Export the frames before the damage of a damaged take.
    #[arg(long)]
    pub(super) recover: bool,
    /// The viser client's index.html, if this program does not contain it (for html).
    #[arg(long, value_name = "FILE")]
    pub(super) viser_client: Option<PathBuf>,
    /// Print a JSON report (with -o).
    #[arg(long)]
    pub(super) json: bool,
    #[command(flatten)]
    pub(super) perform: PerformArgs,
}

/// For robots under ROS 2.
#[derive(clap::Args, Debug)]
pub(super) struct RosFlags {
    /// Time before the first point, s, in which the robot moves there; for ros and bag.
    #[arg(long, value_name = "SECS", default_value_t = 0.0)]
    pub(super) lead_in: f64,
    /// Write the goal of a FollowJointTrajectory action (for ros).
    #[arg(long)]
    pub(super) goal: bool,
    /// Add torques, which controllers without an effort interface refuse; for ros and bag.
    #[arg(long)]
    pub(super) effort: bool,
}

/// For LeRobot.
#[derive(clap::Args, Debug)]
pub(super) struct LearnFlags {
    /// The content of the action column of a LeRobot dataset [default: position].
    #[arg(long, value_enum)]
    pub(super) action: Option<ActionArg>,
    /// Angles of a LeRobot dataset in degrees.
    #[arg(long)]
    pub(super) degrees: bool,
    /// Layout of a LeRobot dataset [default: 3.0].
    #[arg(long, value_enum, value_name = "VERSION")]
    pub(super) lerobot_version: Option<VersionArg>,
    /// Film each episode of a LeRobot dataset at this size: 640x480.
    #[arg(long, value_name = "WxH")]
    pub(super) video: Option<String>,
    /// The task in words, for lerobot and minari [default: the clip's name].
    #[arg(long, value_name = "TEXT")]
    pub(super) task: Option<String>,
}

impl Args {
    /// Refuses what cannot be, before any work.
    pub(super) fn check(&self) -> Outcome {
        let commands = self.to.has_command() || self.to == Format::Bag;
        if What::from(self.what) == What::Command && !commands {
            return Err(Failure::usage("--what command is for csv, json, mjcf, ros, bag and ur"));
        }
        let of_ros = matches!(self.to, Format::Ros | Format::Bag);
        let (to, learn) = (self.to, &self.learn);
        let lerobot = to == Format::Lerobot;
        let lead = self.ros.lead_in;
        if !(0.0..=3600.0).contains(&lead) {
            return Err(Failure::usage(format!("--lead-in takes 0 to 3600 s, not {lead}")));
        }
        let given = [
            ("--with-model", self.with_model, to == Format::Mjcf, "mjcf"),
            ("--goal", self.ros.goal, to == Format::Ros, "ros"),
            ("--lead-in", lead > 0.0, of_ros, "ros and bag"),
            ("--effort", self.ros.effort, of_ros, "ros and bag"),
            ("--rename", self.rename.is_some(), of_ros || lerobot, "ros, bag and lerobot"),
            ("--degrees", learn.degrees, lerobot, "lerobot"),
            ("--video", learn.video.is_some(), lerobot, "lerobot"),
            ("--action", learn.action.is_some(), lerobot, "lerobot"),
            ("--lerobot-version", learn.lerobot_version.is_some(), lerobot, "lerobot"),
            ("--task", learn.task.is_some(), to.gathers(), "lerobot and minari"),
            (
                "--fps",
                self.fps.is_some(),
                matches!(to, Format::Lafan | Format::Npz),
                "lafan and npz",
            ),
            ("--bodies", self.bodies.is_some(), to == Format::Npz, "npz"),
            ("--ur-move", self.ur_move.is_some(), to == Format::Ur, "ur"),
            ("--viser-client", self.viser_client.is_some(), to == Format::Html, "html"),
        ];
        if let Some((flag, _, _, of)) = given.iter().find(|(_, asked, fits, _)| *asked && !fits) {
            return Err(Failure::usage(format!("{flag} is for --to {of}")));
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
