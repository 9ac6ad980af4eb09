//! The interface of all policies.

use super::error::Error;
use super::window::Window;
use robert_mujoco::Snapshot;
use robert_net::forward::Forwards;

/// The inputs of a policy.
#[derive(Debug)]
pub struct View<'a> {
    /// Frame t of the rollout.
    pub frame: usize,
    /// The window of 30 + 1 + 20 frames; a learned policy sees nothing else.
    pub window: &'a Window,
    /// The full simulator state, for policies that own a model of the robot. A learned
    /// policy must not read it.
    pub state: &'a Snapshot,
}

/// Turns a view into an action.
///
/// A policy must be a function of the view, its seed and its own [`Policy::memory`] only, so that a
/// rollout can be resumed at any frame, bit for bit.
pub trait Policy: Send {
    /// The name that tables show.
    fn name(&self) -> String;

    /// Whether it uses a model of the robot; tables mark such policies.
    fn uses_model(&self) -> bool {
        false
    }

    /// Whether it sees the planned motion through gaps, [`Window::way`], beside the goals.
    fn sees_plan(&self) -> bool {
        false
    }

    /// The model card of a learned policy, JSON.
    fn card(&self) -> Option<String> {
        None
    }

    /// Clears all memory; random choices of this episode depend on `seed`.
    fn reset(&mut self, seed: u64);

    /// Writes the action of this frame, in [-1, 1] per actuator; (A).
    ///
    /// # Errors
    /// Any error of the policy; the rollout stops there.
    fn act(&mut self, view: &View<'_>, action: &mut [f64]) -> Result<(), Error>;

    /// Tells the policy which action was applied in the last frame, if it was not the result of
    /// [`Policy::act`].
    fn applied(&mut self, _action: &[f64]) {}

    /// A copy for the next rollout that shares expensive parts (the weights of a network); `None`
    /// if building a new policy is as cheap.
    fn fork(&self) -> Option<Box<dyn Policy>> {
        None
    }

    /// Lets a device compute its network, if it has one.
    fn on(&mut self, _device: &dyn Forwards) {}

    /// The state that the policy keeps from frame to frame (a warm start, an ensemble); empty for
    /// most policies.
    fn memory(&self) -> Vec<f64> {
        Vec::new()
    }

    /// Restores an earlier memory.
    fn recall(&mut self, _memory: &[f64]) {}
}
