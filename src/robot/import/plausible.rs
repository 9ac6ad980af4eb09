//! Checks whether the motors fit the robot: strong enough to carry it, and no placeholders; and whether
//! the robot has shapes.

use std::sync::Arc;

use super::draft::Draft;
use crate::Error;
use crate::derive::digits;
use crate::golden::spread_model;
use crate::motors::torque_limit;
use crate::ties::{carried, ties};
use robert_mujoco::{Data, Joint, Kind, Model};

/// Poses beside the default one.
const POSES: usize = 8;
/// A motor's limit that is this many times what the most loaded joint needs is a placeholder.
const ABSURD: f64 = 100.0;
/// So is one that is this many times what its own joint needs, and [`OTHERS`] times the usual limit.
const ABSURD_ALONE: f64 = 1000.0;
const OTHERS: f64 = 10.0;
/// A limit below this is none, N m or N: a gripper needs force beyond what carries it.
const USUAL: f64 = 300.0;
/// A limit that is this many times what the most loaded joint needs is one from [`LEAST`] on.
const HUGE: f64 = 10_000.0;
const LEAST: f64 = 10.0;
/// A robot that weighs more was not written in kilograms, or with the densities of its materials, kg.
const HEAVY: f64 = 20_000.0;
/// Force limit relative to the greatest weight that a motor carries in some pose.
const RESERVE: f64 = 2.5;
/// The acceleration that a motor reaches if it carries no weight, rad/s^2 or m/s^2. The first joint
/// of an arm, for example, turns the whole arm about a vertical axis.
const ACCELERATION: f64 = 5.0;
/// Joints that a warning names.
const NAMED: usize = 4;

/// A body that is farther from its parent was written in millimetres, m.
const FAR: f64 = 30.0;

/// Warns of motors that are too weak against gravity in most poses, of limits far above what any joint
/// of the robot could need, of a robot without shapes, and of lengths in millimetres.
///
/// # Errors
/// [`Error::Simulator`].
pub(super) fn check(draft: &mut Draft, model: &Arc<Model>) -> Result<(), Error> {
    if (0..model.ngeom()).all(|g| model.geom_bodyid()[g] == 0) {
        draft.warnings.push(
            "the robot has no shapes: pictures show nothing of it, and nothing touches it"
                .to_owned(),
        );
    }
    let inside = |b: &usize| model.body_parentid()[*b] != 0;
    let far =
        (1..model.nbody()).filter(inside).map(|b| (b, length(&model.body_pos()[3 * b..3 * b + 3])));
    if let Some((body, m)) = far.filter(|(_, m)| *m > FAR).max_by(|a, b| a.1.total_cmp(&b.1)) {
        let name = model.name(Kind::Body, body).unwrap_or_default();
        draft.warnings.push(format!(
            "the body \"{name}\" is {} m away from its parent: lengths are in metres; if the file has millimetres, \
             divide them by 1000",
            digits(m, 3)
        ));
    }
    let loads = loads(model)?;
    let most = |slides: bool| {
        let like = |j: &usize| (model.joint_type(*j) == Some(Joint::Slide)) == slides;
        (0..loads.len()).filter(like).map(|j| loads[j].without_drive().effort()).fold(0.0, f64::max)
    };
    let most = [most(false), most(true)];
    let mut limits: Vec<f64> =
        (0..loads.len()).filter_map(|j| torque_limit(model, j)).filter(|l| l.is_finite()).collect();
    limits.sort_by(f64::total_cmp);
    let usual = limits.get(limits.len().saturating_sub(1) / 2).copied().unwrap_or(f64::INFINITY);
    let driven = limits.len();
    let (mut weak, mut absurd, mut rubbing) = (Vec::new(), Vec::new(), Vec::new());
    for (j, load) in loads.iter().enumerate() {
        let Some(limit) = torque_limit(model, j) else { continue };
        let (median, own) = (load.usual_weight(), load.without_drive().effort());
        let most = most[usize::from(model.joint_type(j) == Some(Joint::Slide))];
        let friction = model.dof_frictionloss()[model.jnt_dofadr()[j] as usize];
        if friction > 0.0 && friction >= limit {
            rubbing.push(Unfit { joint: j, asked: friction, limit });
        } else if median > limit {
            weak.push(Unfit { joint: j, asked: median, limit });
        } else if limit > (ABSURD * most).max(USUAL) || limit > (HUGE * most).max(LEAST) {
            absurd.push(Unfit { joint: j, asked: most, limit });
        } else if limit > (ABSURD_ALONE * own).max(OTHERS * usual).max(USUAL) {
            absurd.push(Unfit { joint: j, asked: own, limit });
        }
    }
    let mass = model.moving_mass();
    if mass > HEAVY {
        draft.warnings.push(format!(
            "the robot's moving parts weigh {mass:.0} kg: check the masses in the file (kg) and its densities (kg/m^3)"
        ));
    }
    if !weak.is_empty() {
        draft.warnings.push(format!(
            "the motors of {} of {driven} joints with a torque limit cannot hold the robot of {mass:.1} kg up in \
             most poses (N m or N): {}; check masses, units, and the motors' limits in the file",
            weak.len(),
            list(model, weak)
        ));
    }
    if !rubbing.is_empty() {
        draft.warnings.push(format!(
            "the motors of {} of {driven} joints with a torque limit are weaker than dry friction and do not move \
             them (N m or N): {}; check friction and limits in the file",
            rubbing.len(),
            list(model, rubbing)
        ));
    }
    if !absurd.is_empty() {
        draft.warnings.push(format!(
            "the motors of {} of {driven} joints with a torque limit have far more than the force that moves them, \
             in this robot of {mass:.3} kg (N m or N): {}; if these limits are \
             placeholders, write the real ones into the file, because a drive that the file leaves out is \
             modelled in proportion",
            absurd.len(),
            list(model, absurd)
        ));
    }
    Ok(())
}

