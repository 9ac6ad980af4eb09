//! Trial clips for any robot, to evaluate policies of robots without their own tasks.
//!
//! Five clips are generated from the robot's limits, speeds and a seed: a dense sway of all joints,
//! the same with every tenth frame visible, poses with open gaps between, the same with one visible
//! frame per hold, and one joint after another. Poses are settled in simulation first and used only
//! if the motors can hold them. The same is checked for moments of the sway, because fingers that
//! move at different speeds may collide on the way even if both ends are free. Gaps are long enough
//! for the speeds of the profile, and motions are short enough for the longest gap. Joints that no
//! motor moves have no goals. Training chooses by the clips of seeds 0, 4 and 5,
//! and `robert new` by those of 2 and 3; others are for reports.

use std::f64::consts::TAU;

use super::author::{Authored, blank, dense, middles, sequence, thinned};
use robert_base::rng::{Rng, Stream};
use robert_base::units::CTRL_DT;
use robert_clip::{Clip, Goal};
use robert_robot::{Coupling, Error, Robot, StateJoint};

/// Share of the distance to the further stop that motions use.
const REACH: f64 = 0.45;
/// Range of an unbounded joint: rad, m.
const UNBOUNDED: [f64; 2] = [1.5, 0.5];
/// Share of the greatest sustained speed, and of the acceleration, for which motions are planned.
const PACE: f64 = 0.45;
/// Longest gap, frames.
const LONGEST_GAP: u32 = 60;
/// Poses to try before the best one is used although the motors do not reach it.
const TRIES: u64 = 12;
/// Frames that a pose is held for.
const HOLD: u32 = 16;
/// Poses in the gapped clips.
const POSES: usize = 4;
/// Moments of a sway that are settled.
const MOMENTS: usize = 12;
/// The most joints that move in turn.
const TURNS: usize = 6;

/// The five trial clips of a robot.
///
/// # Errors
/// Poses are settled in simulation, which may fail.
pub fn trial(robot: &Robot, seed: u64) -> Result<Vec<Authored>, Error> {
    let home = robot.home();
    let mut poses: Vec<Vec<f64>> = Vec::new();
    for index in 0..POSES as u64 {
        let pose = held(robot, seed, index, poses.last().unwrap_or(&home))?;
        poses.push(pose);
    }
    let driven = robot.driven()?;
    let sway = clear_sway(robot, &poses, &driven)?;
    let reach = through(robot, "reach", "Poses with open gaps between.", &home, &poses);
    let thin = thinned(&sway, 10, "sway, sparse", "As sway, with every tenth frame visible.");
    let middle = middles(&reach, "reach, high mask", "As reach, with one frame of each hold.");
    // One joint after another leaves home for its part of the second pose and stays there.
    let mut steps: Vec<Vec<f64>> = Vec::new();
    let mut at = home.clone();
    let stride = home.len().div_ceil(TURNS).max(1);
    for first in (0..home.len()).step_by(stride) {
        let some = first..(first + stride).min(home.len());
        at[some.clone()].copy_from_slice(&poses[1][some]);
        let settled = robot.settle_from(steps.last().unwrap_or(&home), &at)?;
        // A part that the motors cannot move alone stays where it is.
        if settled.within {
            steps.push(settled.reached);
        } else {
            at.clone_from(steps.last().unwrap_or(&home));
        }
    }
    if steps.is_empty() {
        steps.push(poses[0].clone());
    }
    let turns = through(robot, "turns", "One joint after another.", &home, &steps);
    let made = |name, mut clip: Clip| {
        leave_free(&mut clip, &driven, &home);
        Authored { name, suite: "trial", clip }
    };
    Ok(vec![
        made("sway", sway),
        made("sway_sparse", thin),
        made("reach", reach),
        made("reach_high_mask", middle),
        made("turns", turns),
    ])
}

/// A pose that the motors can hold and can reach from `from`, as it is after settling. Both are
/// checked, because a motor that is too weak to lift a link past the horizontal may still hold it
/// upright.
fn held(robot: &Robot, seed: u64, index: u64, from: &[f64]) -> Result<Vec<f64>, Error> {
    let mut best: Option<(f64, Vec<f64>)> = None;
    for attempt in 0..TRIES {
        let mut rng = Rng::new(seed, Stream::Trial, index * TRIES + attempt);
        // Later tries stay nearer to home.
        let shrink = 1.0 - 0.06 * attempt as f64;
        let target: Vec<f64> = robot
            .joints()
            .iter()
            .zip(robot.home())
            .map(|(j, home)| {
                let way = shrink * room(j, home) * rng.range(0.3, 1.0);
                // Mostly toward the wider side; both directions if neither is narrow.
                let back = j.unbounded && rng.uniform() < 0.5;
                home + if back { -way } else { way }
            })
            .collect();
        // Trial clips give no more than the usual time.
        let settled = robot.settle_from(&robot.home(), &target)?;
        if settled.within && robot.settle_from(from, &settled.reached)?.within {
            return Ok(settled.reached);
        }
        if best.as_ref().is_none_or(|(worst, _)| settled.worst < *worst) {
            best = Some((settled.worst, settled.reached));
        }
    }
    Ok(best.map_or_else(|| robot.home(), |(_, pose)| pose))
}

