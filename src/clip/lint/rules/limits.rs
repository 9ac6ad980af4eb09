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
        let in_degrees = self.in_degrees(places.iter().chain(&start));
        for place in places.iter().chain(&start) {
            let mut out = Vec::new();
            let mut words = Vec::new();
            for (j, ((name, joint), value)) in facts.iter().zip(place.row).enumerate() {
                let Some(joint) = joint else { continue };
                let (Some(v), Some([lo, hi])) = (*value, joint.range) else { continue };
                // The grid of the document is 1e-6; a limit of pi/2 must accept 1.570796.
                if v < lo - 1e-6 || v > hi + 1e-6 {
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
            if let Some(read) = in_degrees.as_ref().filter(|_| degrees(self.turns(place)).is_some())
            {
                message.push_str(
                    "; clips are in rad: are these degrees? Then check the other poses too",
                );
                fixes.insert(0, read.clone());
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
            });
        }
    }

    /// The hinges of a pose with their values as they are written.
    fn turns<'p>(&'p self, place: &'p Place<'_>) -> impl Iterator<Item = Turn<'p>> {
        let row = self.clip.robot.joints.iter().zip(place.row).enumerate();
        row.filter_map(|(at, (name, value))| {
            let joint = self.table.joint(name).filter(|joint| joint.unit == Unit::Rad)?;
            Some(Turn { name, at, joint, value: (*value)? })
        })
    }

    /// The edit that reads poses as degrees: if one looks so, all poses that are outside of the
    /// limits and would be inside as degrees. One by one, those with small values would be clamped.
    fn in_degrees<'p>(&self, places: impl Iterator<Item = &'p Place<'p>>) -> Option<Fix> {
        let (mut edits, mut evident) = (Vec::new(), false);
        for place in places {
            let outside = |t: Turn<'_>| {
                t.joint.range.is_some_and(|[lo, hi]| !(lo - 1e-6..=hi + 1e-6).contains(&t.value))
            };
            if !self.turns(place).any(outside) {
                continue;
            }
            let Some(read) = degrees(self.turns(place)) else { continue };
            evident |= read.iter().filter(|(_, _, _, value)| value.abs() > TURNS).count() >= 2;
            let values: Vec<_> = read.iter().map(|(name, at, q, _)| (*name, *at, *q)).collect();
            match (place.pointer.as_str(), &self.clip.start) {
                ("/start/q", Some(Start::Q(q))) => {
                    let mut q = q.clone();
                    values.iter().for_each(|(_, at, value)| q[*at] = round(*value));
                    edits.push(Op::ClipStart(ClipStart { start: Some(Start::Q(q)) }));
                }
                _ => edits.extend(place.fix("", &values).into_iter().map(|fix| fix.op)),
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

/// A hinge of a pose.
struct Turn<'a> {
    name: &'a str,
    /// Its place in the row.
    at: usize,
    joint: &'a JointFacts,
    /// As it is written, rad or by mistake degrees.
    value: f64,
}

/// The name and place of each hinge, its value in rad if it is written in degrees, and the value as
/// it is written.
type Read<'a> = Vec<(&'a str, usize, f64, f64)>;

/// The hinges of a pose, read as degrees; `None` if they would be outside of their ranges.
fn degrees<'a>(turns: impl Iterator<Item = Turn<'a>>) -> Option<Read<'a>> {
    let each = |Turn { name, at, joint, value }: Turn<'a>| {
        let [lo, hi] = joint.range.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        let q = value.to_radians();
        (lo - 1e-6..=hi + 1e-6).contains(&q).then_some((name, at, q, value))
    };
    turns.map(each).collect()
}
