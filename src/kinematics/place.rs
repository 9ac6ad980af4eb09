//! Places of bodies, axes and points in the world, for given joint values.
//!
//! The conventions are MuJoCo's (`mj_kinematics`): the joints of a body act one after the other, and a
//! hinge keeps its own point where it is.

use nalgebra::{Isometry3, Point3, Quaternion, Translation3, Unit, UnitQuaternion, Vector3};

use super::tree::{Anchor, JointMotion, Kinematics, Point, SiteFrame};

/// A point that the robot does not have.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("there is no {kind} \"{name}\"")]
pub struct UnknownPoint {
    /// `site` or `body`.
    pub kind: &'static str,
    /// Its name.
    pub name: String,
}

/// A [`Point`] that was looked up by name: a frame fixed to a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointId {
    pub(super) link: usize,
    pub(super) frame: Isometry3<f64>,
}

/// The position and orientation of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Position in the world, m.
    pub pos: [f64; 3],
    /// Orientation in the world, w x y z.
    pub quat: [f64; 4],
}

/// Bodies and axes in the world.
pub(super) struct World {
    pub(super) links: Vec<Isometry3<f64>>,
    /// Point and direction of each joint's axis.
    pub(super) axes: Vec<(Point3<f64>, Vector3<f64>)>,
}

impl Kinematics {
    /// Finds a point.
    ///
    /// # Errors
    /// [`UnknownPoint`].
    pub fn point(&self, point: &Point) -> Result<PointId, UnknownPoint> {
        let unknown = |kind| UnknownPoint { kind, name: point.name().to_owned() };
        match point {
            Point::Site(name) => {
                let site = self.sites.iter().find(|s| &s.name == name);
                site.map(SiteFrame::id).ok_or_else(|| unknown("site"))
            }
            Point::Body { body, offset } => {
                let link = self.links.iter().position(|l| &l.name == body && !body.is_empty());
                let frame = Isometry3::from_parts((*offset).into(), UnitQuaternion::identity());
                link.map(|link| PointId { link, frame }).ok_or_else(|| unknown("body"))
            }
        }
    }

    /// The place of a point for these joint values, rad or m; `state` is (joints).
    pub fn place(&self, state: &[f64], id: &PointId) -> Place {
        let at = self.world(state).point(id);
        let q = at.rotation;
        Place { pos: at.translation.vector.into(), quat: [q.w, q.i, q.j, q.k] }
    }

    /// Whether a joint moves this point: it belongs to the point's body or to a body before that.
    pub(super) fn moves(&self, joint: usize, id: &PointId) -> bool {
        let mut link = id.link;
        while link != 0 {
            if self.links[link].joints.contains(&joint) {
                return true;
            }
            link = self.links[link].parent;
        }
        false
    }

    pub(super) fn world(&self, state: &[f64]) -> World {
        assert_eq!(state.len(), self.joints.len(), "one value for each joint");
        let mut links: Vec<Isometry3<f64>> = Vec::with_capacity(self.links.len());
        let mut axes = vec![(Point3::origin(), Vector3::zeros()); self.joints.len()];
        for (i, link) in self.links.iter().enumerate() {
            let own = isometry(link.pos, link.quat);
            let mut at = if i == 0 { own } else { links[link.parent] * own };
            for &j in &link.joints {
                let joint = &self.joints[j];
                let moved = state[j] - joint.reference;
                let axis = Unit::new_unchecked(Vector3::from(joint.axis));
                let (anchor, direction) = (at * Point3::from(joint.pos), at * *axis);
                axes[j] = (anchor, direction);
                match joint.motion {
                    JointMotion::Slide => at.translation.vector += direction * moved,
                    JointMotion::Hinge => {
                        at.rotation *= UnitQuaternion::from_axis_angle(&axis, moved);
                        let away = at.rotation * Vector3::from(joint.pos);
                        at.translation = Translation3::from(anchor.coords - away);
                    }
                }
            }
            at.rotation.renormalize_fast();
            links.push(at);
        }
        World { links, axes }
    }
}

impl World {
    pub(super) fn point(&self, id: &PointId) -> Isometry3<f64> {
        self.links[id.link] * id.frame
    }
}

