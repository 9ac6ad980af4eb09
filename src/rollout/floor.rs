//! The floor of a clip: the Precision of iLQR, which knows the robot's model.
//!
//! Some goals cannot be reached (different values for two joints of one tendon, fingers through
//! each other), so the Precision of a policy alone says little. The excess over this floor is the
//! error that a better policy could have avoided.
//!
//! iLQR needs seconds per clip of the hand, so the floors of the shipped clips are part of the
//! program: `assets/floors/ROBOT.json`, written by `robert tasks floors`. An entry is valid only
//! for the same robot and the same command, which are compared by hashes. Other clips are measured
//! on demand.

use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

use serde::{Deserialize, Serialize};
use serde_json::json;

use super::error::Error;
use super::jam::Off;
use super::policy_config::PolicyConfig;
use super::suite::{Case, EvalConfig, Floor, Suite, evaluate_on};
use robert_base::fsio;
use robert_base::progress::{Cancel, Progress};
use robert_clip::Command;
use robert_robot::{PlantRange, Robot};

#[derive(rust_embed::RustEmbed)]
#[folder = "assets/floors/"]
struct Files;

/// The floors of one robot's clips, `assets/floors/ROBOT.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FloorTable {
    /// [`robot_hash`] of the robot.
    pub robot: String,
    /// By the name of the clip, for readers of the file.
    pub clips: BTreeMap<String, Entry>,
}

impl FloorTable {
    /// The text of the file: one clip per line.
    pub fn to_text(&self) -> String {
        let line = |(name, entry)| format!("    {}: {}", json!(name), json!(entry));
        let clips: Vec<String> = self.clips.iter().map(line).collect();
        let robot = json!(self.robot);
        format!("{{\n  \"robot\": {robot},\n  \"clips\": {{\n{}\n  }}\n}}\n", clips.join(",\n"))
    }
}

/// One clip in a [`FloorTable`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// [`command_hash`] of the clip.
    pub command: String,
    /// Precision of iLQR, rad or m.
    pub precision: f64,
    /// By joint, frames `[from, to)` where iLQR is too far off to recognise a jam.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub off: BTreeMap<String, Vec<[usize; 2]>>,
}

impl Entry {
    fn of(robot: &Robot, command: &Command, floor: &Floor) -> Entry {
        let mut off: BTreeMap<String, Vec<[usize; 2]>> = BTreeMap::new();
        for o in &floor.off {
            off.entry(robot.joints()[o.joint].name.clone()).or_default().push([o.from, o.to]);
        }
        // Rounded to 1e-12, since the last bits would only cause differences in the file.
        let precision = (floor.precision * 1e12).round() / 1e12;
        Entry { command: command_hash(command), precision, off }
    }

    fn floor(&self, robot: &Robot) -> Floor {
        let mut off = Vec::new();
        for (joint, joint_name) in robot.joints().iter().map(|j| &j.name).enumerate() {
            let spans = self.off.get(joint_name).into_iter().flatten();
            off.extend(spans.map(|&[from, to]| Off { joint, from, to }));
        }
        Floor { precision: self.precision, off }
    }
}

/// Hash of what the simulation depends on: the model and the profile's changes to it.
pub fn robot_hash(robot: &Robot) -> String {
    let profile = robot.profile();
    let text = json!([robot.model_sha256(), profile.physics, profile.actuators]);
    fsio::sha256_hex(text.to_string().as_bytes())
}

/// Hash of the command: joints, start and every goal, without titles and notes.
pub fn command_hash(command: &Command) -> String {
    let mut bytes = command.joints().join("\n").into_bytes();
    let mut put = |v: f32| bytes.extend(v.to_le_bytes());
    command.start().iter().for_each(|v| put(*v));
    for f in 0..command.frames() {
        for (j, v) in command.row(f).iter().enumerate() {
            // A missing goal is encoded by a value that no goal has.
            put(if command.sees(f, j) { *v } else { f32::NAN });
        }
    }
    fsio::sha256_hex(&bytes)
}

/// The built-in floors of a robot; `None` if there are none.
///
/// # Errors
/// [`Error::Floors`] when the file is damaged.
pub fn table(id: &str) -> Result<Option<&'static FloorTable>, Error> {
    type Tables = BTreeMap<String, Result<FloorTable, String>>;
    static TABLES: OnceLock<Tables> = OnceLock::new();
    let tables = TABLES.get_or_init(|| {
        let parse = |path: &str| {
            let file = Files::get(path).ok_or("it is missing")?;
            serde_json::from_slice(&file.data).map_err(|e| e.to_string())
        };
        Files::iter().map(|path| (path.to_string(), parse(&path))).collect()
    });
    let path = format!("{id}.json");
    match tables.get(&path) {
        None => Ok(None),
        Some(Ok(table)) => Ok(Some(table)),
        Some(Err(message)) => Err(Error::Floors { message: message.clone(), path }),
    }
}

/// The built-in floor of this command, if there is one.
///
/// # Errors
/// [`Error::Floors`].
pub fn known(robot: &Robot, command: &Command) -> Result<Option<Floor>, Error> {
    let Some(table) = table(robot.id())?.filter(|t| t.robot == robot_hash(robot)) else {
        return Ok(None);
    };
    let hash = command_hash(command);
    Ok(table.clips.values().find(|e| e.command == hash).map(|e| e.floor(robot)))
}

