//! What the viewport shows, and what a hand in it does.
//!
//! One task owns this state. It moves the robots along the rollout (60 times a second while
//! playing, interpolated, as the client does not interpolate), places the gizmo, turns drags into joint
//! values. Dragging shows a pose and tells the page; the page makes the edit. So there is
//! one way into the document.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::mpsc::{Receiver, Sender};
use tokio::time::Instant;

use super::Viewport;
use super::incoming::{Incoming, Phase};
use super::scene::{self, Actor, Cast};
use super::space::{self, Place, V3};
use crate::studio::error::Error;
use crate::studio::hub::Hub;
use crate::studio::live::Live;
use crate::studio::protocol::{Event, IkRequest, Phase as Rollout, Selection, StudioOp};
use crate::studio::worker::{Report, Request, RobotFacts, WorkerHandle};
use crate::take::viser::{Message, TransformControlsProps};
use crate::units::{FPS, Unit};

/// Between two pictures while playing.
const TICK: Duration = Duration::from_micros(16_667);
const GIZMO: &str = "/gizmo";
/// Moments of a motion that the camera must hold.
const MOMENTS: usize = 16;

/// What the stage is told.
#[derive(Debug)]
pub(super) enum Say {
    /// A request of a page.
    View(StudioOp),
    /// A message of the 3D client.
    Client(Incoming),
    /// Meshes of a robot.
    Geometry(Arc<RobotFacts>, Result<Report, Error>),
    /// Transforms of a floating pose.
    Floating(u64, Result<Report, Error>),
    /// Transforms of the commanded pose at a frame that is not simulated.
    Ghost(usize, Result<Report, Error>),
    /// Transforms of the keys around the playhead.
    Onion([Option<u32>; 2], Result<Report, Error>),
    /// Inverse kinematics.
    Ik(Result<Report, Error>),
}

/// A hand on something.
#[derive(Debug)]
struct Grip {
    what: Held,
    /// The pose when it was taken; (state).
    base: Vec<f64>,
    /// The pose now.
    pose: Vec<f64>,
}

#[derive(Debug)]
enum Held {
    /// A joint: where its axis was, and how far it has turned.
    Joint { joint: usize, anchor: V3, axis: V3, start: Place, total: f64, last: f64 },
    /// A site.
    Site { name: String },
}

#[derive(Debug)]
struct Play {
    from: f64,
    since: Instant,
    speed: f64,
    range: Option<[u32; 2]>,
}

/// The state; see the module.
#[allow(clippy::struct_excessive_bools)] // four switches of a view, not a state machine
pub(super) struct Stage {
    viewport: Arc<Viewport>,
    live: Arc<Live>,
    worker: WorkerHandle,
    hub: Hub,
    inbox: Sender<Say>,
    facts: Option<Arc<RobotFacts>>,
    cast: Option<Cast>,
    /// Whether the camera has been set for the whole motion of the document.
    framed: bool,
    frame: f64,
    play: Option<Play>,
    achieved: bool,
    command: bool,
    ghosts: bool,
    selection: Selection,
    grip: Option<Grip>,
    /// A pose that is not in the clip, and its transforms.
    floating: Option<Vec<f64>>,
    floating_bodies: Option<Vec<f32>>,
    floating_number: u64,
    /// Let go: the next rollout of an edited document ends the floating pose.
    released_at: Option<u64>,
    ghost: Option<(usize, Vec<f32>)>,
    ghost_asked: bool,
    onion: [Option<u32>; 2],
    onion_asked: bool,
    ik_busy: bool,
    ik_next: Option<V3>,
}

impl Stage {
    /// An empty stage.
    pub(super) fn new(
        viewport: Arc<Viewport>,
        live: Arc<Live>,
        worker: WorkerHandle,
        hub: Hub,
        inbox: Sender<Say>,
    ) -> Stage {
        Stage {
            viewport,
            live,
            worker,
            hub,
            inbox,
            facts: None,
            cast: None,
            framed: false,
            frame: 0.0,
            play: None,
            achieved: true,
            command: true,
            ghosts: false,
            selection: Selection::default(),
            grip: None,
            floating: None,
            floating_bodies: None,
            floating_number: 0,
            released_at: None,
            ghost: None,
            ghost_asked: false,
            onion: [None; 2],
            onion_asked: false,
            ik_busy: false,
            ik_next: None,
        }
    }

