//! Computed torque: inverse dynamics of the true model on one-frame targets.
//!
//! The torque is held for a frame of n substeps, during which a damped arm does not keep its
//! initial acceleration. The textbook law qacc = ((r - q)/T - v)/T is half a frame late on our arm.
//! With the bias forces cancelled by the inverse dynamics the frame is linear ([`Response`]): q(T)
//! = q + G v + H u, v(T) = P v + S u, and u solves q(T) = r exactly, including couplings. The
//! remaining velocity alternates with the sampling zeros of the plant. If these hardly decay (light
//! damping), the law solves v(T) = (r - q)/T instead, which never rings.
//!
//! A servo gives way within the frame as the joint moves, which the response includes. Exact targets make
//! stiff servos with little damping swing, so among both laws and the servo by itself the one is taken under
//! which disturbances decay best, also if the inertia is not exactly known.
//!
//! Contact forces are left out of the inverse dynamics. A law that cancels them answers with full
//! torque and pushes a finger through the palm (error 0.14 rad on rock-scissor-paper, 0.06
//! without). Dry friction and stops are included. Equality constraints are left out, too: what they
//! carry is transmitted to the motors ([`Loops`]).
//!
//! Rejected: gains for each joint alone. On the arm the joints are coupled through the inertia
//! matrix M, and such gains make it oscillate by 0.03 rad.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::actuation::Actuation;
use super::error::Error;
use super::nominal_model::NominalModel;
use super::policy::{Policy, View};
use robert_base::units::CTRL_DT;
use robert_mujoco::{Data, Model};
use robert_robot::{Loops, Response, Robot};

/// Sampling zeros with a magnitude beyond this ring visibly before they decay. The formula is that
/// of continuous time. With ten substeps per frame the ringing is weaker (pointmass: 0.85 by the
/// formula, 0.69 in the simulator).
const RINGING: f64 = 0.9;

/// Up to this many joints the law is computed for the current pose in every frame. Beyond that it
/// would cost as much as the simulation, and the law of the home pose is used.
const FOLLOW_POSE: usize = 16;

/// Inverse dynamics with the robot's nominal model.
#[derive(Debug)]
pub(super) struct ComputedTorque {
    nominal: NominalModel,
    actuation: Actuation,
    law: Law,
    mass: Vec<f64>,
    torque: Vec<f64>,
    /// What transmits the torque of joints without actuators, if anything does.
    loops: Option<Loops>,
    servos: Option<Servos>,
}

/// How servos give way, see [`Actuation::servos`], and how they are driven.
#[derive(Debug)]
struct Servos {
    stiffness: DMatrix<f64>,
    drag: DMatrix<f64>,
    aim: Aim,
}

/// What a law brings about by the end of a frame.
#[derive(Clone, Copy, Debug)]
enum Aim {
    /// The target.
    Target,
    /// The speed that would have led to the target.
    Speed,
    /// What a servo does that is commanded to the target.
    Servo,
}

/// Servos are driven to exact targets if a disturbance shrinks at least by this factor a frame, with any of
/// these factors of the inertia: it is computed for the pose at the beginning of the frame.
const DECAYS: f64 = 0.97;
const HEAVIER: [f64; 3] = [0.95, 1.0, 1.05];

impl Servos {
    /// Chooses the aim: the target, if disturbances decay well; else the one under which they decay
    /// best.
    fn new(
        [stiffness, drag]: [DMatrix<f64>; 2],
        mass: &DMatrix<f64>,
        damping: &[f64],
        h: f64,
        n: usize,
    ) -> Servos {
        let servos = Servos { stiffness, drag, aim: Aim::Servo };
        let lasts = |aim: Aim| -> Option<f64> {
            let [way, speed] = gains(aim, &servos.response(mass, damping, h, n)?, Some(&servos))?;
            let each = HEAVIER.map(|f| servos.response(&(mass * f), damping, h, n));
            each.into_iter()
                .map(|r| Some(r?.under(&way, &speed)))
                .try_fold(0.0, |most, one| Some(f64::max(most, one?)))
        };
        let lasting = |aim: Aim| lasts(aim).unwrap_or(f64::INFINITY);
        let aims = [Aim::Target, Aim::Speed, Aim::Servo].map(|aim| (aim, lasting(aim)));
        let best = aims.iter().min_by(|a, b| a.1.total_cmp(&b.1)).map_or(Aim::Servo, |best| best.0);
        let aim = if aims[0].1 < DECAYS { Aim::Target } else { best };
        Servos { aim, ..servos }
    }

    fn response(&self, mass: &DMatrix<f64>, damping: &[f64], h: f64, n: usize) -> Option<Response> {
        Response::of_servos(mass, damping, [&self.stiffness, &self.drag], h, n)
    }
}

/// The torque u = way (r - q) + speed v at the beginning of a frame; `None` if none has this aim.
fn gains(aim: Aim, response: &Response, servos: Option<&Servos>) -> Option<[DMatrix<f64>; 2]> {
    match aim {
        Aim::Target => {
            let inv = response.way.clone().try_inverse()?;
            let speed = -(&inv * &response.coast);
            Some([inv, speed])
        }
        Aim::Speed => {
            let inv = response.speed.clone().try_inverse()?;
            let speed = -(&inv * &response.keep);
            Some([inv / CTRL_DT, speed])
        }
        Aim::Servo => servos.map(|s| [s.stiffness.clone(), -s.drag.clone()]),
    }
}