impl SiteFrame {
    fn id(&self) -> PointId {
        PointId { link: self.link, frame: isometry(self.pos, self.quat) }
    }
}

impl Anchor {
    pub(super) fn id(&self) -> PointId {
        PointId { link: self.link, frame: isometry(self.pos, self.quat) }
    }
}

/// The orientation at a share of the shortest turn from one to another; all w x y z.
pub fn shortest_turn(from: [f64; 4], to: [f64; 4], share: f64) -> [f64; 4] {
    let unit =
        |[w, x, y, z]: [f64; 4]| UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    let (from, to) = (unit(from), unit(to));
    // The axis of a unit quaternion is the one of a turn by at most half a circle.
    let turn = (to * from.inverse()).scaled_axis() * share;
    let at = UnitQuaternion::from_scaled_axis(turn) * from;
    [at.w, at.i, at.j, at.k]
}

fn isometry(pos: [f64; 3], [w, x, y, z]: [f64; 4]) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    Isometry3::from_parts(pos.into(), turn)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tree::{JointAxis, LinkFrame};

    /// A cart on a rail along x; on it an arm of 1 m that turns about z, hinged 0.5 m beside its body.
    fn cart() -> Kinematics {
        let identity = [1.0, 0.0, 0.0, 0.0];
        let joint = |motion, pos, axis| JointAxis {
            motion,
            pos,
            axis,
            reference: 0.0,
            range: None,
            follows: None,
        };
        let link = |name: &str, parent, pos, joints: &[usize]| LinkFrame {
            name: name.to_owned(),
            parent,
            pos,
            quat: identity,
            joints: joints.to_vec(),
        };
        Kinematics {
            links: vec![
                link("world", 0, [0.0; 3], &[]),
                link("cart", 0, [0.0, 0.0, 1.0], &[0]),
                link("arm", 1, [0.5, 0.0, 0.0], &[1]),
            ],
            joints: vec![
                joint(JointMotion::Slide, [0.0; 3], [1.0, 0.0, 0.0]),
                joint(JointMotion::Hinge, [-0.5, 0.0, 0.0], [0.0, 0.0, 1.0]),
            ],
            sites: vec![SiteFrame {
                name: "tip".to_owned(),
                link: 2,
                pos: [0.5, 0.0, 0.0],
                quat: identity,
            }],
            closures: Vec::new(),
            tendons: Vec::new(),
        }
    }

    #[test]
    fn turns_take_the_shorter_way() {
        let about_z = |angle: f64| [(angle / 2.0).cos(), 0.0, 0.0, (angle / 2.0).sin()];
        let half = shortest_turn(about_z(0.2), about_z(1.0), 0.5);
        assert!((half[3] - (0.6_f64 / 2.0).sin()).abs() < 1e-12);
        let flipped = about_z(1.0).map(|v| -v);
        let same = shortest_turn(about_z(0.2), flipped, 0.5);
        assert!((same[3].abs() - (0.6_f64 / 2.0).sin()).abs() < 1e-12, "{same:?}");
    }

    #[test]
    fn a_cart_and_its_arm_stand_where_they_should() {
        let tree = cart();
        let tip = tree.point(&Point::Site("tip".into())).unwrap();
        let quarter = std::f64::consts::FRAC_PI_2;
        let at = tree.place(&[2.0, quarter], &tip);
        for (got, expect) in at.pos.iter().zip([2.0, 1.0, 1.0]) {
            assert!((got - expect).abs() < 1e-12, "{at:?}");
        }
        assert!((at.quat[3] - (quarter / 2.0).sin()).abs() < 1e-12, "{at:?}");
        assert!(tree.moves(0, &tip) && tree.moves(1, &tip));
        let cart = tree.point(&Point::Body { body: "cart".into(), offset: [0.0; 3] }).unwrap();
        assert!(tree.moves(0, &cart) && !tree.moves(1, &cart));
        let nobody = tree.point(&Point::Site("nose".into())).unwrap_err();
        assert_eq!(nobody.to_string(), "there is no site \"nose\"");
    }
}
