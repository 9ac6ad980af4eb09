//! Rules: offsets keep joints inside their ranges, and there is a goal that they are added to.

use std::collections::BTreeMap;

use crate::lint::finder::{Finder, some_of};
use crate::lint::finding::{Fix, Level, Lint, Rule};
use crate::offset::total;
use crate::op::{KeysFrames, OffsetsSet, Op};

/// The grid of the document.
const GRID: f64 = 1e-6;

impl Finder<'_> {
    pub(in crate::lint) fn offsets(&mut self) {
        let (clip, command) = (self.clip, self.command);
        let added = total(&clip.offsets, &clip.robot.joints, clip.length);
        let dim = clip.dim();
        for (i, offset) in clip.offsets.iter().enumerate() {
            let mut words = Vec::new();
            let mut least: BTreeMap<String, Option<f64>> = BTreeMap::new();
            let mut meets_goal = false;
            for (name, &value) in &offset.add {
                let Some(j) = clip.joint(name) else { continue };
                let range = self.table.joint(name).and_then(|f| f.range);
                // The most that may be added for all frames to stay inside, and the worst of them.
                let (mut most, mut worst) = (value, None::<f64>);
                for frame in offset.span(clip.length) {
                    if !command.sees(frame, j) {
                        continue;
                    }
                    meets_goal = true;
                    let Some([lo, hi]) = range else { continue };
                    let now = f64::from(command.row(frame)[j]);
                    let base = now - added[frame as usize * dim + j];
                    let beyond = if now > hi + GRID { now - hi } else { (now - lo).min(0.0) };
                    // What the keys themselves say is found there.
                    let is_inside = (lo - GRID..=hi + GRID).contains(&base);
                    if beyond.abs() <= GRID || !is_inside || beyond * value < 0.0 {
                        continue;
                    }
                    let allowed = value - beyond / offset.weight(frame);
                    most = if value > 0.0 { most.min(allowed) } else { most.max(allowed) };
                    worst = worst.filter(|w| w.abs() >= beyond.abs()).or(Some(beyond));
                }
                if let (Some(beyond), Some(fact)) = (worst, self.table.joint(name)) {
                    let (beyond, unit) = (beyond.abs(), fact.unit.symbol());
                    words.push(format!("{name} goes {beyond:.3} {unit} beyond its range"));
                    // A little less than the most: values are rounded to the grid.
                    let fitting =
                        if most * value > 0.0 { most - GRID * value.signum() } else { 0.0 };
                    least.insert(name.clone(), Some(fitting));
                }
            }
            let (span, pointer) = (offset.span(clip.length), format!("/offsets/{i}"));
            let frames = Some([span.start, span.end]);
            let frame = offset.frame;
            if !meets_goal {
                let op = Op::OffsetsDelete(KeysFrames { frames: vec![frame] });
                self.push(Lint {
                    level: Level::Info,
                    rule: Rule::Hidden,
                    message: format!(
                        "the offset at frame {frame} changes nothing: no goal is near"
                    ),
                    frames,
                    joints: offset.add.keys().cloned().collect(),
                    pointer,
                    fixes: vec![Fix { title: "Delete the offset".to_owned(), op }],
                    settled: None,
                    unlisted: 0,
                });
            } else if !words.is_empty() && !self.full(Rule::JointLimit) {
                let joints = least.keys().cloned().collect();
                let op = Op::OffsetsSet(OffsetsSet { frame, add: least, ..OffsetsSet::default() });
                self.push(Lint {
                    level: Level::Error,
                    rule: Rule::JointLimit,
                    message: format!("offset at frame {frame}: {}", some_of(&words)),
                    frames,
                    joints,
                    pointer: format!("{pointer}/add"),
                    fixes: vec![Fix { title: "Add only as much as fits".to_owned(), op }],
                    settled: None,
                    unlisted: 0,
                });
            }
        }
    }

    /// The edit that makes the offset over these frames grow and fade over a multiple of its
    /// frames.
    pub(super) fn softer(&self, from: u32, to: u32, joints: &[String], ratio: f64) -> Option<Fix> {
        let length = self.clip.length;
        let covers = |o: &&crate::offset::Offset| {
            let span = o.span(length);
            span.start <= to && span.end >= from && joints.iter().any(|j| o.add.contains_key(j))
        };
        let offset = self.clip.offsets.iter().find(covers)?;
        let wider = |frames: u32| Some((f64::from(frames.max(1)) * ratio).ceil() as u32);
        let set = OffsetsSet {
            frame: offset.frame,
            fade_in: wider(offset.fade_in),
            fade_out: wider(offset.fade_out),
            ..OffsetsSet::default()
        };
        let title = format!("Let the offset at frame {} fade over more frames", offset.frame);
        Some(Fix { title, op: Op::OffsetsSet(set) })
    }
}
