//! How far end effectors were from their goals in a motion. Frames that a mask hides do not count.

use serde::Serialize;

use super::perform::Performed;
use crate::units::significant;

/// An end effector while a key with a goal for it is held.
#[derive(Debug, Serialize)]
pub(super) struct Arrival {
    /// First frame, and the one after the last.
    pub frames: [u32; 2],
    /// The site or body.
    pub point: String,
    /// Mean distance from the goal over these frames, m.
    pub distance: f64,
    /// The largest distance, m.
    pub worst: f64,
    /// The mean orientation error, rad; `None` if no orientation was asked for.
    pub angle: Option<f64>,
}

/// The arrivals of a motion, in order of keys.
pub(super) fn arrivals(done: &Performed) -> Vec<Arrival> {
    let (clip, tree, d) = (&done.clip, done.robot.kinematics(), done.robot.state_dim());
    let states: Vec<&[f64]> =
        done.rollout.reached().chunks_exact(d).take(done.rollout.frame() + 1).collect();
    let mut found = Vec::new();
    for (i, key) in clip.keys.iter().enumerate() {
        if key.reach.is_empty() {
            continue;
        }
        // The start is where the robot is put. A key for joints that do not move the points ends no hold of them.
        let points: Vec<_> = key.reach.iter().map(|r| r.point.clone()).collect();
        let movers = tree.movers(&points).unwrap_or_default();
        let ends = movers.iter().map(|j| done.command.tracks().hold_end(clip, i, *j));
        let frames = [key.frame.max(1), ends.min().unwrap_or(clip.hold_end(i))];
        let sees = |f: &u32| (0..d).any(|j| done.command.sees(*f, j));
        let asked = (frames[0]..frames[1]).filter(sees);
        let held: Vec<&[f64]> = asked.filter_map(|f| states.get(f as usize).copied()).collect();
        for reach in &key.reach {
            let Some(id) = tree.point(&reach.point).ok().filter(|_| !held.is_empty()) else {
                continue;
            };
            let places: Vec<_> = held.iter().map(|state| tree.place(state, &id)).collect();
            let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len() as f64;
            let off = |pos: [f64; 3]| {
                pos.iter().zip(reach.pos).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
            };
            let distances: Vec<f64> = places.iter().map(|place| off(place.pos)).collect();
            let angle = reach.quat.map(|goal| {
                let angles: Vec<f64> =
                    places.iter().map(|place| between(place.quat, goal)).collect();
                mean(&angles)
            });
            found.push(Arrival {
                frames,
                point: reach.point.name().to_owned(),
                distance: mean(&distances),
                worst: distances.iter().copied().fold(0.0, f64::max),
                angle,
            });
        }
    }
    found
}

/// Figure and explanation for people; `None` without goals of end effectors.
pub(super) fn said(arrivals: &[Arrival]) -> Option<(String, String)> {
    let worst = arrivals.iter().max_by(|a, b| a.worst.total_cmp(&b.worst))?;
    let mean = arrivals.iter().map(|a| a.distance).sum::<f64>() / arrivals.len() as f64;
    let mm = |m: f64| significant(1e3 * m);
    let figure = format!("{} mm, at most {} mm", mm(mean), mm(worst.worst));
    Some((
        figure,
        format!(
            "mean distance from their goals; most: {} at frame {}",
            worst.point, worst.frames[0]
        ),
    ))
}

/// The angle between two orientations, rad; w x y z.
fn between(a: [f64; 4], b: [f64; 4]) -> f64 {
    let norm = |q: [f64; 4]| q.iter().map(|x| x * x).sum::<f64>().sqrt();
    let dot: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
    2.0 * (dot.abs() / (norm(a) * norm(b)).max(f64::MIN_POSITIVE)).min(1.0).acos()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quarter_turn_is_a_quarter_turn_either_way() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let (a, b) = ([1.0, 0.0, 0.0, 0.0], [half, 0.0, 0.0, half]);
        assert!((between(a, b) - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        assert!((between(a, b.map(|x| -2.0 * x)) - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        assert!(between(b, b) < 1e-7);
    }
}
