//! The task clips in the program: what policies are compared on.
//!
//! They are files (`assets/clips/ROBOT/NAME.clip.json`), since people open, copy and edit
//! them. Those of three suites are written by formulas ([`author`]), since a circle of 200
//! typed rows cannot be reviewed, and a test compares the two: `manual` is what headline
//! figures are about (the tasks of the paper and their kind), `extra` holds harder and
//! sparser variants, `validation` other motions.
//!
//! The others were typed, as a person types them: poses in round degrees, nothing settled in
//! simulation and nothing fixed afterwards. `drawn` holds poses, sequences and medleys, `fast`
//! what is quick, `touch` what presses against something. Each of them has a second half,
//! `drawn-final` and so on, together `final`: measured once a model is frozen, never looked at
//! while anything is trained, tuned or chosen.

mod author;
mod hand;
mod pointmass;
mod trial;
mod ur5e;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

pub use author::Authored;
pub use trial::trial;

use crate::clip::{Clip, ClipError};
use crate::exit::{Exit, HasExit};
use crate::robot::{self, Robot};

#[derive(rust_embed::RustEmbed)]
#[folder = "assets/clips/"]
struct Files;

/// Suites in the order of lists.
pub const SUITES: [&str; 9] = [
    "manual",
    "extra",
    "validation",
    "drawn",
    "fast",
    "touch",
    "drawn-final",
    "fast-final",
    "touch-final",
];

/// Suites whose clips are written by formulas; those of the others were typed.
pub const AUTHORED: [&str; 3] = ["manual", "extra", "validation"];

/// Names of several suites together, and names that a suite had before.
const ALIASES: [(&str, &[&str]); 2] = [
    ("final", &["drawn-final", "fast-final", "touch-final"]),
    // Its figures have been looked at and have decided things since it was called this.
    ("heldout", &["validation"]),
];

/// The suites that a name stands for: itself, unless it is one of the other names.
pub fn expand(name: &str) -> Vec<&str> {
    match ALIASES.iter().find(|(alias, _)| *alias == name) {
        Some((_, suites)) => suites.to_vec(),
        None => vec![name],
    }
}

/// Name of the list of suites beside the clips.
pub const MANIFEST: &str = "suites.toml";

/// Every task of a robot, in the order of tables; none for a robot without tasks.
///
/// # Errors
/// Hand poses are settled in simulation first, which may fail.
pub fn author(robot: &Robot) -> Result<Vec<Authored>, robot::Error> {
    match robot.id() {
        "pointmass" => Ok(pointmass::tasks(robot)),
        "ur5e" => Ok(ur5e::tasks(robot)),
        "shadow_hand" => hand::tasks(robot),
        _ => Ok(Vec::new()),
    }
}

/// A task that is not there, or not readable.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TaskError {
    /// No such task.
    #[error("there is no task {name:?}{hint}; robert tasks ls lists them")]
    UnknownTask {
        /// What was asked for.
        name: String,
        /// A close name, or the robots that share the name.
        hint: String,
    },
    /// No such suite.
    #[error("there is no suite {name:?}; use {known}, or clip files")]
    UnknownSuite {
        /// What was asked for.
        name: String,
        /// What there is.
        known: String,
    },
    /// A robot without tasks of its own.
    #[error("robot {robot} has no built-in tasks; {known} have some; name clip files")]
    NoTasks {
        /// The robot.
        robot: String,
        /// Robots that have tasks.
        known: String,
    },
    /// The embedded files are damaged.
    #[error("assets/clips/{path}: {message}")]
    Damaged {
        /// What is wrong.
        message: String,
        /// The file inside the folder.
        path: String,
    },
    /// An embedded clip does not read.
    #[error(transparent)]
    Clip(#[from] ClipError),
}

impl HasExit for TaskError {
    fn exit(&self) -> Exit {
        match self {
            TaskError::UnknownTask { .. }
            | TaskError::UnknownSuite { .. }
            | TaskError::NoTasks { .. } => Exit::Usage,
            TaskError::Damaged { .. } => Exit::Failed,
            TaskError::Clip(e) => e.exit(),
        }
    }
}

