//! `robert clip check`: finds mistakes in clips, with their place and their fixes.

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::super::bar::Bar;
use super::super::failure::{Failure, Outcome};
use super::super::global::{Global, cores};
use super::super::interrupt::cancel_on_ctrl_c;
use super::super::{input, out};
use super::fix::{Finder, Fixed};
use super::simulate::Simulation;
use crate::clip::{Clip, Granularity, Level, Lint, Parsed, Rule, compile_for};
use crate::exit::Exit;
use crate::limits;
use crate::progress::Cancel;
use crate::robot::Robot;

/// Check clips for mistakes in format, limits, speeds, blind spans and coupled joints.
///
/// An error means that the clip cannot be performed; a warning means that the motion will differ
/// from the clip. The exit code is 4 if errors remain (with --strict also if warnings remain), and
/// 3 if a file is not a clip.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert clip check wave.clip.json\n  robert clip check --simulate fist.clip.json    also settles every pose in simulation\n  robert clip check --fix --strict *.clip.json   fix what can be fixed, then fail on warnings\n  robert clip check --json wave.clip.json | jq '.files[].lints[].rule'"
)]
#[allow(clippy::struct_excessive_bools)] // switches of a command line
pub(super) struct Check {
    /// Clip files; - reads stdin, and with --fix writes the fixed clip to stdout.
    #[arg(required = true, value_name = "CLIP")]
    files: Vec<PathBuf>,
    /// Check against this robot [default: the clip's own].
    #[arg(long)]
    robot: Option<String>,
    /// Assume a policy that was trained on whole frames, such as the published network; goals for
    /// some joints are then an error.
    #[arg(long)]
    whole_masks: bool,
    /// Also settle every pose in simulation, to find self-collisions and unreachable poses.
    #[arg(long)]
    simulate: bool,
    /// Apply the first fix of each finding, write the file, and report what changed. A fix may make
    /// the clip longer or remove goals; the report says so.
    #[arg(long)]
    fix: bool,
    /// List every finding, instead of one line for many of the same kind.
    #[arg(long)]
    all: bool,
    /// Treat warnings as errors.
    #[arg(long)]
    strict: bool,
    /// Print JSON with all findings and their fixes.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Report {
    files: Vec<FileReport>,
    /// Files that are not clips; each counts as an error.
    unreadable: Vec<Unreadable>,
    errors: usize,
    warnings: usize,
}

#[derive(Serialize)]
struct Unreadable {
    path: PathBuf,
    error: String,
}

#[derive(Serialize)]
struct FileReport {
    path: PathBuf,
    robot: String,
    robot_known: bool,
    /// The number of fixes that were applied.
    mended: usize,
    /// The applied fixes and what they changed; with `--fix` only.
    #[serde(skip_serializing_if = "Option::is_none")]
    fixed: Option<Fixed>,
    lints: Vec<PlacedLint>,
    /// The fixed clip, where it came from stdin.
    #[serde(skip)]
    clip: Option<Clip>,
}

#[derive(Serialize)]
struct PlacedLint {
    line: usize,
    col: usize,
    #[serde(flatten)]
    lint: Lint,
}

pub(super) fn run(a: &Check, global: Global) -> Outcome {
    let mut report = Report { files: Vec::new(), unreadable: Vec::new(), errors: 0, warnings: 0 };
    let mut invalid: Option<Failure> = None;
    let cancel = cancel_on_ctrl_c();
    let bar = Bar::new("settle", "poses", global.quiet);
    for path in &a.files {
        match file(a, path, &bar, &cancel) {
            Ok(one) => {
                let count = |level| one.lints.iter().filter(|l| l.lint.level == level).count();
                report.errors += count(Level::Error);
                // What could not be checked counts, too.
                report.warnings += count(Level::Warning) + usize::from(!one.robot_known);
                deliver(a, &one)?;
                report.files.push(one);
            }
            // The other files are still checked; the last broken one decides the exit code.
            Err(failure) if failure.exit() == Exit::Interrupted => {
                bar.finish();
                return Err(failure);
            }
            Err(failure) => {
                report.errors += 1;
                let error = failure.sentence();
                report.unreadable.push(Unreadable { path: path.clone(), error });
                if let Some(earlier) = invalid.replace(failure) {
                    earlier.report();
                }
            }
        }
    }
    bar.finish();
    if a.json {
        out::json(&report)?;
    }
    if let Some(failure) = invalid {
        return Err(failure);
    }
    let counted = report.errors + if a.strict { report.warnings } else { 0 };
    if counted > 0 {
        let found = [(report.errors, "error"), (report.warnings, "warning")];
        let words: Vec<String> = found
            .iter()
            .filter(|(n, _)| *n > 0)
            .map(|(n, what)| format!("{n} {what}{}", if *n == 1 { "" } else { "s" }))
            .collect();
        return Err(Failure::with(Exit::Threshold, words.join(", ")));
    }
    Ok(())
}

/// Prints the findings. If the clip came from stdin, it goes to stdout and the findings to stderr.
fn deliver(a: &Check, report: &FileReport) -> Outcome {
    let lines = lines(report, a.all);
    match &report.clip {
        Some(clip) if !a.json => {
            lines.iter().for_each(out::aside);
            out::line(clip.to_text().trim_end())
        }
        _ if a.json => Ok(()),
        _ => lines.iter().try_for_each(|line| out::line(line)),
    }
}