    /// Runs for the life of the studio.
    pub(super) async fn run(mut self, mut said: Receiver<Say>) {
        let mut live = self.live.watch();
        self.viewport.edit(|scene| scene::empty(scene, false));
        let mut tick = Instant::now();
        loop {
            tokio::select! {
                say = said.recv() => match say {
                    Some(say) => self.hear(say),
                    None => return,
                },
                changed = live.changed() => {
                    if changed.is_err() {
                        return;
                    }
                    self.follow();
                }
                () = tokio::time::sleep_until(tick + TICK), if self.play.is_some() => {
                    tick = Instant::now();
                    self.advance(tick);
                }
            }
        }
    }

    fn hear(&mut self, say: Say) {
        match say {
            Say::View(op) => self.view(op),
            Say::Client(incoming) => self.touched(incoming),
            Say::Geometry(facts, Ok(Report::Geometry(geometry))) => {
                if self.facts.as_ref().is_some_and(|f| Arc::ptr_eq(f, &facts)) {
                    let cast = self.viewport.edit(|scene| {
                        let cast = scene::build(scene, &geometry);
                        cast.camera(scene, &facts, "home", &[]);
                        cast.pose(scene, Actor::Robot, |b| Place::of(&geometry.home, b));
                        cast
                    });
                    self.cast = Some(cast);
                    self.onion = [None; 2];
                    self.refresh();
                }
            }
            Say::Floating(number, Ok(Report::Bodies(bodies))) => {
                if number == self.floating_number && self.floating.is_some() {
                    self.floating_bodies = bodies.into_iter().next();
                    self.refresh();
                }
            }
            Say::Ghost(frame, answer) => {
                self.ghost_asked = false;
                if let Ok(Report::Bodies(bodies)) = answer {
                    self.ghost = bodies.into_iter().next().map(|b| (frame, b));
                    self.refresh();
                }
            }
            Say::Onion(keys, answer) => {
                self.onion_asked = false;
                if let Ok(Report::Bodies(bodies)) = answer {
                    self.show_onion(keys, &bodies);
                }
            }
            Say::Ik(answer) => self.pulled(answer),
            Say::Geometry(_, Err(e)) => {
                self.hub.send(&Event::Notice { level: "warning", message: e.to_string() });
            }
            Say::Geometry(..) | Say::Floating(..) => {}
        }
    }

    /// The rollout moved on, or the document is another one.
    fn follow(&mut self) {
        let facts = self.live.facts();
        let same = match (&facts, &self.facts) {
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            (None, None) => true,
            _ => false,
        };
        if !same {
            self.take_robot(facts);
            return;
        }
        let state = self.live.state();
        if !self.framed && self.cast.is_some() && state.phase == Rollout::Done {
            self.framed = true;
            self.view(StudioOp::ViewCamera { preset: "home".to_owned() });
        }
        if self.released_at.is_some_and(|g| state.generation > g && state.rev > 0)
            && state.cached_to > 0
        {
            self.float(None);
        }
        self.refresh();
    }

    fn take_robot(&mut self, facts: Option<Arc<RobotFacts>>) {
        let known = match (&facts, &self.facts) {
            (Some(a), Some(b)) => a.source == b.source && self.cast.is_some(),
            _ => false,
        };
        self.facts = facts;
        self.framed = false;
        self.frame = 0.0;
        self.play = None;
        self.grip = None;
        self.ghost = None;
        self.onion = [None; 2];
        self.select(Selection::default());
        self.float(None);
        if known {
            self.refresh();
            return;
        }
        self.cast = None;
        let Some(facts) = self.facts.clone() else {
            self.viewport.edit(|scene| {
                for root in Actor::ALL.map(Actor::root).into_iter().chain(["/world", GIZMO]) {
                    scene.remove(root);
                }
            });
            return;
        };
        let request = Request::Geometry { robot: facts.source.clone() };
        self.ask(request, move |answer| Say::Geometry(facts, answer));
    }

