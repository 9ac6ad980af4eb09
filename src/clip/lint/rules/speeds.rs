//! Rule: the time between two goals suffices for the speed of the joints.

use std::collections::{BTreeMap, BTreeSet};

use crate::document::{Fill, Key};
use crate::lint::finder::{Finder, some_of};
use crate::lint::finding::{Fix, Level, Lint, Rule};
use crate::op::{Batch, ClipLength, FillSet, KeysScale, Op, TangentSet, TimeInsert};
use robert_base::limits;
use robert_base::units::CTRL_DT;

#[derive(Clone, Copy)]
struct Run {
    joint: usize,
    from: u32,
    to: u32,
    ratio: f64,
}

impl Finder<'_> {
    /// Speeds between neighbouring goals of each joint, runs of offenders joined.
    pub(in crate::lint) fn speeds(&mut self) {
        let command = self.command;
        let mut runs: Vec<Run> = Vec::new();
        for (j, name) in command.joints().iter().enumerate() {
            let joint = self.table.joint(name);
            let Some(speed_max) = joint.and_then(|f| f.speed_max).filter(|s| *s > 0.0) else {
                continue;
            };
            // The robot is at its start at frame 0.
            let mut last: Option<(u32, f32)> = command.start().get(j).map(|v| (0, *v));
            let mut run: Option<Run> = None;
            for t in 1..command.frames() {
                if !command.sees(t, j) {
                    continue;
                }
                let Some(&v) = command.row(t).get(j) else { continue };
                if let Some((a, from)) = last.replace((t, v)) {
                    let step = (f64::from(v) - f64::from(from)).abs();
                    let ratio = step / (f64::from(t - a) * CTRL_DT) / speed_max;
                    if ratio > 1.0 + 1e-6 {
                        match &mut run {
                            Some(r) if r.to == a => {
                                r.to = t;
                                r.ratio = r.ratio.max(ratio);
                            }
                            _ => runs.extend(run.replace(Run { joint: j, from: a, to: t, ratio })),
                        }
                    }
                }
            }
            runs.extend(run);
        }
        // Joints that are too fast in the same frames are one finding.
        let mut merged: BTreeMap<(u32, u32), Vec<Run>> = BTreeMap::new();
        for run in runs {
            merged.entry((run.from, run.to)).or_default().push(run);
        }
        // Slowing the whole clip down is offered once, at the place that needs it most.
        let top = |runs: &Vec<Run>| runs.iter().map(|r| r.ratio).fold(0.0, f64::max);
        let worst = merged.values().map(top).fold(0.0, f64::max);
        let mut offered = false;
        for ((from, to), runs) in merged {
            let slowest = !offered && top(&runs) >= worst;
            if !slowest && self.full(Rule::JointSpeed) {
                continue;
            }
            offered |= slowest;
            let lint = self.speed_lint(from, to, &runs, slowest);
            self.push(lint);
        }
    }

    fn speed_lint(&self, from: u32, to: u32, runs: &[Run], slowest: bool) -> Lint {
        let ratio = runs.iter().map(|r| r.ratio).fold(1.0, f64::max);
        let mut joints = Vec::new();
        let mut words = Vec::new();
        for run in runs {
            let Some(name) = self.command.joints().get(run.joint) else { continue };
            let Some(fact) = self.table.joint(name) else { continue };
            let max = fact.speed_max.unwrap_or_default();
            let unit = fact.unit.symbol();
            // Near the limit two digits would show the same figure twice.
            let digits = if run.ratio < 1.1 || max < 0.1 { 4 } else { 2 };
            words.push(format!("{name} {:.digits$} of {max:.digits$} {unit}/s", max * run.ratio));
            joints.push(name.clone());
        }
        // The length of the interval between the keys around the run scales the speed.
        let ratio = ratio * self.between_samples(from, to, runs);
        if let Some(jump) = self.jump(to, runs, ratio) {
            return self.too_fast(from, to, joints, &words, vec![jump]);
        }
        let mut fixes = Vec::from_iter(self.automatic(from, to, runs, &joints));
        fixes.extend(self.softer(from, to, &joints, ratio));
        // The way to the first key begins at the start of the clip, and has no key before it. A typed slope
        // stays as steep in a longer interval, and so does an offset.
        let mut ways = runs.iter().map(|run| self.way(from, to, run.joint));
        let way = ways.next().flatten().filter(|way| ways.all(|other| other == Some(*way)));
        if let (Some((before, next)), true) = (way, fixes.is_empty()) {
            let keys = &self.clip.keys;
            let (key, after) = (before.map(|(i, _)| &keys[i]), &keys[next]);
            let begin = before.map_or(0, |(_, last)| last);
            let have = after.frame - begin;
            // A held value jumps over one frame; only a line can be slower.
            let jumps = key.is_some_and(|key| self.clip.fill_after(key) == Fill::Hold);
            let need = if jumps { ratio } else { f64::from(have) * ratio }.ceil().min(1e6) as u32;
            let frames = need.saturating_sub(have).max(u32::from(!jumps));
            let (at, room) = (after.frame, self.clip.length + frames <= limits::CLIP_FRAMES);
            let insert = (frames > 0).then_some(Op::TimeInsert(TimeInsert { at, frames }));
            let line = jumps.then(|| {
                let frames = key.map(|key| vec![key.frame]);
                Op::FillSet(FillSet { frames, fill: Some(Fill::Linear) })
            });
            let title = match (&line, &insert) {
                (None, _) => format!("Allow {} before frame {at}", more(frames)),
                (Some(_), None) => format!("Interpolate linearly from frame {begin} to {at}"),
                (Some(_), Some(_)) => {
                    format!("Interpolate linearly and allow {}", more(frames))
                }
            };
            let mut ops: Vec<Op> = line.into_iter().chain(insert).collect();
            let op = match (ops.pop(), ops.is_empty()) {
                (Some(one), true) => one,
                (last, _) => {
                    ops.extend(last);
                    Op::Batch(Batch { label: title.clone(), ops })
                }
            };
            if room {
                fixes.push(Fix { title, op });
            }
        }
        if slowest {
            fixes.extend(self.slow_down(from, to, runs, ratio));
        }
        self.too_fast(from, to, joints, &words, fixes)
    }

    fn too_fast(
        &self,
        from: u32,
        to: u32,
        joints: Vec<String>,
        words: &[String],
        fixes: Vec<Fix>,
    ) -> Lint {
        let keys = &self.clip.keys;
        let next = keys.partition_point(|k| k.frame < to);
        Lint {
            level: Level::Warning,
            rule: Rule::JointSpeed,
            message: format!("too fast: {}", some_of(words)),
            frames: Some([from, to + 1]),
            joints,
            pointer: format!("/keys/{}", next.min(keys.len().saturating_sub(1))),
            fixes,
            settled: None,
            unlisted: 0,
        }
    }

    /// The edit that gives time before a key at frame 0, if it is held and the robot begins
    /// elsewhere.
    fn jump(&self, to: u32, runs: &[Run], ratio: f64) -> Option<Fix> {
        let key = self.clip.keys.first().filter(|k| k.frame == 0 && k.hold > 1)?;
        let (start, first) = (self.command.start(), self.command.row(0));
        let elsewhere = |run: &Run| run.from == 0 && start.get(run.joint) != first.get(run.joint);
        if to >= key.hold || !runs.iter().any(elsewhere) {
            return None;
        }
        // Poses are single precision here.
        let frames = (ratio * (1.0 - 1e-6)).ceil().min(1e6) as u32;
        let op = Op::TimeInsert(TimeInsert { at: 0, frames });
        (self.clip.length + frames <= limits::CLIP_FRAMES)
            .then(|| Fix { title: format!("Allow {} before frame 0", more(frames)), op })
    }

    /// The last key of a joint up to frame `from`.
    fn key_up_to(&self, from: u32, joint: usize) -> Option<usize> {
        let keys = &self.clip.keys;
        self.command.tracks().last(keys.partition_point(|k| k.frame <= from).checked_sub(1)?, joint)
    }

    /// The interval of a joint's track within which the frames `from..=to` lie: the key where it begins, if it is
    /// not the start of the clip, with the last frame of its hold, and the key where it ends.
    fn way(&self, from: u32, to: u32, joint: usize) -> Option<(Option<(usize, u32)>, usize)> {
        let (clip, tracks) = (self.clip, self.command.tracks());
        let before = self.key_up_to(from, joint);
        let next = match before {
            Some(i) => tracks.next(i, joint)?,
            None => (0..clip.keys.len()).find(|i| tracks.has(*i, joint))?,
        };
        let last = |i: usize| tracks.hold_end(clip, i, joint).saturating_sub(1);
        let before = before.map(|i| (i, last(i).max(clip.keys[i].frame)));
        (clip.keys[next].frame >= to).then_some((before, next))
    }

    /// The intervals between the keys of a joint that have a part in the frames `from..=to`: the last frame of
    /// each hold, and the indices of both keys.
    fn intervals(
        &self,
        from: u32,
        to: u32,
        joint: usize,
    ) -> impl Iterator<Item = (u32, usize, usize)> {
        let (clip, tracks) = (self.clip, self.command.tracks());
        let first = self.key_up_to(from, joint).or_else(|| {
            Some(0).filter(|i| tracks.has(*i, joint)).or_else(|| tracks.next(0, joint))
        });
        let all = std::iter::successors(first, move |i| tracks.next(*i, joint));
        let pairs = all.filter_map(move |i| {
            let last = tracks.hold_end(clip, i, joint).saturating_sub(1);
            Some((last.max(clip.keys[i].frame), i, tracks.next(i, joint)?))
        });
        pairs.take_while(move |(last, ..)| *last < to)
    }

    /// The edit that makes typed slopes of these joints automatic, in the interval in which each is too fast.
    fn automatic(&self, from: u32, to: u32, runs: &[Run], joints: &[String]) -> Option<Fix> {
        let mut frames = BTreeSet::new();
        for (run, joint) in runs.iter().zip(joints) {
            let Some((_, i, next)) = self.intervals(from, to, run.joint).next() else { continue };
            let typed = |k: &&Key| k.tangents.get(joint).is_some_and(|t| t.typed().is_some());
            let ends = [i, next].map(|k| &self.clip.keys[k]);
            frames.extend(ends.into_iter().filter(typed).map(|k| k.frame));
        }
        let frames: Vec<u32> = frames.into_iter().collect();
        let set = TangentSet { frames, joints: Some(joints.to_vec()), tangent: None };
        let title = "Make these slopes automatic".to_owned();
        (!set.frames.is_empty()).then_some(Fix { title, op: Op::TangentSet(set) })
    }

    /// The factor by which a cubic may be faster between frames than at frames. Over L frames at
    /// least 1 - (4/3)/L^2 of its peak speed is seen.
    fn between_samples(&self, from: u32, to: u32, runs: &[Run]) -> f64 {
        let keys = &self.clip.keys;
        let near = runs.iter().flat_map(|run| self.intervals(from, to, run.joint));
        let cubic = near.filter(|(_, i, _)| self.clip.fill_after(&keys[*i]) == Fill::Cubic);
        let frames = cubic.map(|(last, _, next)| keys[next].frame - last).filter(|l| *l > 1);
        frames.min().map_or(1.0, |l| 1.0 / (1.0 - 4.0 / 3.0 / f64::from(l).powi(2)).max(2.0 / 3.0))
    }

    /// Slows everything down by the smallest factor that is enough after rounding to frames.
    fn slow_down(&self, from: u32, to: u32, runs: &[Run], ratio: f64) -> Option<Fix> {
        let clip = self.clip;
        let scaled = |frames: u32, factor: f64| (f64::from(frames) * factor).round();
        let way = clip.keys.first().filter(|k| from == 0 && k.frame > 0).map_or(0, |k| k.frame);
        let near: BTreeSet<(u32, usize, usize)> =
            runs.iter().flat_map(|run| self.intervals(from, to, run.joint)).collect();
        let enough = |factor: &f64| {
            scaled(way, *factor) >= f64::from(way) * ratio - 1e-6
                && near.iter().all(|&(last, i, next)| {
                    let (key, next) = (&clip.keys[i], &clip.keys[next]);
                    if next.frame <= from {
                        return true;
                    }
                    if clip.fill_after(key) == Fill::Hold {
                        return false; // a jump stays a jump
                    }
                    // A hold is scaled with its end, and may again be cut by the next key.
                    let to = scaled(next.frame, *factor);
                    let held = match key.hold {
                        1 => scaled(key.frame, *factor),
                        hold => scaled(key.frame + hold, *factor).min(to) - 1.0,
                    };
                    let room = to - held;
                    room >= f64::from(next.frame - last) * ratio - 1e-6
                })
        };
        let fine = (ratio * 100.0).ceil() / 100.0;
        // Holds grow by the frames at which they end, so short ways need a little more.
        let more = [1.0, 1.02, 1.05, 1.1, 1.15, 1.2, 1.3].map(|more| fine * more);
        let factor = more
            .into_iter()
            .chain([fine.ceil()])
            .map(|f| (f * 100.0).round() / 100.0)
            .find(enough)?;
        let length = (f64::from(clip.length) * factor).ceil();
        if length > f64::from(limits::CLIP_FRAMES) || clip.keys.is_empty() {
            return None;
        }
        let frames = clip.keys.iter().map(|k| k.frame).collect();
        let ops = vec![
            Op::ClipLength(ClipLength { length: length as u32, cut: false }),
            Op::KeysScale(KeysScale { frames, pivot: 0, factor, replace: false }),
        ];
        let title = format!("Slow the whole clip down by {factor}");
        Some(Fix { title: title.clone(), op: Op::Batch(Batch { label: title, ops }) })
    }
}

/// `1 more frame`, `2 more frames`.
fn more(frames: u32) -> String {
    format!("{frames} more {}", if frames == 1 { "frame" } else { "frames" })
}
