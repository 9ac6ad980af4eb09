//! `auto`: chooses the policy by simulation.
//!
//! Every contender performs the clip: the learned policies, proportional control and, on robots that
//! are not the program's, computed torque, with and without smooth motion planned through the gaps. No policy is best everywhere (contact,
//! unreachable poses), and a rollout takes a fraction of a second. The best ones then repeat the
//! clip and correct their goals by what they missed ([`super::ilc`]). If joints still stay away, the
//! nearest one follows the path of a planner and searches for detours ([`super::learner`]). The
//! best motion is used.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use serde::{Deserialize, Serialize};

use super::error::Error;
use super::gaps::{counted, unnatural};
use super::guide::Guide;
use super::ilc::{self, Repeats};
use super::ilqr::IlqrConfig;
use super::inference::Inference;
use super::judge::Judge;
use super::learner::{Learner, RACERS, Stage};
use super::policy::Policy;
use super::policy_config::PolicyConfig;
use super::policy_name::PolicyName;
use super::run::{Rollout, RolloutConfig, Start};
use super::shipped;
use super::window::Goals;
use robert_base::parallel;
use robert_base::progress::{Cancel, Progress};
use robert_clip::Command;
use robert_net::Model;
use robert_robot::{PlantConfig, Robot};

/// The share by which the Precision of the chosen motion may be worse than that of proportional control.
const FARTHER: f64 = 0.03;

/// The result of one contender.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Trial {
    /// The policy, as in [`PolicyConfig::label`].
    pub policy: String,
    /// Its Precision, rad or m; `None` when it failed, or when nothing was commanded.
    pub precision: Option<f64>,
    /// Penalty of its motion, rad or m: for overshoot, long paths and jerk in gaps, and for a missed
    /// frame. 0 if the motion is within the limits.
    pub gaps: f64,
    /// Why it failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}

impl Trial {
    /// A policy that has performed the clip.
    pub(super) fn of(policy: &PolicyConfig, rollout: &Rollout) -> Trial {
        Trial {
            policy: policy.label(),
            precision: rollout.precision().precision,
            gaps: counted(unnatural(rollout)),
            error: None,
        }
    }

    /// A policy that could not perform it.
    pub(super) fn failed(policy: &PolicyConfig, error: Option<&Error>) -> Trial {
        let error = error.map(ToString::to_string);
        Trial { policy: policy.label(), precision: None, gaps: 0.0, error }
    }

    /// What decides: the smaller the better.
    pub(super) fn score(&self) -> Option<f64> {
        Some(self.precision? + self.gaps)
    }

    /// The score of a motion whose Precision is not above `limit`.
    fn score_below(&self, limit: f64) -> Option<f64> {
        self.score().filter(|_| self.precision.is_some_and(|p| p <= limit))
    }
}

impl Chosen {
    /// Replaces the rollout by one of `policy`, usually with corrected goals, if that is better.
    fn adopt(&mut self, policy: &PolicyConfig, better: Rollout) {
        let policy = PolicyConfig { ilc: better.shift().is_some(), ..policy.clone() };
        let trial = Trial::of(&policy, &better);
        if leads(&self.tried, &trial) {
            self.tried.push(trial);
            (self.policy, self.rollout) = (policy, better);
        }
    }

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
        if let Some(shift) = self.rollout.shift() {
            rollout.correct(shift)?;
        }
        Ok(rollout)
    }
}

/// The contenders for one robot, built once and forked for every clip.
pub struct Contenders {
    robot: Arc<Robot>,
    /// Whether the best one repeats the clip.
    learns: bool,
    list: Vec<(PolicyConfig, Mutex<Box<dyn Policy>>)>,
    /// The planner whose path the best one may follow, and its place after the contenders.
    planner: Option<(usize, PolicyConfig)>,
}

impl std::fmt::Debug for Contenders {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.list.iter().map(|(p, _)| p.label())).finish()
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

