//! The arguments of `robert eval`.

use std::path::PathBuf;

use crate::cli::global::Threads;
use crate::cli::input;
use crate::cli::perform::{Conditions, who};
use crate::gpu::Choice;

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert eval --robot ur5e --suite manual --policy zero,pd,computed-torque,ilqr\n  robert eval --robot ur5e --suite manual -p pd,pd+guide --plant mass=1.25,damping=1.5,gear=0.85\n  robert eval --robot ur5e --suite manual -p robert:adaptive+guide --plant mass=0.7..1.4 --seeds 8\n  robert eval --suite ur5e/reacher,ur5e/swing -p auto,robert,pd\n  robert eval --suite my-clips/ --policy ilqr --max-precision 0.005 --json\n  robert eval --robot ur5e --suite manual -p pd,ilqr --seeds 4 --plant gear=0.8..1.2 --plot bars.png"
)]
pub(in crate::cli) struct Args {
    /// The robot; clip files name their own.
    #[arg(long, value_name = "ID|DIR")]
    pub(super) robot: Option<String>,
    /// The tasks to perform. Built-in suites: manual, extra, validation; drawn, fast, touch;
    /// drawn-final, fast-final, touch-final (together: final). Single tasks by their names (robert
    /// tasks ls). Clip files, or folders of clips.
    /// trial: five clips that are generated from the robot's limits and --data-seed. test: tasks
    /// extracted from the held-out part of --data, with no frames, a quarter and half of the frames
    /// hidden.
    #[arg(long, required = true, num_args = 1.., value_delimiter = ',')]
    pub(super) suite: Vec<String>,
    /// The dataset for the suite test.
    #[arg(long, value_name = "DIR")]
    pub(super) data: Option<PathBuf>,
    /// Tasks per suite extracted from data [default: 30 for the arm, 6 for others, as in the
    /// paper].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub(super) cases: Option<u16>,
    /// Seed of the extracted tasks, of their masks, and of the split if the dataset fixes none.
    #[arg(long, default_value_t = 0, value_name = "SEED")]
    pub(super) data_seed: u64,
    /// Policies; --help lists all.
    #[arg(short, long, required = true, num_args = 1.., value_delimiter = ',', long_help = who("Policies:"))]
    pub(super) policy: Vec<String>,
    #[command(flatten)]
    pub(super) conditions: Conditions,
    /// Use the seeds 0 to N-1; intervals are over seeds.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub(super) seeds: u64,
    #[command(flatten)]
    pub(super) threads: Threads,
    /// The device that computes the networks: the processor, or a graphics card, whose rounding
    /// differs. With a card, 64 rollouts run at once unless --threads gives another number. `auto`
    /// uses a card if there is one. Policies with `auto` or `+refine` stay on the processor.
    /// ROBERT_GPU=software allows the software driver.
    #[arg(long, value_name = "auto|cpu|gpu[:N]", default_value_t = Choice::Cpu)]
    pub(super) device: Choice,
    /// Exit with 4 if a policy's mean Precision over a suite is above this (rad or m).
    #[arg(long, value_name = "X")]
    pub(super) max_precision: Option<f64>,
    /// Do not compare with iLQR, which knows the model. Its Precision is stored for built-in clips;
    /// measuring it for another clip can take seconds.
    #[arg(long)]
    pub(super) no_floor: bool,
    /// Write CSV with one row per task and policy; - is stdout.
    #[arg(long, value_name = "FILE")]
    pub(super) csv: Option<PathBuf>,
    /// Write results.json, results.csv and errors.csv (error per frame) to this folder.
    #[arg(short, long, value_name = "DIR")]
    pub(super) out: Option<PathBuf>,
    /// Write a bar chart of the Precisions with 95 % intervals, .png or .svg; - writes SVG to
    /// stdout.
    #[arg(long, value_name = "FILE")]
    pub(super) plot: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    pub(super) json: bool,
}

impl Args {
    /// Whether an output file goes to stdout.
    pub(super) fn takes_stdout(&self) -> bool {
        [&self.csv, &self.plot].into_iter().flatten().any(|p| input::is_standard(p))
    }
}
