//! Noise collector: smooth random torque without learning, the baseline of the exploring agents.
//!
//! Per episode an Ornstein-Uhlenbeck process drives each actuator:
//!
//! ```text
//! x'  = x e^(-dt/tau) + sqrt(1 - e^(-2 dt/tau)) n        tau log-uniform .06-4 s
//! a   = clamp(gate (amplitude x + bias) + .03 n, +-1)
//! ```
//!
//! Joints should rarely be at their stops, where torque cannot be inferred from positions. So
//! amplitudes depend on the plant. Where damping and gravity keep joints off their stops (arm,
//! puck), amplitudes are spread widely. Where nothing does (hand), they are chosen for an expected
//! travel of .05-1 rad per correlation time. Three times that pushes fingers into each other and
//! into their stops, and teaches little about holding still. Hands also get gates (rest at any
//! pose), a bias that is redrawn now and then, and fingers whose joints move together.

use super::env::has_tendons;
use robert_base::rng::{Rng, Stream};
use robert_base::units::CTRL_DT;
use robert_robot::{Drive, Robot};

/// Correlation time, seconds.
const TAU_SECS: [f64; 2] = [0.06, 4.0];
/// Standard deviation of the white component.
const WHITE: f64 = 0.03;
/// Expected travel per correlation time, rad, for a joint of 90 degrees range.
const TRAVEL: [f64; 2] = [0.05, 1.0];
/// Mean time that a gate stays open or shut, seconds.
const GATE_SECS: [f64; 2] = [1.2, 0.8];
/// Share of episodes with gates.
const GATED: f64 = 0.9;
/// Mean time between new biases, seconds.
const BIAS_SECS: f64 = 2.0;

/// The size of torques.
#[derive(Clone, Debug, PartialEq)]
enum Amplitude {
    /// Uniform in these bounds, times a uniform factor from the third number to 1 by joint.
    Spread(f64, f64, f64),
    /// For an expected travel per correlation time; (range / 90 degrees, speed at full torque) of
    /// each actuator.
    Travel(Vec<(f64, f64)>),
}

/// The settings of the noise of a robot.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct NoiseRule {
    amplitude: Amplitude,
    /// Largest standard deviation of the bias, by actuator.
    bias: Vec<f64>,
    /// Whether the bias is redrawn during an episode.
    bias_moves: bool,
    gates: bool,
    /// For each actuator, the one that it may follow.
    leaders: Vec<Option<usize>>,
}

impl NoiseRule {
    /// Tested settings for a built-in robot, else derived from the profile: travel-based if gravity
    /// is off and joints have stops, spread otherwise.
    pub(crate) fn of(robot: &Robot) -> Self {
        let n = robot.action_dim();
        let plain = |amplitude, bias| NoiseRule {
            amplitude,
            bias,
            bias_moves: false,
            gates: false,
            leaders: vec![None; n],
        };
        match robot.id() {
            "pointmass" => plain(Amplitude::Spread(0.05, 1.2, 1.0), vec![0.1; n]),
            "ur5e" => plain(Amplitude::Spread(0.05, 1.0, 0.4), vec![0.09, 0.3, 0.3, 0.09, 0.09]),
            // With a tenth of the damping the same torques would move it from stop to stop.
            "ur5e_light" => {
                plain(Amplitude::Spread(0.02, 0.4, 0.4), vec![0.036, 0.12, 0.12, 0.036, 0.036])
            }
            _ => {
                let floats = robot.model().gravity().iter().all(|g| g.abs() < 1e-9);
                let stops = robot.joints().iter().all(|j| !j.unbounded);
                if !(floats && stops) {
                    return plain(Amplitude::Spread(0.05, 1.0, 0.4), vec![0.1; n]);
                }
                let travel = (0..n).map(|k| reach(robot, k)).collect();
                NoiseRule {
                    amplitude: Amplitude::Travel(travel),
                    bias: vec![0.1; n],
                    bias_moves: true,
                    gates: true,
                    leaders: if has_tendons(robot) { leaders(robot) } else { vec![None; n] },
                }
            }
        }
    }
}

/// (range in right angles, speed at full torque) of the joint of an actuator.
fn reach(robot: &Robot, k: usize) -> (f64, f64) {
    let joint = member(robot, k).and_then(|name| robot.joints().iter().find(|j| j.name == name));
    joint.map_or((1.0, 4.0), |j| {
        let range = (j.range[1] - j.range[0]) / std::f64::consts::FRAC_PI_2;
        (if j.unbounded { 1.0 } else { range }, j.speed_limit.max(1e-3))
    })
}

/// The joint that an actuator drives, or the first one of its tendon.
fn member(robot: &Robot, k: usize) -> Option<&str> {
    match &robot.actuators().get(k)?.drive {
        Drive::Joint(name) => Some(name),
        Drive::Tendon(tendon) => robot.tendon_joints(tendon).first().copied(),
        Drive::Other(_) => None,
    }
}

/// A tendon's motor may follow the motor of the widest joint in the same finger (J0 of J3).
fn leaders(robot: &Robot) -> Vec<Option<usize>> {
    let groups = &robot.profile().groups;
    (0..robot.action_dim())
        .map(|k| {
            if !matches!(robot.actuators()[k].drive, Drive::Tendon(_)) {
                return None;
            }
            let mine = member(robot, k)?;
            let group = groups.iter().find(|g| g.joints.iter().any(|j| j == mine))?;
            (0..robot.action_dim())
                .filter(|&o| matches!(robot.actuators()[o].drive, Drive::Joint(_)))
                .filter(|&o| member(robot, o).is_some_and(|m| group.joints.iter().any(|j| j == m)))
                .max_by(|&a, &b| reach(robot, a).0.total_cmp(&reach(robot, b).0))
        })
        .collect()
}

