//! Problems of the open clip, and what simulation says of its poses.

use std::collections::BTreeMap;

use super::super::error::Error;
use super::super::protocol::{Event, Findings};
use super::super::worker::{Checked, Report, Request};
use super::{Ask, Desk, JUDGED_AT_ONCE, VERDICTS};
use crate::clip::{self, PoseChecker, PoseReport};

impl Desk {
    /// Problems and timeline, and the poses that simulation has not judged yet.
    pub(super) fn findings(&self) -> (Findings, Vec<Vec<f64>>) {
        let Some(document) = &self.document else { return (Findings::default(), Vec::new()) };
        let table = self.table();
        let (clip, command) = (document.clip(), document.command());
        let mut judge = Judge {
            names: table.names(),
            tolerance: self.facts.as_ref().map_or(0.05, |f| f.settle_tolerance),
            verdicts: &self.verdicts,
            unknown: Vec::new(),
        };
        let checker: Option<&mut dyn PoseChecker> =
            if self.facts.is_some() { Some(&mut judge) } else { None };
        let lints = clip::lint(clip, command, &table, checker);
        let findings = Findings {
            rev: document.rev(),
            lints,
            spans: command.spans().to_vec(),
            blind: command.blind_spans(),
            simulated: judge.unknown.is_empty(),
            granularity: self.granularity,
        };
        (findings, judge.unknown)
    }

    /// Tells everyone the findings and lets the simulation judge what is new.
    pub(super) fn tell_findings(&mut self) {
        if self.document.is_none() {
            return;
        }
        let (findings, mut unknown) = self.findings();
        self.hub.send(&Event::Findings(findings));
        let Some(facts) = &self.facts else { return };
        unknown.truncate(JUDGED_AT_ONCE);
        if unknown.is_empty() || self.judging {
            return;
        }
        self.judging = true;
        let robot = facts.source.clone();
        let inbox = self.inbox.clone();
        let request = Request::Check { robot: robot.clone(), poses: unknown.clone() };
        self.worker.ask_with(request, move |verdicts| {
            inbox.send(Ask::Judged { robot, poses: unknown, verdicts }).ok();
        });
    }

    pub(super) fn judged(
        &mut self,
        robot: &str,
        poses: &[Vec<f64>],
        verdicts: Result<Report, Error>,
    ) {
        self.judging = false;
        if self.facts.as_ref().is_none_or(|f| f.source != robot) {
            self.tell_findings();
            return;
        }
        let verdicts = match verdicts {
            Ok(Report::Checked(verdicts)) => verdicts,
            // A pose that kills the simulation must not be asked about again and again.
            _ => vec![Checked::default(); poses.len()],
        };
        if self.verdicts.len() > VERDICTS {
            self.verdicts.clear();
        }
        for (pose, verdict) in poses.iter().zip(verdicts) {
            self.verdicts.insert(bits(pose), verdict);
        }
        self.tell_findings();
    }
}

fn bits(pose: &[f64]) -> Vec<u64> {
    pose.iter().map(|v| v.to_bits()).collect()
}

/// Answers lints from what simulation has said so far.
struct Judge<'a> {
    /// Joints in state order.
    names: Vec<String>,
    tolerance: f64,
    verdicts: &'a BTreeMap<Vec<u64>, Checked>,
    unknown: Vec<Vec<f64>>,
}

impl PoseChecker for Judge<'_> {
    fn check(&mut self, joints: &[String], q: &[f64]) -> PoseReport {
        let place = |name: &String| joints.iter().position(|j| j == name);
        let pose: Option<Vec<f64>> =
            self.names.iter().map(|n| place(n).and_then(|i| q.get(i).copied())).collect();
        let Some(pose) = pose else { return PoseReport::default() };
        let Some(verdict) = self.verdicts.get(&bits(&pose)) else {
            if !self.unknown.contains(&pose) {
                self.unknown.push(pose);
            }
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
