//! A URScript program for the UR5e: the motion as commands for the arm's controller.

use std::f64::consts::PI;
use std::fmt::Write as _;

use super::super::document::{Take, What};
use super::super::error::Error;
use super::files::Export;
use robert_base::units::{CTRL_DT, FPS};
use robert_clip::Sight;

/// Joints of the arm in the controller's order; our model fixes the sixth at zero. The ROS driver
/// adds `_joint` to these names, and both spellings are accepted.
const JOINTS: [&str; 5] = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2"];
/// Greatest joint speed of the UR5e in its data sheet, rad/s: 180 degrees per second.
const SPEED: f64 = PI;

/// The motion command of the program.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum UrMove {
    /// One target every 50 ms, which the arm follows continuously.
    #[default]
    Servoj,
    /// A timed movement from each commanded key to the next, with a stop at each.
    Movej,
}

/// Whether these are the joints of an arm that the program is for.
pub fn fits_ur<'a>(joints: impl Iterator<Item = &'a str>) -> bool {
    order(joints).is_some()
}

/// The places of the controller's joints among these; `None` for another robot.
fn order<'a>(joints: impl Iterator<Item = &'a str>) -> Option<Vec<usize>> {
    let joints: Vec<&str> = joints.map(|j| j.strip_suffix("_joint").unwrap_or(j)).collect();
    let order: Option<Vec<usize>> =
        JOINTS.iter().map(|n| joints.iter().position(|j| j == n)).collect();
    order.filter(|o| o.len() == joints.len())
}

/// The motion as a program.
///
/// # Errors
/// [`Error::Unfit`] for another robot, for a joint faster than the arm, and for a command
/// without goals.
pub fn ur_script(take: &Take, what: What, how: UrMove, title: &str) -> Result<Export, Error> {
    let Some(order) = order(take.robot.joints.iter().map(String::as_str)) else {
        let robot = &take.robot.id;
        return Err(unfit(format!("the joints of a UR5e are needed, and {robot} has others")));
    };
    let targets: Vec<(usize, Vec<f64>)> = match what {
        What::Achieved => (0..take.frames())
            .map(|f| (f, order.iter().map(|j| take.state(f)[*j]).collect()))
            .collect(),
        What::Command => (0..take.command.frames())
            .filter(|f| take.command.sight(*f) == Sight::Full)
            .map(|f| {
                let row = take.command.row(f);
                (f as usize, order.iter().map(|j| f64::from(row[*j])).collect())
            })
            .collect(),
    };
    let targets = match how {
        UrMove::Servoj => targets,
        UrMove::Movej => turns(&targets),
    };
    if targets.is_empty() {
        return Err(unfit("no frame has a goal for every joint".to_owned()));
    }
    let fastest = speeds(&targets)?;
    let name: String =
        title.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    let mut text = format!(
        "# {} of {}, {}\ndef robert_{name}():\n",
        word(what),
        take.robot.id,
        take.provenance.program
    );
    text.push_str(
        "  # base, shoulder, elbow, wrist 1, wrist 2, wrist 3; rad. Slowly to the first pose.\n",
    );
    let mut before = &targets[0];
    for (i, target) in targets.iter().enumerate() {
        let (frame, q) = target;
        let list: Vec<String> = q.iter().map(|v| format!("{v:.6}")).collect();
        let pose = format!("[{}, 0.000000]", list.join(", "));
        let secs = (frame - before.0) as f64 * CTRL_DT;
        match (i, how) {
            (0, _) => writeln!(text, "  movej({pose}, a=0.5, v=0.5)"),
            (_, UrMove::Servoj) => {
                writeln!(text, "  servoj({pose}, t={secs:.2}, lookahead_time=0.1, gain=300)")
            }
            // A movement to the current pose of the arm ends at once.
            (_, UrMove::Movej) if *q == before.1 => writeln!(text, "  sleep({secs:.2})"),
            (_, UrMove::Movej) => writeln!(text, "  movej({pose}, t={secs:.2})"),
        }
        .ok();
        before = target;
    }
    if how == UrMove::Servoj {
        text.push_str("  stopj(2.0)\n");
    }
    text.push_str("end\n");
    let open = format!("nc ROBOT_ADDRESS 30002 < {}", Export::OUT);
    Ok(Export::single(text.into_bytes(), targets.len(), open)
        .says("Joint angles of the controller, rad; wrist 3, which the model welds, stays at 0.")
        .says(format!(
            "The fastest joint needs {fastest:.2} rad/s of {SPEED:.2}; the arm first moves slowly to the first pose: keep its way clear."
        )))
}

