//! The one interface behind which every policy stands.

use super::error::Error;
use super::window::Window;
use crate::mujoco::Snapshot;

/// What a policy may look at when it acts.
#[derive(Debug)]
pub struct View<'a> {
    /// Frame t of the rollout.
    pub frame: usize,
    /// The 30 + 1 + 20 window: all that a learned policy sees.
    pub window: &'a Window,
    /// The full simulator state, for policies that own a model of the robot. A learned
    /// policy must not read it.
    pub state: &'a Snapshot,
}

/// Turns a view into an action.
///
/// A policy is a function of the view, its seed and its own [`Policy::memory`], of nothing
/// else: only then can a rollout be resumed in the middle, bit for bit.
pub trait Policy: Send {
    /// The name that tables show.
    fn name(&self) -> String;

    /// Whether it uses a model of the robot (shown apart from those that only saw data).
    fn uses_model(&self) -> bool {
        false
    }

    /// What a learned policy knows of its own making: its model card, JSON.
    fn card(&self) -> Option<String> {
        None
    }

    /// Forgets everything; draws of this episode come from `seed`.
    fn reset(&mut self, seed: u64);

    /// Writes the action of this frame, in [-1, 1] per actuator; (A).
    ///
    /// # Errors
    /// Whatever keeps the policy from answering; the rollout stops there.
    fn act(&mut self, view: &View<'_>, action: &mut [f64]) -> Result<(), Error>;

    /// What was applied in the last frame instead of the action that [`Policy::act`] gave.
    fn applied(&mut self, _action: &[f64]) {}

    /// A copy that shares what is costly to build (the weights of a network), for the next
    /// rollout; `None` where building anew is as cheap.
    fn fork(&self) -> Option<Box<dyn Policy>> {
        None
    }

    /// What it carries from frame to frame (a warm start, an ensemble); empty for most.
    fn memory(&self) -> Vec<f64> {
        Vec::new()
    }

    /// Back to a memory taken earlier.
    fn recall(&mut self, _memory: &[f64]) {}
}
