//! BVH, the text format of motion capture.
//!
//! The format has offsets but no rest rotations: with all channels at zero, the offsets alone give
//! the rest pose. Here the rest pose is the one with all joints at zero. In it every joint frame is
//! parallel to the world, and the channels contain the rotation of each body since then. With G(t)
//! the world rotation of a body and D = G(t) G(0)^T, the channel of a joint is D_parent^T D. A
//! joint is at the anchor of its hinges, not at the body's frame, since only that point keeps its
//! place in the parent. Axes are converted to Y up and metres to centimetres, as is usual (the file
//! cannot state either).

use std::fmt::Write as _;
use std::sync::Arc;

use glam::{DMat3, DVec3};

use super::super::document::Take;
use super::super::error::Error;
use super::files::Export;
use super::skeleton::{Pose, Skeleton, reached};
use robert_base::units::CTRL_DT;
use robert_robot::Robot;

/// Centimetres of a metre.
const CM: f64 = 100.0;
/// The distance between two joint anchors of one body from which they are not a common joint, m.
const ONE_POINT: f64 = 1e-9;

/// The reached motion as BVH.
///
/// # Errors
/// [`Error::Unfit`] for robots with slides elsewhere than at a single root, or with hinges of
/// one body at several points; [`Error::Robot`], [`Error::Simulator`].
pub fn bvh(take: &Take, robot: &Arc<Robot>) -> Result<Export, Error> {
    let mut skeleton = Skeleton::of(robot)?;
    let tree = Tree::of(&mut skeleton)?;
    let frames = reached(take);
    let mut text = String::from("HIERARCHY\n");
    tree.hierarchy(&skeleton, &mut text);
    writeln!(text, "MOTION\nFrames: {}\nFrame Time: {CTRL_DT}", frames.len()).ok();
    let mut last = vec![[0.0; 3]; tree.order.len()];
    for frame in &frames {
        let row = tree.row(&skeleton, frame, &mut last);
        let cells: Vec<String> = row.iter().map(|v| decimal(*v)).collect();
        text.push_str(&cells.join(" "));
        text.push('\n');
    }
    let open = format!(
        "blender --python-expr \"import bpy; bpy.ops.import_anim.bvh(filepath='{}', global_scale=0.01)\"",
        Export::OUT
    );
    Ok(Export::single(text.into_bytes(), frames.len(), open)
        .says("Centimetres, degrees, Y up, 20 frames a second; channels Z Y X, R = Rz Ry Rx.")
        .says("All channels at zero are all joints at zero; torques, the command and the bodies' shapes are lost."))
}

/// What the format must know about a body of a robot.
#[derive(Clone, Debug)]
pub struct JointedBody<'a> {
    /// Its name.
    pub name: &'a str,
    /// Whether the world is its parent.
    pub is_root: bool,
    /// Of each of its joints whether it slides, and a point on its axis in the body's frame, m.
    pub joints: Vec<(bool, DVec3)>,
}

impl JointedBody<'_> {
    /// The point that its first hinge turns about.
    fn anchor(&self) -> Option<DVec3> {
        self.joints.iter().find(|(slides, _)| !slides).map(|(_, anchor)| *anchor)
    }
}

