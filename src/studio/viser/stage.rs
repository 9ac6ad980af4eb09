//! What the viewport shows, and what a hand in it does.
//!
//! One task owns this state. It moves the robots along the rollout (60 times a second while
//! playing, interpolated, as the client does not interpolate) and places the gizmo; what a hand
//! does there is in `hand`. So there is one way into the document: the page's.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::mpsc::{Receiver, Sender};
use tokio::sync::oneshot;
use tokio::time::Instant;

use super::Viewport;
use super::hand::Grip;
use super::incoming::Incoming;
use super::look::{Hovered, Lens};
use super::scene::{self, Actor, Cast};
use super::space::{self, Place, V3};
use crate::clip::Level;
use crate::studio::error::Error;
use crate::studio::hub::Hub;
use crate::studio::live::Live;
use crate::studio::protocol::{Event, Phase as Rollout, Selection, StudioOp};
use crate::studio::worker::{Report, Request, RobotFacts, WorkerHandle};
use crate::take::viser::{Message, TransformControlsProps};
use crate::units::{FPS, Unit};

/// Between two pictures while playing.
const TICK: Duration = Duration::from_micros(16_667);
pub(super) const GIZMO: &str = "/gizmo";
/// Moments of a motion that the camera must hold.
const MOMENTS: usize = 16;

/// What the stage is told.
#[derive(Debug)]
pub(super) enum Say {
    /// A request of a page.
    View(StudioOp),
    /// A message of a page's 3D client.
    Client(Option<String>, Incoming),
    /// What a page's pointer is over; 0 to 1 from the top left corner.
    Hover(String, [f64; 2], oneshot::Sender<Option<Hovered>>),
    /// Meshes of a robot.
    Geometry(Arc<RobotFacts>, Result<Report, Error>),
    /// Transforms of a floating pose.
    Floating(u64, Result<Report, Error>),
    /// Transforms of the commanded pose at a frame that is not simulated.
    Ghost(usize, Result<Report, Error>),
    /// Transforms of the keys around the playhead.
    Onion([Option<u32>; 2], Result<Report, Error>),
    /// Inverse kinematics, for a grip.
    Ik(u64, Result<Report, Error>),
}

#[derive(Debug)]
pub(super) struct Play {
    from: f64,
    since: Instant,
    speed: f64,
    range: Option<[u32; 2]>,
}

