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
    let ros_options = || RosOptions {
        lead_in_secs: options.lead_in,
        goal: options.goal,
        effort: options.effort,
        rename: options.rename.clone(),
        ranges: Some(robot.joints().iter().map(|j| j.range).collect()),
    };
    let bodies = if options.bodies == "isaac" { Bodies::Isaac } else { Bodies::Mujoco };
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
        "ur" => {
            let how = if options.ur_move == "movej" { UrMove::Movej } else { UrMove::Servoj };
            ur_script(take, what, how, title)
        }
        "csv" => Ok(Export::single(take.to_csv(what).into_bytes(), take.frames(), "")),
        "json" => Ok(Export::single(take.to_json(what).into_bytes(), take.frames(), "")),
        "lerobot" => {
            let episodes: Vec<Episode> = takes.iter().map(episode).collect();
            let v2 = options.lerobot_version == "2.1";
            let torque = options.action == "torque";
            lerobot(
                &episodes,
                None,
                &LeRobotOptions {
                    version: if v2 { LeRobotVersion::V2 } else { LeRobotVersion::V3 },
                    action: if torque { LeRobotAction::Torque } else { LeRobotAction::Position },
                    degrees: options.degrees,
                    rename: options.rename.clone(),
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
