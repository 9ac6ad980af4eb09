//! Checks poses by simulation, on all cores. Each pose is simulated once, however often its clip is
//! checked.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::super::bar::Bar;
use super::super::failure::{Failure, Outcome};
use crate::clip::{Clip, Command, JointTable, Lint, PoseChecker, PoseReport, lint};
use crate::exit::Exit;
use crate::parallel;
use crate::progress::{Cancel, Progress as _};
use crate::robot::Robot;
use crate::rollout::Settler;

/// The results for the poses of one clip so far.
pub(super) struct Simulation<'a> {
    robot: &'a Robot,
    threads: usize,
    bar: &'a Bar,
    cancel: &'a Cancel,
    known: BTreeMap<Vec<u64>, PoseReport>,
}

/// Answers from known results, and collects the poses that have none.
struct Asking<'a> {
    known: &'a BTreeMap<Vec<u64>, PoseReport>,
    unknown: BTreeMap<Vec<u64>, Vec<f64>>,
    tolerance: f64,
}

impl PoseChecker for Asking<'_> {
    fn check(&mut self, _joints: &[String], q: &[f64]) -> PoseReport {
        let key: Vec<u64> = q.iter().map(|v| v.to_bits()).collect();
        if let Some(report) = self.known.get(&key) {
            return report.clone();
        }
        self.unknown.insert(key, q.to_vec());
        PoseReport::default()
    }

    fn tolerance(&self) -> f64 {
        self.tolerance
    }
}

impl<'a> Simulation<'a> {
    pub(super) fn new(
        robot: &'a Robot,
        threads: usize,
        bar: &'a Bar,
        cancel: &'a Cancel,
    ) -> Simulation<'a> {
        Simulation { robot, threads, bar, cancel, known: BTreeMap::new() }
    }

    /// Every finding about a clip.
    pub(super) fn lint(
        &mut self,
        clip: &Clip,
        command: &Command,
        table: &JointTable,
    ) -> Outcome<Vec<Lint>> {
        loop {
            let (lints, unknown) = self.ask(clip, command, table);
            if unknown.is_empty() {
                return Ok(lints);
            }
            self.learn(&clip.robot.joints, unknown)?;
        }
    }

    /// Simulates the poses of all these clips together, so that no core is idle.
    pub(super) fn prepare(&mut self, clips: &[(Clip, Command)], table: &JointTable) -> Outcome {
        let mut unknown = BTreeMap::new();
        for (clip, command) in clips {
            unknown.extend(self.ask(clip, command, table).1);
        }
        match clips.first() {
            Some((clip, _)) => self.learn(&clip.robot.joints, unknown),
            None => Ok(()),
        }
    }

    fn ask(
        &self,
        clip: &Clip,
        command: &Command,
        table: &JointTable,
    ) -> (Vec<Lint>, BTreeMap<Vec<u64>, Vec<f64>>) {
        let tolerance = self.robot.profile().settle.tolerance;
        let mut asking = Asking { known: &self.known, unknown: BTreeMap::new(), tolerance };
        let lints = lint(clip, command, table, Some(&mut asking));
        (lints, asking.unknown)
    }

    /// Settles the poses without a result.
    fn learn(&mut self, joints: &[String], poses: BTreeMap<Vec<u64>, Vec<f64>>) -> Outcome {
        let poses: Vec<(Vec<u64>, Vec<f64>)> = poses.into_iter().collect();
        if !poses.is_empty() {
            self.bar.phase("settle", "poses");
        }
        let (done, total) = (self.known.len() as u64, (self.known.len() + poses.len()) as u64);
        let (next, finished) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let work = || -> Outcome<Vec<(usize, PoseReport)>> {
            let mut settler = Settler::new(self.robot)?;
            let mut mine = Vec::new();
            loop {
                let at = next.fetch_add(1, Ordering::Relaxed);
                let Some((_, q)) = poses.get(at) else { return Ok(mine) };
                if self.cancel.is_cancelled() {
                    return Err(Failure::with(
                        Exit::Interrupted,
                        "interrupted; this clip was not changed",
                    ));
                }
                mine.push((at, settler.check(joints, q)));
                let n = finished.fetch_add(1, Ordering::Relaxed) as u64 + 1;
                self.bar.tick(done + n, total, "");
            }
        };
        for part in parallel::on_threads(self.threads.min(poses.len()), work) {
            for (at, report) in part? {
                self.known.insert(poses[at].0.clone(), report);
            }
        }
        Ok(())
    }
}
