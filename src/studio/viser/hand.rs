//! A hand in the viewport: a gizmo that is turned, a link that is dragged, a point that is
//! pulled. Dragging shows a pose and tells the page; the page makes the edit.

use std::collections::BTreeMap;

use super::incoming::{Incoming, Phase};
use super::look::Lens;
use super::space::{self, Place, V3};
use super::stage::{GIZMO, Say, Stage};
use crate::clip::Level;
use crate::studio::error::Error;
use crate::studio::protocol::{Event, IkRequest, Selection};
use crate::studio::worker::{Report, Request, RobotFacts};
use crate::units::Unit;

/// Share of the hand's way that a fine drag takes.
const FINE: f64 = 0.2;
/// Steps of the search for the angle that brings a link under the pointer.
const STEPS: usize = 12;

/// A hand on something.
#[derive(Debug)]
pub(super) struct Grip {
    what: Held,
    /// The pose when it was taken; (state).
    base: Vec<f64>,
    /// The pose now.
    pose: Vec<f64>,
    /// The page it belongs to: the one that makes the edit.
    tab: Option<String>,
    /// The floating pose that was there before.
    before: Option<Vec<f64>>,
    /// The client moves the gizmo itself.
    pub(super) by_gizmo: bool,
    /// Its number: an answer to an older one is not for it.
    number: u64,
}

#[derive(Debug)]
enum Held {
    /// A joint: where its axis was, and how far it has turned.
    Joint { joint: usize, anchor: V3, axis: V3, start: Place, total: f64, last: f64, grab: Grab },
    /// A point, and where it was.
    Point { point: Pulled, at: V3, grab: Grab },
}

/// Where a link was grabbed. The client's own start position moves along with the link.
#[derive(Clone, Copy, Debug, Default)]
struct Grab {
    /// The point of the link, m.
    link: V3,
    /// The pointer on the plane of the drag, m.
    pointer: V3,
    /// Where the camera looks; without it distances count in depth, too.
    view: Option<V3>,
    /// Shift: a fifth of the way.
    fine: bool,
}

impl Grab {
    /// How far the pointer has come.
    fn way(&self, to: V3) -> V3 {
        space::scale(space::sub(to, self.pointer), if self.fine { FINE } else { 1.0 })
    }
}

/// What inverse kinematics moves.
#[derive(Clone, Debug)]
enum Pulled {
    Site(String),
    /// A point in a body's frame, for robots without sites.
    Body(String, V3),
}

impl Stage {
    pub(super) fn touched(&mut self, tab: Option<String>, incoming: Incoming) {
        match incoming {
            Incoming::SceneNodeClickMessage { name } => {
                let body = self.cast.as_ref().and_then(|c| c.body_of(&name));
                if let Some(body) = body {
                    self.select_body(body);
                }
            }
            Incoming::TransformControlsDragStartMessage { name } if name == GIZMO => {
                let held = match self.selection.site.clone() {
                    Some(site) => self.site_place(&site).map(|at| Held::Point {
                        point: Pulled::Site(site),
                        at,
                        grab: Grab::default(),
                    }),
                    None => self.selected_joint().and_then(|j| self.hold(j, Grab::default())),
                };
                self.grasp(held, tab, true);
            }
            Incoming::TransformControlsUpdateMessage { name, wxyz, position } if name == GIZMO => {
                self.turned(space::unit(wxyz), position);
            }
            Incoming::TransformControlsDragEndMessage { name } if name == GIZMO => {
                self.let_go();
                // After a cancelled drag it stands where the client has it.
                self.place_gizmo_anew();
            }
            Incoming::SceneNodeDragMessage {
                phase,
                name,
                start_position,
                end_position,
                modifier,
            } => {
                let held = |key: &str| {
                    modifier.as_ref().is_some_and(|m| m.split('+').any(|part| part == key))
                };
                if phase == Phase::Start {
                    let view = tab.as_ref().and_then(|t| self.lenses.get(t)).map(Lens::forward);
                    let grab = Grab {
                        link: start_position,
                        pointer: end_position,
                        view,
                        fine: held("shift"),
                    };
                    self.grab(&name, grab, held("alt"), tab);
                }
                self.drag_to(end_position);
                if phase == Phase::End {
                    self.let_go();
                }
            }
            Incoming::ViewerCameraMessage { .. } => {
                if let (Some(tab), Some(lens)) = (tab, incoming.lens()) {
                    self.see(tab, lens);
                }
            }
            _ => {}
        }
    }

