//! Inverse kinematics of a robot: [`robert_kinematics`] with the robot's own names in errors.

use robert_kinematics::{IkConfig, IkResult, Point, Target};

use super::{Error, Robot};
use robert_mujoco::Data;

impl Robot {
    /// Moves joints so that the targets are met as well as limits and locks allow. The search
    /// begins at `start` (`state_dim`) and stays near it. `data` must be of this robot's model, and
    /// contains the result afterwards.
    ///
    /// # Errors
    /// [`Error::UnknownPoint`], [`Error::Length`], [`Error::Simulator`].
    pub fn ik(
        &self,
        data: &mut Data,
        start: &[f64],
        targets: &[Target],
        config: &IkConfig,
    ) -> Result<IkResult, Error> {
        self.ik_meeting(data, start, targets, &[], config)
    }

    /// As [`Robot::ik`]. In addition, the two points of each pair are brought together; where they
    /// meet is not given.
    ///
    /// # Errors
    /// Those of [`Robot::ik`].
    pub fn ik_meeting(
        &self,
        data: &mut Data,
        start: &[f64],
        targets: &[Target],
        pairs: &[(Point, Point)],
        config: &IkConfig,
    ) -> Result<IkResult, Error> {
        self.check_len("start", start.len(), self.state_dim())?;
        let found = self.kinematics().ik_meeting(start, targets, pairs, config);
        let found = found.map_err(|e| self.unknown_point(&e.name))?;
        self.write_state(data, &found.state)?;
        data.kinematics()?;
        Ok(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use robert_base::rng::{Rng, Stream};
    use robert_kinematics::Place;
    use robert_mujoco::Kind;

    fn at(robot: &Robot, state: &[f64], point: &Point) -> Place {
        let tree = robot.kinematics();
        tree.place(state, &tree.point(point).unwrap())
    }

    fn site(robot: &Robot, state: &[f64], name: &str) -> [f64; 3] {
        at(robot, state, &Point::Site(name.into())).pos
    }

    #[test]
    fn every_place_is_where_the_simulator_has_it() {
        for id in Robot::builtin_ids() {
            let robot = Robot::builtin(id).unwrap();
            let (model, tree) = (robot.model(), robot.kinematics());
            let mut data = Data::new(model).unwrap();
            for trial in 0..50 {
                let mut rng = Rng::new(2, Stream::Test, trial);
                let bounded = |j: &crate::StateJoint| !j.unbounded;
                let value = |j: &crate::StateJoint, rng: &mut Rng| {
                    if bounded(j) {
                        rng.range(j.range[0], j.range[1])
                    } else {
                        rng.range(-2.0, 2.0)
                    }
                };
                let state: Vec<f64> = robot.joints().iter().map(|j| value(j, &mut rng)).collect();
                robot.write_state(&mut data, &state).unwrap();
                data.kinematics().unwrap();
                let mut pairs = Vec::new();
                for s in 0..model.nsite() {
                    let Some(name) = model.name(Kind::Site, s) else { continue };
                    let place = at(&robot, &state, &Point::Site(name.to_owned()));
                    pairs.push((place, &data.site_xpos()[3 * s..], &data.site_xmat()[9 * s..]));
                }
                for b in 1..model.nbody() {
                    let Some(body) = model.name(Kind::Body, b).map(str::to_owned) else { continue };
                    let place = at(&robot, &state, &Point::Body { body, offset: [0.0; 3] });
                    pairs.push((place, &data.xpos()[3 * b..], &data.xmat()[9 * b..]));
                }
                assert!(tree.links.len() > 1 && !pairs.is_empty(), "{id}");
                for (place, pos, mat) in pairs {
                    let [w, x, y, z] = place.quat;
                    let turn = nalgebra::UnitQuaternion::from_quaternion(
                        nalgebra::Quaternion::new(w, x, y, z),
                    );
                    let own = turn.to_rotation_matrix();
                    for r in 0..3 {
                        assert!((place.pos[r] - pos[r]).abs() < 1e-9, "{id}: {place:?}");
                        for c in 0..3 {
                            assert!((own[(r, c)] - mat[3 * r + c]).abs() < 1e-9, "{id}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn a_posture_decides_between_solutions() {
        let robot = Robot::builtin("ur5e").unwrap();
        let mut data = Data::new(robot.model()).unwrap();
        let goal = [0.3, -1.2, 1.4, -1.0, -1.3];
        let pos = site(&robot, &goal, "end_effector");
        let target = Target { point: Point::Site("end_effector".into()), pos, quat: None };
        let far =
            |state: &[f64]| state.iter().zip(goal).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let start = [0.1, -0.9, 0.9, -1.5, -1.9];
        let targets = [target];
        let alone = robot.ik(&mut data, &start, &targets, &IkConfig::default()).unwrap();
        let near = IkConfig { near: Some(goal.to_vec()), ..IkConfig::default() };
        let led = robot.ik(&mut data, &start, &targets, &near).unwrap();
        assert!(alone.reached && led.reached && led.distance_m < 1e-5, "{led:?}");
        assert!(far(&led.state) < 0.02 && far(&alone.state) > 0.1, "{led:?} {alone:?}");
    }

    fn within_limits(robot: &Robot, state: &[f64]) -> bool {
        robot.joints().iter().zip(state).all(|(j, v)| *v >= j.range[0] && *v <= j.range[1])
    }

    #[test]
    fn every_fingertip_reaches_where_it_could_be() {
        let robot = Robot::builtin("shadow_hand").unwrap();
        let mut data = Data::new(robot.model()).unwrap();
        let mut missed = Vec::new();
        for (k, tip) in robot.profile().ik_sites.clone().iter().enumerate() {
            for trial in 0..20 {
                let mut rng = Rng::new(1, Stream::Test, 100 * k as u64 + trial);
                let goal_state: Vec<f64> =
                    robot.joints().iter().map(|j| rng.range(j.range[0], j.range[1])).collect();
                let goal = site(&robot, &goal_state, tip);
                let target = Target { point: Point::Site(tip.clone()), pos: goal, quat: None };
                let r =
                    robot.ik(&mut data, &robot.home(), &[target], &IkConfig::default()).unwrap();
                assert!(within_limits(&robot, &r.state));
                if !r.reached {
                    missed.push((tip.clone(), trial, r.distance_m));
                }
            }
        }
        assert!(missed.len() <= 5, "{} of 100 missed: {missed:?}", missed.len());
    }

    #[test]
    fn joints_on_one_tendon_move_alike() {
        let robot = Robot::builtin("shadow_hand").unwrap();
        let mut data = Data::new(robot.model()).unwrap();
        let [a, b, knuckle] = ["FFJ2", "FFJ1", "FFJ3"].map(|n| robot.joint_index(n).unwrap());
        let solve = |pos, data: &mut Data| {
            let target = Target { point: Point::Site("fftip".into()), pos, quat: None };
            robot.ik(data, &robot.home(), &[target], &IkConfig::default()).unwrap()
        };
        let apart = |r: &IkResult| (r.state[a] - r.state[b]).abs();
        let mut goal = robot.home();
        (goal[a], goal[b], goal[knuckle]) = (0.9, 0.5, 0.4);
        // Another bend of the knuckle brings the tip to the same place.
        let r = solve(site(&robot, &goal, "fftip"), &mut data);
        assert!(r.reached && apart(&r) < 2e-3, "{r:?}");
        // Here the knuckle stops before that.
        let r = solve([0.0365, 0.033, 0.2815], &mut data);
        assert!((1e-3..0.01).contains(&r.distance_m) && apart(&r) < 0.02, "{r:?}");
    }

    #[test]
    fn locked_joints_stay_and_subsets_move_alone() {
        let robot = Robot::builtin("ur5e").unwrap();
        let mut data = Data::new(robot.model()).unwrap();
        let home = robot.home();
        let mut pos = site(&robot, &home, "end_effector");
        pos[2] -= 0.15;
        let target = Target { point: Point::Site("end_effector".into()), pos, quat: None };
        let config = IkConfig { locked: vec![0, 3], ..IkConfig::default() };
        let r = robot.ik(&mut data, &home, std::slice::from_ref(&target), &config).unwrap();
        assert!(r.reached, "{r:?}");
        assert_eq!((r.state[0], r.state[3]), (home[0], home[3]));
        let config = IkConfig { joints: Some(vec![1]), ..IkConfig::default() };
        let r = robot.ik(&mut data, &home, &[target], &config).unwrap();
        assert!(!r.reached);
        assert_ne!(r.state[1], home[1]);
        assert_eq!(
            [r.state[0], r.state[2], r.state[3], r.state[4]],
            [home[0], home[2], home[3], home[4]]
        );
    }

    #[test]
    fn two_targets_and_a_body_point_at_once() {
        let robot = Robot::builtin("shadow_hand").unwrap();
        let mut data = Data::new(robot.model()).unwrap();
        let mut goal_state = robot.home();
        for (name, v) in [("FFJ3", 0.7), ("FFJ2", 0.6), ("MFJ3", 0.4), ("THJ4", 0.8), ("THJ1", 0.4)]
        {
            goal_state[robot.joint_index(name).unwrap()] = v;
        }
        let ff = site(&robot, &goal_state, "fftip");
        let th = site(&robot, &goal_state, "thtip");
        let middle = Point::Body { body: "mfdistal".into(), offset: [0.0, 0.0, 0.02] };
        let mf = at(&robot, &goal_state, &middle).pos;
        let targets = [
            Target { point: Point::Site("fftip".into()), pos: ff, quat: None },
            Target { point: Point::Site("thtip".into()), pos: th, quat: None },
            Target { point: middle, pos: mf, quat: None },
        ];
        let r = robot.ik(&mut data, &robot.home(), &targets, &IkConfig::default()).unwrap();
        assert!(r.reached, "{r:?}");
        for name in ["RFJ3", "LFJ3", "LFJ5"] {
            let i = robot.joint_index(name).unwrap();
            assert_eq!(r.state[i], 0.0, "{name} has no part in it");
        }
    }

    #[test]
    fn two_tips_meet_wherever_that_is_while_a_third_stays() {
        let robot = Robot::builtin("shadow_hand").unwrap();
        let mut data = Data::new(robot.model()).unwrap();
        let home = robot.home();
        let stays = site(&robot, &home, "mftip");
        let tip = |name: &str| Point::Site(name.into());
        for finger in ["fftip", "rftip"] {
            let held = Target { point: tip("mftip"), pos: stays, quat: None };
            let pair = (tip("thtip"), tip(finger));
            let r =
                robot.ik_meeting(&mut data, &home, &[held], &[pair], &IkConfig::default()).unwrap();
            assert!(r.reached && within_limits(&robot, &r.state), "{finger}: {r:?}");
            let [a, b] = ["thtip", finger].map(|n| site(&robot, &r.state, n));
            let off = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
            assert!(off < 2e-4, "{finger} and thumb are {off} m apart");
            let still = site(&robot, &r.state, "mftip");
            assert!(stays.iter().zip(still).all(|(a, b)| (a - b).abs() < 2e-4));
        }
    }

    #[test]
    fn orientation_is_met_and_far_goals_end_nearby() {
        let robot = Robot::builtin("ur5e").unwrap();
        let mut data = Data::new(robot.model()).unwrap();
        let goal_state = [0.3, -1.2, 1.4, -1.0, -1.3];
        let Place { pos, quat } = at(&robot, &goal_state, &Point::Site("end_effector".into()));
        let target = Target { point: Point::Site("end_effector".into()), pos, quat: Some(quat) };
        let start = [0.1, -1.4, 1.2, -1.2, -1.5];
        let r = robot.ik(&mut data, &start, &[target], &IkConfig::default()).unwrap();
        assert!(r.reached && r.angle_rad < 1e-3, "{r:?}");
        let far =
            Target { point: Point::Site("end_effector".into()), pos: [0.0, 5.0, 1.6], quat: None };
        let r = robot.ik(&mut data, &start, &[far], &IkConfig::default()).unwrap();
        // Stretched out: the reach is 0.957 m minus the offset of the base.
        assert!(!r.reached && r.distance_m < 5.0 - 0.9, "{r:?}");
        let nobody = Target { point: Point::Site("nose".into()), pos: [0.0; 3], quat: None };
        assert!(robot.ik(&mut data, &start, &[nobody], &IkConfig::default()).is_err());
    }
}