/// The tasks of one robot.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct RobotTasks {
    /// Another robot with the same joints, whose clips are taken.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub like: Option<String>,
    /// Headline tasks.
    pub manual: Vec<String>,
    /// Harder and sparser variants.
    pub extra: Vec<String>,
    /// Other motions. They decided things, hence the name.
    pub validation: Vec<String>,
    /// Poses and sequences as a person types them.
    pub drawn: Vec<String>,
    /// Quick motions.
    pub fast: Vec<String>,
    /// Poses that touch: the robot itself, its stops, the bounds of its motors.
    pub touch: Vec<String>,
    /// The half of [`RobotTasks::drawn`] that nothing is chosen on.
    pub drawn_final: Vec<String>,
    /// The half of [`RobotTasks::fast`] that nothing is chosen on.
    pub fast_final: Vec<String>,
    /// The half of [`RobotTasks::touch`] that nothing is chosen on.
    pub touch_final: Vec<String>,
}

impl RobotTasks {
    /// Names in a suite.
    pub fn suite(&self, name: &str) -> Option<&[String]> {
        match name {
            "manual" => Some(&self.manual),
            "extra" => Some(&self.extra),
            "validation" => Some(&self.validation),
            "drawn" => Some(&self.drawn),
            "fast" => Some(&self.fast),
            "touch" => Some(&self.touch),
            "drawn-final" => Some(&self.drawn_final),
            "fast-final" => Some(&self.fast_final),
            "touch-final" => Some(&self.touch_final),
            _ => None,
        }
    }
}

/// Suites by robot.
///
/// # Errors
/// [`TaskError::Damaged`].
pub fn manifest() -> Result<BTreeMap<String, RobotTasks>, TaskError> {
    toml::from_str(&text(MANIFEST)?).map_err(|e| damaged(MANIFEST, &e.to_string()))
}

/// The clips of a robot's suite, or of all that the name stands for, with their names, in the
/// order of tables.
///
/// # Errors
/// [`TaskError::NoTasks`], [`TaskError::UnknownSuite`].
pub fn suite(robot: &str, suite: &str) -> Result<Vec<(String, Clip)>, TaskError> {
    let manifest = manifest()?;
    let (folder, tasks) = of(&manifest, robot)?;
    let mut clips = Vec::new();
    for name in expand(suite) {
        let names = tasks.suite(name).ok_or_else(|| TaskError::UnknownSuite {
            name: name.to_owned(),
            known: format!("{}, final", SUITES.join(", ")),
        })?;
        for name in names {
            clips.push((name.clone(), read(folder, name)?));
        }
    }
    Ok(clips)
}

/// A task by its name, `NAME` or `ROBOT/NAME`.
///
/// # Errors
/// [`TaskError::UnknownTask`] also where several robots have one of this name and none is
/// given.
pub fn find(name: &str, robot: Option<&str>) -> Result<Clip, TaskError> {
    let manifest = manifest()?;
    let (robot, short) = match name.split_once('/') {
        Some((robot, short)) => (Some(robot), short),
        None => (robot, name),
    };
    let mut folders: Vec<&str> = Vec::new();
    let mut near: Option<(f64, String)> = None;
    for id in manifest.keys().filter(|id| robot.is_none_or(|r| r == *id)) {
        let (folder, tasks) = of(&manifest, id)?;
        for task in SUITES.iter().filter_map(|s| tasks.suite(s)).flatten() {
            let score = strsim::jaro_winkler(task, short);
            if task == short && !folders.contains(&folder) {
                folders.push(folder);
            } else if score > near.as_ref().map_or(0.8, |n| n.0) {
                near = Some((score, format!("{folder}/{task}")));
            }
        }
    }
    let unknown = |hint| TaskError::UnknownTask { name: name.to_owned(), hint };
    match folders.as_slice() {
        [folder] => read(folder, short),
        [] => {
            let of_others = manifest.iter().filter(|(id, tasks)| {
                Some(id.as_str()) != robot
                    && SUITES.iter().filter_map(|s| tasks.suite(s)).flatten().any(|t| t == short)
            });
            let others: Vec<&str> = of_others.map(|(id, _)| id.as_str()).collect();
            Err(unknown(match (robot, others.is_empty(), near) {
                (Some(robot), false, _) => {
                    format!(" for {robot} (it is one of {})", others.join(" and "))
                }
                (_, _, Some(near)) => format!(" (did you mean {}?)", near.1),
                _ => String::new(),
            }))
        }
        many => Err(unknown(format!(" of one robot only (write ROBOT/NAME: {})", many.join(", ")))),
    }
}

