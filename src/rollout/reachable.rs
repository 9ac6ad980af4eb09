//! Makes goals reachable: fills gaps, and takes the current state where no motor can change it.
//!
//! In directions that actions do not move, the goal is replaced by the current state,
//!
//! ```text
//! goal' = s + P (goal - s)        P projects onto what actions move (net::reach)
//! ```
//!
//! because actions cannot change it: on the hand, the difference of two joints on one tendon. A
//! joint without any remaining goal, or in the middle of a gap, has almost no weight beside a joint
//! that it is coupled to and that has a goal, so that this goal is met exactly. Other joints keep
//! their weight. The effect of actions is estimated and never exactly zero, so a joint with almost
//! no weight would be sent far away to meet a goal on another finger. Everything here comes from the
//! data in the model file; the simulator's model of the robot is not used.

use nalgebra::{DMatrix, DVector};

use super::infill::infill;
use super::window::{COMMAND, Window};
use robert_net::reach::Reach;

/// A direction counts as driven by the actions if its singular value is above this, relative to the
/// largest one. Each joint is measured in units of its fastest motion; otherwise a slide in metres,
/// or a joint with much inertia, would count as not driven beside light hinges. Each actuator is
/// measured in units of its largest effect; otherwise a motor would count for nothing beside a servo
/// whose full action is metres away. On some 40 robots the least driven direction is above .08, and
/// joints that never left their stops have 0.
const DRIVEN: f64 = 1e-2;
/// Weight of a joint that gives way relative to all others.
const FREE: f64 = 1e-3;
/// Two joints are coupled if their entry in the projection onto what actions move is above this,
/// relative to the mean of their own two entries; each joint in units of its fastest motion. It is 1
/// for any number of equal joints on one motor; on the hand the error of the estimate leaves .005.
const COUPLED: f64 = 0.05;

/// The map from goals to reachable goals, for one robot.
#[derive(Clone, Debug)]
pub(super) struct Reachable {
    speed: Vec<f64>,
    /// Orthonormal columns that span the directions that actions move, (S, r); `None` if these are
    /// all directions.
    basis: Option<DMatrix<f64>>,
    /// Projection for a window whose joints all have the same weight, (S, S).
    project: Option<DMatrix<f64>>,
    /// The first joint of the group of coupled joints that each joint belongs to, (S).
    group: Vec<usize>,
}

impl Reachable {
    /// From the learned effect of actions, which has been checked.
    pub(super) fn new(reach: &Reach) -> Reachable {
        let s = reach.speed.len();
        let actions = reach.effect.first().map_or(0, Vec::len);
        let effect = DMatrix::from_fn(s, actions, |r, c| reach.effect[r][c]);
        let basis = driven(&effect, &reach.speed);
        let project = basis.as_ref().map(|q| q * q.transpose());
        let group = basis
            .as_ref()
            .and_then(|basis| groups(basis, &reach.speed))
            .unwrap_or_else(|| (0..s).collect());
        Reachable { speed: reach.speed.clone(), basis, project, group }
    }

    /// Fills the gaps of a window; afterwards all its goals are visible.
    pub(super) fn fill(&self, window: &mut Window) {
        infill(window, &self.speed);
    }

    /// The joints that give way: free ones that are coupled to one with a goal.
    fn light(&self, free: &[bool]) -> Vec<bool> {
        let asked = |group: usize| (0..free.len()).any(|j| !free[j] && self.group[j] == group);
        free.iter().zip(&self.group).map(|(&free, &group)| free && asked(group)).collect()
    }

    /// Projects the goals of a window onto what the robot can reach.
    pub(super) fn project(&self, window: &mut Window) {
        let d = window.dim();
        let Some(basis) = &self.basis else { return };
        let light = self.light(&window.free);
        let weighted;
        let project = match &self.project {
            Some(whole) if !light.contains(&true) => whole,
            _ => match weigh(basis, &light) {
                Some(found) => {
                    weighted = found;
                    &weighted
                }
                None => return,
            },
        };
        for i in 0..COMMAND {
            let goal = &mut window.command[i * d..(i + 1) * d];
            let way = DVector::from_fn(d, |j, _| goal[j] - window.current[j]);
            let way = project * way;
            for (j, goal) in goal.iter_mut().enumerate() {
                *goal = window.current[j] + way[j];
            }
        }
    }
}

