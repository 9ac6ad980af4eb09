//! Builds a take from a rollout: kinematics of every frame, torques on the joints.

use std::sync::Arc;

use super::document::{POSE, Provenance, RobotFacts, Take};
use super::error::Error;
use robert_base::limits;
use robert_clip::{Clip, Command, Sight};
use robert_mujoco::{Data, Kind};
use robert_robot::Robot;
use robert_rollout::Rollout;

impl Take {
    /// Records the frames that a rollout has reached so far. `command` is what it performs, and
    /// `clip` is the source of the command.
    ///
    /// # Errors
    /// [`Error::Bodies`], [`Error::Robot`], [`Error::Simulator`].
    pub fn record(
        rollout: &Rollout,
        command: &Command,
        clip: Option<&Clip>,
        provenance: Provenance,
    ) -> Result<Take, Error> {
        let robot = rollout.robot();
        let facts = RobotFacts::of(robot)?;
        let frames = rollout.frame() + 1;
        let dim = robot.state_dim();
        let mut velocity = Vec::with_capacity(frames * dim);
        for f in 0..frames {
            let Some(state) = rollout.snapshot(f) else {
                unreachable!("a rollout keeps the state of every frame that it reached")
            };
            velocity.extend(robot.joints().iter().map(|j| state.qvel[j.dofadr]));
        }
        let actions = rollout.actions().to_vec();
        let mut ctrl = Vec::with_capacity(actions.len());
        for action in actions.chunks_exact(robot.action_dim().max(1)) {
            ctrl.extend(robot.ctrl_of(action)?);
        }
        let mut take = Take {
            robot: facts,
            clip_text: clip.map(Clip::to_text),
            command: command.clone(),
            reached: rollout.reached().to_vec(),
            velocity,
            effort: effort(robot, &ctrl)?,
            actions,
            ctrl,
            poses: Vec::new(),
            ghost: Vec::new(),
            provenance,
            policy_card: rollout.policy_card(),
        };
        take.place(robot)?;
        Ok(take)
    }

    /// Computes the body poses of reached and commanded frames.
    fn place(&mut self, robot: &Arc<Robot>) -> Result<(), Error> {
        let mut stage = Stage::new(robot)?;
        let frames = self.frames();
        let mut poses = Vec::with_capacity(frames * self.robot.bodies.len() * POSE);
        for f in 0..frames {
            stage.pose(self.state(f), &mut poses)?;
        }
        self.poses = poses;
        // A held key is computed once.
        let mut last: Option<(Vec<f32>, Vec<f64>)> = None;
        self.ghost = Vec::with_capacity(self.command.frames() as usize);
        for f in 0..self.command.frames() {
            if self.command.sight(f) != Sight::Full {
                self.ghost.push(None);
                continue;
            }
            let goal = self.command.row(f);
            let placed = match last.take() {
                Some((same, placed)) if same == goal => placed,
                _ => {
                    let state: Vec<f64> = goal.iter().map(|&v| f64::from(v)).collect();
                    let mut placed = Vec::new();
                    stage.pose(&state, &mut placed)?;
                    placed
                }
            };
            self.ghost.push(Some(placed.clone()));
            last = Some((goal.to_vec(), placed));
        }
        Ok(())
    }
}

impl RobotFacts {
    /// The facts about a robot that a take stores.
    ///
    /// # Errors
    /// [`Error::Bodies`], [`Error::Robot`].
    pub fn of(robot: &Robot) -> Result<RobotFacts, Error> {
        let model = robot.scene_model()?;
        if model.nbody() > limits::BODIES {
            return Err(Error::Bodies {
                robot: robot.id().to_owned(),
                bodies: model.nbody(),
                cap: limits::BODIES,
            });
        }
        let mut bodies: Vec<String> = Vec::with_capacity(model.nbody());
        for b in 1..model.nbody() {
            let name = model.name(Kind::Body, b).map_or_else(|| format!("body{b}"), str::to_owned);
            // "world" is the root of all frames; a second frame of that name would make a cycle.
            let taken = name == "world" || bodies.contains(&name);
            bodies.push(if taken { format!("{name}.{b}") } else { name });
        }
        Ok(RobotFacts {
            id: robot.id().to_owned(),
            model_sha256: robot.model_sha256().to_owned(),
            joints: robot.joints().iter().map(|j| j.name.clone()).collect(),
            units: robot.joints().iter().map(|j| j.unit).collect(),
            actuators: robot.actuators().iter().map(|a| a.name.clone()).collect(),
            bodies,
        })
    }
}

/// A simulation that is only used for kinematics.
#[derive(Debug)]
pub(super) struct Stage {
    robot: Arc<Robot>,
    data: Data,
}

impl Stage {
    pub(super) fn new(robot: &Arc<Robot>) -> Result<Stage, Error> {
        Ok(Stage { robot: Arc::clone(robot), data: Data::new(robot.scene_model()?)? })
    }

    /// Appends the world poses of all bodies except the world at a state; (B, 7).
    pub(super) fn pose(&mut self, state: &[f64], out: &mut Vec<f64>) -> Result<(), Error> {
        self.robot.write_state(&mut self.data, state)?;
        self.data.kinematics()?;
        let (pos, quat) = (self.data.xpos(), self.data.xquat());
        for (p, q) in pos.chunks_exact(3).zip(quat.chunks_exact(4)).skip(1) {
            out.extend_from_slice(p);
            out.extend_from_slice(q);
        }
        Ok(())
    }
}

/// Torques on the joints for these controls. The moment arms of joint and tendon motors do not
/// depend on the pose, so they are computed once. Actuators that are not motors command a position
/// instead of a torque, and are left out.
fn effort(robot: &Arc<Robot>, ctrl: &[f64]) -> Result<Vec<f64>, Error> {
    let model = robot.model();
    let mut data = Data::new(model)?;
    robot.write_state(&mut data, &robot.home())?;
    data.forward()?;
    let (nv, nu) = (model.nv(), robot.action_dim());
    let moment = data.actuator_moment(); // (nu, nv)
    let mut out = Vec::with_capacity(ctrl.len() / nu.max(1) * robot.state_dim());
    for row in ctrl.chunks_exact(nu.max(1)) {
        for joint in robot.joints() {
            let mut sum = 0.0;
            for (a, (actuator, u)) in robot.actuators().iter().zip(row).enumerate() {
                let gain = model.actuator_gainprm()[10 * a];
                let arm = moment[a * nv + joint.dofadr];
                if actuator.is_motor {
                    sum += arm * gain * u;
                }
            }
            out.push(sum);
        }
    }
    Ok(out)
}
