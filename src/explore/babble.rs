//! Babbling collector: random references, followed by weak servos, under random torque.
//!
//! Random torque without servos pushes a light arm with strong motors against its stops, where
//! torque cannot be inferred from positions, and leaves it there. Infants reach for random places
//! and hold them instead (motor babbling; Demiris and Dearden 2005, Rolf et al. 2010). In each
//! episode, the reference of a joint either moves randomly around a place
//!
//! ```text
//! x'  = x e^(-dt/tau) + sqrt(1 - e^(-2 dt/tau)) n        tau log-uniform .2-3 s
//! r   = centre + amplitude x
//! ```
//!
//! or moves quickly to another place and rests there. A servo covers a share of the distance per
//! frame. The share is log-uniform, so that stiff and soft motion both occur:
//!
//! ```text
//! a   = clamp((kp (r - q) - kd v + disturbance + weight) / full torque, +-1)
//! ```
//!
//! The weight is the torque that holds the pose against gravity. Without it, soft servos let a
//! heavy arm hang down, and all data are at the bottom of the range. There is no task, reward or
//! demonstration. Of the robot it uses ranges, speeds, and, as any servo tuning does, inertia and
//! weight (of the nominal model).

use super::error::Error;
use robert_base::rng::{Rng, Stream};
use robert_base::units::{CTRL_DT, Unit};
use robert_mujoco::Data;
use robert_robot::{self as robot, Drive, PositionServo, Robot, Servo};

/// Share of the distance that a servo covers in a frame.
const SHARE: [f64; 2] = [0.03, 0.5];
/// Correlation time of a wandering reference and of the disturbance, seconds.
const TAU_SECS: [f64; 2] = [0.2, 3.0];
const DISTURBANCE_SECS: [f64; 2] = [0.06, 1.0];
/// Largest disturbance, in the torque that the servo needs for a frame at full speed.
const DISTURBANCE: f64 = 0.5;
/// Its white component.
const WHITE: f64 = 0.05;
/// Amplitude of a wandering reference, in half ranges.
const AMPLITUDE: [f64; 2] = [0.05, 0.6];
/// Length of a dash, in ranges.
const DASH: [f64; 2] = [0.05, 0.8];
/// Mean rest after a dash, seconds.
const REST_SECS: f64 = 0.8;
/// Speed of references, relative to the greatest sustained speed.
const PACE: [f64; 2] = [0.1, 1.0];
/// A reference moves no faster than a servo moves a joint in this many time constants of the
/// episode, so that its motors are not at their limits all the time.
const RISE: f64 = 1.0;
/// References keep this share of the range away from stops.
const MARGIN: f64 = 0.03;
/// Range of an unbounded joint around home: rad, m.
const UNBOUNDED: [f64; 2] = [1.5, 0.5];

/// The settings of the babbling of a robot.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct BabbleRule {
    joints: Vec<Joint>,
    /// By actuator.
    motors: Vec<Motor>,
}

/// The command of an actuator: weighted torques of its joints.
#[derive(Clone, Debug, PartialEq)]
struct Motor {
    /// Joint and weight.
    pulls: Vec<(usize, f64)>,
    /// The sum of the weighted torques at action 0, and its change to action 1.
    middle: f64,
    half: f64,
    /// The law of a position servo, which receives a position instead of a torque.
    servo: Option<PositionServo>,
}

#[derive(Clone, Debug, PartialEq)]
struct Joint {
    lo: f64,
    hi: f64,
    speed: f64,
    acceleration: f64,
    /// At share 1.
    servo: Servo,
}

impl BabbleRule {
    /// The settings for a robot with motors at joints or at tendons that couple joints.
    ///
    /// # Errors
    /// [`Error::Argument`] for other transmissions; [`Error::Robot`].
    pub(crate) fn of(robot: &Robot) -> Result<Self, Error> {
        let gear = robot.model().actuator_gear();
        let mut motors = Vec::new();
        let servos = robot.position_servos(&SHARE)?;
        for ((k, a), servo) in robot.actuators().iter().enumerate().zip(servos) {
            let [lo, hi] = a.ctrlrange;
            let Some(law) = a.law else {
                return Err(Error::Argument {
                    name: "agent",
                    must: "noise for this robot: babble needs motors or servos".to_owned(),
                    got: format!("babble, with actuator {} of another kind", a.name),
                });
            };
            let (middle, half) =
                (0.5 * law.gain * (lo + hi) + law.bias[0], 0.5 * law.gain * (hi - lo));
            motors.push(match &a.drive {
                Drive::Joint(name) => {
                    let gear = gear[6 * k];
                    let pulls = vec![(robot.joint_index(name)?, 1.0)];
                    Motor { pulls, middle: gear * middle, half: gear * half, servo }
                }
                Drive::Tendon(_) => Motor { pulls: shares(robot, k)?, middle, half, servo },
                Drive::Other(_) => {
                    let must =
                        "noise for this robot, because babble needs motors at joints or tendons";
                    return Err(Error::Argument {
                        name: "agent",
                        must: must.to_owned(),
                        got: format!("babble, but motor {} acts on something else", a.name),
                    });
                }
            });
        }
        let servos = robot.servos(1.0)?;
        let joints = robot
            .joints()
            .iter()
            .zip(robot.home())
            .zip(servos)
            .map(|((j, home), servo)| {
                let [lo, hi] = if j.unbounded {
                    let room = UNBOUNDED[usize::from(j.unit == Unit::M)];
                    [home - room, home + room]
                } else {
                    j.range
                };
                let margin = MARGIN * (hi - lo);
                Joint {
                    lo: lo + margin,
                    hi: hi - margin,
                    speed: j.speed_limit.max(1e-3),
                    acceleration: j.acceleration_limit.max(1e-3),
                    servo,
                }
            })
            .collect();
        Ok(BabbleRule { joints, motors })
    }
}

