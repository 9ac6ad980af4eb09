//! A random search for a better motion of a clip, one part after another.
//!
//! Tries branch from the best motion, several at once, and end as soon as they cannot become better
//! ([`super::detour`]). They are simulated up to the end of their part ([`super::parts`]); then the rest of the clip
//! follows once, and the search goes on in the next part.

use std::collections::VecDeque;
use std::ops::Range;

use super::detour::{self, Detours, Try};
use super::error::Error;
use super::jam::Off;
use super::judge::Judge;
use super::natural::{unnatural, unnatural_until};
use super::parts::{counted, parts};
use super::run::Rollout;

/// The number of checks of a part.
const CHECKS: usize = 4;
/// The share of the clip's error that the search of a part must gain between two checks to go on, roughly.
const GAINS: f64 = 0.0005;
/// A search under a strict judge may simulate a share of the frames: one in so many.
const STRICT: usize = 2;
/// Tries that are simulated at once, from the same motion. The number is fixed, so that the result does not
/// depend on the number of threads.
pub(super) const AT_ONCE: usize = 4;
/// Frames by which one step advances each try.
const CHUNK: usize = 8;
/// The largest number of frames that a search may simulate, for a robot of 24 joints (80 s of a clip).
const MOST: usize = 128_000;

/// A try.
struct Attempt {
    rollout: Rollout,
    what: Try,
    going: bool,
}

/// A search that improves a motion.
pub(super) struct Search {
    judge: Judge,
    threads: usize,
    /// The motion so far, simulated up to the end of the part at least.
    motion: Rollout,
    /// Whether it has changed since it was offered.
    changed: bool,
    /// The complete motion to which it goes back where it leads nowhere; `None` until the first one is complete.
    kept: Option<Rollout>,
    /// The parts that are still to be searched, with the frames that each may simulate; the first one is
    /// searched now.
    parts: VecDeque<(Range<usize>, usize)>,
    /// The search of the first of them; `None` while the rest of the clip follows.
    part: Option<Part>,
    attempts: Vec<Attempt>,
    /// Rollouts for more of them.
    spare: Vec<Rollout>,
    frames: usize,
}

/// The search of a part.
struct Part {
    frames: Range<usize>,
    /// The frames whose errors count: those, and the ones before them at which a policy sees their goals.
    counted: Range<usize>,
    detours: Detours,
    /// The limit for the usual sum.
    limit: f64,
    /// The score of the motion.
    least: f64,
    /// The penalty up to the end of the part.
    gaps: f64,
    /// The frames that it may still simulate.
    budget: usize,
    /// The budget at which it ends unless it has gained enough since the last such check, and the score then.
    check: (usize, f64),
    check_every: usize,
    /// The share that it must gain.
    gains: f64,
}

impl Part {
    /// Searches a part of a motion; `None` if there is nothing to improve.
    fn new(motion: &Rollout, judge: &Judge, frames: Range<usize>, budget: usize) -> Option<Part> {
        let detours = Detours::new(motion, judge, frames.clone());
        let counted = counted(&frames);
        let limit = judge.limit(motion, &counted);
        let least = judge.score_part(motion, &counted, f64::INFINITY)?;
        let gaps = unnatural_until(motion, frames.end);
        let check_every = budget / CHECKS;
        let check = (budget - check_every, least);
        let gains = GAINS * motion.frames() as f64 / (frames.len() + 1) as f64;
        (!detours.is_idle()).then_some(Part {
            frames,
            counted,
            detours,
            limit,
            least,
            gaps,
            budget,
            check,
            check_every,
            gains,
        })
    }

    /// Whether it has gained too little for its time.
    fn stalls(&mut self) -> bool {
        let (at, score) = self.check;
        if self.budget > at {
            return false;
        }
        self.check = (self.budget.saturating_sub(self.check_every), self.least);
        self.least > (1.0 - self.gains) * score
    }
}

