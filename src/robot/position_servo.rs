//! A position servo as a controller sees it.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};

use super::law::Law;
use super::motors::ctrlrange;
use super::response::lasting;
use robert_base::units::{CTRL_DT, SIM_DT, SUBSTEPS};
use robert_mujoco::Data;

/// If more than this share of the distance is left after a frame, the servo is too soft, and its
/// control is not extrapolated.
const MOST_KEPT: f64 = 0.98;
/// A disturbance that is at most this large after a frame, relative to before, has no need to end
/// sooner.
const CALM: f64 = 0.9;
/// A servo that covers a share of the way per frame covers less of it where its joint is heavier.
/// Disturbances may last as long as at this part of the share.
const SLACK: f64 = 0.25;
/// The lead is found to within 1/2^LEAD_STEPS.
const LEAD_STEPS: usize = 6;
/// Robots with more servos than this have one lead for all: the search for each would take seconds.
const OWN_LEADS: usize = 40;

/// Tells which control of a position servo moves its length to a target in one frame.
///
/// With the control held, the length swings towards the servo's rest length as a damped mass does.
/// A frame later, with x the distance from rest, x' = a x + b v. The rest length that leaves the
/// length at l + way is l + (way - b v)/(1 - a), if the servo were alone. Several stiff servos on
/// one arm with little damping push each other away, and such controls make them oscillate ever
/// more, even where the bare target as control would have held them still. So the control is a mean
/// of both: `lead` of the first and 1 - `lead` of the target.
#[derive(Clone, Debug, PartialEq)]
pub struct PositionServo {
    /// Joints of the state that it moves, with their moment arms.
    pub arms: Vec<(usize, f64)>,
    /// The part of each of these joints' weight that it carries.
    shares: Vec<f64>,
    /// The length when all these joints are at zero.
    offset: f64,
    law: Law,
    middle: f64,
    half: f64,
    /// a and b of a frame.
    keep: f64,
    coast: f64,
    /// Between 0 and 1; 1 until [`PositionServo::calm`] has chosen it.
    lead: f64,
}