/// Groups of coupled joints, directly or through others; see [`Reachable::group`].
fn groups(basis: &DMatrix<f64>, speed: &[f64]) -> Option<Vec<usize>> {
    let units = units(speed);
    let scaled = DMatrix::from_fn(basis.nrows(), basis.ncols(), |r, c| basis[(r, c)] / units[r]);
    let q = scaled.svd(true, false).u?;
    let p = &q * q.transpose();
    let mut group: Vec<usize> = (0..p.nrows()).collect();
    for (a, b) in (0..p.nrows()).flat_map(|a| (0..a).map(move |b| (a, b))) {
        if 2.0 * p[(a, b)].abs() > COUPLED * (p[(a, a)] + p[(b, b)]) {
            let (from, to) = (group[a].max(group[b]), group[a].min(group[b]));
            group.iter_mut().filter(|g| **g == from).for_each(|g| *g = to);
        }
    }
    Some(group)
}

/// The fastest motion of each joint, or 1 for all if some joint never moved.
fn units(speed: &[f64]) -> Vec<f64> {
    let still = speed.iter().any(|v| *v <= 0.0);
    speed.iter().map(|v| if still { 1.0 } else { *v }).collect()
}

/// The directions that actions can move; `None` if they move everything.
fn driven(effect: &DMatrix<f64>, speed: &[f64]) -> Option<DMatrix<f64>> {
    let s = effect.nrows();
    let units = units(speed);
    let scaled = DMatrix::from_fn(s, effect.ncols(), |r, c| effect[(r, c)] / units[r]);
    let shares = DMatrix::from_fn(s, effect.ncols(), |r, c| match scaled.column(c).amax() {
        0.0 => 0.0,
        most => scaled[(r, c)] / most,
    });
    let shares = shares.singular_values();
    let rank = shares.iter().filter(|v| **v > DRIVEN * shares.max()).count();
    if rank == s || rank == 0 {
        return None;
    }
    let svd = effect.clone().svd(true, false);
    let u = svd.u?;
    let mut order: Vec<usize> = (0..svd.singular_values.len()).collect();
    order.sort_by(|&a, &b| svd.singular_values[b].total_cmp(&svd.singular_values[a]));
    order.truncate(rank);
    order.sort_unstable();
    Some(DMatrix::from_fn(s, rank, |r, c| u[(r, order[c])]))
}