/// Takes the goals of joints that nothing drives out of a clip; they start at home.
fn leave_free(clip: &mut Clip, driven: &[bool], home: &[f64]) {
    if driven.iter().all(|d| *d) {
        return;
    }
    let free = |row: &mut Vec<Option<f64>>| {
        row.iter_mut().zip(driven).filter(|(_, d)| !**d).for_each(|(q, _)| *q = None);
    };
    clip.start = Some(robert_clip::Start::Q(home.to_vec()));
    clip.poses.values_mut().for_each(free);
    for key in &mut clip.keys {
        if let Goal::Q(row) = &mut key.goal {
            free(row);
        }
    }
}

/// The distance that a joint moves from home, positive or negative toward the wider side of its
/// range. It is at most what the joint can cover in the longest gap.
fn room(j: &StateJoint, home: f64) -> f64 {
    let secs = f64::from(LONGEST_GAP) * CTRL_DT;
    let most = (PACE * j.speed_limit * secs).min(PACE * j.acceleration_limit * secs * secs / 4.0);
    free_room(j, home).clamp(-most, most)
}

/// The distance of a joint, however fast it is.
fn free_room(j: &StateJoint, home: f64) -> f64 {
    if j.unbounded {
        let slides = j.unit == robert_base::units::Unit::M;
        return UNBOUNDED[usize::from(slides)];
    }
    let (down, up) = (home - j.range[0], j.range[1] - home);
    REACH * if up >= down { up } else { -down }
}

/// The first sway all of whose moments the robot can hold. For each pose, a sway with every second
/// joint at half the speed is tried, then one with all joints at the same speed. If there is none,
/// the sway that comes nearest.
fn clear_sway(robot: &Robot, poses: &[Vec<f64>], driven: &[bool]) -> Result<Clip, Error> {
    let tolerance = robot.profile().settle.tolerance;
    let mut best: Option<(f64, Clip)> = None;
    for (slower, far) in [0.5, 1.0].iter().flat_map(|s| poses.iter().map(move |far| (*s, far))) {
        let clip = sway(robot, far, slower);
        let mut worst = 0.0_f64;
        for moment in moments(&clip) {
            let residual = robot.settle_from(&robot.home(), &moment)?.residual;
            let asked = residual.iter().zip(driven).filter(|(_, d)| **d);
            worst = asked.fold(worst, |worst, (r, _)| worst.max(*r));
        }
        if worst <= tolerance {
            return Ok(clip);
        }
        if best.as_ref().is_none_or(|(least, _)| worst < *least) {
            best = Some((worst, clip));
        }
    }
    Ok(best.map_or_else(|| sway(robot, &robot.home(), 1.0), |(_, clip)| clip))
}

/// Poses of a dense clip, evenly spread.
fn moments(clip: &Clip) -> Vec<Vec<f64>> {
    let rows: Vec<Vec<f64>> = clip
        .keys
        .iter()
        .filter_map(|k| match &k.goal {
            Goal::Q(row) => row.iter().copied().collect(),
            Goal::Pose(_) | Goal::Open => None,
        })
        .collect();
    let step = (rows.len() / MOMENTS).max(1);
    rows.into_iter().skip(step / 2).step_by(step).collect()
}

