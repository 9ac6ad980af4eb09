//! `robert tasks`: the built-in task clips.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::bar::Bar;
use super::failure::{Failure, Outcome};
use super::global::Global;
use super::interrupt::cancel_on_ctrl_c;
use super::{motion, out, output};
use crate::fsio;
use crate::rollout::tasks::{self, SUITES};
use crate::rollout::{Case, Start, floor};

#[derive(clap::Subcommand, Debug)]
#[command(
    after_help = "Examples:\n  robert tasks ls --robot shadow_hand\n  robert tasks show ur5e/hang > my.clip.json\n  robert tasks trial --robot my_arm --out my_arm/clips"
)]
pub(super) enum Args {
    /// List the tasks by robot and suite.
    #[command(
        after_help = "Examples:\n  robert tasks ls\n  robert tasks ls --robot shadow_hand --json"
    )]
    Ls {
        /// List only the tasks of this robot.
        #[arg(long)]
        robot: Option<String>,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// Print a task's clip.
    #[command(
        after_help = "Examples:\n  robert tasks show fire\n  robert tasks show ur5e/hang > my.clip.json"
    )]
    Show {
        /// NAME or ROBOT/NAME.
        task: String,
    },
    /// Write five clips that are generated from a robot's limits and a seed: a start for your own
    /// robot.
    #[command(
        after_help = "Examples:\n  robert tasks trial --robot my_arm --out my_arm/clips\n  robert tasks trial --robot ur5e --out trial --seed 3"
    )]
    Trial {
        /// The robot: an id, or a folder.
        #[arg(long, value_name = "ID|DIR")]
        robot: String,
        /// Folder for the clips.
        #[arg(short, long, value_name = "DIR")]
        out: PathBuf,
        /// Seed of the poses.
        #[arg(long, default_value_t = 0)]
        seed: u64,
    },
    /// Measure the floors again: the Precision of iLQR on every task clip, to which robert eval
    /// relates its excess.
    #[command(hide = true)]
    Floors {
        /// The folder for the files.
        #[arg(short, long)]
        out: PathBuf,
        /// Measure only the tasks of this robot.
        #[arg(long)]
        robot: Option<String>,
    },
}

pub(super) fn run(args: &Args, global: Global) -> Outcome {
    match args {
        Args::Ls { robot, json } => ls(robot.as_deref(), *json),
        Args::Show { task } => {
            let clip = tasks::find(task, None)?;
            out::line(clip.to_text().trim_end())
        }
        Args::Trial { robot, out, seed } => trial(robot, out, *seed),
        Args::Floors { out, robot } => floors(out, robot.as_deref(), global),
    }
}

fn ls(robot: Option<&str>, json: bool) -> Outcome {
    let manifest = tasks::manifest()?;
    let robots: Vec<&str> = match robot {
        Some(robot) => vec![robot],
        // A robot that uses another robot's clips would only repeat them.
        None => {
            manifest.iter().filter(|(_, t)| t.like.is_none()).map(|(id, _)| id.as_str()).collect()
        }
    };
    let mut rows: Vec<Value> = Vec::new();
    let mut t = out::table(&["robot", "suite", "task", "frames", "visible", "description"]);
    for robot in robots {
        for suite in SUITES {
            for (name, clip) in tasks::suite(robot, suite)? {
                let command = crate::clip::compile(&clip)
                    .map_err(|e| Failure::invalid(format!("{robot}/{name}: {e}")))?;
                let seen = (1..command.frames())
                    .filter(|f| command.sight(*f) != crate::clip::Sight::Masked)
                    .count();
                let visible = seen as f64 / f64::from(command.frames().saturating_sub(1).max(1));
                rows.push(json!({
                    "robot": robot, "suite": suite, "task": name, "title": clip.name,
                    "frames": clip.length, "visible": visible, "about": clip.notes,
                }));
                t.add_row([
                    robot.to_owned(),
                    suite.to_owned(),
                    name,
                    clip.length.to_string(),
                    format!("{:.0} %", 100.0 * visible),
                    clip.notes,
                ]);
            }
        }
    }
    if json { out::json(&rows) } else { out::line(&t.to_string()) }
}

/// The trial clips of a robot as files.
fn trial(robot: &str, dir: &Path, seed: u64) -> Outcome {
    let robot = motion::robot(robot)?;
    let mut files = Vec::new();
    for task in tasks::trial(&robot, seed)? {
        let path = dir.join(format!("{}{}", task.name, motion::CLIP_SUFFIX));
        files.push((path, task.clip.to_text()));
    }
    // The same clips may be written again, but a person may have changed them.
    let other = |path: &Path, text: &str| std::fs::read(path).is_ok_and(|t| t != text.as_bytes());
    for (path, _) in files.iter().filter(|(path, text)| other(path, text)) {
        output::may_create(path)?;
    }
    for (path, text) in files {
        fsio::write_atomic(&path, text.as_bytes())?;
        out::line(&path.display().to_string())?;
    }
    Ok(())
}

/// The floors of every robot's clips.
fn floors(dir: &Path, only: Option<&str>, global: Global) -> Outcome {
    let cancel = cancel_on_ctrl_c();
    for (id, _) in tasks::manifest()?.iter().filter(|(id, _)| only.is_none_or(|o| o == *id)) {
        let robot = motion::robot(id)?;
        let mut cases = Vec::new();
        for suite in SUITES {
            for (name, clip) in tasks::suite(id, suite)? {
                let command = motion::command(&clip, &robot, &name)?;
                cases.push(Case { name, command, start: Start::Pose, truth: None, floor: None });
            }
        }
        let bar = Bar::new(id, "frames", global.quiet);
        let table = floor::measure_table(&robot, cases, super::global::cores(), &bar, &cancel);
        bar.finish();
        let path = dir.join(format!("{id}.json"));
        fsio::write_atomic(&path, table?.to_text().as_bytes())?;
        out::line(&path.display().to_string())?;
    }
    Ok(())
}
