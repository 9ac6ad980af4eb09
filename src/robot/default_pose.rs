//! The pose of a model in which rollouts begin, as coordinates of the simulator.

use robert_mujoco::{Joint, Model, index};

/// The first keyframe, or the reference pose of a model without keyframes; (nq). A joint beyond its stops is put at
/// the nearer one, because links may overlap beyond it. A home pose is made of it, with joints that follow others where
/// their leaders put them ([`crate::derive`]).
pub(crate) fn default_pose(model: &Model) -> Vec<f64> {
    let first = model.key_qpos().get(..model.nq()).filter(|key| !key.is_empty());
    let mut qpos = first.unwrap_or(model.qpos0()).to_vec();
    let joints = model.jnt_limited().iter().zip(model.jnt_range().chunks_exact(2));
    for (j, (limited, range)) in joints.enumerate() {
        let one = matches!(model.joint_type(j), Some(Joint::Hinge | Joint::Slide));
        if one && *limited != 0 && range[0] <= range[1] {
            let q = &mut qpos[index(model.jnt_qposadr()[j])];
            *q = q.clamp(range[0], range[1]);
        }
    }
    qpos
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joints_beyond_their_stops_stand_at_these() {
        let with = |keys: &str| {
            let model = Model::from_xml(&format!(
                r#"<mujoco><compiler angle="radian" autolimits="true"/><worldbody><body><freejoint/><geom size=".1"/>
                <body><joint name="a" range=".5 2"/><geom size=".1"/></body>
                <body><joint name="b" range="-1 2"/><geom size=".1"/></body>
                <body><joint name="c" type="slide"/><geom size=".1"/></body></body></worldbody>{keys}</mujoco>"#
            ));
            default_pose(&model.unwrap())[7..].to_vec()
        };
        assert_eq!(with(""), [0.5, 0.0, 0.0]);
        let key = r#"<keyframe><key qpos="0 0 0 1 0 0 0 3 -.5 .1"/><key qpos="0 0 0 1 0 0 0 1 1 1"/></keyframe>"#;
        assert_eq!(with(key), [2.0, -0.5, 0.1]);
    }
}