    fn ask(
        &self,
        request: Request,
        then: impl FnOnce(Result<Report, Error>) -> Say + Send + 'static,
    ) {
        let inbox = self.inbox.clone();
        // A full inbox means a storm of drags: the next one asks again.
        self.worker.ask_with(request, move |answer| {
            inbox.try_send(then(answer)).ok();
        });
    }

    fn view(&mut self, op: StudioOp) {
        match op {
            StudioOp::ViewFrame { frame } => {
                self.play = None;
                self.frame = if frame.is_finite() { frame.max(0.0) } else { 0.0 };
                self.refresh();
            }
            StudioOp::ViewPlay { frame, range, speed } => {
                self.frame = if frame.is_finite() { frame.max(0.0) } else { 0.0 };
                self.play = (speed > 0.0 && speed.is_finite()).then(|| Play {
                    from: self.frame,
                    since: Instant::now(),
                    speed: speed.min(16.0),
                    range: range.filter(|r| r[0] < r[1]),
                });
                self.refresh();
            }
            StudioOp::ViewShow(show) => {
                self.achieved = show.achieved.unwrap_or(self.achieved);
                self.command = show.command.unwrap_or(self.command);
                self.ghosts = show.ghosts.unwrap_or(self.ghosts);
                if let Some(dark) = show.dark {
                    self.viewport.edit(|scene| scene::theme(scene, dark));
                }
                self.refresh();
            }
            StudioOp::ViewSelect(selection) => self.select(selection),
            StudioOp::ViewCamera { preset } => {
                if let (Some(cast), Some(facts)) = (&self.cast, &self.facts) {
                    let poses = self.live.moments(MOMENTS);
                    self.viewport.edit(|scene| cast.camera(scene, facts, &preset, &poses));
                }
            }
            StudioOp::ViewPose { q } => self.float(q),
            _ => {}
        }
    }

    fn advance(&mut self, now: Instant) {
        let Some(play) = &self.play else { return };
        let run = now.duration_since(play.since).as_secs_f64() * play.speed * f64::from(FPS);
        let last = self.live.state().frames.saturating_sub(1) as f64;
        let at = play.from + run;
        self.frame = match play.range {
            Some([from, to]) => {
                let (from, span) = (f64::from(from), f64::from(to - from));
                if at < from { at } else { from + (at - from).rem_euclid(span) }
            }
            None if at >= last => {
                self.play = None;
                last
            }
            None => at,
        };
        self.refresh();
    }

    /// Shows a pose that is not in the clip, or ends that.
    fn float(&mut self, pose: Option<Vec<f64>>) {
        let fits = |q: &Vec<f64>| {
            self.facts.as_ref().is_some_and(|f| f.table.joints.len() == q.len())
                && q.iter().all(|v| v.abs() <= crate::limits::CLIP_VALUE_MAX)
        };
        self.floating = pose.filter(fits);
        self.floating_number += 1;
        self.released_at = None;
        if let Some(q) = self.floating.clone() {
            let number = self.floating_number;
            let request = Request::Kinematics { poses: vec![q] };
            self.ask(request, move |answer| Say::Floating(number, answer));
        } else {
            self.floating_bodies = None;
            self.refresh();
        }
    }

    /// The commanded pose at the playhead, in state order.
    fn goal_pose(&self) -> Option<Vec<f64>> {
        let facts = self.facts.as_ref()?;
        let (command, _) = self.live.command();
        pose_at(facts, command.as_deref()?, self.frame.round() as u32)
    }

