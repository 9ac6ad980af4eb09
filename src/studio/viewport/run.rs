//! The loop of the stage: messages, the rollout, the clock.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::mpsc::Receiver;
use tokio::time::Instant;

use super::build;
use super::figure::Figure;
use super::gizmo::GIZMO;
use super::message::ViewportMessage;
use super::scene_nodes::{OUTLINE, SceneNodes};
use super::space::Place;
use super::stage::Stage;
use crate::protocol::{Event, Hovered, Phase, Selection, StudioOp};
use crate::simulation::RobotContext;
use crate::simulation::worker::LookAtRobot;
use robert_clip::Level;

/// Between two pictures while playing.
const TICK: Duration = Duration::from_micros(16_667);
/// The number of moments of a motion at which the camera must show the whole robot.
const MOMENTS: usize = 16;

/// Runs for the life of the studio.
pub(super) async fn run(mut stage: Stage, mut inbox: Receiver<ViewportMessage>) {
    let mut rollout = stage.simulation.rollout.watch();
    stage.shared.edit(build::empty);
    let mut tick = Instant::now();
    loop {
        tokio::select! {
            message = inbox.recv() => match message {
                Some(message) => stage.handle(message),
                None => return,
            },
            changed = rollout.changed() => {
                if changed.is_err() {
                    return;
                }
                stage.follow();
            }
            () = tokio::time::sleep_until(tick + TICK), if stage.playback.play.is_some() => {
                tick = Instant::now();
                stage.advance(tick);
            }
        }
    }
}

impl Stage {
    fn handle(&mut self, message: ViewportMessage) {
        match message {
            ViewportMessage::View(op, done) => {
                self.view(op);
                done.send(()).ok();
            }
            ViewportMessage::Client(tab, incoming) => self.touched(tab, incoming),
            ViewportMessage::Hover(tab, at, reply) => {
                reply.send(self.under(&tab, at)).ok();
            }
            ViewportMessage::Sketch(tab, points, plane, site, reply) => {
                reply.send(self.sketch(&tab, &points, plane, &site)).ok();
            }
            ViewportMessage::Geometry(facts, Ok(geometry)) => {
                if self.robot.as_ref().is_some_and(|f| Arc::ptr_eq(f, &facts)) {
                    let home = geometry.home.clone();
                    let look = self.overlays.look;
                    let nodes = self.shared.edit(|scene| {
                        let mut nodes = build::build(scene, geometry, look);
                        nodes.camera(scene, &facts, "home", &[]);
                        nodes.pose(scene, Figure::Robot, |b| Place::of(&home, b));
                        nodes
                    });
                    self.nodes = Some(nodes);
                    self.overlays.beside = false;
                    self.overlays.reachable.forget();
                    self.overlays.onion = [None; 2];
                    self.overlays.onion_bodies.clear();
                    self.refresh();
                }
            }
            ViewportMessage::Floating(number, Ok(bodies)) => {
                if number == self.hand.floating.number && self.hand.floating.pose.is_some() {
                    self.hand.floating.bodies = bodies.into_iter().next();
                    self.refresh();
                }
            }
            ViewportMessage::Ghost(frame, answer) => {
                self.overlays.ghost_asked = false;
                if let Ok(bodies) = answer {
                    self.overlays.ghost = bodies.into_iter().next().map(|b| (frame, b));
                    self.refresh();
                }
            }
            ViewportMessage::Onion(keys, answer) => {
                self.overlays.onion_asked = false;
                if let Ok(bodies) = answer {
                    self.show_onion(keys, &bodies);
                }
            }
            ViewportMessage::Reachable(pose, answer) => self.reachable_found(pose, answer),
            ViewportMessage::Ik(number, answer) => self.pulled(number, answer),
            ViewportMessage::Geometry(_, Err(e)) => {
                self.hub.send(&Event::Notice { level: Level::Warning, message: e.to_string() });
            }
            ViewportMessage::Floating(..) => {}
        }
    }

    /// The rollout has progressed, or the document was replaced.
    fn follow(&mut self) {
        let facts = self.simulation.robot();
        let same = match (&facts, &self.robot) {
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            (None, None) => true,
            _ => false,
        };
        if !same {
            self.take_robot(facts);
            return;
        }
        let state = self.simulation.rollout.state();
        if !self.cameras.framed && self.nodes.is_some() && state.phase == Phase::Done {
            self.cameras.framed = true;
            self.view(StudioOp::ViewCamera { preset: "home".to_owned() });
        }
        if self.hand.released_at.is_some_and(|g| state.generation > g && state.rev > 0)
            && state.cached_to > 0
        {
            self.float(None);
        }
        self.refresh();
    }

