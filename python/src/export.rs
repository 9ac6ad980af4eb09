//! Takes in the formats of other programs.

use std::collections::BTreeMap;
use std::path::PathBuf;

use pyo3::prelude::*;
use robert::take::What;
use robert::take::export::{
    Bodies, Episode, Export, LeRobotAction, LeRobotOptions, LeRobotVersion, RosOptions,
    TRACKING_FPS, UrMove, bag, bvh, glb, lafan, lerobot, minari, ros, tracking, ur_script, usda,
};
use robert::units::FPS;

use crate::error::{raise, wrong};
use crate::take::Take;

/// Options, by the names of the command line.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Options {
    what: String,
    fps: Option<u32>,
    bodies: String,
    lead_in: f64,
    goal: bool,
    effort: bool,
    rename: BTreeMap<String, String>,
    action: String,
    degrees: bool,
    lerobot_version: String,
    task: Option<String>,
    ur_move: String,
}

impl Options {
    /// Refuses options that another format takes, instead of ignoring them.
    fn check(&self, to: &str) -> PyResult<()> {
        let given = [
            ("what='command'", self.what == "command", "csv json ros bag ur"),
            ("fps", self.fps.is_some(), "lafan npz"),
            ("bodies", self.bodies != "mujoco", "npz"),
            ("lead_in", self.lead_in != 0.0, "ros bag"),
            ("goal", self.goal, "ros"),
            ("effort", self.effort, "ros bag"),
            ("rename", !self.rename.is_empty(), "ros bag lerobot"),
            ("action", self.action != "position", "lerobot"),
            ("degrees", self.degrees, "lerobot"),
            ("lerobot_version", self.lerobot_version != "3.0", "lerobot"),
            ("task", self.task.is_some(), "lerobot minari"),
            ("ur_move", self.ur_move != "servoj", "ur"),
        ];
        let odd = given.iter().find(|(_, asked, of)| *asked && !of.split(' ').any(|f| f == to));
        if let Some((name, _, of)) = odd {
            return Err(wrong(format!("{name} is for {}", of.replace(' ', ", "))));
        }
        if !(0.0..=3600.0).contains(&self.lead_in) {
            return Err(wrong(format!("lead_in takes 0 to 3600 s, not {}", self.lead_in)));
        }
        Ok(())
    }
}

/// The value of a word.
fn chosen<T>(name: &str, word: &str, words: [(&str, T); 2]) -> PyResult<T> {
    let [a, b] = [words[0].0, words[1].0];
    words
        .into_iter()
        .find_map(|(w, value)| (w == word).then_some(value))
        .ok_or_else(|| wrong(format!("{name} is {a} or {b}, not {word:?}")))
}

/// Writes takes; gives the files, the frames, what the numbers mean and what opens them.
#[pyfunction]
pub(crate) fn export(
    py: Python<'_>,
    takes: Vec<PyRef<'_, Take>>,
    to: &str,
    path: PathBuf,
    title: &str,
    options: Options,
) -> PyResult<(Vec<PathBuf>, usize, Vec<String>, String)> {
    let Some(first) = takes.first() else { return Err(wrong("no take to export")) };
    let (take, robot) = (&first.take, &first.robot);
    let what = match options.what.as_str() {
        "achieved" => What::Achieved,
        "command" => What::Command,
        other => return Err(wrong(format!("what is achieved or command, not {other:?}"))),
    };
    let motorised = Some(robot.motorised().map_err(raise)?);
    let ros_options = || RosOptions {
        lead_in_secs: options.lead_in,
        goal: options.goal,
        effort: options.effort,
        rename: options.rename.clone(),
        ranges: Some(robot.joints().iter().map(|j| j.range).collect()),
        motorised: motorised.clone(),
    };
    options.check(to)?;
    let bodies =
        chosen("bodies", &options.bodies, [("mujoco", Bodies::Mujoco), ("isaac", Bodies::Isaac)])?;
    let ur_move = chosen(
        "ur_move",
        &options.ur_move,
        [("servoj", UrMove::Servoj), ("movej", UrMove::Movej)],
    )?;
    let version = [("3.0", LeRobotVersion::V3), ("2.1", LeRobotVersion::V2)];
    let version = chosen("lerobot_version", &options.lerobot_version, version)?;
    let action = [("position", LeRobotAction::Position), ("torque", LeRobotAction::Torque)];
    let action = chosen("action", &options.action, action)?;
    let episode = |t: &PyRef<'_, Take>| {
        let task = options.task.clone().unwrap_or_else(|| {
            let name = t.motion().name;
            if name.is_empty() { title.to_owned() } else { name }
        });
        Episode::of_take(&t.take, &task)
    };
    let made: Export = match to {
        "glb" => glb(take, robot, title),
        "bvh" => bvh(take, robot),
        "usda" => usda(take, robot),
        "lafan" => lafan(take, robot, options.fps.unwrap_or(FPS)),
        "npz" => tracking(take, robot, options.fps.unwrap_or(TRACKING_FPS), bodies),
        "ros" => ros(take, what, &ros_options()),
        "bag" => bag(take, what, &ros_options()),
        "ur" => ur_script(take, what, ur_move, title),
        "csv" => Ok(Export::single(take.to_csv(what).into_bytes(), take.frames(), "")),
        "json" => Ok(Export::single(take.to_json(what).into_bytes(), take.frames(), "")),
        "lerobot" => {
            let episodes: Vec<Episode> = takes.iter().map(episode).collect();
            lerobot(
                &episodes,
                None,
                &LeRobotOptions {
                    version,
                    action,
                    degrees: options.degrees,
                    rename: options.rename.clone(),
                    motorised: motorised.clone(),
                },
            )
        }
        "minari" => minari(takes.iter().map(episode), title, &take.provenance.policy),
        other => return Err(wrong(format!("no format {other:?}"))),
    }
    .map_err(raise)?;
    let files = py.detach(|| made.write(&path)).map_err(raise)?;
    let open = made.open.replace(Export::OUT, &path.display().to_string());
    Ok((files, made.frames, made.meaning, open))
}
