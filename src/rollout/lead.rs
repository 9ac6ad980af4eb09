//! What leads a policy besides its goals: corrections of the goals, and gaps in which it sees the planned motion.

use super::gap::Gap;

/// What leads a policy besides its goals.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Lead {
    /// By how much each goal that the policy sees is moved, rad or m; (frames, S).
    pub(super) shift: Vec<f64>,
    /// Gaps that the policy sees filled with the planned motion, whatever its guide. The correction of their frames
    /// counts, too.
    pub(super) shown: Vec<Gap>,
}

impl Lead {
    /// Nothing but the goals themselves: `values` is frames times S.
    pub(super) fn none(values: usize) -> Lead {
        Lead::of(vec![0.0; values])
    }

    /// These corrections of goals; (frames, S).
    pub(super) fn of(shift: Vec<f64>) -> Lead {
        Lead { shift, shown: Vec::new() }
    }
}
