//! `nearest`: repeats the actions of the most similar recorded moments.
//!
//! Nothing is learned. A recorded moment is similar if the robot had nearly the same pose, had
//! moved in nearly the same way, and k frames later was near the goal, where k is the number of
//! frames to the next visible goal. The search compares every frame, so the result is exact. Frames
//! are read joint by joint in blocks, and most blocks are dropped after their first few joints.

// Vector code must be inlined into the function that pulp compiles for the processor found.
#![allow(clippy::inline_always)]

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use pulp::Arch;
use serde::{Deserialize, Serialize};

use super::error::Error;
use super::fitted::{self, FitCard, FitKind, Scales, file_error, tensors_of};
use super::policy::{Policy, View};
use super::window::{HISTORY, Window};
use robert_base::fsio;
use robert_base::limits;
use robert_dataset::{Dataset, Part, Verify};
use robert_net::tensors::Out;
use robert_net::{self as net, RobotCard, checkpoint};

/// Default number of frames. A search over that many is fast enough for 20 Hz.
pub const FRAMES: usize = 400_000;
/// The most frames of a fit.
const MOST_FRAMES: usize = 20_000_000;
/// Frames that are compared side by side.
const BLOCK: usize = 32;
/// Joints after which a block that is already too far is dropped.
const LOOK_EVERY: usize = 4;

/// Settings and sizes of a fit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NearestSettings {
    /// Moments whose actions are averaged, weighted by closeness.
    pub neighbours: usize,
    /// Weight of the distance in pose, in units of the pose's spread.
    pub place: f32,
    /// Weight of the distance in the last change, in units of a typical change per frame. The
    /// change toward the goal has weight 1.
    pub past: f32,
    /// Frames of each trajectory, in order.
    pub lengths: Vec<usize>,
}

impl NearestSettings {
    /// The best settings; see `docs/results.md`.
    pub fn new(lengths: Vec<usize>) -> Self {
        NearestSettings { neighbours: 8, place: 0.5, past: 0.3, lengths }
    }
}

/// Recorded moments, for retrieval.
#[derive(Clone, Debug)]
pub struct Nearest {
    card: FitCard<NearestSettings>,
    /// (S, stride): one row per joint, trajectories one after the other, then padding for the last
    /// block.
    qpos: Arc<[f32]>,
    stride: usize,
    /// (N, A).
    ctrl: Arc<[f32]>,
    /// Factors of the three distances, (S) each.
    place: Vec<f32>,
    past: Vec<f32>,
    way: Vec<f32>,
    /// The best moments so far: squared distance and frame, nearest first.
    best: Vec<(f32, usize)>,
}

impl Nearest {
    /// From recorded frames, trajectories one after the other: (N, S) and (N, A).
    ///
    /// # Errors
    /// [`net::Error::Shape`] when the numbers do not fit the card, [`net::Error::Config`].
    pub fn new(
        card: FitCard<NearestSettings>,
        qpos: &[f32],
        ctrl: Vec<f32>,
    ) -> Result<Self, net::Error> {
        let set = &card.settings;
        let refuse = |field, why: &str| Err(net::Error::Config { field, why: why.to_owned() });
        if !(1..=1000).contains(&set.neighbours) {
            return refuse("neighbours", "takes 1 to 1000");
        }
        if [set.place, set.past].iter().any(|w| !(w.is_finite() && (0.0..=1e6).contains(w))) {
            return refuse("place, past", "take 0 to 1e6");
        }
        let frames = set
            .lengths
            .iter()
            .try_fold(0_usize, |n, &l| n.checked_add(l).filter(|&n| l > 0 && n <= MOST_FRAMES));
        let Some(frames) = frames.filter(|&n| n > 0) else {
            return refuse(
                "lengths",
                "must be one or more trajectories with at most 20 million frames in total",
            );
        };
        for (what, per, got) in
            [("qpos", card.state(), qpos.len()), ("ctrl", card.actions(), ctrl.len())]
        {
            if got != frames * per {
                return Err(net::Error::Shape { what, want: frames * per, got });
            }
        }
        let scales = Scales::new(&card);
        let times = |x: &[f32], w: f32| x.iter().map(|x| x * w).collect();
        let (s, stride) = (card.state(), frames + BLOCK);
        let mut columns = vec![0.0; s * stride];
        for (t, row) in qpos.chunks_exact(s.max(1)).enumerate() {
            row.iter().enumerate().for_each(|(j, &x)| columns[j * stride + t] = x);
        }
        Ok(Nearest {
            place: times(&scales.place, set.place),
            past: times(&scales.way, set.past),
            way: scales.way,
            best: Vec::with_capacity(set.neighbours + 1),
            card,
            qpos: columns.into(),
            stride,
            ctrl: ctrl.into(),
        })
    }

