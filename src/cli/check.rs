//! `robert __compile-check FILE`: the child's side of [`crate::robot::check`].

use std::path::PathBuf;

use super::failure::Outcome;
use super::out;

#[derive(clap::Args, Debug)]
pub(super) struct Args {
    /// The model.
    model: PathBuf,
    /// Simulator steps to try.
    #[arg(long, default_value_t = crate::robot::check::STEPS)]
    steps: usize,
}

pub(super) fn run(args: &Args) -> Outcome {
    out::json(&crate::robot::check::serve(&args.model, args.steps))
}
