//! The stage: the content of the viewport, and the gestures in it.
//!
//! One task owns this state. It moves the robots along the rollout (60 times a second during
//! playback, interpolated, since the client does not interpolate) and places the gizmo; `gestures`
//! handles what a person does in the scene. A gesture changes the document only through the page.

use std::sync::Arc;

use tokio::sync::mpsc::Sender;

use super::drag::Hand;
use super::message::ViewportMessage;
use super::overlays::Overlays;
use super::page_camera::PageCameras;
use super::playback::Playback;
use super::scene_nodes::SceneNodes;
use super::shared::Shared;
use super::space::{self, Place, V3};
use crate::protocol::{Error, Hub};
use crate::simulation::worker::Question;
use crate::simulation::{RobotContext, Simulation};

/// The state; see the module.
pub(super) struct Stage {
    pub(super) shared: Arc<Shared>,
    pub(super) simulation: Simulation,
    pub(super) hub: Hub,
    inbox: Sender<ViewportMessage>,
    /// The robot that is shown.
    pub(super) robot: Option<Arc<RobotContext>>,
    pub(super) nodes: Option<SceneNodes>,
    pub(super) playback: Playback,
    pub(super) overlays: Overlays,
    pub(super) hand: Hand,
    pub(super) cameras: PageCameras,
}

impl Stage {
    /// An empty stage.
    pub(super) fn new(
        shared: Arc<Shared>,
        simulation: Simulation,
        hub: Hub,
        inbox: Sender<ViewportMessage>,
    ) -> Stage {
        Stage {
            shared,
            simulation,
            hub,
            inbox,
            robot: None,
            nodes: None,
            playback: Playback::default(),
            overlays: Overlays::default(),
            hand: Hand::default(),
            cameras: PageCameras::default(),
        }
    }

    /// Asks the simulation; the answer arrives as a message.
    pub(super) fn ask<Q: Question>(
        &self,
        question: Q,
        then: impl FnOnce(Result<Q::Answer, Error>) -> ViewportMessage + Send + 'static,
    ) {
        let inbox = self.inbox.clone();
        // The inbox is full during a storm of drags; the next drag asks again.
        self.simulation.ask_with(question, move |answer| {
            inbox.try_send(then(answer)).ok();
        });
    }

    /// The commanded pose at the playhead, in state order.
    pub(super) fn goal_pose(&self) -> Option<Vec<f64>> {
        let facts = self.robot.as_ref()?;
        let (command, _) = self.simulation.rollout.command();
        facts.pose_at(command.as_deref()?, self.playback.frame.round() as u32)
    }

    /// Whether any joint has a goal at the playhead.
    pub(super) fn has_goal(&self) -> bool {
        let (command, _) = self.simulation.rollout.command();
        let at = self.playback.frame.round() as u32;
        command.is_some_and(|c| at < c.frames() && (0..c.dim()).any(|j| c.sees(at, j)))
    }

    /// The body transforms at which the gizmo is placed: the floating pose, else the command.
    pub(super) fn reference(&self) -> Option<Vec<f32>> {
        if let Some(bodies) = &self.hand.floating.bodies {
            return Some(bodies.clone());
        }
        let at = self.playback.frame.round() as usize;
        if at < self.simulation.rollout.state().cached_to {
            return self.simulation.rollout.bodies(at).map(|(_, goal)| goal.to_vec());
        }
        self.overlays.ghost.as_ref().filter(|(f, _)| *f == at).map(|(_, b)| b.clone())
    }

    /// Anchor and axis of a joint in the world.
    pub(super) fn axis(&self, bodies: &[f32], joint: usize) -> Option<(V3, V3)> {
        let axis = self.robot.as_ref()?.axes.get(joint)?;
        let place = Place::of(bodies, axis.body)?;
        Some((place.point(axis.pos), space::rotate(place.quat, axis.axis)))
    }

    pub(super) fn selected_joint(&self) -> Option<usize> {
        let name = self.hand.selection.joint.as_ref()?;
        self.robot.as_ref()?.table.joints.iter().position(|j| &j.name == name)
    }

    /// The place of a site in the pose at which the gizmo stands.
    pub(super) fn site_place(&self, name: &str) -> Option<V3> {
        let site = self.robot.as_ref()?.ik_sites.iter().find(|s| s.name == name)?;
        Some(Place::of(&self.reference()?, site.body)?.point(site.pos))
    }

    /// The body of the selection: its own, else the one that its joint moves, else the one of its
    /// site.
    pub(super) fn chosen_body(&self) -> Option<usize> {
        let facts = self.robot.as_ref()?;
        let named = self.hand.selection.body.as_ref();
        let body = named.and_then(|name| facts.bodies.iter().position(|b| &b.name == name));
        let joint = || Some(facts.axes.get(self.selected_joint()?)?.body);
        let site = || {
            let name = self.hand.selection.site.as_ref()?;
            Some(facts.ik_sites.iter().find(|s| &s.name == name)?.body)
        };
        body.or_else(joint).or_else(site)
    }
}
