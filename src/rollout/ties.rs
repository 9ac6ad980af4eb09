//! The joints that one actuator moves together: those of a tendon, or a leader and its follower.
//!
//! Two joints of one tendon that are asked for 0 and 1.2 rad and bend alike have the same sum of errors wherever
//! they stand between these goals: half bent or hardly bent at all. The tendon moves their sum, so its error
//! decides such ties.

use std::sync::Arc;

use robert_robot::{Coupling, Robot};

/// Weight of the error of tied joints together, beside their own. A finger that is half a radian straighter than
/// asked may save the other joints .025 rad at most.
const WEIGHT: f64 = 0.05;

/// The joints of one actuator, and how far each moves it; the largest factor is 1.
#[derive(Clone, Debug, PartialEq)]
struct Tie {
    joints: Vec<(usize, f64)>,
    /// Whether the joints can be apart: those of a tendon, unlike a leader and its follower.
    splits: bool,
}

/// The joints of a robot that are tied to each other.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Ties(Arc<[Tie]>);

impl Ties {
    /// Those of a robot.
    pub(super) fn of(robot: &Robot) -> Ties {
        let place = |name: &str| robot.joint_index(name).ok();
        let tie = |coupling: &Coupling| -> Option<Tie> {
            match coupling {
                Coupling::Tendon { joints, coefs, .. } => {
                    let most = coefs.iter().fold(0.0, |most: f64, c| most.max(c.abs()));
                    let each = joints.iter().zip(coefs);
                    let joints =
                        each.map(|(j, c)| Some((place(j)?, c / most))).collect::<Option<_>>()?;
                    (most > 0.0).then_some(Tie { joints, splits: true })
                }
                Coupling::Mimic { follower, leader, .. } => {
                    let joints = vec![(place(leader)?, 1.0), (place(follower)?, 1.0)];
                    Some(Tie { joints, splits: false })
                }
            }
        };
        Ties(robot.profile().couplings.iter().filter_map(tie).collect())
    }

    /// What the joints of each tendon are off together, with its weight; rad or m. `off` is the error of a joint
    /// with its sign, `None` without a goal.
    pub(super) fn error(&self, off: impl Fn(usize) -> Option<f64>) -> f64 {
        let together =
            |tie: &Tie| tie.joints.iter().map(|&(j, c)| Some(c * off(j)?)).sum::<Option<f64>>();
        let tendons = self.0.iter().filter(|tie| tie.splits);
        WEIGHT * tendons.filter_map(together).map(f64::abs).sum::<f64>()
    }

    /// The other joints that are tied to a joint.
    pub(super) fn partners(&self, joint: usize) -> impl Iterator<Item = usize> {
        let joints = self.0.iter().map(|tie| &tie.joints);
        let tied = joints.filter(move |joints| joints.iter().any(|(j, _)| *j == joint));
        tied.flatten().map(|(j, _)| *j).filter(move |j| *j != joint)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_outer_joints_of_a_finger_are_partners() {
        let hand = Robot::builtin("shadow_hand").unwrap();
        let at = |name: &str| hand.joint_index(name).unwrap();
        let ties = Ties::of(&hand);
        assert_eq!(ties.0.len(), 4);
        assert_eq!(ties.partners(at("FFJ1")).collect::<Vec<_>>(), [at("FFJ2")]);
        assert_eq!(ties.partners(at("FFJ3")).count(), 0);
        assert_eq!(Ties::of(&Robot::builtin("ur5e").unwrap()), Ties::default());
    }

    #[test]
    fn the_length_of_a_tendon_decides_between_equal_sums() {
        let hand = Robot::builtin("shadow_hand").unwrap();
        let [a, b] = ["FFJ2", "FFJ1"].map(|name| hand.joint_index(name).unwrap());
        let ties = Ties::of(&hand);
        // Asked for 0 and 1.2.
        let error = |x: f64, y: f64| {
            ties.error(|j| {
                Some(if j == a {
                    x
                } else if j == b {
                    y - 1.2
                } else {
                    0.0
                })
            })
        };
        assert!(error(0.6, 0.6) < 1e-9);
        assert!((error(0.15, 0.15) - WEIGHT * 0.9).abs() < 1e-9);
        assert_eq!(ties.error(|j| (j == a).then_some(1.0)), 0.0, "the other joint is free");
    }
}
