//! Softer motion in gaps.
//!
//! Where a key asks for what touch does not allow, the plan of the gap after it begins behind the contact: the
//! joint leaves late and with a jolt, and arrives with one. Where something is in the way, the joint presses
//! against it until it slips. So the gap with the roughest motion is tried again along the path that was taken,
//! only more smoothly, and from and to the states that were reached; first one gap, then the next. A judge weighs
//! jolts more than usual.

use super::error::Error;
use super::gap::Gap;
use super::gaps::{self, Roughness};
use super::judge::{self, Judge};
use super::lead::Lead;
use super::natural;
use super::run::Rollout;
use super::search::on_threads;
use super::window::HISTORY;

/// Motion in a gap is rough if its jerk relative to the least exceeds this.
const ROUGH: f64 = 2.0;
/// What an overshoot of 1 rad or m counts like, in jerk: the ratio of what a gentle judge counts for them.
const SWING: f64 = natural::SWING_WEIGHT / (judge::GENTLY * natural::JERK_WEIGHT);
/// Frames before and after a gap in which goals are led to its ends.
const EASE: usize = 6;
/// Frames that are simulated at most, as a multiple of those of the clip.
const BUDGET: usize = 80;
/// Frames that are simulated at most, for a robot of 24 joints.
const MOST: usize = 64_000;
/// The share of the score that a try must gain.
const GAIN: f64 = 0.001;
/// Frames after a gap at which a try ends unless it is better up to there. They are as many as the search takes
/// together in one part.
const AFTER: usize = 400;
/// Frames by which one step advances each try.
const CHUNK: usize = 5;

/// A path through a gap.
#[derive(Clone, Copy)]
enum Path {
    /// The planned motion, but from and to the states that were reached at the two ends.
    Planned,
    /// The motion that was reached, smoothed with a Gaussian of so many frames.
    Taken(f64),
}

/// What is tried in a gap: a path, and the share by which it replaces what led the policy before.
const TRIES: [(Path, f64); 6] = [
    (Path::Planned, 1.0),
    (Path::Planned, 0.6),
    (Path::Taken(2.0), 1.0),
    (Path::Taken(4.0), 1.0),
    (Path::Taken(3.0), 0.6),
    (Path::Taken(1.0), 0.8),
];

/// A try.
struct Attempt {
    rollout: Rollout,
    going: bool,
    /// The sum by which its errors are larger than those of the motion.
    worse: f64,
    /// The next frame to be summed.
    next: usize,
    /// The frame at which it is compared.
    compared: usize,
}

/// Makes the gaps of a motion softer.
pub(super) struct Softening {
    judge: Judge,
    threads: usize,
    motion: Rollout,
    /// Its score, once it is complete.
    least: Option<f64>,
    /// Whether it became softer.
    changed: bool,
    attempts: Vec<Attempt>,
    /// Rollouts for more of them.
    spare: Vec<Rollout>,
    /// The gap that is tried.
    gap: Option<Gap>,
    /// Gaps in which nothing better was found.
    given_up: Vec<Gap>,
    /// Frames simulated so far, and at most.
    frames: usize,
    budget: usize,
}

impl Softening {
    /// Softens the motion `best`, or, if there is none, that without a lead. `fresh` makes a rollout at its
    /// beginning.
    ///
    /// # Errors
    /// As `fresh`.
    pub(super) fn new(
        best: Option<&Rollout>,
        judge: Judge,
        threads: usize,
        fresh: &dyn Fn() -> Result<Rollout, Error>,
    ) -> Result<Softening, Error> {
        let mut motion = fresh()?;
        if let Some(best) = best {
            motion.copy(best)?;
        }
        // The fewer joints a robot has, the faster it simulates.
        let dim = motion.goals().dim().clamp(6, 240);
        Ok(Softening {
            judge,
            threads,
            budget: (BUDGET * motion.frames()).min(MOST) * 24 / dim,
            motion,
            least: None,
            changed: false,
            attempts: Vec::new(),
            spare: (0..TRIES.len()).map(|_| fresh()).collect::<Result<_, _>>()?,
            gap: None,
            given_up: Vec::new(),
            frames: 0,
        })
    }

