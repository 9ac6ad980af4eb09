//! A disturbance observer: what the policy does not know of the robot is inferred from the motion that
//! past actions caused, and added to the next ones.
//!
//! Masked action-inverse inference also infers actions that are known already, those of past frames.
//! Where the applied action was another one, something else acted on the robot, or the inference is
//! wrong there: the weight of a link in a pose that the data hardly show, a load, dry friction. An
//! exponential moving average of this difference, added to each answer, removes the error that would
//! otherwise stay while the robot holds still. (The method is that of disturbance observers in robot
//! control: Ohnishi et al. 1996.)

use super::Error;
use super::config::CURRENT;
use super::token::TokenConfig;

/// The frames from the inferred one to the current one. The inference of a frame depends mainly on the
/// two frames after it; both must have happened, since goals say nothing about what acted on the robot.
pub const BACK: usize = 2;
/// The frame whose action is inferred again.
pub const SEEN: usize = CURRENT - BACK;
/// The largest difference that counts, as a share of the greatest action. A link that presses against
/// another one would otherwise press as hard as it can.
const LIMIT: f32 = 0.2;

/// What the observer has seen since the beginning of a rollout.
#[derive(Clone, Debug)]
pub struct Observer {
    /// Weight of the newest difference.
    gain: f32,
    /// Moving average of the difference of applied and inferred action, (A).
    disturbance: Vec<f32>,
    /// The actions of the last frames, oldest first, (up to [`BACK`], A).
    applied: Vec<f32>,
}

/// Refuses an observer of this weight, in percent, for a model with these features.
///
/// # Errors
/// [`Error::Config`].
pub fn check(percent: u8, tokens: &TokenConfig) -> Result<(), Error> {
    let why = match percent {
        0 => return Ok(()),
        101.. => format!("takes 0 to 100 percent, not {percent}"),
        _ if tokens.ridge_history >= SEEN => {
            format!("the frame that it sees has fewer than {} before it", tokens.ridge_history + 1)
        }
        _ => return Ok(()),
    };
    Err(Error::Config { field: "observer", why })
}

impl Observer {
    /// An observer of this number of actuators, in which the newest difference counts `percent`, at
    /// most 100; `None` if that is 0.
    pub fn new(percent: u8, actions: usize) -> Option<Self> {
        assert!(percent <= 100, "{percent} percent");
        let gain = f32::from(percent) / 100.0;
        let applied = Vec::with_capacity(BACK * actions);
        (percent > 0).then(|| Observer { gain, disturbance: vec![0.0; actions], applied })
    }

    /// Begins a new rollout.
    pub fn reset(&mut self) {
        self.disturbance.fill(0.0);
        self.applied.clear();
    }

    /// Adds the disturbance to `action`, (A), which then is within its range. `inferred` is the
    /// inferred action of frame [`SEEN`] of the window, (A); only what is within the range could be
    /// applied.
    pub fn correct(&mut self, inferred: &[f32], action: &mut [f32]) {
        let a = self.disturbance.len();
        debug_assert_eq!([inferred.len(), action.len()], [a; 2], "one number for each actuator");
        // The actions before the rollout are unknown.
        if self.applied.len() == BACK * a {
            for ((d, &u), &x) in self.disturbance.iter_mut().zip(&self.applied).zip(inferred) {
                let missing = u - x.clamp(-1.0, 1.0);
                *d += self.gain * (missing.clamp(-LIMIT, LIMIT) - *d);
            }
        }
        for (to, d) in action.iter_mut().zip(&self.disturbance) {
            *to = (*to + d).clamp(-1.0, 1.0);
        }
    }

    /// Notes the action of this frame, (A).
    pub fn remember(&mut self, action: impl IntoIterator<Item = f32>) {
        let a = self.disturbance.len();
        if self.applied.len() == BACK * a {
            self.applied.drain(..a);
        }
        self.applied.extend(action);
        debug_assert_eq!(self.applied.len() % a, 0, "one number for each actuator");
    }

    /// Replaces the action of the last frame, (A), by that which was applied.
    pub fn replace(&mut self, action: impl IntoIterator<Item = f32>) {
        self.applied.truncate(self.applied.len().saturating_sub(self.disturbance.len()));
        self.remember(action);
    }

    /// All that it has seen: (A) and up to ([`BACK`], A).
    pub fn memory(&self) -> impl Iterator<Item = f64> {
        self.disturbance.iter().chain(&self.applied).map(|&x| f64::from(x))
    }

    /// Restores an earlier [`Observer::memory`] of the same robot.
    pub fn recall(&mut self, memory: &[f64]) {
        let (disturbance, applied) = memory.split_at(self.disturbance.len());
        self.disturbance.iter_mut().zip(disturbance).for_each(|(to, &x)| *to = x as f32);
        self.applied.clear();
        self.applied.extend(applied.iter().map(|&x| x as f32));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The last of many actions on a plant that moves by the action plus `push`, by a policy that
    /// answers .1 and does not know of the push.
    fn hold(push: f32, steps: usize) -> f32 {
        let mut observer = Observer::new(30, 1).unwrap();
        let (mut seen, mut action) = (Vec::new(), [0.0]);
        for t in 0..steps {
            action = [0.1];
            let inferred = if t >= BACK { seen[t - BACK] } else { 0.0 };
            observer.correct(&[inferred], &mut action);
            observer.remember(action);
            // The motion shows the sum of action and push, and the policy takes it for the action.
            seen.push(action[0] + push);
        }
        action[0]
    }

    #[test]
    fn a_constant_push_is_removed_up_to_the_limit() {
        assert!((hold(-0.15, 60) - 0.25).abs() < 1e-3, "{}", hold(-0.15, 60));
        assert!((hold(0.0, 60) - 0.1).abs() < 1e-6);
        // Nothing is known before two frames have passed.
        assert!((hold(-0.15, BACK) - 0.1).abs() < 1e-6);
        assert!((hold(-0.9, 200) - (0.1 + LIMIT)).abs() < 1e-3, "{}", hold(-0.9, 200));
        assert!(Observer::new(0, 1).is_none());
    }

    #[test]
    fn it_resumes_where_it_was() {
        let mut observer = Observer::new(50, 2).unwrap();
        for t in 0..5_u8 {
            let mut action = [0.1 * f32::from(t), 0.2];
            observer.correct(&[0.0, 0.1], &mut action);
            observer.remember(action);
        }
        let memory: Vec<f64> = observer.memory().collect();
        let mut other = Observer::new(50, 2).unwrap();
        other.recall(&memory);
        let answer = |observer: &mut Observer| {
            let mut action = [0.0; 2];
            observer.correct(&[0.3, -0.1], &mut action);
            action
        };
        assert_eq!(answer(&mut observer), answer(&mut other));
        // Another action was applied than the policy's.
        observer.replace([0.9, 0.9]);
        other.replace([0.9, 0.9]);
        assert_eq!(answer(&mut observer), answer(&mut other));
        observer.reset();
        assert_eq!(answer(&mut observer), [0.0; 2]);
    }
}