    /// Draws everything anew; what has not moved costs nothing.
    fn refresh(&mut self) {
        let Some(cast) = &self.cast else { return };
        let state = self.live.state();
        let at = self.frame.floor() as usize;
        let share = self.frame - at as f64;
        let now = self.live.bodies(at);
        let next = self.live.bodies(at + 1);
        let simulated = at < state.cached_to;
        let ghost = self.ghost.as_ref().filter(|(frame, _)| *frame == at).map(|(_, b)| b.clone());
        let between = |a: &[f32], b: &[f32], body: usize| {
            Some(Place::between(Place::of(a, body)?, Place::of(b, body)?, share))
        };
        let floating = self.floating_bodies.as_deref();
        let (achieved, command, ghosts) = (self.achieved, self.command, self.ghosts);
        let real = |body: usize| match (floating, &now, &next) {
            (Some(bodies), _, _) => Place::of(bodies, body),
            (None, Some((a, _)), Some((b, _))) => between(a, b, body),
            _ => None,
        };
        let asked = |body: usize| match (simulated, &now, &next, &ghost) {
            (true, Some((_, a)), Some((_, b)), _) => between(a, b, body),
            (_, _, _, Some(bodies)) => Place::of(bodies, body),
            _ => None,
        };
        let seen = achieved || floating.is_some();
        self.viewport.edit(|scene| {
            cast.pose(scene, Actor::Robot, real);
            cast.pose(scene, Actor::Command, asked);
            // Without the solid robot there is nothing that a ghost could agree with.
            cast.unveil(scene, |b| real(b).zip(asked(b)).filter(|_| seen));
            scene.put(Message::visibility(Actor::Robot.root(), seen));
            scene.put(Message::visibility(Actor::Command.root(), command));
            if !ghosts {
                scene.put(Message::visibility(Actor::Past.root(), false));
                scene.put(Message::visibility(Actor::Future.root(), false));
            }
        });
        if !simulated && state.frames > 0 && ghost.is_none() && !self.ghost_asked {
            self.ask_ghost(at);
        }
        if self.ghosts {
            self.ask_onion();
        }
        if self.grip.is_none() {
            self.place_gizmo();
        }
    }

    fn ask_ghost(&mut self, frame: usize) {
        let Some(pose) = self.goal_pose() else { return };
        self.ghost_asked = true;
        let request = Request::Kinematics { poses: vec![pose] };
        self.ask(request, move |answer| Say::Ghost(frame, answer));
    }

    fn ask_onion(&mut self) {
        let (command, keys) = self.live.command();
        let (Some(command), Some(facts)) = (command, &self.facts) else { return };
        let at = self.frame.round() as u32;
        let past = keys.iter().rev().find(|k| **k < at).copied();
        let future = keys.iter().find(|k| **k > at).copied();
        let around = [past, future];
        if around == self.onion || self.onion_asked {
            return;
        }
        let poses = around
            .iter()
            .map(|k| pose_at(facts, &command, k.unwrap_or(at)))
            .collect::<Option<Vec<_>>>();
        let Some(poses) = poses else { return };
        self.onion_asked = true;
        self.ask(Request::Kinematics { poses }, move |answer| Say::Onion(around, answer));
    }

    fn show_onion(&mut self, keys: [Option<u32>; 2], bodies: &[Vec<f32>]) {
        self.onion = keys;
        let Some(cast) = &self.cast else { return };
        let wanted = self.ghosts;
        self.viewport.edit(|scene| {
            for ((actor, key), row) in [Actor::Past, Actor::Future].iter().zip(keys).zip(bodies) {
                cast.pose(scene, *actor, |b| Place::of(row, b));
                scene.put(Message::visibility(actor.root(), wanted && key.is_some()));
            }
        });
    }

    fn select(&mut self, mut selection: Selection) {
        let Some(facts) = self.facts.clone() else {
            self.selection = Selection::default();
            return;
        };
        if selection.joint.is_none()
            && let Some(body) = &selection.body
        {
            let body = facts.bodies.iter().position(|b| &b.name == body);
            let joint = body.and_then(|b| moving_joint(&facts, b));
            selection.joint = joint.and_then(|j| facts.table.joints.get(j)).map(|j| j.name.clone());
        }
        let joint = selection.joint.as_ref();
        if joint.is_some_and(|j| facts.table.joint(j).is_none()) {
            selection.joint = None;
        }
        if selection.site.as_ref().is_some_and(|s| !facts.ik_sites.iter().any(|k| &k.name == s)) {
            selection.site = None;
        }
        if selection == self.selection {
            return;
        }
        self.selection = selection;
        self.grip = None;
        self.viewport.edit(|scene| scene.remove(GIZMO));
        self.place_gizmo();
        self.hub.send(&Event::Select(self.selection.clone()));
    }

