//! The pose that the robot can reach at the playhead, where it cannot reach the commanded one.
//!
//! It was found when the clip's poses were checked. So nothing is simulated for it, and while a pose
//! is dragged, which nobody has checked yet, it is not shown.

use super::figure::Figure;
use super::message::{Bodies, ViewportMessage};
use super::space::Place;
use super::stage::Stage;
use crate::simulation::worker::Kinematics;
use robert_take::viser::Message;

impl Stage {
    /// The reachable pose at the playhead; none where the commanded one is reached.
    fn reachable_pose(&self) -> Option<Vec<f64>> {
        let rests = self.playback.play.is_none() && self.hand.floating.pose.is_none();
        if !self.overlays.reachable.wanted || !rests {
            return None;
        }
        let at = self.playback.frame.round() as u32;
        self.simulation.rollout.rests_in(at, &self.goal_pose()?)
    }

    /// Shows it, as far as it differs from the command and from the solid robot.
    pub(super) fn draw_reachable(&mut self) {
        let pose = self.reachable_pose();
        let known = &mut self.overlays.reachable;
        if let Some(q) = &pose
            && known.pose != pose
            && known.asked != pose
        {
            known.asked.clone_from(&pose);
            let (poses, asked) = (vec![q.clone()], q.clone());
            self.ask(Kinematics { poses }, move |answer| ViewportMessage::Reachable(asked, answer));
        }
        let commanded = self.reference();
        let moved = pose.as_ref().map(|q| self.moved(q)).unwrap_or_default();
        let known = &mut self.overlays.reachable;
        let seen = pose.is_some() && known.pose == pose;
        let Some(nodes) = self.nodes.as_mut().filter(|_| seen || known.in_scene) else { return };
        let enters = !std::mem::replace(&mut known.in_scene, true);
        let bodies = &known.bodies;
        let achieved = self.overlays.show.achieved;
        self.shared.edit(|scene| {
            if enters {
                nodes.enter(scene, Figure::Reachable);
            }
            if seen {
                nodes.pose(scene, Figure::Reachable, |b| Place::of(bodies, b));
                // Of what no joint holds off, its own place hides it.
                let own = |b: usize| Place::of(bodies, b);
                let still = |b: usize| own(b).filter(|_| moved.get(b) != Some(&true));
                let goal = |b: usize| Place::of(commanded.as_deref()?, b);
                let solid: Vec<Option<Place>> =
                    (0..nodes.names.len()).map(|b| nodes.shown(b).filter(|_| achieved)).collect();
                let solid = |b: usize| solid.get(b).copied().flatten();
                nodes.unveil(scene, Figure::Reachable, own, &[&still, &goal, &solid]);
            }
            scene.put(Message::visibility(Figure::Reachable.root(), seen));
        });
    }

    /// The bodies that a joint moves which stays off: others only sag by less than the tolerance.
    fn moved(&self, rests: &[f64]) -> Vec<bool> {
        let (Some(facts), Some(asked)) = (&self.robot, self.goal_pose()) else { return Vec::new() };
        let off = asked.iter().zip(rests).map(|(a, b)| (a - b).abs() > facts.settle_tolerance);
        let roots: Vec<usize> =
            facts.axes.iter().zip(off).filter(|(_, off)| *off).map(|(axis, _)| axis.body).collect();
        (0..facts.bodies.len()).map(|b| roots.iter().any(|r| facts.hangs_on(b, *r))).collect()
    }

    /// Its transforms have come.
    pub(super) fn reachable_found(&mut self, pose: Vec<f64>, answer: Bodies) {
        let Some(bodies) = answer.ok().and_then(|b| b.into_iter().next()) else { return };
        let known = &mut self.overlays.reachable;
        (known.pose, known.bodies) = (Some(pose), bodies);
        self.refresh();
    }
}
