//! What a foreign model lacks for torque control: motors with limits, our kind of joints.

use std::fmt::Write as _;

use roxmltree::Node;

use super::config::ImportConfig;
use super::draft::Draft;
use crate::mujoco::{Joint, Kind, Model, Transmission};
use crate::robot::derive::{ctrlrange, is_motor, state_joints};
use crate::robot::text::{Edits, escape};
use crate::robot::{Assets, Error, preparse, text};

/// Takes away joints that only a default class makes free, if asked to; refuses what the
/// state cannot hold. Gives whether anything was taken.
pub(super) fn joints(
    draft: &mut Draft,
    model: &Model,
    project: &preparse::Project,
    config: &ImportConfig,
) -> Result<bool, Error> {
    let free: Vec<&str> = (0..model.jnt_type().len())
        .filter(|j| model.joint_type(*j) == Some(Joint::Free))
        .filter_map(|j| model.name(Kind::Joint, j))
        .collect();
    if free.is_empty() || !config.fixed_base {
        state_joints(model, &project.path)?;
        return Ok(false);
    }
    let doc = preparse::parse(&draft.xml, &project.path)?;
    let mut edits = Edits::default();
    for node in doc.descendants().filter(Node::is_element) {
        let named = node.attribute("name").is_some_and(|n| free.contains(&n));
        let in_body = node.parent().is_some_and(|p| p.has_tag_name("body"));
        if node.has_tag_name("keyframe") || (node.has_tag_name("joint") && named && in_body) {
            edits.replace(node.range(), "");
        }
    }
    let xml = edits.apply(&draft.xml);
    draft.xml = xml;
    draft.changed.push(format!("joints no longer float, held where they are: {}", free.join(", ")));
    Ok(true)
}

/// A motor to write.
struct Motor {
    name: String,
    attribute: &'static str,
    target: String,
    gear: f64,
    limit: [f64; 2],
}

/// Makes every actuator a motor with limits; makes motors where there are none.
pub(super) fn actuators(
    draft: &mut Draft,
    model: &Model,
    config: &ImportConfig,
) -> Result<(), Error> {
    let good = |a: usize| is_motor(model, a) && ctrlrange(model, a).is_some();
    let all_good = (0..model.nu()).all(good);
    if model.nu() > 0 && (all_good || config.keep_servos) {
        return Ok(());
    }
    let mut motors = Vec::new();
    if model.nu() == 0 {
        for j in 0..model.jnt_type().len() {
            let Some(name) = model.name(Kind::Joint, j) else { continue };
            if follows(model, j) {
                continue;
            }
            motors.push(Motor {
                name: name.to_owned(),
                attribute: "joint",
                target: name.to_owned(),
                gear: 1.0,
                limit: [-config.effort, config.effort],
            });
        }
        draft.assumed.push(format!(
            "the source has no actuators: {} motors of +-{} (change with --effort)",
            motors.len(),
            config.effort
        ));
    } else {
        for a in 0..model.nu() {
            if let Some(m) = motor(draft, model, a, config) {
                motors.push(m);
            }
        }
    }
    if motors.is_empty() {
        let message = "no joint can be driven: all actuators pull at sites or bodies".to_owned();
        return Err(Error::Unfit { message, path: config.source.clone() });
    }
    let xml = without_actuators(draft, config)?;
    draft.xml = xml;
    let mut section = String::from("<actuator>");
    for m in &motors {
        write!(
            section,
            "<motor name=\"{}\" {}=\"{}\" gear=\"{}\" ctrllimited=\"true\" ctrlrange=\"{} {}\" forcelimited=\"false\"/>",
            escape(&m.name),
            m.attribute,
            escape(&m.target),
            m.gear,
            m.limit[0],
            m.limit[1]
        )
        .ok();
    }
    section.push_str("</actuator>");
    draft.append(&section, &config.source)
}

