//! The law by which an actuator turns its control into force: a motor, a position or a velocity
//! servo.

use robert_mujoco::Model;

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
