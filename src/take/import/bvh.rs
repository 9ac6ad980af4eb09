//! BVH files whose joints have the names of the robot's bodies.
//!
//! Files have the rotation of each joint since the rest pose. It is compared with the hinges of the
//! body of the same name: the angles about them are the values of its joints. The robot cannot turn
//! about other axes, so such rotation is reported. The rest pose must be the robot's own (all
//! joints at zero); a file of another skeleton is refused.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DQuat, DVec3};

use super::super::error::Error;
use super::super::export::{Pose, Skeleton};
use super::samples::{Samples, at_line, foreign, rate};
use super::turn::Hinges;
use robert_base::limits;
use robert_robot::Robot;

/// Nesting of joints.
const DEPTH: usize = 128;
/// Allowed difference between the file's offsets and the robot's, as a share of the robot's size.
const ALIKE: f64 = 0.01;
/// Rotations about other axes than the hinge's up to this are rounding, rad.
const ROUNDING: f64 = 1e-3;

/// One joint of a file.
#[derive(Debug)]
struct Joint {
    name: String,
    parent: Option<usize>,
    offset: DVec3,
    channels: Vec<Channel>,
}

#[derive(Clone, Copy, Debug)]
enum Channel {
    Place(DVec3),
    Turn(DVec3),
}

/// Reads a file for a robot.
///
/// # Errors
/// [`Error::Foreign`] with the line, or with the joint that does not fit.
pub fn from_bvh(text: &str, robot: &Arc<Robot>) -> Result<Samples, Error> {
    let (joints, fps, frames) = parse(text)?;
    let mut skeleton = Skeleton::of(robot)?;
    let rest = skeleton.poses(&vec![0.0; robot.state_dim()])?;
    let by_name: BTreeMap<&str, usize> =
        joints.iter().enumerate().map(|(i, j)| (j.name.as_str(), i)).collect();
    let moved: Vec<Moved> = (0..skeleton.names.len())
        .filter(|body| !skeleton.joints_of(*body).is_empty())
        .map(|body| Moved::of(&skeleton, &rest, &by_name, body))
        .collect::<Result<_, _>>()?;
    let scale = same_rest(&skeleton, &rest, &joints, &by_name)?;
    let mut rows = Vec::with_capacity(frames.len());
    let mut last = vec![0.0; robot.state_dim()];
    for (f, frame) in frames.iter().enumerate() {
        let file = played(&joints, frame);
        for body in &moved {
            let (place, turn) = file[body.joint];
            for (j, axis) in &body.slides {
                last[*j] = (z_up(place) * scale - body.anchor).dot(*axis);
            }
            let up = z_up(DVec3::new(turn.x, turn.y, turn.z));
            body.turn(DQuat::from_xyzw(up.x, up.y, up.z, turn.w), &mut last).map_err(|off| {
                foreign(format!(
                    "frame {f}: {} turns about other axes than its {} by {off:.3} rad",
                    joints[body.joint].name,
                    if body.hinges.axes.len() > 1 { "hinges" } else { "hinge" }
                ))
            })?;
        }
        rows.push(last.clone());
    }
    let names = robot.joints().iter().map(|j| j.name.clone()).collect();
    Ok(Samples::steady(names, fps, rows))
}

/// A body that joints move, and the joint of the file that has its motion.
struct Moved {
    joint: usize,
    /// The point that it turns about, at rest, m.
    anchor: DVec3,
    /// Places in the state, and axes in the world at rest.
    slides: Vec<(usize, DVec3)>,
    hinges: Hinges,
    /// Places of the hinges in the state, and their values in the model's own pose, rad.
    turned: Vec<(usize, f64)>,
    /// The rotation of the body at rest, and what its hinges have to do with it.
    rest: DQuat,
    by_rest: DQuat,
}

