//! The simulated plant, which may differ from the robot's file.
//!
//! A planner that owns the exact simulator looks too good in a comparison, and a policy that
//! learned from one plant cannot recognise another by its motion. [`PlantConfig`] is one plant;
//! [`PlantRange`] is a range from which plants are drawn, for collection and for evaluation.

use std::sync::Arc;

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

use super::{Error, Robot};
use robert_base::rng::{Rng, Stream};
use robert_mujoco::{Inertial, Model};

/// The simulated plant relative to the robot's file: factors, of which 1 is no change, and a payload.
///
/// ```
/// use robert_robot::PlantConfig;
///
/// let heavier: PlantConfig = "mass=1.25,damping=1.5,payload=2".parse()?;
/// assert_ne!(heavier, PlantConfig::default());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PlantConfig {
    /// Factor on every mass and inertia.
    pub mass: f64,
    /// Factor on joint damping.
    pub damping: f64,
    /// Factor on the force per control.
    pub gear: f64,
    /// A mass at the tool, kg: at the first point that inverse kinematics moves, or at the body of
    /// the last joint if there is none.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub payload: f64,
}

impl Default for PlantConfig {
    fn default() -> Self {
        PlantConfig { mass: 1.0, damping: 1.0, gear: 1.0, payload: 0.0 }
    }
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde asks so")]
fn is_zero(x: &f64) -> bool {
    *x == 0.0
}

impl PlantConfig {
    /// Whether this is the robot of the file.
    pub fn is_nominal(&self) -> bool {
        *self == PlantConfig::default()
    }

    /// The model of this plant; the robot's own if nothing differs.
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub fn model(&self, robot: &Robot) -> Result<Arc<Model>, Error> {
        if self.is_nominal() {
            return Ok(Arc::clone(robot.model()));
        }
        let mut model = robot.model().duplicate()?;
        if self.mass != 1.0 {
            model.scale_mass(self.mass)?;
        }
        if self.payload > 0.0 {
            let (body, at) = tool(robot);
            let loaded = load(model.inertial(body), self.payload, at);
            model.set_inertial(body, loaded)?;
        }
        model.scale_damping(self.damping);
        model.scale_gear(self.gear);
        Ok(Arc::new(model))
    }
}

/// The body that carries a payload, and the point in its frame, m.
fn tool(robot: &Robot) -> (usize, [f64; 3]) {
    let model = robot.model();
    let site = robot.profile().ik_sites.first().and_then(|s| robot.site(s).ok());
    // What is fixed to the world carries nothing.
    if let Some(site) = site.filter(|&s| model.site_bodyid()[s] != 0) {
        let at = std::array::from_fn(|i| model.site_pos()[3 * site + i]);
        return (model.site_bodyid()[site] as usize, at);
    }
    let last = robot.joints().last().map_or(0, |j| j.dofadr);
    let body = model.dof_bodyid()[last] as usize;
    (body, model.inertial(body).pos)
}

/// A body with a point mass of `kg` at `point`, in the frame of the body (parallel axes).
fn load(body: Inertial, kg: f64, point: [f64; 3]) -> Inertial {
    let mass = body.mass + kg;
    let (old, point) = (Vector3::from(body.pos), Vector3::from(point));
    let centre = (old * body.mass + point * kg) / mass;
    let about = |kg: f64, from: Vector3<f64>| {
        (Matrix3::identity() * from.norm_squared() - from * from.transpose()) * kg
    };
    let [w, x, y, z] = body.quat;
    let axes = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).to_rotation_matrix();
    let own =
        axes.matrix() * Matrix3::from_diagonal(&body.inertia.into()) * axes.matrix().transpose();
    let all = own + about(body.mass, old - centre) + about(kg, point - centre);
    let eigen = all.symmetric_eigen();
    let mut turned = eigen.eigenvectors;
    if turned.determinant() < 0.0 {
        turned.neg_mut();
    }
    let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turned));
    Inertial {
        mass,
        pos: centre.into(),
        quat: [q.w, q.i, q.j, q.k],
        inertia: eigen.eigenvalues.into(),
    }
}

impl std::str::FromStr for PlantConfig {
    type Err = Error;