/// Why the format cannot have a robot with these bodies; `None` if it can.
pub fn bvh_unfit(bodies: &[JointedBody<'_>]) -> Option<String> {
    let roots = bodies.iter().filter(|b| b.is_root).count();
    bodies.iter().find_map(|b| {
        let hinges = || b.joints.iter().filter(|(slides, _)| !slides);
        let near = |at: DVec3| b.anchor().is_some_and(|a| (at - a).length() < ONE_POINT);
        if hinges().count() < b.joints.len() && !(b.is_root && roots == 1) {
            Some(format!("{} slides, and only a single root can", b.name))
        } else if !hinges().all(|(_, at)| near(*at)) {
            Some(format!("the hinges of {} stand at several points", b.name))
        } else {
            None
        }
    })
}

/// The joints of the file's hierarchy.
struct Tree {
    /// Bodies in the order of the channels; `None` is a root at the world's origin.
    order: Vec<Option<usize>>,
    /// World poses at zero.
    rest: Vec<Pose>,
    /// Anchor of each body's joint in the body's frame, m.
    anchors: Vec<DVec3>,
}

impl Tree {
    fn of(skeleton: &mut Skeleton) -> Result<Tree, Error> {
        let robot = Arc::clone(skeleton.robot());
        let rest = skeleton.poses(&vec![0.0; robot.state_dim()])?;
        let roots: Vec<usize> = skeleton.children(None).collect();
        let bodies: Vec<JointedBody> = skeleton
            .parents
            .iter()
            .enumerate()
            .map(|(body, parent)| {
                let joints = skeleton.joints_of(body).into_iter();
                JointedBody {
                    name: &skeleton.names[body],
                    is_root: parent.is_none(),
                    joints: joints.map(|j| (skeleton.slides(j), skeleton.anchor(j))).collect(),
                }
            })
            .collect();
        if let Some(problem) = bvh_unfit(&bodies) {
            return Err(unfit(problem));
        }
        let anchors = bodies.iter().map(|b| b.anchor().unwrap_or_default()).collect();
        let mut order = Vec::new();
        // A robot with one root needs no other; several roots become children of the world.
        let mut walk: Vec<Option<usize>> = match roots[..] {
            [root] => vec![Some(root)],
            _ => vec![None],
        };
        while let Some(node) = walk.pop() {
            order.push(node);
            let mut below: Vec<_> = skeleton.children(node).map(Some).collect();
            below.reverse();
            walk.extend(below);
        }
        Ok(Tree { order, rest, anchors })
    }

    /// Place of a joint in the world, m.
    fn anchor(&self, poses: &[Pose], node: Option<usize>) -> DVec3 {
        node.map_or(DVec3::ZERO, |body| poses[body].at(self.anchors[body]))
    }

    fn hierarchy(&self, skeleton: &Skeleton, text: &mut String) {
        let mut open: Vec<Option<usize>> = Vec::new();
        let close = |text: &mut String, open: &mut Vec<Option<usize>>, leaf: Option<usize>| {
            if skeleton.children(leaf).next().is_none() {
                let pad = "  ".repeat(open.len());
                let end = "End Site\n{pad}{\n{pad}  OFFSET 0 0 0\n{pad}}\n";
                write!(text, "{pad}{}", end.replace("{pad}", &pad)).ok();
            }
        };
        for (i, node) in self.order.iter().enumerate() {
            let parent = node.and_then(|body| skeleton.parents[body]);
            while i > 0 && open.last() != Some(&parent) {
                open.pop();
                writeln!(text, "{}}}", "  ".repeat(open.len())).ok();
            }
            let pad = "  ".repeat(open.len());
            let name = node.map_or("world".to_owned(), |body| word(&skeleton.names[body]));
            let offset = if i == 0 {
                DVec3::ZERO
            } else {
                self.anchor(&self.rest, *node) - self.anchor(&self.rest, parent)
            };
            let [x, y, z] = y_up(offset * CM).to_array().map(decimal);
            let (kind, channels) = if i == 0 {
                ("ROOT", "6 Xposition Yposition Zposition Zrotation Yrotation Xrotation")
            } else {
                ("JOINT", "3 Zrotation Yrotation Xrotation")
            };
            writeln!(
                text,
                "{pad}{kind} {name}\n{pad}{{\n{pad}  OFFSET {x} {y} {z}\n{pad}  CHANNELS {channels}"
            )
            .ok();
            open.push(*node);
            close(text, &mut open, *node);
        }
        while open.pop().is_some() {
            writeln!(text, "{}}}", "  ".repeat(open.len())).ok();
        }
    }

    /// Channels of a frame; `last` are the angles of the frame before, degrees.
    fn row(&self, skeleton: &Skeleton, poses: &[Pose], last: &mut [[f64; 3]]) -> Vec<f64> {
        let turned = |node: Option<usize>| {
            node.map_or(DMat3::IDENTITY, |b| {
                DMat3::from_quat(poses[b].rot) * DMat3::from_quat(self.rest[b].rot).transpose()
            })
        };
        let mut row = Vec::with_capacity(3 * self.order.len() + 3);
        for (i, (node, last)) in self.order.iter().zip(last).enumerate() {
            let parent = node.and_then(|body| skeleton.parents[body]);
            let relative = if i == 0 {
                row.extend(y_up(self.anchor(poses, *node) * CM).to_array());
                turned(*node)
            } else {
                turned(parent).transpose() * turned(*node)
            };
            // Conjugated: the same rotation in axes with Y up.
            let up = DMat3::from_cols(y_up(DVec3::X), y_up(DVec3::Y), y_up(DVec3::Z));
            let angles = zyx(up * relative * up.transpose());
            for (now, before) in angles.iter().zip(last.iter_mut()) {
                // The nearest of the equal angles: no jump of 360 degrees between frames.
                *before = now + 360.0 * ((*before - now) / 360.0).round();
                row.push(*before);
            }
        }
        row
    }
}

/// Z up to Y up.
fn y_up(v: DVec3) -> DVec3 {
    DVec3::new(v.x, v.z, -v.y)
}

/// Angles of R = Rz Ry Rx in degrees, computed from the matrix.
fn zyx(r: DMat3) -> [f64; 3] {
    let at = |row: usize, col: usize| r.col(col)[row];
    let y = (-at(2, 0)).clamp(-1.0, 1.0).asin();
    let (z, x) = if at(2, 0).abs() < 1.0 - 1e-12 {
        (at(1, 0).atan2(at(0, 0)), at(2, 1).atan2(at(2, 2)))
    } else {
        // At +-90 degrees about y, x and z rotate about one axis, and z gets the whole angle.
        ((-at(0, 1)).atan2(at(1, 1)), 0.0)
    };
    [z, y, x].map(f64::to_degrees)
}

/// Names of the format hold no spaces.
fn word(name: &str) -> String {
    name.chars().map(|c| if c.is_whitespace() { '_' } else { c }).collect()
}

/// A number with eight decimals: a tenth of a nanometre, or a hundredth of a millionth of a degree.
fn decimal(v: f64) -> String {
    let text = format!("{v:.8}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

fn unfit(problem: String) -> Error {
    Error::Unfit { format: "bvh", problem }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::super::super::sample;
    use super::*;

    /// A reader of the format that shares no code with the writer.
    struct Bvh {
        /// Name, parent, offset, number of channels.
        joints: Vec<(String, Option<usize>, DVec3, usize)>,
        frames: Vec<Vec<f64>>,
    }

    impl Bvh {
        fn parse(text: &str) -> Bvh {
            let (mut joints, mut frames, mut open) = (Vec::new(), Vec::new(), Vec::new());
            let mut words = text.split_whitespace();
            let mut end = false;
            while let Some(word) = words.next() {
                let mut number = || words.next().unwrap().parse::<f64>().unwrap();
                match word {
                    "OFFSET" => {
                        let at = DVec3::new(number(), number(), number());
                        if !end {
                            let last = joints.len() - 1;
                            let joint: &mut (String, Option<usize>, DVec3, usize) =
                                &mut joints[last];
                            joint.2 = at;
                        }
                    }
                    "CHANNELS" => {
                        let last = joints.len() - 1;
                        joints[last].3 = number() as usize;
                    }
                    "ROOT" | "JOINT" => {
                        let name = words.next().unwrap().to_owned();
                        let parent = open.last().copied().flatten();
                        joints.push((name, parent, DVec3::ZERO, 0));
                    }
                    "End" => end = true,
                    "{" => open.push((!end).then(|| joints.len() - 1)),
                    "}" => {
                        open.pop();
                        end = false;
                    }
                    "Frames:" => frames = vec![Vec::new(); number() as usize],
                    "Time:" => {
                        assert!((number() - 0.05).abs() < 1e-12);
                        let width: usize = joints.iter().map(|j| j.3).sum();
                        for frame in &mut frames {
                            frame.extend(
                                (0..width).map(|_| words.next().unwrap().parse::<f64>().unwrap()),
                            );
                        }
                        assert!(words.next().is_none(), "more numbers than frames");
                    }
                    _ => {}
                }
            }
            Bvh { joints, frames }
        }

        /// World places of the joints, m, Z up.
        fn places(&self, frame: usize) -> Vec<(String, DVec3)> {
            let mut row = self.frames[frame].iter().copied();
            let mut done: Vec<(DVec3, DQuat)> = Vec::new();
            for (_, parent, offset, channels) in &self.joints {
                let mut take = || row.next().unwrap();
                let moved =
                    if *channels == 6 { DVec3::new(take(), take(), take()) } else { DVec3::ZERO };
                let turn =
                    |axis: DVec3, degrees: f64| DQuat::from_axis_angle(axis, degrees.to_radians());
                let own = turn(DVec3::Z, take()) * turn(DVec3::Y, take()) * turn(DVec3::X, take());
                let (at, rot) = parent.map_or((DVec3::ZERO, DQuat::IDENTITY), |p| done[p]);
                done.push((at + rot * (*offset + moved), rot * own));
            }
            let names = self.joints.iter().map(|j| j.0.clone());
            names.zip(done.iter().map(|d| DVec3::new(d.0.x, -d.0.z, d.0.y) / 100.0)).collect()
        }
    }

    #[test]
    fn bodies_are_where_the_take_has_them() {
        for id in ["pointmass", "ur5e", "shadow_hand"] {
            let (robot, take) = sample::take(id, 40, 40);
            let export = bvh(&take, &robot).unwrap();
            let file = Bvh::parse(std::str::from_utf8(&export.files[0].bytes).unwrap());
            let skeleton = Skeleton::of(&robot).unwrap();
            for frame in [0, 13, 20, 39] {
                let found = file.places(frame);
                for (body, pose) in reached(&take)[frame].iter().enumerate() {
                    let joint = skeleton.joints_of(body);
                    let hinge = joint.iter().find(|j| !skeleton.slides(**j));
                    let want = pose.at(hinge.map_or(DVec3::ZERO, |j| skeleton.anchor(*j)));
                    let name = &take.robot.bodies[body];
                    let (_, at) = found.iter().find(|(n, _)| n == name).unwrap();
                    assert!((*at - want).length() < 1e-5, "{id} {name} {frame}: {at} {want}");
                }
            }
        }
    }

    #[test]
    fn angles_come_back_also_where_two_axes_meet() {
        for (z, y, x) in
            [(10.0, 20.0, 30.0), (-170.0, 89.0, 5.0), (40.0, 90.0, 0.0), (7.0, -90.0, 0.0)]
        {
            let want = DMat3::from_rotation_z(f64::to_radians(z))
                * DMat3::from_rotation_y(f64::to_radians(y))
                * DMat3::from_rotation_x(f64::to_radians(x));
            let [z, y, x] = zyx(want).map(f64::to_radians);
            let got =
                DMat3::from_rotation_z(z) * DMat3::from_rotation_y(y) * DMat3::from_rotation_x(x);
            assert!(got.abs_diff_eq(want, 1e-7), "{got} {want}");
        }
    }
}
