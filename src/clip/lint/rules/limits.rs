//! Rule: values are inside the ranges of their joints.

use crate::document::{Row, Start};
use crate::joints::JointFacts;
use crate::lint::finder::{Finder, Place, some_of};
use crate::lint::finding::{Level, Lint, Rule};
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
        for place in self.places().iter().chain(&start) {
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
            let pose = facts.iter().zip(place.row).enumerate();
            let turns = pose.filter_map(|(j, ((name, joint), value))| {
                let joint = joint.filter(|joint| joint.unit == Unit::Rad)?;
                Some((name.as_str(), j, joint, (*value)?))
            });
            if let Some(read) = degrees(turns) {
                message.push_str(
                    "; clips are in rad: are these degrees? Then check the other poses too",
                );
                fixes.splice(0..0, place.fix("Read the pose as degrees", &read));
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
}

/// The values of a pose's hinges in rad, if they look like degrees: two are beyond two turns, and
/// as degrees all are possible.
fn degrees<'a>(
    turns: impl Iterator<Item = (&'a str, usize, &'a JointFacts, f64)>,
) -> Option<Vec<(&'a str, usize, f64)>> {
    let mut beyond = 0;
    let mut read = Vec::new();
    for (name, j, joint, degrees) in turns {
        let [lo, hi] = joint.range.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        let q = degrees.to_radians();
        if q < lo - 1e-6 || q > hi + 1e-6 {
            return None;
        }
        beyond += usize::from(degrees.abs() > TURNS);
        read.push((name, j, q));
    }
    (beyond >= 2).then_some(read)
}