impl PositionServo {
    /// The servo of an actuator. `data` is at a pose with the state `state` (S), and `dofs` are the
    /// degrees of freedom of the state joints, `mass` their inertias (S). `None` if the actuator is
    /// not a position servo.
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
            shares: vec![1.0; arms.len()],
            arms,
            offset: data.actuator_length()[actuator] - along,
            law,
            middle: 0.5 * (lo + hi),
            half: (0.5 * (hi - lo)).max(f64::MIN_POSITIVE),
            keep: swing(1.0, 0.0).min(MOST_KEPT),
            coast: swing(0.0, 1.0),
            lead: 1.0,
        })
    }

    /// The action, clamped to -1..1, that moves the joints from `q` towards `target`, at speeds `v`,
    /// against the torques `weight`; (S) each, the last may be empty. At full lead a joint alone
    /// covers `share` of the distance in one frame.
    pub fn action(&self, share: f64, q: &[f64], v: &[f64], target: &[f64], weight: &[f64]) -> f64 {
        let along = |x: &[f64]| -> f64 { self.arms.iter().map(|(k, a)| a * x[*k]).sum() };
        let way = along(target) - along(q);
        let [by_way, by_speed] = self.gains(share);
        let rest = self.offset + along(q) + by_way * way - by_speed * along(v);
        let square: f64 = self.arms.iter().map(|(_, a)| a * a).sum();
        let carried = if weight.is_empty() {
            0.0
        } else {
            let parts = self.arms.iter().zip(&self.shares);
            parts.map(|((k, a), part)| part * a * weight[*k]).sum::<f64>() / square
        };
        let stiffness = -self.law.bias[1];
        let ctrl = (stiffness * rest + carried - self.law.bias[0]) / self.law.gain;
        ((ctrl - self.middle) / self.half).clamp(-1.0, 1.0)
    }

    /// How far from the present length the servo's rest is put, by the way to go and the speed.
    fn gains(&self, share: f64) -> [f64; 2] {
        let full = self.lead / (1.0 - self.keep);
        [full * share + 1.0 - self.lead, full * self.coast]
    }

    /// Divides the weight of each joint equally among the servos that move it, as if they were
    /// equally strong.
    pub(super) fn share_weights(servos: &mut [Option<PositionServo>]) {
        let mut carriers = BTreeMap::new();
        for (k, _) in servos.iter().flatten().flat_map(|servo| &servo.arms) {
            *carriers.entry(*k).or_insert(0.0) += 1.0;
        }
        for servo in servos.iter_mut().flatten() {
            servo.shares = servo.arms.iter().map(|(k, _)| 1.0 / carriers[k]).collect();
        }
    }

    /// Lowers the leads of servos that act on one robot until they move calmly together at each of
    /// these `shares` per frame: in no pose does a disturbance last longer than [`SLACK`] and
    /// [`CALM`] allow, or than it does if the controls are constant. First one lead is found for
    /// all; then each servo gets more where the others bear it, slow ones first. `inertias` are those
    /// of the state joints in the poses, (S, S) each, and `damping` is that of the joints (S).
    pub(super) fn calm(
        servos: &mut [Option<PositionServo>],
        shares: &[f64],
        inertias: &[DMatrix<f64>],
        damping: &[f64],
    ) {
        let mut servos: Vec<&mut PositionServo> = servos.iter_mut().flatten().collect();
        let frames: Vec<Frame> =
            inertias.iter().filter_map(|mass| Frame::of(&servos, mass, damping)).collect();
        let bare: Vec<f64> = frames.iter().map(|frame| lasting(frame.free.clone())).collect();
        let calm = |servos: &[&mut PositionServo]| {
            shares.iter().all(|&share| {
                let gains: Vec<[f64; 2]> = servos.iter().map(|servo| servo.gains(share)).collect();
                frames.iter().zip(&bare).all(|(frame, bare)| {
                    frame.lasting(&gains) <= bare.max(CALM).max(1.0 - SLACK * share) + 1e-3
                })
            })
        };
        let lead = |servos: &mut [&mut PositionServo], lead: f64| {
            servos.iter_mut().for_each(|servo| servo.lead = lead);
        };
        if calm(&servos) {
            return;
        }
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..LEAD_STEPS {
            let middle = 0.5 * (low + high);
            lead(&mut servos, middle);
            *(if calm(&servos) { &mut low } else { &mut high }) = middle;
        }
        lead(&mut servos, low);
        // The lead of all is that of the most restless servo. The slowest ones need theirs most.
        if servos.len() > OWN_LEADS {
            return;
        }
        let mut order: Vec<usize> = (0..servos.len()).collect();
        order.sort_by(|a, b| servos[*b].keep.total_cmp(&servos[*a].keep));
        for k in order {
            for more in [1.0, 0.5 + 0.5 * low] {
                servos[k].lead = more;
                if calm(&servos) {
                    break;
                }
                servos[k].lead = low;
            }
        }
    }
}

/// Joints under position servos for one frame, about a pose at which they rest: x' = free x + push
/// e, with x the positions and the ways that the speeds make in a frame, and e the distances of the
/// servos' rest lengths. All other joints are free to move.
struct Frame {
    /// (2n, 2n) of the n joints that servos move.
    free: DMatrix<f64>,
    /// (2n, servos).
    push: DMatrix<f64>,
    /// Moment arms; (servos, n).
    arms: DMatrix<f64>,
}

