//! `robert clip info|diff`: commands that only read.

use std::path::PathBuf;

use serde::Serialize;

use super::super::failure::{Failure, Outcome};
use super::super::{input, out};
use crate::clip::{Blind, Clip, Delta, Fill, Foreign, Goal, Key, Op, Row, Sight, round};
use crate::exit::Exit;
use crate::fsio;

/// Print what a clip contains.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert clip info wave.clip.json\n  robert clip info --json wave.clip.json | jq .blind"
)]
pub(super) struct Info {
    /// The clip; - reads stdin.
    clip: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// The robot, for end-effector goals and joints that follow others [default: the clip's own, if it is built in].
    #[arg(long, value_name = "ID|DIR")]
    robot: Option<String>,
}

#[derive(Serialize)]
struct Facts {
    format: &'static str,
    name: String,
    robot: String,
    joints: usize,
    frames: u32,
    secs: f64,
    keys: usize,
    poses: usize,
    offsets: usize,
    masks: usize,
    markers: usize,
    fill: Fill,
    visible_frames: u32,
    partial_frames: u32,
    mask_ratio: f64,
    blind: Vec<Blind>,
    start: Vec<f64>,
    sha256: String,
}

pub(super) fn info(a: &Info) -> Outcome {
    let clip = super::files::load(&a.clip)?.clip;
    let command = super::files::compiled(&clip, a.robot.as_deref())?;
    let full = command.full_frames();
    let partial = (0..command.frames()).filter(|t| command.sight(*t) == Sight::Partial).count();
    let facts = Facts {
        format: crate::clip::FORMAT,
        name: clip.name.clone(),
        robot: clip.robot.id.clone(),
        joints: clip.dim(),
        frames: clip.length,
        secs: clip.secs(),
        keys: clip.keys.len(),
        poses: clip.poses.len(),
        offsets: clip.offsets.len(),
        masks: clip.masks.len(),
        markers: clip.markers.len(),
        fill: clip.fill,
        visible_frames: full,
        partial_frames: partial as u32,
        mask_ratio: 1.0 - f64::from(full + partial as u32) / f64::from(clip.length),
        blind: command.blind_spans(),
        start: command.start().iter().map(|v| round(f64::from(*v))).collect(),
        sha256: fsio::sha256_hex(clip.to_text().as_bytes()),
    };
    if a.json {
        return out::json(&facts);
    }
    let mut lines = Vec::new();
    let mut row = |what: &str, value: String| lines.push(format!("{what:<16}{value}"));
    if !facts.name.is_empty() {
        row("name", facts.name.clone());
    }
    row("robot", format!("{} ({} joints)", facts.robot, facts.joints));
    row("length", format!("{} frames, {:.2} s", facts.frames, facts.secs));
    row("keys", facts.keys.to_string());
    row("fill", facts.fill.word().to_owned());
    let some = if partial > 0 { format!(", {partial} of some joints") } else { String::new() };
    let masked = clip.length - full - partial as u32;
    let share = facts.mask_ratio * 100.0;
    row("commanded", format!("{full} frames of all joints{some}; {masked} masked ({share:.0} %)"));
    row("poses", names(clip.poses.keys()));
    row("offsets", facts.offsets.to_string());
    row("mask spans", facts.masks.to_string());
    row("markers", names(clip.markers.iter().map(|m| &m.name)));
    let steps: u32 = facts.blind.iter().map(|b| b.to - b.from).sum();
    row("blind", format!("{steps} steps in {} spans", facts.blind.len()));
    row("sha256", facts.sha256.clone());
    out::line(&lines.join("\n"))
}

fn names<'a>(names: impl Iterator<Item = &'a String>) -> String {
    let all: Vec<&str> = names.map(String::as_str).collect();
    if all.is_empty() { "none".to_owned() } else { all.join(", ") }
}

/// Print what changed between two clips, by keys, masks and frames.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert clip diff old.clip.json new.clip.json\n  robert clip diff --exit-code a.clip.json b.clip.json   exit 4 if they differ\n  robert clip diff --json a.clip.json b.clip.json > a_to_b.json\n  robert clip apply a.clip.json a_to_b.json               the result equals b"
)]
pub(super) struct Diff {
    /// The older clip; - reads stdin.
    old: PathBuf,
    /// The newer clip; - reads stdin.
    new: PathBuf,
    /// Print the difference as an edit in JSON, which `robert clip apply` accepts.
    #[arg(long)]
    json: bool,
    /// Exit with 4 if they differ.
    #[arg(long)]
    exit_code: bool,
    /// The robot, for end-effector goals and joints that follow others [default: the clip's own, if it is built in].
    #[arg(long, value_name = "ID|DIR")]
    robot: Option<String>,
}

