//! The law by which an actuator turns its control into force: a motor, a position or a velocity
//! servo.

use super::derive::ctrlrange;
use robert_base::units::{SIM_DT, SUBSTEPS};
use robert_mujoco::{Data, Model};

/// `force = gain control + bias[0] + bias[1] length + bias[2] speed`, with the actuator's length
/// and speed. Muscles, filters and the like have no such law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Law {
    /// Force in N or N m per unit of control.
    pub gain: f64,
    /// Constant, stiffness and damping, the latter two negative.
    pub bias: [f64; 3],
}

impl Law {
    /// The law of an actuator; `None` where it has dynamics or gains of another kind.
    pub(super) fn of(model: &Model, actuator: usize) -> Option<Law> {
        const AFFINE: i32 = 1; // mjBIAS_AFFINE
        let kind = |v: &[i32]| v[actuator];
        if kind(model.actuator_gaintype()) != 0 || kind(model.actuator_dyntype()) != 0 {
            return None;
        }
        let gain = model.actuator_gainprm()[10 * actuator];
        let bias = match kind(model.actuator_biastype()) {
            0 => [0.0; 3],
            AFFINE => {
                let b = &model.actuator_biasprm()[10 * actuator..10 * actuator + 3];
                [b[0], b[1], b[2]]
            }
            _ => return None,
        };
        (gain != 0.0 && bias.iter().all(|b| b.is_finite())).then_some(Law { gain, bias })
    }

    /// Whether the control is a force.
    pub fn is_motor(&self) -> bool {
        self.bias == [0.0; 3]
    }

    /// Whether the control is a target position.
    pub fn is_position(&self) -> bool {
        self.bias[1] < 0.0
    }
}

/// A position servo as a controller sees it: it tells which control moves its length to a target.
/// With the control held, the length swings towards the servo's rest length as a damped mass does.
/// One frame later, with x the distance from rest, x' = a x + b v. The rest length e that leaves
/// the length at l + way is e = l + (way - b v)/(1 - a).
///
/// With the control held, the length swings towards the servo's rest as a damped mass does. A
/// frame later, with x the distance from rest, x' = a x + b v; the rest e that leaves the length
/// at l + way is e = l + (way - b v)/(1 - a).
#[derive(Clone, Debug, PartialEq)]
pub struct PositionServo {
    /// Joints of the state that it moves, with their moment arms.
    pub arms: Vec<(usize, f64)>,
    /// The length when all these joints are at zero.
    offset: f64,
    law: Law,
    middle: f64,
    half: f64,
    /// a and b of a frame.
    keep: f64,
    coast: f64,
}

impl PositionServo {
    /// The servo of an actuator. `data` is at a pose with the state `state` (S), and `dofs` are the
    /// degrees of freedom of the state joints. `None` if the actuator is not a position servo.
    pub(super) fn of(
        data: &Data,
        actuator: usize,
        state: &[f64],
        dofs: &[usize],
        mass: &[f64],
    ) -> Option<PositionServo> {
        let model = data.model();
        let law = Law::of(model, actuator).filter(Law::is_position)?;
        let nv = model.nv();
        let moment = &data.actuator_moment()[actuator * nv..(actuator + 1) * nv];
        let arms: Vec<(usize, f64)> = dofs
            .iter()
            .enumerate()
            .map(|(k, d)| (k, moment[*d]))
            .filter(|(_, a)| *a != 0.0)
            .collect();
        let square: f64 = arms.iter().map(|(_, a)| a * a).sum();
        if square == 0.0 {
            return None;
        }
        let along: f64 = arms.iter().map(|(k, a)| a * state[*k]).sum();
        // As one mass on the length: the inertia when its joints share the way.
        let mean = |of: &dyn Fn(usize) -> f64| -> f64 {
            arms.iter().map(|(k, a)| a * a * of(*k)).sum::<f64>() / (square * square)
        };
        let inertia = mean(&|k| mass[k]).max(1e-12);
        let damping = mean(&|k| model.dof_damping()[dofs[k]]);
        let [lo, hi] = ctrlrange(model, actuator).unwrap_or([-1.0, 1.0]);
        let swing = |x: f64, v: f64| frame(inertia, damping, &law, x, v);
        Some(PositionServo {
            arms,
            offset: data.actuator_length()[actuator] - along,
            law,
            middle: 0.5 * (lo + hi),
            half: (0.5 * (hi - lo)).max(f64::MIN_POSITIVE),
            keep: swing(1.0, 0.0).min(MOST_KEPT),
            coast: swing(0.0, 1.0),
        })
    }

    /// The action, clamped to -1..1, that moves the joints in one frame by `share` of the distance
    /// from `q` to `target`, at speeds `v`, against the torques `weight`; (S) each, the last may be
    /// empty.
    pub fn action(&self, share: f64, q: &[f64], v: &[f64], target: &[f64], weight: &[f64]) -> f64 {
        let along = |x: &[f64]| -> f64 { self.arms.iter().map(|(k, a)| a * x[*k]).sum() };
        let (length, speed) = (self.offset + along(q), along(v));
        let way = share * (along(target) - along(q));
        let rest = length + (way - self.coast * speed) / (1.0 - self.keep);
        let square: f64 = self.arms.iter().map(|(_, a)| a * a).sum();
        let carried = if weight.is_empty() { 0.0 } else { along(weight) / square };
        let stiffness = -self.law.bias[1];
        let ctrl = (stiffness * rest + carried - self.law.bias[0]) / self.law.gain;
        ((ctrl - self.middle) / self.half).clamp(-1.0, 1.0)
    }
}

/// If more than this share of the distance is left after a frame, the servo is too soft, and its
/// control is not extrapolated.
const MOST_KEPT: f64 = 0.98;

/// Distance from rest after a frame.
fn frame(inertia: f64, damping: f64, law: &Law, mut x: f64, mut v: f64) -> f64 {
    for _ in 0..SUBSTEPS {
        let force = law.bias[1] * x + law.bias[2] * v;
        v = (inertia * v + SIM_DT * force) / (inertia + SIM_DT * damping);
        x += SIM_DT * v;
    }
    x
}
