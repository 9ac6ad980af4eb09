//! `robert bench reference`: worked examples for other implementations of the network.

use std::path::PathBuf;

use crate::cli::failure::Outcome;
use crate::cli::out;
use crate::net::exchange;

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert bench reference --out ref && python benches/peers/reference.py ref"
)]
pub(super) struct Args {
    /// Folder for the files, one for each variant of the network.
    #[arg(short, long)]
    out: PathBuf,
    /// Seed of the numbers.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

pub(super) fn run(args: &Args) -> Outcome {
    for (name, cfg, current_only) in exchange::variants() {
        let path = args.out.join(format!("{name}.safetensors"));
        exchange::write(&path, &cfg, current_only, args.seed)?;
        out::line(&path.display().to_string())?;
    }
    Ok(())
}