/// The embedded text of a task, as it stands in the file.
///
/// # Errors
/// [`TaskError::Damaged`] where there is no such file.
pub fn task_text(folder: &str, name: &str) -> Result<String, TaskError> {
    text(&path_of(folder, name))
}

/// Where a task's file stands in the folder of clips.
pub fn path_of(folder: &str, name: &str) -> String {
    format!("{folder}/{name}.clip.json")
}

/// A robot's tasks and the folder that holds them.
///
/// # Errors
/// [`TaskError::NoTasks`].
pub fn of<'a>(
    manifest: &'a BTreeMap<String, RobotTasks>,
    robot: &'a str,
) -> Result<(&'a str, &'a RobotTasks), TaskError> {
    let none = || TaskError::NoTasks {
        robot: robot.to_owned(),
        known: manifest.keys().cloned().collect::<Vec<_>>().join(", "),
    };
    let tasks = manifest.get(robot).ok_or_else(none)?;
    match &tasks.like {
        None => Ok((robot, tasks)),
        Some(like) => Ok((like, manifest.get(like).ok_or_else(none)?)),
    }
}

fn read(folder: &str, name: &str) -> Result<Clip, TaskError> {
    Ok(Clip::parse(&task_text(folder, name)?)?)
}

fn text(path: &str) -> Result<String, TaskError> {
    let file = Files::get(path).ok_or_else(|| damaged(path, "it is missing"))?;
    String::from_utf8(file.data.into_owned()).map_err(|e| damaged(path, &e.to_string()))
}

