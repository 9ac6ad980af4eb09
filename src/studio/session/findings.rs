//! Problems of the open clip, and the simulation's findings about its poses.

use std::collections::{BTreeMap, BTreeSet};

use super::actor::SessionActor;
use super::command::SessionCommand;
use crate::protocol::{Error, Event, Findings};
use crate::simulation::Unreached;
use crate::simulation::worker::{CheckPoses, Checked};
use robert_clip as clip;
use robert_clip::{PoseChecker, PoseReport};

/// Different poses of one clip that are judged.
const JUDGED: usize = 4_000;

/// The number of poses that are checked in one request. It is small, so that other questions need
/// not wait long.
const JUDGED_AT_ONCE: usize = 4;

impl SessionActor {
    /// Problems and timeline, and the poses that the simulation has not checked yet.
    pub(crate) fn findings(&self) -> (Findings, Vec<Vec<f64>>) {
        let Some(shown) = &self.shown else { return (Findings::default(), Vec::new()) };
        let table = self.table();
        let (clip, command) = (shown.clip(), shown.command());
        let robot = self.simulation.robot();
        let mut judge = Judge {
            names: table.names(),
            tolerance: robot.as_ref().map_or(0.05, |r| r.settle_tolerance),
            verdicts: &self.judgement.verdicts,
            seen: BTreeSet::new(),
            unknown: Vec::new(),
            complete: true,
        };
        let checker: Option<&mut dyn PoseChecker> =
            if robot.is_some() { Some(&mut judge) } else { None };
        let lints = clip::lint(clip, command, &table, checker);
        let findings = Findings {
            rev: shown.version.rev,
            lints,
            spans: command.spans().to_vec(),
            blind: command.blind_spans(),
            simulated: judge.complete,
            granularity: self.choice.granularity,
        };
        (findings, judge.unknown)
    }

    /// Sends the findings to all clients and lets the simulation check new poses.
    pub(crate) fn tell_findings(&mut self) {
        if self.shown.is_none() {
            return;
        }
        let (findings, unknown) = self.findings();
        self.simulation.rollout.set_unreached(self.unreached(&findings));
        self.hub.send(&Event::Findings(findings));
        let Some(robot) = self.simulation.robot() else { return };
        if unknown.is_empty() || self.judgement.asking {
            return;
        }
        self.judgement.asking = true;
        let robot = robot.source.clone();
        let inbox = self.inbox.clone();
        let question = CheckPoses { robot: robot.clone(), poses: unknown.clone() };
        self.simulation.ask_with(question, move |verdicts| {
            inbox.send(SessionCommand::Judged { robot, poses: unknown, verdicts }).ok();
        });
    }

    /// The poses of the clip that the robot cannot hold, in state order.
    fn unreached(&self, findings: &Findings) -> Vec<Unreached> {
        let Some(shown) = &self.shown else { return Vec::new() };
        let joints = &shown.clip().robot.joints;
        let names = self.table().names();
        let ordered = |q: &[f64]| {
            let value = |name| q.get(joints.iter().position(|j| j == name)?).copied();
            names.iter().map(value).collect::<Option<Vec<f64>>>()
        };
        let settled = findings.lints.iter().filter_map(|l| l.settled.as_ref());
        let poses = settled.filter_map(|s| {
            Some(Unreached {
                held: s.held.clone(),
                asked: ordered(&s.asked)?,
                rests: ordered(&s.q)?,
            })
        });
        poses.collect()
    }

    pub(crate) fn judged(
        &mut self,
        robot: &str,
        poses: &[Vec<f64>],
        verdicts: Result<Vec<Checked>, Error>,
    ) {
        self.judgement.asking = false;
        if self.simulation.robot().is_none_or(|r| r.source != robot) {
            self.tell_findings();
            return;
        }
        let known = &mut self.judgement;
        // Those of the clip before this edit and after it fit.
        if known.verdicts.len() >= 2 * JUDGED {
            known.verdicts.clear();
        }
        // A pose that kills the simulation must not be sent to it again: after a few deaths it stays away.
        let verdicts = verdicts.unwrap_or_else(|_| vec![Checked::default(); poses.len()]);
        known.verdicts.extend(poses.iter().map(|pose| bits(pose)).zip(verdicts));
        self.tell_findings();
    }
}

fn bits(pose: &[f64]) -> Vec<u64> {
    pose.iter().map(|v| v.to_bits()).collect()
}

/// Answers the lints' questions with the simulation's findings so far.
struct Judge<'a> {
    /// Joints in state order.
    names: Vec<String>,
    tolerance: f64,
    verdicts: &'a BTreeMap<Vec<u64>, Checked>,
    /// The different poses so far.
    seen: BTreeSet<Vec<u64>>,
    /// The first few without a verdict.
    unknown: Vec<Vec<f64>>,
    /// Whether all have a verdict.
    complete: bool,
}

impl PoseChecker for Judge<'_> {
    fn check(&mut self, joints: &[String], q: &[f64]) -> PoseReport {
        let place = |name: &String| joints.iter().position(|j| j == name);
        let pose: Option<Vec<f64>> =
            self.names.iter().map(|n| place(n).and_then(|i| q.get(i).copied())).collect();
        let Some(pose) = pose else { return PoseReport::default() };
        let mark = bits(&pose);
        let is_new = !self.seen.contains(&mark);
        if is_new && self.seen.len() == JUDGED {
            self.complete = false;
            return PoseReport::default();
        }
        let verdict = self.verdicts.get(&mark);
        if is_new {
            self.seen.insert(mark);
            if verdict.is_none() && self.unknown.len() < JUDGED_AT_ONCE {
                self.unknown.push(pose);
            }
        }
        let Some(verdict) = verdict else {
            self.complete = false;
            return PoseReport::default();
        };
        let settled = verdict.settled.as_ref().map(|state| {
            joints
                .iter()
                .zip(q)
                .map(|(j, own)| {
                    let at = self.names.iter().position(|n| n == j);
                    at.and_then(|i| state.get(i).copied()).unwrap_or(*own)
                })
                .collect()
        });
        PoseReport { contacts: verdict.contacts.clone(), settled }
    }

    fn tolerance(&self) -> f64 {
        self.tolerance
    }
}
