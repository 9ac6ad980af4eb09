//! `robert clip new|fmt|apply|upgrade`: commands that write clips.

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::super::failure::{Failure, Outcome};
use super::super::{input, out};
use crate::clip::{Clip, Delta, Editor, Fill, Key, Op};
use crate::exit::Exit;
use crate::rollout::ClipFacts;
use crate::{fsio, limits};

/// Create a clip for a robot, with its named poses and a first key.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert clip new --robot shadow_hand --secs 10 -o wave.clip.json\n  robert clip new --robot ur5e --length 120 --fill linear > swing.clip.json"
)]
pub(super) struct New {
    /// Robot id; `robert robots ls` lists them.
    #[arg(long, short)]
    robot: String,
    /// Length in frames of 1/20 s.
    #[arg(long, default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..=i64::from(limits::CLIP_FRAMES)))]
    length: u32,
    /// Length in seconds.
    #[arg(long, conflicts_with = "length", value_name = "SECONDS", allow_negative_numbers = true)]
    secs: Option<f64>,
    /// How to fill the frames between keys: mask, linear, cubic or hold.
    #[arg(long, default_value = "mask", value_parser = super::files::fill_word)]
    fill: Fill,
    /// Pose of the first key [default: the robot's home pose].
    #[arg(long)]
    pose: Option<String>,
    /// Title of the clip.
    #[arg(long, default_value = "")]
    name: String,
    /// Write to this file instead of stdout.
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Overwrite an existing file.
    #[arg(long)]
    force: bool,
}

pub(super) fn new(a: &New) -> Outcome {
    let robot = super::files::robot(&a.robot)?;
    let length = match a.secs {
        None => a.length,
        Some(s) if s > 0.0 && s * 20.0 <= f64::from(limits::CLIP_FRAMES) => {
            ((s * 20.0).round() as u32).max(1)
        }
        Some(s) => {
            let most = f64::from(limits::CLIP_FRAMES) / 20.0;
            return Err(Failure::usage(format!(
                "--secs takes a number above 0 and up to {most}, not {s}"
            )));
        }
    };
    let mut clip = Clip::new(robot.clip_ref(), length);
    clip.name.clone_from(&a.name);
    clip.fill = a.fill;
    for name in robot.pose_names() {
        clip.poses.insert(name.to_owned(), robot.pose(name)?.into_iter().map(Some).collect());
    }
    match &a.pose {
        Some(pose) => {
            robot.pose(pose)?;
            clip.keys.push(Key::posed(0, pose));
        }
        None if clip.poses.contains_key(&robot.profile().home) => {
            clip.keys.push(Key::posed(0, &robot.profile().home));
        }
        None => clip.keys.push(Key::new(0, &robot.home())),
    }
    super::files::deliver(&clip, a.out.as_deref(), a.force)
}

/// Rewrite clips in canonical form: one key per line, sorted, rounded to 1e-6.
///
/// A diff of formatted clips shows one line per changed key.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert clip fmt *.clip.json\n  robert clip fmt --check assets/clips/*/*.clip.json    exit 4 if one is not canonical\n  robert clip fmt - < wave.clip.json                    from stdin to stdout"
)]
pub(super) struct Fmt {
    /// Clip files; - reads stdin and writes stdout.
    #[arg(required = true, value_name = "CLIP")]
    files: Vec<PathBuf>,
    /// Write nothing; exit 4 if a file would change.
    #[arg(long)]
    check: bool,
}

pub(super) fn fmt(a: &Fmt) -> Outcome {
    let mut stale = 0;
    for path in &a.files {
        if path == Path::new("-") {
            let clip = super::files::load(path)?.clip;
            out::line(clip.to_text().trim_end())?;
            continue;
        }
        let bytes = fsio::read_capped(path, limits::CLIP_BYTES)?;
        let parsed = crate::clip::parse_bytes(bytes.clone()).map_err(|e| e.in_file(path))?;
        let text = parsed.clip.to_text();
        if text.as_bytes() == bytes {
            continue;
        }
        stale += 1;
        if a.check {
            out::line(&path.display().to_string())?;
        } else {
            input::rewrite(path, &bytes, &text)?;
        }
    }
    if a.check && stale > 0 {
        let message = format!("{stale} of {} clips are not formatted", a.files.len());
        return Err(Failure::with(Exit::Threshold, message));
    }
    Ok(())
}