/// Weights with which the torques of a tendon's joints are combined into the motor force that is
/// closest to them: moment arms divided by the sum of their squares.
fn shares(robot: &Robot, actuator: usize) -> Result<Vec<(usize, f64)>, Error> {
    let mut data = Data::new(robot.model()).map_err(robot::Error::from)?;
    robot.write_state(&mut data, &robot.home())?;
    data.forward().map_err(robot::Error::from)?;
    let nv = robot.model().nv();
    let arms = &data.actuator_moment()[actuator * nv..(actuator + 1) * nv];
    let square: f64 = arms.iter().map(|a| a * a).sum();
    let joints = robot.joints().iter().enumerate();
    let arm = joints.map(|(k, j)| (k, arms[j.dofadr]));
    Ok(arm.filter(|(_, a)| *a != 0.0).map(|(k, a)| (k, a / square)).collect())
}

/// The babbling of one episode.
#[derive(Clone, Debug)]
pub(crate) struct Babble {
    rng: Rng,
    rule: BabbleRule,
    share: f64,
    /// Wander (true) or dash.
    wanders: bool,
    keep: f64,
    disturbance: f64,
    disturbance_keep: f64,
    references: Vec<JointReference>,
    /// Work space, by joint: torque, position, speed, and the target position one frame later.
    torque: Vec<f64>,
    place: Vec<f64>,
    speed: Vec<f64>,
    wish: Vec<f64>,
    begun: bool,
}

/// One joint's reference.
#[derive(Clone, Debug)]
struct JointReference {
    centre: f64,
    amplitude: f64,
    x: f64,
    goal: f64,
    value: f64,
    /// Largest change of the reference in a frame.
    pace: f64,
    dash: f64,
    push: f64,
}

impl Babble {
    /// The babbling of the episode with this seed.
    pub(crate) fn new(rule: &BabbleRule, seed: u64) -> Self {
        let mut rng = Rng::new(seed, Stream::Noise, 0);
        let log_uniform = |rng: &mut Rng, [lo, hi]: [f64; 2]| lo * (hi / lo).powf(rng.uniform());
        let share = log_uniform(&mut rng, SHARE);
        let keep = (-CTRL_DT / log_uniform(&mut rng, TAU_SECS)).exp();
        let disturbance_keep = (-CTRL_DT / log_uniform(&mut rng, DISTURBANCE_SECS)).exp();
        let disturbance = DISTURBANCE * rng.uniform();
        let wanders = rng.uniform() < 0.5;
        let pace = rng.range(PACE[0], PACE[1]);
        let references = rule
            .joints
            .iter()
            .map(|j| JointReference {
                centre: rng.range(j.lo, j.hi),
                amplitude: 0.5 * (j.hi - j.lo) * rng.range(AMPLITUDE[0], AMPLITUDE[1]),
                x: rng.normal(),
                goal: 0.0,
                value: 0.0,
                pace: (pace * j.speed).min(RISE * j.acceleration * CTRL_DT / share)
                    * CTRL_DT
                    * rng.range(0.3, 1.0),
                dash: (j.hi - j.lo) * rng.range(DASH[0], DASH[1]),
                push: 0.0,
            })
            .collect();
        Babble {
            rng,
            share,
            wanders,
            keep,
            disturbance,
            disturbance_keep,
            references,
            torque: vec![0.0; rule.joints.len()],
            place: vec![0.0; rule.joints.len()],
            speed: vec![0.0; rule.joints.len()],
            wish: vec![0.0; rule.joints.len()],
            rule: rule.clone(),
            begun: false,
        }
    }

