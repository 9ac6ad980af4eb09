//! Adaptive computed torque: inverse dynamics of a model whose mass, damping and motor strength are
//! identified while the robot moves.
//!
//! After every frame the reached velocities are compared with a simulation of that frame on the
//! present estimate. The three factors then move by a step of the extended Kalman filter: a
//! recursive least-squares fit of their logarithms, with the gradients from three more simulations.
//! This is the classical rival of a learned policy that infers the plant from the past (Slotine and
//! Li 1987 adapt the same parameters, without a simulator). Under gravity a common factor on all
//! three changes nothing, and the assumption that the file is right settles it.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use super::computed_torque::ComputedTorque;
use super::error::Error;
use super::nominal_model::NominalModel;
use super::policy::{Policy, View};
use robert_mujoco::Snapshot;
use robert_robot::{PlantConfig, Robot};

/// Standard deviation of the logarithm of a factor before anything is known.
const SPREAD: f64 = 0.3;
/// How far a factor may drift in a frame; it keeps the filter awake.
const DRIFT: f64 = 5e-4;
/// Velocity error that no factor explains, as a share of the fastest joint's speed.
const NOISE: f64 = 0.02;
/// The least such error, rad/s or m/s.
const LEAST_NOISE: f64 = 1e-3;
/// Distance of the simulations that measure gradients.
const STEP: f64 = 0.05;
/// The largest logarithm of a factor: a quarter or four times.
const LARGEST_LOG: f64 = 1.386;
/// Numbers of a memory before what is expected: factors, covariance, and factors of the models.
const OWN: usize = 15;
/// Change of a factor below which its model is not rebuilt.
const SAME: f64 = 1e-3;

/// Inverse dynamics on an identified model.
pub(super) struct AdaptiveComputedTorque {
    robot: Arc<Robot>,
    /// Logarithms of the factors on mass, damping and motor strength, and their covariance.
    factors: Vector3<f64>,
    covariance: Matrix3<f64>,
    /// The velocities that the last action leads to, by the estimate and with each factor a step
    /// larger, (4, nv); empty if unknown.
    expected: Vec<f64>,
    /// The state at which the last action began.
    last: Option<Snapshot>,
    /// The factors of the models below.
    built: Vector3<f64>,
    law: ComputedTorque,
    models: [NominalModel; 4],
}

impl AdaptiveComputedTorque {
    /// Begins with the robot of the file.
    ///
    /// # Errors
    /// [`Error::Setup`], [`Error::Timestep`].
    pub(super) fn new(robot: &Arc<Robot>) -> Result<AdaptiveComputedTorque, Error> {
        let factors = Vector3::zeros();
        Ok(AdaptiveComputedTorque {
            factors,
            covariance: Matrix3::identity() * SPREAD.powi(2),
            expected: Vec::new(),
            last: None,
            built: factors,
            law: ComputedTorque::new(robot)?,
            models: models(robot, &factors)?,
            robot: Arc::clone(robot),
        })
    }

    /// Learns from the velocities of the reached state.
    fn learn(&mut self, state: &Snapshot) -> Result<(), Error> {
        let reached = &state.qvel;
        let nv = reached.len();
        if self.expected.len() != 4 * nv || self.touches(state)? {
            return Ok(());
        }
        let of = |k: usize| &self.expected[k * nv..(k + 1) * nv];
        let gradient = DMatrix::from_fn(nv, 3, |i, k| (of(k + 1)[i] - of(0)[i]) / STEP);
        // The models may be a little behind the estimate.
        let ahead = &gradient * DVector::from_column_slice((self.factors - self.built).as_slice());
        let surprise = DVector::from_fn(nv, |i, _| reached[i] - of(0)[i] - ahead[i]);
        let fastest = reached.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        // After a good fit, only what no factor explains is left of the surprise.
        let left = surprise.norm() / (nv as f64).sqrt();
        let noise = (NOISE * fastest).max(LEAST_NOISE).max(left).powi(2);
        self.covariance += Matrix3::identity() * DRIFT.powi(2);
        let weighted = gradient.transpose() / noise;
        let information = &weighted * &gradient;
        let known = self.covariance.try_inverse().unwrap_or_else(Matrix3::identity)
            + Matrix3::from_fn(|r, c| information[(r, c)]);
        // Both terms are positive definite, so the sum has an inverse.
        let Some(covariance) = known.try_inverse() else { return Ok(()) };
        self.covariance = covariance;
        let push = weighted * surprise;
        self.factors += covariance * Vector3::from_fn(|k, _| push[k]);
        self.factors.iter_mut().for_each(|f| *f = f.clamp(-LARGEST_LOG, LARGEST_LOG));
        Ok(())
    }

