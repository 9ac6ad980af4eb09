//! NPZ motion files of BeyondMimic and mjlab: `joint_pos` and `fps`.

use std::io::{Cursor, Read as _};

use npyz::NpyFile;

use super::super::error::Error;
use super::samples::{Samples, foreign, rate};
use robert_base::limits;

/// Reads rows of a robot with these joints, in the order of the file's bodies. `fps` replaces the
/// rate in the file.
///
/// # Errors
/// [`Error::Foreign`].
pub fn from_tracking(bytes: &[u8], joints: &[String], fps: Option<f64>) -> Result<Samples, Error> {
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes))
        .map_err(|e| foreign(format!("this is no NPZ file: {e}")))?;
    let (shape, values) = array(&mut archive, "joint_pos")?;
    let width = joints.len();
    if shape.len() != 2 || shape[1] != width as u64 {
        return Err(foreign(format!("joint_pos is {shape:?}; (rows, {width}) is wanted")));
    }
    if shape[0] == 0 || shape[0] > u64::from(limits::CLIP_FRAMES) {
        return Err(foreign(format!("joint_pos has {} rows", shape[0])));
    }
    let fps = match fps {
        Some(fps) => fps,
        None => array(&mut archive, "fps")?
            .1
            .first()
            .copied()
            .ok_or_else(|| foreign("fps is empty; give --fps"))?,
    };
    let rows = values.chunks_exact(width).map(<[f64]>::to_vec).collect();
    Ok(Samples::steady(joints.to_vec(), rate(fps)?, rows))
}

/// One array as doubles, in C order.
fn array(
    archive: &mut zip::ZipArchive<Cursor<&[u8]>>,
    name: &str,
) -> Result<(Vec<u64>, Vec<f64>), Error> {
    let wrong = |e: &dyn std::fmt::Display| foreign(format!("{name}: {e}"));
    let mut file = archive.by_name(&format!("{name}.npy")).map_err(|e| wrong(&e))?;
    let mut raw = Vec::new();
    file.by_ref().take(limits::PROJECT_BYTES + 1).read_to_end(&mut raw).map_err(|e| wrong(&e))?;
    if raw.len() as u64 > limits::PROJECT_BYTES {
        return Err(wrong(&format!("more than {} bytes", limits::PROJECT_BYTES)));
    }
    let npy = NpyFile::new(&raw[..]).map_err(|e| wrong(&e))?;
    if npy.order() != npyz::Order::C {
        return Err(wrong(&"the order is Fortran's"));
    }
    let shape = npy.shape().to_vec();
    // The header may claim more than the file holds.
    let claimed = shape.iter().try_fold(1_u64, |n, s| n.checked_mul(*s));
    if claimed.is_none_or(|n| n > raw.len() as u64) {
        return Err(wrong(&format!("{shape:?} values in {} bytes", raw.len())));
    }
    let values = match npy.dtype().descr().trim_matches('\'') {
        "<f4" => npy.into_vec::<f32>().map(|v| wide(&v)),
        "<f8" => npy.into_vec::<f64>(),
        "<i8" => npy.into_vec::<i64>().map(|v| v.iter().map(|v| *v as f64).collect()),
        "<i4" => npy.into_vec::<i32>().map(|v| wide(&v)),
        other => return Err(wrong(&format!("numbers of type {other} are not read"))),
    };
    let values = values.map_err(|e| wrong(&e))?;
    if values.iter().any(|v| !v.is_finite()) {
        return Err(wrong(&"a value is no number"));
    }
    Ok((shape, values))
}

fn wide<T: Into<f64> + Copy>(values: &[T]) -> Vec<f64> {
    values.iter().map(|v| (*v).into()).collect()
}

#[cfg(test)]
mod tests {
    use super::super::super::export::{Bodies, tracking};
    use super::super::super::sample;
    use super::*;

    #[test]
    fn our_own_files_come_back() {
        let (robot, take) = sample::take("ur5e", 21, 21);
        let file = tracking(&take, &robot, 20, Bodies::Mujoco).unwrap().files.remove(0).bytes;
        let samples = from_tracking(&file, &take.robot.joints, None).unwrap();
        assert_eq!(samples.rows.len(), 21);
        for (f, row) in samples.rows.iter().enumerate() {
            assert!(row.iter().zip(take.state(f)).all(|(a, b)| (a - b).abs() < 1e-6));
        }
        let joints = &take.robot.joints[1..];
        let e = from_tracking(&file, joints, None).unwrap_err().to_string();
        assert!(e.contains("joint_pos is [21, 5]; (rows, 4) is wanted"), "{e}");
    }

    /// Every byte changed, every length cut: an error or a reading, never a panic.
    #[test]
    fn damaged_files_are_refused() {
        let (robot, take) = sample::take("pointmass", 8, 8);
        let file = tracking(&take, &robot, 20, Bodies::Mujoco).unwrap().files.remove(0).bytes;
        for at in 0..file.len() {
            let mut bad = file.clone();
            bad[at] ^= 0x41;
            from_tracking(&bad, &take.robot.joints, None).ok();
            from_tracking(&file[..at], &take.robot.joints, None).ok();
        }
    }
}
