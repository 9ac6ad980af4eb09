//! Motors of a compiled model: their torques and control ranges.

use super::tendons::tendon_joints;
use robert_mujoco::{Model, Transmission};

/// Greatest torque of the motors of a joint, N m or N; `None` if it has none.
pub(super) fn torque_limit(model: &Model, joint: usize) -> Option<f64> {
    let mut force = None;
    for a in 0..model.nu() {
        if !is_motor(model, a) {
            continue;
        }
        let lever = match model.transmission(a) {
            Some(Transmission::Joint(j)) if j == joint => 1.0,
            Some(Transmission::Tendon(t)) => tendon_joints(model, t)
                .into_iter()
                .find(|(j, _)| *j == joint)
                .map_or(0.0, |(_, c)| c.abs()),
            _ => continue,
        };
        let limit = ctrlrange(model, a).map_or(0.0, |[lo, hi]| lo.abs().max(hi.abs()));
        let gear = model.actuator_gear()[6 * a].abs();
        let gain = model.actuator_gainprm()[10 * a].abs();
        if lever > 0.0 {
            *force.get_or_insert(0.0) += limit * gear * gain * lever;
        }
    }
    force
}

/// Greatest torque of the motors of a joint in the weaker direction, N m or N; that of the other one for a
/// joint that is only pulled one way. `None` if it has no motor.
pub(super) fn weaker_torque(model: &Model, joint: usize) -> Option<f64> {
    let (mut down, mut up) = (0.0, 0.0);
    for a in (0..model.nu()).filter(|a| is_motor(model, *a)) {
        let lever = match model.transmission(a) {
            Some(Transmission::Joint(j)) if j == joint => 1.0,
            Some(Transmission::Tendon(t)) => {
                let own = tendon_joints(model, t).into_iter().find(|(j, _)| *j == joint);
                own.map_or(0.0, |(_, c)| c)
            }
            _ => continue,
        };
        let factor = lever * model.actuator_gear()[6 * a] * model.actuator_gainprm()[10 * a];
        let [lo, hi] = ctrlrange(model, a).unwrap_or_default().map(|c| c * factor);
        down += -lo.min(hi).min(0.0);
        up += lo.max(hi).max(0.0);
    }
    let (weaker, stronger) = (f64::min(down, up), f64::max(down, up));
    Some(if weaker > 0.0 { weaker } else { stronger }).filter(|t| *t > 0.0)
}

/// Whether an actuator's control is a force: fixed gain, no bias, no dynamics.
pub(super) fn is_motor(model: &Model, actuator: usize) -> bool {
    let zero = |v: &[i32]| v.get(actuator).is_some_and(|t| *t == 0);
    zero(model.actuator_gaintype())
        && zero(model.actuator_biastype())
        && zero(model.actuator_dyntype())
}

/// The control range of an actuator; `None` if the model sets no limit.
pub(super) fn ctrlrange(model: &Model, actuator: usize) -> Option<[f64; 2]> {
    let limited = model.actuator_ctrllimited().get(actuator).is_some_and(|l| *l != 0);
    let range = model.actuator_ctrlrange().get(2 * actuator..2 * actuator + 2)?;
    range.try_into().ok().filter(|_| limited)
}