impl Moved {
    fn of(
        skeleton: &Skeleton,
        rest: &[Pose],
        by_name: &BTreeMap<&str, usize>,
        body: usize,
    ) -> Result<Moved, Error> {
        let (robot, name) = (skeleton.robot(), &skeleton.names[body]);
        let word = name.replace(char::is_whitespace, "_");
        let Some(&joint) = by_name.get(word.as_str()) else {
            let has: Vec<&str> = by_name.keys().take(6).copied().collect();
            return Err(foreign(format!("no joint {word}; the file has {}", has.join(", "))));
        };
        let (slides, turned): (Vec<usize>, Vec<usize>) =
            skeleton.joints_of(body).into_iter().partition(|j| skeleton.slides(*j));
        if slides.iter().any(|s| turned.iter().any(|h| qpos(robot, *h) < qpos(robot, *s))) {
            return Err(foreign(format!(
                "{name} slides along axes that it turns, which is not read"
            )));
        }
        let axis = |j: &usize| {
            let id = robot.joints()[*j].id;
            DVec3::from_slice(&robot.model().jnt_axis()[3 * id..3 * id + 3]).normalize()
        };
        let turned: Vec<(usize, f64)> =
            turned.into_iter().map(|j| (j, robot.model().qpos0()[qpos(robot, j)])).collect();
        let range = |(j, own): &(usize, f64)| robot.joints()[*j].range.map(|limit| limit - own);
        let hinges = Hinges {
            axes: turned.iter().map(|(j, _)| axis(j)).collect(),
            ranges: turned.iter().map(range).collect(),
        };
        if !hinges.are_told_apart() {
            let count = turned.len();
            return Err(foreign(format!(
                "{name} turns about {count} hinges whose angles its rotation does not tell"
            )));
        }
        let by_rest = turned
            .iter()
            .zip(&hinges.axes)
            .fold(DQuat::IDENTITY, |q, ((_, own), axis)| q * DQuat::from_axis_angle(*axis, -own));
        let at = turned.first().map_or(DVec3::ZERO, |(j, _)| skeleton.anchor(*j));
        Ok(Moved {
            joint,
            anchor: rest[body].at(at),
            slides: slides.iter().map(|j| (*j, rest[body].rot * axis(j))).collect(),
            hinges,
            turned,
            rest: rest[body].rot,
            by_rest,
        })
    }

    /// Puts the angles of a rotation since rest, in the world, into a state; the rotation that they do
    /// not explain, rad, if it is more than rounding.
    fn turn(&self, turn: DQuat, state: &mut [f64]) -> Result<(), f64> {
        let own = self.by_rest * self.rest.inverse() * turn * self.rest;
        let last: Vec<f64> = self.turned.iter().map(|(j, own)| state[*j] - own).collect();
        let (angles, left) = self.hinges.angles(own, &last);
        if left > ROUNDING {
            return Err(left);
        }
        self.turned.iter().zip(angles).for_each(|((j, own), angle)| state[*j] = angle + own);
        Ok(())
    }
}

fn qpos(robot: &Robot, joint: usize) -> usize {
    robot.joints()[joint].qposadr
}

/// Metres per unit of the file; an error if its rest pose is not the robot's.
fn same_rest(
    skeleton: &Skeleton,
    rest: &[Pose],
    joints: &[Joint],
    by_name: &BTreeMap<&str, usize>,
) -> Result<f64, Error> {
    let anchor = |body: usize| {
        let hinge = skeleton.joints_of(body).into_iter().find(|j| !skeleton.slides(*j));
        rest[body].at(hinge.map_or(DVec3::ZERO, |j| skeleton.anchor(j)))
    };
    let mut pairs = Vec::new();
    for (body, parent) in skeleton.parents.iter().enumerate() {
        let word = |b: usize| skeleton.names[b].replace(char::is_whitespace, "_");
        let Some(parent) = *parent else { continue };
        let (Some(&joint), Some(&above)) =
            (by_name.get(word(body).as_str()), by_name.get(word(parent).as_str()))
        else {
            continue;
        };
        if joints[joint].parent == Some(above) {
            pairs.push((body, z_up(joints[joint].offset), anchor(body) - anchor(parent)));
        }
    }
    let ours: f64 = pairs.iter().map(|(_, _, d)| d.length()).sum();
    let theirs: f64 = pairs.iter().map(|(_, o, _)| o.length()).sum();
    if theirs <= 0.0 || ours <= 0.0 {
        // A single body has no size to compare, so centimetres are assumed, as is usual.
        return Ok(0.01);
    }
    let scale = ours / theirs;
    for (body, offset, own) in pairs {
        let off = (offset * scale - own).length();
        if off > ALIKE * ours {
            return Err(foreign(format!(
                "the rest pose is not the robot's: {} stands {off:.3} m elsewhere",
                skeleton.names[body]
            )));
        }
    }
    Ok(scale)
}