    /// Transforms that the gizmo stands by: the floating pose, else the command.
    fn reference(&self) -> Option<Vec<f32>> {
        if let Some(bodies) = &self.floating_bodies {
            return Some(bodies.clone());
        }
        let at = self.frame.round() as usize;
        if at < self.live.state().cached_to {
            return self.live.bodies(at).map(|(_, goal)| goal.to_vec());
        }
        self.ghost.as_ref().filter(|(f, _)| *f == at).map(|(_, b)| b.clone())
    }

    /// Anchor and axis of a joint in the world.
    fn axis(&self, bodies: &[f32], joint: usize) -> Option<(V3, V3)> {
        let axis = self.facts.as_ref()?.axes.get(joint)?;
        let place = Place::of(bodies, axis.body)?;
        Some((place.point(axis.pos), space::rotate(place.quat, axis.axis)))
    }

    fn selected_joint(&self) -> Option<usize> {
        let name = self.selection.joint.as_ref()?;
        self.facts.as_ref()?.table.joints.iter().position(|j| &j.name == name)
    }

    fn place_gizmo(&mut self) {
        let (Some(cast), Some(facts)) = (&self.cast, &self.facts) else { return };
        let Some(bodies) = self.reference() else { return };
        let scale = cast.gizmo_scale();
        if let Some(name) = &self.selection.site {
            let Some(site) = facts.ik_sites.iter().find(|s| &s.name == name) else { return };
            let Some(place) = Place::of(&bodies, site.body) else { return };
            let props = TransformControlsProps {
                scale,
                disable_rotations: true,
                depth_test: false,
                ..TransformControlsProps::default()
            };
            let quat = [1.0, 0.0, 0.0, 0.0];
            self.put_gizmo(props, Place { pos: place.point(site.pos), quat });
            return;
        }
        let Some(joint) = self.selected_joint() else { return };
        let Some((anchor, axis)) = self.axis(&bodies, joint) else { return };
        let hinge = facts.table.joints.get(joint).is_some_and(|j| j.unit == Unit::Rad);
        // The ring of the x-y plane turns about z, which lies along the joint's axis.
        let props = TransformControlsProps {
            scale,
            active_axes: if hinge { [true, true, false] } else { [false, false, true] },
            disable_axes: hinge,
            disable_sliders: true,
            disable_rotations: !hinge,
            depth_test: false,
            ..TransformControlsProps::default()
        };
        self.put_gizmo(props, Place { pos: anchor, quat: space::from_z(axis) });
    }

    fn put_gizmo(&self, props: TransformControlsProps, place: Place) {
        self.viewport.edit(|scene| {
            scene.put(Message::create(GIZMO, props));
            scene.put(Message::position(GIZMO, place.pos));
            scene.put(Message::orientation(GIZMO, place.quat));
        });
    }

    fn touched(&mut self, incoming: Incoming) {
        match incoming {
            Incoming::SceneNodeClickMessage { name } => {
                let body = self.cast.as_ref().and_then(|c| c.body_of(&name));
                if let Some(body) = body {
                    self.select_body(body);
                }
            }
            Incoming::TransformControlsDragStartMessage { name } if name == GIZMO => {
                let held = match &self.selection.site {
                    Some(site) => Some(Held::Site { name: site.clone() }),
                    None => self.selected_joint().and_then(|j| self.hold(j)),
                };
                self.grasp(held);
            }
            Incoming::TransformControlsUpdateMessage { name, wxyz, position } if name == GIZMO => {
                self.turned(space::unit(wxyz), position);
            }
            Incoming::TransformControlsDragEndMessage { name } if name == GIZMO => self.let_go(),
            Incoming::SceneNodeDragMessage { phase, name, start_position, end_position } => {
                self.dragged(phase, &name, start_position, end_position);
            }
            _ => {}
        }
    }

    fn select_body(&mut self, body: usize) {
        let Some(facts) = &self.facts else { return };
        let name = facts.bodies.get(body).map(|b| b.name.clone());
        self.select(Selection { body: name, ..Selection::default() });
    }

    fn hold(&self, joint: usize) -> Option<Held> {
        let bodies = self.reference()?;
        let (anchor, axis) = self.axis(&bodies, joint)?;
        let start = Place { pos: anchor, quat: space::from_z(axis) };
        Some(Held::Joint { joint, anchor, axis, start, total: 0.0, last: 0.0 })
    }

