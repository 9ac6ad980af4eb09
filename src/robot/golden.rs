//! Poses that cover the ranges evenly: multiples of the golden ratio modulo 1, with another factor
//! for each joint.

use robert_mujoco::Model;

/// Value of joint `joint` in pose `k`, within `[lo, hi]`.
pub(super) fn spread(joint: usize, k: usize, [lo, hi]: [f64; 2]) -> f64 {
    let golden = 0.618_033_988_749_895;
    let multiple = (golden * (joint + 1) as f64).fract();
    lo + (hi - lo) * (multiple * (k + 1) as f64).fract()
}

/// Positions (nq) in pose `k` of a model whose joints are hinges and slides. Joints without limits
/// stay within `room` of their place in the file, rad or m.
pub(super) fn spread_model(model: &Model, k: usize, room: f64) -> Vec<f64> {
    let mut qpos = model.qpos0().to_vec();
    for joint in 0..model.jnt_type().len() {
        let at = model.jnt_qposadr()[joint] as usize;
        let range = if model.jnt_limited()[joint] != 0 {
            [model.jnt_range()[2 * joint], model.jnt_range()[2 * joint + 1]]
        } else {
            [qpos[at] - room, qpos[at] + room]
        };
        qpos[at] = spread(joint, k, range);
    }
    qpos
}
