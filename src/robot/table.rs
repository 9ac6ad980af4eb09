//! The robot as clips see it: plain facts without a simulator.

use crate::clip;

use super::{Coupling, Robot};

impl Robot {
    /// Names, units, limits, speeds, mirror and couplings for [`crate::clip`]. Its rest pose
    /// is the home pose; what a policy can leave open is the caller's to set.
    pub fn joint_table(&self) -> clip::JointTable {
        let profile = self.profile();
        let joints = profile
            .joints
            .iter()
            .map(|j| clip::JointFacts {
                name: j.name.clone(),
                unit: j.unit,
                range: j.range,
                speed_max: Some(j.speed_limit),
            })
            .collect();
        let mirror = match self.mirror_reason() {
            Some(reason) => clip::Mirror::None(reason.to_owned()),
            None => clip::Mirror::Table(profile.mirror.table.iter().map(mirror_row).collect()),
        };
        clip::JointTable {
            robot: self.id().to_owned(),
            model_sha256: Some(self.model_sha256().to_owned()),
            joints,
            rest: self.home(),
            mirror,
            couplings: profile
                .couplings
                .iter()
                .map(|c| coupling(c, profile.settle.tolerance))
                .collect(),
            granularity: clip::Granularity::default(),
        }
    }
}

fn mirror_row(row: &super::MirrorRow) -> clip::MirrorRow {
    clip::MirrorRow {
        target: row.target.clone(),
        source: row.source.clone(),
        sign: row.sign,
        offset: row.offset,
    }
}

fn coupling(c: &Coupling, tolerance: f64) -> clip::Coupling {
    let member = |joint: &str, coef: f64, offset: f64| clip::CouplingMember {
        joint: joint.to_owned(),
        coef,
        offset,
    };
    match c {
        // One force pulls all members; at rest they share it in the ratio of their
        // coefficients, since they have the same stiffness: none.
        Coupling::Tendon { name, joints, coefs, .. } => clip::Coupling {
            name: name.clone(),
            members: joints.iter().zip(coefs).map(|(j, c)| member(j, *c, 0.0)).collect(),
            tolerance,
        },
        Coupling::Mimic { follower, leader, offset, multiplier } => clip::Coupling {
            name: leader.clone(),
            members: vec![member(leader, 1.0, 0.0), member(follower, *multiplier, *offset)],
            tolerance,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hand_as_clips_see_it() {
        let t = Robot::builtin("shadow_hand").unwrap().joint_table();
        assert_eq!((t.joints.len(), t.couplings.len()), (22, 4));
        assert!(matches!(t.mirror, clip::Mirror::None(_)));
        assert_eq!(t.rest, [0.0; 22]);
        assert_eq!(t.model_sha256.as_ref().map(String::len), Some(64));
        let arm = Robot::builtin("ur5e").unwrap().joint_table();
        assert!(matches!(&arm.mirror, clip::Mirror::Table(rows) if rows.len() == 2));
        assert_eq!(arm.joints[0].speed_max, Some(1.5));
        assert_eq!(Robot::builtin("pointmass").unwrap().joint_table().joints[0].range, None);
    }
}