/// The state; see the module.
#[allow(clippy::struct_excessive_bools)] // four switches of a view, not a state machine
pub(super) struct Stage {
    pub(super) viewport: Arc<Viewport>,
    pub(super) live: Arc<Live>,
    worker: WorkerHandle,
    pub(super) hub: Hub,
    inbox: Sender<Say>,
    pub(super) facts: Option<Arc<RobotFacts>>,
    pub(super) cast: Option<Cast>,
    /// Whether the camera has been set for the whole motion of the document.
    framed: bool,
    pub(super) frame: f64,
    pub(super) play: Option<Play>,
    pub(super) achieved: bool,
    command: bool,
    ghosts: bool,
    pub(super) selection: Selection,
    /// Joints that no hand moves.
    pub(super) locked: BTreeSet<String>,
    /// Cameras of the pages.
    pub(super) lenses: BTreeMap<String, Lens>,
    pub(super) grip: Option<Grip>,
    pub(super) grips: u64,
    /// A pose that is not in the clip, and its transforms.
    pub(super) floating: Option<Vec<f64>>,
    floating_bodies: Option<Vec<f32>>,
    floating_number: u64,
    /// Let go: the next rollout of an edited document ends the floating pose.
    pub(super) released_at: Option<u64>,
    ghost: Option<(usize, Vec<f32>)>,
    ghost_asked: bool,
    onion: [Option<u32>; 2],
    onion_asked: bool,
    /// A take stands beside.
    pub(super) beside: bool,
    pub(super) ik_busy: bool,
    pub(super) ik_next: Option<V3>,
    /// Let go as soon as the last pull is answered.
    pub(super) let_go_next: bool,
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
            locked: BTreeSet::new(),
            lenses: BTreeMap::new(),
            grip: None,
            grips: 0,
            floating: None,
            floating_bodies: None,
            floating_number: 0,
            released_at: None,
            ghost: None,
            ghost_asked: false,
            onion: [None; 2],
            onion_asked: false,
            beside: false,
            ik_busy: false,
            ik_next: None,
            let_go_next: false,
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
            Say::Client(tab, incoming) => self.touched(tab, incoming),
            Say::Hover(tab, at, reply) => {
                reply.send(self.under(&tab, at)).ok();
            }
            Say::Geometry(facts, Ok(Report::Geometry(geometry))) => {
                if self.facts.as_ref().is_some_and(|f| Arc::ptr_eq(f, &facts)) {
                    let home = geometry.home.clone();
                    let cast = self.viewport.edit(|scene| {
                        let mut cast = scene::build(scene, *geometry);
                        cast.camera(scene, &facts, "home", &[]);
                        cast.pose(scene, Actor::Robot, |b| Place::of(&home, b));
                        cast
                    });
                    self.cast = Some(cast);
                    self.beside = false;
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
            Say::Ik(number, answer) => self.pulled(number, answer),
            Say::Geometry(_, Err(e)) => {
                self.hub.send(&Event::Notice { level: Level::Warning, message: e.to_string() });
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
        self.let_go_next = false;
        self.ghost = None;
        self.onion = [None; 2];
        self.select(Selection::default());
        self.lock(Vec::new());
        self.float(None);
        if known {
            self.refresh();
            return;
        }
        self.cast = None;
        self.beside = false;
        let Some(facts) = self.facts.clone() else {
            self.viewport.edit(|scene| {
                for root in
                    Actor::ALL.map(Actor::root).into_iter().chain(["/world", GIZMO, scene::OUTLINE])
                {
                    scene.remove(root);
                }
            });
            return;
        };
        let request = Request::Geometry { robot: facts.source.clone() };
        self.ask(request, move |answer| Say::Geometry(facts, answer));
    }

    pub(super) fn ask(
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
                    let chosen = self.chosen_body().filter(|_| preset == "selection");
                    let near = chosen.and_then(|b| cast.around(facts, b));
                    self.viewport.edit(|scene| match near {
                        Some(points) => Cast::look_at(scene, facts, &points),
                        None => cast.camera(scene, facts, &preset, &self.live.moments(MOMENTS)),
                    });
                }
            }
            StudioOp::ViewLock { joints } => self.lock(joints),
            StudioOp::ViewCancel {} => self.cancel_grip(),
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
    pub(super) fn float(&mut self, pose: Option<Vec<f64>>) {
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
    pub(super) fn goal_pose(&self) -> Option<Vec<f64>> {
        let facts = self.facts.as_ref()?;
        let (command, _) = self.live.command();
        pose_at(facts, command.as_deref()?, self.frame.round() as u32)
    }

    /// Draws everything anew; what has not moved costs nothing.
    pub(super) fn refresh(&mut self) {
        let chosen = self.chosen_body();
        let errors = self.has_goal();
        let Some(cast) = &mut self.cast else { return };
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
        let other = self.live.beside(at).zip(self.live.beside(at + 1));
        let beside = |body: usize| other.as_ref().and_then(|(a, b)| between(a, b, body));
        let seen = achieved || floating.is_some();
        // An error is one only where there is a goal now, and what was reached is known.
        let judged = errors && simulated && floating.is_none();
        let entered = std::mem::replace(&mut self.beside, other.is_some());
        self.viewport.edit(|scene| {
            cast.pose(scene, Actor::Robot, real);
            cast.pose(scene, Actor::Command, asked);
            // Without the solid robot there is nothing that a ghost could agree with.
            cast.unveil(scene, Actor::Command, |b| real(b).zip(asked(b)).filter(|_| seen));
            cast.tint(scene, |b| real(b).zip(asked(b)).filter(|_| judged));
            cast.outline(scene, chosen, |b| if seen { real(b) } else { asked(b) });
            scene.put(Message::visibility(Actor::Robot.root(), seen));
            scene.put(Message::visibility(Actor::Command.root(), command));
            if other.is_some() {
                if !entered {
                    cast.enter(scene, Actor::Beside);
                }
                cast.pose(scene, Actor::Beside, beside);
                cast.unveil(scene, Actor::Beside, |b| real(b).zip(beside(b)).filter(|_| seen));
            } else if entered {
                scene.remove(Actor::Beside.root());
            }
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
        if self.grip.as_ref().is_none_or(|g| !g.by_gizmo) {
            self.place_gizmo();
        }
    }

    /// Whether any joint has a goal at the playhead.
    fn has_goal(&self) -> bool {
        let (command, _) = self.live.command();
        let at = self.frame.round() as u32;
        command.is_some_and(|c| at < c.frames() && (0..c.dim()).any(|j| c.sees(at, j)))
    }

    /// Joints that no hand moves from now on.
    fn lock(&mut self, joints: Vec<String>) {
        let known = |j: &String| self.facts.as_ref().is_some_and(|f| f.table.joint(j).is_some());
        let locked: BTreeSet<String> = joints.into_iter().filter(known).collect();
        if locked == self.locked {
            return;
        }
        self.locked = locked;
        self.live.set_locked(self.locked.iter().cloned().collect());
        self.hub.send(&Event::Locked { joints: self.locked.iter().cloned().collect() });
        self.viewport.edit(|scene| scene.remove(GIZMO));
        self.place_gizmo();
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
        let Some(cast) = &mut self.cast else { return };
        let wanted = self.ghosts;
        self.viewport.edit(|scene| {
            for ((actor, key), row) in [Actor::Past, Actor::Future].iter().zip(keys).zip(bodies) {
                cast.pose(scene, *actor, |b| Place::of(row, b));
                scene.put(Message::visibility(actor.root(), wanted && key.is_some()));
            }
        });
    }

    pub(super) fn select(&mut self, mut selection: Selection) {
        let Some(facts) = self.facts.clone() else {
            self.selection = Selection::default();
            return;
        };
        if selection.joint.is_none()
            && let Some(body) = &selection.body
        {
            let body = facts.bodies.iter().position(|b| &b.name == body);
            let joint = body.and_then(|b| self.moving_joint(&facts, b, false));
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
        self.refresh();
        self.hub.send(&Event::Select(self.selection.clone()));
    }

    /// Transforms that the gizmo stands by: the floating pose, else the command.
    pub(super) fn reference(&self) -> Option<Vec<f32>> {
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
    pub(super) fn axis(&self, bodies: &[f32], joint: usize) -> Option<(V3, V3)> {
        let axis = self.facts.as_ref()?.axes.get(joint)?;
        let place = Place::of(bodies, axis.body)?;
        Some((place.point(axis.pos), space::rotate(place.quat, axis.axis)))
    }

    pub(super) fn selected_joint(&self) -> Option<usize> {
        let name = self.selection.joint.as_ref()?;
        self.facts.as_ref()?.table.joints.iter().position(|j| &j.name == name)
    }

    pub(super) fn place_gizmo(&mut self) {
        let (Some(cast), Some(facts)) = (&self.cast, &self.facts) else { return };
        let Some(bodies) = self.reference() else { return };
        let scale = cast.gizmo_scale();
        if let Some(name) = &self.selection.site {
            let Some(pos) = self.site_place(name) else { return };
            let props = TransformControlsProps {
                scale,
                disable_rotations: true,
                depth_test: false,
                ..TransformControlsProps::default()
            };
            self.put_gizmo(props, Place { pos, quat: [1.0, 0.0, 0.0, 0.0] });
            return;
        }
        let Some(joint) = self.selected_joint().filter(|j| !self.is_locked(*j)) else { return };
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

    /// Also where the server knows of no change: a client's drag may have moved it.
    pub(super) fn place_gizmo_anew(&mut self) {
        self.viewport.edit(|scene| scene.remove(GIZMO));
        self.place_gizmo();
    }

    /// Where a site is in the pose that the gizmo stands by.
    pub(super) fn site_place(&self, name: &str) -> Option<V3> {
        let site = self.facts.as_ref()?.ik_sites.iter().find(|s| s.name == name)?;
        Some(Place::of(&self.reference()?, site.body)?.point(site.pos))
    }

    fn put_gizmo(&self, props: TransformControlsProps, place: Place) {
        self.viewport.edit(|scene| {
            scene.put(Message::create(GIZMO, props));
            scene.put(Message::position(GIZMO, place.pos));
            scene.put(Message::orientation(GIZMO, place.quat));
        });
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