impl Contenders {
    /// The contenders for the request `asked`, for which [`PolicyConfig::is_tried`] holds. Its model,
    /// guide and refinement apply to all of them.
    ///
    /// # Errors
    /// As [`PolicyConfig::build`].
    pub fn new(robot: &Arc<Robot>, asked: &PolicyConfig) -> Result<Contenders, Error> {
        let list = configs(robot, asked)?
            .into_iter()
            .map(|config| Ok((config.clone(), Mutex::new(config.build(robot)?))))
            .collect::<Result<Vec<_>, Error>>()?;
        let planner = planner(robot, asked).map(|config| (list.len(), config));
        Ok(Contenders { robot: Arc::clone(robot), learns: learns(asked), list, planner })
    }

    /// Their number.
    pub fn count(&self) -> usize {
        self.list.len()
    }

    /// The policies, in the order in which they are tried.
    pub fn policies(&self) -> impl Iterator<Item = &PolicyConfig> {
        self.list.iter().map(|(config, _)| config)
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
        let goals = Goals::new(command);
        let differ = differing(&self.policies().collect::<Vec<_>>(), &goals);
        let learns = self.learns && goals.frames() <= ilc::LONGEST;
        if self.learns && !learns {
            let most = ilc::LONGEST;
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
            let label = self.list[at].0.label();
            (at, self.one(at, command, start, seed, &|| tick(&label), cancel))
        });
        if cancel.is_cancelled() {
            return Err(Error::Cancelled { frame: 0 });
        }
        let (tried, mut rollouts) = self.compare(all)?;
        let again = |at| self.rollout(at, command, start, seed);
        let racer = |turn: usize| {
            let (at, first) = rollouts[turn].as_ref()?;
            let fresh = [again(*at).ok()?, again(*at).ok()?];
            Repeats::new((*at, &self.list[*at].0), first, fresh, judge(&tried, first)).ok()?
        };
        let racers = leaders(&tried).filter(|_| learns).filter_map(racer).collect();
        let better = Learner::new(racers, self.planner.clone(), threads)
            .and_then(|learner| self.repeat(learner, again, progress, cancel));
        let performed = rollouts.iter().position(Option::is_some);
        let nearest = best(&tried).or(performed).and_then(|turn| rollouts.swap_remove(turn));
        let Some((at, rollout)) = nearest else { unreachable!("one has performed the clip") };
        let mut chosen = Chosen { policy: self.list[at].0.clone(), rollout, tried };
        if let Some((at, better)) = better {
            chosen.adopt(self.policy(at), better);
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
            let own = PolicyConfig { ilc: true, ..self.policy(learner.at()).clone() };
            progress.tick(frames, frames + learner.frames_left() as u64, &own.label());
            // What was found until a stop counts.
            if cancel.is_cancelled() || !learner.step(&again) {
                break;
            }
        }
        let frames = (learner.frames() - began) as u64;
        progress.tick(frames, frames, "");
        learner.into_best()
    }

    /// The settings of a contender, or of the planner.
    fn policy(&self, at: usize) -> &PolicyConfig {
        match &self.planner {
            Some((own, config)) if *own == at => config,
            _ => &self.list[at].0,
        }
    }

    /// A rollout of a contender at its beginning.
    fn rollout(
        &self,
        at: usize,
        command: &Command,
        start: &Start,
        seed: u64,
    ) -> Result<Rollout, Error> {
        let (config, template) = &self.list[at];
        let fork = template.lock().unwrap_or_else(PoisonError::into_inner).fork();
        let policy = fork.map_or_else(|| config.build(&self.robot), Ok)?;
        let own = RolloutConfig { seed, guide: config.guide, plant: PlantConfig::default() };
        Rollout::new(&self.robot, policy, command, start.clone(), own)
    }

    fn one(
        &self,
        at: usize,
        command: &Command,
        start: &Start,
        seed: u64,
        tick: &dyn Fn(),
        cancel: &Cancel,
    ) -> Result<Rollout, Error> {
        let mut rollout = self.rollout(at, command, start, seed)?;
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
            let policy = &self.list[at].0;
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

/// The contender with the smallest sum of error and gap penalty among the [`near`] ones; the first among
/// equals.
pub(super) fn best(tried: &[Trial]) -> Option<usize> {
    let limit = near(tried);
    let scored = tried.iter().enumerate().filter_map(|(at, t)| Some((at, t.score_below(limit)?)));
    scored.min_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(at, _)| at)
}