impl Frame {
    /// `None` if the inertia is singular.
    fn of(servos: &[&mut PositionServo], mass: &DMatrix<f64>, damping: &[f64]) -> Option<Frame> {
        let mut joints: Vec<usize> =
            servos.iter().flat_map(|servo| servo.arms.iter().map(|(joint, _)| *joint)).collect();
        joints.sort_unstable();
        joints.dedup();
        let n = joints.len();
        let arms = DMatrix::from_fn(servos.len(), n, |row, column| {
            let arm = servos[row].arms.iter().find(|(joint, _)| *joint == joints[column]);
            arm.map_or(0.0, |(_, arm)| *arm)
        });
        let of_law = |bias: usize| {
            let each = servos.iter().map(|servo| -servo.law.bias[bias]);
            DMatrix::from_diagonal(&DVector::from_iterator(servos.len(), each))
        };
        let pull = arms.transpose() * of_law(1);
        let drag = arms.transpose() * of_law(2) * &arms;
        let damped = mass + DMatrix::from_diagonal(&DVector::from_row_slice(damping)) * SIM_DT;
        let inverse = damped.try_inverse()?;
        let implicit = DMatrix::from_fn(n, n, |r, c| inverse[(joints[r], joints[c])]);
        let damping = DVector::from_iterator(n, joints.iter().map(|joint| damping[*joint]));
        let mass = implicit.clone().try_inverse()? - DMatrix::from_diagonal(&damping) * SIM_DT;
        // Of a substep: speeds by position, by speed and by rest length.
        let by_position = &implicit * &pull * &arms * -SIM_DT;
        let by_speed = &implicit * (mass - drag * SIM_DT);
        let by_rest = implicit * pull * SIM_DT;
        let mut step = DMatrix::zeros(2 * n, 2 * n);
        step.view_mut((0, 0), (n, n)).copy_from(&(DMatrix::identity(n, n) + &by_position * SIM_DT));
        step.view_mut((0, n), (n, n)).copy_from(&(&by_speed * SIM_DT));
        step.view_mut((n, 0), (n, n)).copy_from(&by_position);
        step.view_mut((n, n), (n, n)).copy_from(&by_speed);
        let mut pushed = DMatrix::zeros(2 * n, servos.len());
        pushed.rows_mut(0, n).copy_from(&(&by_rest * SIM_DT));
        pushed.rows_mut(n, n).copy_from(&by_rest);
        let mut free = DMatrix::identity(2 * n, 2 * n);
        let mut push = DMatrix::zeros(2 * n, servos.len());
        for _ in 0..SUBSTEPS {
            free = &step * free;
            push = &step * push + &pushed;
        }
        // Speeds as ways, so that both halves of a swing are of one size.
        for k in n..2 * n {
            free.row_mut(k).scale_mut(CTRL_DT);
            free.column_mut(k).unscale_mut(CTRL_DT);
            push.row_mut(k).scale_mut(CTRL_DT);
        }
        Some(Frame { free, push, arms })
    }

    /// The factor by which the slowest disturbance decays per frame under [`PositionServo::gains`].
    fn lasting(&self, gains: &[[f64; 2]]) -> f64 {
        let n = self.arms.ncols();
        let by = |of: &dyn Fn(&[f64; 2]) -> f64| {
            let each = gains.iter().map(of);
            DMatrix::from_diagonal(&DVector::from_iterator(gains.len(), each)) * &self.arms
        };
        // The target is at zero: e = q - by_way q - by_speed v.
        let mut feedback = DMatrix::zeros(gains.len(), 2 * n);
        feedback.columns_mut(0, n).copy_from(&by(&|[way, _]| 1.0 - way));
        feedback.columns_mut(n, n).copy_from(&by(&|[_, speed]| -speed / CTRL_DT));
        lasting(&self.free + &self.push * feedback)
    }
}

