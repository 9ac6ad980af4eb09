//! NPZ of BeyondMimic and mjlab: joints and body poses with velocities, one row per control step.

use std::io::{Cursor, Write as _};
use std::sync::Arc;

use glam::{DQuat, DVec3};
use npyz::WriterBuilder as _;
use zip::write::SimpleFileOptions;

use super::super::document::Take;
use super::super::error::Error;
use super::files::Export;
use super::skeleton::{Bodies, Pose, Skeleton};
use super::track::{angular, gradient, linear, resampled};
use robert_robot::Robot;

/// Rows per second that the trackers expect: one for each control step of 0.02 s.
pub const TRACKING_FPS: u32 = 50;

/// The reached motion as a motion file of the trackers.
///
/// # Errors
/// [`Error::Robot`], [`Error::Simulator`], [`Error::Encode`].
pub fn tracking(
    take: &Take,
    robot: &Arc<Robot>,
    fps: u32,
    bodies: Bodies,
) -> Result<Export, Error> {
    let mut skeleton = Skeleton::of(robot)?;
    let (body_order, joint_order) = (skeleton.order(bodies), skeleton.joint_order(bodies));
    let dt = 1.0 / f64::from(fps);
    let rows = resampled(take, fps);
    let velocity = gradient(&rows, dt);
    let pick = |rows: &[Vec<f64>]| -> Vec<f32> {
        rows.iter().flat_map(|r| joint_order.iter().map(|j| r[*j] as f32)).collect()
    };
    let poses = rows.iter().map(|r| skeleton.poses(r)).collect::<Result<Vec<_>, _>>()?;
    let moved = Bodied::of(&poses, &body_order, dt);
    let (t, joints, n) = (rows.len() as u64, joint_order.len() as u64, body_order.len() as u64);
    let mut archive = Archive::new();
    archive.array("fps", &[1], &[i64::from(fps)])?;
    archive.array("joint_pos", &[t, joints], &pick(&rows))?;
    archive.array("joint_vel", &[t, joints], &pick(&velocity))?;
    archive.array("body_pos_w", &[t, n, 3], &moved.pos)?;
    archive.array("body_quat_w", &[t, n, 4], &moved.quat)?;
    archive.array("body_lin_vel_w", &[t, n, 3], &moved.lin)?;
    archive.array("body_ang_vel_w", &[t, n, 3], &moved.ang)?;
    let names: Vec<&str> = body_order.iter().map(|b| skeleton.names[*b].as_str()).collect();
    let joints: Vec<&str> = joint_order.iter().map(|j| robot.joints()[*j].name.as_str()).collect();
    let of = match bodies {
        Bodies::Mujoco => "MuJoCo and mjlab (depth first; Isaac Lab wants --bodies isaac)",
        Bodies::Isaac => "Isaac Lab (breadth first; mjlab wants --bodies mujoco)",
    };
    let open = format!(
        "python -c \"import numpy; print({{k: v.shape for k, v in numpy.load('{}').items()}})\"",
        Export::OUT
    );
    Ok(Export::single(archive.finish()?, rows.len(), open)
        .says(format!("{fps} rows a second from the take's 20, straight between them; velocities by central differences."))
        .says("World frame, at the link frames; rad, m, rad/s, m/s; quaternions w x y z.")
        .says(format!("Order of {of}. Bodies: {}. Joints: {}.", names.join(" "), joints.join(" "))))
}

/// Motion of the bodies in the order of the file, flattened.
struct Bodied {
    pos: Vec<f32>,
    quat: Vec<f32>,
    lin: Vec<f32>,
    ang: Vec<f32>,
}

impl Bodied {
    fn of(poses: &[Vec<Pose>], order: &[usize], dt: f64) -> Bodied {
        let (rows, n) = (poses.len(), order.len());
        let mut out = Bodied {
            pos: vec![0.0; rows * n * 3],
            quat: vec![0.0; rows * n * 4],
            lin: vec![0.0; rows * n * 3],
            ang: vec![0.0; rows * n * 3],
        };
        for (column, &body) in order.iter().enumerate() {
            let pos: Vec<DVec3> = poses.iter().map(|p| p[body].pos).collect();
            let rot: Vec<DQuat> = poses.iter().map(|p| p[body].rot).collect();
            let (lin, ang) = (linear(&pos, dt), angular(&rot, dt));
            for row in 0..rows {
                let at = row * n + column;
                for k in 0..3 {
                    out.pos[3 * at + k] = pos[row][k] as f32;
                    out.lin[3 * at + k] = lin[row][k] as f32;
                    out.ang[3 * at + k] = ang[row][k] as f32;
                }
                let q = rot[row];
                let wxyz = [q.w, q.x, q.y, q.z].map(|v| v as f32);
                out.quat[4 * at..4 * at + 4].copy_from_slice(&wxyz);
            }
        }
        out
    }
}

