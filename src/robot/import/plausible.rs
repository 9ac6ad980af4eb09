//! Checks whether the motors can carry the robot.

use std::sync::Arc;

use super::draft::Draft;
use crate::Error;
use crate::derive::torque_limit;
use crate::golden::spread_model;
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
    for (j, load) in loads(model)?.into_iter().enumerate() {
        let Some(limit) = torque_limit(model, j) else { continue };
        let mut asked = load.weights;
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
        "{} of {} motors cannot hold the robot of {mass:.1} kg up in most poses (N m or N): {}{}; check \
         masses, units, and the motors' limits in the file",
        weak.len(),
        model.nu(),
        named.join(", "),
        if weak.len() > NAMED { ", …" } else { "" }
    ));
    Ok(())
}

/// What the motor of one joint must hold and accelerate.
#[derive(Clone, Default)]
pub(super) struct Load {
    /// The torque that holds the joint against gravity and springs, by pose, N m or N.
    pub(super) weights: Vec<f64>,
    /// The greatest inertia about the joint over the poses, kg m^2 or kg.
    pub(super) inertia: f64,
}

/// The loads of all joints, at the default pose and at poses over the range.
///
/// # Errors
/// [`Error::Simulator`].
pub(super) fn loads(model: &Model) -> Result<Vec<Load>, Error> {
    let mut free = model.duplicate()?;
    free.set_contacts(false);
    let mut data = Data::new(&Arc::new(free))?;
    let joints = model.jnt_type().len();
    let mut loads = vec![Load::default(); joints];
    let mut mass = vec![0.0; model.nv() * model.nv()];
    for k in 0..=POSES {
        let qpos = match k {
            0 => model.qpos0().to_vec(),
            _ => spread_model(model, k - 1, 0.0),
        };
        data.reset()?;
        data.set_qpos(&qpos)?;
        data.forward()?;
        data.full_mass(&mut mass)?;
        for (j, load) in loads.iter_mut().enumerate() {
            let dof = model.jnt_dofadr()[j] as usize;
            load.weights.push((data.qfrc_bias()[dof] - data.qfrc_passive()[dof]).abs());
            load.inertia = load.inertia.max(mass[dof * model.nv() + dof]);
        }
    }
    Ok(loads)
}