    /// Frames simulated so far.
    pub(super) fn frames(&self) -> usize {
        self.frames
    }

    /// Frames that may still be simulated.
    pub(super) fn frames_left(&self) -> usize {
        self.budget.saturating_sub(self.frames)
    }

    /// The motion, if it became softer.
    pub(super) fn into_motion(self) -> Option<Rollout> {
        self.changed.then_some(self.motion)
    }

    /// Simulates some frames; false at the end.
    pub(super) fn step(&mut self) -> bool {
        let Some(least) = self.least else { return self.complete() };
        if self.attempts.iter().all(|a| !a.going) {
            self.adopt_best(least);
            return self.frames_left() > 0 && self.begin();
        }
        let before: usize = self.attempts.iter().map(|a| a.rollout.simulated()).sum();
        let goals = self.motion.sought();
        let commanded = goals.commanded(&(1..goals.frames()));
        let (judge, states) = (&self.judge, self.motion.states());
        let rival = Rival { judge, states, commanded, patience: judge.patience(least) };
        let mut going: Vec<_> = self.attempts.iter_mut().filter(|a| a.going).collect();
        on_threads(self.threads, &mut going, |a| a.advance(&rival));
        self.frames += self.attempts.iter().map(|a| a.rollout.simulated()).sum::<usize>() - before;
        true
    }

    /// Some frames of the motion itself; false if it cannot be completed, or is refused.
    fn complete(&mut self) -> bool {
        for _ in 0..CHUNK {
            match self.motion.step() {
                Ok(Some(_)) => self.frames += 1,
                Ok(None) => break,
                Err(_) => return false,
            }
        }
        if self.motion.is_done() {
            self.least = self.judge.measure(&self.motion);
        }
        self.least.is_some() || !self.motion.is_done()
    }

    /// The roughest gap that was not given up; `None` if there is none, or if the motion is natural.
    fn roughest(&self) -> Option<Gap> {
        if natural::unnatural(&self.motion) <= 0.0 {
            return None;
        }
        let cost = |r: &Roughness| (r.jerk - ROUGH).max(0.0) + SWING * r.overshoot;
        let all = gaps::roughness(self.motion.sought(), self.motion.states()).into_iter();
        let rough = all.filter(|r| cost(r) > 0.0 && !self.given_up.contains(&r.gap));
        rough.max_by(|a, b| cost(a).total_cmp(&cost(b))).map(|r| r.gap)
    }

    /// Begins the tries of the roughest gap; false if there is none.
    fn begin(&mut self) -> bool {
        let Some(gap) = self.roughest() else { return false };
        for (path, share) in TRIES {
            let Some(mut rollout) = self.spare.pop() else { break };
            let lead = lead(&self.motion, &gap, path, share);
            let going = rollout.branch(&self.motion, lead).is_ok();
            let (next, compared) = (rollout.frame() + 1, gap.to + AFTER);
            self.attempts.push(Attempt { rollout, going, worse: 0.0, next, compared });
        }
        // Measuring the gaps takes time, too.
        self.frames += self.motion.frames() / 10 + 1;
        self.gap = Some(gap);
        !self.attempts.is_empty()
    }

    /// Goes on from the best try, if one is better; otherwise gives up the gap.
    fn adopt_best(&mut self, least: f64) {
        if self.attempts.is_empty() {
            return;
        }
        let score =
            |a: &Attempt| a.rollout.is_done().then(|| self.judge.score(&a.rollout)).flatten();
        let scores = self.attempts.iter().enumerate().filter_map(|(at, a)| Some((at, score(a)?)));
        let enough = (1.0 - GAIN) * least;
        let best = scores.filter(|(_, s)| *s < enough).min_by(|a, b| a.1.total_cmp(&b.1));
        match best {
            Some((at, score)) => {
                std::mem::swap(&mut self.motion, &mut self.attempts[at].rollout);
                (self.least, self.changed) = (Some(score), true);
                // What comes after it has changed, too.
                let from = self.gap.take().map_or(0, |gap| gap.from);
                self.given_up.retain(|gap| gap.from < from);
            }
            None => self.given_up.extend(self.gap.take()),
        }
        self.spare.extend(self.attempts.drain(..).map(|a| a.rollout));
    }
}