/// Whether a policy is better than all that were tried.
pub(super) fn leads(tried: &[Trial], trial: &Trial) -> bool {
    let limit = near(tried);
    let others = || tried.iter().filter_map(|t| t.score_below(limit));
    trial.score_below(limit).is_some_and(|s| others().all(|t| s < t))
}

/// The largest Precision that may be chosen, rad or m. A motion that is farther from its goals than
/// proportional control is no choice, however natural it is in its gaps.
fn near(tried: &[Trial]) -> f64 {
    let pd = tried.iter().find(|t| t.policy == "pd" || t.policy.starts_with("pd+"));
    let precision = pd.and_then(|t| t.precision).filter(|p| p.is_finite());
    precision.map_or(f64::INFINITY, |p| (1.0 + FARTHER) * p)
}

/// What decides between the motions of contenders that repeat the clip; `first` is one of the motions tried.
pub(super) fn judge(tried: &[Trial], first: &Rollout) -> Judge {
    Judge::of(first.robot()).no_farther_than(near(tried))
}

/// The contenders that repeat the clip, best first.
pub(super) fn leaders(tried: &[Trial]) -> impl Iterator<Item = usize> {
    let mut scored: Vec<_> =
        tried.iter().enumerate().filter_map(|(at, t)| Some((t.score()?, at))).collect();
    scored.sort_by(|a, b| a.0.total_cmp(&b.0));
    scored.into_iter().map(|(_, at)| at).take(RACERS)
}

/// Whether the best contender repeats the clip. With refinement a pass takes seconds, so this has
/// to be asked for.
pub(super) fn learns(asked: &PolicyConfig) -> bool {
    asked.is_tried() && (asked.ilc || !asked.refine)
}

/// The places of the contenders that move differently. In a clip without gaps there is nothing to
/// fill, so a policy moves like its twin that does not fill them.
pub(super) fn differing(all: &[&PolicyConfig], goals: &Goals) -> Vec<usize> {
    let repeats = |policy: &PolicyConfig| {
        let inference = Inference { masks: false, ..policy.inference };
        let twin = PolicyConfig { guide: Guide::None, inference, ..policy.clone() };
        twin != *policy && all.contains(&&twin)
    };
    (0..all.len()).filter(|&at| goals.has_gaps() || !repeats(all[at])).collect()
}

