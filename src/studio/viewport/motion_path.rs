//! The path of the selected link or end effector, as nodes of the scene.
//!
//! The command is a thin line with a diamond at each key and a dot at each frame. The reached
//! motion is a thick line, coloured by its distance from the command.

use std::time::{Duration, Instant};

use glam::Vec3;

use super::drag::Pulled;
use super::retained::Retained;
use super::scene_nodes::FULL_ERROR;
use super::space::{self, V3};
use robert_render as render;
use robert_take::viser::{Binding, Buffer, LineSegmentsProps, MeshProps, Message, Rgb};

/// The node that holds all of it.
pub(super) const PATH: &str = "/path";
/// Diamonds are `/path/key/FRAME`.
pub(super) const KEYS: &str = "/path/key";
pub(super) const DOTS: &str = "/path/dots";
pub(super) const ASKED: &str = "/path/asked";
pub(super) const REACHED: &str = "/path/reached";

/// The part of all sizes that comes from the path: they are fractions of the robot's radius, or of
/// this share of the path's extent if that is larger.
pub(super) const SHARE: f64 = 0.4;
pub(super) const DIAMOND: f64 = 0.032;
pub(super) const DOT: f64 = 0.009;
/// With more keys than this there are no handles, because they would hide the line.
const HANDLES: usize = 240;
/// The least time between two drawings while frames arrive.
pub(super) const PACE: Duration = Duration::from_millis(80);
/// A click within this distance counts as on the line; a fraction, as the sizes are.
pub(super) const NEAR: f64 = 0.06;

pub(super) const COMMAND: Rgb = [120, 170, 255];
pub(super) const KEY: Rgb = [255, 178, 62];
/// Reached where nothing was commanded.
const FREE: Rgb = [150, 156, 168];

/// The path that is shown.
#[derive(Debug)]
pub(super) struct MotionPath {
    /// The page wants to see it.
    pub(super) wanted: bool,
    pub(super) of: Option<Traced>,
    pub(super) stamp: u64,
    /// The commanded position of the point, by frame, m.
    pub(super) asked: Vec<V3>,
    /// Frames that have a diamond.
    pub(super) keys: Vec<u32>,
    pub(super) drawn: Option<Instant>,
    /// The length, m, that all sizes are fractions of.
    pub(super) size: f64,
}

impl Default for MotionPath {
    fn default() -> Self {
        let (asked, keys) = (Vec::new(), Vec::new());
        MotionPath { wanted: true, of: None, stamp: 0, asked, keys, drawn: None, size: 0.0 }
    }
}

/// A point of the robot that is followed.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Traced {
    pub(super) body: usize,
    /// In the body's frame, m.
    pub(super) offset: V3,
    /// The point in the form that inverse kinematics needs.
    pub(super) point: Pulled,
}

/// The keys that have a diamond: those among the first `known` frames, whose place has arrived, and
/// those that have one already. A new rollout knows its first frames only; without the second rule
/// it would take away the diamond that is being dragged, and the drag would end.
pub(super) fn handles(keys: &[u32], known: usize, shown: &[u32]) -> Vec<u32> {
    let has_place = |k: &u32| (*k as usize) < known || shown.contains(k);
    let keys: Vec<u32> = keys.iter().copied().filter(has_place).collect();
    if keys.len() > HANDLES || dense(&keys) { Vec::new() } else { keys }
}

/// Whether there is a key at nearly every frame, as in a recording. Diamonds would then hide the
/// line, and the ghost of the next key would hide the robot. The page uses the same rule.
pub(super) fn dense(keys: &[u32]) -> bool {
    let close = keys.windows(2).filter(|w| w[1] - w[0] <= 2).count();
    keys.len() >= 20 && close * 5 > (keys.len() - 1) * 4
}

/// The frame of the key whose diamond this is.
pub(super) fn key_of(node: &str) -> Option<u32> {
    node.strip_prefix(KEYS)?.strip_prefix('/')?.parse().ok()
}

pub(super) fn click(scene: &mut Retained, name: &str) {
    let (name, owner) = (name.to_owned(), String::new());
    let bindings = vec![Binding { button: "left", modifier: None }];
    scene.put(Message::SetSceneNodeClickBindingsMessage { name, bindings, owner });
}

/// Diagonal of the box around points, m.
pub(super) fn extent(at: &[V3]) -> f64 {
    let points = at.iter().map(|p| Vec3::from_array(p.map(|v| v as f32)));
    let low = points.clone().fold(Vec3::INFINITY, Vec3::min);
    let high = points.fold(Vec3::NEG_INFINITY, Vec3::max);
    if at.is_empty() { 0.0 } else { f64::from(low.distance(high)) }
}

/// The thin line of the command. Frames without a goal are drawn as every other segment, so the
/// line is dashed there.
pub(super) fn command_line(at: &[V3], goal: impl Fn(usize) -> bool) -> LineSegmentsProps {
    let shown = |f: &usize| goal(*f) || goal(*f + 1) || f.is_multiple_of(2);
    let frames = (0..at.len().saturating_sub(1)).filter(shown);
    segments(frames.map(|f| ([at[f], at[f + 1]], COMMAND)), 1.5)
}

/// The thick line of the reached motion, from blue to red with the error, as the links of the
/// command are; grey where nothing was commanded.
pub(super) fn reached_line(
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
pub(super) fn diamonds(at: &[V3], radius: f64, color: Rgb) -> MeshProps {
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
    fn a_new_rollout_leaves_the_diamonds_of_its_keys() {
        assert_eq!(handles(&[0, 30, 60], 45, &[]), [0, 30]);
        assert_eq!(handles(&[0, 30, 60], 3, &[0, 30]), [0, 30]);
        assert_eq!(handles(&[0, 60], 3, &[0, 30, 60]), [0, 60], "a deleted key has none");
        let dense: Vec<u32> = (0..50).collect();
        assert!(handles(&dense, 50, &[]).is_empty());
    }

    #[test]
    fn a_recording_is_dense_and_typed_keys_are_not() {
        let every = |step: usize, n: u32| (0..n).step_by(step).collect::<Vec<u32>>();
        assert!(dense(&every(1, 120)) && dense(&every(2, 120)));
        assert!(!dense(&every(3, 300)) && !dense(&every(1, 10)) && !dense(&[]));
    }

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