/// The motion that a try must be better than.
struct Rival<'a> {
    judge: &'a Judge,
    /// (30 + frames, S).
    states: &'a [f64],
    /// The number of its goals.
    commanded: f64,
    /// By how much the mean error may grow on the way, rad or m.
    patience: f64,
}

impl Attempt {
    /// Some frames, as long as it may become better.
    fn advance(&mut self, rival: &Rival<'_>) {
        for _ in 0..CHUNK {
            // The plant may diverge with a correction.
            self.going = matches!(self.rollout.step(), Ok(Some(_)))
                && !self.rollout.is_done()
                && self.promises(rival);
            if !self.going {
                return;
            }
        }
    }

    fn promises(&mut self, rival: &Rival<'_>) -> bool {
        let (goals, frame) = (self.rollout.sought(), self.rollout.frame());
        let before = &rival.states[HISTORY * goals.dim()..];
        while self.next <= frame {
            self.worse += rival.judge.error_at(goals, self.rollout.reached(), self.next)
                - rival.judge.error_at(goals, before, self.next);
            self.next += 1;
        }
        if frame == self.compared {
            // From here on the motions are nearly the same again.
            let mut whole = rival.states.to_vec();
            whole[..self.rollout.states().len()].copy_from_slice(self.rollout.states());
            let penalty = |states: &[f64]| rival.judge.penalty(natural::penalties(goals, states));
            let more = penalty(&whole) - penalty(rival.states);
            return self.worse / rival.commanded + more < 0.0;
        }
        self.worse <= rival.patience * rival.commanded
    }
}

/// What leads a policy on a path through a gap, in place of a share of what led it before.
fn lead(motion: &Rollout, gap: &Gap, path: Path, share: f64) -> Lead {
    let (goals, plan, led) = (motion.goals(), motion.plan(), motion.led());
    let d = goals.dim();
    let mut lead = motion.lead_or_none();
    for &j in &gap.joints {
        let way = |f: usize| plan.way_at(f, j);
        let reached = |f: usize| motion.reached()[f * d + j];
        // Nothing leads beyond the two ends.
        let ends = [gap.from, gap.to].map(|f| [goals.way_at(f, j), reached(f)]);
        let lo = ends.as_flattened().iter().copied().fold(f64::INFINITY, f64::min);
        let hi = ends.as_flattened().iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let target = |f: usize| path.at(f, gap, way, reached).clamp(lo, hi);
        let before = |f: usize| led.way_at(f, j) - way(f);
        let after = |f: usize| share * (target(f) - way(f)) + (1.0 - share) * before(f);
        for f in gap.from.max(1)..=gap.to {
            lead.shift[f * d + j] = after(f);
        }
        let [by_from, by_to] = [gap.from, gap.to].map(|f| after(f) - before(f));
        for k in 1..=EASE {
            let part = 1.0 - k as f64 / (EASE + 1) as f64;
            if gap.from > k {
                lead.shift[(gap.from - k) * d + j] += part * by_from;
            }
            if gap.to + k < plan.frames() {
                lead.shift[(gap.to + k) * d + j] += part * by_to;
            }
        }
    }
    if !lead.shown.contains(gap) {
        lead.shown.push(gap.clone());
    }
    lead
}

