//! `robert dataset`: inspect collected trajectories and make views of them.

use std::path::{Component, Path, PathBuf};

use clap::Subcommand;
use serde::Serialize;

use super::failure::{Failure, Outcome};
use super::{dataset_plot, out, output};
use crate::dataset::{self, Corruption, Dataset, Manifest, Statistics, Totals, View};
use crate::exit::Exit;
use crate::plot::Theme;

/// Share of frames at a stop above which a joint gets a warning.
const PINNED: f64 = 0.3;
/// The most bad files that the error names; the lines before it name all of them.
const NAMED: usize = 5;

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert dataset info data/ur5e\n  robert dataset merge data/rnd data/icm --equal --out data/all\n  robert dataset shrink 10 data/all --out data/tenth\n\nViews (split, shrink, corrupt, merge) copy no frames. They list trajectories of the same shard files."
)]
pub(super) struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Print the content of a dataset, and its quality.
    #[command(
        after_help = "Examples:\n  robert dataset info data/ur5e\n  robert dataset info data/ur5e --json | jq .totals"
    )]
    Info {
        /// Dataset folder.
        data: PathBuf,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// Merge datasets of one robot.
    #[command(
        after_help = "Examples:\n  robert dataset merge data/rnd data/icm --equal --out data/all\n\nIt is an error if two inputs have the same trajectory. If only some inputs have a fixed split, the\nothers get the usual one (5 % by seed 0)."
    )]
    Merge {
        /// Dataset folders; their order does not matter.
        #[arg(required = true)]
        data: Vec<PathBuf>,
        /// Reduce every agent to the number of frames of the smallest one.
        #[arg(long)]
        equal: bool,
        #[command(flatten)]
        out: Out,
    },
    /// Decide which trajectories are held out.
    #[command(
        after_help = "Examples:\n  robert dataset split data/all --test 0.1 --out data/split"
    )]
    Split {
        /// Dataset folder.
        data: PathBuf,
        /// Seed of the split.
        #[arg(long, default_value_t = 0)]
        seed: u64,
        /// Share of trajectories held out.
        #[arg(long, default_value_t = 0.05)]
        test: f64,
        #[command(flatten)]
        out: Out,
    },
    /// Keep the trajectories of some agents, or a number of frames, evenly spread.
    #[command(
        after_help = "Examples:\n  robert dataset pick data/all --agent rnd,icm --out data/agents\n  robert dataset pick data/all --frames 100000 --out data/less"
    )]
    Pick {
        /// Dataset folder.
        data: PathBuf,
        /// Agents to keep [default: all].
        #[arg(long, value_delimiter = ',')]
        agent: Vec<String>,
        /// Frames to keep at most.
        #[arg(long)]
        frames: Option<u64>,
        #[command(flatten)]
        out: Out,
    },
    /// Keep every K-th trajectory (of the training part, if the split is fixed).
    #[command(after_help = "Examples:\n  robert dataset shrink 10 data/all --out data/tenth")]
    Shrink {
        /// Keep one trajectory in K.
        k: u64,
        /// Dataset folder.
        data: PathBuf,
        #[command(flatten)]
        out: Out,
    },
    /// Overwrite a share P of the training trajectories by copies of one of them.
    #[command(
        after_help = "Examples:\n  robert dataset corrupt 0.5 data/all --out data/half_copies"
    )]
    Corrupt {
        /// Share, 0 to 1.
        p: f64,
        /// Dataset folder.
        data: PathBuf,
        /// Draw another trajectory to copy for every slot.
        #[arg(long)]
        per_slot: bool,
        /// Seed of the choice.
        #[arg(long, default_value_t = 0)]
        seed: u64,
        #[command(flatten)]
        out: Out,
    },
    /// Draw the visited states: histograms, speeds, planes of joints.
    #[command(
        after_help = "Examples:\n  robert dataset plot data/all --out all.png\n  robert dataset plot data/all --by-agent --out agents.svg"
    )]
    Plot {
        /// Dataset folder.
        data: PathBuf,
        /// Picture to write (png or svg).
        #[arg(short, long)]
        out: PathBuf,
        /// Only these joints.
        #[arg(long, value_delimiter = ',')]
        joints: Vec<String>,
        /// Draw one column of planes per agent instead of all together.
        #[arg(long)]
        by_agent: bool,
        /// Use a dark background.
        #[arg(long)]
        dark: bool,
    },
    /// Verify every shard (sha256, shapes, values, trajectories) and the sums of the manifest. If
    /// any is bad, they are named and the exit code is 3.
    #[command(after_help = "Examples:\n  robert dataset check data/all")]
    Check {
        /// Dataset folder.
        data: PathBuf,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
}