impl Search {
    /// Searches about the motion `best`, or, if there is none, about that without corrections. `fresh` makes a
    /// rollout at its beginning.
    ///
    /// # Errors
    /// As `fresh`.
    pub(super) fn new(
        best: Option<&Rollout>,
        judge: &Judge,
        threads: usize,
        fresh: impl Fn() -> Result<Rollout, Error>,
    ) -> Result<Search, Error> {
        let mut motion = fresh()?;
        let mut kept = None;
        if let Some(best) = best {
            motion.copy(best)?;
            kept.insert(fresh()?).copy(best)?;
        }
        // One for each try, two for what is offered (the best motion so far, and a better one), and one for
        // what is kept.
        let spare = (0..AT_ONCE + 3).map(|_| fresh()).collect::<Result<_, Error>>()?;
        let mut search = Search {
            judge: judge.clone(),
            threads,
            motion,
            changed: false,
            kept,
            parts: VecDeque::new(),
            part: None,
            attempts: Vec::new(),
            spare,
            frames: 0,
        };
        search.divide(|_| true, 1);
        Ok(search)
    }

    /// Searches again about the motion `best` and by another judge, in the parts with a jam.
    ///
    /// # Errors
    /// As [`Rollout::step`].
    pub(super) fn again(
        &mut self,
        best: &Rollout,
        judge: &Judge,
        jams: &[Off],
    ) -> Result<(), Error> {
        self.spare.extend(self.attempts.drain(..).map(|a| a.rollout));
        self.judge = judge.clone();
        self.motion.copy(best)?;
        self.changed = false;
        self.keep();
        self.divide(|part| jams.iter().any(|j| j.from < part.end && part.start < j.to), STRICT);
        Ok(())
    }

    /// Plans to search the parts that are `wanted`, in a share of the usual time.
    fn divide(&mut self, wanted: impl Fn(&Range<usize>) -> bool, share: usize) {
        let dim = self.motion.goals().dim();
        let budget = |part: &Range<usize>| detour::budget(part.len() + 1, dim) / share;
        let all = parts(self.motion.sought()).into_iter().filter(wanted);
        let mut all: VecDeque<_> = all.map(|part| (part.clone(), budget(&part))).collect();
        let (sum, most) = (all.iter().map(|p| p.1).sum::<usize>(), MOST * 24 / dim.clamp(6, 240));
        if sum > most {
            all.iter_mut().for_each(|(_, budget)| *budget = *budget * most / sum);
        }
        (self.parts, self.part) = (all, None);
    }

    /// Frames simulated so far.
    pub(super) fn frames(&self) -> usize {
        self.frames
    }

    /// Frames that tries may still simulate.
    pub(super) fn frames_left(&self) -> usize {
        let all: usize = self.parts.iter().map(|(_, budget)| budget).sum();
        let done = self.part.as_ref().map_or(0, |part| self.parts[0].1.saturating_sub(part.budget));
        all - done
    }

    /// Simulates some frames; false at the end of the search.
    pub(super) fn step(&mut self) -> bool {
        match &self.part {
            Some(_) => {
                if !self.search() {
                    (self.part, _) = (None, self.parts.pop_front());
                }
                true
            }
            None if self.motion.is_done() => self.next_part(),
            None => self.go_on(),
        }
    }

    /// The motion, if it is complete and new, and has a smaller score than `least` without a larger penalty
    /// than `gaps`.
    pub(super) fn offer(&mut self, least: f64, gaps: f64) -> Option<Rollout> {
        if !(self.motion.is_done() && std::mem::take(&mut self.changed)) {
            return None;
        }
        let score = self.judge.score(&self.motion).filter(|s| *s < least);
        score.filter(|_| unnatural(&self.motion) <= gaps)?;
        self.keep();
        let Some(mut copy) = self.spare.pop() else {
            unreachable!("some are left beside the tries")
        };
        if copy.copy(&self.motion).is_err() {
            self.spare.push(copy);
            return None;
        }
        Some(copy)
    }

    /// Whether the judge refuses a motion as a whole, as far as it is known.
    fn refuses(&self, motion: &Rollout) -> bool {
        motion.is_done() && self.judge.score(motion).is_none()
    }

    /// Remembers the motion.
    fn keep(&mut self) {
        let Some(mut copy) = self.kept.take().or_else(|| self.spare.pop()) else { return };
        if copy.copy(&self.motion).is_ok() {
            self.kept = Some(copy);
        } else {
            self.spare.push(copy);
        }
    }

    /// Returns to the motion that was kept; false if there is none.
    fn go_back(&mut self) -> bool {
        self.changed = false;
        self.kept.as_ref().is_some_and(|kept| self.motion.copy(kept).is_ok())
    }

