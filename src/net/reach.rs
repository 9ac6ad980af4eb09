//! The directions in which the robot can move, learned from recorded motion.
//!
//! A typed pose is often unreachable: for example, two joints on one tendon differ, and no motor
//! moves their difference. For such a difference an inverse model gives torque that disturbs
//! everything else. So goals are projected onto what actions can move before a policy sees them
//! (`rollout::reachable`). The effect of actions is estimated from data, not from a model: the
//! change of state is regressed on the last actions and earlier changes, and the map from the last
//! action is kept.

use serde::{Deserialize, Serialize};

use super::Error;
use super::ridge::{Episodes, cholesky, solve};
use super::token::Facts;
use robert_base::rng::{Rng, Stream};
use robert_linalg::{Init, Mat, MatMut, gemm};

/// The most frames of the regression.
const SAMPLES: u64 = 60_000;
/// Frames whose products are computed together.
const BLOCK: usize = 1024;
/// The most draws per wanted frame. In the second half of them frames in self-contact are accepted
/// too.
const PICKY: u64 = 10;
/// Earlier changes of state in the regression.
const PAST: usize = 3;
/// A joint closer than this to a stop shows the effect of the stop, not of the motor; rad or m, and
/// as a share of the range. A finger of a gripper slides only a few centimetres.
const STOP: f64 = 0.03;
const STOP_SHARE: f64 = 0.1;
/// Ridge penalty for each sample.
const PENALTY: f64 = 1e-6;
/// The fastest speed of a joint is that which this share of recorded frames stays below.
const FASTEST: f64 = 0.9999;

/// The effect of actions, and the fastest recorded motion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reach {
    /// Change of each state joint in one frame for a full action of each actuator, rad or m;
    /// S rows of A. A row of zeros: the joint was never seen away from its stops.
    pub effect: Vec<Vec<f64>>,
    /// Greatest recorded change of each state joint in one frame (except one frame in ten
    /// thousand), rad or m; (S).
    pub speed: Vec<f64>,
}

impl Reach {
    /// Fits both to recorded motion.
    ///
    /// # Errors
    /// [`Error::Shape`] when no episode is long enough, [`Error::Singular`].
    pub fn fit(facts: &Facts, episodes: &impl Episodes, seed: u64) -> Result<Self, Error> {
        let (s, a) = (facts.joints.len(), facts.actions);
        let lengths: Vec<(usize, u64)> = (0..episodes.count())
            .map(|e| (e, (episodes.states(e).len() / s.max(1)) as u64))
            .filter(|(_, n)| *n > PAST as u64 + 1)
            .collect();
        if lengths.is_empty() {
            let want = PAST + 2;
            return Err(Error::Shape { what: "frames of the longest episode", want, got: 0 });
        }
        let inputs = 2 * a + PAST * s + 1;
        let mut sums = vec![Sums::new(inputs); s];
        let mut block = Block::new(inputs, s);
        let mut taken = 0;
        let mut index = 0;
        while taken < SAMPLES && index < PICKY * SAMPLES {
            let mut rng = Rng::new(seed, Stream::Fit, index);
            index += 1;
            let (e, n) = lengths[rng.below(lengths.len() as u64) as usize];
            let t = PAST + rng.below(n - PAST as u64 - 1) as usize;
            if index < PICKY * SAMPLES / 2 && (t - 1..=t + 1).any(|f| episodes.in_contact(e, f)) {
                continue;
            }
            let (states, actions) = (episodes.states(e), episodes.actions(e));
            let q = |t: usize, j: usize| f64::from(states[t * s + j]);
            let u = |t: usize, i: usize| f64::from(actions[t * a + i]);
            block.x.extend((0..a).map(|i| u(t, i)));
            block.x.extend((0..a).map(|i| u(t - 1, i)));
            for back in 0..PAST {
                block.x.extend((0..s).map(|j| q(t - back, j) - q(t - back - 1, j)));
            }
            block.x.push(1.0);
            block.y.extend(facts.joints.iter().enumerate().map(|(j, joint)| {
                let free = joint.range.is_none_or(|[lo, hi]| {
                    let stop = STOP.min(STOP_SHARE * (hi - lo));
                    [q(t, j), q(t + 1, j)].iter().all(|&q| q > lo + stop && q < hi - stop)
                });
                free.then(|| q(t + 1, j) - q(t, j))
            }));
            taken += 1;
            if block.rows() == BLOCK {
                block.add_to(&mut sums);
            }
        }
        block.add_to(&mut sums);
        let effect = sums
            .into_iter()
            .enumerate()
            .map(|(j, sum)| {
                let all = sum.solve().map_err(|row| Error::Singular {
                    what: format!("the effect of actions on joint {j}"),
                    row,
                })?;
                Ok(all[..a].to_vec())
            })
            .collect::<Result<_, Error>>()?;
        Ok(Reach { effect, speed: speeds(s, episodes, &lengths) })
    }

