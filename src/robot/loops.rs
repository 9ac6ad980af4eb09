//! Torques of a robot whose joints hang together by equality constraints: closed loops, welds, and
//! joints that follow others.
//!
//! A four-bar linkage has motors on some of its joints, and the others are carried by the loop. A
//! torque that is wanted on every joint is therefore not the torque of the motors: the constraints
//! transmit what falls on a joint without a motor. With the moment arms m (nu, nv) and the
//! constraints' Jacobian J (n, nv), the forces f of the actuators and those of the constraints, c,
//! solve mᵀ f + Jᵀ c = torque, by least squares of the smallest norm.
//!
//! Constraints are soft, so a loop is never closed exactly, and axes that should be parallel are not
//! quite. Along such directions a small torque would need huge forces. Every column of mᵀ and Jᵀ is
//! scaled to length 1, except for constraints that hold next to nothing ([`SHORT`]), and directions
//! whose singular value is below [`LEAST`] transmit nothing.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector, SVD};

use super::{Error, Robot};
use robert_mujoco::{Data, Model};

/// The smallest singular value that is a transmission and not an inaccuracy.
const LEAST: f64 = 1e-2;
/// The length of a constraint's column, relative to the longest, below which it stays shorter than 1.
const SHORT: f64 = 1e-3;
/// The most sweeps of a decomposition. It usually needs two for each number.
const SWEEPS: usize = 1000;

/// The equality constraints of a robot.
#[derive(Debug)]
pub struct Loops {
    /// The nominal model without contacts.
    data: Data,
}

/// The part of joint torques that the actuators exert at one pose, when the constraints transmit the
/// rest.
#[derive(Clone, Debug)]
pub struct Transmission {
    /// (nv, nv).
    part: DMatrix<f64>,
}

impl Transmission {
    /// Replaces joint torques, N m or N; (nv), by the part of the actuators.
    pub fn apply(&self, torque: &mut [f64]) {
        let own = &self.part * DVector::from_column_slice(torque);
        torque.copy_from_slice(own.as_slice());
    }
}

impl Loops {
    /// The constraints of a robot; `None` if it has none.
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub fn of(robot: &Robot) -> Result<Option<Loops>, Error> {
        Loops::on(robot.model())
    }

    /// The constraints of a model; `None` if it has none that is active.
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub fn on(model: &Model) -> Result<Option<Loops>, Error> {
        if !has_loops(model) {
            return Ok(None);
        }
        let mut model = model.duplicate()?;
        model.set_contacts(false);
        model.set_dense_jacobians();
        Ok(Some(Loops { data: Data::new(&Arc::new(model))? }))
    }

    /// The transmission at a pose; `qpos` is (nq).
    ///
    /// # Errors
    /// [`Error::Simulator`]; [`Error::Loops`] for constraints that are not finite.
    pub fn at(&mut self, qpos: &[f64]) -> Result<Transmission, Error> {
        self.data.set_qpos(qpos)?;
        self.data.forward()?;
        transmission(&self.data)
    }
}

/// Whether an equality constraint of the model is active.
pub(super) fn has_loops(model: &Model) -> bool {
    model.eq_active().contains(&1)
}

/// The transmission at the pose of the last forward pass. The model must have dense Jacobians.
///
/// # Errors
/// [`Error::Loops`] for constraints that are not finite.
pub(super) fn transmission(data: &Data) -> Result<Transmission, Error> {
    let model = data.model();
    let (nu, nv) = (model.nu(), model.nv());
    let (moment, jacobian) = (data.actuator_moment(), data.equality_jacobian());
    if nu == 0 || nv == 0 {
        return Ok(Transmission { part: DMatrix::zeros(nv, nv) });
    }
    let longest = jacobian.chunks_exact(nv).map(length).fold(0.0, f64::max);
    if !(longest.is_finite() && moment.iter().chain(jacobian).all(|x| x.is_finite())) {
        return Err(Error::Loops);
    }
    let moments = moment.chunks_exact(nv).flat_map(|column| scaled(column, 0.0));
    let constraints = jacobian.chunks_exact(nv).flat_map(|column| scaled(column, SHORT * longest));
    let columns: Vec<f64> = moments.chain(constraints).collect();
    let all = DMatrix::from_column_slice(nv, nu + jacobian.len() / nv, &columns);
    let svd = SVD::try_new(all, true, true, f64::EPSILON, SWEEPS).ok_or(Error::Loops)?;
    let Ok(inverse) = svd.pseudo_inverse(LEAST) else { return Err(Error::Loops) };
    let own = DMatrix::from_column_slice(nv, nu, &columns[..nv * nu]);
    Ok(Transmission { part: own * inverse.rows(0, nu) })
}

