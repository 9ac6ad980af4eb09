//! Drags in the viewport: of a gizmo, a link, or a point.

use std::collections::BTreeSet;

use super::space::{self, Place, V3};
use crate::protocol::{Pin, Selection};

/// The selection, and the drag that is in progress.
#[derive(Debug, Default)]
pub(super) struct Hand {
    /// The selected joints or body.
    pub(super) selection: Selection,
    /// Joints that are locked: no drag moves them.
    pub(super) locked: BTreeSet<String>,
    /// Sites that inverse kinematics keeps in place.
    pub(super) pins: Vec<Pin>,
    /// The drag in progress.
    pub(super) drag: Option<Drag>,
    /// The number of drags so far.
    pub(super) drags: u64,
    /// A pose that is not in the clip.
    pub(super) floating: Floating,
    /// Set when the drag has ended: the next rollout of an edited document then ends the floating
    /// pose.
    pub(super) released_at: Option<u64>,
    /// A point that is pulled.
    pub(super) pull: Pull,
}

/// A pose that is not in the clip.
#[derive(Debug, Default)]
pub(super) struct Floating {
    /// One value per state joint.
    pub(super) pose: Option<Vec<f64>>,
    /// Its body transforms; (nbody, 7).
    pub(super) bodies: Option<Vec<f32>>,
    /// Increases with every pose, so that an answer for an older pose is recognised.
    pub(super) number: u64,
}

/// Questions of inverse kinematics: one at a time, the newest wins.
#[derive(Debug, Default)]
pub(super) struct Pull {
    /// One is under way.
    pub(super) busy: bool,
    /// The next target of the point.
    pub(super) next: Option<V3>,
    /// The drag ends as soon as the last question is answered.
    pub(super) let_go_next: bool,
}

/// The share of the pointer's movement that a fine drag uses.
const FINE: f64 = 0.2;

/// Steps of the search for the angle that brings a link under the pointer.
const STEPS: usize = 12;

/// A hand on something.
#[derive(Debug)]
pub(super) struct Drag {
    pub(super) what: Held,
    /// The pose when it was taken; (state).
    pub(super) base: Vec<f64>,
    /// The pose now.
    pub(super) pose: Vec<f64>,
    /// The page that it belongs to, which makes the edit.
    pub(super) tab: Option<String>,
    /// The floating pose that was there before.
    pub(super) before: Option<Vec<f64>>,
    /// The client moves the gizmo itself.
    pub(super) by_gizmo: bool,
    /// Its number, so that an answer for an older drag is recognised.
    pub(super) number: u64,
}

#[derive(Debug)]
pub(super) enum Held {
    /// A joint: its axis at the start of the drag, and its rotation since then.
    Joint { joint: usize, anchor: V3, axis: V3, start: Place, total: f64, last: f64, grab: Grab },
    /// A point, and where it was.
    Point { point: Pulled, at: V3, grab: Grab },
}

/// The place at which a link was grabbed. The client's own start position moves along with the
/// link.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Grab {
    /// The point of the link, m.
    pub(super) link: V3,
    /// The pointer on the plane of the drag, m.
    pub(super) pointer: V3,
    /// The direction of the camera; without it distances count in depth, too.
    pub(super) view: Option<V3>,
    /// Shift: a fifth of the way.
    pub(super) fine: bool,
}

impl Grab {
    /// The pointer's way so far.
    pub(super) fn way(&self, to: V3) -> V3 {
        space::scale(space::sub(to, self.pointer), if self.fine { FINE } else { 1.0 })
    }
}

/// The point that inverse kinematics moves.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Pulled {
    Site(String),
    /// A point in a body's frame, for robots without sites.
    Body(String, V3),
}

/// The angle (near `from`) about `axis` that brings the end of `arm` closest, as the camera sees
/// it, to its old place plus `way`. The method is Gauss-Newton on the one angle, damped where the
/// end moves along the line of sight.
pub(super) fn turn_towards(arm: V3, axis: V3, way: V3, view: Option<V3>, from: f64) -> f64 {
    let seen = |v: V3| match view {
        Some(n) => space::sub(v, space::scale(n, space::dot(v, n))),
        None => v,
    };
    let goal = space::add(arm, way);
    let damping = 0.02 * space::dot(arm, arm).max(1e-12);
    let mut angle = from;
    for _ in 0..STEPS {
        let (sin, cos) = (angle / 2.0).sin_cos();
        let turned = space::rotate([cos, axis[0] * sin, axis[1] * sin, axis[2] * sin], arm);
        let slope = seen(space::cross(axis, turned));
        let miss = seen(space::sub(goal, turned));
        let step = space::dot(slope, miss) / (space::dot(slope, slope) + damping);
        angle += step.clamp(-0.4, 0.4);
        if step.abs() < 1e-5 {
            break;
        }
    }
    angle
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dragged_link_follows_the_pointer_from_any_side() {
        let (axis, arm) = ([0.0, 0.0, 1.0], [0.3, 0.0, 0.0]);
        let way = |a: f64| [0.3 * a.cos() - 0.3, 0.3 * a.sin(), 0.0];
        for angle in [0.2, -0.9, 1.6] {
            // Seen along the axis, and from a slant: the end is under the pointer.
            for view in [[0.0, 0.0, 1.0], space::direction([0.3, 0.2, -0.8])] {
                let mut at = 0.0;
                for part in 1..=8 {
                    at =
                        turn_towards(arm, axis, way(angle * f64::from(part) / 8.0), Some(view), at);
                }
                assert!((at - angle).abs() < 0.02, "{angle} from {view:?}: {at}");
            }
        }
        // Seen from the side the end moves on a line; it follows that, and never jumps over.
        let side = Some([1.0, 0.0, 0.0]);
        let at = turn_towards(arm, axis, [0.0, 0.15, 0.0], side, 0.0);
        assert!((0.4..0.6).contains(&at), "{at}");
        // Along the line of sight nothing can be told.
        let at = turn_towards([0.0, 0.3, 0.0], axis, [0.0, 0.0, 0.1], side, 0.0);
        assert!(at.abs() < 1e-6, "{at}");
    }
}