/// The list of contenders. With a model: the network alone, with smooth motion through the gaps,
/// and filling the gaps itself; the linear prediction and proportional control, alone and with
/// smooth motion. For a robot of the user's own, and without a model: policies that need no data. For a
/// named policy: this one.
pub(super) fn configs(robot: &Robot, asked: &PolicyConfig) -> Result<Vec<PolicyConfig>, Error> {
    if asked.name != PolicyName::Auto {
        return Ok(vec![PolicyConfig { ilc: false, ..asked.clone() }]);
    }
    let guides: &[Guide] = match asked.guide {
        Guide::None => &[Guide::None, Guide::Smooth],
        Guide::Linear => &[Guide::Linear],
        Guide::Smooth => &[Guide::Smooth],
    };
    let each =
        |of: PolicyConfig| guides.iter().map(move |&guide| PolicyConfig { guide, ..of.clone() });
    let of = |name| PolicyConfig { name, ilc: false, ..asked.clone() };
    let inference = Inference::default();
    let plain = |name| PolicyConfig { model_path: None, inference, ..of(name) };
    let mut list = Vec::new();
    if asked.model_path.is_some() || shipped::has_default(robot)? {
        let model: Arc<Model> = of(PolicyName::Robert).model(robot)?;
        // Without a step of training the network adds nothing to the linear prediction.
        let linear = model.encoder.ridge.is_some();
        if model.card.training.step > 0 || !linear {
            list.extend(each(of(PolicyName::Robert)));
            if asked.guide == Guide::None && model.card.reach.is_some() {
                let inference = Inference { masks: true, ..asked.inference };
                list.push(PolicyConfig { inference, ..of(PolicyName::Robert) });
            }
        }
        if linear {
            list.extend(each(PolicyConfig { inference, ..of(PolicyName::Ridge) }));
        }
    }
    // A robot of the user's own has no other policy before `robert new`, and should not lose it.
    if list.is_empty() || robot.folder().is_some() {
        list.extend(each(plain(PolicyName::ComputedTorque)));
    }
    list.extend(each(plain(PolicyName::Pd)));
    Ok(list)
}

/// The planner whose own motion may be chosen, if any policy may. Its cost on small robots has no term for
/// gaps, so it gets smooth goals there.
pub(super) fn planner(robot: &Robot, asked: &PolicyConfig) -> Option<PolicyConfig> {
    let free = asked.name == PolicyName::Auto && asked.guide == Guide::None;
    let ahead = IlqrConfig::for_robot(robot).guide_weight == 0.0;
    let guide = if ahead && free { Guide::Smooth } else { asked.guide };
    (asked.name == PolicyName::Auto).then(|| PolicyConfig { guide, ..PolicyConfig::floor() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::learner::VISIBLE_ERROR;
    use crate::tasks;
    use crate::{Choice, LiveRollout};
    use robert_base::progress::Silent;
    use robert_clip::compile;

    fn trial(precision: f64, gaps: f64) -> Trial {
        Trial { policy: "x".into(), precision: Some(precision), gaps, error: None }
    }

    #[test]
    fn the_nearest_wins_unless_it_swings() {
        assert_eq!(best(&[trial(0.2, 0.0), trial(0.1, 0.01), trial(0.1, 0.02)]), Some(1));
        assert_eq!(best(&[trial(4e-4, 2e-3), trial(5e-4, 0.0), trial(5e-4, 0.0)]), Some(1));
        // Where all shake, the distance to the goals decides.
        let wild = |precision, gaps| trial(precision, counted(gaps));
        assert_eq!(best(&[wild(0.35, 0.15), wild(0.15, 0.9), wild(0.2, 5.0)]), Some(1));
        let failed = Trial { precision: None, ..trial(0.0, 0.0) };
        assert_eq!(best(&[failed.clone(), trial(0.1, 0.0)]), Some(1));
        assert_eq!(best(&[failed]), None);
    }

    #[test]
    fn a_motion_that_is_farther_than_proportional_control_is_no_choice() {
        let pd = Trial { policy: "pd".into(), ..trial(1e-4, 5e-3) };
        // Natural in its gaps, but it leaves goals that proportional control meets.
        let smooth = trial(4e-4, 0.0);
        let tried = [trial(1e-6, 2e-3), pd, smooth.clone()];
        assert_eq!(best(&tried), Some(0));
        assert!(!leads(&tried[..2], &smooth));
        assert!(leads(&tried, &trial(1.02e-4, 0.0)));
        assert_eq!(best(&tried[2..]), Some(0), "it may be all that there is");
    }

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
        let chosen = all.perform(&command, &Start::Pose, 0, 2, &Silent, &cancel).unwrap();
        let gaps = crate::GapFigures::of(&chosen.rollout).unwrap();
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
        let score = |t: &Trial| t.precision.unwrap() + t.gaps;
        assert!(one.tried.iter().all(|t| score(own) <= score(t)));
    }
}