    /// The training part of a dataset, at most `frames` of it: whole trajectories, evenly spread
    /// over the list, so that every collector and snapshot keeps its share.
    ///
    /// # Errors
    /// As [`Nearest::new`].
    pub fn of(data: &Dataset, seed: u64, frames: usize) -> Result<Self, net::Error> {
        let all = data.part(Part::Train, seed);
        let length = |i: &usize| data.episodes().get(*i).map_or(0, |e| e.length);
        let total: u64 = all.iter().map(length).sum();
        let (mut seen, mut kept) = (0_u64, 0_u64);
        let (mut lengths, mut qpos, mut ctrl) = (Vec::new(), Vec::new(), Vec::new());
        for i in &all {
            seen += length(i);
            let share = u128::from(seen) * frames as u128 / u128::from(total.max(1));
            if u128::from(kept + length(i)) > share.max(u128::from(length(i))) {
                continue;
            }
            let Some(e) = data.episodes().get(*i) else { continue };
            let (q, _, a) = data.frames(e);
            qpos.extend_from_slice(q);
            ctrl.extend_from_slice(a);
            lengths.push(e.length as usize);
            kept += e.length;
        }
        let settings = NearestSettings::new(lengths);
        Self::new(FitCard::of(FitKind::Nearest, data, seed, settings), &qpos, ctrl)
    }

    /// Opens a file of `robert fit nearest`, or a dataset.
    ///
    /// # Errors
    /// As [`Nearest::load`], and [`Error::Dataset`].
    pub fn open(path: &Path, robot: &RobotCard) -> Result<Self, Error> {
        let fitted = path.join(FitKind::Nearest.file());
        if fitted.exists() {
            return Ok(Self::load(&fitted, Some(robot))?);
        }
        if !path.is_dir() {
            return Ok(Self::load(path, Some(robot))?);
        }
        let data = Dataset::open(path, Verify::Structure)?;
        checkpoint::same_robot(&fitted::card_of(&data.manifest().robot), robot, path)?;
        Ok(Self::of(&data, 0, FRAMES)?)
    }

    /// Its settings.
    pub fn card(&self) -> &FitCard<NearestSettings> {
        &self.card
    }

    /// Frames that are searched.
    pub fn frames(&self) -> usize {
        self.ctrl.len() / self.card.actions().max(1)
    }

    /// Writes it, atomically.
    ///
    /// # Errors
    /// [`net::Error::Files`].
    pub fn save(&self, path: &Path) -> Result<(), net::Error> {
        let (n, s) = (self.frames(), self.card.state());
        let at = |t: usize, j: usize| self.qpos[j * self.stride + t];
        let qpos: Vec<f32> = (0..n).flat_map(|t| (0..s).map(move |j| at(t, j))).collect();
        let all = BTreeMap::from([
            ("qpos".to_owned(), Out::new(&[n, s], &qpos)),
            ("ctrl".to_owned(), Out::new(&[n, self.card.actions()], &self.ctrl)),
        ]);
        self.card.save(path, &all)
    }

    /// Reads and checks a file; `robot`, when given, must be its robot.
    ///
    /// # Errors
    /// [`net::Error::File`] with the reason, [`net::Error::Robot`], [`net::Error::Files`].
    pub fn load(path: &Path, robot: Option<&RobotCard>) -> Result<Self, net::Error> {
        let bytes = fsio::read_capped(path, limits::TENSOR_FILE_BYTES)?;
        let card = FitCard::<NearestSettings>::parse(&bytes, FitKind::Nearest, robot, path)?;
        let file = tensors_of(&bytes, &["qpos".to_owned(), "ctrl".to_owned()], path)?;
        let frames = card.settings.lengths.iter().fold(0_usize, |n, &l| n.saturating_add(l));
        let read = |name: &str, columns: usize| {
            checkpoint::numbers(&file, name, &[frames, columns])
                .map_err(|why| file_error(why, path))
        };
        let (qpos, ctrl) = (read("qpos", card.state())?, read("ctrl", card.actions())?);
        if ctrl.iter().any(|a| a.abs() > 1.0) {
            return Err(file_error("actions beyond [-1, 1]".to_owned(), path));
        }
        Self::new(card, &qpos, ctrl).map_err(|e| file_error(e.to_string(), path))
    }

    /// The most similar moments, nearest first: squared distance and frame.
    fn look(&mut self, query: &Query) {
        let mut best = std::mem::take(&mut self.best);
        best.clear();
        Arch::new().dispatch(
            #[inline(always)]
            || self.scan(query, &mut best),
        );
        self.best = best;
    }