    /// The action of the next frame, (A), at these positions and speeds, (S) each. `weight` is the
    /// torque that holds the pose against gravity, (S), or empty for a robot without gravity.
    pub(crate) fn next(&mut self, qpos: &[f32], qvel: &[f32], weight: &[f64], action: &mut [f32]) {
        let (kick, push_kick) = (
            (1.0 - self.keep * self.keep).sqrt(),
            (1.0 - self.disturbance_keep * self.disturbance_keep).sqrt(),
        );
        let first = !std::mem::replace(&mut self.begun, true);
        for (k, (reference, joint)) in self.references.iter_mut().zip(&self.rule.joints).enumerate()
        {
            let (q, v) = (f64::from(qpos[k]), f64::from(qvel[k]));
            if first {
                (reference.value, reference.goal) = (q, q);
            }
            if self.wanders {
                reference.x = self.keep * reference.x + kick * self.rng.normal();
                reference.goal = reference.centre + reference.amplitude * reference.x;
            } else if self.rng.uniform() < CTRL_DT / REST_SECS {
                reference.goal = reference.value + self.rng.range(-reference.dash, reference.dash);
            }
            reference.goal = reference.goal.clamp(joint.lo, joint.hi);
            reference.value +=
                (reference.goal - reference.value).clamp(-reference.pace, reference.pace);
            reference.push = self.disturbance_keep * reference.push + push_kick * self.rng.normal();
            // A frame at full speed, or what full torque adds in a frame where that is less.
            let most = (joint.speed * CTRL_DT)
                .min(0.5 * joint.acceleration * CTRL_DT * CTRL_DT / self.share);
            let full_speed = joint.servo.kp * most;
            let noise = self.disturbance * reference.push + WHITE * self.rng.normal();
            self.torque[k] = self.share
                * (joint.servo.kp * (reference.value - q) - joint.servo.kd * v
                    + full_speed * noise);
            (self.place[k], self.speed[k]) = (q, v);
            self.wish[k] = reference.value + most * noise;
        }
        self.torque.iter_mut().zip(weight).for_each(|(torque, weight)| *torque += weight);
        for (a, motor) in action.iter_mut().zip(&self.rule.motors) {
            if let Some(servo) = &motor.servo {
                let (q, v) = (&self.place, &self.speed);
                *a = servo.action(self.share, q, v, &self.wish, weight) as f32;
                continue;
            }
            let pull = |&(joint, weight): &(usize, f64)| weight * self.torque[joint];
            let force: f64 = motor.pulls.iter().map(pull).sum();
            *a = ((force - motor.middle) / motor.half).clamp(-1.0, 1.0) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn references_are_followed_and_episodes_repeat() {
        let rule = BabbleRule::of(&Robot::builtin("ur5e").unwrap()).unwrap();
        let run = |seed| {
            let mut babble = Babble::new(&rule, seed);
            let mut actions = Vec::new();
            let mut a = [0.0_f32; 5];
            for _ in 0..50 {
                babble.next(&[0.1; 5], &[0.0; 5], &[], &mut a);
                assert!(a.iter().all(|x| x.abs() <= 1.0));
                actions.extend(a);
            }
            actions
        };
        assert_eq!(run(1), run(1));
        assert_ne!(run(1), run(2));
        // A servo pulls towards its reference.
        let mut babble = Babble::new(&rule, 3);
        let mut a = [0.0_f32; 5];
        babble.next(&[0.0; 5], &[0.0; 5], &[], &mut a);
        (babble.disturbance, babble.wanders) = (0.0, false);
        babble.references.iter_mut().for_each(|l| (l.goal, l.value) = (1.0, 1.0));
        babble.next(&[0.0; 5], &[0.0; 5], &[], &mut a);
        assert!(a.iter().all(|&x| x > 0.0), "{a:?}");
    }

    #[test]
    fn a_tendon_pulls_where_its_joints_are_to_go() {
        let hand = Robot::builtin("shadow_hand").unwrap();
        let rule = BabbleRule::of(&hand).unwrap();
        let k = hand.actuators().iter().position(|a| a.name == "FFJ0").unwrap();
        let names: Vec<_> =
            rule.motors[k].pulls.iter().map(|&(j, _)| hand.joints()[j].name.as_str()).collect();
        assert_eq!(names, ["FFJ2", "FFJ1"]);
        let mut babble = Babble::new(&rule, 3);
        let home: Vec<f32> = hand.home().iter().map(|&x| x as f32).collect();
        let still = vec![0.0; home.len()];
        let mut a = vec![0.0; hand.actuators().len()];
        babble.next(&home, &still, &[], &mut a);
        (babble.disturbance, babble.wanders) = (0.0, false);
        for (sign, up) in [(0.5, true), (-0.5, false)] {
            for &(j, _) in &rule.motors[k].pulls {
                let at = f64::from(home[j]) + sign;
                (babble.references[j].goal, babble.references[j].value) = (at, at);
                babble.rule.joints[j].lo = -9.0;
            }
            babble.next(&home, &still, &[], &mut a);
            assert_eq!(a[k] > 0.0, up, "{a:?}");
        }
    }
}
