//! The rollout: one control step per frame. Every frame is kept, so it can be resumed anywhere.

use std::sync::Arc;

use super::error::Error;
use super::goals::Goals;
use super::guide::Guide;
use super::holds;
use super::joint_order::check_joints;
use super::lead::Lead;
use super::nominal_model::substeps;
use super::policy::{Policy, View};
use super::precision::Precision;
use super::start::{Start, first_state};
use super::window::{COMMAND, HISTORY, Window};
use super::worst::Worst;
use robert_base::progress::Cancel;
use robert_base::units::CTRL_DT;
use robert_clip::Command;
use robert_mujoco::{Data, Snapshot};
use robert_robot::{PlantConfig, Robot};

/// Settings of a rollout.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RolloutConfig {
    /// Seed of the policy's random choices.
    pub seed: u64,
    /// The rule that fills masked frames.
    pub guide: Guide,
    /// The simulated plant.
    pub plant: PlantConfig,
}

/// One simulated frame.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// Its number; the first simulated frame is 1.
    pub frame: usize,
    /// State reached; (S).
    pub reached: &'a [f64],
    /// The action that led here, applied during the previous frame; (A).
    pub action: &'a [f64],
    /// Mean absolute error over its goals; `None` if it is masked.
    pub error: Option<f64>,
}

/// Errors of a motion, rad or m.
#[derive(Clone, Copy, Debug)]
pub(super) struct Errors {
    pub(super) precision: f64,
    /// In a clip with dropouts, the mean error over goals and the likely motion in dropouts.
    pub(super) with_dropouts: Option<f64>,
    /// This if there are dropouts, else Precision, and the error of tied joints together: what decides.
    pub(super) judged: f64,
}

/// A clip being performed by a policy.
///
/// ```
/// use std::sync::Arc;
///
/// use robert_clip::compile;
/// use robert_base::progress::Cancel;
/// use robert_robot::Robot;
/// use robert_rollout::{PolicyConfig, PolicyName, Rollout, RolloutConfig, Start, tasks};
///
/// let clip = tasks::find("pointmass/circle", None)?;
/// let (robot, command) = (Arc::new(Robot::builtin(&clip.robot.id)?), compile(&clip)?);
/// let policy = PolicyConfig::new(PolicyName::Pd).build(&robot)?;
/// let config = RolloutConfig::default();
/// let mut rollout = Rollout::new(&robot, policy, &command, Start::Pose, config)?;
/// rollout.run(&Cancel::default())?;
/// assert!(rollout.precision().precision.is_some_and(|error_m| error_m < 0.1));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Rollout {
    robot: Arc<Robot>,
    policy: Box<dyn Policy>,
    config: RolloutConfig,
    start: Start,
    goals: Goals,
    /// What the policy sees: the goals, with smooth motion in the gaps if the guide asks for it.
    plan: Goals,
    /// The plan with the lead of [`Rollout::correct`].
    led: Goals,
    /// That lead.
    lead: Option<Lead>,
    start_pose: Vec<f64>,
    /// The state at frame 0 of a rollout from that pose, (S); empty if it begins in a recorded motion.
    first: Vec<f64>,
    plant: Data,
    substeps: usize,
    window: Window,
    /// Pre-roll and frames 0..=t; (30 + t + 1, S).
    reached: Vec<f64>,
    /// (t, A).
    actions: Vec<f64>,
    /// State at each frame 0..=t.
    snapshots: Vec<Snapshot>,
    /// The policy's memory before acting at each frame 0..=t.
    memories: Vec<Vec<f64>>,
    simulated: usize,
}

impl Rollout {
    /// Prepares a rollout; nothing is simulated yet.
    ///
    /// # Errors
    /// [`Error::Joints`] when the command is for another robot, [`Error::TooShort`],
    /// [`Error::Timestep`], [`Error::Setup`].
    pub fn new(
        robot: &Arc<Robot>,
        policy: Box<dyn Policy>,
        command: &Command,
        start: Start,
        config: RolloutConfig,
    ) -> Result<Rollout, Error> {
        check_joints(robot, command)?;
        let goals = start.goals(command);
        Rollout::prepared(robot, policy, (command, goals), start, config)
    }

    /// As [`Rollout::new`], with the goals of the command, [`Start::goals`].
    pub(super) fn prepared(
        robot: &Arc<Robot>,
        policy: Box<dyn Policy>,
        (command, goals): (&Command, Goals),
        start: Start,
        config: RolloutConfig,
    ) -> Result<Rollout, Error> {
        check_joints(robot, command)?;
        Rollout::begin(robot, policy, goals, pose(command), start, config)
    }