/// Sets the floor of every case for which `wants` is true: the built-in floor, or else that of a
/// rollout of iLQR on the nominal plant. A case that iLQR cannot perform has no floor. What was measured
/// before an interruption is kept.
///
/// # Errors
/// As [`super::evaluate`], and [`Error::Floors`].
pub fn fill<'a>(
    robot: &Arc<Robot>,
    cases: impl Iterator<Item = &'a mut Case>,
    threads: usize,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<(), Error> {
    let mut missing: Vec<&mut Case> = Vec::new();
    for case in cases {
        case.floor = known(robot, &case.command)?;
        if case.floor.is_none() {
            missing.push(case);
        }
    }
    if missing.is_empty() {
        return Ok(());
    }
    let suite =
        Suite { name: String::new(), cases: missing.iter().map(|c| (**c).clone()).collect() };
    let (found, is_whole) = measure(robot, suite, threads, progress, cancel)?;
    for (case, floor) in missing.into_iter().zip(found) {
        case.floor = floor;
    }
    if is_whole { Ok(()) } else { Err(Error::Cancelled { frame: 0 }) }
}

/// The floors of a suite's cases, by rollouts of iLQR, and whether all were measured.
fn measure(
    robot: &Arc<Robot>,
    suite: Suite,
    threads: usize,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<(Vec<Option<Floor>>, bool), Error> {
    let policies = vec![PolicyConfig::floor()];
    let config = EvalConfig { policies, plant: PlantRange::default(), seeds: 0..1, threads };
    let found = evaluate_on(robot, &[suite], &config, None, progress, cancel)?;
    let is_whole = found.is_whole();
    let tasks = found.results.into_iter().flat_map(|r| r.tasks);
    Ok((tasks.map(|t| t.as_floor()).collect(), is_whole))
}

/// The table of these clips of a robot, with every floor measured again.
///
/// # Errors
/// As [`super::evaluate`].
pub fn measure_table(
    robot: &Arc<Robot>,
    cases: Vec<Case>,
    threads: usize,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<FloorTable, Error> {
    let suite = Suite { name: "floors".to_owned(), cases };
    let (floors, is_whole) = measure(robot, suite.clone(), threads, progress, cancel)?;
    if !is_whole {
        return Err(Error::Cancelled { frame: 0 });
    }
    let named = suite.cases.iter().zip(floors);
    let clips = named.filter_map(|(case, floor)| {
        Some((case.name.clone(), Entry::of(robot, &case.command, &floor?)))
    });
    Ok(FloorTable { robot: robot_hash(robot), clips: clips.collect() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Start, tasks};
    use robert_base::progress::Silent;
    use robert_clip::compile;

    fn case(robot: &str, name: &str) -> Case {
        let command = compile(&tasks::find(name, Some(robot)).unwrap()).unwrap();
        Case { name: name.to_owned(), command, start: Start::Pose, truth: None, floor: None }
    }

    /// A changed clip or robot makes its entry stale; `robert tasks floors` writes them again.
    #[test]
    fn every_shipped_clip_has_its_floor() {
        for (id, entry) in tasks::manifest().unwrap() {
            let robot = Robot::builtin(&id).unwrap();
            let table = table(&id).unwrap().unwrap_or_else(|| panic!("{id} has no floors"));
            assert_eq!(table.robot, robot_hash(&robot), "{id}: run robert tasks floors");
            let mut clips = 0;
            for suite in tasks::SUITES {
                for (name, clip) in tasks::suite(&id, suite).unwrap() {
                    let floor = known(&robot, &compile(&clip).unwrap()).unwrap();
                    assert!(floor.is_some(), "{id}/{name}: run robert tasks floors");
                    clips += 1;
                }
            }
            assert_eq!(
                table.clips.len(),
                clips,
                "{id}: clips that are gone, run robert tasks floors"
            );
            assert!(entry.like.is_some() || clips > 0);
        }
    }

    /// Measures two short clips again, so that a change to iLQR or to the simulation is noticed.
    #[test]
    fn floors_are_what_ilqr_does() {
        for (id, name) in
            [("pointmass", "dash_cross"), ("ur5e", "peck"), ("shadow_hand", "ok_ok_ok")]
        {
            let robot = Arc::new(Robot::builtin(id).unwrap());
            let case = case(id, name);
            let stored = known(&robot, &case.command).unwrap().unwrap();
            let cancel = Cancel::default();
            let table = measure_table(&robot, vec![case], 1, &Silent, &cancel).unwrap();
            let anew = table.clips[name].precision;
            // Other processors round differently, and contact amplifies that.
            assert!(
                (anew - stored.precision).abs() < 0.02 * anew,
                "{id}/{name}: {anew} {stored:?}"
            );
        }
    }

    #[test]
    fn hashes_tell_commands_apart_and_ignore_titles() {
        let clip = tasks::find("peck", Some("ur5e")).unwrap();
        let hash = |c: &robert_clip::Clip| command_hash(&compile(c).unwrap());
        let mut other = clip.clone();
        other.name = "another".into();
        other.notes.clear();
        assert_eq!(hash(&clip), hash(&other));
        other.keys[1].hold += 1;
        assert_ne!(hash(&clip), hash(&other));
        let [big, light] = ["ur5e", "ur5e_light"].map(|id| Robot::builtin(id).unwrap());
        assert_ne!(robot_hash(&big), robot_hash(&light));
    }
}
