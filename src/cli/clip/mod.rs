//! `robert clip …`: the operations of the studio on the command line.

mod check;
mod convert;
mod edit;
mod files;
mod fix;
mod info;
mod join;
mod ops;
mod recorded;
mod simulate;

use clap::Subcommand;

use super::failure::Outcome;
use super::global::Global;

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert clip new --robot ur5e --secs 5 -o wave.clip.json\n  robert clip check wave.clip.json\n  robert clip check wave.clip.json --fix\n  robert clip apply wave.clip.json ops.json -i\n  robert clip convert wave.clip.json wave.csv"
)]
pub(super) struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    New(edit::New),
    Check(check::Check),
    Fmt(edit::Fmt),
    Info(info::Info),
    Apply(edit::Apply),
    Ops(ops::Ops),
    Diff(info::Diff),
    Convert(convert::Convert),
    Join(join::Join),
    Schema(Schema),
    Upgrade(edit::Upgrade),
}

/// Print the JSON Schema (2020-12) of clip files.
///
/// Editors use it to complete and check clips. Save it, and refer to it in your editor's settings
/// for *.clip.json.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  robert clip schema > robert-clip-1.schema.json")]
struct Schema {}

pub(super) fn run(args: &Args, global: Global) -> Outcome {
    match &args.command {
        Command::New(a) => edit::new(a),
        Command::Check(a) => check::run(a, global),
        Command::Fmt(a) => edit::fmt(a),
        Command::Info(a) => info::info(a),
        Command::Apply(a) => edit::apply_ops(a),
        Command::Ops(a) => ops::run(a),
        Command::Diff(a) => info::diff(a),
        Command::Convert(a) => convert::run(a),
        Command::Join(a) => join::run(a),
        Command::Schema(_) => super::out::json(&crate::clip::schema()),
        Command::Upgrade(a) => edit::upgrade(a),
    }
}
