//! The state of the optimiser in a training checkpoint.

use super::Error;
use super::step::Learner;

/// Moments and step of the optimiser, which resuming needs besides the weights. Random numbers and
/// the data cursor are functions of seed and step.
#[derive(Clone, Debug, PartialEq)]
pub struct OptimiserState {
    /// First moment, laid out as the weights.
    pub first: Vec<f32>,
    /// Second moment.
    pub second: Vec<f32>,
    /// Running average of the weights, if there is one.
    pub average: Option<Vec<f32>>,
    /// Steps applied.
    pub count: u64,
}

impl OptimiserState {
    /// The state of a learner, with the running average if one is kept.
    pub fn of(learner: &Learner<f32>, average: Option<&[f32]>) -> Self {
        OptimiserState {
            first: learner.first.to_vec(),
            second: learner.second.to_vec(),
            average: average.map(<[f32]>::to_vec),
            count: learner.count,
        }
    }

    /// Restores the state of a learner whose network came from the same file.
    ///
    /// # Errors
    /// [`Error::Shape`].
    pub fn restore(&self, learner: &mut Learner<f32>) -> Result<(), Error> {
        let want = learner.first.len();
        if self.first.len() != want || self.second.len() != want {
            return Err(Error::Shape { what: "optimiser state", want, got: self.first.len() });
        }
        learner.first.copy_from_slice(&self.first);
        learner.second.copy_from_slice(&self.second);
        learner.count = self.count;
        Ok(())
    }
}
