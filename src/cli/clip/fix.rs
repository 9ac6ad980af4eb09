//! `robert clip check --fix`: applies fixes as long as each leaves fewer findings, and reports the
//! changes.

use std::cmp::Ordering;
use std::collections::HashSet;

use serde::Serialize;

use super::super::bar::Bar;
use super::super::failure::{Failure, Outcome};
use super::simulate::Simulation;
use crate::clip::{
    Batch, Clip, Command, Fix, JointTable, KeysSet, Level, Lint, Op, Rule, compile_for, edited,
    lint,
};
use crate::exit::Exit;
use crate::progress::{Cancel, Progress as _};

/// The most rounds, in each of which one fix is applied, or many together.
const ROUNDS: usize = 1000;

/// From this number on, fixes of the values of keys are tried together.
const MANY: usize = 8;

/// The most clips that are checked to find fixes one by one. A long recording with a thousand findings takes
/// a minute then.
const CHECKS: usize = 4000;

/// The most fixes that change nothing for the better by themselves, after which others are tried.
const FIRSTS: usize = 6;
/// The most others that are tried after each of them.
const PARTNERS: usize = 12;

/// The most kinds of fixes that the report names one by one.
const SAID: usize = 12;

/// The longest that a clip becomes, as a multiple of its length, or in frames if it is short. A pose
/// that is far off by mistake must not stretch the clip out of shape.
const STRETCH: u32 = 2;
const SHORT: u32 = 400;

/// The changes that were made to a clip.
#[derive(Debug, Default, Serialize)]
pub(super) struct Fixed {
    /// Titles of the fixes in the order of their first use, and how often each was applied.
    pub fixes: Vec<(String, usize)>,
    /// Frames before and after.
    pub length: [u32; 2],
    /// Goals (a joint at a frame), before and after.
    pub goals: [usize; 2],
    /// A fix that was not applied, because the clip would become too long.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub left_out: Option<String>,
    /// Findings with fixes of which none was applied, because it would lead to others, or change the
    /// timing.
    pub kept: usize,
    /// Whether so many fixes were tried that others were not.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub gave_up: bool,
}

impl Fixed {
    pub(super) fn count(&self) -> usize {
        self.fixes.iter().map(|f| f.1).sum()
    }

    /// The lines to print about the fixes.
    pub(super) fn lines(&self) -> Vec<String> {
        let mut lines = match self.count() {
            0 => vec!["nothing was fixed".to_owned()],
            n => vec![format!("fixed {n}")],
        };
        lines.extend(self.fixes.iter().take(SAID).map(|(title, n)| match n {
            1 => format!("    {title}"),
            n => format!("    {title} ({n} times)"),
        }));
        match self.fixes.len().saturating_sub(SAID) {
            0 => {}
            1 => lines.push("    and one other".to_owned()),
            more => lines.push(format!("    and {more} others")),
        }
        let secs = |frames: u32| f64::from(frames) / f64::from(crate::units::FPS);
        let [before, after] = self.length;
        if before != after {
            lines.push(format!(
                "    the clip now lasts {} frames ({:.2} s), before {before} ({:.2} s)",
                after,
                secs(after),
                secs(before)
            ));
        }
        if let Some(title) = &self.left_out {
            lines.push(format!(
                "    left out: \"{title}\" would make the clip more than {STRETCH} times as long; check the poses first"
            ));
        }
        match self.kept {
            0 => {}
            n if self.gave_up => lines.push(format!(
                "    {n} findings are left: after {CHECKS} tries no more were made; run it again"
            )),
            1 => lines.push("    one finding is left whose fix would leave another".to_owned()),
            n => lines.push(format!("    {n} findings are left whose fixes would leave others")),
        }
        if self.goals[1] < self.goals[0] {
            lines.push(format!(
                "    {} of {} goals (a joint at a frame) were removed",
                self.goals[0] - self.goals[1],
                self.goals[0]
            ));
        }
        lines
    }
}

/// A clip after some fixes, and what is still wrong with it.
struct Repaired {
    titles: Vec<String>,
    clip: Clip,
    lints: Vec<Lint>,
}