    /// The same clip from the same start with another policy; nothing is simulated yet.
    pub(super) fn with(&self, policy: Box<dyn Policy>, guide: Guide) -> Result<Rollout, Error> {
        let config = RolloutConfig { guide, ..self.config.clone() };
        let (goals, start_pose) = (self.goals.clone(), self.start_pose.clone());
        Rollout::begin(&self.robot, policy, goals, start_pose, self.start.clone(), config)
    }

    fn begin(
        robot: &Arc<Robot>,
        policy: Box<dyn Policy>,
        goals: Goals,
        start_pose: Vec<f64>,
        start: Start,
        config: RolloutConfig,
    ) -> Result<Rollout, Error> {
        let model = config.plant.model(robot)?;
        let substeps = substeps(&model)?;
        let plant = Data::new(&model)?;
        let goals = goals.tied(robot);
        let plan = plan(&goals, config.guide);
        let first = match start {
            Start::Pose => first_state(robot, &start_pose)?,
            Start::Recorded { .. } => Vec::new(),
        };
        let mut rollout = Rollout {
            robot: Arc::clone(robot),
            policy,
            config,
            start,
            plan: plan.clone(),
            led: plan,
            lead: None,
            goals,
            first,
            start_pose,
            plant,
            substeps,
            window: Window::new(robot.state_dim()),
            reached: Vec::new(),
            actions: Vec::new(),
            snapshots: Vec::new(),
            memories: Vec::new(),
            simulated: 0,
        };
        if rollout.goals.frames() < 2 {
            return Err(Error::TooShort { frames: rollout.goals.frames() });
        }
        rollout.rewind()?;
        Ok(rollout)
    }

    /// Resets to frame 0.
    fn rewind(&mut self) -> Result<(), Error> {
        let dim = self.robot.state_dim();
        self.plant.reset()?;
        self.reached.clear();
        match &self.start {
            Start::Pose => {
                for _ in 0..=HISTORY {
                    self.reached.extend_from_slice(&self.first);
                }
                self.robot.write_state(&mut self.plant, &self.first)?;
            }
            Start::Recorded { history, state, velocity } => {
                let lengths =
                    [(history.len(), HISTORY * dim), (state.len(), dim), (velocity.len(), dim)];
                for (got, want) in lengths {
                    if got != want {
                        let what = "recorded start";
                        return Err(robert_mujoco::Error::Length { what, got, want }.into());
                    }
                }
                self.reached.extend_from_slice(history);
                self.reached.extend_from_slice(state);
                self.robot.write_state(&mut self.plant, state)?;
                let mut qvel = vec![0.0; self.plant.qvel().len()];
                for (joint, v) in self.robot.joints().iter().zip(velocity) {
                    qvel[joint.dofadr] = *v;
                }
                self.plant.set_qvel(&qvel)?;
            }
        }
        self.actions.clear();
        self.policy.reset(self.config.seed);
        self.snapshots.clear();
        self.snapshots.push(self.plant.snapshot());
        self.memories.clear();
        self.memories.push(self.policy.memory());
        Ok(())
    }

    /// The last simulated frame; 0 before the first step.
    pub fn frame(&self) -> usize {
        self.snapshots.len().saturating_sub(1)
    }

    /// Whether two links touch at the end of the last step.
    pub fn touches_itself(&self) -> bool {
        self.plant.touches_itself()
    }

    /// Frames of the clip.
    pub fn frames(&self) -> usize {
        self.goals.frames()
    }

    /// Whether every frame has been simulated.
    pub fn is_done(&self) -> bool {
        self.frame() + 1 >= self.frames()
    }

    /// Control steps that this rollout has simulated so far, including those that an edit has
    /// replaced.
    pub fn simulated(&self) -> usize {
        self.simulated
    }

