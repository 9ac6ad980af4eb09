//! The way of the selected link or end effector through the clip.
//!
//! The command is a thin line with a diamond at each key and a dot at each frame, what was reached
//! a thick one that is coloured by its distance from the command. A diamond can be dragged, which
//! is a pull of that point at its key; a click on the line asks for a key there.

use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::Vec3;

use super::drag::{Grab, Held, Pulled};
use super::retained::Retained;
use super::scene_nodes::FULL_ERROR;
use super::space::{self, Place, V3};
use super::stage::Stage;
use crate::protocol::Event;
use robert_render as render;
use robert_take::viser::{Binding, Buffer, FrameProps, LineSegmentsProps, MeshProps, Message, Rgb};

/// The node that holds all of it.
pub(super) const PATH: &str = "/path";
/// Diamonds are `/path/key/FRAME`.
const KEYS: &str = "/path/key";
const DOTS: &str = "/path/dots";
const ASKED: &str = "/path/asked";
const REACHED: &str = "/path/reached";

/// Sizes in radii of the robot.
const DIAMOND: f64 = 0.032;
const DOT: f64 = 0.009;
/// More keys than this are no handles: they would hide the line.
const HANDLES: usize = 240;
/// Between two drawings while frames come.
const PACE: Duration = Duration::from_millis(80);
/// A click is on the line if it passes by this near, in radii of the robot.
const NEAR: f64 = 0.06;

const COMMAND: Rgb = [120, 170, 255];
const KEY: Rgb = [255, 178, 62];
/// Reached where nothing was commanded.
const FREE: Rgb = [150, 156, 168];

/// The path that is shown.
#[derive(Debug)]
pub(super) struct MotionPath {
    /// The page wants to see it.
    pub(super) wanted: bool,
    of: Option<Traced>,
    stamp: u64,
    /// Where the command has the point, by frame, m.
    asked: Vec<V3>,
    /// Frames that have a diamond.
    keys: Vec<u32>,
    drawn: Option<Instant>,
}

impl Default for MotionPath {
    fn default() -> Self {
        let (asked, keys) = (Vec::new(), Vec::new());
        MotionPath { wanted: true, of: None, stamp: 0, asked, keys, drawn: None }
    }
}

/// A point of the robot that is followed.
#[derive(Clone, Debug, PartialEq)]
struct Traced {
    body: usize,
    /// In the body's frame, m.
    offset: V3,
    /// The same for inverse kinematics.
    point: Pulled,
}

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

    /// Draws the path anew where it has changed.
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
        let (command, keys) = rollout.command();
        let goal = |frame: usize| {
            command.as_ref().is_some_and(|c| {
                (frame as u32) < c.frames() && (0..c.dim()).any(|j| c.sees(frame as u32, j))
            })
        };
        let keys: Vec<u32> = keys.iter().copied().filter(|k| (*k as usize) < asked.len()).collect();
        let keys = if keys.len() > HANDLES { Vec::new() } else { keys };
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
            scene.put(Message::create(DOTS, diamonds(&dots, DOT * radius, COMMAND)));
            for line in [DOTS, ASKED] {
                click(scene, line);
            }
            for key in &keys {
                let name = format!("{KEYS}/{key}");
                scene.put(Message::create(&name, diamonds(&[[0.0; 3]], DIAMOND * radius, KEY)));
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
        let near = NEAR * self.nodes.as_ref().map_or(0.5, |n| n.radius);
        let Some((frame, _)) = nearest.filter(|(_, d)| *d < near) else { return };
        let Some(pose) = facts.pose_at(&command, frame as u32) else { return };
        let names = facts.table.joints.iter().map(|j| j.name.clone());
        let values = Some(names.zip(pose.into_iter().map(robert_clip::round)).collect());
        self.hub.send(&Event::PathPoint { frame: frame as u32, values, tab });
    }

    /// A diamond is taken: its point is pulled at its key.
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

/// The frame of the key whose diamond this is.
pub(super) fn key_of(node: &str) -> Option<u32> {
    node.strip_prefix(KEYS)?.strip_prefix('/')?.parse().ok()
}

fn click(scene: &mut Retained, name: &str) {
    let (name, owner) = (name.to_owned(), String::new());
    let bindings = vec![Binding { button: "left", modifier: None }];
    scene.put(Message::SetSceneNodeClickBindingsMessage { name, bindings, owner });
}

