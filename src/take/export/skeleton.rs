//! The tree of a robot's bodies, and their places in a state.

use std::collections::VecDeque;
use std::sync::Arc;

use glam::{DQuat, DVec3};

use super::super::assemble::Stage;
use super::super::document::{POSE, RobotFacts, Take};
use super::super::error::Error;
use robert_mujoco::Joint;
use robert_robot::Robot;

/// Place and orientation of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// m.
    pub pos: DVec3,
    /// Unit quaternion.
    pub rot: DQuat,
}

impl Pose {
    /// The frame of the world.
    pub const WORLD: Pose = Pose { pos: DVec3::ZERO, rot: DQuat::IDENTITY };

    /// From numbers of a take: x y z and w x y z.
    fn of_row(row: &[f64]) -> Pose {
        let pos = DVec3::new(row[0], row[1], row[2]);
        Pose { pos, rot: DQuat::from_xyzw(row[4], row[5], row[6], row[3]).normalize() }
    }

    /// This pose relative to its parent; both are given in the world.
    #[must_use]
    pub fn in_parent(self, parent: Pose) -> Pose {
        let back = parent.rot.inverse();
        Pose { pos: back * (self.pos - parent.pos), rot: (back * self.rot).normalize() }
    }

    /// A point of this frame in the world, m.
    pub fn at(self, point: DVec3) -> DVec3 {
        self.pos + self.rot * point
    }
}

/// Order of the bodies and joints in a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Bodies {
    /// Depth first, as MuJoCo and mjlab number them.
    #[default]
    Mujoco,
    /// Breadth first, as PhysX and Isaac Lab number them.
    Isaac,
}

/// A robot's bodies without the world, in MuJoCo's order.
#[derive(Debug)]
pub struct Skeleton {
    /// Names, unique.
    pub names: Vec<String>,
    /// Parent of each body; `None` for children of the world.
    pub parents: Vec<Option<usize>>,
    robot: Arc<Robot>,
    stage: Stage,
}

impl Skeleton {
    /// The skeleton of a robot.
    ///
    /// # Errors
    /// [`Error::Bodies`], [`Error::Robot`], [`Error::Simulator`].
    pub fn of(robot: &Arc<Robot>) -> Result<Skeleton, Error> {
        let facts = RobotFacts::of(robot)?;
        let model = robot.scene_model()?;
        let parents = model.body_parentid()[1..].iter().map(|&p| (p as usize).checked_sub(1));
        Ok(Skeleton {
            names: facts.bodies,
            parents: parents.collect(),
            robot: Arc::clone(robot),
            stage: Stage::new(robot)?,
        })
    }

    /// The robot.
    pub fn robot(&self) -> &Arc<Robot> {
        &self.robot
    }

    /// World poses of all bodies at a state (rad or m).
    ///
    /// # Errors
    /// [`Error::Robot`], [`Error::Simulator`].
    pub fn poses(&mut self, state: &[f64]) -> Result<Vec<Pose>, Error> {
        let mut row = Vec::with_capacity(self.names.len() * POSE);
        self.stage.pose(state, &mut row)?;
        Ok(poses(&row))
    }

    /// Poses in the parents' frames, from world poses.
    pub fn local(&self, world: &[Pose]) -> Vec<Pose> {
        world
            .iter()
            .zip(&self.parents)
            .map(|(pose, parent)| pose.in_parent(parent.map_or(Pose::WORLD, |p| world[p])))
            .collect()
    }

