//! The facts about a robot that clips need, without its simulator.
//!
//! It is a plain struct instead of a trait over the robot profile, because lints, mirroring and the
//! studio need plain data that can be sent as JSON. Code that knows the robot fills it.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::document::{Clip, Row};
use super::grid::round;
use super::tangent::Tangent;
use robert_base::units::Unit;
use robert_kinematics::Kinematics;

/// The masks that a policy allows: whole frames, or single joints.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[derive(schemars::JsonSchema)]
pub enum Granularity {
    /// Whole frames only, as in the paper.
    #[default]
    State,
    /// Single joints of a frame.
    Joint,
}

/// One joint coordinate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct JointFacts {
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: Unit,
    /// Lowest and highest position, rad or m; `None` = unbounded.
    pub range: Option<[f64; 2]>,
    /// Highest speed that the plant can sustain, rad/s or m/s, if known.
    pub speed_max: Option<f64>,
    /// The range of 98 of 100 frames of the data that the robot's policy learned from, rad or m.
    #[serde(default)]
    pub band: Option<[f64; 2]>,
    /// Speed that 99 of 100 of those frames stay below, rad/s or m/s.
    #[serde(default)]
    pub speed_usual: Option<f64>,
    /// Whether no motor moves this joint together with others, but for those of its couplings.
    #[serde(default)]
    pub moves_alone: bool,
}

/// One row of a mirror table: `mirrored[target] = sign * q[source] + offset`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct MirrorRow {
    /// The joint that is set.
    pub target: String,
    /// The joint whose value it takes.
    pub source: String,
    /// 1 or -1.
    pub sign: f64,
    /// Added afterwards, rad or m.
    pub offset: f64,
}

/// The mirror image of a pose as a rule for each joint, or the reason why there is none.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[derive(schemars::JsonSchema)]
pub enum Mirror {
    /// Row by row; joints without a row keep their value.
    Table(Vec<MirrorRow>),
    /// The reason, for a greyed-out button.
    None(String),
}

/// One joint of a coupling: `q = coef * shared + offset`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct CouplingMember {
    /// The joint.
    pub joint: String,
    /// Its share.
    pub coef: f64,
    /// Added to it, rad or m.
    pub offset: f64,
}

/// What holds coupled joints together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum CouplingKind {
    /// An actuator pulls all of them; contact can still set them apart.
    Tendon,
    /// A joint follows another one.
    Mimic,
}

/// Joints that one actuator moves together: a tendon, or a mimic joint and its leader.
/// They agree when (q - offset) / coef is the same for all.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Coupling {
    /// What holds them together.
    pub kind: CouplingKind,
    /// Tendon or leader name.
    pub name: String,
    /// The joints.
    pub members: Vec<CouplingMember>,
    /// Allowed difference between members, rad or m. Contact and limits separate them a little.
    pub tolerance: f64,
}

/// A robot as clips see it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct JointTable {
    /// Robot id.
    pub robot: String,
    /// Sha-256 of its model, 64 hex digits, if known.
    pub model_sha256: Option<String>,
    /// Joints in state order.
    pub joints: Vec<JointFacts>,
    /// The rest pose, in state order.
    pub rest: Vec<f64>,
    /// Mirror table or reason.
    pub mirror: Mirror,
    /// Couplings.
    pub couplings: Vec<Coupling>,
    /// The masks that the current policy allows.
    pub granularity: Granularity,
    /// Bodies and joint axes in space, for end-effector goals; `None` if they are not known.
    #[serde(default)]
    pub kinematics: Option<Kinematics>,
}

impl JointTable {
    /// The facts that a clip contains about its robot: names and units, no limits.
    pub fn from_clip(clip: &Clip) -> JointTable {
        let unit = |i: usize| clip.robot.units.get(i).copied().unwrap_or(Unit::Rad);
        let fact = |(i, name): (usize, &String)| JointFacts {
            name: name.clone(),
            unit: unit(i),
            range: None,
            speed_max: None,
            band: None,
            speed_usual: None,
            moves_alone: false,
        };
        JointTable {
            robot: clip.robot.id.clone(),
            model_sha256: clip.robot.model_sha256.clone(),
            joints: clip.robot.joints.iter().enumerate().map(fact).collect(),
            rest: vec![0.0; clip.dim()],
            mirror: Mirror::None("this robot is unknown here".into()),
            couplings: Vec::new(),
            granularity: Granularity::Joint,
            kinematics: None,
        }
    }

    /// The same facts with the joints in the clip's order, those that it does not have at the end; without
    /// the bodies in space, whose joints are numbered.
    #[must_use]
    pub fn in_order_of(mut self, clip: &Clip) -> JointTable {
        let place = |name: &str| clip.joint(name).unwrap_or(usize::MAX);
        let mut joints: Vec<(JointFacts, f64)> = self.joints.into_iter().zip(self.rest).collect();
        joints.sort_by_key(|(fact, _)| place(&fact.name));
        (self.joints, self.rest) = joints.into_iter().unzip();
        self.kinematics = None;
        self
    }

    /// The couplings of joints that follow others. A tendon shares a force, but does not fix where each
    /// joint is.
    pub fn followers(&self) -> impl Iterator<Item = &Coupling> {
        self.couplings.iter().filter(|c| c.kind == CouplingKind::Mimic)
    }

    /// The joint of this name.
    pub fn joint(&self, name: &str) -> Option<&JointFacts> {
        self.joints.iter().find(|j| j.name == name)
    }

    /// Joint names in state order.
    pub fn names(&self) -> Vec<String> {
        self.joints.iter().map(|j| j.name.clone()).collect()
    }

