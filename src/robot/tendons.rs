//! Tendons of a compiled model: their names and joints.

use robert_mujoco::{Kind, Model, index};

pub(super) fn tendon_name(model: &Model, t: usize) -> String {
    model.name(Kind::Tendon, t).map_or_else(|| format!("tendon_{t}"), str::to_owned)
}

/// Joints and coefficients of a fixed tendon; empty for spatial ones.
pub(super) fn tendon_joints(model: &Model, t: usize) -> Vec<(usize, f64)> {
    const WRAP_JOINT: i32 = 1; // mjWRAP_JOINT
    let (adr, num) = (index(model.tendon_adr()[t]), index(model.tendon_num()[t]));
    (adr..adr + num)
        .filter(|&w| model.wrap_type().get(w) == Some(&WRAP_JOINT))
        .filter_map(|w| {
            let joint = usize::try_from(*model.wrap_objid().get(w)?).ok()?;
            Some((joint, *model.wrap_prm().get(w)?))
        })
        .collect()
}
