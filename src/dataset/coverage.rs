//! Coverage of the state space, on coarse grids.
//!
//! A grid over all joints at once is useless beyond three joints: with 22 joints every frame has
//! its own cell. So the measure uses planes: every pair of joints, and every joint against its own
//! velocity, each divided into 20 x 20 cells. Coverage is the mean share of visited cells. It is 0
//! for a robot at rest, rises with every new combination, and is comparable between agents and over
//! time.

use super::robot::Robot;

/// Cells along one edge of a plane.
const CELLS: usize = 20;
/// Words of 64 cells in one plane.
const WORDS: usize = (CELLS * CELLS).div_ceil(64);
/// Half-width of the grid for joints without stops, in the joint's unit.
const UNBOUNDED: f64 = 3.0;
/// Half-width of the velocity axis: this many ranges (or grid widths) per second.
const SPEED_RANGES: f64 = 1.0;

/// Visited cells of all planes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Coverage {
    /// (offset, cells per unit) of each position axis as bits of f32, so that Eq holds.
    position: Vec<Axis>,
    velocity: Vec<Axis>,
    bits: Vec<[u64; WORDS]>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Axis {
    lo: u32,
    scale: u32,
}

impl Axis {
    fn new(lo: f64, hi: f64) -> Self {
        let scale = CELLS as f64 / (hi - lo).max(1e-9);
        Axis { lo: (lo as f32).to_bits(), scale: (scale as f32).to_bits() }
    }

    /// Cell of `x`; values outside the grid belong to no cell.
    fn cell(self, x: f32) -> Option<usize> {
        let at = (x - f32::from_bits(self.lo)) * f32::from_bits(self.scale);
        (0.0..CELLS as f32).contains(&at).then_some(at as usize)
    }
}

impl Coverage {
    /// Empty grids for this robot: positions over each joint's range (3 rad or m either way
    /// without stops), velocities up to one range a second.
    pub fn new(robot: &Robot) -> Self {
        let mut position = Vec::new();
        let mut velocity = Vec::new();
        for range in &robot.ranges {
            let [lo, hi] = range.unwrap_or([-UNBOUNDED, UNBOUNDED]);
            let speed = SPEED_RANGES * (hi - lo);
            position.push(Axis::new(lo, hi));
            velocity.push(Axis::new(-speed, speed));
        }
        let s = position.len();
        Coverage { bits: vec![[0; WORDS]; s * (s + 1) / 2], position, velocity }
    }

    /// Marks one frame: `qpos` and `qvel` (S).
    pub fn add(&mut self, qpos: &[f32], qvel: &[f32]) {
        let mut cells = [None; robert_base::limits::JOINTS];
        for ((cell, axis), &x) in cells.iter_mut().zip(&self.position).zip(qpos) {
            *cell = axis.cell(x);
        }
        let cells = &cells[..self.position.len()];
        let mut planes = self.bits.iter_mut();
        for (i, &a) in cells.iter().enumerate() {
            let speed = self.velocity.get(i).zip(qvel.get(i)).and_then(|(v, &x)| v.cell(x));
            mark(planes.next(), a, speed);
            for &b in cells.iter().skip(i + 1) {
                mark(planes.next(), a, b);
            }
        }
    }

    /// Adds the visited cells of another grid of the same robot.
    pub fn merge(&mut self, other: &Self) {
        for (mine, theirs) in self.bits.iter_mut().zip(&other.bits) {
            for (m, t) in mine.iter_mut().zip(theirs) {
                *m |= t;
            }
        }
    }

    /// Mean share of cells visited, 0 to 1.
    pub fn share(&self) -> f64 {
        let seen: u64 = self.bits.iter().flatten().map(|w| u64::from(w.count_ones())).sum();
        seen as f64 / (self.bits.len() * CELLS * CELLS).max(1) as f64
    }

    /// The visited cells, for a checkpoint.
    pub fn words(&self) -> Vec<u64> {
        self.bits.iter().flatten().copied().collect()
    }

    /// Restores visited cells from a checkpoint of the same robot; others are ignored.
    pub fn restore(&mut self, words: &[u64]) {
        for (mine, theirs) in self.bits.iter_mut().zip(words.chunks_exact(WORDS)) {
            mine.copy_from_slice(theirs);
        }
    }
}

fn mark(plane: Option<&mut [u64; WORDS]>, a: Option<usize>, b: Option<usize>) {
    if let (Some(plane), Some(a), Some(b)) = (plane, a, b) {
        let at = a * CELLS + b;
        if let Some(word) = plane.get_mut(at / 64) {
            *word |= 1 << (at % 64);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::manifest::tests::robot;
    use super::*;

    #[test]
    fn counts_cells_once() {
        let mut c = Coverage::new(&robot());
        assert_eq!(c.share(), 0.0);
        c.add(&[0.0, 0.0], &[0.0, 0.0]);
        let one = c.share();
        assert!((one - 3.0 / (3.0 * 400.0)).abs() < 1e-12, "{one}");
        c.add(&[0.01, 0.01], &[0.01, 0.01]);
        assert_eq!(c.share(), one);
        c.add(&[0.9, 0.0], &[0.0, 0.0]);
        assert!((c.share() - 5.0 / 1200.0).abs() < 1e-12);
        c.add(&[9.0, 99.0], &[0.0, 0.0]);
        assert!((c.share() - 5.0 / 1200.0).abs() < 1e-12, "outside is no cell");
        let mut d = Coverage::new(&robot());
        d.restore(&c.words());
        assert_eq!(c, d);
    }

    #[test]
    fn a_full_grid_is_one() {
        let mut c = Coverage::new(&robot());
        let edge = |i: usize, lo: f32, hi: f32| lo + (hi - lo) * (i as f32 + 0.5) / CELLS as f32;
        for i in 0..CELLS {
            for j in 0..CELLS {
                c.add(&[edge(i, -1.0, 1.0), edge(j, -3.0, 3.0)], &[edge(j, -2.0, 2.0), 0.0]);
                c.add(&[0.0, edge(i, -3.0, 3.0)], &[0.0, edge(j, -6.0, 6.0)]);
            }
        }
        assert_eq!(c.share(), 1.0);
    }
}
