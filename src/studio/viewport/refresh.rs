//! Draws the figures where they are now.

use super::figure::Figure;
use super::message::ViewportMessage;
use super::motion_path::dense;
use super::overlays::Show;
use super::space::Place;
use super::stage::Stage;
use crate::simulation::worker::Kinematics;
use robert_take::viser::Message;

/// In dense motion ghosts are shown at this distance in frames, because the next key is only one
/// frame away.
const DENSE_GHOSTS: u32 = 10;

impl Stage {
    /// Draws everything again; parts that have not moved cost nothing.
    pub(super) fn refresh(&mut self) {
        let chosen = self.chosen_body();
        let errors = self.has_goal();
        let Some(nodes) = &mut self.nodes else { return };
        let state = self.simulation.rollout.state();
        let at = self.playback.frame.floor() as usize;
        let share = self.playback.frame - at as f64;
        let now = self.simulation.rollout.bodies(at);
        let next = self.simulation.rollout.bodies(at + 1);
        let simulated = at < state.cached_to;
        let ghost =
            self.overlays.ghost.as_ref().filter(|(frame, _)| *frame == at).map(|(_, b)| b.clone());
        let between = |a: &[f32], b: &[f32], body: usize| {
            Some(Place::between(Place::of(a, body)?, Place::of(b, body)?, share))
        };
        let floating = self.hand.floating.bodies.as_deref();
        let Show { achieved, command, ghosts } = self.overlays.show;
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
        let other = self.simulation.rollout.beside(at).zip(self.simulation.rollout.beside(at + 1));
        let beside = |body: usize| other.as_ref().and_then(|(a, b)| between(a, b, body));
        let seen = achieved || floating.is_some();
        // An error is shown only where there is a goal, and where the reached motion is known.
        let judged = errors && simulated && floating.is_none();
        let onion = self.overlays.onion_bodies.clone();
        // Without a neighbouring key there is no ghost, whatever another clip or frame has left.
        let around = self.overlays.onion.map(|key| ghosts && key.is_some() && !onion.is_empty());
        let entered = std::mem::replace(&mut self.overlays.beside, other.is_some());
        self.shared.edit(|scene| {
            nodes.pose(scene, Figure::Robot, real);
            nodes.pose(scene, Figure::Command, asked);
            // A figure that is not shown hides no other.
            let solid = |b: usize| real(b).filter(|_| seen);
            let goal = |b: usize| asked(b).filter(|_| command);
            nodes.unveil(scene, Figure::Command, asked, &[&solid]);
            nodes.tint(scene, |b| real(b).zip(asked(b)).filter(|_| judged));
            nodes.outline(scene, chosen, |b| if seen { real(b) } else { asked(b) });
            scene.put(Message::visibility(Figure::Robot.root(), seen));
            scene.put(Message::visibility(Figure::Command.root(), command));
            if other.is_some() {
                if !entered {
                    nodes.enter(scene, Figure::Beside);
                }
                nodes.pose(scene, Figure::Beside, beside);
                nodes.unveil(scene, Figure::Beside, beside, &[&solid]);
            } else if entered {
                scene.remove(Figure::Beside.root());
            }
            // A ghost of a neighbouring key at the robot's own pose, or at the command's, would only
            // tint it.
            for (figure, row) in [Figure::Past, Figure::Future].into_iter().zip(&onion) {
                nodes.unveil(scene, figure, |b| Place::of(row, b), &[&solid, &goal]);
            }
            for (figure, seen) in [Figure::Past, Figure::Future].into_iter().zip(around) {
                scene.put(Message::visibility(figure.root(), seen));
            }
        });
        if !simulated && state.frames > 0 && ghost.is_none() && !self.overlays.ghost_asked {
            self.ask_ghost(at);
        }
        if self.overlays.show.ghosts {
            self.ask_onion();
        }
        self.draw_reachable();
        self.draw_path();
        if self.hand.drag.as_ref().is_none_or(|g| !g.by_gizmo) {
            self.place_gizmo();
        }
    }

    /// Shows a pose that is not in the clip, or stops showing it.
    pub(super) fn float(&mut self, pose: Option<Vec<f64>>) {
        let fits = |q: &Vec<f64>| {
            self.robot.as_ref().is_some_and(|f| f.table.joints.len() == q.len())
                && q.iter().all(|v| v.abs() <= robert_base::limits::CLIP_VALUE_MAX)
        };
        self.hand.floating.pose = pose.filter(fits);
        self.hand.floating.number += 1;
        self.hand.released_at = None;
        if let Some(q) = self.hand.floating.pose.clone() {
            let number = self.hand.floating.number;
            self.ask(Kinematics { poses: vec![q] }, move |answer| {
                ViewportMessage::Floating(number, answer)
            });
        } else {
            self.hand.floating.bodies = None;
            self.refresh();
        }
    }

    pub(super) fn ask_ghost(&mut self, frame: usize) {
        let Some(pose) = self.goal_pose() else { return };
        self.overlays.ghost_asked = true;
        self.ask(Kinematics { poses: vec![pose] }, move |answer| {
            ViewportMessage::Ghost(frame, answer)
        });
    }

    pub(super) fn ask_onion(&mut self) {
        let (command, keys) = self.simulation.rollout.command();
        let (Some(command), Some(facts)) = (command, &self.robot) else { return };
        let at = self.playback.frame.round() as u32;
        let apart = if dense(&keys) { DENSE_GHOSTS } else { 1 };
        let past = keys.iter().rev().find(|k| **k + apart <= at).copied();
        let future = keys.iter().find(|k| **k >= at + apart).copied();
        let around = [past, future];
        if around == self.overlays.onion || self.overlays.onion_asked {
            return;
        }
        let poses = around
            .iter()
            .map(|k| facts.pose_at(&command, k.unwrap_or(at)))
            .collect::<Option<Vec<_>>>();
        let Some(poses) = poses else { return };
        self.overlays.onion_asked = true;
        self.ask(Kinematics { poses }, move |answer| ViewportMessage::Onion(around, answer));
    }

    pub(super) fn show_onion(&mut self, keys: [Option<u32>; 2], bodies: &[Vec<f32>]) {
        self.overlays.onion = keys;
        self.overlays.onion_bodies = bodies.to_vec();
        let Some(nodes) = &mut self.nodes else { return };
        self.shared.edit(|scene| {
            for (figure, row) in [Figure::Past, Figure::Future].into_iter().zip(bodies) {
                nodes.pose(scene, figure, |b| Place::of(row, b));
            }
        });
        self.refresh();
    }
}
