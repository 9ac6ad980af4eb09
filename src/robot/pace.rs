//! The speed and acceleration that the motors give each joint, measured in simulation.
//!
//! Torque limit divided by damping gives the speed only if damping dominates. By that rule a joint
//! without damping in its file would reach 1,300 rad/s, and a joint that cannot lift its link would
//! move. So each joint is driven with the full torque of its motors, from rest, in both directions,
//! at poses over the range and under gravity. Its speed is the highest one within half its range. A
//! joint with much inertia and little damping needs long to reach it, so its acceleration limits
//! short motions.

use std::sync::Arc;

use super::Error;
use super::golden::spread;
use super::law::Law;
use super::motors::{ctrlrange, torque_limit};
use super::rings::rings;
use super::tendons::tendon_joints;
use super::ties;
use robert_mujoco::{Data, Joint, Model, Transmission, index};

/// Poses beside the default one.
const POSES: usize = 4;
/// The time in which a joint may cross half its range, in simulator steps of 5 ms.
const STEPS: usize = 400;
/// The number of steps after which an unchanged speed counts as reached.
const STEADY_STEPS: usize = 20;
/// The relative change over these steps below which the speed is unchanged.
const STEADY: f64 = 1e-3;
/// The limit of the work of all runs: simulator steps times the size of the model. The size is the
/// number of its joints if few of them follow each other in a chain. 5 million take about a second;
/// 40 joints of a humanoid need half of that. If there are more joints, each is driven at fewer
/// poses, or for a shorter time.
const WORK: usize = 5_000_000;
/// Geoms that cost as much as one joint.
const GEOMS: usize = 5;
/// The number of pairs of joints in one chain that cost as much as one more joint.
const CHAINED: usize = 200;
/// The damping that keeps the other joints still, N m s/rad or N s/m.
const HELD: f64 = 1e8;
/// Half the interval of a joint without limits: rad, m.
const UNBOUNDED: [f64; 2] = [1.5, 0.5];
/// The highest speed that is measured for a position or velocity servo, rad/s, m/s. It could be
/// faster for a moment if it were commanded to the far end of its range at once, but no task does
/// that.
const SERVO_SPEED: [f64; 2] = [3.0, 0.5];
/// The highest speed that is measured for a motor, rad/s, m/s. If a file lets one light joint spin
/// at 30 rad/s, exploration would use that speed and throw the other joints about.
const MOTOR_SPEED: [f64; 2] = [6.0, 1.0];
/// No joint gets a speed that crosses its range in less time than this, seconds.
const CROSSING_SECS: f64 = 0.5;
/// Share of the reached speed up to which acceleration is measured.
const RISEN: f64 = 0.9;
/// A joint that is slower than this in most poses counts as not moved by its motors, rad/s or m/s.
const STILL: f64 = 1e-3;

/// The speed and acceleration that the motors give one joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Pace {
    /// It moves: the speed of the slower direction, the median over the poses.
    Moves {
        /// Speed that it reaches and that tasks may ask for, rad/s or m/s.
        speed: f64,
        /// Speed that it reaches, rad/s or m/s.
        top: f64,
        /// Mean acceleration up to [`RISEN`] of that speed, rad/s² or m/s².
        acceleration: f64,
    },
    /// Its motors do not move it in most poses.
    Stuck,
    /// No motor acts on it, or the simulation diverges when one does.
    Unknown,
}

/// What was measured.
#[derive(Debug)]
pub(super) struct Paces {
    /// The speed and acceleration of every joint, in order.
    pub(super) joints: Vec<Pace>,
    /// Seconds for which the joints were driven; `None` unless the model is so large that there was
    /// no time for [`STEPS`].
    pub(super) cut_secs: Option<f64>,
}