/// Finds what is wrong with clips, with or without simulation.
pub(super) struct Finder<'a> {
    table: &'a JointTable,
    simulation: Option<Simulation<'a>>,
    bar: &'a Bar,
    cancel: &'a Cancel,
    /// Clips checked so far.
    checks: usize,
}

impl<'a> Finder<'a> {
    pub(super) fn new(
        table: &'a JointTable,
        simulation: Option<Simulation<'a>>,
        bar: &'a Bar,
        cancel: &'a Cancel,
    ) -> Finder<'a> {
        Finder { table, simulation, bar, cancel, checks: 0 }
    }
}

impl Finder<'_> {
    /// What is wrong with a clip.
    ///
    /// # Errors
    /// A clip that cannot be compiled; an interruption.
    pub(super) fn find(&mut self, clip: &Clip) -> Outcome<Vec<Lint>> {
        self.go_on()?;
        self.checks += 1;
        let command = compile_for(clip, Some(self.table)).map_err(Failure::invalid)?;
        match &mut self.simulation {
            Some(simulation) => simulation.lint(clip, &command, self.table),
            None => Ok(lint(clip, &command, self.table, None)),
        }
    }

    /// An error if the command was interrupted.
    fn go_on(&self) -> Outcome {
        if self.cancel.is_cancelled() {
            return Err(Failure::with(Exit::Interrupted, "interrupted; this clip was not changed"));
        }
        Ok(())
    }

    /// Applies fixes as long as each reduces the number of findings.
    pub(super) fn fix(
        &mut self,
        clip: &Clip,
        lints: Vec<Lint>,
    ) -> Outcome<(Clip, Vec<Lint>, Fixed)> {
        let before = compile_for(clip, Some(self.table)).map_err(Failure::invalid)?;
        self.prepare(clip, &lints)?;
        let longest = (STRETCH * clip.length).max(SHORT);
        let (total, mut left_out) = (bad(&lints), None);
        if self.simulation.is_none() {
            self.bar.phase("fix", "findings");
        }
        let mut now = Repaired { titles: Vec::new(), clip: clip.clone(), lints };
        let mut search = Search { longest, ..Search::default() };
        for _ in 0..ROUNDS {
            if self.simulation.is_none() {
                self.bar.tick(total.saturating_sub(bad(&now.lints)) as u64, total as u64, "");
            }
            let mut values = of_values(&now.lints);
            values.retain(|fix| search.together.insert(words(fix)));
            let before = now.titles.len();
            now = self.together(now, &values)?;
            if now.titles.len() > before {
                continue;
            }
            let before = search.left_out.take();
            let step = self.step(&now.clip, &now.lints, &mut search)?;
            // The last step may have tried nothing.
            left_out = search.left_out.clone().or(before.filter(|_| search.gave_up));
            let Some(next) = step else { break };
            let titles = [now.titles, next.titles].concat();
            now = Repaired { titles, ..next };
        }
        let Repaired { titles: applied, clip, lints } = now;
        let mut titles: Vec<(String, usize)> = Vec::new();
        for title in applied {
            match titles.iter_mut().find(|t| t.0 == title) {
                Some(t) => t.1 += 1,
                None => titles.push((title, 1)),
            }
        }
        let after = compile_for(&clip, Some(self.table)).map_err(Failure::invalid)?;
        let fixed = Fixed {
            fixes: titles,
            length: [before.frames(), after.frames()],
            goals: [goals(&before), goals(&after)],
            kept: lints.iter().filter(|l| l.level > Level::Info && !l.fixes.is_empty()).count(),
            left_out,
            gave_up: search.gave_up,
        };
        Ok((clip, lints, fixed))
    }

    /// Simulates the poses that the fixes would make, all at once.
    fn prepare(&mut self, clip: &Clip, lints: &[Lint]) -> Outcome {
        let Some(simulation) = &mut self.simulation else { return Ok(()) };
        let bad = lints.iter().filter(|l| l.level > Level::Info);
        let firsts = bad.filter_map(|l| l.fixes.first());
        let mut clips = Vec::new();
        for next in firsts.filter_map(|fix| edited(clip, &fix.op, Some(self.table)).ok()) {
            let command = compile_for(&next, Some(self.table)).map_err(Failure::invalid)?;
            clips.push((next, command));
        }
        simulation.prepare(&clips, self.table)
    }

    /// The clip after these fixes, if there are as many findings less; otherwise after each half of them for which this
    /// holds.
    fn together(&mut self, now: Repaired, fixes: &[Fix]) -> Outcome<Repaired> {
        if fixes.len() < MANY || self.checks > CHECKS {
            return Ok(now);
        }
        let ops = fixes.iter().map(|fix| fix.op.clone()).collect();
        let all = Op::Batch(Batch { label: String::new(), ops });
        if let Ok(clip) = edited(&now.clip, &all, Some(self.table)) {
            let lints = self.find(&clip)?;
            let fixed = bad(&lints) + fixes.len() <= bad(&now.lints);
            if fixed && weight(&lints) < weight(&now.lints) {
                let mut titles = now.titles;
                titles.extend(fixes.iter().map(|fix| fix.title.clone()));
                return Ok(Repaired { titles, clip, lints });
            }
        }
        let (first, second) = fixes.split_at(fixes.len() / 2);
        let now = self.together(now, first)?;
        self.together(now, second)
    }

    /// The clip after the first fix that reduces the number of findings and keeps it within the longest
    /// length, or after two fixes that do so together. Fixes that did not help before come last.
    fn step(
        &mut self,
        clip: &Clip,
        lints: &[Lint],
        search: &mut Search,
    ) -> Outcome<Option<Repaired>> {
        let mut level = Vec::new();
        let (again, new): (Vec<&Fix>, Vec<&Fix>) =
            each(lints).partition(|fix| search.useless.contains(&words(fix)));
        for one in new.into_iter().chain(again) {
            let Some(next) = self.apply(clip, one, search)? else { continue };
            match weight(&next.lints).cmp(&weight(lints)) {
                Ordering::Less => return Ok(Some(next)),
                Ordering::Equal if level.len() < FIRSTS => level.push(next),
                Ordering::Equal | Ordering::Greater => {}
            }
            search.useless.insert(words(one));
        }
        // A pose that was stored may need another fix before it is right.
        for first in level {
            for second in each(&first.lints).take(PARTNERS) {
                let Some(mut next) = self.apply(&first.clip, second, search)? else { continue };
                if weight(&next.lints) < weight(lints) {
                    next.titles.splice(0..0, first.titles);
                    return Ok(Some(next));
                }
            }
        }
        Ok(None)
    }

    /// The clip after a fix; `None` if it cannot be applied, makes the clip too long, or too much was tried.
    fn apply(&mut self, clip: &Clip, fix: &Fix, search: &mut Search) -> Outcome<Option<Repaired>> {
        if self.checks > CHECKS {
            search.gave_up = true;
            return Ok(None);
        }
        self.go_on()?;
        let Ok(next) = edited(clip, &fix.op, Some(self.table)) else {
            search.useless.insert(words(fix));
            return Ok(None);
        };
        if next.length > search.longest {
            search.left_out.get_or_insert(fix.title.clone());
            return Ok(None);
        }
        let lints = self.find(&next)?;
        Ok(Some(Repaired { titles: vec![fix.title.clone()], clip: next, lints }))
    }
}