    /// Reads `mass=1.25,damping=1.5,gear=0.85`; each factor within 0.01 to 100.
    fn from_str(text: &str) -> Result<Self, Error> {
        let range: PlantRange = text.parse()?;
        range.single().ok_or_else(|| Error::Plant {
            text: text.to_owned(),
            problem: "expected one plant, not a range".to_owned(),
        })
    }
}

impl std::fmt::Display for PlantConfig {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        PlantRange::from(*self).fmt(f)
    }
}

/// A range of plants: least and greatest factor, log-uniform between them, and payload, uniform.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlantRange {
    /// Factors on every mass and inertia.
    pub mass: [f64; 2],
    /// Factors on joint damping.
    pub damping: [f64; 2],
    /// Factors on the force per control.
    pub gear: [f64; 2],
    /// A mass at the tool, kg.
    #[serde(default, skip_serializing_if = "is_none")]
    pub payload: [f64; 2],
}

fn is_none(payload: &[f64; 2]) -> bool {
    *payload == [0.0; 2]
}

impl Default for PlantRange {
    fn default() -> Self {
        PlantConfig::default().into()
    }
}

impl From<PlantConfig> for PlantRange {
    fn from(p: PlantConfig) -> Self {
        PlantRange {
            mass: [p.mass; 2],
            damping: [p.damping; 2],
            gear: [p.gear; 2],
            payload: [p.payload; 2],
        }
    }
}

impl PlantRange {
    /// The only plant of this range, if there is only one.
    pub fn single(&self) -> Option<PlantConfig> {
        let only = |[lo, hi]: [f64; 2]| (lo == hi).then_some(lo);
        Some(PlantConfig {
            mass: only(self.mass)?,
            damping: only(self.damping)?,
            gear: only(self.gear)?,
            payload: only(self.payload)?,
        })
    }

    /// The plant of this seed.
    pub fn draw(&self, seed: u64) -> PlantConfig {
        let mut rng = Rng::new(seed, Stream::Plant, 0);
        let mut factor = |[lo, hi]: [f64; 2]| {
            let share = rng.uniform();
            // A fixed plant is returned exactly, without rounding.
            if lo == hi { lo } else { lo * (hi / lo).powf(share) }
        };
        let (mass, damping, gear) = (factor(self.mass), factor(self.damping), factor(self.gear));
        let [least, most] = self.payload;
        PlantConfig { mass, damping, gear, payload: least + (most - least) * rng.uniform() }
    }
}

impl std::str::FromStr for PlantRange {
    type Err = Error;

    /// Reads `mass=0.7..1.4,damping=0.5..2,gear=0.85,payload=0.5..5`; each factor within 0.01 to
    /// 100, a payload within 0 to 1000 kg.
    fn from_str(text: &str) -> Result<Self, Error> {
        let fail = |problem: String| Error::Plant { text: text.to_owned(), problem };
        let number = |value: &str, least: f64, most: f64| {
            let x: f64 =
                value.trim().parse().or(Err(fail(format!("{value:?} is not a number"))))?;
            if (least..=most).contains(&x) {
                Ok(x)
            } else {
                Err(fail(format!("{x} is not in {least} to {most}")))
            }
        };
        let mut plant = PlantRange::default();
        for part in text.split(',').filter(|p| !p.trim().is_empty()) {
            let Some((key, value)) = part.split_once('=') else {
                return Err(fail(format!("{part:?} has no =")));
            };
            let (lo, hi) = value.split_once("..").unwrap_or((value, value));
            let (least, most) = if key.trim() == "payload" { (0.0, 1000.0) } else { (0.01, 100.0) };
            let range = [number(lo, least, most)?, number(hi, least, most)?];
            if range[0] > range[1] {
                return Err(fail(format!("{value:?} is a decreasing range")));
            }
            match key.trim() {
                "mass" => plant.mass = range,
                "damping" => plant.damping = range,
                "gear" => plant.gear = range,
                "payload" => plant.payload = range,
                other => {
                    return Err(fail(format!("{other:?} is not mass, damping, gear or payload")));
                }
            }
        }
        Ok(plant)
    }
}

