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

    /// Whether a cubic curve begins at key `i` and ends at the next.
    fn is_cubic(&self, i: usize) -> bool {
        let keys = &self.clip.keys;
        i + 1 < keys.len() && keys.get(i).is_some_and(|k| self.clip.fill_after(k) == Fill::Cubic)
    }

    /// Slopes that are faster than their joints, or that shape no curve.
    fn slopes(&mut self, i: usize) {
        let Some(key) = self.clip.keys.get(i).filter(|k| !k.tangents.is_empty()) else { return };
        let (before, after) =
            (i.checked_sub(1).is_some_and(|b| self.is_cubic(b)), self.is_cubic(i));
        if !before && !after {
            self.without_curve(i, key);
            return;
        }
        let mut fast = Offenders::default();
        for (joint, tangent) in &key.tangents {
            let (Some([arriving, leaving]), Some(fact)) =
                (tangent.typed(), self.table.joint(joint))
            else {
                continue;
            };
            let Some(max) = fact.speed_max.filter(|m| *m > 0.0) else { continue };
            let slope = match (before, after) {
                (true, true) => arriving.abs().max(leaving.abs()),
                (true, false) => arriving.abs(),
                _ => leaving.abs(),
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

    fn without_curve(&mut self, i: usize, key: &Key) {
        let frames = vec![key.frame];
        let mut fixes = Vec::new();
        if i + 1 < self.clip.keys.len() {
            let fill = FillSet { frames: Some(frames.clone()), fill: Some(Fill::Cubic) };
            fixes.push(Fix { title: "Fill with a cubic curve".to_owned(), op: Op::FillSet(fill) });
        }
        let none = TangentSet { frames, joints: None, tangent: None };
        fixes.push(Fix { title: "Remove the tangents".to_owned(), op: Op::TangentSet(none) });
        self.add(
            Level::Info,
            Rule::Hidden,
            format!(
                "the tangents at frame {} have no effect: no cubic curve begins or ends there",
                key.frame
            ),
            [key.frame, key.frame + 1],
            format!("/keys/{i}/tangents"),
            fixes,
            key.tangents.keys().cloned().collect(),
        );
    }

    /// A curve with set slopes that leaves a joint's range between its keys.
    fn overshoot(&mut self, i: usize) {
        let keys = &self.clip.keys;
        let (Some(key), Some(next), true) = (keys.get(i), keys.get(i + 1), self.is_cubic(i)) else {
            return;
        };
        let mut out = Offenders::default();
        for (j, joint) in self.clip.robot.joints.iter().enumerate() {
            let shaped = [key, next].into_iter().filter(|k| k.tangents.contains_key(joint));
            let shaped: Vec<u32> = shaped.map(|k| k.frame).collect();
            let Some(fact) = self.table.joint(joint).filter(|_| !shaped.is_empty()) else {
                continue;
            };
            if let Some((v, [lo, hi])) = self.farthest(self.clip.hold_end(i)..next.frame, j, fact) {
                let unit = fact.unit.symbol();
                out.words.push(format!("{joint} {v:.3} is outside {lo}..{hi} {unit}"));
                out.joints.push(joint.clone());
                out.ops.push(set(&shaped, joint, None));
            }
        }
        if out.joints.is_empty() {
            return;
        }
        self.add(
            Level::Error,
            Rule::JointLimit,
            format!("the curve after frame {} overshoots: {}", key.frame, some_of(&out.words)),
            [key.frame, next.frame + 1],
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
            self.push(Lint { level, rule, message, frames, joints, pointer, fixes, settled });
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
