//! The gains of a servo for one joint.

use robert_base::units::CTRL_DT;

/// Torque per rad (or m) of error and per rad/s (or m/s) of speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Servo {
    /// N m/rad or N/m.
    pub kp: f64,
    /// N m s/rad or N s/m.
    pub kd: f64,
}

impl Servo {
    /// The servo of a joint with its own inertia and damping only: with tau = M/c, g = tau (1 -
    /// e^(-T/tau)) and b = (T - g)/c; undamped, b = T^2/(2M) and g = T.
    pub fn tuned(inertia: f64, damping: f64, share: f64) -> Servo {
        let (b, g) = if damping * CTRL_DT < 1e-6 * inertia {
            (CTRL_DT * CTRL_DT / (2.0 * inertia), CTRL_DT)
        } else {
            let tau = inertia / damping;
            let g = tau * (1.0 - (-CTRL_DT / tau).exp());
            ((CTRL_DT - g) / damping, g)
        };
        Servo::covering(share, b, g)
    }

    /// From the response of a torque that is held for one frame: it moves the joint by b per unit, and a
    /// speed by g.
    pub(super) fn covering(share: f64, b: f64, g: f64) -> Servo {
        Servo { kp: share / b, kd: share * g / b }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_reach_the_target_of_a_single_joint() {
        for (inertia, damping) in [(3.0, 100.0), (0.0003, 0.05), (4.0, 0.0), (0.3, 3.0)] {
            let servo = Servo::tuned(inertia, damping, 1.0);
            let (mut q, mut v, dt) = (0.0, 0.4, CTRL_DT / 1000.0);
            let u = servo.kp * (1.0 - q) - servo.kd * v;
            for _ in 0..1000 {
                v += dt * (u - damping * v) / inertia;
                q += dt * v;
            }
            assert!((q - 1.0_f64).abs() < 2e-2, "M {inertia}, c {damping}: reached {q}");
        }
    }
}
