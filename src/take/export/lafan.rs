//! Rows of the LAFAN1 retargeting sets: `x y z qx qy qz qw` of the base, then the joints.
//!
//! The file contains neither header nor rate, and other programs write the same columns with the
//! quaternion as w x y z. Therefore the name of the file and the report of the export state the
//! order.

use std::fmt::Write as _;
use std::sync::Arc;

use super::super::document::Take;
use super::super::error::Error;
use super::files::Export;
use super::skeleton::{Bodies, Pose, Skeleton};
use super::track::resampled;
use robert_robot::Robot;

/// The reached motion as LAFAN CSV at `fps` rows per second.
///
/// # Errors
/// [`Error::Robot`], [`Error::Simulator`].
pub fn lafan(take: &Take, robot: &Arc<Robot>, fps: u32) -> Result<Export, Error> {
    let mut skeleton = Skeleton::of(robot)?;
    let base = base(&mut skeleton)?;
    let order = skeleton.joint_order(Bodies::Mujoco);
    let rows = resampled(take, fps);
    let mut text = String::new();
    for row in &rows {
        let (p, r) = (base.pos, base.rot);
        write!(text, "{},{},{},{},{},{},{}", p.x, p.y, p.z, r.x, r.y, r.z, r.w).ok();
        for &j in &order {
            write!(text, ",{}", row[j]).ok();
        }
        text.push('\n');
    }
    let names: Vec<&str> = order.iter().map(|j| robot.joints()[*j].name.as_str()).collect();
    let open = format!(
        "python -c \"import numpy; print(numpy.loadtxt('{}', delimiter=',').shape)\"",
        Export::OUT
    );
    Ok(Export::single(text.into_bytes(), rows.len(), open)
        .says("A row a frame, no header: x y z of the base (m), qx qy qz qw (w last), then the joints (rad or m).")
        .says(format!("Joints: {}.", names.join(" ")))
        .says(format!(
            "The file does not say its rate, which is {fps} Hz: csv_to_npz.py --input_fps {fps}."
        )))
}

/// The pose of the base: the first body, or the world if that body moves by joints. Our robots do
/// not walk, so it is the same in every row.
fn base(skeleton: &mut Skeleton) -> Result<Pose, Error> {
    let home = skeleton.robot().home();
    let poses = skeleton.poses(&home)?;
    let stands = !poses.is_empty() && skeleton.joints_of(0).is_empty();
    Ok(if stands { poses[0] } else { Pose::WORLD })
}

#[cfg(test)]
mod tests {
    use super::super::super::sample;
    use super::*;

    #[test]
    fn rows_are_base_and_joints() {
        let (robot, take) = sample::take("ur5e", 21, 21);
        let export = lafan(&take, &robot, 20).unwrap();
        let text = String::from_utf8(export.files[0].bytes.clone()).unwrap();
        let rows: Vec<Vec<f64>> =
            text.lines().map(|l| l.split(',').map(|c| c.parse().unwrap()).collect()).collect();
        assert_eq!((rows.len(), rows[0].len()), (21, 12));
        for (f, row) in rows.iter().enumerate() {
            assert_eq!(&row[7..], take.state(f), "frame {f}");
            // The base's orientation in the take is w x y z.
            let body = take.body_poses(f);
            assert_eq!(&row[..3], &body[..3]);
            let wxyz = [row[6], row[3], row[4], row[5]];
            assert!(wxyz.iter().zip(&body[3..7]).all(|(a, b)| (a - b).abs() < 1e-12));
        }
        assert_eq!(lafan(&take, &robot, 50).unwrap().frames, 51);
    }
}
