//! A clip that is performed while it is edited, by one policy or by all contenders of `auto`.
//!
//! Each contender keeps its own rollout, so that an edit simulates again only what it can change.
//! One of them is shown: it performs first, and its frames can be streamed. The others follow. The
//! best one repeats the clip and corrects its goals, and its best motion is shown until the next edit.

use std::sync::Arc;

use super::contest::Contest;
use super::error::Error;
use super::goals::Goals;
use super::learner::{Learner, Stage};
use super::policy_config::PolicyConfig;
use super::run::Rollout;
use super::start::Start;
use super::trial::{Trial, best};
use robert_clip::Command;
use robert_robot::Robot;

/// One policy on the clip.
#[derive(Default)]
struct Contender {
    rollout: Option<Rollout>,
    /// The edit that its rollout performs.
    edit: u64,
    /// Why it cannot perform that edit.
    failed: Option<Error>,
}

/// A clip that is performed while it is edited.
pub struct LiveRollout {
    contest: Contest,
    contenders: Vec<Contender>,
    /// The contender that is shown, and how often its corrections had improved what is shown: 0 if
    /// it is shown as it is.
    shown: (usize, usize),
    /// The contenders that repeat the clip, once all have performed it.
    learner: Option<Learner>,
    command: Command,
    /// The contenders that move differently on this clip.
    differing: Vec<usize>,
    /// The goals of the command.
    goals: Goals,
    edit: u64,
    seed: u64,
}

/// The result of comparing the contenders.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Choice {
    /// The policy that is shown from now on.
    pub policy: String,
    /// Whether another one was shown before.
    pub changed: bool,
    /// Those that move differently on this clip, in the order of [`super::Contenders::policies`];
    /// last the best one with corrected goals, if that is better.
    pub tried: Vec<Trial>,
}

impl LiveRollout {
    /// Prepares a rollout on the nominal plant; nothing is simulated yet. The first contender is
    /// shown.
    ///
    /// # Errors
    /// As [`PolicyConfig::build`] and [`Rollout::new`].
    pub fn new(
        robot: &Arc<Robot>,
        asked: &PolicyConfig,
        seed: u64,
        command: &Command,
    ) -> Result<LiveRollout, Error> {
        let contest = Contest::new(robot, asked)?;
        let goals = contest.goals(&Start::Pose, command);
        let differing = contest.differing(&goals);
        let contenders = contest.policies().iter().map(|_| Contender::default()).collect();
        let mut live = LiveRollout {
            contest,
            contenders,
            shown: (0, 0),
            learner: None,
            command: command.clone(),
            differing,
            goals,
            edit: 1,
            seed,
        };
        live.take_up(0)?;
        Ok(live)
    }

    /// The rollout that is shown.
    pub fn shown(&self) -> &Rollout {
        let best = self.learner.as_ref().and_then(Learner::best);
        if let Some(best) = best.filter(|_| self.shown.1 > 0) {
            return best;
        }
        match &self.contenders[self.shown.0].rollout {
            Some(rollout) => rollout,
            None => unreachable!("the shown contender has always a rollout"),
        }
    }

    /// The contenders; 1 if a policy was named. In a clip without gaps fewer are compared.
    pub fn count(&self) -> usize {
        self.contenders.len()
    }

    /// Replaces the command. Returns the frame up to which the motion stands that was shown; it is 0
    /// if corrections learned for the last command were shown. The others follow when their turn
    /// comes.
    ///
    /// # Errors
    /// As [`Rollout::new`].
    pub fn set_command(&mut self, command: &Command) -> Result<usize, Error> {
        let goals = self.contest.goals(&Start::Pose, command);
        self.differing = self.contest.differing(&goals);
        (self.command, self.goals) = (command.clone(), goals);
        self.edit += 1;
        let leader = self.learner.take().map(|learner| learner.leader());
        let corrected = std::mem::take(&mut self.shown.1) > 0;
        if self.shows_plan() {
            // A planner is too slow to be the first after an edit.
            self.shown.0 = leader.unwrap_or(0);
        }
        self.take_up(self.shown.0)?;
        Ok(if corrected { 0 } else { self.shown().frame() })
    }