/// An NPZ file while it grows.
struct Archive {
    zip: zip::ZipWriter<Cursor<Vec<u8>>>,
}

impl Archive {
    fn new() -> Archive {
        Archive { zip: zip::ZipWriter::new(Cursor::new(Vec::new())) }
    }

    /// Adds an array in C order.
    fn array<T: npyz::AutoSerialize + Copy>(
        &mut self,
        name: &str,
        shape: &[u64],
        values: &[T],
    ) -> Result<(), Error> {
        let mut bytes = Vec::new();
        let options =
            npyz::WriteOptions::<T>::new().default_dtype().shape(shape).writer(&mut bytes);
        let mut writer = options.begin_nd().map_err(failed)?;
        writer.extend(values.iter().copied()).map_err(failed)?;
        writer.finish().map_err(failed)?;
        // A fixed time: the same take gives the same bytes.
        let stored = SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Deflated)
            .last_modified_time(zip::DateTime::default());
        self.zip.start_file(format!("{name}.npy"), stored).map_err(failed)?;
        self.zip.write_all(&bytes).map_err(failed)
    }

    fn finish(self) -> Result<Vec<u8>, Error> {
        Ok(self.zip.finish().map_err(failed)?.into_inner())
    }
}

fn failed(e: impl std::fmt::Display) -> Error {
    Error::Encode { what: "the NPZ file", problem: e.to_string() }
}

#[cfg(test)]
mod tests {
    use std::io::Read as _;

    use super::super::super::sample;
    use super::super::skeleton::reached;
    use super::*;

    fn array(bytes: &[u8], name: &str) -> (Vec<u64>, Vec<f32>) {
        let mut zip = zip::ZipArchive::new(Cursor::new(bytes)).unwrap();
        let mut raw = Vec::new();
        zip.by_name(&format!("{name}.npy")).unwrap().read_to_end(&mut raw).unwrap();
        let npy = npyz::NpyFile::new(&raw[..]).unwrap();
        (npy.shape().to_vec(), npy.into_vec().unwrap())
    }

    #[test]
    fn bodies_are_where_the_take_has_them() {
        for (id, bodies) in [("ur5e", Bodies::Mujoco), ("shadow_hand", Bodies::Isaac)] {
            let (robot, take) = sample::take(id, 31, 31);
            let export = tracking(&take, &robot, 50, bodies).unwrap();
            let bytes = &export.files[0].bytes;
            assert_eq!(tracking(&take, &robot, 50, bodies).unwrap(), export);
            let order = Skeleton::of(&robot).unwrap().order(bodies);
            let (shape, pos) = array(bytes, "body_pos_w");
            let n = order.len();
            assert_eq!(shape, [76, n as u64, 3]);
            assert_eq!(array(bytes, "body_quat_w").0, [76, n as u64, 4]);
            let (shape, joint_pos) = array(bytes, "joint_pos");
            assert_eq!(shape, [76, robot.state_dim() as u64]);
            assert!(joint_pos.iter().all(|v| v.is_finite()));
            // Every fifth row lies on every second frame of the take.
            for (f, row) in reached(&take).iter().enumerate().step_by(2) {
                let at = f / 2 * 5;
                for (column, &body) in order.iter().enumerate() {
                    let found = &pos[3 * (at * n + column)..][..3];
                    let want = row[body].pos;
                    let off = (0..3).map(|k| (f64::from(found[k]) - want[k]).abs());
                    assert!(off.fold(0.0, f64::max) < 1e-5, "{id} frame {f} body {body}");
                }
            }
            let fps: Vec<i64> = {
                let mut zip = zip::ZipArchive::new(Cursor::new(bytes)).unwrap();
                let mut raw = Vec::new();
                zip.by_name("fps.npy").unwrap().read_to_end(&mut raw).unwrap();
                let npy = npyz::NpyFile::new(&raw[..]).unwrap();
                npy.into_vec().unwrap()
            };
            assert_eq!(fps, [50]);
        }
    }

    /// Integrated over time, velocities lead from the first pose to the last.
    #[test]
    fn velocities_are_those_of_the_poses() {
        let (robot, take) = sample::take("ur5e", 31, 31);
        let export = tracking(&take, &robot, 50, Bodies::Mujoco).unwrap();
        let bytes = &export.files[0].bytes;
        let ((shape, pos), (_, vel)) = (array(bytes, "body_pos_w"), array(bytes, "body_lin_vel_w"));
        let (rows, width) = (shape[0] as usize, shape[1] as usize * 3);
        for column in 0..width {
            let mut sum = pos[column];
            for r in 1..rows {
                sum += 0.01 * (vel[(r - 1) * width + column] + vel[r * width + column]);
            }
            let last = pos[(rows - 1) * width + column];
            assert!((sum - last).abs() < 2e-3, "column {column}: {sum} {last}");
        }
    }
}
