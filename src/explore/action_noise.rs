//! Exploration noise around a policy's mean action.
//!
//! URLB samples white noise with a standard deviation of .2. A damped joint integrates torque over
//! many frames, and white torque averages out long before the joint has moved. Noise explores an
//! arm only if it keeps its direction for a while. So in each episode
//!
//! ```text
//! x' = x e^(-dt/tau) + sqrt(1 - e^(-2 dt/tau)) n      n standard normal
//! a  = clamp(mu + sigma x, +-(1 - 1e-6))
//! ```
//!
//! with sigma and tau log-uniform in the preset's bounds. The mixture of time constants is similar
//! to the pink noise of Eberhard et al. (ICLR 2023), the mixture of deviations to the mixed
//! exploration of parallel Q-learning (Li et al. 2023, arXiv 2307.12983, section 3.3). Equal bounds
//! and a tau of 0 give the published white noise.

use serde::{Deserialize, Serialize};

use super::ddpg::{EDGE, SIGMA};
use robert_base::rng::Rng;
use robert_base::units::CTRL_DT;

/// Bounds from which each episode draws its noise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoiseBounds {
    /// Least and largest standard deviation of an action.
    pub sigma: [f64; 2],
    /// Least and largest correlation time, seconds; 0 for white noise.
    pub tau_secs: [f64; 2],
}

impl NoiseBounds {
    /// As published: white, .2.
    pub const WHITE: NoiseBounds = NoiseBounds { sigma: [SIGMA; 2], tau_secs: [0.0; 2] };
}

/// The noise of one episode.
#[derive(Clone, Debug)]
pub(crate) struct ActionNoise {
    rng: Rng,
    sigma: f64,
    keep: f64,
    fresh: f64,
    /// Deviation of each actuator in units of sigma.
    x: Vec<f64>,
}

impl ActionNoise {
    /// Draws an episode's noise for `act` actuators.
    pub(crate) fn new(spread: &NoiseBounds, act: usize, mut rng: Rng) -> Self {
        let log_uniform = |rng: &mut Rng, [lo, hi]: [f64; 2]| {
            if hi > lo && lo > 0.0 { lo * (hi / lo).powf(rng.uniform()) } else { lo }
        };
        let sigma = log_uniform(&mut rng, spread.sigma);
        let tau = log_uniform(&mut rng, spread.tau_secs);
        let keep = if tau > 0.0 { (-CTRL_DT / tau).exp() } else { 0.0 };
        let x = (0..act).map(|_| rng.normal()).collect();
        ActionNoise { rng, sigma, keep, fresh: (1.0 - keep * keep).sqrt(), x }
    }

    /// The next action around this mean (A), inside +-1.
    pub(crate) fn act(&mut self, mean: &[f32], action: &mut [f32]) {
        for ((a, &m), x) in action.iter_mut().zip(mean).zip(&mut self.x) {
            *a = (f64::from(m) + self.sigma * *x).clamp(EDGE - 1.0, 1.0 - EDGE) as f32;
            *x = self.keep * *x + self.fresh * self.rng.normal();
        }
    }

    /// A uniform action, for the steps before anything is learned.
    pub(crate) fn uniform(&mut self, action: &mut [f32]) {
        for a in action {
            *a = self.rng.range(-1.0, 1.0) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use robert_base::rng::Stream;

    /// Deviation and lag-one correlation over many episodes.
    fn moments(spread: &NoiseBounds) -> (f64, f64) {
        let (mut square, mut lag, mut n) = (0.0, 0.0, 0.0);
        for episode in 0..400 {
            let mut w = ActionNoise::new(spread, 1, Rng::new(4, Stream::Test, episode));
            let (mut a, mut last) = ([0.0_f32], None);
            for _ in 0..100 {
                w.act(&[0.0], &mut a);
                let x = f64::from(a[0]);
                square += x * x;
                lag += last.unwrap_or(0.0) * x;
                n += 1.0;
                last = Some(x);
            }
        }
        ((square / n).sqrt(), lag / square)
    }

    #[test]
    fn published_noise_is_white_and_correlated_noise_lasts() {
        let (sd, lag) = moments(&NoiseBounds::WHITE);
        assert!((sd - 0.2).abs() < 0.005 && lag.abs() < 0.02, "{sd} {lag}");
        let (sd, lag) = moments(&NoiseBounds { sigma: [0.2; 2], tau_secs: [0.5; 2] });
        assert!((sd - 0.2).abs() < 0.02, "{sd}");
        assert!((lag - (-CTRL_DT / 0.5).exp()).abs() < 0.03, "{lag}");
    }

    #[test]
    fn episodes_differ_in_deviation_within_the_bounds() {
        let spread = NoiseBounds { sigma: [0.1, 0.8], tau_secs: [0.06, 4.0] };
        let of = |i| ActionNoise::new(&spread, 2, Rng::new(4, Stream::Test, i));
        let sigmas: Vec<f64> = (0..200).map(|i| of(i).sigma).collect();
        assert!(sigmas.iter().all(|s| (0.1..=0.8).contains(s)));
        let low = sigmas.iter().filter(|s| **s < (0.1 * 0.8_f64).sqrt()).count();
        assert!((70..130).contains(&low), "log-uniform: {low} of 200 below the middle");
        let mut a = [0.0_f32; 2];
        of(0).act(&[1.0, -1.0], &mut a);
        assert!(a.iter().all(|a| a.abs() < 1.0));
    }
}
