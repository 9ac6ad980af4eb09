//! Turns a drawn line into keys at which a site of the robot follows it.
//!
//! The line is simplified in the robot's task space (Ramer 1972; Douglas and Peucker 1973). Inverse
//! kinematics finds a pose for each corner, beginning at the pose before. If the site leaves the
//! straight line between two poses, another pose is inserted. Times are those of the drawing, or
//! those of constant speed. If joints cannot move that fast, the motion becomes slower. At a sharp
//! corner the robot waits for a moment, since no mass can change its direction at once.

use super::message::Trace;
use crate::protocol::{DrawAnswer, DrawnKey};
use robert_base::units::CTRL_DT;
use robert_clip as clip;
use robert_mujoco::Data;
use robert_robot::{self as robot, IkConfig, Point, Robot, Target};

type V3 = [f64; 3];

/// The share of the tolerance that simplifying the line may use; the rest is for the motion between
/// two poses.
const CORNERS: f64 = 0.5;
/// The number of times that the segment between two corners is halved.
const HALVINGS: u32 = 6;
/// A turn by more than this is a sharp corner, rad.
const SHARP: f64 = 0.6;
/// Frames that a sharp corner is held.
const REST: u32 = 4;

/// A pose on the way.
struct Spot {
    q: Vec<f64>,
    /// The position of the site then, m.
    at: V3,
    /// Seconds after the line began.
    secs: f64,
    sharp: bool,
}

/// Poses along a line.
struct Tracer<'a> {
    robot: &'a Robot,
    data: &'a mut Data,
    ask: &'a Trace,
    config: IkConfig,
    site: usize,
    /// Farthest that a corner was missed, m.
    off: f64,
}

/// The keys of a line, the first at the frame where the site reaches its beginning.
pub(super) fn trace(
    robot: &Robot,
    data: &mut Data,
    ask: &Trace,
) -> Result<DrawAnswer, robot::Error> {
    let locked = ask.locked.iter().map(|j| robot.joint_index(j)).collect::<Result<Vec<_>, _>>()?;
    let config = IkConfig { locked, ..IkConfig::default() };
    let site = robot.site(&ask.site)?;
    Tracer { robot, data, ask, config, site, off: 0.0 }.keys()
}

impl Tracer<'_> {
    fn keys(&mut self) -> Result<DrawAnswer, robot::Error> {
        let line = &self.ask.line;
        let corners = simplified(line, CORNERS * self.ask.tolerance_m);
        let times = times(line, self.ask.secs);
        let Some(first) = corners.first() else {
            return Ok(DrawAnswer { keys: Vec::new(), frames: 0, off_m: 0.0, line: Vec::new() });
        };
        let mut spots = vec![self.reach(&self.ask.q, place(line[*first]), 0.0)?];
        for (n, pair) in corners.windows(2).enumerate() {
            let (from, to) = (pair[0], pair[1]);
            let turn = corners.get(n + 2).map_or(0.0, |next| {
                let way = |a: usize, b: usize| sub(place(line[b]), place(line[a]));
                angle(way(from, to), way(to, *next))
            });
            self.go(&mut spots, place(line[to]), times[to], HALVINGS)?;
            if let Some(spot) = spots.last_mut() {
                spot.sharp = turn > SHARP;
            }
        }
        Ok(self.timed(&spots))
    }

    /// The pose that brings the site there.
    fn reach(&mut self, from: &[f64], to: V3, secs: f64) -> Result<Spot, robot::Error> {
        let target = Target { point: Point::Site(self.ask.site.clone()), pos: to, quat: None };
        let found = self.robot.ik(self.data, from, &[target], &self.config)?;
        self.off = self.off.max(found.distance_m);
        let q: Vec<f64> = found.state.into_iter().map(clip::round).collect();
        let at = self.site_at(&q)?;
        Ok(Spot { q, at, secs, sharp: false })
    }

    fn site_at(&mut self, q: &[f64]) -> Result<V3, robot::Error> {
        self.robot.write_state(self.data, q)?;
        self.data.kinematics()?;
        Ok(self.data.site_xpos().as_chunks::<3>().0[self.site])
    }

    /// Continues from the last pose straight to a point, with as many poses in between as
    /// necessary.
    fn go(
        &mut self,
        spots: &mut Vec<Spot>,
        to: V3,
        secs: f64,
        halvings: u32,
    ) -> Result<(), robot::Error> {
        let Some(last) = spots.last() else { return Ok(()) };
        let (from, from_at, from_secs) = (last.q.clone(), last.at, last.secs);
        let spot = self.reach(&from, to, secs)?;
        let middle: Vec<f64> = from.iter().zip(&spot.q).map(|(a, b)| 0.5 * (a + b)).collect();
        let straight = scale(add(from_at, spot.at), 0.5);
        let bend = norm(sub(self.site_at(&middle)?, straight));
        if halvings > 0 && bend > (1.0 - CORNERS) * self.ask.tolerance_m {
            let half = scale(add(from_at, to), 0.5);
            self.go(spots, half, 0.5 * (from_secs + secs), halvings - 1)?;
            return self.go(spots, to, secs, halvings - 1);
        }
        spots.push(spot);
        Ok(())
    }

    /// Frames that joints need between two poses.
    fn needed(&self, from: &[f64], to: &[f64]) -> u32 {
        let frames = from
            .iter()
            .zip(to)
            .zip(&self.ask.speeds)
            .map(|((a, b), speed)| speed.map_or(0.0, |s| (b - a).abs() / (s * CTRL_DT)));
        // A hair above a whole number is that number.
        (frames.fold(0.0, f64::max) - 1e-6).ceil().max(0.0) as u32
    }

    fn timed(&self, spots: &[Spot]) -> DrawAnswer {
        let mut keys: Vec<DrawnKey> = Vec::with_capacity(spots.len());
        let (mut clock, mut before): (f64, Option<&Spot>) = (0.0, None);
        for spot in spots {
            let (frame, rest) = match (before, keys.last()) {
                (Some(last), Some(key)) => {
                    clock += (spot.secs - last.secs) / CTRL_DT;
                    let soonest = key.frame + key.hold - 1 + self.needed(&last.q, &spot.q).max(1);
                    // A delay by joints or corners is never caught up.
                    clock = clock.max(f64::from(soonest));
                    (clock.round() as u32, if spot.sharp { REST } else { 1 })
                }
                // The way from the pose before to the beginning of the line, and a moment to come
                // to rest. It begins and ends at rest, so the highest speed would be too fast.
                _ if self.needed(&self.ask.q, &spot.q) > 0 => {
                    let lead = 2 * self.needed(&self.ask.q, &spot.q);
                    clock = f64::from(lead);
                    (lead, REST)
                }
                _ => (0, 1),
            };
            keys.push(DrawnKey { frame, hold: rest, q: spot.q.clone() });
            before = Some(spot);
        }
        let frames = keys.last().map_or(0, |k| k.frame + k.hold);
        let line = self.ask.line.iter().copied().map(place).collect();
        DrawAnswer { keys, frames, off_m: self.off, line }
    }
}