    #[inline(always)]
    fn scan(&self, query: &Query, best: &mut Vec<(f32, usize)>) {
        let Query { now, past, goal, k } = query;
        let keep = self.card.settings.neighbours;
        let share = 1.0 / *k as f32;
        let mut first = 0;
        for &length in &self.card.settings.lengths {
            // A frame needs a frame before it and the frame of the goal after it.
            let (begin, end) = (first + 1, (first + length).saturating_sub(*k));
            first += length;
            for t in (begin..end).step_by(BLOCK) {
                let full = best.len() == keep;
                let worst = best.last().filter(|_| full).map_or(f32::INFINITY, |b| b.0);
                let mut d = [0.0; BLOCK];
                let joints = || self.qpos.chunks_exact(self.stride).enumerate();
                let far = joints().any(
                    #[inline(always)]
                    |(j, q)| {
                        apart(&mut d, block(q, t + k), block(q, t), share, goal[j], self.way[j]);
                        (j + 1) % LOOK_EVERY == 0 && !any_below(&d, worst)
                    },
                );
                if far || !any_below(&d, worst) {
                    continue;
                }
                for (j, q) in joints() {
                    let here = block(q, t);
                    apart(&mut d, here, &[now[j]; BLOCK], 1.0, 0.0, self.place[j]);
                    apart(&mut d, here, block(q, t - 1), 1.0, past[j], self.past[j]);
                }
                // Frames beyond the trajectory do not count.
                for (i, &d) in d.iter().enumerate().take(end - t) {
                    let worst = best.get(keep - 1).map_or(f32::INFINITY, |b| b.0);
                    if d < worst {
                        best.insert(best.partition_point(|b| b.0 <= d), (d, t + i));
                        best.truncate(keep);
                    }
                }
            }
        }
    }

    /// The action for this window, (A).
    pub fn answer(&mut self, window: &Window, action: &mut [f64]) {
        let s = window.dim();
        let single = |x: &[f64]| x.iter().map(|&x| x as f32).collect::<Vec<f32>>();
        let now = single(&window.current);
        let before = single(&window.history[(HISTORY - 1) * s..]);
        let past: Vec<f32> = now.iter().zip(&before).map(|(a, b)| a - b).collect();
        // The first frame with a visible joint; its hidden joints are on their own lines.
        let seen = window.visible.chunks_exact(s).position(|row| row.iter().any(|&v| v));
        let k = seen.map_or(1, |i| i + 1);
        let goal: Vec<f32> =
            (0..s).map(|j| (window.next_target(j) - window.current[j]) as f32).collect();
        self.look(&Query { now, past, goal, k });
        action.fill(0.0);
        let a = self.card.actions();
        let mut all = 0.0;
        // Weights fall with the distance; an identical moment counts alone.
        for &(d, t) in &self.best {
            let weight = 1.0 / (f64::from(d) + 1e-9);
            all += weight;
            for (to, &x) in action.iter_mut().zip(&self.ctrl[t * a..(t + 1) * a]) {
                *to += weight * f64::from(x);
            }
        }
        if all > 0.0 {
            action.iter_mut().for_each(|x| *x /= all);
        }
    }
}

/// A query: pose, last change, change per frame toward the goal, (S) each, and frames to the goal.
#[derive(Debug)]
struct Query {
    now: Vec<f32>,
    past: Vec<f32>,
    goal: Vec<f32>,
    k: usize,
}

/// The numbers from `t` on.
#[inline(always)]
fn block(q: &[f32], t: usize) -> &[f32; BLOCK] {
    let Some(block) = q[t..].first_chunk() else {
        unreachable!("positions are padded to whole blocks")
    };
    block
}

/// Adds to each frame the squared distance between `share` times the change from `from` to `to`,
/// and `way`, in units of 1 / `scale`.
#[inline(always)]
fn apart(
    d: &mut [f32; BLOCK],
    to: &[f32; BLOCK],
    from: &[f32; BLOCK],
    share: f32,
    way: f32,
    scale: f32,
) {
    for ((d, to), from) in d.iter_mut().zip(to).zip(from) {
        let x = ((to - from) * share - way) * scale;
        *d += x * x;
    }
}

/// Whether any of `d` is less than `worst`. Without branches, so that the values stay in registers.
#[inline(always)]
fn any_below(d: &[f32; BLOCK], worst: f32) -> bool {
    let mut any = false;
    for d in d {
        any |= *d < worst;
    }
    any
}

impl Policy for Nearest {
    fn name(&self) -> String {
        "nearest".to_owned()
    }

    fn reset(&mut self, _seed: u64) {}

    fn act(&mut self, view: &View<'_>, action: &mut [f64]) -> Result<(), Error> {
        self.answer(view.window, action);
        Ok(())
    }

