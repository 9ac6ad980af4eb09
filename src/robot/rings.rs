//! The joints on closed loops: those between two bodies that a `<connect>` or `<weld>` ties.

use robert_mujoco::{Model, index};

/// `mjEQ_CONNECT`.
pub(super) const CONNECT: i32 = 0;
/// `mjEQ_WELD`.
pub(super) const WELD: i32 = 1;

/// The joints of each closed loop of a model.
pub(super) fn rings(model: &Model) -> Vec<Vec<usize>> {
    let ties =
        |e: &usize| matches!(model.eq_type()[*e], CONNECT | WELD) && model.eq_active()[*e] != 0;
    let ring = |e: usize| {
        let [a, b] = [model.eq_obj1id()[e], model.eq_obj2id()[e]].map(|id| above(model, index(id)));
        let lone = a.iter().filter(|j| !b.contains(j)).chain(b.iter().filter(|j| !a.contains(j)));
        lone.copied().collect::<Vec<_>>()
    };
    (0..model.neq()).filter(ties).map(ring).filter(|ring| !ring.is_empty()).collect()
}

/// The joints that move a body.
pub(super) fn above(model: &Model, mut body: usize) -> Vec<usize> {
    let mut joints = Vec::new();
    while body > 0 {
        let of = |j: &usize| index(model.jnt_bodyid()[*j]) == body;
        joints.extend((0..model.jnt_type().len()).filter(of));
        body = index(model.body_parentid()[body]);
    }
    joints
}
