//! Checks whether the motors can carry the robot.

use std::sync::Arc;

use super::draft::Draft;
use crate::Error;
use crate::derive::torque_limit;
use crate::golden::spread;
use robert_mujoco::{Data, Kind, Model};

/// Poses beside the default one.
const POSES: usize = 8;
/// Joints that a warning names.
const NAMED: usize = 4;

/// Warns of motors that are too weak against gravity in most poses.
///
/// # Errors
/// [`Error::Simulator`].
pub(super) fn check(draft: &mut Draft, model: &Arc<Model>) -> Result<(), Error> {
    let mut weak = Vec::new();
    for (j, mut asked) in weights(model)?.into_iter().enumerate() {
        let Some(limit) = torque_limit(model, j) else { continue };
        asked.sort_by(f64::total_cmp);
        let median = asked[asked.len() / 2];
        if median > limit {
            weak.push((median / limit, j, median, limit));
        }
    }
    if weak.is_empty() {
        return Ok(());
    }
    weak.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mass: f64 = model.body_mass().iter().sum();
    let named: Vec<String> = weak
        .iter()
        .take(NAMED)
        .map(|(_, j, asked, limit)| {
            let name = model.name(Kind::Joint, *j).unwrap_or_default();
            format!("\"{name}\" needs {asked:.1} and has {limit:.1}")
        })
        .collect();
    draft.warnings.push(format!(
        "{} motors cannot hold the robot of {mass:.1} kg up in most poses (N m or N): {}{}; check \
         masses and units, or --effort",
        weak.len(),
        named.join(", "),
        if weak.len() > NAMED { ", …" } else { "" }
    ));
    Ok(())
}

/// The torque that holds each joint against gravity and springs, at the default pose and at poses
/// over the range, N m or N: (joints, poses).
///
/// # Errors
/// [`Error::Simulator`].
pub(super) fn weights(model: &Model) -> Result<Vec<Vec<f64>>, Error> {
    let mut free = model.duplicate()?;
    free.set_contacts(false);
    let mut data = Data::new(&Arc::new(free))?;
    let joints = model.jnt_type().len();
    let mut asked = vec![Vec::new(); joints];
    for k in 0..=POSES {
        let mut qpos = model.qpos0().to_vec();
        for j in (0..joints).filter(|j| k > 0 && model.jnt_limited()[*j] != 0) {
            let range = [model.jnt_range()[2 * j], model.jnt_range()[2 * j + 1]];
            qpos[model.jnt_qposadr()[j] as usize] = spread(j, k - 1, range);
        }
        data.reset()?;
        data.set_qpos(&qpos)?;
        data.forward()?;
        for (j, asked) in asked.iter_mut().enumerate() {
            let dof = model.jnt_dofadr()[j] as usize;
            asked.push((data.qfrc_bias()[dof] - data.qfrc_passive()[dof]).abs());
        }
    }
    Ok(asked)
}
