//! What steps of 5 ms do not bear in servos, and how joints change so that they do.
//!
//! The simulator integrates the damping of joints implicitly, but damping and stiffness of servos
//! explicitly. It diverges where a servo takes more than its speed from a joint within a step, and
//! where a servo swings a joint faster than the steps can follow. Such damping becomes that of the
//! joint, unless its force limit would make the servo slow, and such joints get armature. Both depend on the pose: two links that fold onto each other
//! can turn their common joint almost without inertia. Servos at tendons are left as they are.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use nalgebra::DMatrix;

use crate::Error;
use crate::derive::digits;
use crate::golden::spread_model;
use crate::law::Law;
use robert_base::units::SIM_DT;
use robert_mujoco::{Data, Joint, Model, Transmission};

/// The share of its speed that a servo may remove from a joint in a step.
const LARGEST_SHARE: f64 = 0.5;
/// The phase by which a servo may swing a joint in a step, rad. The limit of the integrator is 2
/// for a joint by itself, and less if several swing together.
const SWING: f64 = 1.0;
/// The speed that a servo must reach with its damping in the joint, rad/s and m/s. A servo's own damping is part of
/// its force and ends with its limit; that of a joint does not, and would slow it down.
const FAST: [f64; 2] = [3.0, 1.0];
/// Share of the largest inertia that is added to all where the inverse does not exist.
const SINGULAR: f64 = 1e-9;
/// The number of digits of a written armature.
const DIGITS: i32 = 3;
/// Poses besides that of the file.
const POSES: usize = 16;
/// Range of an unbounded joint around its place in the file: rad or m.
const UNBOUNDED: f64 = 1.5;

/// The changes that a model needs.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Bearable {
    /// Actuators whose damping must move to their joint.
    pub(super) moved: BTreeSet<usize>,
    /// The new damping of these joints.
    pub(super) damping: BTreeMap<usize, f64>,
    /// The new armature of joints.
    pub(super) armature: BTreeMap<usize, f64>,
}

/// All actuators of a joint together.
#[derive(Default)]
struct Together {
    damping: f64,
    stiffness: f64,
    /// The largest force of those that damp it, N m or N.
    force: f64,
    /// Those that damp it.
    damps: Vec<usize>,
}

impl Bearable {
    /// The changes for the actuators with these laws and these largest forces at their joints, N m or N.
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub(super) fn of(
        laws: &[Option<Law>],
        forces: &[f64],
        model: &Arc<Model>,
    ) -> Result<Bearable, Error> {
        let mut all = Bearable::default();
        if laws.iter().flatten().all(Law::is_motor) {
            return Ok(all);
        }
        let mut least = least_inertias(model)?;
        let mut joints: BTreeMap<usize, Together> = BTreeMap::new();
        for (a, (law, force)) in laws.iter().zip(forces).enumerate() {
            let (Some(law), Some(Transmission::Joint(joint))) = (law, model.transmission(a)) else {
                continue;
            };
            let square = model.actuator_gear()[6 * a].powi(2);
            let all = joints.entry(joint).or_default();
            all.damping -= square * law.bias[2];
            all.stiffness -= square * law.bias[1];
            if law.bias[2] != 0.0 {
                all.damps.push(a);
                all.force += force;
            }
        }
        for (joint, Together { damping, stiffness, force, damps }) in joints {
            let dof = model.jnt_dofadr()[joint] as usize;
            let fast = FAST[usize::from(model.joint_type(joint) == Some(Joint::Slide))];
            let mut needed = (SIM_DT / SWING).powi(2) * stiffness;
            if SIM_DT * damping > LARGEST_SHARE * least[dof] {
                if force >= fast * damping {
                    all.damping.insert(joint, model.dof_damping()[dof] + damping);
                    least[dof] += SIM_DT * damping;
                    all.moved.extend(damps);
                } else {
                    needed = needed.max(SIM_DT * damping / LARGEST_SHARE);
                }
            }
            if needed > least[dof] {
                let armature = model.dof_armature()[dof] + needed - least[dof];
                all.armature.insert(joint, digits(armature, DIGITS));
            }
        }
        Ok(all)
    }

    /// Whether nothing changes.
    pub(super) fn is_empty(&self) -> bool {
        *self == Bearable::default()
    }
}

