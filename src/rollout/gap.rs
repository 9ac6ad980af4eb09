//! A run of frames in which joints have no goals.

/// One gap: these joints have goals at frames `from` and `to`, and none between. Frame 0, the start, counts as a goal.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Gap {
    pub(super) from: usize,
    pub(super) to: usize,
    pub(super) joints: Vec<usize>,
}
