//! Couplings of a compiled model: the joints that one actuator moves together.

use std::sync::Arc;

use nalgebra::DMatrix;

use super::error::Error;
use super::profile::Coupling;
use super::tendons::{tendon_joints, tendon_name};
use super::ties::{Tie, joint_ties, ties};
use robert_mujoco::{Data, Kind, Model, Transmission, index};

/// Joints that one actuator moves together: those of its tendon, and of an equality.
pub(super) fn couplings(model: &Model) -> Result<Vec<Coupling>, Error> {
    let arms = (model.ntendon() > 0).then(|| MomentArms::of(model)).transpose()?;
    let pulled =
        |t: usize| (0..model.nu()).any(|a| model.transmission(a) == Some(Transmission::Tendon(t)));
    let apart = |members: &[_]| arms.as_ref().is_some_and(|arms| arms.moves_each(members));
    let tendons = tendons(model).filter(|(t, members)| pulled(*t) && !apart(members));
    Ok(tendons
        .map(|(t, members)| tendon(model, t, &members))
        .chain(mimics(model, ties(model)))
        .collect())
}

/// What older versions took for couplings, from the oldest: every tendon, and tendons whose joints no other
/// actuators set apart.
pub(super) fn older(model: &Model) -> Result<[Vec<Coupling>; 2], Error> {
    let arms = (model.ntendon() > 0).then(|| MomentArms::of(model)).transpose()?;
    let tied = |members: &[_]| !arms.as_ref().is_some_and(|arms| arms.moves_each(members));
    let list = |only_tied: bool| -> Vec<Coupling> {
        let tendons = tendons(model).filter(|(_, members)| !only_tied || tied(members));
        let tendons = tendons.map(|(t, members)| tendon(model, t, &members));
        tendons.chain(mimics(model, joint_ties(model))).collect()
    };
    Ok([list(false), list(true)])
}

/// The tendons of several joints.
fn tendons(model: &Model) -> impl Iterator<Item = (usize, Vec<(usize, f64)>)> {
    let all = (0..model.ntendon()).map(|t| (t, tendon_joints(model, t)));
    all.filter(|(_, members)| members.len() > 1)
}

fn joint_name(model: &Model, joint: usize) -> String {
    model.name(Kind::Joint, joint).unwrap_or_default().to_owned()
}

fn tendon(model: &Model, t: usize, members: &[(usize, f64)]) -> Coupling {
    let limited = model.tendon_limited().get(t).is_some_and(|l| *l != 0);
    let range = model.tendon_range().get(2 * t..2 * t + 2);
    Coupling::Tendon {
        name: tendon_name(model, t),
        joints: members.iter().map(|(j, _)| joint_name(model, *j)).collect(),
        coefs: members.iter().map(|(_, c)| *c).collect(),
        range: range.filter(|_| limited).and_then(|r| r.try_into().ok()),
    }
}

fn mimics(model: &Model, ties: Vec<Tie>) -> impl Iterator<Item = Coupling> {
    let straight = ties.into_iter().filter(|tie| tie.polynomial[2..] == [0.0; 3]);
    straight.map(|Tie { follower, leader, polynomial: [offset, multiplier, ..] }| Coupling::Mimic {
        follower: joint_name(model, follower),
        leader: joint_name(model, leader),
        offset,
        multiplier,
    })
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