    fn select_body(&mut self, body: usize) {
        let Some(facts) = &self.facts else { return };
        let name = facts.bodies.get(body).map(|b| b.name.clone());
        self.select(Selection { body: name, ..Selection::default() });
    }

    fn hold(&self, joint: usize, grab: Grab) -> Option<Held> {
        if self.is_locked(joint) {
            return None;
        }
        let bodies = self.reference()?;
        let (anchor, axis) = self.axis(&bodies, joint)?;
        let start = Place { pos: anchor, quat: space::from_z(axis) };
        Some(Held::Joint { joint, anchor, axis, start, total: 0.0, last: 0.0, grab })
    }

    fn grasp(&mut self, held: Option<Held>, tab: Option<String>, by_gizmo: bool) {
        let base = self.floating.clone().or_else(|| self.goal_pose());
        let (Some(what), Some(base)) = (held, base) else { return };
        if self.grip.is_some() {
            // Of the last one only an answer was still to come.
            self.finish();
        }
        self.play = None;
        self.released_at = None;
        let before = self.floating.clone();
        self.grips += 1;
        let number = self.grips;
        self.grip = Some(Grip { what, pose: base.clone(), base, tab, before, by_gizmo, number });
    }

    /// A link is taken with the mouse: it turns about its own joint, or with Alt the nearest
    /// point that can be pulled comes along.
    fn grab(&mut self, node: &str, grab: Grab, pull: bool, tab: Option<String>) {
        let Some(facts) = self.facts.clone() else { return };
        let Some(body) = self.cast.as_ref().and_then(|c| c.body_of(node)) else { return };
        if pull {
            let Some(bodies) = self.reference() else { return };
            let Some((point, at)) = self.nearest_point(&facts, &bodies, body, grab.link) else {
                return;
            };
            let site = match &point {
                Pulled::Site(name) => Some(name.clone()),
                Pulled::Body(..) => None,
            };
            if site.is_some() {
                self.select(Selection { site, ..Selection::default() });
            } else {
                self.select_body(body);
            }
            self.grasp(Some(Held::Point { point, at, grab }), tab, false);
            return;
        }
        self.select_body(body);
        let joint = self.moving_joint(&facts, body, true);
        let held = joint.and_then(|j| self.hold(j, grab));
        if held.is_none() && self.moving_joint(&facts, body, false).is_some() {
            let message = "this link's joints are locked (Alt+L unlocks)".to_owned();
            self.hub.send(&Event::Notice { level: Level::Info, message });
        }
        if let Some(joint) = joint.and_then(|j| facts.table.joints.get(j)) {
            let body = self.selection.body.clone();
            self.select(Selection { joint: Some(joint.name.clone()), body, site: None });
        }
        self.grasp(held, tab, false);
    }

    /// What Alt pulls where this body was grabbed: a site of its own, else the nearest one that
    /// it carries, else the nearest of all; without any site the grabbed point itself.
    fn nearest_point(
        &self,
        facts: &RobotFacts,
        bodies: &[f32],
        body: usize,
        at: V3,
    ) -> Option<(Pulled, V3)> {
        let carried = |mut b: usize| {
            for _ in 0..facts.bodies.len() {
                if b == body {
                    return true;
                }
                match facts.bodies.get(b) {
                    Some(fact) if b != 0 => b = fact.parent,
                    _ => return false,
                }
            }
            false
        };
        let best = facts
            .ik_sites
            .iter()
            .filter_map(|s| Some((s, Place::of(bodies, s.body)?.point(s.pos))))
            .min_by(|(a, p), (b, q)| {
                let key = |s: &crate::studio::worker::SiteFacts, p: &V3| {
                    let class = match s.body {
                        own if own == body => 0.0,
                        other if carried(other) => 1.0,
                        _ => 2.0,
                    };
                    (class, space::norm(space::sub(*p, at)))
                };
                let ((i, d), (j, e)) = (key(a, p), key(b, q));
                f64::total_cmp(&i, &j).then(d.total_cmp(&e))
            });
        if let Some((site, at)) = best {
            return Some((Pulled::Site(site.name.clone()), at));
        }
        let name = facts.bodies.get(body)?.name.clone();
        // The solid robot was grabbed; the command's own body has the point, too.
        let place = self.cast.as_ref()?.shown(body).or_else(|| Place::of(bodies, body))?;
        let offset = space::rotate(space::conjugate(place.quat), space::sub(at, place.pos));
        Some((Pulled::Body(name, offset), Place::of(bodies, body)?.point(offset)))
    }

