//! Counter-based random numbers: every draw is a pure function of (seed, stream, index).
//!
//! With a stateful generator results would depend on the order of work, and so on the number of
//! threads and on where a run was resumed. Here every draw is identified by its purpose and index,
//! so a batch, a mask or an episode is the same on one machine or a thousand.
//!
//! A draw applies the finaliser of `SplitMix64` (Steele, Lea, Flood 2014) to the three words in
//! turn. [`Rng`] gives a sequence that counts upward from that draw.

use std::f64::consts::TAU;

/// The purpose of a draw. The numbers are part of every recorded result: never renumber.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u64)]
pub enum Stream {
    /// Chooses the windows of a training batch.
    Batch = 1,
    /// Chooses the hidden command frames.
    Mask = 2,
    /// Chooses the sampled action bin at inference.
    Bin = 3,
    /// Network initialisation.
    Init = 4,
    /// K-means starts and re-draws.
    KMeans = 5,
    /// Train/test split by trajectory.
    Split = 6,
    /// Dataset corruption.
    Corrupt = 7,
    /// Episode resets in collection.
    Reset = 8,
    /// Collector noise (torques, exploration).
    Noise = 9,
    /// Replay sampling.
    Replay = 10,
    /// Skill vectors and candidate sampling of the collectors.
    Skill = 11,
    /// Sampling planners.
    Planner = 13,
    /// Randomised plants (mass, damping, gear).
    Plant = 14,
    /// Closed-form fits and their samples.
    Fit = 15,
    /// Poses of trial clips.
    Trial = 17,
    /// Windows from motion that a network performed itself.
    Reached = 18,
    /// Movements of goals that are tried to get around what blocks a joint.
    Detour = 19,
    /// Small movements of a mesh's points.
    Mesh = 20,
    /// Tests only.
    Test = 99,
}

const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;

fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// 64 random bits, a pure function of the three words.
pub fn draw(seed: u64, stream: Stream, index: u64) -> u64 {
    let a = mix(seed.wrapping_add(GOLDEN));
    let b = mix(a ^ (stream as u64).wrapping_mul(GOLDEN));
    mix(b.wrapping_add(index.wrapping_mul(GOLDEN)).wrapping_add(GOLDEN))
}

/// A short sequence of draws that starts at (seed, stream, index).
///
/// ```
/// use robert_base::rng::{Rng, Stream};
///
/// // Draws are functions: the same three numbers give the same sequence, on any thread.
/// let draw = |index| Rng::new(7, Stream::Noise, index).uniform();
/// assert_eq!(draw(3), draw(3));
/// assert_ne!(draw(3), draw(4));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Rng {
    key: u64,
    count: u64,
}

impl Rng {
    /// The sequence named by the three words.
    pub fn new(seed: u64, stream: Stream, index: u64) -> Self {
        Rng { key: draw(seed, stream, index), count: 0 }
    }

    /// The next 64 bits.
    pub fn next_u64(&mut self) -> u64 {
        self.count += 1;
        mix(self.key.wrapping_add(self.count.wrapping_mul(GOLDEN)))
    }

    /// Uniform in [0, 1), 53 bits.
    pub fn uniform(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
    }

    /// Uniform in [lo, hi).
    pub fn range(&mut self, lo: f64, hi: f64) -> f64 {
        lo + (hi - lo) * self.uniform()
    }

    /// Uniform integer in 0..n, without modulo bias (Lemire 2019). 0 when n is 0.
    pub fn below(&mut self, n: u64) -> u64 {
        if n == 0 {
            return 0;
        }
        loop {
            let wide = u128::from(self.next_u64()) * u128::from(n);
            if (wide as u64) >= n.wrapping_neg() % n {
                return (wide >> 64) as u64;
            }
        }
    }

    /// Standard normal (Box–Muller; both halves are drawn, one is used, so that each
    /// call costs the same two draws).
    pub fn normal(&mut self) -> f64 {
        let u = 1.0 - self.uniform();
        let v = self.uniform();
        (-2.0 * u.ln()).sqrt() * (TAU * v).cos()
    }

    /// `count` distinct integers of 0..n in ascending order (Floyd's algorithm).
    pub fn subset(&mut self, count: usize, n: usize) -> Vec<usize> {
        let count = count.min(n);
        let mut chosen = Vec::with_capacity(count);
        for j in (n - count)..n {
            let t = self.below(j as u64 + 1) as usize;
            let pick = if chosen.contains(&t) { j } else { t };
            chosen.push(pick);
        }
        chosen.sort_unstable();
        chosen
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_depend_on_every_word() {
        let d = draw(1, Stream::Mask, 7);
        assert_ne!(d, draw(2, Stream::Mask, 7));
        assert_ne!(d, draw(1, Stream::Batch, 7));
        assert_ne!(d, draw(1, Stream::Mask, 8));
        assert_eq!(d, draw(1, Stream::Mask, 7));
    }

    #[test]
    fn moments_are_right() {
        let mut rng = Rng::new(3, Stream::Test, 0);
        let n = 200_000;
        let (mut mean, mut sq, mut uni) = (0.0, 0.0, 0.0);
        for _ in 0..n {
            let z = rng.normal();
            mean += z;
            sq += z * z;
            uni += rng.uniform();
        }
        let n = f64::from(n);
        assert!((mean / n).abs() < 0.01);
        assert!((sq / n - 1.0).abs() < 0.02);
        assert!((uni / n - 0.5).abs() < 0.005);
    }

    #[test]
    fn subset_is_distinct_and_uniform() {
        let mut hits = [0_u32; 20];
        for i in 0..20_000 {
            let s = Rng::new(5, Stream::Test, i).subset(7, 20);
            assert_eq!(s.len(), 7);
            assert!(s.windows(2).all(|w| w[0] < w[1]));
            for k in s {
                hits[k] += 1;
            }
        }
        for h in hits {
            assert!((f64::from(h) / 20_000.0 - 0.35).abs() < 0.02, "{hits:?}");
        }
    }

    #[test]
    fn below_covers_the_range() {
        let mut rng = Rng::new(9, Stream::Test, 1);
        let mut seen = [0_u32; 5];
        for _ in 0..5000 {
            seen[rng.below(5) as usize] += 1;
        }
        assert!(seen.iter().all(|&n| (850..1150).contains(&n)), "{seen:?}");
    }
}