    /// Refuses numbers of another robot, and numbers that are not finite.
    ///
    /// # Errors
    /// [`Error::Shape`], [`Error::Config`].
    pub fn check(&self, facts: &Facts) -> Result<(), Error> {
        let (s, a) = (facts.joints.len(), facts.actions);
        for (what, want, got) in
            [("rows of reach.effect", s, self.effect.len()), ("reach.speed", s, self.speed.len())]
        {
            if got != want {
                return Err(Error::Shape { what, want, got });
            }
        }
        if let Some(row) = self.effect.iter().find(|row| row.len() != a) {
            let (what, got) = ("columns of reach.effect", row.len());
            return Err(Error::Shape { what, want: a, got });
        }
        let finite = self.effect.iter().flatten().chain(&self.speed).all(|x| x.is_finite());
        if !finite || self.speed.iter().any(|x| *x < 0.0) {
            let why = "contains a number that is not finite, or a negative speed".to_owned();
            return Err(Error::Config { field: "reach", why });
        }
        Ok(())
    }
}

/// Normal equations of one joint.
#[derive(Clone)]
struct Sums {
    xx: Vec<f64>,
    xy: Vec<f64>,
    count: f64,
}

impl Sums {
    fn new(inputs: usize) -> Self {
        Sums { xx: vec![0.0; inputs * inputs], xy: vec![0.0; inputs], count: 0.0 }
    }

    /// The weights, or the row that could not be solved.
    fn solve(mut self) -> Result<Vec<f64>, usize> {
        let n = self.xy.len();
        let penalty = PENALTY * self.count.max(1.0);
        self.xx.iter_mut().step_by(n + 1).for_each(|d| *d += penalty);
        cholesky(&mut self.xx, n)?;
        solve(&self.xx, n, &mut self.xy, 1);
        Ok(self.xy)
    }
}

/// Samples whose products are computed together. Most of them count for every joint.
struct Block {
    /// The inputs, (samples, inputs).
    x: Vec<f64>,
    /// The change of each joint, (samples, S); `None` where a stop is near.
    y: Vec<Option<f64>>,
    inputs: usize,
    joints: usize,
}

impl Block {
    fn new(inputs: usize, joints: usize) -> Self {
        Block { x: Vec::new(), y: Vec::new(), inputs, joints }
    }

    fn rows(&self) -> usize {
        self.x.len() / self.inputs
    }