/// Measures every joint of a model with hinges and slides.
///
/// # Errors
/// [`Error::Simulator`] where a simulation cannot be made.
pub(super) fn measure(model: &Arc<Model>) -> Result<Paces, Error> {
    let (count, groups) = (model.jnt_type().len(), Groups::of(model));
    let mut left = WORK / size(model).max(1);
    let (mut joints, mut cut) = (Vec::with_capacity(count), None::<usize>);
    for joint in 0..count {
        // What a joint leaves, because it was soon as fast as it gets, is for those after it.
        let mut share = Share::new(left / (count - joint));
        joints.push(one(model, &groups, joint, &mut share)?);
        left = left.saturating_sub(share.used);
        if share.is_cut {
            cut = Some(cut.map_or(share.most, |c| c.min(share.most)));
        }
    }
    Ok(Paces { joints, cut_secs: cut.map(|steps| steps as f64 * model.timestep()) })
}

/// The simulator steps that one joint may use.
struct Share {
    all: usize,
    used: usize,
    /// Of one run.
    most: usize,
    /// Whether a run was ended by this limit before it was finished.
    is_cut: bool,
}

impl Share {
    fn new(all: usize) -> Share {
        // At least one pose, in both directions.
        Share { all, used: 0, most: (all / 2).clamp(1, STEPS), is_cut: false }
    }

    /// Whether the limit allows another pose, however long it takes.
    fn has_room(&self) -> bool {
        self.used == 0 || self.used + 2 * self.most <= self.all
    }
}

/// What a simulator step costs, in joints.
fn size(model: &Model) -> usize {
    let mut above = vec![0; model.nbody()];
    let mut chained = 0;
    for body in 1..model.nbody() {
        let before = above[index(model.body_parentid()[body])];
        above[body] = before + index(model.body_jntnum()[body]);
        // The inertia of each joint is eliminated from those above it, two by two.
        chained += (before + 1..=above[body]).map(|depth| depth * depth / 2).sum::<usize>();
    }
    model.nv() + model.ngeom() / GEOMS + chained / CHAINED
}

/// The pace of one joint.
fn one(
    model: &Arc<Model>,
    groups: &Groups,
    joint: usize,
    share: &mut Share,
) -> Result<Pace, Error> {
    let dof = model.jnt_dofadr()[joint] as usize;
    let mut held = model.duplicate()?;
    held.set_contacts(false);
    let mut damping = held.dof_damping().to_vec();
    let together = groups.moving_with(joint);
    let in_ring = together.iter().any(|j| groups.in_ring(*j));
    for (j, adr) in model.jnt_dofadr().iter().enumerate() {
        if !together.contains(&j) {
            damping[*adr as usize] = HELD;
        }
    }
    held.set_damping(&damping)?;
    let mut data = Data::new(&Arc::new(held))?;
    let (mut speeds, mut accelerations) = (Vec::new(), Vec::new());
    for k in 0..=if in_ring { 0 } else { POSES } {
        if !share.has_room() {
            break;
        }
        let mut slower: Option<Run> = None;
        for up in [true, false] {
            let Some(qpos) = start(model, groups, joint, k, up) else { return Ok(Pace::Unknown) };
            if in_ring && !has_way(model, joint, up) {
                continue;
            }
            data.reset()?;
            data.set_qpos(&qpos)?;
            data.forward()?;
            let Some(ctrl) = full(model, &data, dof, up) else { return Ok(Pace::Unknown) };
            data.set_ctrl(&ctrl)?;
            if let Some(one) = run(&mut data, model, joint, up, share) {
                slower = Some(slower.map_or(one, |s| s.slower(one)));
            }
        }
        speeds.extend(slower.map(|s| s.speed));
        accelerations.extend(slower.map(|s| s.acceleration));
    }
    let median = |all: &mut Vec<f64>| {
        all.sort_by(f64::total_cmp);
        all.get(all.len() / 2).copied()
    };
    // On one side of the range gravity helps, but its contribution is not the motor's.
    let spent = match torque_limit(model, joint) {
        Some(torque) if model.dof_damping()[dof] > 0.0 => torque / model.dof_damping()[dof],
        _ => f64::INFINITY,
    };
    Ok(match (median(&mut speeds), median(&mut accelerations)) {
        (Some(v), Some(acceleration)) if v >= STILL => {
            let top = v.min(spent);
            Pace::Moves { speed: top.min(asked_at_most(model, joint)), top, acceleration }
        }
        (Some(_), _) => Pace::Stuck,
        (None, _) => Pace::Unknown,
    })
}