impl std::fmt::Display for PlantRange {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let factors = [("mass", self.mass), ("damping", self.damping), ("gear", self.gear)];
        let payload = Some(("payload", self.payload)).filter(|_| !is_none(&self.payload));
        for (i, (name, [lo, hi])) in factors.into_iter().chain(payload).enumerate() {
            let comma = if i == 0 { "" } else { "," };
            if lo == hi {
                write!(f, "{comma}{name}={lo}")?;
            } else {
                write!(f, "{comma}{name}={lo}..{hi}")?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_round_trips_and_mistakes_are_named() {
        let p: PlantConfig = "mass=1.25, gear=0.85".parse().unwrap();
        assert_eq!(p, PlantConfig { mass: 1.25, gear: 0.85, ..PlantConfig::default() });
        assert_eq!(p.to_string().parse::<PlantConfig>().unwrap(), p);
        let r: PlantRange = "mass=.7..1.4,damping=2,payload=0..5".parse().unwrap();
        let own = PlantRange { mass: [0.7, 1.4], damping: [2.0; 2], ..PlantRange::default() };
        assert_eq!(r, PlantRange { payload: [0.0, 5.0], ..own });
        assert_eq!(r.to_string().parse::<PlantRange>().unwrap(), r);
        let bad = ["mass", "mass=x", "mass=0", "wind=2", "gear=nan", "mass=2..1", "mass=1.."];
        for bad in bad.into_iter().chain(["payload=-1", "payload=1e9"]) {
            assert!(bad.parse::<PlantRange>().is_err(), "{bad}");
        }
        assert!("mass=.7..1.4".parse::<PlantConfig>().is_err());
    }

    #[test]
    fn draws_fill_the_range_and_leave_a_fixed_plant_exact() {
        let fixed = PlantConfig { mass: 1.1, damping: 0.3, gear: 0.7, payload: 2.5 };
        assert_eq!(PlantRange::from(fixed).draw(9), fixed);
        let r: PlantRange = "mass=.5..2".parse().unwrap();
        let masses: Vec<f64> = (0..400).map(|s| r.draw(s).mass).collect();
        assert!(masses.iter().all(|m| (0.5..=2.0).contains(m)));
        // Log-uniform: as many below one as above.
        let below = masses.iter().filter(|m| **m < 1.0).count();
        assert!((160..240).contains(&below), "{below}");
    }

    #[test]
    fn a_payload_weighs_at_the_tool() {
        let robot = Robot::builtin("ur5e").unwrap();
        let (body, at) = tool(&robot);
        let own = robot.model().inertial(body);
        // Two masses in turn are as one.
        let once = load(own, 3.0, at);
        let twice = load(load(own, 1.0, at), 2.0, at);
        assert!(
            (once.mass - own.mass - 3.0).abs() < 1e-12 && (once.mass - twice.mass).abs() < 1e-12
        );
        let near = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
        assert!(
            near(&once.pos, &twice.pos) && near(&once.inertia, &twice.inertia),
            "{once:?} {twice:?}"
        );
        // The torque that holds the straight arm still grows by that of the payload's weight.
        let hold = |payload: f64| {
            let plant = PlantConfig { payload, ..PlantConfig::default() };
            let mut data = robert_mujoco::Data::new(&plant.model(&robot).unwrap()).unwrap();
            robot.write_state(&mut data, &robot.pose("straight").unwrap()).unwrap();
            data.forward().unwrap();
            let site = robot.site("end_effector").unwrap();
            let three = |x: &[f64], i: usize| Vector3::new(x[3 * i], x[3 * i + 1], x[3 * i + 2]);
            let lever = |j| three(data.site_xpos(), site) - three(data.xanchor(), j);
            let weight = Vector3::new(0.0, 0.0, -9.81 * payload);
            let turning = |j| -three(data.xaxis(), j).dot(&lever(j).cross(&weight));
            (data.qfrc_bias().to_vec(), (0..5).map(turning).collect::<Vec<f64>>())
        };
        let ((empty, _), (loaded, more)) = (hold(0.0), hold(2.0));
        for j in 0..5 {
            assert!((loaded[j] - empty[j] - more[j]).abs() < 1e-6, "{j}: {loaded:?} {more:?}");
        }
        assert!(more[1].abs() > 1.0, "{more:?}");
    }
}