    /// Adds the samples to the sums of all joints, and forgets them.
    fn add_to(&mut self, sums: &mut [Sums]) {
        let n = self.inputs;
        let all = product(&self.x, n);
        let mut few = Vec::new();
        for (j, sum) in sums.iter_mut().enumerate() {
            let changes = || self.y.iter().skip(j).step_by(self.joints);
            let free = changes().flatten().count();
            // The product of the fewer rows, of those that count or of the others.
            let counts = 2 * free <= self.rows();
            few.clear();
            for (x, y) in self.x.chunks_exact(n).zip(changes()) {
                if y.is_some() == counts {
                    few.extend_from_slice(x);
                }
                if let Some(y) = y {
                    sum.xy.iter_mut().zip(x).for_each(|(to, x)| *to += x * y);
                }
            }
            let some = product(&few, n);
            let to = sum.xx.iter_mut();
            if counts {
                to.zip(&some).for_each(|(to, some)| *to += some);
            } else {
                to.zip(all.iter().zip(&some)).for_each(|(to, (all, some))| *to += all - some);
            }
            sum.count += free as f64;
        }
        self.x.clear();
        self.y.clear();
    }
}

/// x' x of rows of `n` numbers, (n, n).
fn product(x: &[f64], n: usize) -> Vec<f64> {
    let mut out = vec![0.0; n * n];
    let rows = x.len() / n;
    if rows > 0 {
        let x = Mat::new(x, rows, n);
        gemm(MatMut::new(&mut out, n, n), Init::Zero, x.t(), x);
    }
    out
}