/// The time at which each point of a line is passed, seconds after its first: as it was drawn, or
/// evenly in `secs`.
fn times(line: &[[f64; 4]], secs: Option<f64>) -> Vec<f64> {
    let Some(first) = line.first() else { return Vec::new() };
    let Some(secs) = secs else { return line.iter().map(|p| p[3] - first[3]).collect() };
    let mut passed = vec![0.0];
    for pair in line.windows(2) {
        let last = passed.last().copied().unwrap_or(0.0);
        passed.push(last + norm(sub(place(pair[1]), place(pair[0]))));
    }
    let whole = passed.last().copied().unwrap_or(0.0).max(1e-9);
    passed.into_iter().map(|p| secs * p / whole).collect()
}

/// Points of a line such that all others are near them: Ramer, Douglas and Peucker.
fn simplified(line: &[[f64; 4]], tolerance: f64) -> Vec<usize> {
    let Some(last) = line.len().checked_sub(1) else { return Vec::new() };
    let mut kept = vec![false; line.len()];
    (kept[0], kept[last]) = (true, true);
    let mut open = vec![(0, last)];
    while let Some((a, b)) = open.pop() {
        let far = (a + 1..b)
            .map(|k| (k, from_segment(place(line[k]), place(line[a]), place(line[b]))))
            .max_by(|x, y| x.1.total_cmp(&y.1));
        if let Some((k, distance)) = far.filter(|(_, d)| *d > tolerance) {
            debug_assert!(distance.is_finite());
            kept[k] = true;
            open.extend([(a, k), (k, b)]);
        }
    }
    (0..line.len()).filter(|k| kept[*k]).collect()
}

/// Distance of a point from a segment.
fn from_segment(p: V3, a: V3, b: V3) -> f64 {
    let along = sub(b, a);
    let long = dot(along, along);
    let share = if long > 0.0 { (dot(sub(p, a), along) / long).clamp(0.0, 1.0) } else { 0.0 };
    norm(sub(p, add(a, scale(along, share))))
}

fn place([x, y, z, _]: [f64; 4]) -> V3 {
    [x, y, z]
}

fn add(a: V3, b: V3) -> V3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

fn sub(a: V3, b: V3) -> V3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn scale(a: V3, s: f64) -> V3 {
    a.map(|v| v * s)
}

