//! Gestures in the viewport: turning a gizmo, dragging a link, pulling a point. Dragging shows a
//! pose and tells the page; the page makes the edit.

use std::collections::{BTreeMap, BTreeSet};

use super::drag::{Drag, Grab, Held, Pulled, turn_towards};
use super::gizmo::GIZMO;
use super::incoming::{Incoming, Phase};
use super::message::ViewportMessage;
use super::motion_path::{PATH, key_of};
use super::page_camera::PageCamera;
use super::space::{self, Place, V3};
use super::stage::Stage;
use crate::protocol::{Error, Event, IkAnswer, IkRequest, Selection, SiteFacts};
use crate::simulation::RobotContext;
use robert_base::units::Unit;
use robert_clip::Level;

impl Stage {
    pub(super) fn touched(&mut self, tab: Option<String>, incoming: Incoming) {
        match incoming {
            Incoming::SceneNodeClickMessage { name, ray_origin, ray_direction }
                if name.starts_with(PATH) =>
            {
                let ray = ray_origin.zip(ray_direction).map(|(eye, along)| [eye, along]);
                self.path_clicked(&name, ray, tab);
            }
            Incoming::SceneNodeClickMessage { name, .. } => {
                let body = self.nodes.as_ref().and_then(|c| c.body_of(&name));
                if let Some(body) = body {
                    self.select_body(body);
                }
            }
            Incoming::TransformControlsDragStartMessage { name } if name == GIZMO => {
                let held = match self.hand.selection.site.clone() {
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
                // After a cancelled drag the gizmo is placed where the client has it.
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
                    let view =
                        tab.as_ref().and_then(|t| self.cameras.of(t)).map(PageCamera::forward);
                    let grab = Grab {
                        link: start_position,
                        pointer: end_position,
                        view,
                        fine: held("shift"),
                    };
                    match key_of(&name) {
                        Some(frame) => self.grab_key(frame, grab, tab),
                        None => self.grab(&name, grab, held("alt"), tab),
                    }
                }
                self.drag_to(end_position);
                if phase == Phase::End {
                    self.let_go();
                }
            }
            Incoming::ViewerCameraMessage { .. } => {
                if let (Some(tab), Some(camera)) = (tab, incoming.camera()) {
                    self.cameras.moved(tab, camera);
                }
            }
            _ => {}
        }
    }

    pub(super) fn select_body(&mut self, body: usize) {
        let Some(facts) = &self.robot else { return };
        let name = facts.bodies.get(body).map(|b| b.name.clone());
        self.select(Selection { body: name, ..Selection::default() });
    }

    pub(super) fn hold(&self, joint: usize, grab: Grab) -> Option<Held> {
        if self.robot.as_ref()?.is_locked(joint, &self.hand.locked) {
            return None;
        }
        let bodies = self.reference()?;
        let (anchor, axis) = self.axis(&bodies, joint)?;
        let start = Place { pos: anchor, quat: space::from_z(axis) };
        Some(Held::Joint { joint, anchor, axis, start, total: 0.0, last: 0.0, grab })
    }

    pub(super) fn grasp(&mut self, held: Option<Held>, tab: Option<String>, by_gizmo: bool) {
        let base = self.hand.floating.pose.clone().or_else(|| self.goal_pose());
        let (Some(what), Some(base)) = (held, base) else { return };
        if self.hand.drag.is_some() {
            // Only an answer to the previous drag was still missing.
            self.finish();
        }
        self.playback.play = None;
        self.hand.released_at = None;
        let before = self.hand.floating.pose.clone();
        self.hand.drags += 1;
        let number = self.hand.drags;
        self.hand.drag =
            Some(Drag { what, pose: base.clone(), base, tab, before, by_gizmo, number });
    }

    /// A link is grabbed with the mouse: it turns about its own joint, or with Alt the nearest
    /// point that can be pulled follows the mouse.
    pub(super) fn grab(&mut self, node: &str, grab: Grab, pull: bool, tab: Option<String>) {
        let Some(facts) = self.robot.clone() else { return };
        let Some(body) = self.nodes.as_ref().and_then(|c| c.body_of(node)) else { return };
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
        let joint = facts.moving_joint(body, &self.hand.locked);
        let held = joint.and_then(|j| self.hold(j, grab));
        if held.is_none() && facts.moving_joint(body, &BTreeSet::new()).is_some() {
            let message = "this link's joints are locked (Alt+L unlocks)".to_owned();
            self.hub.send(&Event::Notice { level: Level::Info, message });
        }
        if let Some(joint) = joint.and_then(|j| facts.table.joints.get(j)) {
            let body = self.hand.selection.body.clone();
            self.select(Selection { joint: Some(joint.name.clone()), body, site: None });
        }
        self.grasp(held, tab, false);
    }

