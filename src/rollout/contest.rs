//! The policies that compete on a clip, and what follows from how they perform it.
//!
//! [`super::auto`] performs a clip once, and [`super::live`] while it is edited; both compare the same
//! contenders by the same rules.

use std::sync::Arc;

use super::error::Error;
use super::goals::Goals;
use super::guide::Guide;
use super::ilc::Repeats;
use super::ilqr::IlqrConfig;
use super::inference::Inference;
use super::judge::Judge;
use super::learner::Learner;
use super::natural::{counted, unnatural_but_for_jolts};
use super::policy::Policy;
use super::policy_config::PolicyConfig;
use super::policy_name::PolicyName;
use super::run::{Rollout, RolloutConfig};
use super::shipped;
use super::start::Start;
use super::trial::{Trial, leaders, leads, least, near};
use robert_clip::Command;
use robert_net::Model;
use robert_robot::{PlantConfig, Robot};

/// The policies that compete on one robot.
pub(super) struct Contest {
    robot: Arc<Robot>,
    /// The contenders, in the order in which they are tried.
    policies: Vec<PolicyConfig>,
    /// The planners whose motions may be chosen. Their places are after the contenders.
    planners: Vec<PolicyConfig>,
    /// Whether the best ones repeat the clip.
    pub(super) learns: bool,
}

impl Contest {
    /// The contenders for the request `asked`: all that are tried for `auto`, or the policy that it names.
    pub(super) fn new(robot: &Arc<Robot>, asked: &PolicyConfig) -> Result<Contest, Error> {
        // With refinement a pass takes seconds, so repeating has to be asked for.
        let learns = asked.is_tried() && (asked.ilc || !asked.refine);
        let (policies, planners) = (contenders(robot, asked)?, planners(robot, asked));
        Ok(Contest { robot: Arc::clone(robot), policies, planners, learns })
    }

    /// The contenders.
    pub(super) fn policies(&self) -> &[PolicyConfig] {
        &self.policies
    }

    /// The settings of a contender, or of a planner.
    pub(super) fn policy(&self, at: usize) -> &PolicyConfig {
        let planner = at.checked_sub(self.policies.len());
        planner.map_or_else(|| &self.policies[at], |planner| &self.planners[planner])
    }

    /// The goals of a clip that begins so, for this robot.
    pub(super) fn goals(&self, start: &Start, command: &Command) -> Goals {
        start.goals(command).tied(&self.robot)
    }

    /// The places of the contenders that move differently. In a clip without gaps there is nothing to
    /// fill, so a policy moves like its twin that does not fill them.
    pub(super) fn differing(&self, goals: &Goals) -> Vec<usize> {
        let repeats = |policy: &PolicyConfig| {
            let inference = Inference { masks: false, ..policy.inference };
            let twin = PolicyConfig { guide: Guide::None, inference, ..policy.clone() };
            twin != *policy && self.policies.contains(&twin)
        };
        let places = 0..self.policies.len();
        places.filter(|&at| goals.has_gaps() || !repeats(&self.policies[at])).collect()
    }

    /// A rollout of a contender at its beginning; the goals are those of the command from this start.
    /// `fork` is its policy, if one was built before.
    pub(super) fn rollout(
        &self,
        at: usize,
        fork: Option<Box<dyn Policy>>,
        (command, goals): (&Command, &Goals),
        start: &Start,
        seed: u64,
    ) -> Result<Rollout, Error> {
        let policy = &self.policies[at];
        let built = fork.map_or_else(|| policy.build(&self.robot), Ok)?;
        let config = RolloutConfig { seed, guide: policy.guide, plant: PlantConfig::default() };
        Rollout::prepared(&self.robot, built, (command, goals.clone()), start.clone(), config)
    }

    /// The best contenders, about to repeat the clip; `None` if none can. `motions` holds what each of
    /// `tried` did, with the place of its contender; `fresh` makes a rollout of a contender at its
    /// beginning.
    pub(super) fn learner(
        &self,
        tried: &[Trial],
        motions: &[Option<(usize, &Rollout)>],
        fresh: impl Fn(usize) -> Result<Rollout, Error>,
        threads: usize,
    ) -> Option<Learner> {
        let judge = Judge::default().no_farther_than(near(tried));
        let racer = |turn: usize| {
            let (at, first) = motions[turn]?;
            let rollouts = [fresh(at).ok()?, fresh(at).ok()?];
            Repeats::new((at, &self.policies[at]), first, rollouts, judge.clone()).ok()?
        };
        let racers = leaders(tried).filter(|_| self.learns).filter_map(racer).collect();
        let places = self.policies.len()..;
        Learner::new(racers, places.zip(self.planners.clone()).collect(), least(tried), threads)
    }

    /// The policy of a `motion` that was learned by a contender or planned, and its result, if it is better
    /// than all that were tried.
    pub(super) fn better(
        &self,
        tried: &[Trial],
        at: usize,
        motion: &Rollout,
    ) -> Option<(PolicyConfig, Trial)> {
        let policy = PolicyConfig { ilc: motion.lead().is_some(), ..self.policy(at).clone() };
        let trial = Trial::of(&policy, motion);
        // A planner that is far nearer than the others is worth a jolt.
        let gaps = counted(unnatural_but_for_jolts(motion));
        let planned = at >= self.policies.len() && leads(tried, &Trial { gaps, ..trial.clone() });
        (planned || leads(tried, &trial)).then_some((policy, trial))
    }
}

/// The list of contenders. With a model: the network alone, with smooth motion through the gaps,
/// and filling the gaps itself; the linear prediction and proportional control, alone and with
/// smooth motion. For a robot of the user's own, and without a model: policies that need no data. For a
/// named policy: this one.
fn contenders(robot: &Robot, asked: &PolicyConfig) -> Result<Vec<PolicyConfig>, Error> {
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

/// The planners whose own motions may be chosen, if any policy may. On small robots their cost has no term for
/// gaps, so one gets smooth goals there; the other one is free to swing a load up that no motor can lift.
fn planners(robot: &Robot, asked: &PolicyConfig) -> Vec<PolicyConfig> {
    if asked.name != PolicyName::Auto {
        return Vec::new();
    }
    let free = asked.guide == Guide::None;
    let ahead = IlqrConfig::for_robot(robot).guide_weight == 0.0;
    let guides = if ahead && free { &[Guide::Smooth, Guide::None][..] } else { &[asked.guide] };
    guides.iter().map(|&guide| PolicyConfig { guide, ..PolicyConfig::floor() }).collect()
}