    /// Ends the search: simulates the rest of the clip, so that what was found can be offered.
    pub(super) fn stop(&mut self) {
        (self.part, self.parts) = (None, VecDeque::new());
        while self.changed && !self.motion.is_done() && self.go_on() {}
    }

    /// Takes back a rollout that is no longer needed.
    pub(super) fn give_back(&mut self, rollout: Option<Rollout>) {
        self.spare.extend(rollout);
    }

    /// Some frames of the rest of the clip; false if the plant diverges and nothing else is known.
    fn go_on(&mut self) -> bool {
        for _ in 0..CHUNK {
            match self.motion.step() {
                Ok(Some(_)) => self.frames += 1,
                Ok(None) => break,
                Err(_) => return self.go_back(),
            }
        }
        if self.kept.is_none() && self.motion.is_done() {
            self.keep();
        }
        true
    }

    /// Begins to search the next part in which there is something to improve; false if there is none.
    fn next_part(&mut self) -> bool {
        while let Some((frames, budget)) = self.parts.front().cloned() {
            self.part = Part::new(&self.motion, &self.judge, frames, budget);
            if self.part.is_some() {
                return true;
            }
            self.parts.pop_front();
        }
        false
    }

    /// Some frames of each try; false when the search of the part is over.
    fn search(&mut self) -> bool {
        if self.attempts.iter().all(|a| !a.going) {
            self.adopt_best();
            let stalls = self.part.as_mut().is_none_or(Part::stalls);
            if stalls || !self.next_tries() {
                return false;
            }
        }
        let Some(part) = &mut self.part else { return false };
        let before: usize = self.attempts.iter().map(|a| a.rollout.simulated()).sum();
        let mut going: Vec<_> = self.attempts.iter_mut().filter(|a| a.going).collect();
        on_threads(self.threads, &mut going, |a| a.advance(&part.detours, part.frames.end));
        let frames = self.attempts.iter().map(|a| a.rollout.simulated()).sum::<usize>() - before;
        self.frames += frames;
        part.budget = part.budget.saturating_sub(frames);
        let over = part.budget == 0;
        if over {
            self.adopt_best();
        }
        !over
    }

    /// Begins the next tries; false if there is nothing to try.
    fn next_tries(&mut self) -> bool {
        let Some(part) = &mut self.part else { return false };
        for _ in 0..AT_ONCE {
            let Some(mut what) = part.detours.next(self.motion.sought()) else { break };
            let Some(mut rollout) = self.spare.pop() else { break };
            let begun = rollout.branch(&self.motion, std::mem::take(&mut what.lead));
            // A try counts as a frame, so that the search ends even if tries change nothing.
            part.budget = part.budget.saturating_sub(1);
            self.frames += 1;
            self.attempts.push(Attempt { rollout, what, going: begun.is_ok() });
        }
        !self.attempts.is_empty()
    }

    /// Goes on from the best of the tries, if one is better, and gives up the others.
    fn adopt_best(&mut self) {
        let Some(part) = &self.part else { return };
        let end = part.frames.end;
        let score = |a: &Attempt| {
            let done = a.rollout.frame() + 1 >= end;
            done.then(|| self.judge.score_part(&a.rollout, &part.counted, part.limit)).flatten()
        };
        let scores = self.attempts.iter().enumerate().filter_map(|(at, a)| Some((at, score(a)?)));
        // What the judge would refuse as a whole leads nowhere, unless it is so already.
        let lost = self.refuses(&self.motion);
        let fair = scores.filter(|(at, score)| {
            let rollout = &self.attempts[*at].rollout;
            let natural = unnatural_until(rollout, end) <= part.gaps;
            *score < part.least && natural && (lost || !self.refuses(rollout))
        });
        let best = fair.min_by(|a, b| a.1.total_cmp(&b.1));
        if let (Some((at, score)), Some(part)) = (best, &mut self.part) {
            let better = &mut self.attempts[at].rollout;
            std::mem::swap(&mut self.motion, better);
            self.changed = true;
            part.least = score;
            part.gaps = unnatural_until(&self.motion, end);
            part.detours.go_on(&self.motion);
        }
        self.spare.extend(self.attempts.drain(..).map(|a| a.rollout));
    }
}

