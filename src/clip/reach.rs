//! An end-effector goal: the position that a key sets for a site or a point of a body.
//!
//! The compiler finds the joint values ([`crate::solve`]). The document stores only the place, so
//! that the goal keeps its meaning when neighbouring keys, the posture or the robot's model change.

use std::fmt::Write as _;

use robert_kinematics::Point;
use serde::{Deserialize, Serialize};

use super::grid::round;

/// An end-effector goal: the place of a point in the world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ReachFields", into = "ReachFields")]
pub struct Reach {
    /// The point that is moved.
    pub point: Point,
    /// Its position in the world, m.
    pub pos: [f64; 3],
    /// Its orientation in the world, w x y z; `None` leaves it free.
    pub quat: Option<[f64; 4]>,
}

/// An end-effector goal as in JSON.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ReachFields {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) site: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) body: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) offset: Option<[f64; 3]>,
    pub(super) pos: [f64; 3],
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) quat: Option<[f64; 4]>,
}

impl TryFrom<ReachFields> for Reach {
    type Error = &'static str;

    fn try_from(r: ReachFields) -> Result<Reach, Self::Error> {
        let point = match (r.site, r.body, r.offset) {
            (Some(site), None, None) => Point::Site(site),
            (None, Some(body), offset) => Point::Body { body, offset: offset.unwrap_or_default() },
            (Some(_), None, Some(_)) => {
                return Err("`offset` is a point of a `body`, not of a site");
            }
            _ => return Err("an end-effector goal needs either `site` or `body`, not both"),
        };
        Ok(Reach { point, pos: r.pos, quat: r.quat })
    }
}

impl From<Reach> for ReachFields {
    fn from(r: Reach) -> ReachFields {
        let (site, body, offset) = match r.point {
            Point::Site(site) => (Some(site), None, None),
            Point::Body { body, offset } => {
                (None, Some(body), (offset != [0.0; 3]).then_some(offset))
            }
        };
        ReachFields { site, body, offset, pos: r.pos, quat: r.quat }
    }
}

impl Reach {
    /// A site at a position, in any orientation.
    pub fn site(name: &str, pos: [f64; 3]) -> Reach {
        Reach { point: Point::Site(name.to_owned()), pos, quat: None }
    }

    /// The same goal with an orientation, w x y z.
    #[must_use]
    pub fn turned(self, quat: [f64; 4]) -> Reach {
        Reach { quat: Some(quat), ..self }
    }

    /// On the document's grid; the quaternion has length 1.
    pub(super) fn normal(mut self) -> Reach {
        self.pos = self.pos.map(round);
        if let Point::Body { offset, .. } = &mut self.point {
            *offset = offset.map(round);
        }
        if let Some(quat) = &mut self.quat {
            let length = quat.iter().map(|v| v * v).sum::<f64>().sqrt();
            // A quaternion on the grid is off by up to 1e-6, and must not change again.
            if (length - 1.0).abs() > 1e-5 {
                *quat = quat.map(|v| v / length);
            }
            *quat = quat.map(round);
        }
        self
    }

    /// Its text in the file.
    pub(super) fn text(&self) -> String {
        let list = |v: &[f64]| v.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
        let quote = |text: &str| serde_json::Value::from(text).to_string();
        let mut text = match &self.point {
            Point::Site(site) => format!("{{\"site\": {}", quote(site)),
            Point::Body { body, offset } if *offset == [0.0; 3] => {
                format!("{{\"body\": {}", quote(body))
            }
            Point::Body { body, offset } => {
                format!("{{\"body\": {}, \"offset\": [{}]", quote(body), list(offset))
            }
        };
        write!(text, ", \"pos\": [{}]", list(&self.pos)).ok();
        if let Some(quat) = &self.quat {
            write!(text, ", \"quat\": [{}]", list(quat)).ok();
        }
        text.push('}');
        text
    }
}

/// How closely the points of a key reach their goals.
#[derive(Clone, Debug, PartialEq)]
pub struct Reached {
    /// Index of the key, or of the key before the frame.
    pub key: usize,
    /// The frame. Between keys it is the frame with the largest error.
    pub frame: u32,
    /// The index of the goal in its key.
    pub goal: usize,
    /// Distance from the goal, m.
    pub distance_m: f64,
    /// Orientation error, rad; 0 if no orientation was requested.
    pub angle_rad: f64,
    /// The place that the point reaches.
    pub instead: Reach,
    /// The joints that decide where it is.
    pub joints: Vec<String>,
    /// Whether the point reaches its goal.
    pub reached: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_goals_stay_as_they_are() {
        let reach = Reach::site("tool", [0.123_456_789, -0.0, 1.0]).turned([0.0, 3.0, 4.0, 0.1]);
        let once = reach.normal();
        assert_eq!(once.clone().normal(), once);
        let length: f64 = once.quat.unwrap().iter().map(|v| v * v).sum();
        assert!((length - 1.0).abs() < 1e-5);
        let back: Reach = serde_json::from_str(&once.text()).unwrap();
        assert_eq!(back, once);
    }
}