impl Path {
    /// A joint at a frame of the gap, by its planned motion and the one that was reached.
    fn at(
        self,
        f: usize,
        gap: &Gap,
        way: impl Fn(usize) -> f64,
        reached: impl Fn(usize) -> f64,
    ) -> f64 {
        match self {
            Path::Planned => {
                let missed = |f: usize| reached(f) - way(f);
                let s = (f - gap.from) as f64 / (gap.to - gap.from) as f64;
                let along = s * s * (3.0 - 2.0 * s);
                way(f) + missed(gap.from) + along * (missed(gap.to) - missed(gap.from))
            }
            Path::Taken(sigma) => {
                // The filter becomes narrower towards the ends, which stay.
                let reach = ((3.0 * sigma) as usize).min(f - gap.from).min(gap.to - f);
                let weight = |k: usize| (-0.5 * (k.abs_diff(f) as f64 / sigma).powi(2)).exp();
                let frames = f - reach..=f + reach;
                let sum: f64 = frames.clone().map(|k| weight(k) * reached(k)).sum();
                sum / frames.map(weight).sum::<f64>()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Guide, PolicyConfig, PolicyName, RolloutConfig, Start};
    use robert_base::progress::Cancel;
    use robert_clip::Command;
    use robert_robot::Robot;
    use std::sync::Arc;

    /// The ends of a path are the states that were reached there.
    #[test]
    fn a_path_leads_from_and_to_what_was_reached() {
        let gap = Gap { from: 10, to: 30, joints: vec![0] };
        let way = |f: usize| (f as f64 - 10.0) / 20.0;
        let reached = |f: usize| if f < 20 { 0.2 } else { 0.9 };
        for (path, _) in TRIES {
            let at = |f: usize| path.at(f, &gap, way, reached);
            assert!((at(10) - 0.2).abs() < 1e-9 && (at(30) - 0.9).abs() < 1e-9);
            assert!((10..30).all(|f| (-1e-9..0.5).contains(&(at(f + 1) - at(f)))));
        }
    }

    /// A thumb and fingers that touch on the way into a fist and out of it.
    fn fist(robot: &Robot) -> Command {
        let (frames, d) = (110, robot.state_dim());
        let pose = |curl: f64, thumb: f64| -> Vec<f64> {
            let value = |name: &str| match (&name[..2], &name[2..]) {
                ("TH", "J5" | "J4") => thumb,
                ("TH", "J1" | "J2") => 0.6 * thumb,
                (_, "J3" | "J2") => 1.4 * curl,
                (_, "J1") => 0.8 * curl,
                _ => 0.0,
            };
            robot.joints().iter().map(|j| value(&j.name)).collect()
        };
        let keys = [
            (0, pose(0.0, 0.0)),
            (40, pose(1.0, 0.9)),
            (75, pose(0.2, 0.9)),
            (109, pose(1.0, 0.2)),
        ];
        let (mut q, mut seen) = (vec![0.0; frames * d], vec![false; frames * d]);
        for (f, row) in keys {
            for (j, value) in row.into_iter().enumerate() {
                (q[f * d + j], seen[f * d + j]) = (value as f32, true);
            }
        }
        let names = robot.joints().iter().map(|j| j.name.clone()).collect();
        Command::from_dense(names, vec![0.0; d], q, seen).unwrap()
    }

    #[test]
    fn jolts_become_weaker_and_the_motion_has_the_bits_of_a_new_one() {
        let robot = Arc::new(Robot::builtin("shadow_hand").unwrap());
        let command = fist(&robot);
        let pd = PolicyConfig::new(PolicyName::Pd);
        for guide in [Guide::None, Guide::Smooth] {
            let fresh = || {
                let config = RolloutConfig { guide, ..RolloutConfig::default() };
                Rollout::new(&robot, pd.build(&robot)?, &command, Start::Pose, config)
            };
            let mut first = fresh().unwrap();
            first.run(&Cancel::default()).unwrap();
            let usual = Judge::default();
            let least = usual.score(&first).unwrap();
            let soften = |threads: usize| {
                // It begins also where nothing better than the first motion was found.
                let judge = usual.gentle(least, least);
                let mut softening = Softening::new(None, judge, threads, &fresh).unwrap();
                while softening.step() {}
                let most = softening.budget + TRIES.len() * CHUNK + first.frames();
                assert!(softening.frames() <= most);
                softening.into_motion().unwrap()
            };
            let softer = soften(1);
            let jolts = |motion: &Rollout| natural::apart(motion).1;
            assert!(jolts(&softer) < 0.7 * jolts(&first), "{} {}", jolts(&softer), jolts(&first));
            assert!(usual.score(&softer).unwrap() < least);
            assert_eq!(soften(3).actions(), softer.actions());
            let mut again = fresh().unwrap();
            again.correct(softer.lead().unwrap().clone()).unwrap();
            again.run(&Cancel::default()).unwrap();
            assert_eq!(again.actions(), softer.actions());
        }
    }
}