impl Attempt {
    /// Some frames, up to that before `end`, as long as the try may still become better.
    fn advance(&mut self, detours: &Detours, end: usize) {
        for _ in 0..CHUNK {
            // The plant may diverge with a correction.
            let moved =
                self.rollout.frame() + 1 < end && matches!(self.rollout.step(), Ok(Some(_)));
            self.going = moved && detours.promises(&mut self.what, &self.rollout);
            if !self.going {
                return;
            }
        }
    }
}

/// Lets `work` be done on each item, shared among threads.
pub(super) fn on_threads<T: Send>(
    threads: usize,
    items: &mut [&mut T],
    work: impl Fn(&mut T) + Sync,
) {
    let share = items.len().div_ceil(threads).max(1);
    let each = |some: &mut [&mut T]| some.iter_mut().for_each(|item| work(item));
    std::thread::scope(|scope| {
        let mut shares = items.chunks_mut(share);
        let own = shares.next();
        let each = &each;
        shares.for_each(|some| drop(scope.spawn(move || each(some))));
        own.map(each);
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{PolicyConfig, PolicyName, RolloutConfig, Start, tasks};
    use robert_base::progress::Cancel;
    use robert_clip::{Command, compile};
    use robert_robot::Robot;
    use std::sync::Arc;

    /// A task of the point mass, so often one after another.
    fn again_and_again(task: &str, times: usize) -> (Arc<Robot>, Command) {
        let robot = Arc::new(Robot::builtin("pointmass").unwrap());
        let one = compile(&tasks::find(task, Some("pointmass")).unwrap()).unwrap();
        let frames = |_| 0..one.frames();
        let q = (0..times).flat_map(frames).flat_map(|f| one.row(f).to_vec()).collect();
        let dim = robot.state_dim();
        let sees = |f| (0..dim).map(move |j| (f, j));
        let all = (0..times).flat_map(frames).flat_map(sees);
        let seen = all.map(|(f, j)| one.sees(f, j)).collect();
        let names = robot.joints().iter().map(|j| j.name.clone()).collect();
        (robot, Command::from_dense(names, one.start().to_vec(), q, seen).unwrap())
    }

    #[test]
    fn each_part_of_a_long_clip_becomes_better() {
        let (robot, command) = again_and_again("jumps", 3);
        let policy = PolicyConfig::new(PolicyName::Pd);
        let fresh = || {
            let built = policy.build(&robot)?;
            Rollout::new(&robot, built, &command, Start::Pose, RolloutConfig::default())
        };
        let mut first = fresh().unwrap();
        first.run(&Cancel::default()).unwrap();
        let judge = Judge::default();
        let (usual, gaps) = (judge.score(&first).unwrap(), unnatural(&first));
        let search = |threads| {
            let mut search = Search::new(None, &judge, threads, fresh).unwrap();
            let rest = parts(first.goals()).len() * (first.frames() + AT_ONCE * CHUNK);
            let most = search.frames_left() + rest;
            let (mut best, mut offers): (Option<Rollout>, usize) = (None, 0);
            while search.step() {
                let least = best.as_ref().map_or(usual, |best| judge.score(best).unwrap());
                if let Some(better) = search.offer(least, gaps) {
                    search.give_back(best.replace(better));
                    offers += 1;
                }
            }
            assert!(search.frames() <= most && search.frames_left() == 0);
            assert!(offers > 1, "whatever is better is offered at once");
            assert!(search.offer(usual, gaps).is_none(), "and only once");
            assert_eq!(best.as_ref().unwrap().actions(), search.motion.actions());
            (search, best.unwrap())
        };
        let (mut one, better) = search(1);
        let all = parts(first.goals());
        assert!(all.len() > 1);
        for part in &all {
            let score = |motion| judge.score_part(motion, part, f64::INFINITY).unwrap();
            assert!(score(&better) < 0.99 * score(&first), "{part:?}");
        }
        assert_eq!(search(3).1.actions(), better.actions());
        let mut repeated = fresh().unwrap();
        repeated.correct(better.lead().unwrap().clone()).unwrap();
        repeated.run(&Cancel::default()).unwrap();
        assert_eq!(repeated.actions(), better.actions());
        // A motion that jams in the second part is searched there only.
        let jam = Off { joint: 0, from: all[1].start + 5, to: all[1].start + 30 };
        one.again(&first, &judge.strict(&first, &[jam], f64::INFINITY), &[jam]).unwrap();
        assert_eq!(one.frames_left(), detour::budget(all[1].len() + 1, 2) / STRICT);
    }
}
