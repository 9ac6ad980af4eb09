//! `auto`: chooses the policy by simulation.
//!
//! Every contender performs the clip: the learned policies, proportional control and, on robots that
//! are not the program's, computed torque, with and without smooth motion planned through the gaps. No
//! policy is best everywhere (contact, unreachable poses), and a rollout takes a fraction of a second. The
//! best ones then repeat the clip and correct their goals by what they missed ([`super::ilc`]). If joints
//! still stay away, the nearest one follows the path of a planner and searches for detours, and rough gaps become
//! softer ([`super::learner`]). The best motion is used.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use super::contest::Contest;
use super::error::Error;
use super::goals::Goals;
use super::ilc;
use super::learner::{Learner, Stage};
use super::policy::Policy;
use super::policy_config::PolicyConfig;
use super::run::{Rollout, RolloutConfig};
use super::start::Start;
use super::trial::{Trial, best};
use robert_base::parallel;
use robert_base::progress::{Cancel, Progress};
use robert_clip::Command;
use robert_robot::{PlantConfig, Robot};

/// The contenders for one robot, built once and forked for every clip.
pub struct Contenders {
    contest: Contest,
    /// Their policies.
    templates: Vec<Mutex<Box<dyn Policy>>>,
}

impl std::fmt::Debug for Contenders {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.policies().map(PolicyConfig::label)).finish()
    }
}

/// A clip that all contenders performed, with the best rollout.
#[derive(Debug)]
pub struct Chosen {
    /// The best policy. [`PolicyConfig::ilc`] tells whether its goals were corrected.
    pub policy: PolicyConfig,
    /// Its rollout on the nominal plant.
    pub rollout: Rollout,
    /// Those that move differently on this clip, in the order in which they were tried; last the best
    /// one with corrected goals, if that is better.
    pub tried: Vec<Trial>,
}

impl Chosen {
    /// The chosen policy on any plant, with the same corrections; nothing is simulated yet.
    ///
    /// # Errors
    /// As [`PolicyConfig::build`] and [`Rollout::new`].
    pub fn again(
        &self,
        command: &Command,
        start: &Start,
        seed: u64,
        plant: PlantConfig,
    ) -> Result<Rollout, Error> {
        let robot = self.rollout.robot();
        let built = PolicyConfig { ilc: false, ..self.policy.clone() }.build(robot)?;
        let config = RolloutConfig { seed, guide: self.policy.guide, plant };
        let mut rollout = Rollout::new(robot, built, command, start.clone(), config)?;
        if let Some(lead) = self.rollout.lead() {
            rollout.correct(lead.clone())?;
        }
        Ok(rollout)
    }
}

impl Contenders {
    /// The contenders for the request `asked`, for which [`PolicyConfig::is_tried`] holds. Its model,
    /// guide and refinement apply to all of them.
    ///
    /// # Errors
    /// As [`PolicyConfig::build`].
    pub fn new(robot: &Arc<Robot>, asked: &PolicyConfig) -> Result<Contenders, Error> {
        let contest = Contest::new(robot, asked)?;
        let build = |policy: &PolicyConfig| Ok(Mutex::new(policy.build(robot)?));
        let templates = contest.policies().iter().map(build).collect::<Result<_, Error>>()?;
        Ok(Contenders { contest, templates })
    }

    /// Their number.
    pub fn count(&self) -> usize {
        self.templates.len()
    }

    /// The policies, in the order in which they are tried.
    pub fn policies(&self) -> impl Iterator<Item = &PolicyConfig> {
        self.contest.policies().iter()
    }