/// The smallest inertia that a degree of freedom shows a fast force, with all others free to move,
/// in the pose of the file and others across the ranges; (nv). It includes what a step of its
/// damping adds.
fn least_inertias(model: &Arc<Model>) -> Result<Vec<f64>, Error> {
    let nv = model.nv();
    // Contacts take most of the time and change no inertia.
    let mut free = model.duplicate()?;
    free.set_contacts(false);
    let mut data = Data::new(&Arc::new(free))?;
    let mut least = vec![f64::INFINITY; nv];
    let mut mass = vec![0.0; nv * nv];
    for pose in 0..=POSES {
        let qpos = match pose {
            POSES => model.qpos0().to_vec(),
            _ => spread_model(model, pose, UNBOUNDED),
        };
        data.reset()?;
        data.set_qpos(&qpos)?;
        data.forward()?;
        data.full_mass(&mut mass)?;
        let damped = DMatrix::from_fn(nv, nv, |r, c| {
            let own = if r == c { SIM_DT * model.dof_damping()[r] } else { 0.0 };
            mass[r * nv + c] + own
        });
        // Joints that share an axis can move against each other without any inertia.
        let some = SINGULAR * damped.diagonal().amax();
        let mobility = damped
            .clone()
            .try_inverse()
            .or_else(|| (damped + DMatrix::from_diagonal_element(nv, nv, some)).try_inverse());
        for (dof, least) in least.iter_mut().enumerate() {
            let here = mobility.as_ref().map_or(0.0, |mobility| mobility[(dof, dof)].recip());
            *least = least.min(if here > 0.0 { here } else { 0.0 });
        }
    }
    Ok(least)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two links in a row: a slow force turns both, a fast one bends the joint between them.
    #[test]
    fn a_link_that_can_bend_is_lighter_than_its_inertia() {
        let link = r#"<inertial pos=".3 0 0" mass="1" diaginertia="1e-3 1e-3 1e-3"/>"#;
        let text = format!(
            r#"<mujoco><worldbody><body><joint name="a" axis="0 1 0"/>{link}
            <body pos=".3 0 0"><joint name="b" axis="0 1 0"/>{link}</body></body></worldbody>
            <actuator><motor joint="a"/><motor joint="a"/></actuator></mujoco>"#
        );
        let model = Arc::new(Model::from_xml(&text).unwrap());
        let least = least_inertias(&model).unwrap();
        assert!(4.0 * least[0] < model.dof_M0()[0], "{least:?} {:?}", model.dof_M0());
        let changes = |kp: f64, kv: f64| {
            let law = Law { gain: kp, bias: [0.0, -kp, -kv] };
            Bearable::of(&[Some(law)], &[f64::INFINITY], &model).unwrap()
        };
        // By its inertia alone, 45 N m s/rad would do.
        let moved = changes(80.0, 12.0);
        assert_eq!((moved.moved, moved.damping), ([0].into(), [(0, 12.0)].into()));
        assert!(changes(80.0, 1.0).is_empty());
        assert!(changes(0.0, 0.0).is_empty());
        // Two servos damp the joint together.
        let some = 0.6 * LARGEST_SHARE * least[0] / SIM_DT;
        let servo = || Some(Law { gain: 80.0, bias: [0.0, -80.0, -some] });
        assert!(changes(80.0, some).is_empty());
        let both = Bearable::of(&[servo(), servo()], &[f64::INFINITY; 2], &model).unwrap();
        assert_eq!((both.moved, both.damping), ([0, 1].into(), [(0, 2.0 * some)].into()));
        // With 30 N m it would reach 2.5 rad/s, so the joint becomes heavier instead.
        let law = Law { gain: 80.0, bias: [0.0, -80.0, -12.0] };
        let limited = |force| Bearable::of(&[Some(law)], &[force], &model).unwrap();
        assert!(limited(30.0).moved.is_empty() && limited(30.0).damping.is_empty());
        let missing = SIM_DT * 12.0 / LARGEST_SHARE - least[0];
        let given = limited(30.0).armature[&0];
        assert!((given / missing - 1.0).abs() < 1e-2, "{given} {missing}");
        assert_eq!(limited(36.0).damping, [(0, 12.0)].into());
        let stiff = changes(8000.0, 0.0);
        assert!(stiff.damping.is_empty());
        let missing = 8000.0 * SIM_DT * SIM_DT - least[0];
        assert!((stiff.armature[&0] / missing - 1.0).abs() < 1e-2, "{stiff:?} {missing}");
    }
}