/// The speed and acceleration that one run at full torque reached.
#[derive(Clone, Copy, Debug)]
struct Run {
    speed: f64,
    acceleration: f64,
}

impl Run {
    fn slower(self, other: Run) -> Run {
        Run {
            speed: self.speed.min(other.speed),
            acceleration: self.acceleration.min(other.acceleration),
        }
    }
}

/// The highest speed that a task may require of a joint.
fn asked_at_most(model: &Model, joint: usize) -> f64 {
    let serves = |a: usize| {
        let here = match model.transmission(a) {
            Some(Transmission::Joint(j)) => j == joint,
            Some(Transmission::Tendon(t)) => tendon_joints(model, t).iter().any(|m| m.0 == joint),
            _ => false,
        };
        here && Law::of(model, a).is_some_and(|l| !l.is_motor())
    };
    let speeds = if (0..model.nu()).any(serves) { SERVO_SPEED } else { MOTOR_SPEED };
    let [lo, hi] = room(model, joint);
    let slides = model.joint_type(joint) == Some(Joint::Slide);
    speeds[usize::from(slides)].min((hi - lo) / CROSSING_SECS)
}

/// The joints that move together.
struct Groups {
    /// Joints of each tendon, and of each tie.
    tied: Vec<Vec<usize>>,
    /// Joints of each closed loop.
    rings: Vec<Vec<usize>>,
    /// The groups of each joint: places in `tied`, and in `rings`.
    of: Vec<[Vec<usize>; 2]>,
    /// Whether a motor acts on each joint itself.
    has_motor: Vec<bool>,
}

impl Groups {
    fn of(model: &Model) -> Groups {
        let tendons = (0..model.ntendon())
            .map(|t| tendon_joints(model, t).into_iter().map(|(j, _)| j).collect());
        let ties = ties::ties(model).into_iter().map(|tie| vec![tie.follower, tie.leader]);
        let (tied, rings): (Vec<Vec<usize>>, _) = (tendons.chain(ties).collect(), rings(model));
        let count = model.jnt_type().len();
        let mut of = vec![[Vec::new(), Vec::new()]; count];
        for (kind, groups) in [&tied, &rings].into_iter().enumerate() {
            for (at, joints) in groups.iter().enumerate() {
                joints.iter().for_each(|j| of[*j][kind].push(at));
            }
        }
        let mut has_motor = vec![false; count];
        for a in 0..model.nu() {
            if let Some(Transmission::Joint(j)) = model.transmission(a) {
                has_motor[j] = true;
            }
        }
        Groups { tied, rings, of, has_motor }
    }

    /// The joint, those coupled to it by a tendon or an equality, and those that a loop carries along. Motors
    /// on a loop hold.
    fn moving_with(&self, joint: usize) -> Vec<usize> {
        let mut seen = vec![false; self.of.len()];
        // A group that was taken has nothing more to give.
        let mut taken = [vec![false; self.tied.len()], vec![false; self.rings.len()]];
        let mut all = vec![joint];
        seen[joint] = true;
        let mut next = 0;
        while let Some(&here) = all.get(next) {
            next += 1;
            for (kind, groups) in [&self.tied, &self.rings].into_iter().enumerate() {
                for &at in &self.of[here][kind] {
                    if std::mem::replace(&mut taken[kind][at], true) {
                        continue;
                    }
                    for &j in groups[at].iter().filter(|&&j| kind == 0 || !self.has_motor[j]) {
                        if !std::mem::replace(&mut seen[j], true) {
                            all.push(j);
                        }
                    }
                }
            }
        }
        all
    }

    fn in_ring(&self, joint: usize) -> bool {
        !self.of[joint][1].is_empty()
    }
}

/// Whether a joint at its default has a tenth of its range left in one direction.
fn has_way(model: &Model, joint: usize, up: bool) -> bool {
    let [lo, hi] = room(model, joint);
    let at = model.qpos0()[model.jnt_qposadr()[joint] as usize];
    let left = if up { hi - at } else { at - lo };
    left >= 0.1 * (hi - lo)
}