/// Whether an equality ties the joint to another one.
fn follows(model: &Model, joint: usize) -> bool {
    const EQ_JOINT: i32 = 2; // mjEQ_JOINT
    (0..model.neq()).any(|e| {
        model.eq_type().get(e) == Some(&EQ_JOINT)
            && model.eq_obj1id().get(e).and_then(|v| usize::try_from(*v).ok()) == Some(joint)
    })
}

/// The motor in place of an actuator.
fn motor(draft: &mut Draft, model: &Model, a: usize, config: &ImportConfig) -> Option<Motor> {
    let called = model.name(Kind::Actuator, a);
    let (attribute, target) = match model.transmission(a) {
        Some(Transmission::Joint(j)) => ("joint", model.name(Kind::Joint, j)?.to_owned()),
        Some(Transmission::Tendon(t)) => {
            let Some(name) = model.name(Kind::Tendon, t) else {
                draft.dropped.push(format!("actuator {a}: its tendon has no name"));
                return None;
            };
            ("tendon", name.to_owned())
        }
        _ => {
            let name =
                called.map_or_else(|| format!("actuator {a}"), |n| format!("actuator \"{n}\""));
            draft.dropped.push(format!("{name}: it pulls at a site or body, not at a joint"));
            return None;
        }
    };
    let name = called.unwrap_or(&target).to_owned();
    let gear = model.actuator_gear().get(6 * a).copied().unwrap_or(1.0);
    let gain = model.actuator_gainprm().get(10 * a).copied().unwrap_or(1.0);
    let forced = model.actuator_forcelimited().get(a).is_some_and(|l| *l != 0);
    let force: Option<[f64; 2]> = model
        .actuator_forcerange()
        .get(2 * a..2 * a + 2)
        .filter(|_| forced)
        .and_then(|r| r.try_into().ok());
    let limit = match (is_motor(model, a), ctrlrange(model, a), force) {
        (true, Some([lo, hi]), None) => [lo * gain, hi * gain],
        (true, Some([lo, hi]), Some([f_lo, f_hi])) => {
            [(lo * gain).max(f_lo), (hi * gain).min(f_hi)]
        }
        (true, None, Some(f)) => f,
        (false, _, Some(f)) => {
            draft.changed.push(format!("servo \"{name}\" became a motor of {} to {}", f[0], f[1]));
            f
        }
        (motor, _, None) => {
            let e = config.effort;
            let what = if motor { "motor without limits" } else { "servo without a force limit" };
            draft.assumed.push(format!(
                "\"{name}\" ({what}) became a motor of +-{e} (change with --effort)"
            ));
            [-e, e]
        }
    };
    Some(Motor { name, attribute, target, gear, limit })
}

/// The model without its actuators, and without the controls in its keyframes.
fn without_actuators(draft: &mut Draft, config: &ImportConfig) -> Result<String, Error> {
    let doc = preparse::parse(&draft.xml, &config.source)?;
    let mut edits = Edits::default();
    for section in doc.root_element().children().filter(Node::is_element) {
        if section.has_tag_name("actuator") {
            edits.replace(section.range(), "");
        }
        if section.has_tag_name("keyframe") {
            for key in section.children().filter(Node::is_element) {
                edits.unset(key, "ctrl");
                edits.unset(key, "act");
            }
        }
    }
    Ok(edits.apply(&draft.xml))
}

/// Whether the model weighs the same without its visual geoms, body by body, bit by bit.
pub(super) fn weightless_visuals(xml: &str, assets: &Assets, full: &Model) -> bool {
    let Ok(bare) = text::discard_visual(xml) else { return false };
    let Ok(bare) = crate::robot::compile(&bare, assets) else { return false };
    bare.nq() == full.nq()
        && bare.nu() == full.nu()
        && bare.body_mass() == full.body_mass()
        && bare.body_inertia() == full.body_inertia()
        && bare.body_ipos() == full.body_ipos()
        && bare.body_pos() == full.body_pos()
        && bare.ngeom() < full.ngeom()
}