    /// Whether links touch in this state; forces of contact hide those of the plant.
    fn touches(&mut self, state: &Snapshot) -> Result<bool, Error> {
        let data = &mut self.models[0].data;
        data.restore(state)?;
        data.forward()?;
        Ok(data.touches_itself())
    }

    /// Rebuilds the models if the estimate has moved.
    fn rebuild(&mut self) -> Result<(), Error> {
        if (self.factors - self.built).amax() > SAME {
            self.models = models(&self.robot, &self.factors)?;
            self.law = ComputedTorque::on(&self.robot, self.models[0].data.model())?;
            self.built = self.factors;
        }
        Ok(())
    }

    /// Simulates the frame that begins at `state` with this action.
    fn expect(&mut self, state: &Snapshot, action: &[f64]) -> Result<(), Error> {
        self.expected.clear();
        for model in &mut self.models {
            model.data.restore(state)?;
            self.robot.apply_action(&mut model.data, action)?;
            let diverged = model.data.step(model.substeps).is_err();
            if diverged || model.data.touches_itself() {
                self.expected.clear();
                return Ok(());
            }
            self.expected.extend_from_slice(model.data.qvel());
        }
        Ok(())
    }
}

/// Simulations of the estimate, and with each factor a step larger.
fn models(robot: &Arc<Robot>, factors: &Vector3<f64>) -> Result<[NominalModel; 4], Error> {
    let one = |larger: Option<usize>| {
        let of = |k: usize| (factors[k] + if larger == Some(k) { STEP } else { 0.0 }).exp();
        let plant = PlantConfig { mass: of(0), damping: of(1), gear: of(2), payload: 0.0 };
        NominalModel::on(robot, &plant.model(robot)?)
    };
    Ok([one(None)?, one(Some(0))?, one(Some(1))?, one(Some(2))?])
}

impl Policy for AdaptiveComputedTorque {
    fn name(&self) -> String {
        "adaptive-computed-torque".into()
    }

    fn uses_model(&self) -> bool {
        true
    }

    fn reset(&mut self, _seed: u64) {
        let mut beginning = vec![0.0; OWN];
        let covariance = Matrix3::<f64>::identity() * SPREAD.powi(2);
        beginning[3..12].copy_from_slice(covariance.as_slice());
        self.recall(&beginning);
    }

    fn act(&mut self, view: &View<'_>, action: &mut [f64]) -> Result<(), Error> {
        self.learn(view.state)?;
        self.rebuild()?;
        self.law.act(view, action)?;
        self.last = Some(view.state.clone());
        self.expect(view.state, action)
    }

    fn applied(&mut self, action: &[f64]) {
        // The expectation was for another action.
        if let Some(last) = self.last.take()
            && self.expect(&last, action).is_err()
        {
            self.expected.clear();
        }
    }

    fn memory(&self) -> Vec<f64> {
        let own = self.factors.iter().chain(self.covariance.iter()).chain(self.built.iter());
        own.chain(&self.expected).copied().collect()
    }

