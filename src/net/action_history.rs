//! Features of past actions, which reveal the plant: the difference between each action and the
//! linear prediction, and the ratio of the two.
//!
//! A plant that is heavier, more damped or weaker than those of the fit needs another torque for
//! the same motion. The ratio of the applied action to the linear prediction, summed over the past,
//! is known for each actuator, and the gate of the skip can use it directly.

/// Assumed weight of a usual plant (ratio 1), as a sum of squared linear predictions. Once the sum
/// over the past is larger than this, the measured ratio weighs more than the assumption. Actions
/// are in [-1, 1].
const DOUBT: f32 = 0.1;
/// Ratios beyond these come from contact or stops, not from the plant.
const RATIO: (f32, f32) = (0.2, 5.0);

/// Sums over the frames so far, per actuator.
#[derive(Clone, Debug)]
pub struct ActionHistory {
    both: Vec<f32>,
    square: Vec<f32>,
    residual: Vec<f32>,
    gain: Vec<f32>,
}

impl ActionHistory {
    /// For this number of actuators.
    pub fn new(actions: usize) -> Self {
        let zero = vec![0.0; actions];
        ActionHistory {
            both: zero.clone(),
            square: zero.clone(),
            residual: zero.clone(),
            gain: zero,
        }
    }

    /// Clears the sums.
    pub fn clear(&mut self) {
        for x in [&mut self.both, &mut self.square, &mut self.residual, &mut self.gain] {
            x.fill(0.0);
        }
    }

    /// Adds the next frame: the action applied before it, and the linear prediction of that action.
    pub fn see(&mut self, applied: &[f32], linear: &[f32]) {
        for (j, (&u, &l)) in applied.iter().zip(linear).enumerate() {
            self.residual[j] = u - l;
            self.both[j] += u * l;
            self.square[j] += l * l;
            let ratio = (DOUBT + self.both[j]) / (DOUBT + self.square[j]);
            self.gain[j] = ratio.clamp(RATIO.0, RATIO.1) - 1.0;
        }
    }

    /// A frame whose previous action is unknown.
    pub(super) fn miss(&mut self) {
        self.residual.fill(0.0);
    }

    /// Applied minus linear, for the action before this frame, (A).
    pub(super) fn residual(&self) -> &[f32] {
        &self.residual
    }

    /// Ratio of applied to linear over the past, minus 1, (A).
    pub fn gain(&self) -> &[f32] {
        &self.gain
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ratio_of_a_plant_is_found_per_actuator_and_held_back_without_motion() {
        let mut past = ActionHistory::new(3);
        for t in 0..30_u8 {
            let x = 0.3 * f32::from(t).sin();
            // Half as strong, twice as strong, hardly moved.
            past.see(&[2.0 * x, 0.5 * x, 0.02 * x], &[x, x, 0.01 * x]);
        }
        let gain = past.gain().to_vec();
        assert!((gain[0] - 1.0).abs() < 0.1 && (gain[1] + 0.5).abs() < 0.05, "{gain:?}");
        assert!(gain[2].abs() < 0.01, "{gain:?}");
        past.see(&[0.3; 3], &[0.1, 0.3, 0.5]);
        assert!(past.residual().iter().zip([0.2, 0.0, -0.2]).all(|(x, y)| (x - y).abs() < 1e-6));
        past.miss();
        assert_eq!(past.residual(), [0.0; 3], "unknown actions say nothing");
        assert_ne!(past.gain(), [0.0; 3], "what was learned stays");
        past.see(&[9.0; 3], &[0.1; 3]);
        past.clear();
        assert_eq!(past.gain(), [0.0; 3]);
    }

    #[test]
    fn what_no_plant_explains_is_cut() {
        let mut past = ActionHistory::new(2);
        (0..30).for_each(|_| past.see(&[1.0, -1.0], &[0.1, 0.1]));
        assert_eq!(past.gain(), [RATIO.1 - 1.0, RATIO.0 - 1.0]);
    }
}
