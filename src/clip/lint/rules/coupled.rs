//! Rule: joints that share an actuator have values that the actuator can reach.

use crate::joints::Coupling;
use crate::lint::finder::{Finder, Place};
use crate::lint::finding::{Level, Lint, Rule};

/// By how much rounded numbers may exceed a tolerance: .4 - .3 is a little more than .1 in binary.
const ROUNDING: f64 = 1e-6;

impl Finder<'_> {
    pub(in crate::lint) fn coupled(&mut self) {
        let mut lints = Vec::new();
        for place in self.places() {
            let all = self.table.couplings.iter();
            let mut here: Vec<_> = all.filter_map(|c| self.coupled_in(&place, c)).collect();
            here.sort_by(|a, b| b.0.total_cmp(&a.0));
            lints.extend(here.into_iter().map(|(_, lint)| lint));
        }
        for lint in lints {
            self.push(lint);
        }
    }

    /// How far apart the joints of a coupling are, and the warning about it; `None` if the actuator reaches them.
    fn coupled_in(&self, place: &Place<'_>, coupling: &Coupling) -> Option<(f64, Lint)> {
        let mut shared = Vec::new();
        for member in &coupling.members {
            let at = self.clip.joint(&member.joint)?;
            let q = place.row.get(at).copied().flatten();
            if member.coef != 0.0
                && let Some(q) = q
            {
                shared.push((member, at, (q - member.offset) / member.coef));
            }
        }
        let values = || shared.iter().map(|s| s.2);
        let (lo, hi) = (values().fold(f64::MAX, f64::min), values().fold(f64::MIN, f64::max));
        if shared.len() < 2 || hi - lo <= coupling.tolerance + ROUNDING {
            return None;
        }
        let mean = values().sum::<f64>() / shared.len() as f64;
        let even: Vec<(&str, usize, f64)> = shared
            .iter()
            .map(|(m, at, _)| {
                let q = m.coef * mean + m.offset;
                let q = self.table.joint(&m.joint).map_or(q, |j| j.clamp(q));
                (m.joint.as_str(), *at, q)
            })
            .collect();
        let joints: Vec<String> = shared.iter().map(|s| s.0.joint.clone()).collect();
        let first = shared.first().map_or(0, |s| s.1);
        let lint = Lint {
            level: Level::Warning,
            rule: Rule::Coupled,
            message: format!(
                "{}: {}",
                place.who(),
                if shared.iter().all(|s| (s.0.coef, s.0.offset) == (1.0, 0.0)) {
                    let joints = joints.join(" and ");
                    format!("{joints} share {} and cannot be {:.3} apart", coupling.name, hi - lo)
                } else {
                    let way = even.iter().map(|(joint, _, q)| format!("{joint} {q:.3}"));
                    format!(
                        "{} move together and cannot meet these goals at once; together they could be {}",
                        joints.join(" and "),
                        way.collect::<Vec<_>>().join(" and ")
                    )
                }
            ),
            frames: place.span(),
            joints,
            pointer: format!("{}/{first}", place.pointer),
            fixes: place.fix("Split evenly", &even),
            settled: None,
            unlisted: 0,
        };
        Some((hi - lo, lint))
    }
}
