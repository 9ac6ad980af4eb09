//! Rule: joints can follow typed slopes, and the curves stay inside the ranges.

use crate::document::{Fill, Key};
use crate::joints::JointFacts;
use crate::lint::finder::{Finder, some_of};
use crate::lint::finding::{Fix, Level, Lint, Rule};
use crate::op::{Batch, FillSet, Op, TangentSet};
use crate::tangent::Tangent;

/// Joints of a finding, what is said about each, and the edits that mend it.
#[derive(Default)]
struct Offenders {
    joints: Vec<String>,
    words: Vec<String>,
    ops: Vec<Op>,
}

impl Finder<'_> {
    pub(in crate::lint) fn tangents(&mut self) {
        for i in 0..self.clip.keys.len() {
            self.slopes(i);
            self.overshoot(i);
        }
    }

    /// The key at which the curve of a joint ends that begins at key `i`.
    fn curve_to(&self, i: usize, joint: usize) -> Option<usize> {
        let (tracks, is_cubic) =
            (self.command.tracks(), |k| self.clip.fill_after(k) == Fill::Cubic);
        self.clip.keys.get(i).filter(|k| is_cubic(k) && tracks.has(i, joint))?;
        tracks.next(i, joint)
    }

    /// Whether a curve of a joint ends at key `i`, and whether one begins there.
    fn curves(&self, i: usize, joint: usize) -> (bool, bool) {
        let before = self.command.tracks().before(i, joint);
        let ends = before.is_some_and(|b| self.curve_to(b, joint) == Some(i));
        (ends, self.curve_to(i, joint).is_some())
    }

    /// Slopes that are faster than their joints, or that shape no curve.
    fn slopes(&mut self, i: usize) {
        let Some(key) = self.clip.keys.get(i) else { return };
        let (mut fast, mut idle) = (Offenders::default(), Vec::new());
        for (joint, tangent) in &key.tangents {
            let Some(j) = self.clip.joint(joint) else { continue };
            let (before, after) = self.curves(i, j);
            if !before && !after {
                idle.push(j);
            }
            let (Some([arriving, leaving]), Some(fact)) =
                (tangent.typed(), self.table.joint(joint))
            else {
                continue;
            };
            let Some(max) = fact.speed_max.filter(|m| *m > 0.0) else { continue };
            let slope = match (before, after) {
                (true, true) => arriving.abs().max(leaving.abs()),
                (true, false) => arriving.abs(),
                (false, true) => leaving.abs(),
                (false, false) => continue,
            };
            if slope > max * (1.0 + 1e-6) {
                let unit = fact.unit.symbol();
                fast.words.push(format!("{joint} {slope:.2} of {max:.2} {unit}/s"));
                fast.joints.push(joint.clone());
                // Rounded down to the document's grid.
                let most = (max * 1e6).floor() / 1e6;
                fast.ops.push(set(
                    &[key.frame],
                    joint,
                    Some(tangent.map(|s| s.clamp(-most, most))),
                ));
            }
        }
        self.without_curve(i, key, &idle);
        let Some(first) = fast.joints.first().cloned() else { return };
        self.add(
            Level::Warning,
            Rule::JointSpeed,
            format!("key at frame {}: slope too steep: {}", key.frame, some_of(&fast.words)),
            [key.frame, key.frame + 1],
            format!("/keys/{i}/tangents/{}", crate::json::escape_step(&first)),
            vec![fix("Limit the slope to the joint's speed", fast.ops)],
            fast.joints,
        );
    }

    /// Tangents of key `i` for joints of which no curve begins or ends there.
    fn without_curve(&mut self, i: usize, key: &Key, idle: &[usize]) {
        if idle.is_empty() {
            return;
        }
        let joints: Vec<String> = idle.iter().map(|j| self.clip.robot.joints[*j].clone()).collect();
        let of = if joints.len() < key.tangents.len() {
            format!(" of {}", some_of(&joints))
        } else {
            String::new()
        };
        let frames = vec![key.frame];
        let mut fixes = Vec::new();
        let tracks = self.command.tracks();
        if idle.iter().all(|j| tracks.has(i, *j) && tracks.next(i, *j).is_some()) {
            let fill = FillSet { frames: Some(frames.clone()), fill: Some(Fill::Cubic) };
            fixes.push(Fix { title: "Fill with a cubic curve".to_owned(), op: Op::FillSet(fill) });
        }
        let none = TangentSet { frames, joints: Some(joints.clone()), tangent: None };
        fixes.push(Fix { title: "Remove the tangents".to_owned(), op: Op::TangentSet(none) });
        self.add(
            Level::Info,
            Rule::Hidden,
            format!(
                "the tangents{of} at frame {} have no effect: no cubic curve begins or ends there",
                key.frame
            ),
            [key.frame, key.frame + 1],
            format!("/keys/{i}/tangents"),
            fixes,
            joints,
        );
    }

    /// Curves with set slopes that leave the range of their joint after key `i`.
    fn overshoot(&mut self, i: usize) {
        let keys = &self.clip.keys;
        let Some(key) = keys.get(i).filter(|k| self.clip.fill_after(k) == Fill::Cubic) else {
            return;
        };
        let (mut out, mut last) = (Offenders::default(), key.frame);
        for (j, joint) in self.clip.robot.joints.iter().enumerate() {
            let Some(next) = self.curve_to(i, j).and_then(|n| keys.get(n)) else { continue };
            let shaped = [key, next].into_iter().filter(|k| k.tangents.contains_key(joint));
            let shaped: Vec<u32> = shaped.map(|k| k.frame).collect();
            let Some(fact) = self.table.joint(joint).filter(|_| !shaped.is_empty()) else {
                continue;
            };
            let end = self.command.tracks().hold_end(self.clip, i, j);
            if let Some((v, [lo, hi])) = self.farthest(end..next.frame, j, fact) {
                let unit = fact.unit.symbol();
                out.words.push(format!("{joint} {v:.3} is outside {lo}..{hi} {unit}"));
                out.joints.push(joint.clone());
                out.ops.push(set(&shaped, joint, None));
                last = last.max(next.frame);
            }
        }
        if out.joints.is_empty() {
            return;
        }
        self.add(
            Level::Error,
            Rule::JointLimit,
            format!("the curve after frame {} overshoots: {}", key.frame, some_of(&out.words)),
            [key.frame, last + 1],
            format!("/keys/{i}"),
            vec![fix("Make these slopes automatic", out.ops)],
            out.joints,
        );
    }

    /// The goal of these frames that is farthest outside the joint's range, and the range.
    fn farthest(
        &self,
        frames: std::ops::Range<u32>,
        joint: usize,
        fact: &JointFacts,
    ) -> Option<(f64, [f64; 2])> {
        let [lo, hi] = fact.range?;
        let goals = frames.filter(|t| self.command.sees(*t, joint));
        let goals = goals.filter_map(|t| self.command.row(t).get(joint).map(|v| f64::from(*v)));
        let far = |v: &f64| (lo - v).max(v - hi);
        let worst = goals.max_by(|a, b| far(a).total_cmp(&far(b)))?;
        // A curve that runs along a limit is off by the rounding of its goals to f32.
        (far(&worst) > 2e-6 * (1.0 + worst.abs())).then_some((worst, [lo, hi]))
    }

    fn add(
        &mut self,
        level: Level,
        rule: Rule,
        message: String,
        frames: [u32; 2],
        pointer: String,
        fixes: Vec<Fix>,
        joints: Vec<String>,
    ) {
        if !self.full(rule) {
            let (frames, settled) = (Some(frames), None);
            self.push(Lint {
                level,
                rule,
                message,
                frames,
                joints,
                pointer,
                fixes,
                settled,
                unlisted: 0,
            });
        }
    }
}

fn set(frames: &[u32], joint: &str, tangent: Option<Tangent>) -> Op {
    let joints = Some(vec![joint.to_owned()]);
    Op::TangentSet(TangentSet { frames: frames.to_vec(), joints, tangent })
}

fn fix(title: &str, mut ops: Vec<Op>) -> Fix {
    let op = match (ops.pop(), ops.is_empty()) {
        (Some(one), true) => one,
        (last, _) => {
            ops.extend(last);
            Op::Batch(Batch { label: title.to_owned(), ops })
        }
    };
    Fix { title: title.to_owned(), op }
}
