//! Text exports of takes: CSV, MJCF keys, ROS trajectories.
//!
//! Commands use the clip's writers, so that they are read back as the same command. Reached motion
//! is written in full precision, with velocities, torques or controls if the format has them.

use std::fmt::Write as _;

use super::document::{Take, What, row};
use super::error::Error;
use crate::clip::formats;
use crate::units::{CTRL_DT, FPS};

impl Take {
    /// CSV: `frame,time,mask,<joint>...`, one row per frame.
    pub fn to_csv(&self, what: What) -> String {
        if what == What::Command {
            return formats::to_csv(&self.command);
        }
        let mut out = String::from("frame,time,mask");
        for joint in &self.robot.joints {
            let quoted = joint.replace('"', "\"\"");
            let plain = !joint.contains([',', '"', '\n', '\r']);
            write!(out, ",{}", if plain { quoted } else { format!("\"{quoted}\"") }).ok();
        }
        out.push('\n');
        for f in 0..self.frames() {
            write!(out, "{f},{},0", secs(f)).ok();
            for q in self.state(f) {
                write!(out, ",{q}").ok();
            }
            out.push('\n');
        }
        out
    }

    /// MJCF: one `<key>` per frame. Keys of the reached motion also have velocities and controls,
    /// so that the simulator can start from each of them.
    ///
    /// # Errors
    /// [`Error::Export`] for commands with goals for some joints only.
    pub fn to_mjcf(&self, what: What) -> Result<String, Error> {
        if what == What::Command {
            return Ok(formats::to_mjcf(&self.command)?);
        }
        let mut out = String::from("<mujoco>\n  <!-- qpos and qvel: ");
        // A comment must not contain two dashes.
        let plain = |names: &[String]| names.join(" ").replace("--", "- -");
        writeln!(
            out,
            "{}\n       ctrl: {} -->",
            plain(&self.robot.joints),
            plain(&self.robot.actuators)
        )
        .ok();
        out.push_str("  <keyframe>\n");
        for f in 0..self.frames() {
            let qpos = numbers(self.state(f));
            let qvel = numbers(row(&self.velocity, f, self.state_dim()));
            write!(
                out,
                "    <key name=\"frame{f}\" time=\"{}\" qpos=\"{qpos}\" qvel=\"{qvel}\"",
                secs(f)
            )
            .ok();
            let ctrl = row(&self.ctrl, f, self.action_dim());
            if !ctrl.is_empty() {
                write!(out, " ctrl=\"{}\"", numbers(ctrl)).ok();
            }
            out.push_str("/>\n");
        }
        out.push_str("  </keyframe>\n</mujoco>\n");
        Ok(out)
    }

    /// ROS 2 `trajectory_msgs/msg/JointTrajectory` as YAML: one point per frame.
    ///
    /// # Errors
    /// [`Error::Export`] for commands with goals for some joints only, or for none.
    pub fn to_ros(&self, what: What) -> Result<String, Error> {
        if what == What::Command {
            return Ok(formats::to_ros(&self.command)?);
        }
        let mut out = String::from("# trajectory_msgs/msg/JointTrajectory\njoint_names:\n");
        for joint in &self.robot.joints {
            // A JSON string is a YAML string too.
            writeln!(out, "- {}", serde_json::Value::from(joint.as_str())).ok();
        }
        out.push_str("points:\n");
        for f in 0..self.frames() {
            writeln!(out, "- positions: {}", list(self.state(f))).ok();
            writeln!(out, "  velocities: {}", list(row(&self.velocity, f, self.state_dim()))).ok();
            let effort = row(&self.effort, f, self.state_dim());
            if !effort.is_empty() {
                writeln!(out, "  effort: {}", list(effort)).ok();
            }
            let fps = FPS as usize;
            let (sec, nanosec) = (f / fps, f % fps * 50_000_000);
            writeln!(out, "  time_from_start: {{sec: {sec}, nanosec: {nanosec}}}").ok();
        }
        Ok(out)
    }
}

/// Frame times without accumulated rounding of 0.05.
fn secs(frame: usize) -> f64 {
    (frame as f64 * CTRL_DT * 100.0).round() / 100.0
}

