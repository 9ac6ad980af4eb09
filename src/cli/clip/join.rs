//! `robert clip join`: several clips as one, one after the other.

use std::path::{Path, PathBuf};

use super::super::failure::{Failure, Outcome};
use super::super::input;
use crate::clip::{BlocksInsert, Clip, Marker, Op, Part, edited};

/// Put clips one after the other into one clip, with a blend between them.
///
/// Each becomes a block of the new clip, which the studio moves and repeats as a whole. The same file
/// may be named several times. Robot, poses, notes and start are those of the first clip; the joints of
/// all clips must have the same names.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert clip join one.clip.json two.clip.json -o both.clip.json\n  robert clip join wave.clip.json hop.clip.json wave.clip.json --blend 20 -o show.clip.json"
)]
pub(super) struct Join {
    /// The clips, in their order.
    #[arg(required = true)]
    clips: Vec<PathBuf>,
    /// Frames of the smooth curve from one to the next (0 to 1000).
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u32).range(0..=1000))]
    blend: u32,
    /// Write to this file instead of stdout.
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Overwrite an existing file.
    #[arg(long)]
    force: bool,
    /// The robot, for end-effector goals and joints that follow others [default: the clip's own, if it is built in].
    #[arg(long, value_name = "ID|DIR")]
    robot: Option<String>,
}

pub(super) fn run(a: &Join) -> Outcome {
    let mut joined: Option<Clip> = None;
    for path in &a.clips {
        let clip = super::files::load(path)?.clip;
        let name = name_of(&clip, path);
        joined = Some(match joined {
            None => first(clip, name),
            Some(whole) => {
                let robot = super::files::robot_of(&whole, a.robot.as_deref())?;
                let table = super::files::joint_table(&whole, robot.as_ref());
                let (at, part) = (whole.length, Part::of(&clip));
                let op = Op::BlocksInsert(BlocksInsert { at, name, part, blend: a.blend });
                edited(&whole, &op, Some(&table))
                    .map_err(|e| Failure::invalid(format!("{}: {e}", path.display())))?
            }
        });
    }
    let Some(clip) = joined else { return Err(Failure::usage("no clip is given")) };
    super::files::deliver(&clip, a.out.as_deref(), a.force)
}

/// The first clip, as a block.
fn first(mut clip: Clip, name: String) -> Clip {
    clip.markers.retain(|m| m.frame != 0);
    clip.markers.push(Marker { frame: 0, name, to: Some(clip.length) });
    clip.normalize();
    clip
}

fn name_of(clip: &Clip, path: &Path) -> String {
    let file = || {
        let file = input::place(path).file_name().map(|n| n.to_string_lossy().into_owned());
        let file = file.unwrap_or_default();
        file.split('.').next().unwrap_or_default().to_owned()
    };
    // The name of a block has no space around it.
    let name = if clip.name.trim().is_empty() { file() } else { clip.name.clone() };
    let name = name.trim();
    if name.is_empty() { "block".to_owned() } else { name.to_owned() }
}