/// The first and last frame of each run of equal rows: the position of keys and their holds.
fn turns(targets: &[(usize, Vec<f64>)]) -> Vec<(usize, Vec<f64>)> {
    let same = |a: &(usize, Vec<f64>), b: &(usize, Vec<f64>)| a.0 + 1 == b.0 && a.1 == b.1;
    let mut out: Vec<(usize, Vec<f64>)> = Vec::new();
    for run in targets.chunk_by(same) {
        let (first, last) = (&run[0], &run[run.len() - 1]);
        out.push(first.clone());
        if last.0 > first.0 {
            out.push(last.clone());
        }
    }
    out
}

/// The greatest speed between targets, rad/s; an error if the arm cannot reach it.
fn speeds(targets: &[(usize, Vec<f64>)]) -> Result<f64, Error> {
    let mut fastest = 0.0_f64;
    for pair in targets.windows(2) {
        let (frame, secs) = (pair[1].0, (pair[1].0 - pair[0].0) as f64 / f64::from(FPS));
        for ((a, b), joint) in pair[0].1.iter().zip(&pair[1].1).zip(JOINTS) {
            let speed = (b - a).abs() / secs;
            if speed > SPEED {
                return Err(unfit(format!(
                    "frame {frame}: {joint} would turn at {speed:.2} rad/s, and the arm does at most {SPEED:.2}"
                )));
            }
            fastest = fastest.max(speed);
        }
    }
    Ok(fastest)
}

fn word(what: What) -> &'static str {
    match what {
        What::Achieved => "reached motion",
        What::Command => "command",
    }
}

fn unfit(problem: String) -> Error {
    Error::Unfit { format: "ur", problem }
}

#[cfg(test)]
mod tests {
    use super::super::super::sample;
    use super::*;

    fn text(export: &Export) -> &str {
        std::str::from_utf8(&export.files[0].bytes).unwrap()
    }

    #[test]
    fn every_frame_is_a_target_in_the_controllers_order() {
        let (_, take) = sample::take("ur5e", 40, 40);
        let export = ur_script(&take, What::Achieved, UrMove::Servoj, "wave").unwrap();
        let lines: Vec<&str> = text(&export).lines().collect();
        assert_eq!(lines.iter().filter(|l| l.contains("servoj(")).count(), 39);
        let moved = lines.iter().find(|l| l.contains("movej(")).unwrap();
        let list = moved.split(['[', ']']).nth(1).unwrap();
        let q: Vec<f64> = list.split(',').map(|v| v.trim().parse().unwrap()).collect();
        assert_eq!((q.len(), q[5]), (6, 0.0));
        assert!(q.iter().zip(take.state(0)).all(|(a, b)| (a - b).abs() < 1e-6));
        assert!(lines[1] == "def robert_wave():" && lines.last() == Some(&"end"));
    }

    #[test]
    fn other_robots_and_speeds_beyond_the_arm_are_refused() {
        let (_, take) = sample::take("pointmass", 20, 20);
        let e = ur_script(&take, What::Achieved, UrMove::Servoj, "x").unwrap_err().to_string();
        assert!(e.contains("the joints of a UR5e are needed"), "{e}");
        let (_, mut take) = sample::take("ur5e", 40, 40);
        take.reached[5 * 7 + 2] += 0.5;
        let e = ur_script(&take, What::Achieved, UrMove::Servoj, "x").unwrap_err().to_string();
        assert!(e.contains("frame 7: elbow would turn at"), "{e}");
    }

    #[test]
    fn keys_become_timed_movements() {
        let (_, take) = sample::take("ur5e", 60, 60);
        let export = ur_script(&take, What::Command, UrMove::Movej, "wave").unwrap();
        let times: f64 = text(&export)
            .lines()
            .filter_map(|l| l.split_once("t=").or(l.split_once("sleep("))?.1.strip_suffix(')'))
            .map(|secs| secs.parse::<f64>().unwrap())
            .sum();
        assert!((times - 59.0 * 0.05).abs() < 1e-9, "{times}");
    }
}