/// Every joint moves from home toward `far` and back, every second joint at `slower` times the
/// speed.
fn sway(robot: &Robot, far: &[f64], slower: f64) -> Clip {
    let home = robot.home();
    let joints = robot.joints().iter().zip(&home).zip(far);
    // A raised cosine of period T has the greatest speed pi d / T and acceleration 2 pi^2 d / T^2.
    let period = joints
        .map(|((j, h), f)| {
            let d = (f - h).abs();
            let rise = TAU * (d / (2.0 * PACE * j.acceleration_limit.max(1e-3))).sqrt();
            rise.max(d * TAU / 2.0 / (PACE * j.speed_limit.max(1e-3)))
        })
        .fold(2.0, f64::max);
    let turns = (8.0 / period).round().max(1.0);
    let frames = (turns * period / CTRL_DT).round() as u32;
    // A joint that follows another goes at the pace of that one.
    let paces: Vec<usize> = (0..home.len()).map(|j| leader(robot, j)).collect();
    dense(robot, "sway", "All joints leave home and return.", frames, |t| {
        let wave = |t: f64| (1.0 - (TAU * t / period).cos()) / 2.0;
        home.iter()
            .zip(far)
            .enumerate()
            .map(|(j, (h, f))| {
                h + (f - h) * wave(if paces[j].is_multiple_of(2) { t } else { t * slower })
            })
            .collect()
    })
}

/// The joint that this one follows in the end; itself if it follows none.
fn leader(robot: &Robot, mut joint: usize) -> usize {
    let joints = robot.joints();
    let next = |at: usize| {
        robot.profile().couplings.iter().find_map(|c| match c {
            Coupling::Mimic { follower, leader, .. } if *follower == joints[at].name => {
                joints.iter().position(|j| j.name == *leader)
            }
            _ => None,
        })
    };
    // A chain of followers is at most as long as the robot.
    for _ in 0..joints.len() {
        let Some(at) = next(joint) else { break };
        joint = at;
    }
    joint
}

/// From home through poses, each reached over an open gap and held.
fn through(robot: &Robot, title: &str, notes: &str, home: &[f64], poses: &[Vec<f64>]) -> Clip {
    let mut clip = blank(robot, title, notes, 1);
    let names: Vec<String> = (0..poses.len()).map(|k| format!("pose_{}", k + 1)).collect();
    let row = |q: &[f64]| q.iter().copied().map(Some).collect();
    clip.poses.insert("home".to_owned(), row(home));
    let mut steps = Vec::new();
    let mut from = home;
    for (name, pose) in names.iter().zip(poses) {
        clip.poses.insert(name.clone(), row(pose));
        steps.push((name.as_str(), gap(robot, from, pose), HOLD));
        from = pose;
    }
    sequence(&mut clip, "home", &steps);
    clip
}

/// Open frames between two poses.
fn gap(robot: &Robot, from: &[f64], to: &[f64]) -> u32 {
    let joints = robot.joints().iter().zip(from).zip(to);
    let secs = joints
        .map(|((j, a), b)| {
            let d = (b - a).abs();
            // Half of the way it accelerates, half of it it brakes.
            let rise = 2.0 * (d / (PACE * j.acceleration_limit.max(1e-3))).sqrt();
            rise.max(d / (PACE * j.speed_limit.max(1e-3)))
        })
        .fold(0.0, f64::max);
    ((secs / CTRL_DT).ceil() as u32).clamp(8, LONGEST_GAP)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ClipFacts as _;
    use robert_clip::{compile, lint};

    #[test]
    fn clips_are_valid_and_within_reach() {
        for id in Robot::builtin_ids() {
            let robot = Robot::builtin(id).unwrap();
            let table = robot.joint_table();
            for task in trial(&robot, 0).unwrap() {
                let command = compile(&task.clip).unwrap();
                let again = Clip::parse(&task.clip.to_text()).unwrap();
                assert_eq!(again.to_text(), task.clip.to_text());
                for found in lint(&task.clip, &command, &table, None) {
                    let (level, text) = (found.level, &found.message);
                    assert!(level < robert_clip::Level::Error, "{id}/{}: {text}", task.name);
                }
                let moved = (0..command.frames()).any(|f| command.row(f) != command.row(0));
                assert!(moved, "{id}/{} stands still", task.name);
            }
        }
    }

    #[test]
    fn every_moment_of_a_sway_can_be_held() {
        for id in ["ur5e", "shadow_hand"] {
            let robot = Robot::builtin(id).unwrap();
            let sway = trial(&robot, 1).unwrap().remove(0);
            let moments = moments(&sway.clip);
            assert!(moments.len() >= MOMENTS);
            for moment in moments {
                let settled = robot.settle(&moment).unwrap();
                assert!(settled.within, "{id}: {} off", settled.worst);
            }
        }
    }

    #[test]
    fn a_seed_names_its_clips() {
        let robot = Robot::builtin("ur5e").unwrap();
        let text = |seed| -> Vec<String> {
            trial(&robot, seed).unwrap().iter().map(|t| t.clip.to_text()).collect()
        };
        assert_eq!(text(3), text(3));
        assert_ne!(text(3), text(4));
    }
}
