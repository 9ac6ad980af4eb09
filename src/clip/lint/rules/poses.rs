//! Rule: the robot reaches the poses without touching itself.

use crate::joints::{Coupling, JointFacts};
use crate::lint::finder::{Finder, Place, some_of};
use crate::lint::finding::{Fix, Level, Lint, PoseChecker, Rule, SettledPose};
use robert_kinematics::Loops;

/// The number of keys for some joints only that are simulated; each takes about a hundredth of a second.
const LED: usize = 500;

impl Finder<'_> {
    pub(in crate::lint) fn poses(&mut self, checker: &mut dyn PoseChecker) {
        let joints = &self.clip.robot.joints;
        let mut lints = Vec::new();
        let mut led = 0;
        let together = self.together();
        for place in self.places() {
            // Joints that are left free are simulated where the goals around the key lead them.
            let whole = self.with_followers(place.row);
            let is_whole = whole.is_some();
            if !is_whole && !self.is_led(place.row, &together) {
                continue;
            }
            led += usize::from(!is_whole);
            let free = || (led <= LED).then(|| self.led(&place)).flatten();
            let Some(q) = whole.or_else(free) else { continue };
            let is_asked = |joint: usize| place.row[joint].is_some();
            let report = checker.check(joints, &q);
            // Free joints may move out of each other's way.
            if is_whole && !report.contacts.is_empty() {
                let words: Vec<String> = report
                    .contacts
                    .iter()
                    .map(|(a, b, depth)| format!("{a} and {b} by {:.1} mm", depth * 1e3))
                    .collect();
                lints.push(Lint {
                    level: Level::Warning,
                    rule: Rule::SelfCollision,
                    message: format!("{}: {} overlap", place.who(), some_of(&words)),
                    frames: place.span(),
                    joints: Vec::new(),
                    pointer: place.pointer.clone(),
                    fixes: store(&place, joints, report.settled.as_deref()),
                    settled: None,
                    unlisted: 0,
                });
            }
            let Some(reached) = &report.settled else { continue };
            if !is_whole && !report.contacts.is_empty() {
                continue;
            }
            let mut off: Vec<(&String, f64)> = joints
                .iter()
                .zip(q.iter().zip(reached).map(|(a, b)| (a - b).abs()))
                .enumerate()
                .filter(|(i, (_, residual))| is_asked(*i) && *residual > checker.tolerance())
                .map(|(_, off)| off)
                .collect();
            off.sort_by(|a, b| b.1.total_cmp(&a.1));
            let Some((joint, distance)) = off.first().map(|(j, r)| ((*j).clone(), *r)) else {
                continue;
            };
            let unit = |joint: &str| self.table.joint(joint).map_or("", |j| j.unit.symbol());
            let words: Vec<String> =
                off.iter().map(|(j, r)| format!("{j} by {r:.3} {}", unit(j))).collect();
            lints.push(Lint {
                level: Level::Warning,
                rule: Rule::Unreachable,
                message: format!(
                    "{}: the robot does not reach the pose: {}",
                    place.who(),
                    some_of(&words)
                ),
                frames: place.span(),
                joints: off.iter().map(|(j, _)| (*j).clone()).collect(),
                pointer: place.pointer.clone(),
                fixes: store(&place, joints, Some(reached)),
                settled: Some(SettledPose {
                    held: self.held(&place),
                    asked: q,
                    q: reached.clone(),
                    joint,
                    distance,
                }),
                unlisted: 0,
            });
        }
        for lint in lints {
            self.push(lint);
        }
    }

    /// Whether goals around a key lead the joints that it leaves free. Joints that move along with those that the key
    /// asks for do not: by a tendon, in a closed loop, or by something else than a motor of their own, they go where
    /// these need them.
    fn is_led(&self, row: &[Option<f64>], together: &[Vec<&String>]) -> bool {
        let has = |joint: &str| {
            self.clip.joint(joint).is_some_and(|at| row.get(at).is_some_and(Option::is_some))
        };
        let split = |group: &Vec<&String>| {
            let asked = group.iter().filter(|j| has(j)).count();
            asked > 0 && asked < group.len()
        };
        let alone = |fact: &JointFacts| !together.iter().any(|group| group.contains(&&fact.name));
        let is_odd = |fact: &JointFacts| !fact.moves_alone && !has(&fact.name) && alone(fact);
        !together.iter().any(split) && !self.table.joints.iter().any(is_odd)
    }

    /// Joints that move together, as far as the table says: those of each closed loop, and those of each coupling.
    fn together(&self) -> Vec<Vec<&String>> {
        let name = |at: &usize| self.table.joints.get(*at).map(|fact| &fact.name);
        let loops = self.table.kinematics.as_ref().map(|tree| Loops::new(tree).joints());
        let loops = loops.into_iter().flatten();
        let loops = loops.map(|joints| joints.iter().filter_map(name).collect());
        let couplings = self.table.couplings.iter();
        let couplings = couplings.map(|c| c.members.iter().map(|m| &m.joint).collect());
        loops.chain(couplings).collect()
    }

    /// The row of a key with joints that it leaves free on their line between other goals; `None` for a pose that no
    /// key uses.
    fn led(&self, place: &Place<'_>) -> Option<Vec<f64>> {
        let led = self.command.interpolated(*place.frames.first()?);
        let row = place.row.iter().zip(led);
        Some(row.map(|(own, led)| own.unwrap_or_else(|| f64::from(led))).collect())
    }

    /// A row in which joints that follow others get the values that these give them; `None` if others are
    /// left free.
    fn with_followers(&self, row: &[Option<f64>]) -> Option<Vec<f64>> {
        let mut whole = row.to_vec();
        let free = |row: &[Option<f64>]| row.iter().filter(|q| q.is_none()).count();
        // A follower may lead another one, so this is repeated.
        loop {
            let before = free(&whole);
            self.table.followers().for_each(|coupling| self.follow(coupling, &mut whole));
            if free(&whole) == before {
                return whole.into_iter().collect();
            }
        }
    }

    /// Fills in the free joints of a coupling of which one joint has a value.
    fn follow(&self, coupling: &Coupling, row: &mut [Option<f64>]) {
        let members = || coupling.members.iter().filter(|m| m.coef != 0.0);
        let at = |joint: &str| self.clip.joint(joint);
        let shared = members().find_map(|m| {
            let value = row.get(at(&m.joint)?).copied().flatten()?;
            Some((value - m.offset) / m.coef)
        });
        for m in members() {
            if let (Some(shared), Some(at)) = (shared, at(&m.joint))
                && let Some(slot @ None) = row.get_mut(at)
            {
                let q = m.coef * shared + m.offset;
                *slot = Some(self.table.joint(&m.joint).map_or(q, |j| j.clamp(q)));
            }
        }
    }

    /// The frames at which keys command a row.
    fn held(&self, place: &Place<'_>) -> Vec<[u32; 2]> {
        let keys = &self.clip.keys;
        let of = |frame: &u32| keys.binary_search_by_key(frame, |k| k.frame).ok();
        let spans = place.frames.iter().filter_map(of);
        spans.map(|i| [keys[i].frame, self.clip.hold_end(i)]).collect()
    }
}

/// Stores what is reached, of the joints that have a value.
fn store(place: &Place<'_>, joints: &[String], reached: Option<&[f64]>) -> Vec<Fix> {
    let Some(reached) = reached else { return Vec::new() };
    let all = joints.iter().zip(reached).enumerate();
    let asked = all.filter(|(i, _)| place.row.get(*i).is_some_and(Option::is_some));
    let values: Vec<(&str, usize, f64)> = asked.map(|(i, (j, v))| (j.as_str(), i, *v)).collect();
    place.fix("Store the pose that is reached", &values)
}