    /// The joint that moves a body: its own, else that of the nearest body it hangs on; with
    /// `free` the first that is not locked.
    pub(super) fn moving_joint(
        &self,
        facts: &RobotFacts,
        body: usize,
        free: bool,
    ) -> Option<usize> {
        let mut at = body;
        for _ in 0..facts.bodies.len() {
            let body = facts.bodies.get(at)?;
            let joint = body.joints.iter().rev().find(|j| !free || !self.is_locked(**j));
            if let Some(joint) = joint {
                return Some(*joint);
            }
            at = body.parent;
        }
        None
    }

    /// Whether a joint must stay, itself or with one that it is bound to.
    pub(super) fn is_locked(&self, joint: usize) -> bool {
        let Some(facts) = &self.facts else { return false };
        let Some(name) = facts.table.joints.get(joint).map(|j| &j.name) else { return false };
        self.locked.contains(name)
            || facts.table.couplings.iter().any(|c| {
                c.members.iter().any(|m| &m.joint == name)
                    && c.members.iter().any(|m| self.locked.contains(&m.joint))
            })
    }

    /// The gizmo was moved there.
    fn turned(&mut self, quat: space::Q, pos: V3) {
        let hinge = self.held_is_hinge();
        let Some(grip) = &mut self.grip else { return };
        match &mut grip.what {
            Held::Point { .. } => {
                self.ik_next = Some(pos);
                self.pull();
            }
            Held::Joint { axis, start, total, last, .. } => {
                if hinge {
                    let turn = space::mul(quat, space::conjugate(start.quat));
                    let now = space::twist(turn, *axis);
                    *total += space::wrap(now - *last);
                    *last = now;
                } else {
                    *total = space::dot(space::sub(pos, start.pos), *axis);
                }
                self.move_joint();
            }
        }
    }

    /// The pointer of a link's drag is there.
    fn drag_to(&mut self, to: V3) {
        let hinge = self.held_is_hinge();
        let Some(grip) = &mut self.grip else { return };
        match &mut grip.what {
            Held::Point { at, grab, .. } => {
                self.ik_next = Some(space::add(*at, grab.way(to)));
                self.pull();
            }
            Held::Joint { anchor, axis, total, grab, .. } => {
                let way = grab.way(to);
                *total = if hinge {
                    let arm = space::sub(grab.link, *anchor);
                    turn_towards(arm, *axis, way, grab.view, *total)
                } else {
                    space::dot(way, *axis)
                };
                self.move_joint();
            }
        }
    }

    fn held_is_hinge(&self) -> bool {
        match (&self.grip, &self.facts) {
            (Some(Grip { what: Held::Joint { joint, .. }, .. }), Some(facts)) => {
                facts.table.joints.get(*joint).is_some_and(|j| j.unit == Unit::Rad)
            }
            _ => false,
        }
    }