fn length(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// A motor whose limit does not fit.
struct Unfit {
    joint: usize,
    /// What the joint needs, N m or N.
    asked: f64,
    limit: f64,
}

/// The worst of them in words.
fn list(model: &Model, mut unfit: Vec<Unfit>) -> String {
    // A limit of 0 is the worst.
    let off = |u: &Unfit| (u.asked / u.limit.max(f64::MIN_POSITIVE)).ln().abs();
    unfit.sort_by(|a, b| off(b).total_cmp(&off(a)));
    let named = unfit.iter().take(NAMED).map(|u| {
        let name = model.name(Kind::Joint, u.joint).unwrap_or_default();
        let [asked, limit] = [u.asked, u.limit].map(|x| digits(x, 4));
        format!("\"{name}\" has {limit} for {asked}")
    });
    let more = if unfit.len() > NAMED { ", …" } else { "" };
    named.collect::<Vec<_>>().join(", ") + more
}

/// What the motor of one joint must hold and accelerate.
#[derive(Clone, Default)]
pub(super) struct Load {
    /// The torque that holds the joint against gravity and springs, by pose, N m or N.
    pub(super) weights: Vec<f64>,
    /// The greatest inertia about the joint over the poses, kg m^2 or kg.
    pub(super) inertia: f64,
    /// The part of it that the motor's rotor has.
    rotor: f64,
    /// Dry friction, and damping at a rad/s or m/s, N m or N.
    friction: f64,
}

impl Load {
    /// The torque that holds the joint in most poses, N m or N.
    pub(super) fn usual_weight(&self) -> f64 {
        let mut weights = self.weights.clone();
        weights.sort_by(f64::total_cmp);
        weights[weights.len() / 2]
    }

    /// A force limit that carries and moves the joint, N m or N.
    pub(super) fn effort(&self) -> f64 {
        let weight = self.weights.iter().copied().fold(0.0, f64::max);
        (RESERVE * weight).max(ACCELERATION * self.inertia) + self.friction
    }

    fn without_drive(&self) -> Load {
        Load { inertia: self.inertia - self.rotor, rotor: 0.0, friction: 0.0, ..self.clone() }
    }
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
    let ties = ties(model);
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
        let dofs = model.jnt_dofadr().iter().map(|dof| *dof as usize);
        let mut held: Vec<f64> =
            dofs.map(|dof| data.qfrc_bias()[dof] - data.qfrc_passive()[dof]).collect();
        // A motor carries what moves with its joint, too.
        let alone = held.clone();
        for (j, held) in held.iter_mut().enumerate() {
            let with = carried(&ties, j);
            *held += with.iter().map(|(other, slope)| slope * alone[*other]).sum::<f64>();
        }
        for (j, load) in loads.iter_mut().enumerate() {
            let dof = model.jnt_dofadr()[j] as usize;
            load.weights.push(held[j].abs());
            load.inertia = load.inertia.max(mass[dof * model.nv() + dof]);
            load.rotor = model.dof_armature()[dof];
            load.friction = model.dof_frictionloss()[dof] + model.dof_damping()[dof];
        }
    }
    Ok(loads)
}