/// Apply edits from a file. The operations are those of the studio.
///
/// OPS is one operation, an array of operations, or a batch. Either all of them are applied or
/// none. `robert clip ops` lists the operations with their arguments.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  echo '{\"op\": \"keys.hold\", \"args\": {\"frames\": [0], \"hold\": 20}}' > ops.json\n  robert clip apply wave.clip.json ops.json            print the edited clip\n  robert clip apply wave.clip.json ops.json -i         edit the file\n  robert clip apply wave.clip.json ops.json -i --json   print what changed and how to undo it\n  robert clip apply - ops.json < wave.clip.json        from stdin to stdout"
)]
pub(super) struct Apply {
    /// The clip; - reads stdin.
    clip: PathBuf,
    /// The operations as JSON; - reads stdin.
    ops: PathBuf,
    /// Write the edited clip back to its own file.
    #[arg(long, short, conflicts_with = "out")]
    in_place: bool,
    /// Write the edited clip to this file.
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Overwrite an existing file.
    #[arg(long)]
    force: bool,
    /// The robot whose mirror table is used [default: the clip's own].
    #[arg(long)]
    robot: Option<String>,
    /// Print what changed as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Applied {
    ops: usize,
    patch: Delta,
    undo: Op,
    first_changed_frame: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    clip: Option<serde_json::Value>,
}

pub(super) fn apply_ops(a: &Apply) -> Outcome {
    if input::is_standard(&a.clip) && input::is_standard(&a.ops) {
        return Err(Failure::usage("the clip and the operations cannot both come from stdin"));
    }
    let bytes = input::read(&a.clip, limits::CLIP_BYTES)?;
    let place = input::place(&a.clip);
    let clip = crate::clip::parse_bytes(bytes.clone()).map_err(|e| e.in_file(&place))?.clip;
    let ops = read_ops(&a.ops)?;
    let robot = super::files::robot_of(&clip, a.robot.as_deref())?;
    let table = robot.as_ref().map(ClipFacts::joint_table);
    let mut editor = Editor::new(clip.clone(), table).map_err(Failure::invalid)?;
    let before = editor.command().clone();
    for (i, op) in ops.iter().enumerate() {
        editor.apply(op).map_err(|e| {
            Failure::invalid(format!("{}: edit {i} ({}): {e}", a.ops.display(), op.name()))
        })?;
    }
    let out = if a.in_place { Some(a.clip.as_path()) } else { a.out.as_deref() };
    if a.in_place {
        input::rewrite(&a.clip, &bytes, &editor.clip().to_text())?;
    } else if out.is_some() || !a.json {
        super::files::deliver(editor.clip(), out, a.force)?;
    }
    if !a.json {
        return Ok(());
    }
    out::json(&Applied {
        ops: ops.len(),
        patch: Delta::between(&clip, editor.clip()),
        undo: Op::Patch(Box::new(Delta::between(editor.clip(), &clip))),
        first_changed_frame: editor.command().first_changed_frame(&before),
        clip: out.is_none().then(|| editor.clip().to_json()),
    })
}

fn read_ops(path: &Path) -> Result<Vec<Op>, Failure> {
    let bytes = input::read(path, limits::CLIP_BYTES)?;
    let start = bytes.iter().find(|b| !b.is_ascii_whitespace());
    let read = if start == Some(&b'[') {
        serde_json::from_slice::<Vec<Op>>(&bytes)
    } else {
        serde_json::from_slice::<Op>(&bytes).map(|op| vec![op])
    };
    read.map_err(|e| {
        // serde_json appends the place; our messages begin with it.
        let text = e.to_string();
        let what = text.rsplit_once(" at line ").map_or(text.as_str(), |(what, _)| what);
        let path = input::place(path);
        Failure::invalid(format!("{}:{}:{}: {what}", path.display(), e.line(), e.column()))
    })
}

/// Bring clips to the newest format version.
///
/// There is only one version so far, robert-clip/1. Its files are brought into canonical form, and
/// files of a newer version are refused.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  robert clip upgrade *.clip.json")]
pub(super) struct Upgrade {
    /// Clip files; - reads stdin and writes stdout.
    #[arg(required = true, value_name = "CLIP")]
    files: Vec<PathBuf>,
}

pub(super) fn upgrade(a: &Upgrade) -> Outcome {
    for path in &a.files {
        let old = input::read(path, limits::CLIP_BYTES)?;
        let place = input::place(path);
        let clip = crate::clip::parse_bytes(old.clone()).map_err(|e| e.in_file(&place))?.clip;
        if input::is_standard(path) {
            input::write_clip(path, &clip)?;
            continue;
        }
        let text = clip.to_text();
        let word = if text.as_bytes() == old { "is up to date" } else { "rewritten" };
        if word == "rewritten" {
            input::rewrite(path, &old, &text)?;
        }
        out::line(&format!("{}: {} {word}", path.display(), crate::clip::FORMAT))?;
    }
    Ok(())
}