    /// Simulates one frame; `None` at the end.
    ///
    /// # Errors
    /// [`Error::Simulation`] with the frame when the plant diverges, [`Error::BadAction`]
    /// when the policy returns a value that is not a number. The frames before stay valid, and the
    /// next call tries the same frame again.
    pub fn step(&mut self) -> Result<Option<Frame<'_>>, Error> {
        if self.is_done() {
            return Ok(None);
        }
        let t = self.frame();
        if let Err(e) = self.advance(t) {
            // A plant that diverged has been reset, and the policy has seen this frame.
            self.plant.restore(&self.snapshots[t])?;
            self.policy.recall(&self.memories[t]);
            return Err(e);
        }
        Ok(Some(self.at(t + 1)))
    }

    /// Simulates frame t.
    fn advance(&mut self, t: usize) -> Result<(), Error> {
        let (dim, actions) = (self.robot.state_dim(), self.robot.action_dim());
        self.window.fill(t, &self.reached, &self.led);
        if self.config.guide == Guide::Linear {
            self.window.guide_linear();
        }
        let mut action = vec![0.0; actions];
        let view = View { frame: t, window: &self.window, state: &self.snapshots[t] };
        self.policy.act(&view, &mut action)?;
        if let Some(actuator) = action.iter().position(|a| !a.is_finite()) {
            return Err(Error::BadAction {
                frame: t,
                policy: self.policy.name(),
                actuator,
                value: action[actuator],
            });
        }
        action.iter_mut().for_each(|a| *a = a.clamp(-1.0, 1.0));
        self.robot.apply_action(&mut self.plant, &action)?;
        self.plant.step(self.substeps).map_err(|source| Error::Simulation { frame: t, source })?;
        self.simulated += 1;
        let at = self.reached.len();
        self.reached.resize(at + dim, 0.0);
        self.robot.read_state(&self.plant, &mut self.reached[at..]);
        self.actions.extend_from_slice(&action);
        self.snapshots.push(self.plant.snapshot());
        self.memories.push(self.policy.memory());
        Ok(())
    }

    /// Simulates to the end or until cancelled.
    ///
    /// # Errors
    /// As [`Rollout::step`], and [`Error::Cancelled`].
    pub fn run(&mut self, cancel: &Cancel) -> Result<(), Error> {
        while !self.is_done() {
            if cancel.is_cancelled() {
                return Err(Error::Cancelled { frame: self.frame() });
            }
            self.step()?;
        }
        Ok(())
    }

    /// Replaces the command and keeps every frame that the change cannot affect. An action depends
    /// on 20 frames ahead, so a command that first differs at f leaves the actions before f - 20
    /// unchanged, unless the policy sees a plan through the gap before. Returns the frame from which
    /// the rollout continues; the result has the same bits as a rollout from the start.
    ///
    /// # Errors
    /// As [`Rollout::new`]; the rollout is then unchanged.
    pub fn set_command(&mut self, command: &Command) -> Result<usize, Error> {
        check_joints(&self.robot, command)?;
        self.set_goals(command, self.start.goals(command))
    }

    /// As [`Rollout::set_command`], with the goals of the command, [`Start::goals`].
    pub(super) fn set_goals(&mut self, command: &Command, goals: Goals) -> Result<usize, Error> {
        check_joints(&self.robot, command)?;
        if goals.frames() < 2 {
            return Err(Error::TooShort { frames: goals.frames() });
        }
        let start_pose = pose(command);
        let moved = self.start == Start::Pose && start_pose != self.start_pose;
        let first_state = moved.then(|| first_state(&self.robot, &start_pose)).transpose()?;
        let goals = goals.tied(&self.robot);
        let plan = plan(&goals, self.config.guide);
        let first = if moved { Some(0) } else { self.first_difference(&self.led, &plan) };
        (self.goals, self.led, self.plan, self.lead) = (goals, plan.clone(), plan, None);
        self.start_pose = start_pose;
        if let Some(state) = first_state {
            self.first = state;
            self.rewind()?;
            return Ok(0);
        }
        if let Some(f) = first {
            self.back_to(f.saturating_sub(COMMAND))?;
        }
        self.back_to(self.frames() - 1)?;
        Ok(self.frame())
    }

    /// The first frame whose goals, or plan if the policy sees it, differ in a way that changes some
    /// window.
    fn first_difference(&self, a: &Goals, b: &Goals) -> Option<usize> {
        let goals = a.first_difference(b);
        let plan = a.first_other_plan(b).filter(|_| self.policy.sees_plan());
        [goals, plan].into_iter().flatten().min()
    }

    /// Leads the policy besides its goals, and keeps every frame that this cannot affect. Errors are still
    /// measured against the command.
    pub(super) fn correct(&mut self, lead: Lead) -> Result<(), Error> {
        let led = self.plan.led_by(&lead);
        let first = self.first_difference(&self.led, &led);
        (self.led, self.lead) = (led, Some(lead));
        first.map_or(Ok(()), |f| self.back_to(f.saturating_sub(COMMAND)))
    }

    /// As [`Rollout::correct`], but goes on from the frames of `other` that this cannot affect.
    /// `other` is the same rollout with another lead.
    pub(super) fn branch(&mut self, other: &Rollout, lead: Lead) -> Result<(), Error> {
        let led = other.plan.led_by(&lead);
        let before = |a: &Goals, b: &Goals| {
            self.first_difference(a, b).map_or(usize::MAX, |f| f.saturating_sub(COMMAND))
        };
        let keep = before(&other.led, &led).min(other.frame());
        self.back_to(before(&self.led, &other.led).min(keep))?;
        let (dim, actions) = (self.robot.state_dim(), self.robot.action_dim());
        let from = self.frame();
        self.reached
            .extend_from_slice(&other.states()[self.reached.len()..(HISTORY + keep + 1) * dim]);
        self.actions.extend_from_slice(&other.actions[from * actions..keep * actions]);
        self.snapshots.extend_from_slice(&other.snapshots[from + 1..=keep]);
        self.memories.extend_from_slice(&other.memories[from + 1..=keep]);
        self.plant.restore(&self.snapshots[keep])?;
        self.policy.recall(&self.memories[keep]);
        (self.led, self.lead) = (led, Some(lead));
        Ok(())
    }

    /// Takes over the lead and the frames of `other`, which is the same rollout otherwise.
    pub(super) fn copy(&mut self, other: &Rollout) -> Result<(), Error> {
        self.branch(other, other.lead_or_none())
    }

    /// What leads the policy besides its goals, if anything does.
    pub(super) fn lead(&self) -> Option<&Lead> {
        self.lead.as_ref()
    }

    /// The same; no corrections if nothing leads it.
    pub(super) fn lead_or_none(&self) -> Lead {
        let none = || Lead::none(self.frames() * self.goals.dim());
        self.lead.clone().unwrap_or_else(none)
    }

    /// What the policy sees.
    pub(super) fn led(&self) -> &Goals {
        &self.led
    }

    /// What the policy sees without a lead.
    pub(super) fn plan(&self) -> &Goals {
        &self.plan
    }

    /// The states of frames `from`+1 ..= `to` that the same policy reaches from frame `from` where nothing
    /// touches; (to - from, S). `to` must have been reached. The rollout stays as it is.
    ///
    /// # Errors
    /// As [`Rollout::step`], and [`Error::Cancelled`] as soon as `stopped`.
    pub(super) fn without_contact(
        &mut self,
        from: usize,
        to: usize,
        stopped: &dyn Fn() -> bool,
    ) -> Result<Vec<f64>, Error> {
        let mut model = self.plant.model().duplicate()?;
        model.set_contacts(false);
        let mut alone = Data::new(&Arc::new(model))?;
        alone.restore(&self.snapshots[from])?;
        let (dim, actions) = (self.robot.state_dim(), self.robot.action_dim());
        let start = (HISTORY + from + 1) * dim;
        let reached = self.reached.split_off(start);
        let acted = self.actions.split_off(from * actions);
        let snapshots = self.snapshots.split_off(from + 1);
        let memories = self.memories.split_off(from + 1);
        let simulated = self.simulated;
        let plant = std::mem::replace(&mut self.plant, alone);
        self.policy.recall(&self.memories[from]);
        let done = (from..to).try_for_each(|frame| {
            if stopped() { Err(Error::Cancelled { frame }) } else { self.advance(frame) }
        });
        let states = self.reached.split_off(start);
        self.reached.extend(reached);
        self.actions.truncate(from * actions);
        self.actions.extend(acted);
        self.snapshots.truncate(from + 1);
        self.snapshots.extend(snapshots);
        self.memories.truncate(from + 1);
        self.memories.extend(memories);
        (self.plant, self.simulated) = (plant, simulated);
        self.policy.recall(&self.memories[self.frame()]);
        done.map(|()| states)
    }

    /// Drops the frames after `t`.
    fn back_to(&mut self, t: usize) -> Result<(), Error> {
        if t >= self.frame() {
            return Ok(());
        }
        let (dim, actions) = (self.robot.state_dim(), self.robot.action_dim());
        self.reached.truncate((HISTORY + t + 1) * dim);
        self.actions.truncate(t * actions);
        self.snapshots.truncate(t + 1);
        self.memories.truncate(t + 1);
        self.plant.restore(&self.snapshots[t])?;
        self.policy.recall(&self.memories[t]);
        Ok(())
    }

    /// A frame that has been reached; frame 0 has no action.
    fn at(&self, frame: usize) -> Frame<'_> {
        let actions = self.robot.action_dim();
        let reached = self.reached_at(frame);
        let goal = self.goals.row(frame);
        let (mut sum, mut n) = (0.0, 0);
        for j in 0..reached.len() {
            if self.goals.is_visible(frame, j) {
                sum += (reached[j] - goal[j]).abs();
                n += 1;
            }
        }
        let action = match frame {
            0 => &[][..],
            f => &self.actions[(f - 1) * actions..f * actions],
        };
        Frame { frame, reached, action, error: (n > 0).then(|| sum / f64::from(n)) }
    }

    /// The frames reached so far, frame 0 first.
    pub fn frames_reached(&self) -> impl Iterator<Item = Frame<'_>> {
        (0..=self.frame()).map(|f| self.at(f))
    }

    fn reached_at(&self, frame: usize) -> &[f64] {
        let dim = self.robot.state_dim();
        &self.reached[(HISTORY + frame) * dim..(HISTORY + frame + 1) * dim]
    }

    /// States of frames 0..=t; (t + 1, S).
    pub fn reached(&self) -> &[f64] {
        &self.reached[HISTORY * self.robot.state_dim()..]
    }

    /// The 30 frames before frame 0, then frames 0..=t; (30 + t + 1, S).
    pub fn states(&self) -> &[f64] {
        &self.reached
    }

    /// Actions of frames 0..t; (t, A).
    pub fn actions(&self) -> &[f64] {
        &self.actions
    }

    /// Full simulator state at a frame that has been reached.
    pub fn snapshot(&self, frame: usize) -> Option<&Snapshot> {
        self.snapshots.get(frame)
    }

    /// The goals.
    pub fn goals(&self) -> &Goals {
        &self.goals
    }

    /// The goals by which motions are compared: with the likely motion in dropouts.
    pub(super) fn sought(&self) -> &Goals {
        self.goals.restored()
    }

    /// What motions are compared by. `None` if nothing is commanded.
    pub(super) fn errors(&self) -> Option<Errors> {
        let precision = self.precision().precision?;
        let (goals, reached) = (self.sought(), self.reached());
        let restored = self.goals.has_dropouts().then(|| self.measured(goals));
        let with_dropouts = restored.and_then(|r| r.precision);
        let frames = 1..goals.frames().min(reached.len() / goals.dim());
        let together: f64 = frames.clone().map(|f| goals.tied_error(reached, f)).sum();
        let together = together / goals.commanded(&frames).max(1.0);
        let judged = with_dropouts.unwrap_or(precision) + together;
        Some(Errors { precision, with_dropouts, judged })
    }

    /// The robot.
    pub fn robot(&self) -> &Arc<Robot> {
        &self.robot
    }

    /// A copy of the policy for another rollout, if it can share expensive parts.
    pub(super) fn fork_policy(&self) -> Option<Box<dyn Policy>> {
        self.policy.fork()
    }

    /// The card of a learned policy, JSON.
    pub fn policy_card(&self) -> Option<String> {
        self.policy.card()
    }

    /// Whether the policy used a model of the robot.
    pub fn uses_model(&self) -> bool {
        self.policy.uses_model()
    }

    /// The largest motion of a joint within a hold that does not bring it nearer to its goal, rad or m, from eight
    /// frames after the start of the hold; `None` without
    /// a hold of more frames.
    pub fn hold_motion(&self) -> Option<Worst> {
        let joints: Vec<_> = self.robot.joints().iter().map(|j| j.name.clone()).collect();
        holds::longest(&self.goals, self.states(), &joints)
    }

    /// The figures over the frames so far.
    pub fn precision(&self) -> Precision {
        self.measured(&self.goals)
    }

    fn measured(&self, goals: &Goals) -> Precision {
        Precision::measure(goals, self.reached(), &self.actions, self.robot.action_dim())
    }

    /// Simulated time minus clip time at the last reached frame, seconds. It is 0 except for
    /// rounding.
    pub fn clock_error_secs(&self) -> f64 {
        let clip = self.frame() as f64 * CTRL_DT;
        let Some(last) = self.snapshots.last() else { unreachable!("the start is kept") };
        last.time_secs - clip
    }
}

impl std::fmt::Debug for Rollout {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Rollout")
            .field("policy", &self.policy.name())
            .field("frame", &self.frame())
            .field("frames", &self.frames())
            .finish_non_exhaustive()
    }
}

fn pose(command: &Command) -> Vec<f64> {
    command.start().iter().map(|&v| f64::from(v)).collect()
}

/// The goals as the guide leaves them for the policy.
fn plan(goals: &Goals, guide: Guide) -> Goals {
    match guide {
        Guide::Smooth => goals.smooth(),
        Guide::None | Guide::Linear => goals.clone(),
    }
}

#[cfg(test)]
mod tests;
