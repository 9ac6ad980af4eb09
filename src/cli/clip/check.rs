//! `robert clip check`: what is wrong with a clip, where, and how to fix it.

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::super::failure::{Failure, Outcome};
use super::super::out;
use crate::clip::{
    Clip, Granularity, JointTable, Level, Lint, Parsed, PoseChecker, Rule, compile, edited, lint,
};
use crate::exit::Exit;
use crate::robot::{Robot, Settler};

/// How many fixes `--fix` tries: each removes a finding, some uncover another.
const FIXES: usize = 1000;

/// Check clips: format, limits, speeds, blind spans, coupled joints.
///
/// Findings have a level: an error cannot be performed, a warning will not go as drawn.
/// Exit code 4 when errors remain (with --strict, warnings too), 3 when a file is no clip.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert clip check wave.clip.json\n  robert clip check --simulate fist.clip.json    also settles every pose in simulation\n  robert clip check --fix --strict *.clip.json   fix what can be fixed, then fail on warnings\n  robert clip check --json wave.clip.json | jq '.files[].lints[].rule'"
)]
#[allow(clippy::struct_excessive_bools)] // switches of a command line
pub(super) struct Check {
    /// Clips; - reads stdin.
    #[arg(required = true, value_name = "CLIP")]
    files: Vec<PathBuf>,
    /// Check for this robot; the clip's own when absent.
    #[arg(long)]
    robot: Option<String>,
    /// The policy understands goals for single joints.
    #[arg(long)]
    joint_masks: bool,
    /// Settle every pose in simulation: self-collision, poses out of reach.
    #[arg(long)]
    simulate: bool,
    /// Apply the first fix of each finding and write the file.
    #[arg(long)]
    fix: bool,
    /// Warnings count like errors.
    #[arg(long)]
    strict: bool,
    /// One JSON document with all findings and their fixes.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Report {
    files: Vec<FileReport>,
    /// Files that are no clip; each counts as an error.
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
    // Scripts know the old name.
    #[serde(rename = "mended")]
    fixed: usize,
    lints: Vec<PlacedLint>,
}

#[derive(Serialize)]
struct PlacedLint {
    line: usize,
    col: usize,
    #[serde(flatten)]
    lint: Lint,
}

pub(super) fn run(a: &Check) -> Outcome {
    let mut report = Report { files: Vec::new(), unreadable: Vec::new(), errors: 0, warnings: 0 };
    let mut invalid: Option<Failure> = None;
    for path in &a.files {
        match file(a, path) {
            Ok(one) => {
                let count = |level| one.lints.iter().filter(|l| l.lint.level == level).count();
                report.errors += count(Level::Error);
                report.warnings += count(Level::Warning);
                if !a.json {
                    print(&one)?;
                }
                report.files.push(one);
            }
            // The other files are still checked; the last broken one decides the exit code.
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

fn file(a: &Check, path: &Path) -> Result<FileReport, Failure> {
    let mut parsed = super::files::load(path)?;
    let robot = super::files::robot_of(&parsed.clip, a.robot.as_deref())?;
    let mut table = super::files::joint_table(&parsed.clip, robot.as_ref());
    if a.joint_masks {
        table.granularity = Granularity::Joint;
    }
    let mut lints = find(a, &parsed.clip, &table, robot.as_ref())?;
    let mut fixed = 0;
    if a.fix {
        let mut clip = parsed.clip.clone();
        while fixed < FIXES {
            let Some(next) = fix(a, &clip, &lints, &table, robot.as_ref())? else { break };
            (clip, lints) = next;
            fixed += 1;
        }
        if fixed > 0 {
            clip.save(path)?;
            parsed = Parsed::of(&clip);
        }
    }
    let placed = lints.into_iter().map(|lint| {
        let (line, col) = parsed.line_col(&lint.pointer);
        PlacedLint { line, col, lint }
    });
    Ok(FileReport {
        path: path.to_owned(),
        robot: table.robot.clone(),
        robot_known: robot.is_some(),
        fixed,
        lints: placed.collect(),
    })
}

fn find(
    a: &Check,
    clip: &Clip,
    table: &JointTable,
    robot: Option<&Robot>,
) -> Result<Vec<Lint>, Failure> {
    let command = compile(clip).map_err(Failure::invalid)?;
    let mut settler = match robot {
        Some(robot) if a.simulate => Some(Settler::new(robot)?),
        _ => None,
    };
    let checker = settler.as_mut().map(|s| s as &mut dyn PoseChecker);
    Ok(lint(clip, &command, table, checker))
}

/// The clip after the first fix that leaves less to complain about.
fn fix(
    a: &Check,
    clip: &Clip,
    lints: &[Lint],
    table: &JointTable,
    robot: Option<&Robot>,
) -> Result<Option<(Clip, Vec<Lint>)>, Failure> {
    // Too fast weighs more than blind: stretching time may open a blind span, which then
    // gets keys; the other way round two fixes would undo each other for ever.
    let weight = |lints: &[Lint]| {
        let count = |is: &dyn Fn(&Lint) -> bool| lints.iter().filter(|l| is(l)).count();
        (
            count(&|l| l.level == Level::Error),
            count(&|l| l.rule == Rule::JointSpeed),
            count(&|l| l.level == Level::Warning),
        )
    };
    let bad = lints.iter().filter(|l| l.level > Level::Info);
    for fix in bad.flat_map(|l| &l.fixes) {
        let Ok(next) = edited(clip, &fix.op, Some(table)) else { continue };
        let found = find(a, &next, table, robot)?;
        if weight(&found) < weight(lints) {
            return Ok(Some((next, found)));
        }
    }
    Ok(None)
}

fn print(report: &FileReport) -> Outcome {
    let path = report.path.display();
    if report.fixed > 0 {
        out::line(&format!("{path}: fixed {}", report.fixed))?;
    }
    if !report.robot_known {
        let robot = &report.robot;
        out::line(&format!(
            "{path}: robot {robot} is not known here: limits and speeds are not checked"
        ))?;
    }
    for placed in &report.lints {
        let PlacedLint { line, col, lint } = placed;
        let (level, rule) = (word(&lint.level), word(&lint.rule));
        out::line(&format!("{path}:{line}:{col}: {level}[{rule}]: {}", lint.message))?;
        for fix in &lint.fixes {
            out::line(&format!("    fix: {}", fix.title))?;
        }
        if lint.rule == Rule::OtherRobot {
            let robot = &report.robot;
            out::line(&format!(
                "    fix: robert clip convert {path} NEW.clip.json --robot {robot}   (where the joints have the same names)"
            ))?;
        }
    }
    if report.lints.is_empty() {
        out::line(&format!("{path}: ok"))?;
    }
    Ok(())
}

/// The word that JSON has for it.
fn word(value: &impl Serialize) -> String {
    match serde_json::to_value(value) {
        Ok(serde_json::Value::String(word)) => word,
        _ => String::new(),
    }
}
