//! Joints that an equality of the model ties to another.

use robert_mujoco::Model;

/// `mjEQ_JOINT`.
const EQ_JOINT: i32 = 2;

/// A joint that follows another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Tie {
    /// Joint number of the follower.
    pub(super) follower: usize,
    /// Joint number of the one that leads it.
    pub(super) leader: usize,
    /// The follower's distance from its zero, rad or m, by powers 0 to 4 of the leader's.
    pub(super) polynomial: [f64; 5],
}

/// The ties of a model that are active.
pub(super) fn ties(model: &Model) -> Vec<Tie> {
    let tie = |e: usize| {
        let [follower, leader] = [model.eq_obj1id()[e], model.eq_obj2id()[e]];
        let polynomial = model.eq_data()[11 * e..11 * e + 5].try_into().ok()?;
        // A joint that an equality holds where it is has no leader.
        let (follower, leader) = (follower.try_into().ok()?, leader.try_into().ok()?);
        Some(Tie { follower, leader, polynomial })
    };
    let is = |e: &usize| model.eq_type()[*e] == EQ_JOINT && model.eq_active()[*e] != 0;
    (0..model.neq()).filter(is).filter_map(tie).collect()
}