/// The projection if some joints have almost no weight: Q (Qᵀ W Q)⁻¹ Qᵀ W.
fn weigh(basis: &DMatrix<f64>, light: &[bool]) -> Option<DMatrix<f64>> {
    let weighted = DMatrix::from_fn(basis.nrows(), basis.ncols(), |r, c| {
        basis[(r, c)] * if light[r] { FREE } else { 1.0 }
    });
    let normal = basis.transpose() * &weighted;
    Some(basis * normal.cholesky()?.solve(&weighted.transpose()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two joints on one tendon and one on its own.
    fn hand() -> Reachable {
        let effect = vec![vec![0.1, 0.0], vec![0.1, 0.0], vec![0.0, 0.2]];
        Reachable::new(&Reach { effect, speed: vec![1.0; 3] })
    }

    fn window(goal: [f64; 3], current: [f64; 3]) -> Window {
        let mut window = Window::new(3);
        window.current.copy_from_slice(&current);
        window.history = current.repeat(window.history.len() / 3);
        window.command = goal.repeat(COMMAND);
        window.visible.fill(true);
        window.way.clone_from(&window.command);
        window.end.copy_from_slice(&goal);
        window
    }

    fn near(a: &[f64], b: [f64; 3]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 2e-3)
    }

    #[test]
    fn what_no_motor_moves_stays_as_it_is() {
        let mut w = window([0.6, 0.2, 0.3], [0.15, 0.05, 0.0]);
        hand().fill(&mut w);
        hand().project(&mut w);
        // The mean of the pair is reached, its difference stays.
        assert!(near(&w.command[..3], [0.45, 0.35, 0.3]), "{:?}", &w.command[..3]);
    }

    #[test]
    fn a_joint_without_a_goal_gives_way_to_its_neighbour() {
        let mut w = window([0.6, 0.0, 0.3], [0.0, 0.0, 0.0]);
        w.free[1] = true;
        for i in 0..COMMAND {
            w.visible[i * 3 + 1] = false;
        }
        hand().fill(&mut w);
        hand().project(&mut w);
        assert!(near(&w.command[..3], [0.6, 0.6, 0.3]), "{:?}", &w.command[..3]);
    }

    #[test]
    fn a_joint_in_the_middle_of_a_gap_gives_way_to_its_neighbour() {
        let mut w = window([0.6, 0.1, 0.3], [0.0, 0.0, 0.0]);
        w.passing[1] = true;
        for i in 0..COMMAND - 1 {
            w.visible[i * 3 + 1] = false;
        }
        hand().fill(&mut w);
        assert_eq!(w.free, [false, true, false]);
        hand().project(&mut w);
        assert!(near(&w.command[..3], [0.6, 0.6, 0.3]), "{:?}", &w.command[..3]);
    }

    #[test]
    fn joints_of_one_motor_are_coupled_whatever_their_number_and_units() {
        let one = |effect: Vec<Vec<f64>>, speed: Vec<f64>| Reachable::new(&Reach { effect, speed });
        // 24 joints on one tendon, and one of its own.
        let many = (0..25).map(|j| if j < 24 { vec![0.1, 0.0] } else { vec![0.0, 0.1] });
        let many = one(many.collect(), vec![1.0; 25]);
        assert!(many.group[..24].iter().all(|g| *g == 0) && many.group[24] == 24, "{many:?}");
        // A rack and its pinion of 10 mm.
        let rack = one(vec![vec![1e-3], vec![0.1]], vec![0.01, 1.0]);
        assert_eq!(rack.group, [0, 0]);
        assert_eq!(hand().group, [0, 0, 2]);
    }

    #[test]
    fn goals_that_cannot_be_met_do_not_move_a_free_joint_that_has_no_part_in_them() {
        // The estimate is a little wrong: the motor of the third joint seems to move the first one.
        let effect = vec![vec![0.1, -0.003], vec![0.1, 0.0], vec![0.0, 0.2]];
        let reachable = Reachable::new(&Reach { effect, speed: vec![1.0; 3] });
        let mut w = window([0.6, 0.0, 0.3], [0.0, 0.0, 0.3]);
        w.free[2] = true;
        for i in 0..COMMAND {
            w.visible[i * 3 + 2] = false;
        }
        reachable.fill(&mut w);
        reachable.project(&mut w);
        let goal = &w.command[..3];
        assert!(goal.iter().zip([0.3, 0.3, 0.3]).all(|(a, b)| (a - b).abs() < 0.01), "{goal:?}");
    }

    #[test]
    fn a_weak_motor_counts_beside_a_strong_servo() {
        // A servo with a goal metres away, a motor that accelerates slowly, and no motor.
        let effect = vec![vec![0.4, 1e-5], vec![-4e-4, 0.013], vec![0.0, 0.0]];
        let reachable = Reachable::new(&Reach { effect, speed: vec![0.03, 0.45, 1.0] });
        let mut w = window([0.6, 0.2, 0.3], [0.0, 0.0, 0.1]);
        reachable.project(&mut w);
        assert!(near(&w.command[..3], [0.6, 0.2, 0.1]), "{:?}", &w.command[..3]);
    }

    #[test]
    fn a_robot_whose_motors_move_everything_keeps_its_goals() {
        // A light hinge, and a slide that moves a thousandth of that in metres.
        let effect = vec![vec![0.3, 0.02], vec![0.0, 3e-4]];
        let speed = vec![1.0, 2e-3];
        let reachable = Reachable::new(&Reach { effect, speed });
        assert!(reachable.basis.is_none());
        let mut w = Window::new(2);
        w.visible.fill(true);
        w.command = [0.4, -0.7].repeat(COMMAND);
        let goals = w.command.clone();
        reachable.project(&mut w);
        assert_eq!(w.command, goals);
    }
}
