//! The robot's tree of bodies as plain data, from the compiled model.

use robert_kinematics::{
    Anchor, Closure, Follow, JointAxis, JointMotion, Kinematics, LinkFrame, Share, SiteFrame,
};
use robert_mujoco::{Joint, Kind, Model, index};

use super::profile::{Coupling, Profile};
use super::rings::{CONNECT, WELD};
use super::{Robot, StateJoint};

impl Robot {
    /// The tree of bodies on joints, for places and inverse kinematics without the simulator.
    pub fn kinematics(&self) -> &Kinematics {
        self.kinematics.get_or_init(|| tree(self.model(), self.profile(), self.joints()))
    }
}

/// The tree of a model whose joints are the state.
fn tree(model: &Model, profile: &Profile, joints: &[StateJoint]) -> Kinematics {
    let link = |body: usize| LinkFrame {
        name: model.name(Kind::Body, body).unwrap_or_default().to_owned(),
        parent: index(model.body_parentid()[body]),
        pos: of(model.body_pos(), body),
        quat: of(model.body_quat(), body),
        joints: {
            // A body without joints has address -1.
            let count = index(model.body_jntnum()[body]);
            let first = if count == 0 { 0 } else { index(model.body_jntadr()[body]) };
            (first..first + count).collect()
        },
    };
    let axis = |joint: &StateJoint| JointAxis {
        motion: match model.joint_type(joint.id) {
            Some(Joint::Slide) => JointMotion::Slide,
            _ => JointMotion::Hinge,
        },
        pos: of(model.jnt_pos(), joint.id),
        axis: of(model.jnt_axis(), joint.id),
        reference: model.qpos0()[joint.qposadr],
        range: (!joint.unbounded).then_some(joint.range),
        follows: follow(&joint.name, profile, joints),
    };
    let site = |site: usize| {
        Some(SiteFrame {
            name: model.name(Kind::Site, site)?.to_owned(),
            link: index(model.site_bodyid()[site]),
            pos: of(model.site_pos(), site),
            quat: of(model.site_quat(), site),
        })
    };
    Kinematics {
        links: (0..model.nbody()).map(link).collect(),
        joints: joints.iter().map(axis).collect(),
        sites: (0..model.nsite()).filter_map(site).collect(),
        closures: (0..model.neq()).filter_map(|eq| closure(model, eq)).collect(),
        tendons: profile.couplings.iter().filter_map(|c| shares(c, joints)).collect(),
    }
}

/// The loop that an equality constraint closes, if it holds two bodies together.
fn closure(model: &Model, eq: usize) -> Option<Closure> {
    let data: [f64; 11] = of(model.eq_data(), eq);
    let part = |from: usize| [data[from], data[from + 1], data[from + 2]];
    let upright = [1.0, 0.0, 0.0, 0.0];
    // A point of each body; of a weld the second body's comes first, then the place of its frame in the first body.
    let kind = model.eq_type()[eq];
    let (first, turn, second) = match kind {
        CONNECT => (part(0), upright, part(3)),
        WELD => (part(3), [data[6], data[7], data[8], data[9]], part(0)),
        _ => return None,
    };
    let body = |ids: &[i32]| index(ids[eq]);
    let ends = [
        Anchor { link: body(model.eq_obj1id()), pos: first, quat: turn },
        Anchor { link: body(model.eq_obj2id()), pos: second, quat: upright },
    ];
    // The last number of a weld weighs its torques against its forces; without any it is a point.
    let turns = kind == WELD && data[10] != 0.0;
    (model.eq_active()[eq] != 0).then_some(Closure { ends, turns })
}

/// The joints of a tendon.
fn shares(coupling: &Coupling, joints: &[StateJoint]) -> Option<Vec<Share>> {
    let Coupling::Tendon { joints: names, coefs, .. } = coupling else { return None };
    let share = |(name, factor): (&String, &f64)| {
        let joint = joints.iter().position(|j| &j.name == name)?;
        (*factor != 0.0).then_some(Share { joint, factor: *factor })
    };
    names.iter().zip(coefs).map(share).collect()
}

/// The joint that this one follows.
fn follow(name: &str, profile: &Profile, joints: &[StateJoint]) -> Option<Follow> {
    profile.couplings.iter().find_map(|coupling| match coupling {
        Coupling::Mimic { follower, leader, offset, multiplier } if follower == name => {
            let leader = joints.iter().position(|j| &j.name == leader)?;
            Some(Follow { leader, offset: *offset, multiplier: *multiplier })
        }
        _ => None,
    })
}

/// The `N` numbers of item `i`.
fn of<const N: usize>(all: &[f64], i: usize) -> [f64; N] {
    all.as_chunks::<N>().0[i]
}