    fn grasp(&mut self, held: Option<Held>) {
        let base = self.floating.clone().or_else(|| self.goal_pose());
        let (Some(what), Some(base)) = (held, base) else { return };
        self.play = None;
        self.released_at = None;
        self.grip = Some(Grip { what, pose: base.clone(), base });
    }

    /// The gizmo was moved there.
    fn turned(&mut self, quat: space::Q, pos: V3) {
        let hinge = self.held_is_hinge();
        let Some(grip) = &mut self.grip else { return };
        match &mut grip.what {
            Held::Site { .. } => {
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
                self.move_joint(false);
            }
        }
    }

    /// A link is dragged with the mouse: it turns about its own joint.
    fn dragged(&mut self, phase: Phase, node: &str, from: V3, to: V3) {
        if phase == Phase::Start {
            let Some(body) = self.cast.as_ref().and_then(|c| c.body_of(node)) else { return };
            self.select_body(body);
            let held = self.selected_joint().and_then(|j| self.hold(j));
            self.grasp(held);
        }
        let hinge = self.held_is_hinge();
        if let Some(Grip { what: Held::Joint { anchor, axis, total, last, .. }, .. }) =
            &mut self.grip
        {
            if hinge {
                let flat = |p: V3| {
                    let arm = space::sub(p, *anchor);
                    space::sub(arm, space::scale(*axis, space::dot(arm, *axis)))
                };
                let (a, b) = (flat(from), flat(to));
                let now = space::dot(*axis, space::cross(a, b)).atan2(space::dot(a, b));
                *total += space::wrap(now - *last);
                *last = now;
            } else {
                *total = space::dot(space::sub(to, from), *axis);
            }
            self.move_joint(false);
        }
        if phase == Phase::End {
            self.let_go();
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
    fn move_joint(&mut self, done: bool) {
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
        let pose = grip.pose.clone();
        self.hub.send(&Event::Joint { values, done });
        self.float(Some(pose));
    }

    /// Sends the newest pull, unless one is under way.
    fn pull(&mut self) {
        if self.ik_busy {
            return;
        }
        let Some(Grip { what: Held::Site { name }, pose, .. }) = &self.grip else { return };
        let Some(pos) = self.ik_next.take() else { return };
        let request =
            IkRequest { q: pose.clone(), site: name.clone(), pos, quat: None, locked: Vec::new() };
        self.ik_busy = true;
        self.ask(Request::Ik(request), Say::Ik);
    }

    fn pulled(&mut self, answer: Result<Report, Error>) {
        self.ik_busy = false;
        let (Ok(Report::Ik(found)), Some(grip)) = (answer, &mut self.grip) else { return };
        grip.pose = found.q.iter().map(|v| crate::clip::round(*v)).collect();
        let pose = grip.pose.clone();
        self.tell_pose(false);
        self.float(Some(pose));
        self.pull();
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
        self.hub.send(&Event::Joint { values, done });
    }

    fn let_go(&mut self) {
        if self.grip.is_none() {
            return;
        }
        self.tell_pose(true);
        self.grip = None;
        self.ik_next = None;
        self.released_at = Some(self.live.state().generation);
        self.place_gizmo();
    }
}

/// A command's pose in state order, masks bridged by straight lines.
fn pose_at(facts: &RobotFacts, command: &crate::clip::Command, frame: u32) -> Option<Vec<f64>> {
    let row = command.interpolated(frame.min(command.frames().saturating_sub(1)));
    facts
        .table
        .joints
        .iter()
        .map(|j| {
            let at = command.joints().iter().position(|name| name == &j.name)?;
            row.get(at).map(|v| f64::from(*v))
        })
        .collect()
}

/// The joint that moves a body: its own, else that of the nearest body it hangs on.
fn moving_joint(facts: &RobotFacts, body: usize) -> Option<usize> {
    let mut at = body;
    for _ in 0..facts.bodies.len() {
        let body = facts.bodies.get(at)?;
        if let Some(joint) = body.joints.last() {
            return Some(*joint);
        }
        at = body.parent;
    }
    None
}