/// Thin; every other frame is left out where nothing is commanded.
fn command_line(at: &[V3], goal: impl Fn(usize) -> bool) -> LineSegmentsProps {
    let shown = |f: &usize| goal(*f) || goal(*f + 1) || f.is_multiple_of(2);
    let frames = (0..at.len().saturating_sub(1)).filter(shown);
    segments(frames.map(|f| ([at[f], at[f + 1]], COMMAND)), 1.5)
}

/// Thick; from blue to red as links of the command are, grey where nothing was commanded.
fn reached_line(
    reached: &[V3],
    asked: &[V3],
    goal: impl Fn(usize) -> bool,
    radius: f64,
) -> LineSegmentsProps {
    let full = (2.0 * FULL_ERROR * radius).max(1e-3);
    let color = |f: usize| {
        let error = space::norm(space::sub(reached[f], asked[f])) / full;
        if goal(f) { render::error_color(error.min(1.0)) } else { FREE }
    };
    let frames = 0..reached.len().min(asked.len()).saturating_sub(1);
    segments(frames.map(|f| ([reached[f], reached[f + 1]], color(f + 1))), 3.5)
}

fn segments(of: impl Iterator<Item = ([V3; 2], Rgb)>, thickness: f64) -> LineSegmentsProps {
    let (mut points, mut colors) = (Vec::new(), Vec::new());
    for (ends, color) in of {
        points.extend(ends.iter().flatten().map(|v| *v as f32));
        colors.extend([color, color].iter().flatten());
    }
    LineSegmentsProps {
        points: Buffer::f32(&points),
        colors: Buffer::u8(&colors),
        thickness,
        ..LineSegmentsProps::default()
    }
}

/// An octahedron of this radius around each point, as one mesh.
fn diamonds(at: &[V3], radius: f64, color: Rgb) -> MeshProps {
    const CORNERS: [V3; 6] = [
        [1.0, 0.0, 0.0],
        [-1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, -1.0, 0.0],
        [0.0, 0.0, 1.0],
        [0.0, 0.0, -1.0],
    ];
    const FACES: [[u32; 3]; 8] =
        [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for (n, p) in at.iter().enumerate() {
        let corners = CORNERS.iter().map(|c| space::add(*p, space::scale(*c, radius)));
        vertices.extend(corners.flatten().map(|v| v as f32));
        faces.extend(FACES.iter().flatten().map(|i| i + 6 * n as u32));
    }
    MeshProps {
        vertices: Buffer::f32(&vertices),
        faces: Buffer::u32(&faces),
        color,
        flat_shading: true,
        cast_shadow: false,
        receive_shadow: false,
        ..MeshProps::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_have_gaps_where_nothing_is_commanded_and_error_has_a_colour() {
        let at: Vec<V3> = (0..11).map(|f| [f64::from(f), 0.0, 0.0]).collect();
        let whole = command_line(&at, |_| true);
        let open = command_line(&at, |f| f < 5);
        assert_eq!(whole.points.len_bytes(), 10 * 2 * 3 * 4);
        assert_eq!(open.points.len_bytes(), 7 * 2 * 3 * 4, "from 5, 7 and 9 on nothing is drawn");
        let mut off = at.clone();
        off[5][1] = 9.0;
        let line = reached_line(&off, &at, |f| f != 8, 1.0);
        let red = render::error_color(1.0);
        let blue = render::error_color(0.0);
        let colors: Vec<Rgb> = (1..11)
            .map(|f| {
                if f == 8 {
                    FREE
                } else if f == 5 {
                    red
                } else {
                    blue
                }
            })
            .collect();
        let twice: Vec<u8> = colors.iter().flat_map(|c| [*c, *c]).flatten().collect();
        assert_eq!(line.colors, Buffer::u8(&twice));
        assert_eq!(key_of("/path/key/30"), Some(30));
        assert_eq!(key_of("/path/keys"), None);
        let two = diamonds(&[[0.0; 3], [1.0, 0.0, 0.0]], 0.1, KEY);
        assert_eq!(two.faces.len_bytes(), 2 * 8 * 3 * 4);
    }
}
