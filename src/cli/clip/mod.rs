//! `robert clip …`: the same operations as in the studio, without it.

mod check;
mod convert;
mod edit;
mod info;

use std::path::{Path, PathBuf};

use clap::Subcommand;

use super::failure::{Failure, Outcome};
use crate::clip::{Clip, Fill, JointTable, Parsed, RobotRef};
use crate::robot::Robot;

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
    Diff(info::Diff),
    Convert(convert::Convert),
    Schema(Schema),
    Upgrade(edit::Upgrade),
}

/// Print the JSON Schema (2020-12) of clip files.
///
/// Editors use it to complete and check clips: save it and refer to it in your editor's
/// settings for *.clip.json.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  robert clip schema > robert-clip-1.schema.json")]
struct Schema {}

pub(super) fn run(args: &Args) -> Outcome {
    match &args.command {
        Command::New(a) => edit::new(a),
        Command::Check(a) => check::run(a),
        Command::Fmt(a) => edit::fmt(a),
        Command::Info(a) => info::info(a),
        Command::Apply(a) => edit::apply_ops(a),
        Command::Diff(a) => info::diff(a),
        Command::Convert(a) => convert::run(a),
        Command::Schema(_) => super::out::json(&crate::clip::schema()),
        Command::Upgrade(a) => edit::upgrade(a),
    }
}

/// Reads a clip; `-` is stdin.
fn load(path: &Path) -> Result<Parsed, Failure> {
    if path == Path::new("-") {
        return Ok(crate::clip::parse_bytes(stdin()?).map_err(|e| e.in_file(Path::new("stdin")))?);
    }
    Ok(crate::clip::load(path)?)
}

fn stdin() -> Result<Vec<u8>, Failure> {
    use std::io::Read as _;
    let mut bytes = Vec::new();
    let cap = crate::limits::CLIP_BYTES;
    std::io::stdin().lock().take(cap + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > cap {
        return Err(Failure::invalid(format!("stdin: more than {cap} bytes")));
    }
    Ok(bytes)
}

/// The one place that asks for a robot: an id, or a folder.
fn robot(id: &str) -> Result<Robot, Failure> {
    Ok(Robot::load(id)?)
}

/// The robot named on the command line, else the clip's own where it is known here.
fn robot_of(clip: &Clip, asked: Option<&str>) -> Result<Option<Robot>, Failure> {
    match asked {
        Some(id) => robot(id).map(Some),
        None if Robot::builtin_ids().any(|id| id == clip.robot.id) => {
            robot(&clip.robot.id).map(Some)
        }
        None => Ok(None),
    }
}

/// What is known about a clip's robot: everything, or only what the clip says.
fn joint_table(clip: &Clip, robot: Option<&Robot>) -> JointTable {
    robot.map_or_else(|| JointTable::from_clip(clip), Robot::joint_table)
}

/// Robot and joint order for a file that has none of its own.
fn reference(robot_id: Option<&str>, like: Option<&PathBuf>) -> Result<Option<RobotRef>, Failure> {
    match (robot_id, like) {
        (Some(id), _) => Ok(Some(robot(id)?.clip_ref())),
        (None, Some(path)) => Ok(Some(load(path)?.clip.robot)),
        (None, None) => Ok(None),
    }
}

/// Writes a clip to a file, or its text to stdout.
fn deliver(clip: &Clip, out: Option<&Path>, force: bool) -> Outcome {
    let Some(path) = out else { return super::out::line(clip.to_text().trim_end()) };
    if !force && path.exists() {
        let path = path.display();
        return Err(Failure::usage(format!("{path} exists; say --force to overwrite it")));
    }
    clip.save(path)?;
    Ok(())
}

fn fill_word(word: &str) -> Result<Fill, String> {
    Fill::from_word(word).ok_or_else(|| "one of mask, linear, cubic, hold".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fills_are_words_of_the_format() {
        assert_eq!(fill_word("cubic"), Ok(Fill::Cubic));
        assert!(fill_word("spline").is_err());
    }
}
