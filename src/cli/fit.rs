//! `robert fit`: fits policies that need no training to collected motion.

use std::path::PathBuf;
use std::time::Instant;

use serde::Serialize;

use super::bar::Bar;
use super::failure::Outcome;
use super::global::{Global, Threads};
use super::interrupt::cancel_on_ctrl_c;
use super::{motion, out, output};
use crate::dataset::{self, Dataset, Verify};
use crate::rollout::{InverseSettings, NEAREST_FRAMES};
use crate::train::{self, fit, fit::HIDDEN};
use crate::units::count;

/// Frames that `nearest` can search.
fn nearest_frames(text: &str) -> Result<u64, String> {
    match count(text)? {
        n if (51..=20_000_000).contains(&n) => Ok(n),
        n => Err(format!("{n} is not in 51..=20000000")),
    }
}

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert fit ridge --data data/ur5e\n  robert fit nearest --data data/ur5e --frames 100000 --out near.safetensors\n  robert fit mlp-inverse --data data/ur5e --json\n  robert eval --robot ur5e --suite manual -p ridge:data/ur5e,nearest:data/ur5e\n\nWithout --out the fit is written into the data's folder, and that folder's name then selects it.\nOnly the training part of the data is used; the error is measured on the rest."
)]
pub(super) struct Args {
    /// The policy to fit.
    #[arg(value_enum)]
    policy: Fit,
    /// Dataset folder.
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// File to write [default: POLICY.safetensors in the data's folder].
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Refuse data of any other robot.
    #[arg(long, value_name = "ID|DIR")]
    robot: Option<String>,
    /// Seed of the random choices, and of the split if the dataset fixes none.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// nearest: the most frames to search, in whole trajectories, evenly spread.
    #[arg(long, default_value_t = NEAREST_FRAMES as u64, value_parser = nearest_frames)]
    frames: u64,
    /// mlp-inverse: training steps.
    #[arg(long, default_value_t = InverseSettings::default().steps, value_parser = clap::value_parser!(u64).range(1..=10_000_000))]
    steps: u64,
    /// mlp-inverse: units in each of the two hidden layers.
    #[arg(long, default_value_t = InverseSettings::default().width as u64, value_parser = clap::value_parser!(u64).range(1..=4096))]
    width: u64,
    #[command(flatten)]
    threads: Threads,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Fit {
    /// One linear map for each number of frames to the next goal.
    Ridge,
    /// The actions of the recorded moments most similar to this one.
    Nearest,
    /// A small network of three frames: the last, the current and the next command.
    MlpInverse,
}

impl Fit {
    fn as_str(self) -> &'static str {
        match self {
            Fit::Ridge => "ridge",
            Fit::Nearest => "nearest",
            Fit::MlpInverse => "mlp-inverse",
        }
    }
}

#[derive(Serialize)]
struct Report<'a> {
    policy: &'static str,
    robot: &'a str,
    out: PathBuf,
    seed: u64,
    dataset_sha256: String,
    secs: f64,
    hidden: [usize; 3],
    /// Share of the actions' variance, by hidden frames.
    held_out: Option<[f64; 3]>,
}

pub(super) fn run(args: &Args, global: Global) -> Outcome {
    let data = Dataset::open(&args.data, Verify::Full)?;
    if let Some(robot) = &args.robot {
        data.must_be_of(&*motion::robot(robot)?)?;
    }
    let of = &data.manifest().robot;
    let name = args.policy.as_str();
    let beside = data.path().with_file_name(format!("{name}.safetensors"));
    let path = args.out.clone().unwrap_or(beside);
    output::may_create(&path)?;
    let threads = args.threads.count();
    let bar = Bar::new("fit", "steps", global.quiet || args.json);
    let cancel = cancel_on_ctrl_c();
    let begin = Instant::now();
    let fitted = match args.policy {
        Fit::Ridge => fit::ridge(&data, args.seed, threads, &path, &cancel),
        Fit::Nearest => fit::nearest(&data, args.seed, args.frames as usize, &path),
        Fit::MlpInverse => {
            let settings = InverseSettings {
                width: args.width as usize,
                steps: args.steps,
                ..InverseSettings::default()
            };
            fit::mlp_inverse(&data, args.seed, &settings, &path, &bar, &cancel)
        }
    };
    bar.finish();
    let mut fitted = fitted?;
    let secs = begin.elapsed().as_secs_f64();
    // The fit is useful even if there are too few data to hold any out.
    let held_out = match fit::held_out(&data, args.seed, &mut fitted) {
        Err(train::Error::Data(dataset::Error::Empty { .. })) => None,
        measured => Some(measured?),
    };
    if args.json {
        return out::json(&Report {
            policy: name,
            robot: &of.id,
            out: path,
            seed: args.seed,
            dataset_sha256: data.manifest().sha256(),
            secs,
            hidden: HIDDEN,
            held_out,
        });
    }
    let error = held_out.map_or_else(
        || "no trajectory is held out to measure on".to_owned(),
        |e| {
            let [a, b, c] = e;
            let [_, many, most] = HIDDEN;
            format!(
                "held-out action error (share of variance): {a:.4} next frame known, {b:.3} / {c:.3} with {many} / {most} frames hidden"
            )
        },
    );
    out::line(&format!(
        "{name} for {} in {secs:.1} s: {}\n{error}\nuse it: robert rollout CLIP --policy {name}:{}",
        of.id,
        path.display(),
        path.display()
    ))
}