/// The noise of one episode.
#[derive(Clone, Debug)]
pub(crate) struct Noise {
    rng: Rng,
    decay: f64,
    amplitude: Vec<f64>,
    bias_sd: Vec<f64>,
    bias: Vec<f64>,
    x: Vec<f64>,
    open: Vec<bool>,
    /// How closely the followers follow, 0 to 1.
    follow: f64,
    gated: bool,
    bias_moves: bool,
    leaders: Vec<Option<usize>>,
}

impl Noise {
    /// The noise of the episode with this seed.
    pub(crate) fn new(rule: &NoiseRule, seed: u64) -> Self {
        let mut rng = Rng::new(seed, Stream::Noise, 0);
        let n = rule.bias.len();
        let log_uniform =
            |rng: &mut Rng, [lo, hi]: [f64; 2]| (lo.ln() + (hi / lo).ln() * rng.uniform()).exp();
        let tau = log_uniform(&mut rng, TAU_SECS);
        let amplitude: Vec<f64> = match &rule.amplitude {
            Amplitude::Spread(lo, hi, least) => {
                let whole = rng.range(*lo, *hi);
                (0..n).map(|_| whole * rng.range(*least, 1.0)).collect()
            }
            Amplitude::Travel(reach) => {
                let travel = log_uniform(&mut rng, TRAVEL);
                reach
                    .iter()
                    .map(|(range, speed)| {
                        let own = travel * range * rng.range(0.5, 1.5);
                        (own / (speed * tau.max(CTRL_DT))).min(1.0)
                    })
                    .collect()
            }
        };
        let level = rng.uniform();
        let relative = matches!(rule.amplitude, Amplitude::Travel(_));
        // With travel-based amplitudes, the strongest allowed bias would push joints to their
        // stops.
        let bias_sd: Vec<f64> = rule
            .bias
            .iter()
            .zip(&amplitude)
            .map(|(b, a)| level * if relative { 0.5 * b.min(0.5 * a) } else { *b })
            .collect();
        let mut noise = Noise {
            decay: (-CTRL_DT / tau).exp(),
            bias: bias_sd.iter().map(|sd| sd * rng.normal()).collect(),
            x: (0..n).map(|_| rng.normal()).collect(),
            open: vec![true; n],
            follow: [0.0, 0.7, 1.0][rng.below(3) as usize],
            gated: rule.gates && rng.uniform() < GATED,
            bias_moves: rule.bias_moves,
            leaders: rule.leaders.clone(),
            amplitude,
            bias_sd,
            rng,
        };
        if noise.gated {
            for k in 0..n {
                noise.open[k] = noise.rng.uniform() < GATE_SECS[0] / (GATE_SECS[0] + GATE_SECS[1]);
            }
        }
        noise
    }

    /// The action of the next frame, (A).
    pub(crate) fn next(&mut self, action: &mut [f32]) {
        let kick = (1.0 - self.decay * self.decay).sqrt();
        for x in &mut self.x {
            *x = self.decay * *x + kick * self.rng.normal();
        }
        for (k, a) in action.iter_mut().enumerate() {
            if self.bias_moves && self.rng.uniform() < CTRL_DT / BIAS_SECS {
                self.bias[k] = self.bias_sd[k] * self.rng.normal();
            }
            if self.gated {
                let stay = GATE_SECS[usize::from(!self.open[k])];
                if self.rng.uniform() < CTRL_DT / stay {
                    self.open[k] = !self.open[k];
                }
            }
            let (x, open) = match self.leaders[k] {
                Some(l) => {
                    let own = (1.0 - self.follow * self.follow).sqrt();
                    let open = if self.follow > 0.9 { self.open[l] } else { self.open[k] };
                    (self.follow * self.x[l] + own * self.x[k], open)
                }
                None => (self.x[k], self.open[k]),
            };
            let drive = if open { self.amplitude[k] * x + self.bias[k] } else { 0.0 };
            *a = (drive + WHITE * self.rng.normal()).clamp(-1.0, 1.0) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tendons_follow_the_proximal_joint() {
        let robot = Robot::builtin("shadow_hand").unwrap();
        let rule = NoiseRule::of(&robot);
        let name = |k: usize| robot.actuators()[k].name.as_str();
        let pairs: Vec<(&str, &str)> =
            (0..18).filter_map(|k| rule.leaders[k].map(|l| (name(k), name(l)))).collect();
        assert_eq!(pairs, [("FFJ0", "FFJ3"), ("MFJ0", "MFJ3"), ("RFJ0", "RFJ3"), ("LFJ0", "LFJ3")]);
    }

    #[test]
    fn correlation_and_bounds() {
        let rule = NoiseRule::of(&Robot::builtin("ur5e").unwrap());
        let mut a = [0.0; 5];
        let mut spread = std::collections::BTreeSet::new();
        for seed in 0..200 {
            let mut noise = Noise::new(&rule, seed);
            let mut same = Noise::new(&rule, seed);
            let mut b = [0.0; 5];
            for _ in 0..50 {
                noise.next(&mut a);
                same.next(&mut b);
                assert_eq!(a, b);
                assert!(a.iter().all(|x| x.abs() <= 1.0));
            }
            spread.insert((noise.amplitude[0] * 10.0) as u32);
        }
        assert!(spread.len() >= 8, "amplitudes are spread: {spread:?}");
    }
}