    /// Rolls out all contenders on the nominal plant, on `threads` threads, and chooses the best.
    /// The result does not depend on the number of threads.
    ///
    /// # Errors
    /// An error that keeps the first contender from starting (a clip for another robot),
    /// the error of the first one if all fail, and [`Error::Cancelled`].
    pub fn perform(
        &self,
        command: &Command,
        start: &Start,
        seed: u64,
        threads: usize,
        progress: &dyn Progress,
        cancel: &Cancel,
    ) -> Result<Chosen, Error> {
        let done = AtomicUsize::new(0);
        let goals = self.contest.goals(start, command);
        let clip = (command, &goals);
        let differ = self.contest.differing(&goals);
        let most = ilc::LONGEST;
        if self.contest.learns && goals.frames() > most {
            progress.log(&format!(
                "a clip of more than {most} frames is not repeated: its goals are not corrected"
            ));
        }
        let frames = differ.len() * command.frames().saturating_sub(1) as usize;
        let tick = |label: &str| {
            let n = (done.fetch_add(1, Ordering::Relaxed) + 1).min(frames);
            progress.tick(n as u64, frames as u64, label);
        };
        let all = parallel::each(threads, &differ, |_, &at| {
            let label = self.contest.policy(at).label();
            (at, self.one(at, clip, start, seed, &|| tick(&label), cancel))
        });
        if cancel.is_cancelled() {
            return Err(Error::Cancelled { frame: 0 });
        }
        let (tried, mut rollouts) = self.compare(all)?;
        let again = |at| self.rollout(at, clip, start, seed);
        let motions: Vec<_> = rollouts.iter().map(|r| r.as_ref().map(|(at, r)| (*at, r))).collect();
        let better = self
            .contest
            .learner(&tried, &motions, again, threads)
            .and_then(|learner| self.repeat(learner, again, progress, cancel));
        let performed = rollouts.iter().position(Option::is_some);
        let nearest = best(&tried).or(performed).and_then(|turn| rollouts.swap_remove(turn));
        let Some((at, rollout)) = nearest else { unreachable!("one has performed the clip") };
        let mut chosen = Chosen { policy: self.contest.policy(at).clone(), rollout, tried };
        if let Some((at, motion)) = better
            && let Some((policy, trial)) = self.contest.better(&chosen.tried, at, &motion)
        {
            chosen.tried.push(trial);
            (chosen.policy, chosen.rollout) = (policy, motion);
        }
        Ok(chosen)
    }

    /// Improves the motions of the racers until a stop; the best motion, if it is better than what
    /// its contender did at first.
    fn repeat(
        &self,
        mut learner: Learner,
        again: impl Fn(usize) -> Result<Rollout, Error>,
        progress: &dyn Progress,
        cancel: &Cancel,
    ) -> Option<(usize, Rollout)> {
        let (mut stage, mut began): (Option<Stage>, usize) = (None, 0);
        loop {
            // Each stage has its own pace, and so its own estimate of the time that is left.
            if stage != Some(learner.stage()) {
                (stage, began) = (Some(learner.stage()), learner.frames());
                progress.phase(learner.stage().title(), "frames");
            }
            let frames = (learner.frames() - began) as u64;
            let own = PolicyConfig { ilc: true, ..self.contest.policy(learner.at()).clone() };
            progress.tick(frames, frames + learner.frames_left() as u64, &own.label());
            if cancel.is_cancelled() {
                learner.stop();
                break;
            }
            if !learner.step(&again) {
                break;
            }
        }
        let frames = (learner.frames() - began) as u64;
        progress.tick(frames, frames, "");
        learner.into_best()
    }

    /// A rollout of a contender at its beginning.
    fn rollout(
        &self,
        at: usize,
        clip: (&Command, &Goals),
        start: &Start,
        seed: u64,
    ) -> Result<Rollout, Error> {
        let fork = self.templates[at].lock().unwrap_or_else(PoisonError::into_inner).fork();
        self.contest.rollout(at, fork, clip, start, seed)
    }

    fn one(
        &self,
        at: usize,
        clip: (&Command, &Goals),
        start: &Start,
        seed: u64,
        tick: &dyn Fn(),
        cancel: &Cancel,
    ) -> Result<Rollout, Error> {
        let mut rollout = self.rollout(at, clip, start, seed)?;
        while !cancel.is_cancelled() && rollout.step()?.is_some() {
            tick();
        }
        Ok(rollout)
    }

    /// What the contenders achieved, and their rollouts.
    fn compare(&self, all: Vec<(usize, Result<Rollout, Error>)>) -> Result<Performances, Error> {
        let (mut tried, mut rollouts) = (Vec::new(), Vec::new());
        let mut first_error = None;
        for (at, result) in all {
            let policy = self.contest.policy(at);
            match result {
                Ok(rollout) => {
                    tried.push(Trial::of(policy, &rollout));
                    rollouts.push(Some((at, rollout)));
                }
                Err(e) => {
                    tried.push(Trial::failed(policy, Some(&e)));
                    first_error.get_or_insert(e);
                    rollouts.push(None);
                }
            }
        }
        match first_error {
            Some(e) if rollouts.iter().all(Option::is_none) => Err(e),
            _ => Ok((tried, rollouts)),
        }
    }
}

