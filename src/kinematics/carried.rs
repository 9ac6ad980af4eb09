//! Joints whose values follow from those of others, because loops are closed.

use nalgebra::DMatrix;

use super::ik::{IkConfig, Search};
use super::tree::Kinematics;

/// The smallest singular value of a loop's Jacobian, relative to the largest, that ties joints together.
const LEAST: f64 = 1e-4;
/// The share of a joint's motion that loops must determine.
const DETERMINED: f64 = 1.0 - 1e-4;

/// The result of [`Kinematics::carried`].
#[derive(Clone, Debug, PartialEq)]
pub struct Carried {
    /// All joint values, with closed loops; (joints).
    pub state: Vec<f64>,
    /// State indices of the joints that the known ones determine, sorted.
    pub joints: Vec<usize>,
    /// Iterations used.
    pub iterations: u32,
}

impl Kinematics {
    /// Closes the loops of which some joints are known, from `start` (joints), which holds the values of the
    /// `known` ones (state indices). A rod between two ball joints, for example, may still turn about itself:
    /// that joint is not determined. `None` if no loop has both known and unknown joints, or if the known
    /// values cannot be met.
    pub fn carried(&self, start: &[f64], known: &[usize]) -> Option<Carried> {
        if self.closures.is_empty() {
            return None;
        }
        let config = IkConfig { locked: known.to_vec(), ..IkConfig::default() };
        let may = self.free_joints(&config);
        let (mut free, closures) = self.along(known.to_vec(), &may);
        free.retain(|joint| may.contains(joint));
        if free.is_empty() || closures.is_empty() {
            return None;
        }
        let search = Search::new(self, &closures, free, &config);
        let mut state = start.to_vec();
        let iterations = search.closest(&mut state);
        let world = self.world(&state);
        if !search.is_reached(&search.error(&world, &state), 1.0) {
            return None;
        }
        let determined = determined(&search.jacobian(&world));
        let free = search.free.iter().zip(determined);
        let joints: Vec<usize> = free.filter_map(|(joint, is)| is.then_some(*joint)).collect();
        Some(Carried { state, joints, iterations })
    }
}

/// Which of the columns' variables are determined by all rows together.
fn determined(jacobian: &DMatrix<f64>) -> Vec<bool> {
    let svd = jacobian.clone().svd(false, true);
    let least = LEAST * svd.singular_values.max();
    let Some(v) = svd.v_t else { return vec![false; jacobian.ncols()] };
    let held = |column: usize| -> f64 {
        let rows = svd.singular_values.iter().enumerate().filter(|(_, s)| **s > least);
        rows.map(|(row, _)| v[(row, column)].powi(2)).sum()
    };
    (0..jacobian.ncols()).map(|column| held(column) > DETERMINED).collect()
}