/// The interval in which a joint may move: its range, or the room about its default.
fn room(model: &Model, joint: usize) -> [f64; 2] {
    if model.jnt_limited()[joint] != 0 {
        return [model.jnt_range()[2 * joint], model.jnt_range()[2 * joint + 1]];
    }
    let half = UNBOUNDED[usize::from(model.joint_type(joint) == Some(Joint::Slide))];
    let at = model.qpos0()[model.jnt_qposadr()[joint] as usize];
    [at - half, at + half]
}

/// Pose `k`, with the joint a quarter of its range from the near stop; pose 0 is the default one. Loops are
/// closed in their default pose only, so their joints stay there.
fn start(model: &Model, groups: &Groups, joint: usize, k: usize, up: bool) -> Option<Vec<f64>> {
    let mut qpos = model.qpos0().to_vec();
    for j in 0..model.jnt_type().len() {
        let [lo, hi] = room(model, j);
        let at = model.jnt_qposadr()[j] as usize;
        if groups.in_ring(j) {
            continue;
        }
        if j == joint {
            let quarter = 0.25 * (hi - lo);
            qpos[at] = if up { lo + quarter } else { hi - quarter };
        } else if k > 0 {
            qpos[at] = spread(j, k - 1, [lo, hi]);
        } else {
            qpos[at] = qpos[at].clamp(lo, hi);
        }
    }
    // Otherwise ties would throw the joint about, and its speed would not be that of its motors.
    ties::place(model, joint, &mut qpos);
    qpos.iter().all(|q| q.is_finite()).then_some(qpos)
}

/// Controls that drive a degree of freedom with the full force of its motors; `None` without a
/// motor.
fn full(model: &Model, data: &Data, dof: usize, up: bool) -> Option<Vec<f64>> {
    let nv = model.nv();
    let mut any = false;
    let ctrl = (0..model.nu())
        .map(|a| {
            let lever = data.actuator_moment()[a * nv + dof] * model.actuator_gainprm()[10 * a];
            let [lo, hi] = ctrlrange(model, a).unwrap_or([-1.0, 1.0]);
            if lever == 0.0 {
                return 0.0_f64.clamp(lo, hi);
            }
            any = true;
            if (lever > 0.0) == up { hi } else { lo }
        })
        .collect();
    any.then_some(ctrl)
}