    fn take_robot(&mut self, facts: Option<Arc<RobotContext>>) {
        let known = match (&facts, &self.robot) {
            (Some(a), Some(b)) => a.source == b.source && self.nodes.is_some(),
            _ => false,
        };
        self.robot = facts;
        self.cameras.framed = false;
        self.playback.stand(0.0);
        self.hand.drag = None;
        self.hand.pull.let_go_next = false;
        self.overlays.ghost = None;
        self.overlays.onion = [None; 2];
        self.overlays.onion_bodies.clear();
        self.select(Selection::default());
        self.forget_path();
        self.lock(Vec::new());
        self.pin(Vec::new());
        self.float(None);
        if known {
            self.refresh();
            return;
        }
        self.nodes = None;
        self.overlays.beside = false;
        self.overlays.reachable.forget();
        let Some(facts) = self.robot.clone() else {
            self.shared.edit(|scene| {
                for root in
                    Figure::ALL.map(Figure::root).into_iter().chain(["/world", GIZMO, OUTLINE])
                {
                    scene.remove(root);
                }
            });
            return;
        };
        let request = LookAtRobot { robot: facts.source.clone() };
        self.ask(request, move |answer| ViewportMessage::Geometry(facts, answer));
    }

    fn view(&mut self, op: StudioOp) {
        match op {
            StudioOp::ViewFrame { frame } => {
                self.playback.stand(frame);
                self.refresh();
            }
            StudioOp::ViewPlay { frame, range, speed } => {
                self.playback.start(frame, range, speed);
                self.refresh();
            }
            StudioOp::ViewShow(show) => {
                let now = &mut self.overlays.show;
                now.achieved = show.achieved.unwrap_or(now.achieved);
                now.command = show.command.unwrap_or(now.command);
                now.ghosts = show.ghosts.unwrap_or(now.ghosts);
                let path = &mut self.overlays.path;
                path.wanted = show.path.unwrap_or(path.wanted);
                let reachable = &mut self.overlays.reachable;
                reachable.wanted = show.reachable.unwrap_or(reachable.wanted);
                let look = &mut self.overlays.look;
                look.dark = show.dark.unwrap_or(look.dark);
                look.shadows = show.shadows.unwrap_or(look.shadows);
                let (look, radius) = (*look, self.nodes.as_ref().map(|n| n.radius));
                self.shared.edit(|scene| build::dress(scene, look, radius));
                self.refresh();
            }
            StudioOp::ViewSelect(selection) => self.select(selection),
            StudioOp::ViewCamera { preset } => {
                if let (Some(nodes), Some(facts)) = (&self.nodes, &self.robot) {
                    let chosen = self.chosen_body().filter(|_| preset == "selection");
                    let near = chosen.and_then(|b| nodes.around(facts, b));
                    self.shared.edit(|scene| match near {
                        Some(points) => SceneNodes::look_at(scene, facts, &points),
                        None => nodes.camera(
                            scene,
                            facts,
                            &preset,
                            &self.simulation.rollout.moments(MOMENTS),
                        ),
                    });
                }
            }
            StudioOp::ViewLock { joints } => self.lock(joints),
            StudioOp::ViewPins { pins } => self.pin(pins),
            StudioOp::ViewCancel {} => self.cancel_drag(),
            StudioOp::ViewPose { q } => self.float(q),
            _ => {}
        }
    }

    fn advance(&mut self, now: Instant) {
        let last = self.simulation.rollout.state().frames.saturating_sub(1) as f64;
        self.playback.advance(now, last);
        self.refresh();
    }

    /// The part of the robot under a page's pointer.
    pub(crate) fn under(&self, tab: &str, at: [f64; 2]) -> Option<Hovered> {
        let (camera, facts) = (self.cameras.of(tab)?, self.robot.as_ref()?);
        let body = self.nodes.as_ref()?.first_hit(camera.eye, camera.ray(at))?;
        let joint = facts.moving_joint(body, &BTreeSet::new());
        Some(Hovered {
            body: facts.bodies.get(body)?.name.clone(),
            joint: joint.and_then(|j| facts.table.joints.get(j)).map(|j| j.name.clone()),
        })
    }
}
