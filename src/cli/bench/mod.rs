//! `robert bench`: speed, given as a ratio to a named reference that is measured alternately in the
//! same run.

mod clock;
mod collect;
mod device;
mod engine;
mod explore;
mod infer;
mod reference;
mod render;
mod rollout;
mod sim;
mod train;

use clap::Subcommand;

use super::failure::Outcome;

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert bench sim              control steps per second, against a bare C loop\n  robert bench sim --json --secs 4 --robot ur5e\n  robert bench train            training throughput and its share of the machine's peak\n  robert bench infer            one action at batch 1"
)]
pub(super) struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Control steps per second through the simulator binding, against a bare C loop.
    Sim(sim::Args),
    /// Processor time per picture.
    Render(render::Args),
    /// Processor time of policies, against bare simulation of the same frames.
    Rollout(rollout::Args),
    /// Training throughput of the network, and its share of the machine's peak.
    Train(train::Args),
    /// Time of one action at batch 1.
    Infer(infer::Args),
    /// Write worked examples (weights, batch, loss, gradients) for other implementations.
    Reference(reference::Args),
    /// Collecting: roll-outs against bare simulation, updates of each agent, reading of windows.
    Collect(collect::Args),
    /// Reward and coverage of every collector over steps.
    Explore(explore::Args),
}

pub(super) fn run(args: Args) -> Outcome {
    match args.what {
        What::Sim(args) => sim::run(&args),
        What::Render(args) => render::run(&args),
        What::Rollout(args) => rollout::run(&args),
        What::Train(args) => train::run(&args),
        What::Infer(args) => infer::run(&args),
        What::Reference(args) => reference::run(&args),
        What::Collect(args) => collect::run(&args),
        What::Explore(args) => explore::run(&args),
    }
}
