//! Rule: values are inside the ranges of their joints.

use crate::document::{Row, Start};
use crate::grid::round;
use crate::joints::JointFacts;
use crate::lint::finder::{Finder, Place, some_of};
use crate::lint::finding::{Fix, Level, Lint, Rule};
use crate::op::{Batch, ClipStart, Op};
use robert_base::units::Unit;

/// Two turns, rad: beyond what a pose in rad needs.
const TURNS: f64 = 12.6;
/// How far a pose that is read as degrees may be beyond the limits, rad: 20 degrees.
const BEYOND: f64 = 0.35;

impl Finder<'_> {
    pub(in crate::lint) fn limits(&mut self) {
        let start: Option<Row> = match &self.clip.start {
            Some(Start::Q(q)) => Some(q.iter().copied().map(Some).collect()),
            _ => None,
        };
        let start = start.as_ref().map(|row| Place {
            row,
            pointer: "/start/q".to_owned(),
            pose: None,
            frames: vec![],
            is_solved: false,
        });
        let names = &self.clip.robot.joints;
        let facts: Vec<_> = names.iter().map(|name| (name, self.table.joint(name))).collect();
        let places = self.places();
        // The edit of all poses together is offered once, at the first of them.
        let mut in_degrees = self.in_degrees(places.iter().chain(&start));
        let evident = in_degrees.is_some();
        for place in places.iter().chain(&start) {
            let mut out = Vec::new();
            let mut words = Vec::new();
            for (j, ((name, joint), value)) in facts.iter().zip(place.row).enumerate() {
                let Some(joint) = joint else { continue };
                let (Some(v), Some([lo, hi])) = (*value, joint.range) else { continue };
                if !inside(joint, v) {
                    out.push((name.as_str(), j, joint.clamp(v)));
                    let unit = joint.unit.symbol();
                    words.push(format!("{name} {v} is outside {lo}..{hi} {unit}"));
                }
            }
            if out.is_empty() || self.full(Rule::JointLimit) {
                continue;
            }
            let first = out.first().map_or(0, |o| o.1);
            let mut message = format!("{}: {}", place.who(), some_of(&words));
            let mut fixes = place.fix("Clamp to the limits", &out);
            if evident && self.degrees(place).is_some() {
                message.push_str(
                    "; clips are in rad: are these degrees? Then check the other poses too",
                );
                fixes.splice(0..0, in_degrees.take());
            }
            self.push(Lint {
                level: Level::Error,
                rule: Rule::JointLimit,
                message,
                frames: place.span(),
                joints: out.iter().map(|o| o.0.to_owned()).collect(),
                pointer: format!("{}/{first}", place.pointer),
                fixes,
                settled: None,
                unlisted: 0,
            });
        }
    }

    /// The hinges of a pose, read as degrees: name, place and value in rad. `None` if one would be
    /// more than [`BEYOND`] outside of its range, or if the values were solved, which gives rad.
    fn degrees(&self, place: &Place<'_>) -> Option<Vec<(&str, usize, f64)>> {
        let row = self.clip.robot.joints.iter().zip(place.row).enumerate();
        let hinges = row.filter_map(|(at, (name, value))| {
            let joint = self.table.joint(name).filter(|joint| joint.unit == Unit::Rad)?;
            Some((name.as_str(), at, joint, (*value)?.to_radians()))
        });
        let read =
            hinges.map(|(name, at, joint, q)| inside_by(joint, q, BEYOND).then_some((name, at, q)));
        if place.is_solved { None } else { read.collect() }
    }

    /// The edit that reads poses as degrees: if one looks so, all poses that are outside of the
    /// limits and would be inside as degrees. One by one, those with small values would be clamped.
    fn in_degrees<'p>(&self, places: impl Iterator<Item = &'p Place<'p>>) -> Option<Fix> {
        let (mut edits, mut evident) = (Vec::new(), false);
        for place in places {
            let Some(read) = self.degrees(place) else { continue };
            let written = |at: usize| place.row.get(at).copied().flatten().unwrap_or(0.0);
            let fits = |(name, at, _): &(&str, usize, f64)| {
                self.table.joint(name).is_none_or(|joint| inside(joint, written(*at)))
            };
            if read.iter().all(fits) {
                continue;
            }
            evident |= read.iter().filter(|(_, at, _)| written(*at).abs() > TURNS).count() >= 2;
            match (&self.clip.start, place.pose, place.frames.first()) {
                (Some(Start::Q(q)), None, None) => {
                    let mut q = q.clone();
                    read.iter().for_each(|(_, at, value)| q[*at] = round(*value));
                    edits.push(Op::ClipStart(ClipStart { start: Some(Start::Q(q)) }));
                }
                _ => edits.extend(place.fix("", &read).into_iter().map(|fix| fix.op)),
            }
        }
        let title = match edits.len() {
            0 | 1 => "Read the pose as degrees".to_owned(),
            n => format!("Read {n} poses as degrees"),
        };
        let op = match (edits.pop()?, edits.is_empty()) {
            (one, true) => one,
            (last, false) => {
                edits.push(last);
                Op::Batch(Batch { label: title.clone(), ops: edits })
            }
        };
        evident.then_some(Fix { title, op })
    }
}

/// Whether a value is in the range of a joint. The grid of the document is 1e-6; a limit of pi/2 must
/// accept 1.570796.
fn inside(joint: &JointFacts, value: f64) -> bool {
    inside_by(joint, value, 1e-6)
}

/// Whether a value is less than `margin` outside of the range of a joint.
fn inside_by(joint: &JointFacts, value: f64, margin: f64) -> bool {
    joint.range.is_none_or(|[lo, hi]| (lo - margin..=hi + margin).contains(&value))
}
