//! `robert bench`: speed, always as a ratio to a named peer, measured in turns in one run.

mod clock;
mod collect;
mod explore;
mod sim;

use clap::Subcommand;

use super::failure::Outcome;

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert bench sim              control steps a second, against a bare C loop\n  robert bench sim --json --secs 4 --robot ur5e"
)]
pub(super) struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Control steps a second through the simulator layer, against a bare C loop.
    Sim(sim::Args),
    /// Collection: roll-outs against bare simulation, updates of each agent, reading windows.
    Collect(collect::Args),
    /// Reward and coverage of every collector over steps.
    Explore(explore::Args),
}

pub(super) fn run(args: Args) -> Outcome {
    match args.what {
        What::Sim(args) => sim::run(&args),
        What::Collect(args) => collect::run(&args),
        What::Explore(args) => explore::run(&args),
    }
}