#[derive(clap::Args, Debug)]
struct Out {
    /// Folder of the new manifest.
    #[arg(short, long)]
    out: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Info<'a> {
    robot: &'a str,
    model_sha256: &'a str,
    manifest_sha256: String,
    fps: u32,
    qpos_dim: usize,
    ctrl_dim: usize,
    joints: &'a [String],
    actuators: &'a [String],
    totals: Totals,
    views: &'a [View],
    statistics: &'a Statistics,
}

pub(super) fn run(args: Args) -> Outcome {
    match args.what {
        What::Info { data, json } => info(&Manifest::load(&data)?, json),
        What::Merge { data, equal, out } => {
            may_derive(&data, &out.out)?;
            publish(dataset::merge(&data, &out.out, equal)?, None, &out)
        }
        What::Split { data, seed, test, out } => {
            view(&data, &out, |m| dataset::split(m, seed, test))
        }
        What::Pick { data, agent, frames, out } => {
            view(&data, &out, |m| dataset::pick(m, &agent, frames))
        }
        What::Shrink { k, data, out } => view(&data, &out, |m| dataset::shrink(m, k)),
        What::Corrupt { p, data, per_slot, seed, out } => {
            let how = Corruption { share: p, per_slot, seed };
            view(&data, &out, |m| dataset::corrupt(m, how))
        }
        What::Check { data, json } => check(&data, json),
        What::Plot { data, out, joints, by_agent, dark } => {
            let theme = if dark { Theme::Dark } else { Theme::Light };
            dataset_plot::run(&data, &out, &joints, by_agent, theme)
        }
    }
}

fn view(
    data: &Path,
    out: &Out,
    change: impl FnOnce(&mut Manifest) -> Result<(), dataset::Error>,
) -> Outcome {
    may_derive(&[data.to_owned()], &out.out)?;
    let mut m = Manifest::load(data)?;
    let shortest = m.episodes.iter().map(|e| e.length).min();
    change(&mut m)?;
    dataset::rebase(&mut m, &Manifest::path_of(data), &out.out)?;
    publish(m, shortest, out)
}

fn may_derive(data: &[PathBuf], out: &Path) -> Outcome {
    let real = |p: &Path| p.canonicalize().ok();
    if data.iter().any(|d| real(d).is_some() && real(d) == real(out)) {
        return Err(Failure::usage(format!(
            "--out must be another folder than the data, got {}",
            out.display()
        )));
    }
    output::may_be_folder(out)?;
    // The manifest of a view may be replaced: the same command makes it again.
    if Manifest::load(out).is_ok_and(|m| m.shards.iter().any(|s| is_own(out, &s.file))) {
        return Err(Failure::usage(format!(
            "{} holds shards that only its manifest describes: choose another --out",
            out.display()
        )));
    }
    Ok(())
}

/// Whether a shard lies in this dataset's folder and in no other dataset's.
fn is_own(dataset: &Path, shard: &Path) -> bool {
    let inside = shard.components().all(|c| matches!(c, Component::Normal(_)));
    let folders = shard.ancestors().skip(1).filter(|f| !f.as_os_str().is_empty());
    inside && folders.into_iter().all(|f| !Manifest::path_of(&dataset.join(f)).exists())
}

/// Writes the manifest if anything is left. `shortest` is the shortest trajectory of its source.
fn publish(m: Manifest, shortest: Option<u64>, out: &Out) -> Outcome {
    if m.episodes.is_empty() {
        return Err(Failure::usage(shortest.map_or_else(
            || "the result would be empty: the data have no trajectory".to_owned(),
            |n| format!("the result would be empty: the shortest trajectory has {n} frames"),
        )));
    }
    let m = Dataset::publish(m, &out.out)?;
    if out.json {
        return info(&m, true);
    }
    out::line(&format!(
        "{}: {} trajectories, {} frames in {} shards",
        out.out.display(),
        m.totals.episodes,
        m.totals.frames,
        m.totals.shards
    ))
}