    /// Whether the motion that is shown is a planner's own; planners come after the contenders.
    fn shows_plan(&self) -> bool {
        self.shown.0 >= self.contenders.len()
    }

    /// Makes a contender's rollout continue with the current command.
    fn take_up(&mut self, at: usize) -> Result<(), Error> {
        let Contender { rollout, edit, failed } = &mut self.contenders[at];
        if *edit == self.edit {
            return Ok(());
        }
        *failed = None;
        match rollout {
            Some(rollout) => drop(rollout.set_goals(&self.command, self.goals.clone())?),
            None => {
                let clip = (&self.command, &self.goals);
                let seed = self.seed;
                *rollout = Some(self.contest.rollout(at, None, clip, &Start::Pose, seed)?);
            }
        }
        *edit = self.edit;
        Ok(())
    }

    /// Simulates one frame of the rollout that is shown; `None` at its end.
    ///
    /// # Errors
    /// As [`Rollout::step`].
    pub fn step(&mut self) -> Result<Option<super::run::Frame<'_>>, Error> {
        if self.shows_plan() {
            // The planner has planned to the end.
            return Ok(None);
        }
        match &mut self.contenders[self.shown.0].rollout {
            Some(rollout) => rollout.step(),
            None => unreachable!("the shown contender has always a rollout"),
        }
    }

    /// Simulates one frame of a contender that has not finished, or some frames of a search. False if
    /// all have finished; then [`LiveRollout::choose`] compares them.
    pub fn step_another(&mut self) -> bool {
        let behind = |c: &Contender| {
            let done = c.rollout.as_ref().is_some_and(Rollout::is_done);
            c.edit != self.edit || !(done || c.failed.is_some())
        };
        let next = self.differing.iter().copied().find(|&at| behind(&self.contenders[at]));
        let Some(at) = next else { return self.learn() };
        let result = self.take_up(at).and_then(|()| match &mut self.contenders[at].rollout {
            Some(rollout) => rollout.step().map(|_| ()),
            None => unreachable!("it has been taken up"),
        });
        if let Err(e) = result {
            let contender = &mut self.contenders[at];
            (contender.failed, contender.edit) = (Some(e), self.edit);
        }
        true
    }

    /// Simulates one frame of a repetition by the best contender, or some of a search. False after the
    /// last one.
    fn learn(&mut self) -> bool {
        if !self.contest.learns {
            return false;
        }
        if self.learner.is_none() {
            self.learner = self.learner();
        }
        let mut learner = self.learner.take();
        let going = learner.as_mut().is_some_and(|learner| learner.step(|at| self.beginning(at)));
        self.learner = learner;
        going
    }

    /// The best contenders, about to repeat the clip; `None` if none can.
    fn learner(&self) -> Option<Learner> {
        let (places, trials): (Vec<usize>, Vec<Trial>) = self.tried().into_iter().unzip();
        let motion = |at: &usize| Some((*at, self.contenders[*at].rollout.as_ref()?));
        let motions: Vec<_> = places.iter().map(motion).collect();
        let threads = robert_base::parallel::cores();
        self.contest.learner(&trials, &motions, |at| self.beginning(at), threads)
    }

    /// A rollout of a contender at its beginning.
    fn beginning(&self, at: usize) -> Result<Rollout, Error> {
        let fork = self.contenders[at].rollout.as_ref().and_then(Rollout::fork_policy);
        self.contest.rollout(at, fork, (&self.command, &self.goals), &Start::Pose, self.seed)
    }

    /// What the contenders achieved that have something of their own to show.
    fn tried(&self) -> Vec<(usize, Trial)> {
        let trial = |at: usize| {
            let policy = self.contest.policy(at);
            match &self.contenders[at] {
                Contender { rollout: Some(rollout), failed: None, .. } => {
                    Trial::of(policy, rollout)
                }
                Contender { failed, .. } => Trial::failed(policy, failed.as_ref()),
            }
        };
        self.differing.iter().map(|&at| (at, trial(at))).collect()
    }

    /// How the best contender improves its motion at the moment; `None` while contenders perform.
    pub fn stage(&self) -> Option<Stage> {
        self.learner.as_ref().map(Learner::stage)
    }

    /// Shows the best motion so far once a search for a better one has begun, because the search may
    /// take seconds. Whether another motion is shown than before.
    pub fn show_best_so_far(&mut self) -> bool {
        let Some(learner) = self.learner.as_ref().filter(|l| l.searches()) else { return false };
        let best = (learner.at(), learner.improvements());
        let waits = self.shown.0 != best.0 || (self.shown.1 == 0 && best.1 > 0);
        if waits {
            self.shown = best;
        }
        waits
    }

    /// Compares the contenders and shows the best one. It is the choice of
    /// [`super::Contenders::perform`] for the same clip and seed.
    ///
    /// # Errors
    /// The first one's error when all have failed.
    pub fn choose(&mut self) -> Result<Choice, Error> {
        let (places, mut tried): (Vec<usize>, Vec<Trial>) = self.tried().into_iter().unzip();
        let performed = places.iter().position(|&at| self.contenders[at].failed.is_none());
        let Some(turn) = best(&tried).or(performed) else {
            let first = self.contenders.iter_mut().find_map(|c| c.failed.take());
            return Err(first.unwrap_or_else(|| unreachable!("all have failed")));
        };
        let mut at = places[turn];
        let mut improvements = 0;
        let mut policy = self.contest.policy(at).clone();
        if let Some(learner) = &self.learner
            && let Some(motion) = learner.best()
            && let Some((own, trial)) = self.contest.better(&tried, learner.at(), motion)
        {
            tried.push(trial);
            (at, policy, improvements) = (learner.at(), own, learner.improvements());
        }
        let shown = (at, improvements);
        let changed = std::mem::replace(&mut self.shown, shown) != shown;
        Ok(Choice { policy: policy.label(), changed, tried })
    }
}

