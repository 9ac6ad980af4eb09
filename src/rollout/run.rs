//! The rollout: one control step per frame. Every frame is kept, so it can be resumed anywhere.

use std::sync::Arc;

use super::error::Error;
use super::guide::Guide;
use super::holds;
use super::nominal_model::substeps;
use super::policy::{Policy, View};
use super::precision::Precision;
use super::window::{COMMAND, Goals, HISTORY, Window};
use super::worst::Worst;
use robert_base::progress::Cancel;
use robert_base::units::CTRL_DT;
use robert_clip::Command;
use robert_mujoco::{Data, Snapshot};
use robert_robot::{PlantConfig, Robot};

/// The start of a rollout.
#[derive(Clone, Debug, PartialEq)]
pub enum Start {
    /// At the clip's start pose, at rest, as if it had been held for 30 frames.
    Pose,
    /// In the middle of a recorded motion.
    Recorded {
        /// States of the 30 frames before; (30, S).
        history: Vec<f64>,
        /// State of frame 0; (S).
        state: Vec<f64>,
        /// True joint velocities of frame 0; (S).
        velocity: Vec<f64>,
    },
}

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
    /// The plan with the corrections of [`Rollout::correct`].
    led: Goals,
    /// Those corrections; (frames, S).
    shift: Option<Vec<f64>>,
    start_pose: Vec<f64>,
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
        Rollout::begin(robot, policy, Goals::new(command), pose(command), start, config)
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
        let plan = plan(&goals, config.guide);
        let mut rollout = Rollout {
            robot: Arc::clone(robot),
            policy,
            config,
            start,
            plan: plan.clone(),
            led: plan,
            shift: None,
            goals,
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
                    self.reached.extend_from_slice(&self.start_pose);
                }
                self.robot.write_state(&mut self.plant, &self.start_pose)?;
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
        let goals = Goals::new(command);
        if goals.frames() < 2 {
            return Err(Error::TooShort { frames: goals.frames() });
        }
        let start_pose = pose(command);
        let moved = self.start == Start::Pose && start_pose != self.start_pose;
        let plan = plan(&goals, self.config.guide);
        let first = if moved { Some(0) } else { self.first_difference(&self.led, &plan) };
        (self.goals, self.led, self.plan, self.shift) = (goals, plan.clone(), plan, None);
        self.start_pose = start_pose;
        if moved {
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

    /// Moves every goal that the policy sees by `shift`, (frames, S), rad or m, and keeps every frame
    /// that this cannot affect. Errors are still measured against the command.
    pub(super) fn correct(&mut self, shift: &[f64]) -> Result<(), Error> {
        let led = self.plan.shifted(shift);
        let first = self.first_difference(&self.led, &led);
        (self.led, self.shift) = (led, Some(shift.to_vec()));
        first.map_or(Ok(()), |f| self.back_to(f.saturating_sub(COMMAND)))
    }

    /// As [`Rollout::correct`], but goes on from the frames of `other` that this cannot affect.
    /// `other` is the same rollout with other corrections.
    pub(super) fn branch(&mut self, other: &Rollout, shift: &[f64]) -> Result<(), Error> {
        let led = other.plan.shifted(shift);
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
        (self.led, self.shift) = (led, Some(shift.to_vec()));
        Ok(())
    }

    /// Takes over the corrections and the frames of `other`, which is the same rollout otherwise.
    pub(super) fn copy(&mut self, other: &Rollout) -> Result<(), Error> {
        match other.shift() {
            Some(shift) => self.branch(other, shift),
            None => self.branch(other, &vec![0.0; other.frames() * other.goals.dim()]),
        }
    }

    /// The corrections, if there are any; (frames, S).
    pub(super) fn shift(&self) -> Option<&[f64]> {
        self.shift.as_deref()
    }

    /// What the policy sees without corrections.
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
        Precision::measure(&self.goals, self.reached(), &self.actions, self.robot.action_dim())
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

/// The command must name the robot's joints in the robot's order.
fn check_joints(robot: &Robot, command: &Command) -> Result<(), Error> {
    let known: Vec<&str> = robot.joints().iter().map(|j| j.name.as_str()).collect();
    if known.iter().eq(command.joints().iter()) {
        return Ok(());
    }
    let strange = command.joints().iter().find(|j| !known.contains(&j.as_str()));
    let why = match strange {
        Some(joint) => format!("\"{joint}\" is not a joint of the robot"),
        None => "their order differs, or some are missing".to_owned(),
    };
    Err(Error::Joints {
        robot: robot.id().to_owned(),
        got: command.dim(),
        want: robot.state_dim(),
        hint: format!("{why}; correct the clip, or name its own robot with --robot"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{PolicyConfig, PolicyName};
    use robert_base::rng::{Rng, Stream};

    fn robot(id: &str) -> Arc<Robot> {
        Arc::new(Robot::builtin(id).unwrap())
    }

    /// Poses near home at a few frames, masked between.
    fn command(robot: &Robot, frames: usize, keys: &[(usize, f64)]) -> Command {
        let dim = robot.state_dim();
        let home = robot.home();
        let (mut q, mut visible) = (vec![0.0_f32; frames * dim], vec![false; frames * dim]);
        for &(f, offset) in keys {
            for (j, joint) in robot.joints().iter().enumerate() {
                let v = (home[j] + offset * (j as f64 + 1.0).sin())
                    .clamp(joint.range[0].max(-10.0), joint.range[1].min(10.0));
                q[f * dim + j] = v as f32;
                visible[f * dim + j] = true;
            }
        }
        let start = home.iter().map(|&v| v as f32).collect();
        let names = robot.joints().iter().map(|j| j.name.clone()).collect();
        Command::from_dense(names, start, q, visible).unwrap()
    }

    fn rollout(robot: &Arc<Robot>, name: PolicyName, command: &Command) -> Rollout {
        let policy = PolicyConfig::new(name).build(robot).unwrap();
        Rollout::new(robot, policy, command, Start::Pose, RolloutConfig::default()).unwrap()
    }

    fn bits(r: &Rollout) -> Vec<u64> {
        r.reached().iter().chain(r.actions()).map(|v| v.to_bits()).collect()
    }

    #[test]
    fn a_gap_that_is_repeated_without_contact_leaves_the_rollout_as_it_is() {
        let robot = robot("shadow_hand");
        let dim = robot.state_dim();
        let mut ridge = PolicyConfig::new(PolicyName::Ridge);
        ridge.inference.gain = true;
        let cases = [
            (PolicyConfig::new(PolicyName::Pd), "rsp_high_mask"),
            (PolicyConfig::new(PolicyName::Random), "rsp_high_mask"),
            (ridge, "rsp_high_mask"),
        ];
        for (policy, name) in cases {
            let clip = crate::tasks::find(&format!("shadow_hand/{name}"), None).unwrap();
            let command = robert_clip::compile(&clip).unwrap();
            let begun = || {
                let built = policy.build(&robot).unwrap();
                let config = RolloutConfig::default();
                Rollout::new(&robot, built, &command, Start::Pose, config).unwrap()
            };
            let (mut whole, mut cut) = (begun(), begun());
            whole.run(&Cancel::default()).unwrap();
            while cut.frame() < 60 {
                cut.step().unwrap();
            }
            let reached = cut.states()[(HISTORY + 27) * dim..(HISTORY + 61) * dim].to_vec();
            let (memories, simulated) = (cut.memories.clone(), cut.simulated());
            let alone = cut.without_contact(26, 60, &|| false).unwrap();
            // The fingers push the thumb; without contact it stays where it is.
            assert_eq!(alone.len(), reached.len());
            let far = |states: &[f64]| {
                let thumb = states.chunks_exact(dim).map(|q| (q[dim - 1] - reached[dim - 1]).abs());
                thumb.fold(0.0, f64::max)
            };
            if policy.name != PolicyName::Random {
                assert!(far(&alone) < 0.03 && far(&reached) > 0.1, "{policy:?}");
            }
            assert_eq!((cut.frame(), cut.simulated()), (60, simulated));
            assert_eq!(cut.memories, memories, "{policy:?}");
            let stopped = cut.without_contact(26, 60, &|| true);
            assert!(matches!(stopped, Err(Error::Cancelled { frame: 26 })));
            cut.run(&Cancel::default()).unwrap();
            assert_eq!(bits(&cut), bits(&whole), "{policy:?}");
        }
    }

    #[test]
    fn a_gap_without_contact_is_repeated_bit_by_bit() {
        let robot = robot("ur5e");
        let command = command(&robot, 60, &[(0, 0.0), (30, 0.2), (59, -0.1)]);
        let mut rollout = rollout(&robot, PolicyName::Ridge, &command);
        rollout.run(&Cancel::default()).unwrap();
        let alone = rollout.without_contact(10, 40, &|| false).unwrap();
        let dim = robot.state_dim();
        assert_eq!(alone, rollout.states()[(HISTORY + 11) * dim..(HISTORY + 41) * dim]);
    }

    /// After each of 200 random edits per robot the rollout has the same bits as a rollout from the
    /// start, and no frame was simulated that the edit cannot have changed.
    #[test]
    fn an_edit_resimulates_only_what_it_can_change() {
        let cases = [
            ("pointmass", PolicyName::ComputedTorque, 200, 90),
            ("ur5e", PolicyName::Pd, 200, 90),
            ("ur5e_light", PolicyName::ComputedTorque, 200, 60),
            ("shadow_hand", PolicyName::Pd, 200, 45),
            ("ur5e", PolicyName::Ilqr, 8, 60),
            ("pointmass", PolicyName::PredictiveSampling, 20, 60),
            ("ur5e", PolicyName::Ridge, 200, 90),
            ("shadow_hand", PolicyName::Ridge, 60, 60),
        ];
        let (mut in_sight, mut planned) = (0, 0);
        for (id, name, edits, frames) in cases {
            let robot = robot(id);
            let span = frames as u64 - 1;
            let mut keys: Vec<(usize, f64)> = vec![(0, 0.0), (20, 0.2), (40, -0.1)];
            let mut before = command(&robot, frames, &keys);
            let mut live = rollout(&robot, name, &before);
            live.run(&Cancel::default()).unwrap();
            for edit in 0..edits {
                let mut rng = Rng::new(7, Stream::Test, edit);
                let k = 1 + rng.below(keys.len() as u64 - 1) as usize;
                match rng.below(3) {
                    0 => keys[k].1 = rng.range(-0.3, 0.3),
                    1 => keys[k].0 = 1 + rng.below(span) as usize,
                    _ if keys.len() < 7 => {
                        keys.push((1 + rng.below(span) as usize, rng.range(-0.3, 0.3)));
                    }
                    _ => drop(keys.pop()),
                }
                let command = command(&robot, frames, &keys);
                let simulated = live.simulated();
                let from = live.set_command(&command).unwrap();
                // The first changed step according to the clip; the plan through a gap may change
                // before. If a goal is always in the window,
                // no virtual keyframe depends on a later one, and 20 frames before the change is
                // exact.
                let changed = command.first_changed_frame(&before);
                let step = command.first_changed_step(&before);
                let plans = live.policy.sees_plan();
                planned += u64::from(plans && (1..frames - 1).contains(&from));
                assert!(plans || from >= step.map_or(frames - 1, |s| s as usize).min(frames - 1));
                if !plans && command.blind_spans().is_empty() && before.blind_spans().is_empty() {
                    in_sight += u64::from(changed.is_some());
                    let exact = changed.map_or(frames - 1, |f| (f as usize).saturating_sub(20));
                    assert_eq!(from, exact.min(frames - 1), "{id} {name:?}, edit {edit}");
                }
                live.run(&Cancel::default()).unwrap();
                assert_eq!(live.simulated() - simulated, frames - 1 - from);
                let mut fresh = rollout(&robot, name, &command);
                fresh.run(&Cancel::default()).unwrap();
                assert!(bits(&live) == bits(&fresh), "{id} {name:?}, edit {edit}");
                before = command;
            }
        }
        assert!(in_sight > 20, "hardly an edit without a blind span: {in_sight}");
        assert!(planned > 20, "policies that see the plan hardly keep a frame: {planned}");
    }

    /// A rollout with corrections that goes on from another one has the bits of one from the start,
    /// also with a policy that remembers.
    #[test]
    fn a_branch_has_the_bits_of_a_rollout_from_the_start() {
        for (id, name) in [("shadow_hand", PolicyName::Pd), ("ur5e", PolicyName::Ilqr)] {
            let robot = robot(id);
            let (frames, dim) = (120, robot.state_dim());
            let keys: Vec<(usize, f64)> =
                (1..frames).map(|f| (f, 0.2 * (f as f64 / 9.0).sin())).collect();
            let command = command(&robot, frames, &keys);
            let moved = |spans: &[(usize, usize)]| -> Vec<f64> {
                let inside = |f: usize| spans.iter().any(|s| (s.0..s.1).contains(&f));
                (0..frames * dim).map(|i| if inside(i / dim) { 0.1 } else { 0.0 }).collect()
            };
            let make = || rollout(&robot, name, &command);
            let mut best = make();
            best.correct(&moved(&[(50, 55)])).unwrap();
            best.run(&Cancel::default()).unwrap();
            let mut branch = make();
            // Before and after what the best one changed, with frames of another try behind.
            for (spans, steps) in [
                (vec![(50, 55), (90, 95)], 49),
                (vec![(50, 55), (30, 33)], 109),
                (vec![(50, 55), (110, 118)], 29),
                (vec![(50, 55)], 0),
            ] {
                let before = branch.simulated();
                branch.branch(&best, &moved(&spans)).unwrap();
                branch.run(&Cancel::default()).unwrap();
                assert_eq!(branch.simulated() - before, steps, "{id} {spans:?}");
                let mut fresh = make();
                fresh.correct(&moved(&spans)).unwrap();
                fresh.run(&Cancel::default()).unwrap();
                assert!(bits(&branch) == bits(&fresh), "{id} {spans:?}");
            }
        }
    }

    #[test]
    fn hidden_goals_are_never_read() {
        let alone =
            |n: &PolicyName| *n == PolicyName::Ridge || !n.needs_model() && *n != PolicyName::Auto;
        for name in PolicyName::all().filter(alone) {
            let robot = robot("ur5e");
            let keys = [(0, 0.0), (12, 0.2), (13, 0.2), (14, 0.2)];
            let mut a = rollout(&robot, name, &command(&robot, 24, &keys));
            let mut b = rollout(&robot, name, &command(&robot, 24, &keys));
            // Overwrite what masks hide.
            for i in 0..b.led.frames() * b.led.dim() {
                b.led.poison_hidden(i, 99.0);
            }
            a.run(&Cancel::default()).unwrap();
            b.run(&Cancel::default()).unwrap();
            assert!(bits(&a) == bits(&b), "{name:?}");
        }
    }

    #[test]
    fn simulated_time_is_clip_time() {
        for timestep in [0.001, 0.002, 0.0025, 0.005] {
            let robot = robot("ur5e");
            let command = command(&robot, 41, &[(0, 0.0), (40, 0.1)]);
            let mut r = rollout(&robot, PolicyName::ComputedTorque, &command);
            let mut model = robot.model().duplicate().unwrap();
            model.set_timestep(timestep);
            r.substeps = substeps(&model).unwrap();
            r.plant = Data::new(&Arc::new(model)).unwrap();
            r.rewind().unwrap();
            r.run(&Cancel::default()).unwrap();
            assert_eq!(r.frames_reached().count(), 41, "both ends are there");
            assert!(r.clock_error_secs().abs() < 1e-9, "{timestep}: {}", r.clock_error_secs());
            assert!((r.snapshot(40).unwrap().time_secs - 2.0).abs() < 1e-9);
            assert!(
                r.frames_reached().last().unwrap().error.is_some(),
                "the last key is commanded"
            );
        }
        let mut odd = robot("ur5e").model().duplicate().unwrap();
        odd.set_timestep(0.003);
        assert!(matches!(substeps(&odd), Err(Error::Timestep { .. })));
    }

    /// Counts its calls in its memory, and fails at frame 5 as often as it is told.
    struct Stumbles {
        calls: f64,
        failures: usize,
    }

    impl Policy for Stumbles {
        fn name(&self) -> String {
            "stumbles".into()
        }

        fn reset(&mut self, _seed: u64) {
            self.calls = 0.0;
        }

        fn act(&mut self, view: &View<'_>, action: &mut [f64]) -> Result<(), Error> {
            self.calls += 1.0;
            action.fill(0.1 * self.calls);
            if view.frame == 5 && self.failures > 0 {
                self.failures -= 1;
                action.fill(f64::NAN);
            }
            Ok(())
        }

        fn memory(&self) -> Vec<f64> {
            vec![self.calls]
        }

        fn recall(&mut self, memory: &[f64]) {
            self.calls = memory[0];
        }
    }

    #[test]
    fn a_frame_that_failed_can_be_tried_again() {
        let robot = robot("pointmass");
        let command = command(&robot, 12, &[(0, 0.0), (11, 0.1)]);
        let rollout = |failures| {
            let policy = Box::new(Stumbles { calls: 0.0, failures });
            let config = RolloutConfig::default();
            Rollout::new(&robot, policy, &command, Start::Pose, config).unwrap()
        };
        let (mut sure, mut stumbling) = (rollout(0), rollout(2));
        sure.run(&Cancel::default()).unwrap();
        for _ in 0..2 {
            let e = stumbling.run(&Cancel::default()).unwrap_err();
            assert!(matches!(e, Error::BadAction { frame: 5, .. }), "{e}");
        }
        stumbling.run(&Cancel::default()).unwrap();
        assert!(bits(&sure) == bits(&stumbling));
    }

    #[test]
    fn a_planner_that_knows_the_plant_beats_none() {
        let robot = robot("ur5e");
        let keys: Vec<(usize, f64)> =
            std::iter::once((0, 0.0)).chain((20..40).map(|f| (f, 0.25))).collect();
        let command = command(&robot, 40, &keys);
        let precision = |name| {
            let mut r = rollout(&robot, name, &command);
            r.run(&Cancel::default()).unwrap();
            r.precision().precision.unwrap()
        };
        let (zero, pd) = (precision(PolicyName::Zero), precision(PolicyName::Pd));
        let (ct, ilqr) = (precision(PolicyName::ComputedTorque), precision(PolicyName::Ilqr));
        assert!(zero > 0.05 && pd < 0.02 && ct < 0.002 && ilqr < 0.002, "{zero} {pd} {ct} {ilqr}");
    }

    #[test]
    fn other_joints_are_refused() {
        let (arm, mass) = (robot("ur5e"), robot("pointmass"));
        let policy = PolicyConfig::new(PolicyName::Zero).build(&arm).unwrap();
        let command = command(&mass, 10, &[(0, 0.0)]);
        let e = Rollout::new(&arm, policy, &command, Start::Pose, RolloutConfig::default());
        assert!(matches!(e, Err(Error::Joints { got: 2, want: 5, .. })), "{e:?}");
    }
}