/// What contenders achieved, and each contender with its rollout, if it could perform.
type Performances = (Vec<Trial>, Vec<Option<(usize, Rollout)>>);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::learner::VISIBLE_ERROR;
    use crate::tasks;
    use crate::{Choice, LiveRollout, PolicyName};
    use robert_base::progress::Silent;
    use robert_clip::compile;

    /// A fast swing of the light arm, which needs a plan, and what follows from the choice of one.
    #[test]
    fn a_planner_is_chosen_where_it_is_clearly_nearer() {
        let robot = Arc::new(Robot::builtin("ur5e_light").unwrap());
        let (n, home): (_, Vec<f32>) = (40, robot.home().iter().map(|q| *q as f32).collect());
        let swing = |f: usize| 0.5 * (f.clamp(10, 20) - 10) as f32 / 10.0;
        let q = (0..n).flat_map(|f| home.iter().map(move |q| q + swing(f))).collect();
        let joints = robot.joints().iter().map(|j| j.name.clone()).collect();
        let seen = vec![true; n * home.len()];
        let command = Command::from_dense(joints, home.clone(), q, seen).unwrap();
        let asked = PolicyConfig::new(PolicyName::Auto);
        let (start, cancel) = (Start::Pose, Cancel::default());
        let all = Contenders::new(&robot, &asked).unwrap();
        let chosen = all.perform(&command, &start, 0, 2, &Silent, &cancel).unwrap();
        assert_eq!(chosen.policy.label(), "ilqr+smooth");
        let others = chosen.tried.iter().filter(|t| t.policy != "ilqr+smooth");
        let nearest = others.filter_map(|t| t.precision).fold(f64::INFINITY, f64::min);
        let own = chosen.rollout.precision().precision.unwrap();
        assert!(own < 0.9 * nearest && nearest > VISIBLE_ERROR, "{own} {nearest}");
        let mut again = chosen.again(&command, &start, 0, PlantConfig::default()).unwrap();
        again.run(&cancel).unwrap();
        assert_eq!(again.actions(), chosen.rollout.actions());
        // A clip that is edited comes to the same, and the next edit begins with a fast policy.
        let mut live = LiveRollout::new(&robot, &asked, 0, &command).unwrap();
        let choice = to_the_end(&mut live);
        assert_eq!(choice.policy, "ilqr+smooth");
        assert_eq!(live.shown().actions(), chosen.rollout.actions());
        assert!(live.step().unwrap().is_none());
        assert_eq!(live.set_command(&command).unwrap(), 0);
        assert_eq!(to_the_end(&mut live).tried, choice.tried);
    }

    /// The light arm's joints swing beyond their goals by a little more than what is allowed, whichever
    /// policy that learned moves it.
    #[test]
    fn a_planner_is_chosen_where_the_motion_in_a_gap_is_unnatural() {
        let robot = Arc::new(Robot::builtin("ur5e_light").unwrap());
        let clip = tasks::find("ur5e/pick_place", None).unwrap();
        let command = compile(&clip).unwrap();
        let all = Contenders::new(&robot, &PolicyConfig::new(PolicyName::Auto)).unwrap();
        let cancel = Cancel::default();
        let mut chosen = all.perform(&command, &Start::Pose, 0, 2, &Silent, &cancel).unwrap();
        let gaps = crate::GapFigures::of(&mut chosen.rollout, &|| false).unwrap();
        assert_eq!((chosen.policy.label().as_str(), gaps.overshoot), ("ilqr+smooth", None));
    }

    fn to_the_end(live: &mut LiveRollout) -> Choice {
        while live.step().unwrap().is_some() {}
        while live.step_another() {}
        live.choose().unwrap()
    }

    #[test]
    fn the_choice_is_no_worse_than_any_and_the_same_on_any_number_of_threads() {
        let clip = tasks::find("pointmass/star", None).unwrap();
        let robot = Arc::new(Robot::builtin("pointmass").unwrap());
        let command = compile(&clip).unwrap();
        let asked = PolicyConfig::new(PolicyName::Auto);
        let contenders = Contenders::new(&robot, &asked).unwrap();
        let labels: Vec<String> = contenders.policies().map(PolicyConfig::label).collect();
        assert!(labels.contains(&"robert".to_owned()) && labels.contains(&"pd".to_owned()));
        let run = |threads| {
            let (start, cancel) = (Start::Pose, Cancel::default());
            contenders.perform(&command, &start, 0, threads, &Silent, &cancel).unwrap()
        };
        let (one, two) = (run(1), run(2));
        assert_eq!(one.rollout.actions(), two.rollout.actions());
        assert_eq!(one.tried, two.tried);
        let own = one.tried.iter().find(|t| t.policy == one.policy.label()).unwrap();
        assert_eq!(own.precision, one.rollout.precision().precision);
        let score = |t: &Trial| t.judged.unwrap() + t.gaps;
        assert!(one.tried.iter().all(|t| score(own) <= score(t)));
    }
}