impl std::fmt::Debug for LiveRollout {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LiveRollout")
            .field("shown", &self.shown())
            .field("contenders", &self.contenders.len())
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Contenders, PolicyName, tasks};
    use robert_base::progress::{Cancel, Silent};
    use robert_clip::{Clip, compile};
    use robert_robot::PlantConfig;

    fn to_the_end(live: &mut LiveRollout) -> Choice {
        while live.step().unwrap().is_some() {}
        while live.step_another() {}
        live.choose().unwrap()
    }

    /// After each edit the choice and the shown motion have the same bits as a choice from the
    /// start.
    #[test]
    fn an_edited_clip_has_the_same_choice_as_a_new_one() {
        let robot = Arc::new(Robot::builtin("pointmass").unwrap());
        let asked = PolicyConfig::new(PolicyName::Auto);
        let clips: Vec<Clip> = ["circle", "heart", "hops", "jumps"]
            .map(|n| tasks::find(n, Some("pointmass")).unwrap())
            .into();
        let mut live: Option<LiveRollout> = None;
        let contenders = Contenders::new(&robot, &asked).unwrap();
        let mut shown_early = Vec::new();
        for clip in [&clips[0], &clips[1], &clips[1], &clips[2], &clips[3]] {
            let command = compile(clip).unwrap();
            match &mut live {
                Some(live) => drop(live.set_command(&command).unwrap()),
                None => live = Some(LiveRollout::new(&robot, &asked, 3, &command).unwrap()),
            }
            let live = live.as_mut().unwrap();
            while live.step().unwrap().is_some() {}
            let mut shown = 0;
            while live.step_another() {
                shown += usize::from(live.show_best_so_far());
            }
            shown_early.push(shown);
            let choice = live.choose().unwrap();
            let fresh = contenders
                .perform(&command, &Start::Pose, 3, 1, &Silent, &Cancel::default())
                .unwrap();
            assert_eq!(choice.tried, fresh.tried);
            assert_eq!(choice.policy, fresh.policy.label());
            assert_eq!(live.shown().actions(), fresh.rollout.actions());
        }
        // In the fourth one a gap is rough: the leader is shown while it is softened. In the last one joints stay
        // away: another contender, and its first better motion.
        assert_eq!(shown_early, [0, 0, 0, 1, 2]);
        let live = live.as_mut().unwrap();
        let actions = live.shown().actions().to_vec();
        assert!(!to_the_end(live).changed, "the same clip, the same choice");
        assert_eq!(live.shown().actions(), actions);
    }

    #[test]
    fn an_interrupted_comparison_continues_with_the_newest_clip() {
        let robot = Arc::new(Robot::builtin("pointmass").unwrap());
        let asked = PolicyConfig::new(PolicyName::Auto);
        let command = |n| compile(&tasks::find(n, Some("pointmass")).unwrap()).unwrap();
        let mut live = LiveRollout::new(&robot, &asked, 0, &command("heart")).unwrap();
        while live.step().unwrap().is_some() {}
        for _ in 0..150 {
            live.step_another();
        }
        live.set_command(&command("circle")).unwrap();
        let choice = to_the_end(&mut live);
        let mut fresh = LiveRollout::new(&robot, &asked, 0, &command("circle")).unwrap();
        assert_eq!(choice.tried, to_the_end(&mut fresh).tried);
        assert_eq!(live.shown().actions(), fresh.shown().actions());
    }

    /// A clip without gaps gives a guide nothing to do; a policy that has no twin without it stays.
    #[test]
    fn guides_and_repetition_work_on_a_clip_without_gaps_alone_and_in_comparison() {
        let robot = Arc::new(Robot::builtin("pointmass").unwrap());
        let command = compile(&tasks::find("pointmass/heart", None).unwrap()).unwrap();
        assert!(!Goals::new(&command).has_gaps());
        let (start, cancel) = (Start::Pose, Cancel::default());
        for (text, contenders) in [
            ("auto", 3),
            ("auto+guide", 3),
            ("pd+guide", 1),
            ("pd+ilc", 1),
            ("pd+smooth+ilc", 1),
            ("robert+masks+ilc", 1),
            ("pd+refine+ilc", 1),
        ] {
            let asked: PolicyConfig = text.parse().unwrap();
            let mut live = LiveRollout::new(&robot, &asked, 0, &command).unwrap();
            assert_eq!(live.differing.len(), contenders, "{text}");
            let choice = to_the_end(&mut live);
            assert!(choice.tried.len() >= contenders, "{text}");
            if asked.is_tried() {
                let all = Contenders::new(&robot, &asked).unwrap();
                let fresh = all.perform(&command, &start, 0, 1, &Silent, &cancel).unwrap();
                assert_eq!(choice.tried, fresh.tried, "{text}");
                assert_eq!(live.shown().actions(), fresh.rollout.actions(), "{text}");
                let mut again = fresh.again(&command, &start, 0, PlantConfig::default()).unwrap();
                again.run(&cancel).unwrap();
                assert_eq!(again.actions(), fresh.rollout.actions(), "{text}");
            }
        }
    }

    #[test]
    fn a_named_policy_has_nothing_to_compare() {
        let robot = Arc::new(Robot::builtin("pointmass").unwrap());
        let command = compile(&tasks::find("pointmass/heart", None).unwrap()).unwrap();
        let asked = PolicyConfig::new(PolicyName::Pd);
        let mut live = LiveRollout::new(&robot, &asked, 0, &command).unwrap();
        while live.step().unwrap().is_some() {}
        assert!(live.count() == 1 && !live.step_another());
        assert_eq!(live.choose().unwrap().policy, "pd");
    }
}
