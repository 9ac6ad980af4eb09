//! Warns of angles whose figures look like the other unit. MJCF has degrees unless it says
//! otherwise, but never in control ranges; URDF always has radians.

use super::draft::Draft;
use crate::law::Law;
use crate::motors::ctrlrange;
use crate::preparse::Format;
use robert_mujoco::{Joint, Kind, Model, Transmission};

/// A hinge with less room moves too little to be of use, rad.
const NARROW: f64 = 0.1;
/// Beyond two turns, rad.
const WIDE: f64 = 12.6;
/// Joints that a warning names.
const NAMED: usize = 4;

/// Adds the warnings.
pub(super) fn check(draft: &mut Draft, model: &Model, format: Format) {
    let hinges: Vec<(usize, &str, [f64; 2])> = (0..model.jnt_type().len())
        .filter(|j| model.joint_type(*j) == Some(Joint::Hinge) && model.jnt_limited()[*j] != 0)
        .map(|j| {
            let range = [model.jnt_range()[2 * j], model.jnt_range()[2 * j + 1]];
            (j, model.name(Kind::Joint, j).unwrap_or_default(), range)
        })
        .collect();
    let said = |(_, name, [lo, hi]): &(usize, &str, [f64; 2])| {
        format!("\"{name}\" {lo:.4} to {hi:.4} rad")
    };
    let list = |of: &[&(usize, &str, [f64; 2])]| {
        let words: Vec<String> = of.iter().take(NAMED).map(|h| said(h)).collect();
        words.join(", ") + if of.len() > NAMED { ", …" } else { "" }
    };
    let narrow: Vec<_> = hinges.iter().filter(|(_, _, [lo, hi])| hi - lo < NARROW).collect();
    if !narrow.is_empty() && narrow.len() == hinges.len() {
        draft.warnings.push(format!(
            "no hinge turns by more than {NARROW} rad: {}; {}",
            list(&narrow),
            match format {
                Format::Mjcf =>
                    "angles in MJCF are degrees unless the file has <compiler angle=\"radian\"/>",
                Format::Urdf => "is this the right unit?",
            }
        ));
    }
    let wide: Vec<_> =
        hinges.iter().filter(|(_, _, range)| range.iter().any(|x| x.abs() > WIDE)).collect();
    if !wide.is_empty() {
        draft
            .warnings
            .push(format!("hinges that turn more than twice: {}; are these degrees?", list(&wide)));
    }
    for a in 0..model.nu() {
        let Some(Transmission::Joint(j)) = model.transmission(a) else { continue };
        let Some((_, name, range)) = hinges.iter().find(|(hinge, ..)| *hinge == j) else {
            continue;
        };
        let Some(law) = Law::of(model, a).filter(Law::is_position) else { continue };
        let (Some(ctrl), gear) = (ctrlrange(model, a), model.actuator_gear()[6 * a]) else {
            continue;
        };
        let ends = ctrl.map(|x| (law.gain * x + law.bias[0]) / (-law.bias[1] * gear));
        let most = |of: [f64; 2]| of.into_iter().map(f64::abs).fold(0.0, f64::max);
        if most(ends) > WIDE && most(ends) > 2.0 * most(*range) {
            draft.warnings.push(format!(
                "the servo of \"{name}\" takes targets from {:.4} to {:.4} rad: control ranges are in radians, whatever the unit of the joints; are these degrees?",
                ends[0].min(ends[1]),
                ends[0].max(ends[1])
            ));
        }
    }
}