fn numbers(values: &[f64]) -> String {
    values.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}

/// ROS parsers require floats to look like floats.
fn list(values: &[f64]) -> String {
    let decimal = |v: &f64| {
        let text = v.to_string();
        if text.contains('.') { text } else { format!("{text}.0") }
    };
    format!("[{}]", values.iter().map(decimal).collect::<Vec<_>>().join(", "))
}

#[cfg(test)]
mod tests {
    use super::super::sample;
    use super::*;
    use crate::clip::formats::{from_csv, from_mjcf, from_ros};
    use crate::clip::{Clip, Command, Fill, compile, parse};
    use crate::rollout::{PolicyConfig, PolicyName, Precision, Rollout, RolloutConfig, Start};

    fn original(take: &Take) -> Clip {
        parse(take.clip_text.clone().unwrap()).unwrap().clip
    }

    /// What each exporter writes of the reached motion is read back to within the clip's grid.
    #[test]
    fn achieved_motion_survives_every_format() {
        let (_, take) = sample::take("ur5e", 30, 30);
        let robot = original(&take).robot;
        let csv = take.to_csv(What::Achieved);
        let mjcf = take.to_mjcf(What::Achieved).unwrap();
        let ros = take.to_ros(What::Achieved).unwrap();
        let near = |clip: Clip, what: &str| {
            let command = compile(&clip).unwrap();
            assert_eq!(command.frames(), 30, "{what}");
            for f in 0..30_usize {
                for (q, r) in command.row(f as u32).iter().zip(take.state(f)) {
                    assert!((f64::from(*q) - r).abs() < 2e-6, "{what} frame {f}: {q} {r}");
                }
            }
        };
        near(from_csv(csv.as_bytes(), Some(&robot), Fill::Mask).unwrap(), "csv");
        near(from_mjcf(&mjcf, &robot, Fill::Mask).unwrap(), "mjcf");
        near(from_ros(&ros, Some(&robot), Fill::Mask).unwrap(), "ros");
        assert_eq!(csv.lines().count(), 31);
        assert_eq!(mjcf.matches(" qvel=").count(), 30);
        assert_eq!(mjcf.matches(" ctrl=").count(), 29);
        assert_eq!(ros.matches("velocities:").count(), 30);
        assert_eq!(ros.matches("effort:").count(), 29);
    }

    fn precision(take: &Take, id: &str, command: &Command) -> Precision {
        let robot = std::sync::Arc::new(crate::robot::Robot::builtin(id).unwrap());
        let policy = PolicyConfig::new(PolicyName::Pd).build(&robot).unwrap();
        let config = RolloutConfig { seed: take.provenance.seed, ..RolloutConfig::default() };
        let mut rollout = Rollout::new(&robot, policy, command, Start::Pose, config).unwrap();
        rollout.run(&crate::progress::Cancel::default()).unwrap();
        rollout.precision()
    }

    /// The command of a take, exported and imported, is performed with the same Precision.
    #[test]
    fn exported_commands_give_the_same_precision() {
        for id in ["ur5e", "shadow_hand"] {
            let (_, take) = sample::take(id, 45, 45);
            let robot = original(&take).robot;
            let csv = from_csv(take.to_csv(What::Command).as_bytes(), Some(&robot), Fill::Mask);
            let mjcf = from_mjcf(&take.to_mjcf(What::Command).unwrap(), &robot, Fill::Mask);
            let ros = from_ros(&take.to_ros(What::Command).unwrap(), Some(&robot), Fill::Mask);
            let again = original(&take);
            for (what, clip) in [
                ("csv", csv.unwrap()),
                ("mjcf", mjcf.unwrap()),
                ("ros", ros.unwrap()),
                ("take", again),
            ] {
                let command = compile(&clip).unwrap();
                let found = precision(&take, id, &command);
                let (a, b) = (found.precision.unwrap(), take.precision().precision.unwrap());
                assert!((a - b).abs() <= 1e-9, "{id} {what}: {a} {b}");
                assert_eq!(found.per_frame, take.precision().per_frame, "{id} {what}");
            }
        }
    }
}