    /// The mirror image of a row whose joints are `names`.
    ///
    /// An angle outside its range is moved by whole turns, if that brings it inside.
    ///
    /// # Errors
    /// The reason why this robot has no mirror image.
    pub fn mirrored(&self, names: &[String], row: &Row) -> Result<Row, String> {
        let rows = match &self.mirror {
            Mirror::Table(rows) => rows,
            Mirror::None(reason) => return Err(reason.clone()),
        };
        let value = |name: &str| {
            names.iter().position(|n| n == name).and_then(|i| row.get(i).copied()).flatten()
        };
        let image = names.iter().zip(row).map(|(name, own)| {
            let Some(rule) = rows.iter().find(|r| &r.target == name) else { return *own };
            let q = rule.sign * value(&rule.source)? + rule.offset;
            Some(round(self.joint(name).map_or(q, |j| j.turned_into_range(q))))
        });
        Ok(image.collect())
    }
}

impl JointTable {
    /// The tangents of the mirror image of a key.
    pub(super) fn mirrored_tangents(
        &self,
        tangents: &BTreeMap<String, Tangent>,
    ) -> BTreeMap<String, Tangent> {
        let Mirror::Table(rows) = &self.mirror else { return tangents.clone() };
        let own = tangents.iter().filter(|(joint, _)| !rows.iter().any(|r| &r.target == *joint));
        let mut image: BTreeMap<_, _> = own.map(|(joint, t)| (joint.clone(), *t)).collect();
        image.extend(rows.iter().filter_map(|rule| {
            let tangent = tangents.get(&rule.source)?;
            Some((rule.target.clone(), tangent.map(|slope| rule.sign * slope)))
        }));
        image
    }
}

impl JointFacts {
    /// The value moved by whole turns into the range, if it is an angle and one fits.
    fn turned_into_range(&self, q: f64) -> f64 {
        const TURN: f64 = std::f64::consts::TAU;
        match self.range {
            Some([lo, hi]) if self.unit == Unit::Rad && !(lo..=hi).contains(&q) => {
                let moved = if q < lo {
                    q + ((lo - q) / TURN).ceil() * TURN
                } else {
                    q - ((q - hi) / TURN).ceil() * TURN
                };
                if (lo..=hi).contains(&moved) { moved } else { q }
            }
            _ => q,
        }
    }

    /// The nearest value inside the range, on the document's grid.
    pub fn clamp(&self, q: f64) -> f64 {
        match self.range {
            Some([lo, _]) if q < lo => inward(lo, 1e-6),
            Some([_, hi]) if q > hi => inward(hi, -1e-6),
            _ => q,
        }
    }
}

/// A limit rounded to the grid, inward if rounding would leave the range.
fn inward(limit: f64, step: f64) -> f64 {
    let on_grid = round(limit);
    if (on_grid - limit) * step < 0.0 { round(on_grid + step) } else { on_grid }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arm() -> JointTable {
        let joint = |name: &str| JointFacts {
            name: name.into(),
            unit: Unit::Rad,
            range: Some([-6.2, 6.2]),
            speed_max: None,
            band: None,
            speed_usual: None,
            moves_alone: true,
        };
        let row =
            |j: &str, sign, offset| MirrorRow { target: j.into(), source: j.into(), sign, offset };
        JointTable {
            robot: "arm".into(),
            model_sha256: None,
            joints: vec![joint("pan"), joint("lift"), joint("wrist")],
            rest: vec![0.0; 3],
            mirror: Mirror::Table(vec![
                row("pan", -1.0, 0.0),
                row("wrist", -1.0, std::f64::consts::PI),
            ]),
            couplings: vec![],
            granularity: Granularity::State,
            kinematics: None,
        }
    }

    #[test]
    fn facts_come_in_the_order_of_the_clip() {
        let mut clip = Clip::new(super::super::RobotRef::default(), 10);
        clip.robot.joints = ["wrist", "pan", "lift"].map(String::from).to_vec();
        let table = JointTable { rest: vec![1.0, 2.0, 3.0], ..arm() }.in_order_of(&clip);
        assert_eq!(table.names(), clip.robot.joints);
        assert_eq!(table.rest, [3.0, 1.0, 2.0]);
    }

    #[test]
    fn mirror_wraps_and_is_its_own_inverse() {
        let t = arm();
        let names = t.names();
        let q = vec![Some(0.5), Some(-1.0), Some(-4.0)];
        let once = t.mirrored(&names, &q).unwrap();
        assert_eq!(
            once,
            [
                Some(-0.5),
                Some(-1.0),
                Some(round(std::f64::consts::PI + 4.0 - std::f64::consts::TAU))
            ]
        );
        let twice = t.mirrored(&names, &once).unwrap();
        for (a, b) in twice.iter().zip(&q) {
            let turns = (a.unwrap() - b.unwrap()) / std::f64::consts::TAU;
            assert!((turns - turns.round()).abs() < 1e-6, "{twice:?}");
        }
        assert_eq!(
            t.mirrored(&names, &vec![None, Some(1.0), None]).unwrap(),
            [None, Some(1.0), None]
        );
    }

    #[test]
    fn clamped_values_are_inside_and_on_the_grid() {
        let j = JointFacts {
            name: "x".into(),
            unit: Unit::Rad,
            range: Some([-0.349_065_85, 0.349_065_85]),
            speed_max: None,
            band: None,
            speed_usual: None,
            moves_alone: true,
        };
        for q in [-9.0, 9.0] {
            let c = j.clamp(q);
            assert!(c.abs() <= 0.349_065_85 && c == round(c) && c.abs() > 0.349);
        }
    }
}