    fn fork(&self) -> Option<Box<dyn Policy>> {
        Some(Box::new(self.clone()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::COMMAND;
    use robert_base::rng::{Rng, Stream};
    use robert_net::{JointFacts, Normaliser};

    /// Smooth motion of two joints; every action encodes its frame.
    fn recorded(neighbours: usize) -> (Nearest, Vec<f32>) {
        let lengths = vec![80, 90];
        let mut rng = Rng::new(2, Stream::Test, 0);
        let mut qpos = Vec::new();
        let (mut q, mut v) = ([0.0_f64; 2], [0.0_f64; 2]);
        for _ in 0..170 {
            for (q, v) in q.iter_mut().zip(&mut v) {
                *v = 0.8 * *v + 0.02 * rng.normal();
                *q += *v;
            }
            qpos.extend(q.map(|x| x as f32));
        }
        let ctrl: Vec<f32> = (0..170).map(|t| t as f32 / 170.0).collect();
        let robot = RobotCard {
            id: "toy".into(),
            model_sha256: String::new(),
            joints: vec!["a".into(), "b".into()],
            actuators: vec!["m".into()],
        };
        let norm = Normaliser {
            mean: vec![0.0; 2],
            std: vec![0.3; 2],
            std_d1: vec![0.03; 2],
            std_d2: vec![0.02; 2],
        };
        let settings = NearestSettings { neighbours, ..NearestSettings::new(lengths) };
        let card = FitCard {
            format: "robert-fit/1".into(),
            kind: FitKind::Nearest,
            robot,
            joints: vec![JointFacts { hinge: true, range: None }; 2],
            normaliser: norm,
            dataset_sha256: String::new(),
            seed: 0,
            settings,
        };
        (Nearest::new(card, &qpos, ctrl).unwrap(), qpos)
    }

    /// The window at frame `t` of the recording when the next `hidden` frames are masked.
    fn window(qpos: &[f32], t: usize, hidden: usize) -> Window {
        let mut w = Window::new(2);
        let wide = |f: usize| [f64::from(qpos[f * 2]), f64::from(qpos[f * 2 + 1])];
        for i in 0..HISTORY {
            w.history[i * 2..i * 2 + 2].copy_from_slice(&wide(t - HISTORY + i));
        }
        w.current.copy_from_slice(&wide(t));
        for i in 0..COMMAND {
            w.command[i * 2..i * 2 + 2].copy_from_slice(&wide(t + 1 + i));
            w.visible[i * 2..i * 2 + 2].fill(i >= hidden);
        }
        w
    }

    #[test]
    fn a_recorded_moment_gives_its_own_action() {
        let (mut one, qpos) = recorded(1);
        let (mut eight, _) = recorded(8);
        let mut action = [0.0];
        for t in (HISTORY..79 - COMMAND).chain(80 + HISTORY..169 - COMMAND) {
            for hidden in [0, 1, 7, 19] {
                let w = window(&qpos, t, hidden);
                for policy in [&mut one, &mut eight] {
                    policy.answer(&w, &mut action);
                    let want = f64::from(t as f32 / 170.0);
                    assert!((action[0] - want).abs() < 1e-3, "frame {t}, {hidden} hidden");
                }
            }
        }
    }

    #[test]
    fn the_search_leaves_nothing_out() {
        let (mut policy, qpos) = recorded(3);
        let mut rng = Rng::new(3, Stream::Test, 0);
        for _ in 0..50 {
            let mut draw = |scale: f64| [0, 1].map(|_| (scale * rng.normal()) as f32);
            let (now, past, goal) = (draw(0.3), draw(0.03), draw(0.03));
            for k in [1, 5, 20] {
                let query =
                    Query { now: now.to_vec(), past: past.to_vec(), goal: goal.to_vec(), k };
                policy.look(&query);
                let mut all: Vec<(f32, usize)> = Vec::new();
                for (begin, end) in [(0, 80), (80, 170)] {
                    for t in begin + 1..end - k {
                        let at = |t: usize, j: usize| qpos[t * 2 + j];
                        let d = (0..2).map(|j| {
                            let way = (at(t + k, j) - at(t, j)) / k as f32 - goal[j];
                            let behind = at(t, j) - at(t - 1, j) - past[j];
                            (way / 0.03).powi(2)
                                + ((at(t, j) - now[j]) * 0.5 / 0.3).powi(2)
                                + (behind * 0.3 / 0.03).powi(2)
                        });
                        all.push((d.sum(), t));
                    }
                }
                all.sort_by(|a, b| a.0.total_cmp(&b.0));
                let found: Vec<usize> = policy.best.iter().map(|b| b.1).collect();
                let want: Vec<usize> = all[..3].iter().map(|b| b.1).collect();
                assert_eq!(found, want, "gap {k}");
            }
        }
    }
}