fn file(a: &Check, path: &Path, bar: &Bar, cancel: &Cancel) -> Result<FileReport, Failure> {
    let bytes = input::read(path, limits::CLIP_BYTES)?;
    let place = input::place(path);
    if a.fix && input::is_pipe(path) {
        let message = format!(
            "{}: a pipe cannot be written to; --fix takes a file, or - to write the fixed clip to stdout",
            place.display()
        );
        return Err(Failure::usage(message));
    }
    let mut parsed = crate::clip::parse_bytes(bytes.clone()).map_err(|e| e.in_file(&place))?;
    let robot = super::files::robot_of(&parsed.clip, a.robot.as_deref())?;
    let mut table = super::files::joint_table(&parsed.clip, robot.as_ref());
    if a.whole_masks {
        table.granularity = Granularity::State;
    }
    let threads = cores();
    let asked = robot.as_ref().filter(|_| a.simulate);
    let simulation = asked.map(|robot| Simulation::new(robot, threads, bar, cancel));
    let mut finder = Finder::new(&table, simulation, bar, cancel);
    let placed = |e: Failure| match compile_for(&parsed.clip, Some(&table)) {
        Err(broken) => parsed.broken(broken).in_file(&place).into(),
        Ok(_) => e.about(&place),
    };
    let mut lints = finder.find(&parsed.clip).map_err(placed)?;
    let mut fixed = None;
    if a.fix {
        let (clip, left, done) = finder.fix(&parsed.clip, lints)?;
        lints = left;
        if input::is_standard(path) {
            parsed = Parsed::of(&clip);
        } else if done.count() > 0 {
            input::rewrite(path, &bytes, &clip.to_text())?;
            parsed = Parsed::of(&clip);
        }
        fixed = Some(done);
    }
    let places = parsed.places(lints.iter().map(|lint| lint.pointer.as_str()));
    let placed = lints.into_iter().zip(places);
    let placed = placed.map(|(lint, (line, col))| PlacedLint { line, col, lint });
    Ok(FileReport {
        path: path.to_owned(),
        robot: table.robot.clone(),
        robot_known: robot.is_some(),
        mended: fixed.as_ref().map_or(0, Fixed::count),
        fixed,
        lints: placed.collect(),
        clip: (a.fix && input::is_standard(path)).then_some(parsed.clip),
    })
}

/// From this number on, findings of one rule are summed up in one line.
const GROUP: usize = 4;

/// The lines to print about a file.
fn lines(report: &FileReport, all: bool) -> Vec<String> {
    let place = input::place(&report.path);
    let path = place.display();
    let mut lines = Vec::new();
    if let Some(fixed) = report.fixed.as_ref().filter(|f| f.count() > 0 || f.kept > 0) {
        let said = fixed.lines().into_iter().enumerate();
        lines.extend(said.map(|(i, l)| if i == 0 { format!("{path}: {l}") } else { l }));
    }
    if !report.robot_known {
        let why = Robot::load(&report.robot).err().map(|e| format!(": {e}")).unwrap_or_default();
        lines.push(format!("{path}: warning: limits and speeds were not checked{why}"));
    }
    let mut said: Vec<(Level, Rule)> = Vec::new();
    for placed in &report.lints {
        let PlacedLint { line, col, lint } = placed;
        let kind = (lint.level, lint.rule);
        let like = || report.lints.iter().filter(|p| (p.lint.level, p.lint.rule) == kind);
        let count = like().count();
        if !all && count >= GROUP {
            if said.contains(&kind) {
                continue;
            }
            said.push(kind);
        }
        let (level, rule) = (word(&lint.level), word(&lint.rule));
        let more = match count {
            n if all || n < GROUP => String::new(),
            n => format!("; {} more of this kind, at {} (--all lists them)", n - 1, frames(like())),
        };
        lines.push(format!("{path}:{line}:{col}: {level}[{rule}]: {}{more}", lint.message));
        lines.extend(lint.fixes.iter().map(|fix| format!("    fix: {}", fix.title)));
        if lint.rule == Rule::OtherRobot {
            let robot = &report.robot;
            lines.push(format!(
                "    fix: robert clip convert {path} NEW.clip.json --robot {robot}   (if the joints have the same names)"
            ));
        }
    }
    if report.lints.is_empty() {
        lines.push(format!("{path}: ok"));
    }
    lines
}

/// The place of findings: their first and last frame.
fn frames<'a>(lints: impl Iterator<Item = &'a PlacedLint>) -> String {
    let at: Vec<u32> = lints.filter_map(|p| Some(p.lint.frames?[0])).collect();
    match (at.iter().min(), at.iter().max()) {
        (Some(first), Some(last)) if first != last => format!("frames {first} to {last}"),
        (Some(only), _) => format!("frame {only}"),
        _ => "the clip as a whole".to_owned(),
    }
}

/// The word that the JSON output uses.
fn word(value: &impl Serialize) -> String {
    match serde_json::to_value(value) {
        Ok(serde_json::Value::String(word)) => word,
        _ => String::new(),
    }
}
