//! What clips need to know about a robot, and checks of poses by simulation.
//!
//! It is here and not beside [`Robot`], so that the floors below (robots, datasets, agents,
//! pictures) know nothing of clips and are not compiled again when the clip changes.

use robert_clip as clip;
use robert_mujoco::{Data, Kind};
use robert_robot::{Coupling, Drive, Robot};

/// Geoms that overlap by more than this count as a collision, m.
const OVERLAP: f64 = 0.002;

/// Allowed difference between coupled joints in a pose; contact separates them by this much in a
/// settled fist.
const COUPLING_TOLERANCE: f64 = 0.1;

/// What clips need to know about a robot.
pub trait ClipFacts {
    /// The facts needed to check, mirror and draw clips.
    fn joint_table(&self) -> clip::JointTable;

    /// Compiles a clip for this robot, with its end-effector goals solved.
    ///
    /// # Errors
    /// [`clip::Invalid`], as [`clip::compile_for`].
    fn compile(&self, clip: &clip::Clip) -> Result<clip::Command, clip::Invalid>;

    /// The reference to this robot in a new clip.
    fn clip_ref(&self) -> clip::RobotRef;
}

impl ClipFacts for Robot {
    fn joint_table(&self) -> clip::JointTable {
        let profile = self.profile();
        let own = |drive: &Drive, joint: &str| matches!(drive, Drive::Joint(name) if name == joint);
        let pulls = |drive: &Drive, joint: &str| matches!(drive, Drive::Tendon(name) if self.tendon_joints(name).contains(&joint));
        // Which joints a spatial tendon moves is not known here.
        let spatial = self.actuators().iter().any(|a| match &a.drive {
            Drive::Joint(_) => false,
            Drive::Tendon(name) => self.tendon_joints(name).is_empty(),
            Drive::Other(_) => true,
        });
        let joints = self.joints().iter().map(|j| clip::JointFacts {
            name: j.name.clone(),
            unit: j.unit,
            range: (!j.unbounded).then_some(j.range),
            speed_max: (j.top_speed.is_finite() && j.top_speed > 0.0).then_some(j.top_speed),
            band: None,
            speed_usual: None,
            moves_alone: self.actuators().iter().any(|a| own(&a.drive, &j.name))
                || !spatial && !self.actuators().iter().any(|a| pulls(&a.drive, &j.name)),
        });
        let rows = profile.mirror.table.iter().map(|r| clip::MirrorRow {
            target: r.target.clone(),
            source: r.source.clone(),
            sign: r.sign,
            offset: r.offset,
        });
        let mirror = match self.mirror_reason() {
            Some(reason) => clip::Mirror::None(reason.to_owned()),
            None => clip::Mirror::Table(rows.collect()),
        };
        clip::JointTable {
            robot: self.id().to_owned(),
            model_sha256: Some(self.model_sha256().to_owned()),
            joints: joints.collect(),
            rest: self.home(),
            mirror,
            couplings: profile.couplings.iter().map(coupling).collect(),
            granularity: clip::Granularity::Joint,
            kinematics: Some(self.kinematics().clone()),
        }
    }

    fn compile(&self, clip: &clip::Clip) -> Result<clip::Command, clip::Invalid> {
        // Only end-effector goals and joints that follow others need to know the robot.
        let follow = |c: &Coupling| matches!(c, Coupling::Mimic { .. });
        let follows = self.profile().couplings.iter().any(follow);
        let loops = !self.kinematics().closures.is_empty();
        if !follows && !loops && clip.keys.iter().all(|k| k.reach.is_empty()) {
            return clip::compile(clip);
        }
        clip::compile_for(clip, Some(&self.joint_table()))
    }

    fn clip_ref(&self) -> clip::RobotRef {
        clip::RobotRef {
            id: self.id().to_owned(),
            model: None,
            model_sha256: Some(self.model_sha256().to_owned()),
            joints: self.joints().iter().map(|j| j.name.clone()).collect(),
            units: self.joints().iter().map(|j| j.unit).collect(),
        }
    }
}

fn coupling(coupling: &Coupling) -> clip::Coupling {
    let member =
        |joint: &str, coef, offset| clip::CouplingMember { joint: joint.to_owned(), coef, offset };
    match coupling {
        Coupling::Tendon { name, joints, coefs, .. } => clip::Coupling {
            kind: clip::CouplingKind::Tendon,
            name: name.clone(),
            members: joints.iter().zip(coefs).map(|(j, c)| member(j, *c, 0.0)).collect(),
            tolerance: COUPLING_TOLERANCE,
        },
        Coupling::Mimic { follower, leader, offset, multiplier } => clip::Coupling {
            kind: clip::CouplingKind::Mimic,
            name: leader.clone(),
            members: vec![member(leader, 1.0, 0.0), member(follower, *multiplier, *offset)],
            tolerance: 1e-3,
        },
    }
}

