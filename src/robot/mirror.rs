//! A pose and its mirror image.
//!
//! For every joint, a table names the joint whose value it gets in the mirror image, with a sign
//! and an offset. On hinges the image is unique only up to full turns. The turn nearest to a
//! reference is used, so that a mirrored motion does not jump.

use std::f64::consts::TAU;

use super::{Error, Robot};
use robert_base::units::Unit;

impl Robot {
    /// Why the robot has no mirror image; `None` if it has one.
    pub fn mirror_reason(&self) -> Option<&str> {
        let mirror = &self.profile().mirror;
        mirror.table.is_empty().then_some(mirror.none.as_str())
    }

    /// The mirror image of a pose; (`state_dim`). `near` (the frame before, or the home pose)
    /// selects the turn of joints that can make more than one.
    ///
    /// # Errors
    /// [`Error::NoMirror`], [`Error::Length`].
    pub fn mirror(&self, pose: &[f64], near: Option<&[f64]>) -> Result<Vec<f64>, Error> {
        if let Some(reason) = self.mirror_reason() {
            let (robot, reason) = (self.id().to_owned(), reason.to_owned());
            return Err(Error::NoMirror { robot, reason });
        }
        self.check_len("pose", pose.len(), self.state_dim())?;
        if let Some(near) = near {
            self.check_len("reference", near.len(), self.state_dim())?;
        }
        let mut out = pose.to_vec();
        for row in &self.profile().mirror.table {
            let (target, source) = (self.joint_index(&row.target)?, self.joint_index(&row.source)?);
            let joint = &self.joints()[target];
            let image = row.offset + row.sign * pose[source];
            let reference = near.map_or(0.0, |n| n[target]);
            out[target] = match joint.unit {
                Unit::Rad => nearest_turn(image, reference, joint.range),
                Unit::M => image.clamp(joint.range[0], joint.range[1]),
            };
        }
        Ok(out)
    }

    /// The mirror image of a motion, frame by frame without jumps; `(frames, state_dim)`.
    ///
    /// # Errors
    /// As [`Robot::mirror`].
    pub fn mirror_motion(&self, frames: &[Vec<f64>]) -> Result<Vec<Vec<f64>>, Error> {
        let mut out: Vec<Vec<f64>> = Vec::with_capacity(frames.len());
        for frame in frames {
            let image = self.mirror(frame, out.last().map(Vec::as_slice))?;
            out.push(image);
        }
        Ok(out)
    }
}

/// The angle equal to `angle` up to full turns that is inside the range and nearest to `reference`;
/// clamped if no turn fits.
fn nearest_turn(angle: f64, reference: f64, [lo, hi]: [f64; 2]) -> f64 {
    let nearest = angle - TAU * ((angle - reference) / TAU).round();
    let fits = |v: f64| v >= lo - 1e-9 && v <= hi + 1e-9;
    [0.0, -1.0, 1.0, -2.0, 2.0]
        .iter()
        .map(|k| nearest + TAU * k)
        .filter(|v| fits(*v))
        .min_by(|a, b| (a - reference).abs().total_cmp(&(b - reference).abs()))
        .unwrap_or_else(|| nearest.clamp(lo, hi))
}

#[cfg(test)]
mod tests {
    use super::*;
    use robert_mujoco::{Data, Kind};

    /// Position and direction of the tool, with the base's x reversed.
    fn tool(robot: &Robot, pose: &[f64]) -> ([f64; 3], [f64; 3]) {
        let mut data = Data::new(robot.model()).unwrap();
        robot.write_state(&mut data, pose).unwrap();
        data.kinematics().unwrap();
        let s = robot.model().id(Kind::Site, "end_effector").unwrap();
        let p = &data.site_xpos()[3 * s..3 * s + 3];
        let m = &data.site_xmat()[9 * s..9 * s + 9];
        ([p[0], p[1], p[2]], [m[2], m[5], m[8]])
    }

    #[test]
    fn the_arms_image_is_an_image() {
        let robot = Robot::builtin("ur5e").unwrap();
        for pose in
            [robot.home(), vec![0.4, -1.1, 1.3, -0.7, 0.6], vec![-2.1, -0.4, -0.9, 0.3, -2.2]]
        {
            let image = robot.mirror(&pose, None).unwrap();
            let ((p, a), (q, b)) = (tool(&robot, &pose), tool(&robot, &image));
            // The tool's axis mirrors exactly about the plane x = 0; its place is off by
            // twice the sideways offset of the arm (2 x 0.134 m), a constant.
            assert!((a[0] + b[0]).abs() < 1e-9 && (a[1] - b[1]).abs() < 1e-9, "{a:?} {b:?}");
            assert!((a[2] - b[2]).abs() < 1e-9);
            let off = ((p[0] + q[0]).powi(2) + (p[1] - q[1]).powi(2)).sqrt();
            assert!((off - 0.268).abs() < 0.003, "{off}");
            let twice = robot.mirror(&image, Some(&pose)).unwrap();
            for (x, y) in pose.iter().zip(&twice) {
                assert!((x - y).abs() < 1e-9, "mirroring twice changes the pose");
            }
        }
    }

    #[test]
    fn a_motion_does_not_jump() {
        let robot = Robot::builtin("ur5e").unwrap();
        let frames: Vec<Vec<f64>> =
            (0..100).map(|i| vec![0.0, -1.5, 1.0, -1.0, -2.0 + 0.05 * f64::from(i)]).collect();
        let out = robot.mirror_motion(&frames).unwrap();
        for w in out.windows(2) {
            assert!((w[1][4] - w[0][4]).abs() < 0.06, "{} to {}", w[0][4], w[1][4]);
        }
    }

    #[test]
    fn a_single_hand_says_why_not() {
        let robot = Robot::builtin("shadow_hand").unwrap();
        let e = robot.mirror(&robot.home(), None).unwrap_err();
        assert!(matches!(&e, Error::NoMirror { reason, .. } if !reason.is_empty()), "{e}");
    }

    #[test]
    fn turns_stay_in_range() {
        assert!((nearest_turn(4.7, -1.5, [-6.2, 6.2]) + 1.583_185).abs() < 1e-5);
        assert!((nearest_turn(4.0, 0.0, [0.0, 5.0]) - 4.0).abs() < 1e-12);
        assert!((nearest_turn(3.0, 0.0, [-1.0, 1.0]) - 1.0).abs() < 1e-12);
    }
}
