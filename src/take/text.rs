//! Text exports of takes: CSV and MJCF keys.
//!
//! Commands use the clip's writers, so that they are read back as the same command. Reached motion
//! is written in full precision, with velocities, torques or controls if the format has them.

use std::fmt::Write as _;

use super::document::{Take, What, row};
use super::error::Error;
use robert_base::units::CTRL_DT;
use robert_base::xml;
use robert_clip::formats;

impl Take {
    /// CSV: `frame,time,mask,<joint>...`, one row per frame.
    pub fn to_csv(&self, what: What) -> String {
        if what == What::Command {
            return formats::to_csv(&self.command);
        }
        let row = |f: usize| (f as i64, false, self.state(f).iter().map(Some));
        formats::motion_to_csv(&self.robot.joints, (0..self.frames()).map(row))
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
        let plain = |names: &[String]| xml::in_comment(&names.join(" "));
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
}

/// Frame times without accumulated rounding of 0.05.
fn secs(frame: usize) -> f64 {
    (frame as f64 * CTRL_DT * 100.0).round() / 100.0
}

fn numbers(values: &[f64]) -> String {
    values.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::super::sample;
    use super::*;
    use robert_clip::formats::{from_csv, from_mjcf, from_ros};
    use robert_clip::{Clip, Command, Fill, compile, parse};
    use robert_rollout::{PolicyConfig, PolicyName, Precision, Rollout, RolloutConfig, Start};

    fn original(take: &Take) -> Clip {
        parse(take.clip_text.clone().unwrap()).unwrap().clip
    }

    /// The reached motion that each exporter writes is read back to within the clip's grid.
    #[test]
    fn achieved_motion_survives_every_format() {
        let (_, take) = sample::take("ur5e", 30, 30);
        let robot = original(&take).robot;
        let csv = take.to_csv(What::Achieved);
        let mjcf = take.to_mjcf(What::Achieved).unwrap();
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
        assert_eq!(csv.lines().count(), 31);
        assert_eq!(mjcf.matches(" qvel=").count(), 30);
        assert_eq!(mjcf.matches(" ctrl=").count(), 29);
    }

    fn precision(take: &Take, id: &str, command: &Command) -> Precision {
        let robot = std::sync::Arc::new(robert_robot::Robot::builtin(id).unwrap());
        let policy = PolicyConfig::new(PolicyName::Pd).build(&robot).unwrap();
        let config = RolloutConfig { seed: take.provenance.seed, ..RolloutConfig::default() };
        let mut rollout = Rollout::new(&robot, policy, command, Start::Pose, config).unwrap();
        rollout.run(&robert_base::progress::Cancel::default()).unwrap();
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
            let ros = formats::to_ros(&take.command).unwrap();
            let ros = from_ros(&ros, Some(&robot), Fill::Mask);
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