    /// Children of a body, or of the world.
    pub fn children(&self, of: Option<usize>) -> impl Iterator<Item = usize> + '_ {
        self.parents.iter().enumerate().filter(move |(_, p)| **p == of).map(|(i, _)| i)
    }

    /// Bodies in the order of a file.
    pub fn order(&self, bodies: Bodies) -> Vec<usize> {
        if bodies == Bodies::Mujoco {
            return (0..self.names.len()).collect();
        }
        let mut waiting: VecDeque<usize> = self.children(None).collect();
        let mut order = Vec::with_capacity(self.names.len());
        while let Some(body) = waiting.pop_front() {
            order.push(body);
            waiting.extend(self.children(Some(body)));
        }
        order
    }

    /// Indices into the state, in the order in which a file lists its joints.
    pub fn joint_order(&self, bodies: Bodies) -> Vec<usize> {
        let mut order = Vec::with_capacity(self.robot.state_dim());
        for body in self.order(bodies) {
            order.extend(self.joints_of(body));
        }
        order
    }

    /// Indices into the state of the joints that move a body against its parent.
    pub fn joints_of(&self, body: usize) -> Vec<usize> {
        let owners = self.robot.model().jnt_bodyid();
        let of = |j: &usize| owners[self.robot.joints()[*j].id] as usize == body + 1;
        let mut found: Vec<usize> = (0..self.robot.state_dim()).filter(of).collect();
        found.sort_by_key(|j| self.robot.joints()[*j].qposadr);
        found
    }

    /// Whether a joint of the state slides.
    pub fn slides(&self, joint: usize) -> bool {
        self.robot.model().joint_type(self.robot.joints()[joint].id) == Some(Joint::Slide)
    }

    /// Anchor of a joint in the frame of its body, m.
    pub fn anchor(&self, joint: usize) -> DVec3 {
        let id = self.robot.joints()[joint].id;
        DVec3::from_slice(&self.robot.model().jnt_pos()[3 * id..3 * id + 3])
    }
}

/// Rows of a take as poses.
pub(super) fn poses(row: &[f64]) -> Vec<Pose> {
    row.chunks_exact(POSE).map(Pose::of_row).collect()
}

/// Reached world poses; (frames)(B).
pub(super) fn reached(take: &Take) -> Vec<Vec<Pose>> {
    (0..take.frames()).map(|f| poses(take.body_poses(f))).collect()
}

/// Commanded world poses with their frames, where all joints have a goal.
pub(super) fn commanded(take: &Take) -> Vec<(usize, Vec<Pose>)> {
    let frames = take.ghost.iter().enumerate();
    frames.filter_map(|(f, row)| Some((f, poses(row.as_ref()?)))).collect()
}

#[cfg(test)]
mod tests {
    use super::super::super::sample;
    use super::*;

    #[test]
    fn poses_of_a_take_are_those_of_the_model() {
        let (robot, take) = sample::take("shadow_hand", 30, 30);
        let mut skeleton = Skeleton::of(&robot).unwrap();
        for (f, row) in reached(&take).iter().enumerate() {
            let again = skeleton.poses(take.state(f)).unwrap();
            for (a, b) in row.iter().zip(&again) {
                assert!((a.pos - b.pos).length() < 1e-12 && a.rot.dot(b.rot).abs() > 1.0 - 1e-12);
            }
            // Local poses multiply back to the world's.
            let local = skeleton.local(row);
            for (i, parent) in skeleton.parents.iter().enumerate() {
                let p = parent.map_or(Pose::WORLD, |p| row[p]);
                assert!((p.at(local[i].pos) - row[i].pos).length() < 1e-12);
            }
        }
    }

    #[test]
    fn breadth_first_lists_the_fingers_joint_by_joint() {
        let robot = Arc::new(Robot::builtin("shadow_hand").unwrap());
        let skeleton = Skeleton::of(&robot).unwrap();
        let depth =
            |body: usize| std::iter::successors(Some(body), |b| skeleton.parents[*b]).count();
        let order = skeleton.order(Bodies::Isaac);
        assert!(order.windows(2).all(|w| depth(w[0]) <= depth(w[1])), "{order:?}");
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, skeleton.order(Bodies::Mujoco));
        let joints = skeleton.joint_order(Bodies::Isaac);
        assert_ne!(joints, skeleton.joint_order(Bodies::Mujoco));
        assert_eq!(joints.len(), robot.state_dim());
        assert_eq!(skeleton.joint_order(Bodies::Mujoco), (0..22).collect::<Vec<_>>());
    }
}
