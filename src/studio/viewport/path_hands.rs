//! The path of the selected link or end effector through the clip: which point it shows, when it is
//! drawn again, and gestures on it. Dragging a diamond moves that point at its key; a click on the
//! line asks for a key there.

use std::sync::Arc;
use std::time::Instant;

use glam::Vec3;

use super::drag::{Grab, Held, Pulled};
use super::motion_path::{
    ASKED, COMMAND, DIAMOND, DOT, DOTS, KEY, KEYS, MotionPath, NEAR, PACE, PATH, REACHED, SHARE,
    Traced, click, command_line, diamonds, extent, handles, key_of, reached_line,
};
use super::space::{self, Place, V3};
use super::stage::Stage;
use crate::protocol::Event;
use robert_take::viser::{Binding, FrameProps, Message};

impl Stage {
    /// The point whose path is shown: the selected site, else that of the selected link, else the
    /// link's middle.
    fn traced(&self) -> Option<Traced> {
        let facts = self.robot.as_ref()?;
        let chosen = self.hand.selection.site.as_ref();
        let body = self.chosen_body().filter(|b| *b > 0)?;
        let site = facts.ik_sites.iter().find(|s| match chosen {
            Some(name) => &s.name == name,
            None => s.body == body,
        });
        if let Some(site) = site {
            let point = Pulled::Site(site.name.clone());
            return Some(Traced { body: site.body, offset: site.pos, point });
        }
        let (_, hull) = self.nodes.as_ref()?.hulls.iter().find(|(b, _)| *b == body)?;
        let low = hull.iter().fold(Vec3::INFINITY, |a, p| a.min(*p));
        let high = hull.iter().fold(Vec3::NEG_INFINITY, |a, p| a.max(*p));
        let offset = (0.5 * (low + high)).to_array().map(f64::from);
        let name = facts.bodies.get(body)?.name.clone();
        Some(Traced { body, offset, point: Pulled::Body(name, offset) })
    }

    /// Draws the path again if it has changed.
    pub(super) fn draw_path(&mut self) {
        let traced = self.traced().filter(|_| self.overlays.path.wanted);
        let rollout = &self.simulation.rollout;
        let (stamp, path) = (rollout.stamp(), &self.overlays.path);
        let same = traced == path.of;
        let Some(traced) = traced else {
            if !same {
                self.forget_path();
            }
            return;
        };
        let soon = path.drawn.is_some_and(|t| t.elapsed() < PACE) && !rollout.rests();
        if same && (stamp == path.stamp || soon) {
            return;
        }
        let radius = self.nodes.as_ref().map_or(0.5, |n| n.radius);
        let (reached, asked) = rollout.all_bodies();
        let way = |rows: &[Arc<[f32]>]| -> Vec<V3> {
            let at = |row: &Arc<[f32]>| Some(Place::of(row, traced.body)?.point(traced.offset));
            rows.iter().filter_map(at).collect()
        };
        let (reached, asked) = (way(&reached), way(&asked));
        // A small robot on a large path is seen from a distance.
        let size = radius.max(SHARE * extent(&asked));
        let (command, keys) = rollout.command();
        let goal = |frame: usize| {
            command.as_ref().is_some_and(|c| {
                (frame as u32) < c.frames() && (0..c.dim()).any(|j| c.sees(frame as u32, j))
            })
        };
        let shown: &[u32] = if same { &self.overlays.path.keys } else { &[] };
        let keys = handles(&keys, asked.len(), shown);
        let gone: Vec<u32> =
            self.overlays.path.keys.iter().filter(|k| !keys.contains(k)).copied().collect();
        self.shared.edit(|scene| {
            if !same {
                scene.remove(PATH);
            }
            scene.put(Message::create(PATH, FrameProps::default()));
            for key in gone {
                scene.remove(&format!("{KEYS}/{key}"));
            }
            scene.put(Message::create(ASKED, command_line(&asked, goal)));
            scene.put(Message::create(REACHED, reached_line(&reached, &asked, goal, radius)));
            let dots: Vec<V3> = asked
                .iter()
                .enumerate()
                .filter(|(f, _)| goal(*f) && !keys.contains(&(*f as u32)))
                .map(|(_, p)| *p)
                .collect();
            scene.put(Message::create(DOTS, diamonds(&dots, DOT * size, COMMAND)));
            for line in [DOTS, ASKED] {
                click(scene, line);
            }
            for key in &keys {
                let name = format!("{KEYS}/{key}");
                scene.put(Message::create(&name, diamonds(&[[0.0; 3]], DIAMOND * size, KEY)));
                if let Some(at) = asked.get(*key as usize) {
                    scene.put(Message::position(&name, *at));
                }
                click(scene, &name);
                let held = |modifier| Binding { button: "left", modifier };
                let bindings = vec![held(None), held(Some("shift"))];
                let owner = String::new();
                scene.put(Message::SetSceneNodeDragBindingsMessage { name, bindings, owner });
            }
        });
        let path = &mut self.overlays.path;
        (path.of, path.stamp, path.asked, path.keys) = (Some(traced), stamp, asked, keys);
        path.size = size;
        path.drawn = Some(Instant::now());
    }

    /// Takes the path off the stage.
    pub(super) fn forget_path(&mut self) {
        let wanted = self.overlays.path.wanted;
        self.overlays.path = MotionPath { wanted, ..MotionPath::default() };
        self.shared.edit(|scene| scene.remove(PATH));
    }

    /// A click on a diamond shows its key; one on the line asks for a key there.
    pub(super) fn path_clicked(&mut self, node: &str, ray: Option<[V3; 2]>, tab: Option<String>) {
        if let Some(frame) = key_of(node) {
            return self.hub.send(&Event::PathPoint { frame, values: None, tab });
        }
        let (command, _) = self.simulation.rollout.command();
        let (Some([eye, along]), Some(facts), Some(command)) = (ray, &self.robot, command) else {
            return;
        };
        let along = space::direction(along);
        let off = |p: &V3| {
            let to = space::sub(*p, eye);
            space::norm(space::sub(to, space::scale(along, space::dot(to, along))))
        };
        let frames = self.overlays.path.asked.iter().enumerate();
        let nearest = frames.map(|(f, p)| (f, off(p))).min_by(|a, b| a.1.total_cmp(&b.1));
        let near = NEAR * self.overlays.path.size;
        let Some((frame, _)) = nearest.filter(|(_, d)| *d < near) else { return };
        let Some(pose) = facts.pose_at(&command, frame as u32) else { return };
        let names = facts.table.joints.iter().map(|j| j.name.clone());
        let values = Some(names.zip(pose.into_iter().map(robert_clip::round)).collect());
        self.hub.send(&Event::PathPoint { frame: frame as u32, values, tab });
    }

    /// Begins to drag a diamond: its point is moved at its key.
    pub(super) fn grab_key(&mut self, frame: u32, grab: Grab, tab: Option<String>) {
        let path = &self.overlays.path;
        let (Some(traced), Some(at)) = (path.of.clone(), path.asked.get(frame as usize)) else {
            return;
        };
        let held = Held::Point { point: traced.point, at: *at, grab };
        if self.hand.floating.pose.is_some() {
            self.float(None);
        }
        self.playback.stand(f64::from(frame));
        self.hub.send(&Event::PathPoint { frame, values: None, tab: tab.clone() });
        self.grasp(Some(held), tab, false);
    }
}