fn length(column: &[f64]) -> f64 {
    column.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// A column of length 1, or shorter if its own length is below `least`; zeros stay zeros.
fn scaled(column: &[f64], least: f64) -> Vec<f64> {
    let length = length(column).max(least);
    column.iter().map(|x| if length == 0.0 { 0.0 } else { x / length }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two cranks and two rods that meet in one point, with motors on these joints.
    fn linkage(motors: &[&str], axis: &str, connect: &str) -> Model {
        let motors: Vec<String> =
            motors.iter().map(|j| format!("<motor joint=\"{j}\"/>")).collect();
        let motors = motors.concat();
        let text = format!(
            r#"<mujoco><compiler angle="radian"/>
      <default><joint axis="0 1 0" damping=".2" armature=".01"/>
        <geom type="capsule" size=".012" contype="0" conaffinity="0" density="1500"/></default>
      <worldbody>
        <body pos="-.1 0 .5"><joint name="a" axis="{axis}"/><geom fromto="0 0 0 -.15 0 -.2"/>
          <body name="left" pos="-.15 0 -.2"><joint name="b"/><geom fromto="0 0 0 .25 0 -.25"/></body></body>
        <body pos=".1 0 .5"><joint name="c"/><geom fromto="0 0 0 .15 0 -.2"/>
          <body name="right" pos=".15 0 -.2"><joint name="d"/><geom fromto="0 0 0 -.25 0 -.25"/></body></body>
      </worldbody>
      <equality><connect body1="left" body2="right" anchor=".25 0 -.25" {connect}/></equality>
      <actuator>{motors}</actuator></mujoco>"#
        );
        Model::from_xml(&text).unwrap()
    }

    /// The motors' part of the weight at a pose.
    fn held(model: &Model, qpos: [f64; 4]) -> Vec<f64> {
        let mut loops = Loops::on(model).unwrap().unwrap();
        let transmission = loops.at(&qpos).unwrap();
        let mut weight = loops.data.qfrc_bias().to_vec();
        transmission.apply(&mut weight);
        weight
    }

    #[test]
    fn two_motors_carry_a_linkage() {
        let own = linkage(&["a", "c"], "0 1 0", "");
        let found = held(&own, [0.0; 4]);
        let want = [0.748, 0.0, -0.748, 0.0];
        assert!(found.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-3), "{found:?}");
    }

    #[test]
    fn loops_that_are_nearly_closed_need_no_huge_forces() {
        // Four motors on a linkage that two would move.
        let many = linkage(&["a", "b", "c", "d"], "0 1 0", "");
        let closed = held(&many, [0.0; 4]);
        for off in [1e-5, 1e-4, 1e-3] {
            let found = held(&many, [off, 0.0, 0.0, 0.0]);
            let apart = found.iter().zip(&closed).map(|(a, b)| (a - b).abs());
            assert!(apart.fold(0.0, f64::max) < 0.02, "{off}: {found:?} {closed:?}");
        }
        // One motor, and an axis as a drawing program rounds it.
        let [straight, tilted] =
            ["0 1 0", "0 1 1e-6"].map(|axis| held(&linkage(&["a"], axis, ""), [0.0; 4]));
        assert!((straight[0] - tilted[0]).abs() < 1e-3, "{straight:?} {tilted:?}");
    }

    #[test]
    fn without_constraints_or_motors_nothing_is_transmitted() {
        assert!(Loops::on(&linkage(&["a"], "0 1 0", "active=\"false\"")).unwrap().is_none());
        assert_eq!(held(&linkage(&[], "0 1 0", ""), [0.0; 4]), [0.0; 4]);
    }

    #[test]
    fn constraints_that_are_not_finite_are_an_error() {
        let text = r#"<mujoco><worldbody><body><joint name="a"/><geom size=".1"/></body><body><joint name="b"/><geom size=".1"/></body></worldbody>
            <equality><joint joint1="a" joint2="b" polycoef="0 1 0 0 4e307"/></equality>
            <actuator><motor joint="a"/><motor joint="b"/></actuator></mujoco>"#;
        let mut loops = Loops::on(&Model::from_xml(text).unwrap()).unwrap().unwrap();
        assert!(loops.at(&[0.0, 5.0]).is_err());
    }
}