/// What is known while fixes are tried one by one.
#[derive(Default)]
struct Search {
    /// The longest that the clip may become, frames.
    longest: u32,
    /// A fix that was not applied, because the clip would become longer.
    left_out: Option<String>,
    /// Whether fixes were left untried.
    gave_up: bool,
    /// Fixes that were tried together.
    together: HashSet<String>,
    /// Fixes that did not help when they were tried one by one.
    useless: HashSet<String>,
}

/// A fix in words that no other one has.
fn words(fix: &Fix) -> String {
    serde_json::to_string(&fix.op).unwrap_or_default()
}

/// The first fixes of findings that only change values of keys, none of them twice.
fn of_values(lints: &[Lint]) -> Vec<Fix> {
    let mut taken = HashSet::new();
    let firsts = lints.iter().filter(|l| l.level > Level::Info).filter_map(|l| l.fixes.first());
    let values = firsts.filter(|fix| match &fix.op {
        Op::KeysSet(KeysSet { frame, values, .. }) => {
            let places: Vec<_> = values.keys().map(|joint| (*frame, joint.as_str())).collect();
            let is_free = !places.is_empty() && places.iter().all(|place| !taken.contains(place));
            taken.extend(places);
            is_free
        }
        _ => false,
    });
    values.cloned().collect()
}