    /// The point that Alt pulls if this body is grabbed: a site of its own, else the nearest one
    /// that it carries, else the nearest of all; without any site the grabbed point itself.
    pub(super) fn nearest_point(
        &self,
        facts: &RobotContext,
        bodies: &[f32],
        body: usize,
        at: V3,
    ) -> Option<(Pulled, V3)> {
        let carried = |b: usize| facts.hangs_on(b, body);
        let best = facts
            .ik_sites
            .iter()
            .filter_map(|s| Some((s, Place::of(bodies, s.body)?.point(s.pos))))
            .min_by(|(a, p), (b, q)| {
                let key = |s: &SiteFacts, p: &V3| {
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
        // The solid robot was grabbed; the same point is on the command's body.
        let place = self.nodes.as_ref()?.shown(body).or_else(|| Place::of(bodies, body))?;
        let offset = space::rotate(space::conjugate(place.quat), space::sub(at, place.pos));
        Some((Pulled::Body(name, offset), Place::of(bodies, body)?.point(offset)))
    }

    /// The gizmo was moved there.
    pub(super) fn turned(&mut self, quat: space::Q, pos: V3) {
        let hinge = self.held_is_hinge();
        let Some(drag) = &mut self.hand.drag else { return };
        match &mut drag.what {
            Held::Point { .. } => {
                self.hand.pull.next = Some(pos);
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

    /// The pointer of a link's drag has moved to this point.
    pub(super) fn drag_to(&mut self, to: V3) {
        let hinge = self.held_is_hinge();
        let Some(drag) = &mut self.hand.drag else { return };
        match &mut drag.what {
            Held::Point { at, grab, .. } => {
                self.hand.pull.next = Some(space::add(*at, grab.way(to)));
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

    pub(super) fn held_is_hinge(&self) -> bool {
        match (&self.hand.drag, &self.robot) {
            (Some(Drag { what: Held::Joint { joint, .. }, .. }), Some(facts)) => {
                facts.table.joints.get(*joint).is_some_and(|j| j.unit == Unit::Rad)
            }
            _ => false,
        }
    }

    /// Shows the joint at the dragged value, inside its limits, and sends it to the pages.
    pub(super) fn move_joint(&mut self) {
        let (Some(facts), Some(drag)) = (&self.robot, &mut self.hand.drag) else { return };
        let Held::Joint { joint, total, .. } = &drag.what else { return };
        let (Some(fact), Some(start)) = (facts.table.joints.get(*joint), drag.base.get(*joint))
        else {
            return;
        };
        let value = robert_clip::round(fact.clamp(start + total));
        let mut values = BTreeMap::new();
        for (joint, value) in facts.bound(*joint, value) {
            if let (Some(fact), Some(q)) = (facts.table.joints.get(joint), drag.pose.get_mut(joint))
            {
                values.insert(fact.name.clone(), value);
                *q = value;
            }
        }
        let (pose, tab) = (drag.pose.clone(), drag.tab.clone());
        self.hub.send(&Event::Joint { values, done: false, tab });
        self.float(Some(pose));
    }

    /// Sends the newest target, unless a question is unanswered.
    pub(super) fn pull(&mut self) {
        if self.hand.pull.busy {
            return;
        }
        let Some(Drag { what: Held::Point { point, .. }, pose, number, .. }) = &self.hand.drag
        else {
            return;
        };
        let number = *number;
        let Some(pos) = self.hand.pull.next.take() else { return };
        let (site, body) = match point.clone() {
            Pulled::Site(name) => (name, None),
            Pulled::Body(name, offset) => (String::new(), Some((name, offset))),
        };
        let locked = self.hand.locked.iter().cloned().collect();
        // The pulled point itself is not pinned.
        let pins = self.hand.pins.iter().filter(|p| p.site != site).cloned().collect();
        let (q, pos) = (pose.clone(), Some(pos));
        let request = IkRequest { q, site, body, pos, quat: None, locked, pins };
        self.hand.pull.busy = true;
        self.ask(request, move |answer| ViewportMessage::Ik(number, answer));
    }

    pub(super) fn pulled(&mut self, number: u64, answer: Result<IkAnswer, Error>) {
        self.hand.pull.busy = false;
        if let (Ok(found), Some(drag)) = (answer, &mut self.hand.drag)
            && drag.number == number
        {
            drag.pose = found.q.iter().map(|v| robert_clip::round(*v)).collect();
            let pose = drag.pose.clone();
            self.tell_pose(false);
            self.float(Some(pose));
        }
        self.pull();
        if self.hand.pull.let_go_next && !self.hand.pull.busy {
            self.finish();
        }
    }

    /// Sends the pages every joint that differs from the pose at the start of the drag.
    pub(super) fn tell_pose(&self, done: bool) {
        let (Some(facts), Some(drag)) = (&self.robot, &self.hand.drag) else { return };
        let values: BTreeMap<String, f64> = facts
            .table
            .joints
            .iter()
            .zip(drag.pose.iter().zip(&drag.base))
            .filter(|(_, (now, before))| (**now - **before).abs() > 1e-6)
            .map(|(j, (now, _))| (j.name.clone(), *now))
            .collect();
        self.hub.send(&Event::Joint { values, done, tab: drag.tab.clone() });
    }

    pub(super) fn let_go(&mut self) {
        if self.hand.drag.is_none() {
            return;
        }
        if self.hand.pull.busy || self.hand.pull.next.is_some() {
            // The mouse was released before the answer to the last question.
            self.hand.pull.let_go_next = true;
            return;
        }
        self.finish();
    }

    pub(super) fn finish(&mut self) {
        self.hand.pull.let_go_next = false;
        self.hand.pull.next = None;
        self.tell_pose(true);
        self.hand.drag = None;
        self.hand.released_at = Some(self.simulation.rollout.state().generation);
        self.place_gizmo();
    }

    /// Esc: restores the pose from before the drag. Later messages of the client about this drag
    /// are ignored.
    pub(super) fn cancel_drag(&mut self) {
        let Some(drag) = self.hand.drag.take() else { return };
        self.hand.pull.next = None;
        self.hand.pull.let_go_next = false;
        self.float(drag.before);
        self.hub.send(&Event::JointCancelled { tab: drag.tab });
        self.place_gizmo_anew();
    }
}
