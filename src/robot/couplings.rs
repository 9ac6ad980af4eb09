//! Couplings of a compiled model: the joints that one actuator moves together.

use std::sync::Arc;

use nalgebra::DMatrix;

use super::error::Error;
use super::profile::Coupling;
use super::tendons::{tendon_joints, tendon_name};
use super::ties::{Tie, ties};
use robert_mujoco::{Data, Kind, Model, index};

/// Joints that one actuator moves together: those of a tendon, and of an equality. With `only_tied`
/// tendons are left out whose joints other actuators set apart.
pub(super) fn couplings(model: &Model, only_tied: bool) -> Result<Vec<Coupling>, Error> {
    let joint_name = |j: usize| model.name(Kind::Joint, j).unwrap_or_default().to_owned();
    let mut found = Vec::new();
    let arms = (only_tied && model.ntendon() > 0).then(|| MomentArms::of(model)).transpose()?;
    for t in 0..model.ntendon() {
        let members = tendon_joints(model, t);
        if members.len() < 2 || arms.as_ref().is_some_and(|a| a.moves_each(&members)) {
            continue;
        }
        let limited = model.tendon_limited().get(t).is_some_and(|l| *l != 0);
        let range = model.tendon_range().get(2 * t..2 * t + 2);
        found.push(Coupling::Tendon {
            name: tendon_name(model, t),
            joints: members.iter().map(|(j, _)| joint_name(*j)).collect(),
            coefs: members.iter().map(|(_, c)| *c).collect(),
            range: range.filter(|_| limited).and_then(|r| r.try_into().ok()),
        });
    }
    for Tie { follower, leader, polynomial: [offset, multiplier, curve @ ..] } in ties(model) {
        if curve == [0.0; 3] {
            found.push(Coupling::Mimic {
                follower: joint_name(follower),
                leader: joint_name(leader),
                offset,
                multiplier,
            });
        }
    }
    Ok(found)
}

/// How far the actuators pull at each joint in the model's first pose; (nu, nv).
struct MomentArms {
    moments: DMatrix<f64>,
    dofs: Vec<usize>,
}

impl MomentArms {
    /// The smallest singular value of normalised moments that counts as a direction of its own.
    const LEAST: f64 = 1e-3;

    fn of(model: &Model) -> Result<MomentArms, Error> {
        let mut data = Data::new(&Arc::new(model.duplicate()?))?;
        data.forward()?;
        let (nu, nv) = (model.nu(), model.nv());
        let mut moments = DMatrix::from_row_slice(nu, nv, data.actuator_moment());
        for mut row in moments.row_iter_mut() {
            let norm = row.norm();
            if norm > 0.0 {
                row /= norm;
            }
        }
        Ok(MomentArms { moments, dofs: model.jnt_dofadr().iter().map(|a| index(*a)).collect() })
    }

    /// Whether the actuators move each of these joints by itself, as the two motors of a differential
    /// do.
    fn moves_each(&self, members: &[(usize, f64)]) -> bool {
        if self.moments.nrows() < members.len() || !self.moments.iter().all(|m| m.is_finite()) {
            return false;
        }
        let columns = members.iter().map(|(j, _)| self.moments.column(self.dofs[*j]));
        let own = DMatrix::from_columns(&columns.collect::<Vec<_>>());
        own.rank(MomentArms::LEAST) == members.len()
    }
}