fn check(data: &Path, json: bool) -> Outcome {
    let problems = Dataset::check(data)?;
    let shards = Manifest::load(data)?.totals.shards;
    if json {
        out::json(&serde_json::json!({ "shards": shards, "problems": problems }))?;
    } else {
        for p in &problems {
            out::line(&format!("shard {} {}: {}", p.shard, p.message, p.path.display()))?;
        }
    }
    match problems.len() {
        0 if json => Ok(()),
        0 => out::line(&format!("{shards} shards are whole: {}", data.display())),
        n => {
            let files: Vec<String> =
                problems.iter().map(|p| p.path.display().to_string()).collect();
            let more = n.saturating_sub(NAMED);
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            let named = files.get(..NAMED).unwrap_or(&files).join(", ");
            Err(Failure::with(
                Exit::Invalid,
                format!(
                    "{n} of {shards} shards are missing, damaged or not as listed: {named}{more}; \
                     where they were collected, delete them and repeat the command with --resume \
                     (robert collect … --resume): {}",
                    data.display()
                ),
            ))
        }
    }
}

pub(super) fn info(m: &Manifest, json: bool) -> Outcome {
    if json {
        return out::json(&Info {
            robot: &m.robot.id,
            model_sha256: &m.robot.model_sha256,
            manifest_sha256: m.sha256(),
            fps: m.fps,
            qpos_dim: m.qpos_dim(),
            ctrl_dim: m.ctrl_dim(),
            joints: &m.robot.joints,
            actuators: &m.robot.actuators,
            totals: m.totals,
            views: &m.views,
            statistics: &m.statistics,
        });
    }
    let (t, s) = (m.totals, &m.statistics);
    let percent = |x: f64| format!("{:.1} %", x * 100.0);
    let agents: Vec<String> = s.agents.iter().map(|(a, n)| format!("{a} {n}")).collect();
    let hours = t.frames as f64 / f64::from(m.fps) / 3600.0;
    out::line(&format!(
        "{}: {} trajectories, {} frames ({hours:.1} h at {} Hz) in {} shards\nagents: {}\ndropped: {} broken, {} short   self-contact: {}   any joint near a stop: {}   coverage: {}",
        m.robot.id,
        t.episodes,
        t.frames,
        m.fps,
        t.shards,
        agents.join(", "),
        t.dropped_broken,
        t.dropped_short,
        percent(s.self_contact),
        percent(s.near_limit_any),
        percent(s.coverage),
    ))?;
    let mut table =
        out::table(&["joint", "unit", "min", "mean", "max", "std", "speed std", "near a stop"]);
    let value = |v: &[f64], j: usize| v.get(j).map_or(String::new(), |x| format!("{x:.3}"));
    for (j, (name, unit)) in m.robot.joints.iter().zip(&m.robot.units).enumerate() {
        table.add_row([
            name.clone(),
            unit.symbol().to_owned(),
            value(&s.qpos_min, j),
            value(&s.qpos_mean, j),
            value(&s.qpos_max, j),
            value(&s.qpos_std, j),
            value(&s.qvel_std, j),
            s.near_limit.get(j).map_or(String::new(), |&x| percent(x)),
        ]);
    }
    out::line(&table.to_string())?;
    let mut table = out::table(&["actuator", "control range", "saturated"]);
    for ((name, [lo, hi]), x) in m.robot.actuators.iter().zip(&m.robot.ctrlranges).zip(&s.saturated)
    {
        table.add_row([name.clone(), format!("{lo} .. {hi}"), percent(*x)]);
    }
    out::line(&table.to_string())?;
    let pinned: Vec<String> = m
        .robot
        .joints
        .iter()
        .zip(&s.near_limit)
        .filter(|(_, x)| **x > PINNED)
        .map(|(name, x)| format!("{name} {:.0} %", x * 100.0))
        .collect();
    if !pinned.is_empty() {
        tracing::warn!(
            "in many frames these joints are near a stop, where torque cannot be inferred from positions: {}",
            pinned.join(", ")
        );
    }
    Ok(())
}