/// The fixes of all findings that are more than a remark. A key that is held longer leaves less time
/// for the way to the next, so that is for a person to choose.
fn each(lints: &[Lint]) -> impl Iterator<Item = &Fix> {
    let fixes = lints.iter().filter(|l| l.level > Level::Info).flat_map(|l| &l.fixes);
    fixes.filter(|fix| !matches!(fix.op, Op::KeysHold(_)))
}

/// The order in which findings count: first errors, then speeds, then the other warnings. Two fixes that
/// trade one finding for another then do not undo each other for ever.
fn weight(lints: &[Lint]) -> (usize, usize, usize) {
    (
        count(lints, &|l| l.level == Level::Error),
        count(lints, &|l| l.rule == Rule::JointSpeed),
        count(lints, &|l| l.level == Level::Warning),
    )
}

/// The number of such findings, with those that are not listed because there are too many of their rule.
fn count(lints: &[Lint], is: &dyn Fn(&Lint) -> bool) -> usize {
    let all = |rest: &Lint| {
        let like = lints.iter().find(|l| l.rule == rest.rule && l.unlisted == 0);
        if rest.unlisted == 0 {
            usize::from(is(rest))
        } else {
            like.map_or(0, |l| rest.unlisted * usize::from(is(l)))
        }
    };
    lints.iter().map(all).sum()
}

/// The number of findings that are more than a remark.
fn bad(lints: &[Lint]) -> usize {
    count(lints, &|l| l.level > Level::Info)
}

fn goals(command: &Command) -> usize {
    let frame = |f| (0..command.dim()).filter(|&j| command.sees(f, j)).count();
    (0..command.frames()).map(frame).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clip::{Key, RobotRef};
    use crate::robot::Robot;

    /// A recording of the hand in which two joints of each tendon are apart at every frame.
    fn recording(robot: &Robot, frames: u32) -> Clip {
        let (id, joints) = (robot.id().to_owned(), robot.joints());
        let joints: Vec<String> = joints.iter().map(|j| j.name.clone()).collect();
        let bent = |frame: u32| 0.5 + 0.1 * (f64::from(frame) / 10.0).sin();
        let row = |frame: u32| {
            let value = |name: &String| if name.ends_with("J2") { bent(frame) } else { 0.0 };
            joints.iter().map(value).collect::<Vec<f64>>()
        };
        let clip = RobotRef { id, joints: joints.clone(), ..RobotRef::default() };
        let mut clip = Clip::new(clip, frames);
        clip.keys = (0..frames).map(|frame| Key::new(frame, &row(frame))).collect();
        clip
    }

    #[test]
    fn a_recording_with_hundreds_of_findings_is_fixed_at_once() {
        let robot = Robot::builtin("shadow_hand").unwrap();
        let clip = recording(&robot, 80);
        let table = super::super::files::joint_table(&clip, Some(&robot));
        let (bar, cancel) = (Bar::new("settle", "poses", true), Cancel::default());
        let mut finder = Finder::new(&table, None, &bar, &cancel);
        let lints = finder.find(&clip).unwrap();
        let findings = bad(&lints);
        assert!(findings >= 80, "{findings}");
        let (clip, left, fixed) = finder.fix(&clip, lints).unwrap();
        assert_eq!((bad(&left), fixed.kept), (0, 0), "{left:?}");
        assert!(fixed.count() >= 80, "{fixed:?}");
        assert!(finder.checks < 40, "{} clips were checked", finder.checks);
        // It can be stopped.
        cancel.cancel();
        assert!(finder.find(&clip).is_err());
    }
}