/// Distance from rest after a frame.
fn frame(inertia: f64, damping: f64, law: &Law, mut x: f64, mut v: f64) -> f64 {
    for _ in 0..SUBSTEPS {
        let force = law.bias[1] * x + law.bias[2] * v;
        v = (inertia * v + SIM_DT * force) / (inertia + SIM_DT * damping);
        x += SIM_DT * v;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use robert_mujoco::Model;

    /// Three links in a row on servos of stiffness 200 N m/rad.
    fn chain(damping: f64) -> Data {
        let link = |k: usize| {
            format!(
                r#"<body pos="{x} 0 0"><joint name="j{k}" axis="0 1 0" damping="{damping}"/>
                <geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1" contype="0"/>"#,
                x = if k == 0 { 0.0 } else { 0.3 },
            )
        };
        let servo =
            |k| format!(r#"<position joint="j{k}" kp="200" ctrllimited="true" ctrlrange="-3 3"/>"#);
        let links: String = (0..3).map(link).collect();
        let servos: String = (0..3).map(servo).collect();
        let text = format!(
            r#"<mujoco><option timestep="{SIM_DT}" gravity="0 0 0" integrator="Euler"/>
            <worldbody>{links}</body></body></body></worldbody>
            <actuator>{servos}</actuator></mujoco>"#
        );
        let mut data = Data::new(&Model::from_xml(&text).unwrap().into()).unwrap();
        data.forward().unwrap();
        data
    }

    fn inertia(data: &mut Data) -> DMatrix<f64> {
        let mut mass = vec![0.0; 9];
        data.full_mass(&mut mass).unwrap();
        DMatrix::from_row_slice(3, 3, &mass)
    }

    fn servos(data: &Data, mass: &DMatrix<f64>) -> Vec<Option<PositionServo>> {
        let own: Vec<f64> = mass.diagonal().iter().copied().collect();
        (0..3).map(|a| PositionServo::of(data, a, &[0.0; 3], &[0, 1, 2], &own)).collect()
    }

    /// The largest distance from the target in the last of 100 frames, after one joint was moved by
    /// .05 rad. Infinite if the simulation diverges.
    fn left(data: &mut Data, servos: &[Option<PositionServo>]) -> f64 {
        data.set_qpos(&[0.05, 0.0, 0.0]).unwrap();
        data.set_qvel(&[0.0; 3]).unwrap();
        let mut far = 0.0;
        for frame in 0..100 {
            let (q, v) = (data.qpos().to_vec(), data.qvel().to_vec());
            let act = |s: &Option<PositionServo>| {
                s.as_ref().unwrap().action(0.9, &q, &v, &[0.0; 3], &[]) * 3.0
            };
            let ctrl: Vec<f64> = servos.iter().map(act).collect();
            data.set_ctrl(&ctrl).unwrap();
            if data.step(SUBSTEPS).is_err() {
                return f64::INFINITY;
            }
            if frame >= 90 {
                far = data.qpos().iter().fold(far, |far: f64, q| far.max(q.abs()));
            }
        }
        far
    }

    #[test]
    fn two_servos_of_one_joint_share_its_weight() {
        let mut data = chain(1.0);
        let mass = inertia(&mut data);
        let one = servos(&data, &mass)[0].clone();
        let mut alone = vec![one.clone(), None];
        let mut together = vec![one.clone(), one];
        PositionServo::share_weights(&mut alone);
        PositionServo::share_weights(&mut together);
        let action = |servos: &[Option<PositionServo>], weight: &[f64]| {
            servos[0].as_ref().unwrap().action(0.0, &[0.0; 3], &[0.0; 3], &[0.0; 3], weight)
        };
        let carried = |servos: &[Option<PositionServo>]| {
            action(servos, &[0.2, 0.0, 0.0]) - action(servos, &[0.0; 3])
        };
        assert!(carried(&alone).abs() > 1e-6);
        assert!((carried(&together) / carried(&alone) - 0.5).abs() < 1e-9);
    }

    #[test]
    fn stiff_servos_on_one_arm_come_to_rest() {
        let mut data = chain(1.0);
        let mass = inertia(&mut data);
        let mut servos = servos(&data, &mass);
        let alone = left(&mut data, &servos);
        assert!(alone > 0.1, "they oscillate ever more: {alone}");
        PositionServo::calm(&mut servos, &[0.9], &[mass], &[1.0; 3]);
        let lead = servos[0].as_ref().unwrap().lead;
        assert!((0.0..0.9).contains(&lead), "{lead}");
        let together = left(&mut chain(1.0), &servos);
        assert!(together < 0.005, "{together}");
    }

    #[test]
    fn damped_servos_keep_their_full_lead() {
        let mut data = chain(40.0);
        let mass = inertia(&mut data);
        let mut servos = servos(&data, &mass);
        let heavier = &mass * 3.0;
        PositionServo::calm(&mut servos, &[0.03, 0.9], &[heavier, mass], &[40.0; 3]);
        assert!(servos.iter().flatten().all(|servo| servo.lead == 1.0), "{servos:?}");
        assert!(left(&mut data, &servos) < 1e-4);
    }

    #[test]
    fn a_frame_is_its_substeps() {
        let mut data = chain(1.0);
        let mass = inertia(&mut data);
        let mut servos = servos(&data, &mass);
        let servos: Vec<&mut PositionServo> = servos.iter_mut().flatten().collect();
        let frame = Frame::of(&servos, &mass, &[1.0; 3]).unwrap();
        data.set_qpos(&[1e-4, -2e-4, 1e-4]).unwrap();
        data.set_qvel(&[1e-3, 0.0, -1e-3]).unwrap();
        data.set_ctrl(&[1e-4, 0.0, 2e-4]).unwrap();
        let now = |data: &Data| {
            let ways = data.qvel().iter().map(|v| v * CTRL_DT);
            DVector::from_iterator(6, data.qpos().iter().copied().chain(ways))
        };
        let before = now(&data);
        data.step(SUBSTEPS).unwrap();
        let after = &frame.free * before + &frame.push * DVector::from_row_slice(data.ctrl());
        let got = now(&data);
        assert!((&after - &got).norm() < 1e-2 * got.norm(), "{after} {got}");
    }
}