fn damaged(path: &str, message: &str) -> TaskError {
    TaskError::Damaged { message: message.to_owned(), path: path.to_owned() }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::clip::{Level, Rule, compile, lint};
    use crate::robot::Robot;

    fn folders() -> impl Iterator<Item = String> {
        manifest().unwrap().into_iter().filter(|(_, t)| t.like.is_none()).map(|(id, _)| id)
    }

    #[test]
    fn every_file_is_listed_and_every_listed_task_is_a_file() {
        let listed: BTreeSet<String> = folders()
            .flat_map(|id| {
                SUITES.map(|s| {
                    suite(&id, s)
                        .unwrap()
                        .into_iter()
                        .map(|(n, _)| path_of(&id, &n))
                        .collect::<Vec<_>>()
                })
            })
            .flatten()
            .chain([MANIFEST.to_owned()])
            .collect();
        let there: BTreeSet<String> = Files::iter().map(|f| f.to_string()).collect();
        assert_eq!(listed, there);
        let count = |id| suite(id, "manual").unwrap().len();
        assert_eq!([count("pointmass"), count("ur5e"), count("shadow_hand")], [15, 4, 18]);
        assert_eq!(suite("ur5e_light", "manual").unwrap().len(), 4);
    }

    #[test]
    fn every_task_is_canonical_lasts_and_lints_clean() {
        for id in folders() {
            let robot = Robot::builtin(&id).unwrap();
            let table = robot.joint_table();
            for s in SUITES {
                for (name, clip) in suite(&id, s).unwrap() {
                    let text = task_text(&id, &name).unwrap();
                    assert_eq!(clip.to_text(), text, "{id}/{name} is not canonical");
                    assert!(s != "manual" || clip.secs() > 10.0, "{id}/{name} is too short");
                    assert!(!clip.name.is_empty() && !clip.notes.is_empty());
                    let sha = clip.robot.model_sha256.as_deref();
                    assert_eq!(sha, Some(robot.model_sha256()), "{id}/{name}");
                    let command = compile(&clip).unwrap();
                    for lint in lint(&clip, &command, &table, None) {
                        // People also type goals for some joints only.
                        let may = !AUTHORED.contains(&s) && lint.rule == Rule::PartialMask;
                        assert!(lint.level < Level::Error || may, "{id}/{name}: {}", lint.message);
                    }
                    for f in 0..command.frames() {
                        for (j, q) in robot.joints().iter().zip(command.row(f)) {
                            let inside = j.range[0] - 1e-6..=j.range[1] + 1e-6;
                            assert!(inside.contains(&f64::from(*q)), "{id}/{name} {f} {}", j.name);
                        }
                    }
                }
            }
        }
    }

    /// The files are what the formulas give; hand poses to a milliradian, since they come
    /// out of a simulation.
    #[test]
    fn files_and_formulas_agree() {
        for id in folders() {
            let robot = Robot::builtin(&id).unwrap();
            let tasks = author(&robot).unwrap();
            let names: usize = AUTHORED.iter().map(|s| suite(&id, s).unwrap().len()).sum();
            assert_eq!(tasks.len(), names, "{id}: run robert tasks author --out assets/clips");
            for task in tasks {
                let file = read(&id, task.name).unwrap();
                assert_eq!(file.keys.len(), task.clip.keys.len(), "{id}/{}", task.name);
                assert_eq!(file.poses.len(), task.clip.poses.len(), "{id}/{}", task.name);
                let (a, b) = (compile(&file).unwrap(), compile(&task.clip).unwrap());
                assert_eq!(a.frames(), b.frames());
                for f in 0..a.frames() {
                    assert_eq!(a.sight(f), b.sight(f), "{id}/{} {f}", task.name);
                    for (x, y) in a.row(f).iter().zip(b.row(f)) {
                        assert!((x - y).abs() < 1e-3, "{id}/{} {f}: {x} {y}", task.name);
                    }
                }
            }
        }
    }

    /// Both halves of a typed suite are of one size, and no clip is in two suites.
    #[test]
    fn typed_suites_have_two_halves() {
        for (id, least) in [("shadow_hand", 6), ("ur5e", 3), ("pointmass", 3)] {
            let mut seen = BTreeSet::new();
            for name in ["drawn", "fast", "touch"] {
                let half = |s: &str| -> Vec<String> {
                    suite(id, s).unwrap().into_iter().map(|(n, _)| n).collect()
                };
                let (first, last) = (half(name), half(&format!("{name}-final")));
                assert_eq!(first.len(), last.len(), "{id} {name}");
                assert!(first.len() >= least, "{id} {name}");
                seen.extend(first.into_iter().chain(last));
            }
            let clips = |s| suite(id, s).unwrap().len();
            assert_eq!(seen.len(), 2 * clips("final"), "{id}");
        }
        assert_eq!(suite("ur5e", "heldout").unwrap(), suite("ur5e", "validation").unwrap());
    }

    #[test]
    fn names_find_their_task_and_mistakes_a_near_one() {
        assert_eq!(find("reacher", None).unwrap().robot.id, "ur5e");
        assert_eq!(find("shadow_hand/fire", None).unwrap().name, "fire a handgun");
        assert_eq!(find("hang", Some("ur5e_light")).unwrap().robot.id, "ur5e");
        let e = find("recher", None).unwrap_err();
        assert!(e.to_string().contains("ur5e/reacher"), "{e}");
        assert!(matches!(suite("ur5e", "x"), Err(TaskError::UnknownSuite { .. })));
        assert!(matches!(suite("spot", "manual"), Err(TaskError::NoTasks { .. })));
    }
}