/// qacc = way (r - q) + speed v.
#[derive(Debug)]
struct Law {
    way: DMatrix<f64>,
    speed: DMatrix<f64>,
}

impl Law {
    /// The law for a joint-space inertia; `None` if it is singular.
    fn new(
        mass: &[f64],
        damping: &[f64],
        servos: Option<&Servos>,
        h: f64,
        n: usize,
    ) -> Option<Law> {
        let nv = damping.len();
        let m = DMatrix::from_row_slice(nv, nv, mass);
        let d = DMatrix::from_diagonal(&DVector::from_row_slice(damping));
        let response = match servos {
            None => Response::new(&m, damping, h, n)?,
            Some(servos) => servos.response(&m, damping, h, n)?,
        };
        let aim = match servos {
            Some(servos) => servos.aim,
            None if rings(mass, damping) => Aim::Speed,
            None => Aim::Target,
        };
        let [gain_way, gain_speed] = gains(aim, &response, servos)?;
        let m_inv = m.try_inverse()?;
        // qacc = M^-1 (u - D v).
        Some(Law { way: &m_inv * gain_way, speed: m_inv * (gain_speed - d) })
    }
}

/// Whether exact position targets would make some joint alternate between two torques. The sampling
/// zero of a joint by itself is -(g - T e)/(T - g), with e = exp(-T/tau), g = tau (1 - e).
fn rings(mass: &[f64], damping: &[f64]) -> bool {
    let nv = damping.len();
    (0..nv).any(|j| {
        let (inertia, c) = (mass[j * nv + j].max(1e-12), damping[j]);
        if c * CTRL_DT < 1e-6 * inertia {
            return true;
        }
        let tau = inertia / c;
        let e = (-CTRL_DT / tau).exp();
        let g = tau * (1.0 - e);
        (g - CTRL_DT * e) / (CTRL_DT - g) > RINGING
    })
}

impl ComputedTorque {
    /// Prepares the model.
    ///
    /// # Errors
    /// [`Error::Setup`], [`Error::Timestep`].
    pub(super) fn new(robot: &Arc<Robot>) -> Result<ComputedTorque, Error> {
        ComputedTorque::on(robot, robot.model())
    }

    /// Prepares another model of the robot.
    ///
    /// # Errors
    /// As [`ComputedTorque::new`].
    pub(super) fn on(robot: &Arc<Robot>, model: &Model) -> Result<ComputedTorque, Error> {
        let loops = Loops::on(model)?;
        // The wanted accelerations of a loop's joints do not fit together exactly, and a constraint
        // would answer with forces without bound.
        let mut free = model.duplicate()?;
        free.set_contacts(false);
        free.set_equalities(false);
        let mut nominal = NominalModel::on(robot, &Arc::new(free))?;
        robot.write_state(&mut nominal.data, &robot.home())?;
        let actuation = Actuation::new(robot, &mut nominal.data)?;
        let nv = robot.model().nv();
        let mut mass = vec![0.0; nv * nv];
        nominal.data.forward()?;
        let zero = Law { way: DMatrix::zeros(nv, nv), speed: DMatrix::zeros(nv, nv) };
        nominal.data.full_mass(&mut mass)?;
        let m = DMatrix::from_row_slice(nv, nv, &mass);
        let (h, n, damping) = (model.timestep(), nominal.substeps, model.dof_damping());
        let servos = actuation.servos().map(|s| Servos::new(s, &m, damping, h, n));
        let law = law_here(&mut nominal.data, &mut mass, servos.as_ref(), n)?;
        let (law, torque) = (law.unwrap_or(zero), vec![0.0; nv]);
        Ok(ComputedTorque { nominal, actuation, law, mass, torque, loops, servos })
    }
}

/// The law at the pose that `data` was last computed for.
fn law_here(
    data: &mut Data,
    mass: &mut [f64],
    servos: Option<&Servos>,
    substeps: usize,
) -> Result<Option<Law>, Error> {
    data.full_mass(mass)?;
    let model = data.model();
    Ok(Law::new(mass, model.dof_damping(), servos, model.timestep(), substeps))
}

impl Policy for ComputedTorque {
    fn name(&self) -> String {
        "computed-torque".into()
    }

    fn uses_model(&self) -> bool {
        true
    }

    fn reset(&mut self, _seed: u64) {}

    fn act(&mut self, view: &View<'_>, action: &mut [f64]) -> Result<(), Error> {
        let nv = self.torque.len();
        let data = &mut self.nominal.data;
        data.restore(view.state)?;
        if nv <= FOLLOW_POSE {
            data.forward()?;
            let (servos, substeps) = (self.servos.as_ref(), self.nominal.substeps);
            if let Some(law) = law_here(data, &mut self.mass, servos, substeps)? {
                self.law = law;
            }
        }
        let mut way = DVector::zeros(nv);
        for (k, joint) in self.nominal.robot.joints().iter().enumerate() {
            way[joint.dofadr] = view.window.next_target(k) - view.window.current[k];
        }
        let speed = DVector::from_row_slice(&view.state.qvel);
        let qacc = &self.law.way * way + &self.law.speed * speed;
        data.set_qacc(qacc.as_slice())?;
        data.inverse()?;
        self.torque.copy_from_slice(data.qfrc_inverse());
        if let Some(loops) = &mut self.loops {
            loops.at(&view.state.qpos)?.apply(&mut self.torque);
        }
        self.actuation.action(&self.torque, &view.state.qpos, &view.state.qvel, action);
        Ok(())
    }
}