/// Checks poses by settling them in simulation.
#[derive(Debug)]
pub struct Settler<'a> {
    robot: &'a Robot,
    data: Data,
}

impl<'a> Settler<'a> {
    /// For this robot.
    ///
    /// # Errors
    /// [`robert_robot::Error::Simulator`] when no simulation can be made.
    pub fn new(robot: &'a Robot) -> Result<Settler<'a>, robert_robot::Error> {
        Ok(Settler { robot, data: Data::new(robot.model())? })
    }

    /// What overlaps in this pose, (S), the deepest first, and the pose that settles from it, (S); none if
    /// the simulation diverges.
    ///
    /// # Errors
    /// [`robert_robot::Error::Simulator`], [`robert_robot::Error::Length`].
    pub fn examine(&mut self, state: &[f64]) -> Result<clip::PoseReport, robert_robot::Error> {
        let contacts = self.overlaps(state)?;
        // A pose may be so far off that the simulation diverges.
        let settled = self.robot.settle(state).ok().map(|s| s.reached);
        Ok(clip::PoseReport { contacts, settled })
    }

    /// Bodies that overlap, and the depth, m.
    fn overlaps(
        &mut self,
        state: &[f64],
    ) -> Result<Vec<(String, String, f64)>, robert_robot::Error> {
        self.data.reset()?;
        self.robot.write_state(&mut self.data, state)?;
        self.data.forward()?;
        let model = self.robot.model();
        let body = |geom: usize| {
            let id = model.geom_bodyid().get(geom).and_then(|b| usize::try_from(*b).ok())?;
            model.name(Kind::Body, id)
        };
        let word = |name: Option<&str>| name.unwrap_or("a body without name").to_owned();
        let deep = self.data.contacts().filter(|c| c.dist < -OVERLAP);
        let mut found: Vec<(String, String, f64)> = deep
            .map(|c| {
                let [a, b] = c.geoms;
                (word(body(a)), word(body(b)), -c.dist)
            })
            .collect();
        found.sort_by(|x, y| (&x.0, &x.1).cmp(&(&y.0, &y.1)).then(y.2.total_cmp(&x.2)));
        found.dedup_by(|later, first| later.0 == first.0 && later.1 == first.1);
        found.sort_by(|x, y| y.2.total_cmp(&x.2));
        Ok(found)
    }
}

impl clip::PoseChecker for Settler<'_> {
    fn check(&mut self, joints: &[String], q: &[f64]) -> clip::PoseReport {
        let mut state = self.robot.home();
        let mut places = Vec::new();
        for (name, value) in joints.iter().zip(q) {
            // An unknown joint is a separate finding; here it only means that the pose cannot be
            // simulated.
            let Ok(at) = self.robot.joint_index(name) else { return clip::PoseReport::default() };
            state[at] = *value;
            places.push(at);
        }
        let Ok(found) = self.examine(&state) else { return clip::PoseReport::default() };
        let settled = found.settled.map(|q| places.iter().map(|&at| q[at]).collect());
        clip::PoseReport { contacts: found.contacts, settled }
    }

    fn tolerance(&self) -> f64 {
        self.robot.profile().settle.tolerance
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use robert_clip::PoseChecker;

    #[test]
    fn tables_say_what_profiles_say() {
        let arm = Robot::builtin("ur5e").unwrap().joint_table();
        assert_eq!(arm.joints.len(), 5);
        assert!(arm.joints.iter().all(|j| j.range.is_some() && j.speed_max.is_some()));
        assert!(matches!(&arm.mirror, clip::Mirror::Table(rows) if !rows.is_empty()));
        let hand = Robot::builtin("shadow_hand").unwrap().joint_table();
        assert_eq!((hand.joints.len(), hand.couplings.len()), (22, 4));
        assert!(matches!(&hand.mirror, clip::Mirror::None(reason) if !reason.is_empty()));
        let point = Robot::builtin("pointmass").unwrap().joint_table();
        assert!(point.joints.iter().all(|j| j.range.is_none()));
    }

    #[test]
    fn a_jammed_thumb_is_noticed() {
        let hand = Robot::builtin("shadow_hand").unwrap();
        let table = hand.joint_table();
        let mut settler = Settler::new(&hand).unwrap();
        let open = settler.check(&table.names(), &hand.pose("open").unwrap());
        let worst = |report: &clip::PoseReport, q: &[f64]| {
            let reached = report.settled.clone().unwrap();
            q.iter().zip(reached).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
        };
        assert!(open.contacts.is_empty() && worst(&open, &hand.home()) < 0.02);
        let mut fist: Vec<f64> = hand.pose("rock").unwrap();
        for (name, v) in [("THJ5", 0.6), ("THJ4", 1.1), ("THJ2", 0.5), ("THJ1", 0.9)] {
            fist[hand.joint_index(name).unwrap()] = v;
        }
        let report = settler.check(&table.names(), &fist);
        assert!(worst(&report, &fist) > settler.tolerance() || !report.contacts.is_empty());
    }
}