pub(super) fn diff(a: &Diff) -> Outcome {
    if input::is_standard(&a.old) && input::is_standard(&a.new) {
        return Err(Failure::usage("both clips cannot come from stdin"));
    }
    let (old, new) = (super::files::load(&a.old)?.clip, super::files::load(&a.new)?.clip);
    let compiled = |clip| super::files::compiled(clip, a.robot.as_deref());
    let (was, is) = (compiled(&old)?, compiled(&new)?);
    let patch = Delta::between(&old, &new);
    let foreign = Foreign::between(&old, &new);
    let first = is.first_changed_frame(&was);
    let same = patch.is_empty() && foreign.robot.is_none() && foreign.x.is_none();
    if a.json {
        for (what, differs) in [("robot", foreign.robot.is_some()), ("x", foreign.x.is_some())] {
            if differs {
                tracing::warn!(
                    "{what} differs too; no edit can change it, so it is not in the patch"
                );
            }
        }
        out::json(&Op::Patch(Box::new(patch)))?;
    } else {
        for line in lines(&old, &new, &patch, &foreign) {
            out::line(&line)?;
        }
        match first {
            None if same => {}
            None => out::line("the commanded motion is the same")?,
            Some(f) => out::line(&format!("the commanded motion differs from frame {f} on"))?,
        }
    }
    if a.exit_code && !same {
        return Err(Failure::with(Exit::Threshold, "the clips differ"));
    }
    Ok(())
}

fn lines(old: &Clip, new: &Clip, patch: &Delta, foreign: &Foreign) -> Vec<String> {
    let mut lines = Vec::new();
    if let Some(robot) = &foreign.robot {
        lines.push(format!("robot: {} -> {}", old.robot.id, robot.id));
    }
    if let Some(name) = &patch.name {
        lines.push(format!("name: \"{}\" -> \"{name}\"", old.name));
    }
    if patch.notes.is_some() {
        lines.push("notes changed".to_owned());
    }
    if let Some(length) = patch.length {
        lines.push(format!("length: {} -> {length} frames", old.length));
    }
    if let Some(fill) = patch.fill {
        lines.push(format!("fill: {} -> {}", old.fill.word(), fill.word()));
    }
    if patch.start.is_some() {
        lines.push("start changed".to_owned());
    }
    for name in &patch.poses_removed {
        lines.push(format!("- pose {name}"));
    }
    for (name, row) in &patch.poses_put {
        lines.push(match old.poses.get(name) {
            None => format!("+ pose {name}"),
            Some(was) => format!("~ pose {name}: {}", moved(old, was, row)),
        });
    }
    for frame in &patch.keys_removed {
        lines.push(format!("- key {frame}"));
    }
    for key in &patch.keys_put {
        lines.push(match old.key(key.frame) {
            None => format!("+ key {}", key.frame),
            Some(was) => format!("~ key {}: {}", key.frame, changes(old, was, new, key)),
        });
    }
    if let Some(offsets) = &patch.offsets {
        lines.push(format!("offsets: {} -> {}", old.offsets.len(), offsets.len()));
    }
    if let Some(masks) = &patch.masks {
        lines.push(format!("mask spans: {} -> {}", old.masks.len(), masks.len()));
    }
    if let Some(markers) = &patch.markers {
        lines.push(format!("markers: {} -> {}", old.markers.len(), markers.len()));
    }
    if foreign.x.is_some() {
        lines.push("extensions (x) changed".to_owned());
    }
    lines
}

fn changes(old: &Clip, was: &Key, new: &Clip, is: &Key) -> String {
    let mut words = Vec::new();
    if was.goal != is.goal {
        words.push(match (&was.goal, &is.goal) {
            (Goal::Pose(a), Goal::Pose(b)) => format!("pose {a} -> {b}"),
            _ => match (old.row(was), new.row(is)) {
                (Some(a), Some(b)) => moved(old, a, b),
                _ => "values".to_owned(),
            },
        });
    }
    if was.reach != is.reach {
        words.push("end-effector goals".to_owned());
    }
    if was.hold != is.hold {
        words.push(format!("hold {} -> {}", was.hold, is.hold));
    }
    if was.fill != is.fill {
        let word = |f: Option<Fill>| f.map_or("default", Fill::word);
        words.push(format!("fill {} -> {}", word(was.fill), word(is.fill)));
    }
    if was.tangents != is.tangents {
        words.push("tangents".to_owned());
    }
    if was.note != is.note {
        words.push("note".to_owned());
    }
    words.join(", ")
}

/// The joint that moved most.
fn moved(clip: &Clip, was: &Row, is: &Row) -> String {
    let far = |(a, b): (&Option<f64>, &Option<f64>)| match (a, b) {
        (Some(a), Some(b)) => (b - a).abs(),
        (None, None) => 0.0,
        _ => f64::INFINITY,
    };
    let changed = was.iter().zip(is).filter(|(a, b)| a != b).count();
    let most = was.iter().zip(is).map(far).enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
    let Some((j, _)) = most.filter(|m| m.1 > 0.0) else { return "same values".to_owned() };
    let text = |row: &Row| match row.get(j).copied().flatten() {
        Some(v) => v.to_string(),
        None => "open".to_owned(),
    };
    let name = clip.robot.joints.get(j).map_or("", String::as_str);
    let more = if changed > 1 { format!(" and {} more", changed - 1) } else { String::new() };
    format!("{name} {} -> {}{more}", text(was), text(is))
}