/// Greatest change of each joint in a frame, except one frame in ten thousand.
fn speeds(s: usize, episodes: &impl Episodes, lengths: &[(usize, u64)]) -> Vec<f64> {
    let mut moves: Vec<f32> = Vec::new();
    (0..s)
        .map(|j| {
            moves.clear();
            for &(e, n) in lengths {
                let q = episodes.states(e);
                moves.extend((1..n as usize).map(|t| (q[t * s + j] - q[(t - 1) * s + j]).abs()));
            }
            let rank = ((moves.len() - 1) as f64 * FASTEST) as usize;
            let (_, at, _) = moves.select_nth_unstable_by(rank, f32::total_cmp);
            f64::from(*at)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::JointFacts;

    /// Two joints on one motor, one joint on its own: first-order plants.
    struct Tendon {
        q: Vec<f32>,
        u: Vec<f32>,
    }

    impl Tendon {
        fn new() -> Self {
            let n = 4000;
            let (mut q, mut u) = (vec![0.0_f32; 3 * n], vec![0.0_f32; 2 * n]);
            for t in 0..n {
                let mut rng = Rng::new(3, Stream::Test, t as u64);
                for i in 0..2 {
                    u[2 * t + i] = rng.range(-1.0, 1.0) as f32;
                }
                if t + 1 < n {
                    let pull = [0.05 * u[2 * t], 0.05 * u[2 * t], 0.1 * u[2 * t + 1]];
                    for (j, pull) in pull.into_iter().enumerate() {
                        q[3 * t + 3 + j] = 0.98 * q[3 * t + j] + pull + 1e-4 * rng.normal() as f32;
                    }
                }
            }
            Tendon { q, u }
        }
    }

    impl Episodes for Tendon {
        fn count(&self) -> usize {
            1
        }
        fn states(&self, _: usize) -> &[f32] {
            &self.q
        }
        fn actions(&self, _: usize) -> &[f32] {
            &self.u
        }
    }

    fn facts() -> Facts {
        Facts { joints: vec![JointFacts { hinge: true, range: None }; 3], actions: 2 }
    }

    #[test]
    fn the_effect_of_actions_is_found() {
        let reach = Reach::fit(&facts(), &Tendon::new(), 0).unwrap();
        reach.check(&facts()).unwrap();
        let want = [[0.05, 0.0], [0.05, 0.0], [0.0, 0.1]];
        for (row, want) in reach.effect.iter().zip(want) {
            for (x, want) in row.iter().zip(want) {
                assert!((x - want).abs() < 2e-3, "{reach:?}");
            }
        }
        assert!(reach.speed[2] > 0.08 && reach.speed[2] < 0.12, "{:?}", reach.speed);
    }

    #[test]
    fn a_short_slide_is_not_always_at_a_stop() {
        struct Gripper(Vec<f32>, Vec<f32>);
        impl Episodes for Gripper {
            fn count(&self) -> usize {
                1
            }
            fn states(&self, _: usize) -> &[f32] {
                &self.0
            }
            fn actions(&self, _: usize) -> &[f32] {
                &self.1
            }
        }
        let n = 2000;
        let u: Vec<f32> =
            (0..n).map(|t| Rng::new(5, Stream::Test, t).range(-1.0, 1.0) as f32).collect();
        let mut q = vec![0.02_f32; n as usize];
        for t in 1..q.len() {
            q[t] = (q[t - 1] + 0.004 * u[t - 1]).clamp(0.0, 0.04);
        }
        let slide = JointFacts { hinge: false, range: Some([0.0, 0.04]) };
        let facts = Facts { joints: vec![slide], actions: 1 };
        let reach = Reach::fit(&facts, &Gripper(q, u), 0).unwrap();
        assert!((reach.effect[0][0] - 0.004).abs() < 1e-4, "{reach:?}");
    }

    #[test]
    fn numbers_of_another_robot_are_refused() {
        let good = Reach { effect: vec![vec![0.0; 2]; 3], speed: vec![1.0; 3] };
        good.check(&facts()).unwrap();
        let mut bad = good.clone();
        bad.effect.pop();
        assert!(bad.check(&facts()).is_err());
        let mut bad = good.clone();
        bad.effect[1].pop();
        assert!(bad.check(&facts()).is_err());
        let mut bad = good.clone();
        bad.speed[0] = f64::NAN;
        assert!(bad.check(&facts()).is_err());
        let mut bad = good;
        bad.speed[0] = -1.0;
        assert!(bad.check(&facts()).is_err());
    }

    #[test]
    fn too_little_motion_is_refused() {
        struct Nothing;
        impl Episodes for Nothing {
            fn count(&self) -> usize {
                1
            }
            fn states(&self, _: usize) -> &[f32] {
                &[0.0; 9]
            }
            fn actions(&self, _: usize) -> &[f32] {
                &[0.0; 6]
            }
        }
        assert!(Reach::fit(&facts(), &Nothing, 0).is_err());
    }

    #[test]
    fn a_block_has_the_sums_of_its_samples() {
        let (inputs, samples) = (5, 40);
        let mut rng = Rng::new(3, Stream::Test, 1);
        let x: Vec<f64> = (0..samples * inputs).map(|_| rng.normal()).collect();
        // Joint j counts in j of every five samples: in none, in few, in most, in all.
        let counts = |row: usize, j: usize| row % 5 < j;
        let mut sums = vec![Sums::new(inputs); 6];
        let mut block = Block::new(inputs, 6);
        block.x.clone_from(&x);
        let y = |row: usize, j: usize| (row * 7 + j) as f64 * 0.01;
        block.y.extend((0..samples).flat_map(|row| {
            (0..6).map(move |j| counts(row, j).then(|| y(row, j))).collect::<Vec<_>>()
        }));
        block.add_to(&mut sums);
        for (j, sum) in sums.iter().enumerate() {
            let rows: Vec<usize> = (0..samples).filter(|&row| counts(row, j)).collect();
            assert_eq!(sum.count, rows.len() as f64);
            for a in 0..inputs {
                let column = |row: usize, k: usize| x[row * inputs + k];
                let xy: f64 = rows.iter().map(|&r| column(r, a) * y(r, j)).sum();
                assert!((sum.xy[a] - xy).abs() < 1e-9);
                for b in 0..inputs {
                    let xx: f64 = rows.iter().map(|&r| column(r, a) * column(r, b)).sum();
                    assert!((sum.xx[a * inputs + b] - xx).abs() < 1e-9, "joint {j}");
                }
            }
        }
        assert_eq!(block.rows(), 0);
    }
}