/// Y up to Z up.
fn z_up(v: DVec3) -> DVec3 {
    DVec3::new(v.x, -v.z, v.y)
}

/// Position and rotation of every joint at a frame, each relative to its parent.
fn played(joints: &[Joint], frame: &[f64]) -> Vec<(DVec3, DQuat)> {
    let mut values = frame.iter();
    let mut out = Vec::with_capacity(joints.len());
    for joint in joints {
        let (mut place, mut turn) = (DVec3::ZERO, DQuat::IDENTITY);
        for (channel, value) in joint.channels.iter().zip(values.by_ref()) {
            match channel {
                Channel::Place(axis) => place += *axis * *value,
                Channel::Turn(axis) => turn *= DQuat::from_axis_angle(*axis, value.to_radians()),
            }
        }
        out.push((place, turn));
    }
    out
}

type File = (Vec<Joint>, f64, Vec<Vec<f64>>);

/// Words with their lines.
struct Words<'a> {
    rest: std::iter::Peekable<Box<dyn Iterator<Item = (usize, &'a str)> + 'a>>,
    line: usize,
}

impl<'a> Words<'a> {
    fn of(text: &'a str) -> Words<'a> {
        let words = text.lines().enumerate();
        let words = words.flat_map(|(i, l)| l.split_whitespace().map(move |w| (i + 1, w)));
        let words: Box<dyn Iterator<Item = (usize, &'a str)> + 'a> = Box::new(words);
        Words { rest: words.peekable(), line: 1 }
    }

    fn next(&mut self) -> Result<&'a str, Error> {
        let (line, word) =
            self.rest.next().ok_or_else(|| at_line(self.line, "the file ends here"))?;
        self.line = line;
        Ok(word)
    }

    fn wants(&mut self, word: &str) -> Result<(), Error> {
        let found = self.next()?;
        if found.eq_ignore_ascii_case(word) {
            return Ok(());
        }
        Err(at_line(self.line, format!("{word} is wanted here, not {found:?}")))
    }

    fn number(&mut self) -> Result<f64, Error> {
        let word = self.next()?;
        let value = word.parse::<f64>().ok().filter(|v| v.is_finite());
        value.ok_or_else(|| at_line(self.line, format!("{word:?} is no number")))
    }
}

fn parse(text: &str) -> Result<File, Error> {
    let mut words = Words::of(text.trim_start_matches('\u{feff}'));
    words.wants("HIERARCHY")?;
    words.wants("ROOT")?;
    let joints = hierarchy(&mut words)?;
    words.wants("MOTION")?;
    words.wants("Frames:")?;
    let count = words.number()?;
    if !(1.0..=f64::from(limits::CLIP_FRAMES)).contains(&count) || count.fract() != 0.0 {
        return Err(at_line(words.line, format!("{count} frames")));
    }
    words.wants("Frame")?;
    words.wants("Time:")?;
    let fps = rate(1.0 / words.number()?)?;
    let width: usize = joints.iter().map(|j| j.channels.len()).sum();
    if count as usize * width > limits::CLIP_VALUES * 4 {
        return Err(at_line(words.line, format!("{count} frames of {width} channels")));
    }
    let mut frames = Vec::new();
    for _ in 0..count as usize {
        frames.push((0..width).map(|_| words.number()).collect::<Result<Vec<f64>, _>>()?);
    }
    Ok((joints, fps, frames))
}

/// Joints from the root's name to the brace that closes it.
fn hierarchy(words: &mut Words<'_>) -> Result<Vec<Joint>, Error> {
    let mut joints: Vec<Joint> = Vec::new();
    // Open joints; `None` is an end site.
    let mut open: Vec<Option<usize>> = Vec::new();
    let name = words.next()?;
    let add = |joints: &mut Vec<Joint>, name: &str, parent| {
        let (offset, channels) = (DVec3::ZERO, Vec::new());
        joints.push(Joint { name: name.to_owned(), parent, offset, channels });
        joints.len() - 1
    };
    words.wants("{")?;
    open.push(Some(add(&mut joints, name, None)));
    while let Some(top) = open.last().copied() {
        let word = words.next()?;
        let line = words.line;
        match (word.to_ascii_uppercase().as_str(), top) {
            ("OFFSET", _) => {
                let offset = DVec3::new(words.number()?, words.number()?, words.number()?);
                if let Some(joint) = top {
                    joints[joint].offset = offset;
                }
            }
            ("CHANNELS", Some(joint)) => {
                let count = words.number()?;
                if !(0.0..=6.0).contains(&count) {
                    return Err(at_line(line, format!("{count} channels")));
                }
                for _ in 0..count as usize {
                    let word = words.next()?;
                    let channel = channel(word)
                        .ok_or_else(|| at_line(words.line, format!("{word:?} is no channel")))?;
                    joints[joint].channels.push(channel);
                }
            }
            ("JOINT", Some(joint)) => {
                let name = words.next()?;
                words.wants("{")?;
                if joints.len() >= limits::BODIES || open.len() >= DEPTH {
                    return Err(at_line(line, "too many joints"));
                }
                open.push(Some(add(&mut joints, name, Some(joint))));
            }
            ("END", Some(_)) => {
                words.wants("Site")?;
                words.wants("{")?;
                open.push(None);
            }
            ("}", _) => drop(open.pop()),
            _ => return Err(at_line(line, format!("{word:?} has no place here"))),
        }
    }
    Ok(joints)
}

fn channel(word: &str) -> Option<Channel> {
    let axis = match word.chars().next()?.to_ascii_uppercase() {
        'X' => DVec3::X,
        'Y' => DVec3::Y,
        'Z' => DVec3::Z,
        _ => return None,
    };
    match word.get(1..)?.to_ascii_lowercase().as_str() {
        "position" => Some(Channel::Place(axis)),
        "rotation" => Some(Channel::Turn(axis)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::export::bvh;
    use super::super::super::sample;
    use super::*;

    #[test]
    fn our_own_files_come_back() {
        for id in ["pointmass", "ur5e", "shadow_hand"] {
            let (robot, take) = sample::take(id, 40, 40);
            let text =
                String::from_utf8(bvh(&take, &robot).unwrap().files.remove(0).bytes).unwrap();
            let samples = from_bvh(&text, &robot).unwrap();
            for (f, row) in samples.rows.iter().enumerate() {
                for (j, (a, b)) in row.iter().zip(take.state(f)).enumerate() {
                    assert!((a - b).abs() < 1e-6, "{id} frame {f} joint {j}: {a} {b}");
                }
            }
        }
    }

    #[test]
    fn faults_have_a_line_or_a_joint() {
        let (robot, take) = sample::take("ur5e", 10, 10);
        let text = String::from_utf8(bvh(&take, &robot).unwrap().files.remove(0).bytes).unwrap();
        let fault = |text: &str| from_bvh(text, &robot).unwrap_err().to_string();
        assert!(fault("").contains("line 1: the file ends here"));
        assert!(
            fault(&text.replace("JOINT shoulder_link", "JOINT other"))
                .contains("no joint shoulder_link")
        );
        assert!(fault(&text.replace("CHANNELS 3 Z", "CHANNELS 3 W")).contains("is no channel"));
        let line = text.lines().position(|l| l.starts_with("Frame Time")).unwrap() + 2;
        let cut: Vec<&str> = text.lines().take(line - 1).collect();
        assert!(fault(&cut.join("\n")).contains("the file ends here"));
        let stretched = text.replacen("OFFSET 0 ", "OFFSET 31 ", 3);
        assert!(
            fault(&stretched).contains("rest pose is not the robot's"),
            "{}",
            fault(&stretched)
        );
        for at in 0..text.len() {
            from_bvh(&text[..at], &robot).ok();
        }
    }
}
