//! `robert clip check --fix`: applies fixes as long as each leaves fewer findings, and reports the
//! changes.

use std::cmp::Ordering;

use serde::Serialize;

use super::super::failure::{Failure, Outcome};
use super::simulate::Simulation;
use crate::clip::{
    Clip, Command, Fix, JointTable, Level, Lint, Op, Rule, compile_for, edited, lint,
};

/// The most fixes to apply. Each removes a finding, and some lead to another one.
const FIXES: usize = 1000;

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
    pub table: &'a JointTable,
    pub simulation: Option<Simulation<'a>>,
}

impl Finder<'_> {
    pub(super) fn find(&mut self, clip: &Clip) -> Outcome<Vec<Lint>> {
        let command = compile_for(clip, Some(self.table)).map_err(Failure::invalid)?;
        match &mut self.simulation {
            Some(simulation) => simulation.lint(clip, &command, self.table),
            None => Ok(lint(clip, &command, self.table, None)),
        }
    }

    /// Applies fixes as long as each reduces the number of findings.
    pub(super) fn fix(
        &mut self,
        clip: &Clip,
        lints: Vec<Lint>,
    ) -> Outcome<(Clip, Vec<Lint>, Fixed)> {
        let before = compile_for(clip, Some(self.table)).map_err(Failure::invalid)?;
        let (mut clip, mut lints) = (clip.clone(), lints);
        self.prepare(&clip, &lints)?;
        let mut titles: Vec<(String, usize)> = Vec::new();
        let longest = (STRETCH * clip.length).max(SHORT);
        let mut left_out = None;
        for _ in 0..FIXES {
            left_out = None;
            let step = self.step(&clip, &lints, longest, &mut left_out)?;
            let Some(Repaired { titles: applied, clip: next, lints: found }) = step else { break };
            for title in applied {
                match titles.iter_mut().find(|t| t.0 == title) {
                    Some(t) => t.1 += 1,
                    None => titles.push((title, 1)),
                }
            }
            (clip, lints) = (next, found);
        }
        let after = compile_for(&clip, Some(self.table)).map_err(Failure::invalid)?;
        let fixed = Fixed {
            fixes: titles,
            length: [before.frames(), after.frames()],
            goals: [goals(&before), goals(&after)],
            kept: lints.iter().filter(|l| l.level > Level::Info && !l.fixes.is_empty()).count(),
            left_out,
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

    /// The clip after the first fix that reduces the number of findings and keeps it within
    /// `longest` frames, or after two fixes that do so together. A longer one is `left_out`.
    fn step(
        &mut self,
        clip: &Clip,
        lints: &[Lint],
        longest: u32,
        left_out: &mut Option<String>,
    ) -> Outcome<Option<Repaired>> {
        let mut level = Vec::new();
        for one in each(lints) {
            let Some(next) = self.apply(clip, one, longest, left_out)? else { continue };
            match weight(&next.lints).cmp(&weight(lints)) {
                Ordering::Less => return Ok(Some(next)),
                Ordering::Equal => level.push(next),
                Ordering::Greater => {}
            }
        }
        // A pose that was stored may need another fix before it is right.
        for first in level.into_iter().take(FIRSTS) {
            for second in each(&first.lints).take(PARTNERS) {
                let Some(mut next) = self.apply(&first.clip, second, longest, left_out)? else {
                    continue;
                };
                if weight(&next.lints) < weight(lints) {
                    next.titles.splice(0..0, first.titles);
                    return Ok(Some(next));
                }
            }
        }
        Ok(None)
    }

    /// The clip after a fix; `None` if it cannot be applied, or makes the clip too long.
    fn apply(
        &mut self,
        clip: &Clip,
        fix: &Fix,
        longest: u32,
        left_out: &mut Option<String>,
    ) -> Outcome<Option<Repaired>> {
        let Ok(next) = edited(clip, &fix.op, Some(self.table)) else { return Ok(None) };
        if next.length > longest {
            left_out.get_or_insert(fix.title.clone());
            return Ok(None);
        }
        let lints = self.find(&next)?;
        Ok(Some(Repaired { titles: vec![fix.title.clone()], clip: next, lints }))
    }
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
    let count = |is: &dyn Fn(&Lint) -> bool| lints.iter().filter(|l| is(l)).count();
    (
        count(&|l| l.level == Level::Error),
        count(&|l| l.rule == Rule::JointSpeed),
        count(&|l| l.level == Level::Warning),
    )
}

fn goals(command: &Command) -> usize {
    let frame = |f| (0..command.dim()).filter(|&j| command.sees(f, j)).count();
    (0..command.frames()).map(frame).sum()
}