    /// Shows the joint where the hand has it, inside its limits, and tells the pages.
    fn move_joint(&mut self) {
        let (Some(facts), Some(grip)) = (&self.facts, &mut self.grip) else { return };
        let Held::Joint { joint, total, .. } = &grip.what else { return };
        let (Some(fact), Some(start)) = (facts.table.joints.get(*joint), grip.base.get(*joint))
        else {
            return;
        };
        let value = crate::clip::round(fact.clamp(start + total));
        let mut values = BTreeMap::from([(fact.name.clone(), value)]);
        for coupling in &facts.table.couplings {
            let Some(own) = coupling.members.iter().find(|m| m.joint == fact.name) else {
                continue;
            };
            let shared = (value - own.offset) / own.coef;
            for m in &coupling.members {
                values.insert(m.joint.clone(), crate::clip::round(m.coef * shared + m.offset));
            }
        }
        for (name, value) in &values {
            let at = facts.table.joints.iter().position(|j| &j.name == name);
            if let Some(q) = at.and_then(|i| grip.pose.get_mut(i)) {
                *q = *value;
            }
        }
        let (pose, tab) = (grip.pose.clone(), grip.tab.clone());
        self.hub.send(&Event::Joint { values, done: false, tab });
        self.float(Some(pose));
    }

    /// Sends the newest pull, unless one is under way.
    fn pull(&mut self) {
        if self.ik_busy {
            return;
        }
        let Some(Grip { what: Held::Point { point, .. }, pose, number, .. }) = &self.grip else {
            return;
        };
        let number = *number;
        let Some(pos) = self.ik_next.take() else { return };
        let (site, body) = match point.clone() {
            Pulled::Site(name) => (name, None),
            Pulled::Body(name, offset) => (String::new(), Some((name, offset))),
        };
        let locked = self.locked.iter().cloned().collect();
        let request = IkRequest { q: pose.clone(), site, body, pos, quat: None, locked };
        self.ik_busy = true;
        self.ask(Request::Ik(request), move |answer| Say::Ik(number, answer));
    }

    pub(super) fn pulled(&mut self, number: u64, answer: Result<Report, Error>) {
        self.ik_busy = false;
        if let (Ok(Report::Ik(found)), Some(grip)) = (answer, &mut self.grip)
            && grip.number == number
        {
            grip.pose = found.q.iter().map(|v| crate::clip::round(*v)).collect();
            let pose = grip.pose.clone();
            self.tell_pose(false);
            self.float(Some(pose));
        }
        self.pull();
        if self.let_go_next && !self.ik_busy {
            self.finish();
        }
    }

    /// Tells the pages every joint that differs from the pose that was taken.
    fn tell_pose(&self, done: bool) {
        let (Some(facts), Some(grip)) = (&self.facts, &self.grip) else { return };
        let values: BTreeMap<String, f64> = facts
            .table
            .joints
            .iter()
            .zip(grip.pose.iter().zip(&grip.base))
            .filter(|(_, (now, before))| (**now - **before).abs() > 1e-6)
            .map(|(j, (now, _))| (j.name.clone(), *now))
            .collect();
        self.hub.send(&Event::Joint { values, done, tab: grip.tab.clone() });
    }

    fn let_go(&mut self) {
        if self.grip.is_none() {
            return;
        }
        if self.ik_busy || self.ik_next.is_some() {
            // The hand was faster than the answer to its last pull.
            self.let_go_next = true;
            return;
        }
        self.finish();
    }

    fn finish(&mut self) {
        self.let_go_next = false;
        self.ik_next = None;
        self.tell_pose(true);
        self.grip = None;
        self.released_at = Some(self.live.state().generation);
        self.place_gizmo();
    }

    /// Esc: as if nothing had been touched. What the client goes on to say is not heard.
    pub(super) fn cancel_grip(&mut self) {
        let Some(grip) = self.grip.take() else { return };
        self.ik_next = None;
        self.let_go_next = false;
        self.float(grip.before);
        self.hub.send(&Event::JointCancelled { tab: grip.tab });
        self.place_gizmo_anew();
    }
}

/// The angle (near `from`) about `axis` that brings the end of `arm`, as the camera sees it,
/// nearest to where it was plus `way`: Gauss-Newton on the one angle, damped where the end
/// moves along the line of sight.
fn turn_towards(arm: V3, axis: V3, way: V3, view: Option<V3>, from: f64) -> f64 {
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