/// The highest speed in the wanted direction within half the range, and the time until it is
/// reached; `None` if the simulation diverges.
fn run(data: &mut Data, model: &Model, joint: usize, up: bool, share: &mut Share) -> Option<Run> {
    let (at, dof) = (model.jnt_qposadr()[joint] as usize, model.jnt_dofadr()[joint] as usize);
    let sign = if up { 1.0 } else { -1.0 };
    let [lo, hi] = room(model, joint);
    let (half, from) = (0.5 * (hi - lo), data.qpos()[at]);
    let (mut best, mut before) = (0.0_f64, f64::NEG_INFINITY);
    let mut rise = Vec::new();
    for step in 1..=share.most {
        share.used += 1;
        data.step(1).ok()?;
        let (way, v) = (sign * (data.qpos()[at] - from), sign * data.qvel()[dof]);
        if !(way.is_finite() && v.is_finite()) {
            return None;
        }
        best = best.max(v);
        rise.push(v);
        // Gravity may be stronger: then the joint moves the other way.
        if way.abs() >= half {
            break;
        }
        if step % STEADY_STEPS == 0 {
            if (v - before).abs() <= STEADY * v.abs() {
                break;
            }
            before = v;
        }
        share.is_cut |= step == share.most && step < STEPS;
    }
    let steps = rise.iter().position(|v| *v >= RISEN * best).map_or(rise.len(), |at| at + 1);
    Some(Run { speed: best, acceleration: RISEN * best / (steps as f64 * model.timestep()) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn paces(xml: &str) -> Vec<Pace> {
        measure(&Arc::new(Model::from_xml(xml).unwrap())).unwrap().joints
    }

    fn arm(joint: &str, limit: f64) -> String {
        format!(
            r#"<mujoco><compiler angle="radian"/><option timestep=".005"/><worldbody><body><joint name="j" axis="0 1 0" range="-2 2" limited="true" {joint}/>
            <geom type="capsule" fromto="0 0 0 .5 0 0" size=".03" mass="1"/>
            <body pos=".5 0 0"><joint name="free" axis="0 1 0"/><geom size=".02" mass=".1"/></body></body></worldbody>
            <actuator><motor joint="j" ctrllimited="true" ctrlrange="-{limit} {limit}"/></actuator></mujoco>"#
        )
    }

    #[test]
    fn a_damped_joint_runs_at_torque_over_damping() {
        let weightless =
            arm("damping=\"10\"", 20.0).replace("<option ", "<option gravity=\"0 0 0\" ");
        let [Pace::Moves { speed: v, acceleration, .. }, Pace::Unknown] = paces(&weightless)[..]
        else {
            panic!()
        };
        assert!((v / 2.0 - 1.0).abs() < 0.03, "{v}");
        // Nine tenths of it after 2.3 time constants M/c = 11 ms.
        assert!((40.0..110.0).contains(&acceleration), "{acceleration}");
        // Gravity takes its share of the torque.
        let [Pace::Moves { speed: heavy, .. }, _] = paces(&arm("damping=\"10\"", 20.0))[..] else {
            panic!()
        };
        assert!(heavy > 1.4 && heavy < 1.99, "{heavy}");
    }

    #[test]
    fn a_free_joint_runs_as_fast_as_half_its_range_lets_it() {
        let weightless = arm("", 20.0).replace("<option ", "<option gravity=\"0 0 0\" ");
        let [Pace::Moves { speed: v, acceleration, .. }, _] = paces(&weightless)[..] else {
            panic!()
        };
        let want = 20.0 / 0.111;
        assert!((acceleration / want - 1.0).abs() < 0.15, "{acceleration}");
        assert!(v <= MOTOR_SPEED[0], "{v}: no task asks for more");
        // v^2 = 2 a s with .5 N m on .111 kg m^2 (and the other link held), over 2 rad.
        let weak = weightless.replace("\"-20 20\"", "\"-.5 .5\"");
        let [Pace::Moves { speed: v, .. }, _] = paces(&weak)[..] else { panic!() };
        let want = (2.0_f64 * 0.5 / 0.111 * 2.0).sqrt();
        assert!((v / want - 1.0).abs() < 0.15, "{v}, {want}");
    }

    #[test]
    fn a_joint_that_its_motor_cannot_lift_is_stuck() {
        assert_eq!(paces(&arm("damping=\"10\"", 0.01))[0], Pace::Stuck);
    }

    #[test]
    fn a_lift_that_drags_another_is_no_faster_than_its_motor() {
        // Its weight and half of the follower's leave 13 of 100 N, which damping spends at 26 mm/s.
        let lift = r#"<mujoco><compiler angle="radian"/><option timestep=".005"/><worldbody>
            <body><joint name="lift" type="slide" axis="0 0 1" range="0 .7" limited="true" damping="500"/>
              <geom size=".1" mass="5.8"/></body>
            <body pos="1 0 0"><joint name="torso" type="slide" axis="0 0 1" range="0 .35" limited="true"/>
              <geom size=".1" mass="6.1"/></body></worldbody>
            <equality><joint joint1="torso" joint2="lift" polycoef="0 .5 0 0 0"/></equality>
            <actuator><motor joint="lift" ctrllimited="true" ctrlrange="-100 100"/></actuator></mujoco>"#;
        let Pace::Moves { speed, .. } = paces(lift)[0] else { panic!() };
        assert!((0.015..0.04).contains(&speed), "{speed}");
    }

    #[test]
    fn a_loop_moves_with_the_one_motor_that_drives_it() {
        // A parallelogram: three joints of the loop have no motor, and holding one would stop it.
        let four_bar = r#"<mujoco><compiler angle="radian"/><option timestep=".005" gravity="0 0 0"/>
            <default><joint axis="0 1 0" damping=".01"/><geom type="capsule" size=".01" mass=".1"/></default><worldbody>
            <body><joint name="crank" damping="2" range="-1 1" limited="true"/><geom fromto="0 0 0 0 0 .2"/>
              <body name="rod_body" pos="0 0 .2"><joint name="rod"/><geom fromto="0 0 0 .3 0 0"/></body></body>
            <body pos=".3 0 0"><joint name="rocker"/><geom fromto="0 0 0 0 0 .2"/><body name="end" pos="0 0 .2"/></body>
            </worldbody><equality><connect body1="end" body2="rod_body" anchor="0 0 0"/></equality>
            <actuator><motor joint="crank" ctrllimited="true" ctrlrange="-2 2"/></actuator></mujoco>"#;
        let [Pace::Moves { speed, .. }, ..] = paces(four_bar)[..] else {
            panic!("{:?}", paces(four_bar));
        };
        assert!((0.7..1.1).contains(&speed), "{speed}: 2 N m spent by 2 N m s/rad");
        // A second one whose crank follows the first, as in a gripper with two fingers.
        let (head, rest) = four_bar.split_once("<worldbody>").unwrap();
        let (bodies, tail) = rest.split_once("</worldbody>").unwrap();
        let mut other = bodies.to_owned();
        for name in ["crank", "rod_body", "rod", "rocker", "end"] {
            other = other.replace(&format!("name=\"{name}\""), &format!("name=\"{name}2\""));
        }
        let both = format!(
            "{head}<worldbody>{bodies}<body pos=\"0 1 0\">{other}</body></worldbody>{tail}"
        )
        .replace(
            "</equality>",
            "<connect body1=\"end2\" body2=\"rod_body2\" anchor=\"0 0 0\"/>\
             <joint joint1=\"crank2\" joint2=\"crank\" polycoef=\"0 1 0 0 0\"/></equality>",
        );
        let all = paces(&both.replace("damping=\"2\"", "damping=\"1\""));
        let Pace::Moves { speed, .. } = all[0] else { panic!("{all:?}") };
        assert!((0.7..1.1).contains(&speed), "{speed}: 2 N m spent by twice 1 N m s/rad");
    }

    #[test]
    fn a_robot_of_any_size_is_measured_with_the_same_work() {
        // Chains of 50 links that take seconds to become fast.
        let chains = |count: usize| {
            let mut bodies = String::new();
            let mut motors = String::new();
            for chain in 0..count {
                for link in 0..50 {
                    let name = format!("j{chain}_{link}");
                    bodies += &[
                        "<body pos='0 0 1'><joint name='",
                        &name,
                        "' axis='0 0 1' range='-3 3' limited='true'/><inertial pos='0 0 0' mass='1' diaginertia='.09 .09 .09'/>",
                    ]
                    .concat();
                    motors += &["<motor joint='", &name, "' ctrllimited='true' ctrlrange='-5 5'/>"]
                        .concat();
                }
                bodies.push_str(&"</body>".repeat(50));
            }
            format!(
                "<mujoco><compiler angle='radian'/><option timestep='.005'/><worldbody>{bodies}</worldbody><actuator>{motors}</actuator></mujoco>"
            )
        };
        let model = Arc::new(Model::from_xml(&chains(5)).unwrap());
        let paces = measure(&model).unwrap();
        assert!(paces.joints.iter().all(|p| matches!(p, Pace::Moves { .. })));
        let cut = paces.cut_secs.unwrap();
        let steps = (cut / 0.005).round() as usize;
        assert!(steps >= 5 && 250 * 2 * steps * size(&model) <= WORK, "{steps}");
        let small = Arc::new(Model::from_xml(&chains(1)).unwrap());
        assert!(measure(&small).unwrap().cut_secs.is_none_or(|secs| secs > 0.2));
        assert_eq!(size(&small), 50 + (1..=50).map(|d| d * d / 2).sum::<usize>() / CHAINED);
    }
}
