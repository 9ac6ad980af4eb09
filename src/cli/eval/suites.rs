//! The suites that an evaluation is asked for: shipped ones, files, folders, and recorded motion.

use std::path::Path;
use std::sync::Arc;

use super::args::Args;
use crate::cli::failure::{Failure, Outcome};
use crate::cli::input;
use crate::cli::motion::{self, CLIP_SUFFIX};
use crate::clip::Clip;
use crate::dataset::{Dataset, Verify};
use crate::fsio;
use crate::robot::Robot;
use crate::rollout::{self, Case, Start, Suite, tasks, test_suites};

/// The name of the suite of single files and tasks.
const FILES: &str = "files";

/// Clips with their names.
type Clips = Vec<(String, Clip)>;

/// The source of a suite's tasks.
enum Source {
    Shipped,
    Trial,
    Clips(Clips),
    Data,
}

/// The robot and its suites, every clip compiled.
pub(super) fn suites(args: &Args) -> Outcome<(Arc<Robot>, Vec<Suite>)> {
    let mut files: Clips = Vec::new();
    let mut named: Vec<(String, Source)> = Vec::new();
    for text in &args.suite {
        let path = Path::new(text);
        if path.is_dir() {
            named.push((text.trim_end_matches('/').to_owned(), Source::Clips(folder(path)?)));
        } else if input::exists(path) || path.extension().is_some_and(|e| e == "json") {
            let clip = motion::clip(text, None)?;
            // Stdin and pipes have no name of their own.
            let is_unnamed = input::is_standard(path) || input::is_pipe(path);
            let name =
                if is_unnamed && !clip.name.is_empty() { clip.name.clone() } else { stem(path) };
            files.push((name, clip));
        } else if text == "trial" {
            named.push((text.clone(), Source::Trial));
        } else if text == "test" {
            named.push((text.clone(), Source::Data));
        } else if let Some(clip) = task(text, args.robot.as_deref())? {
            files.push(clip);
        } else {
            let name = match tasks::expand(text)[..] {
                [one] => one,
                _ => text,
            };
            named.push((name.to_owned(), Source::Shipped));
        }
    }
    if !files.is_empty() {
        named.push((FILES.to_owned(), Source::Clips(files)));
    }
    let of_clips = named.iter().find_map(|(_, s)| match s {
        Source::Clips(clips) => clips.first().map(|(_, c)| c.robot.id.clone()),
        Source::Shipped | Source::Trial | Source::Data => None,
    });
    let robot = match (&args.robot, of_clips) {
        (Some(id), _) => motion::robot(id)?,
        (None, Some(own)) => motion::robot_for(None, &own)?,
        (None, None) => {
            return Err(Failure::usage(
                "a built-in suite needs a robot: --robot pointmass, ur5e, ur5e_light or shadow_hand",
            ));
        }
    };
    for (i, (name, source)) in named.iter().enumerate() {
        one_robot(name, source, robot.id())?;
        if named.iter().take(i).any(|(other, _)| other == name) {
            return Err(Failure::usage(format!("the suite {name} is listed twice")));
        }
    }
    let mut suites = Vec::new();
    for (name, source) in named {
        let clips = match source {
            Source::Clips(clips) => clips,
            Source::Shipped => tasks::suite(robot.id(), &name)?,
            Source::Trial => {
                let trial = tasks::trial(&robot, args.data_seed)?;
                trial.into_iter().map(|t| (t.name.to_owned(), t.clip)).collect()
            }
            Source::Data => {
                suites.extend(cut_suites(args, &robot)?);
                continue;
            }
        };
        let cases = clips.into_iter().map(|c| case(&robot, c)).collect::<Outcome<Vec<_>>>()?;
        suites.push(Suite { name, cases });
    }
    Ok((robot, suites))
}

/// A built-in task by its name, `NAME` or `ROBOT/NAME`; `None` if it is the name of a suite, or of
/// nothing.
fn task(name: &str, robot: Option<&str>) -> Outcome<Option<(String, Clip)>> {
    if tasks::expand(name).iter().any(|suite| tasks::SUITES.contains(suite)) {
        return Ok(None);
    }
    let short = name.rsplit('/').next().unwrap_or(name);
    match motion::clip(name, robot) {
        Ok(clip) => Ok(Some((short.to_owned(), clip))),
        // A task was meant: it names a robot, or several robots have one of this name, or there is
        // no robot of which it could be a suite.
        Err(e) if short != name || robot.is_none() || e.sentence().contains("ROBOT/NAME") => Err(e),
        Err(_) => Ok(None),
    }
}

/// Refuses clips that were made for different robots, which cannot share a table.
fn one_robot(name: &str, source: &Source, robot: &str) -> Outcome {
    let Source::Clips(clips) = source else { return Ok(()) };
    let of = |(_, clip): &(String, Clip)| clip.robot.id.clone();
    let mut robots: Vec<String> = clips.iter().map(of).collect();
    robots.sort();
    robots.dedup();
    match (&robots[..], clips.iter().find(|c| of(c) != robot)) {
        ([_, _, ..], Some(other)) => Err(Failure::invalid(format!(
            "{} for {}, such as {} for {}: evaluate those of each robot alone",
            if name == FILES { "the clips are".to_owned() } else { format!("{name} has clips") },
            robots.join(", "),
            other.0,
            other.1.robot.id
        ))),
        _ => Ok(()),
    }
}

/// The three suites extracted from a dataset.
fn cut_suites(args: &Args, robot: &Robot) -> Outcome<Vec<Suite>> {
    let Some(path) = &args.data else {
        return Err(Failure::usage("the suite test needs recorded motion: give --data DIR"));
    };
    let data = Dataset::open(path, Verify::Structure)?;
    let count = args.cases.map_or_else(|| rollout::extracted_cases(robot.id()), usize::from);
    Ok(test_suites(robot, &data, count, args.data_seed)?)
}

/// The clips of a folder, by name.
fn folder(dir: &Path) -> Outcome<Clips> {
    let unreadable = |source| fsio::Error::Read { source, path: dir.to_owned() };
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(dir).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if path.to_string_lossy().ends_with(CLIP_SUFFIX) {
            paths.push(path);
        }
    }
    paths.sort();
    if paths.is_empty() {
        return Err(Failure::invalid(format!(
            "there is no file *{CLIP_SUFFIX} in {}",
            dir.display()
        )));
    }
    paths.iter().map(|p| Ok((stem(p), Clip::load(p)?))).collect()
}

/// The file name without its suffix.
fn stem(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.strip_suffix(CLIP_SUFFIX).unwrap_or(&name).to_owned()
}

fn case(robot: &Robot, (name, clip): (String, Clip)) -> Outcome<Case> {
    let command = motion::command(&clip, robot, &name)?;
    Ok(Case { name, command, start: Start::Pose, truth: None, floor: None })
}