fn dot(a: V3, b: V3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn norm(a: V3) -> f64 {
    dot(a, a).sqrt()
}

fn angle(a: V3, b: V3) -> f64 {
    let long = norm(a) * norm(b);
    if long > 0.0 { (dot(a, b) / long).clamp(-1.0, 1.0).acos() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use robert_mujoco::Kind;

    fn ask(robot: &Robot, site: &str, line: Vec<[f64; 4]>, secs: Option<f64>) -> Trace {
        Trace {
            q: robot.home(),
            site: site.to_owned(),
            line,
            secs,
            tolerance_m: 0.002,
            speeds: vec![Some(1.0); robot.state_dim()],
            locked: Vec::new(),
        }
    }

    /// A closed square, with a point every few millimetres.
    fn square([x, y, z]: V3, side: f64) -> Vec<[f64; 4]> {
        let corners = [[0.0, 0.0], [side, 0.0], [side, side], [0.0, side], [0.0, 0.0]];
        let mut line = Vec::new();
        for pair in corners.windows(2) {
            for k in 0..20 {
                let s = f64::from(k) / 20.0;
                let at = |i: usize| pair[0][i] + s * (pair[1][i] - pair[0][i]);
                line.push([x + at(0), y + at(1), z, 0.1 * line.len() as f64]);
            }
        }
        line.push([x, y, z, 0.1 * line.len() as f64]);
        line
    }

    #[test]
    fn a_square_with_the_arms_tool_keeps_its_corners_and_its_edges() {
        let robot = Robot::builtin("ur5e").unwrap();
        let mut data = Data::new(robot.model()).unwrap();
        let site = robot.model().id(Kind::Site, "end_effector").unwrap();
        let mut at = |q: &[f64]| {
            robot.write_state(&mut data, q).unwrap();
            data.kinematics().unwrap();
            data.site_xpos().as_chunks::<3>().0[site]
        };
        let tip = at(&robot.home());
        let line = square([tip[0] - 0.1, tip[1] - 0.1, tip[2]], 0.2);
        let ask = ask(&robot, "end_effector", line.clone(), Some(8.0));
        let mut work = Data::new(robot.model()).unwrap();
        let found = trace(&robot, &mut work, &ask).unwrap();
        assert!(found.off_m < 2e-4, "{}", found.off_m);
        assert!(found.keys.len() >= 5 && found.keys.len() < 60, "{} keys", found.keys.len());
        // Between two keys joints go straight: nowhere is the tool off the line.
        for pair in found.keys.windows(2) {
            assert!(pair[0].frame + pair[0].hold <= pair[1].frame, "keys in order");
            let speed = pair[0].q.iter().zip(&pair[1].q).map(|(a, b)| (a - b).abs());
            let frames = f64::from(pair[1].frame - pair[0].frame - pair[0].hold + 1);
            assert!(speed.fold(0.0, f64::max) <= 1.0 * CTRL_DT * frames + 1e-5, "too fast");
            for k in 0..=4 {
                let s = f64::from(k) / 4.0;
                let q: Vec<f64> =
                    pair[0].q.iter().zip(&pair[1].q).map(|(a, b)| a + s * (b - a)).collect();
                let p = at(&q);
                let off = line
                    .windows(2)
                    .map(|l| from_segment(p, place(l[0]), place(l[1])))
                    .fold(f64::INFINITY, f64::min);
                assert!(off < 0.002, "{off}");
            }
        }
        for corner in [0, 20, 40, 60, 80] {
            let near = found
                .keys
                .iter()
                .map(|k| norm(sub(at(&k.q), place(line[corner]))))
                .fold(f64::INFINITY, f64::min);
            assert!(near < 1e-3, "corner {corner} is {near} away from every key");
        }
    }

    #[test]
    fn times_are_the_hands_or_even_and_joints_delay_them() {
        let robot = Robot::builtin("pointmass").unwrap();
        let mut data = Data::new(robot.model()).unwrap();
        let line = vec![[0.0, 0.0, 0.01, 5.0], [0.5, 0.0, 0.01, 6.0], [0.5, 0.1, 0.01, 8.0]];
        let by_hand = trace(&robot, &mut data, &ask(&robot, "puck", line.clone(), None)).unwrap();
        let frames = |a: &DrawAnswer| a.keys.iter().map(|k| k.frame).collect::<Vec<_>>();
        assert_eq!(frames(&by_hand), [0, 20, 60]);
        let even = trace(&robot, &mut data, &ask(&robot, "puck", line.clone(), Some(6.0))).unwrap();
        assert_eq!(frames(&even), [0, 100, 120]);
        // Half a metre at 1 m/s takes ten frames, however fast the hand was.
        let fast = trace(&robot, &mut data, &ask(&robot, "puck", line, Some(0.1))).unwrap();
        assert_eq!(frames(&fast), [0, 10, 10 + REST - 1 + 2]);
    }

    #[test]
    fn only_points_that_count_are_kept() {
        let arc: Vec<[f64; 4]> = (0..=90)
            .map(|d| {
                let a = f64::from(d).to_radians();
                [0.1 * a.cos(), 0.1 * a.sin(), 0.0, 0.0]
            })
            .collect();
        let kept = simplified(&arc, 1e-3);
        // A chord of a circle of radius r is off by e where it spans 2 sqrt(2 e / r).
        assert!((5..=10).contains(&kept.len()), "{kept:?}");
        assert_eq!(simplified(&arc[..2], 1e-3), [0, 1]);
        assert!(simplified(&[], 1e-3).is_empty());
    }
}