    fn recall(&mut self, memory: &[f64]) {
        let (own, expected) = memory.split_at(OWN);
        self.factors = Vector3::from_column_slice(&own[..3]);
        self.covariance = Matrix3::from_column_slice(&own[3..12]);
        let built = Vector3::from_column_slice(&own[12..]);
        self.expected = expected.to_vec();
        if built != self.built
            && let Ok(models) = models(&self.robot, &built)
            && let Ok(law) = ComputedTorque::on(&self.robot, models[0].data.model())
        {
            (self.models, self.law, self.built) = (models, law, built);
        }
    }
}

impl std::fmt::Debug for AdaptiveComputedTorque {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let factors = self.factors.map(f64::exp);
        f.debug_struct("AdaptiveComputedTorque").field("factors", &factors).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Rollout, RolloutConfig, Start, tasks};
    use robert_base::progress::Cancel;
    use robert_clip::compile;

    fn perform(task: &str, plant: PlantConfig, policy: Box<dyn Policy>) -> Rollout {
        let clip = tasks::find(task, None).unwrap();
        let robot = Arc::new(Robot::builtin(&clip.robot.id).unwrap());
        let config = RolloutConfig { plant, ..RolloutConfig::default() };
        let command = compile(&clip).unwrap();
        let mut rollout = Rollout::new(&robot, policy, &command, Start::Pose, config).unwrap();
        rollout.run(&Cancel::default()).unwrap();
        rollout
    }

    #[test]
    fn a_wrong_file_is_found_out() {
        let robot = Arc::new(Robot::builtin("ur5e").unwrap());
        let plant = PlantConfig { mass: 1.1, damping: 1.6, gear: 0.95, payload: 0.0 };
        let error = |policy: Box<dyn Policy>| {
            perform("ur5e/ellipse_air", plant, policy).precision().precision.unwrap()
        };
        let fixed = error(Box::new(ComputedTorque::new(&robot).unwrap()));
        let adaptive = error(Box::new(AdaptiveComputedTorque::new(&robot).unwrap()));
        assert!(adaptive < 0.1 * fixed, "{adaptive} {fixed}");
        // On the robot of the file it does as well as without identification.
        let plant = PlantConfig::default();
        let policy = Box::new(AdaptiveComputedTorque::new(&robot).unwrap());
        let right = perform("ur5e/ellipse_air", plant, policy).precision().precision.unwrap();
        assert!(right < 2e-4, "{right}");
    }

    #[test]
    fn it_goes_on_from_any_frame() {
        let robot = Arc::new(Robot::builtin("pointmass").unwrap());
        let plant = PlantConfig { mass: 1.3, ..PlantConfig::default() };
        let policy = || Box::new(AdaptiveComputedTorque::new(&robot).unwrap());
        let whole = perform("pointmass/star", plant, policy());
        let (heart, star) = ("pointmass/heart", "pointmass/star");
        let mut changed = perform(heart, plant, policy());
        let command = |task| compile(&tasks::find(task, None).unwrap()).unwrap();
        changed.set_command(&command(star)).unwrap();
        changed.run(&Cancel::default()).unwrap();
        assert_eq!(changed.actions(), whole.actions());
        // Also from the start, with models of the motion before.
        let star_command = command(star);
        let q: Vec<f32> =
            (0..star_command.frames()).flat_map(|f| star_command.row(f).to_vec()).collect();
        let names = robot.joints().iter().map(|j| j.name.clone()).collect();
        let seen = vec![true; q.len()];
        let other = robert_clip::Command::from_dense(names, vec![0.1, -0.1], q, seen).unwrap();
        changed.set_command(&other).unwrap();
        changed.run(&Cancel::default()).unwrap();
        let mut fresh = perform(star, plant, policy());
        fresh.set_command(&other).unwrap();
        fresh.run(&Cancel::default()).unwrap();
        assert_eq!(changed.actions(), fresh.actions());
    }
}
