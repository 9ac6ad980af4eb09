//! Adds what torque control needs and a foreign model lacks: motors with limits, our kinds of
//! joints.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::sync::Arc;

use roxmltree::Node;

use super::bearable::Bearable;
use super::config::{ImportConfig, Servos};
use super::draft::Draft;
use super::effort::Efforts;
use super::words::Servo;
use crate::derive::state_joints;
use crate::law::Law;
use crate::motors::{ctrlrange, is_motor};
use crate::text::{Edits, escape};
use crate::{Assets, Error, preparse, text};
use robert_mujoco::{Joint, Kind, Model, Transmission};

/// Removes joints that are free only because of a default class, if this was requested; an error
/// for joints that the state cannot represent. Returns whether any was removed.
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

/// An actuator to write: a motor, or a servo with its law.
struct Motor {
    name: String,
    /// Whether the name is that of what it pulls at.
    is_nameless: bool,
    attribute: &'static str,
    target: String,
    gear: f64,
    /// Control range.
    limit: [f64; 2],
    servo: Option<Law>,
    /// Force range of a servo.
    force: Option<[f64; 2]>,
}

impl Motor {
    fn write(&self, out: &mut String) {
        let (name, target) = (escape(&self.name), escape(&self.target));
        let ([lo, hi], gear) = (self.limit, self.gear);
        let common = format!(
            "name=\"{name}\" {}=\"{target}\" gear=\"{gear}\" ctrllimited=\"true\" ctrlrange=\"{lo} {hi}\"",
            self.attribute
        );
        let force = match self.force {
            Some([lo, hi]) => format!("forcelimited=\"true\" forcerange=\"{lo} {hi}\""),
            None => "forcelimited=\"false\"".to_owned(),
        };
        match self.servo {
            None => write!(out, "<motor {common} {force}/>").ok(),
            Some(Law { gain, bias: [a, b, c] }) => write!(
                out,
                "<general {common} {force} dyntype=\"none\" gaintype=\"fixed\" gainprm=\"{gain}\" biastype=\"affine\" biasprm=\"{a} {b} {c}\"/>"
            )
            .ok(),
        };
    }
}

/// Makes every actuator a motor or servo with limits; adds motors if there are none.
pub(super) fn actuators(
    draft: &mut Draft,
    model: &Arc<Model>,
    config: &ImportConfig,
) -> Result<(), Error> {
    let keep = config.servos == Servos::Keep;
    let good = |a: usize| {
        let law = Law::of(model, a).filter(|l| l.is_motor() || keep);
        law.is_some() && ctrlrange(model, a).is_some()
    };
    let told = draft.words.servos.iter().any(|w| *w != Servo::default());
    let changes = if keep {
        let laws: Vec<_> = (0..model.nu()).map(|a| servo_law(draft, model, a)).collect();
        let force = |a: usize| {
            let gear = model.actuator_gear()[6 * a];
            let range = force_range(draft, model, a, gear);
            range.map_or(f64::INFINITY, |[lo, hi]| gear.abs() * lo.abs().max(hi.abs()))
        };
        Bearable::of(&laws, &(0..model.nu()).map(force).collect::<Vec<_>>(), model)?
    } else {
        Bearable::default()
    };
    let endless = if keep { endless_slides(draft, model) } else { BTreeSet::new() };
    let as_it_is = !told
        && changes.is_empty()
        && endless.is_empty()
        && draft.words.torque.is_empty()
        && draft.effortless.is_empty()
        && (0..model.nu()).all(good);
    if model.nu() > 0 && as_it_is {
        return Ok(());
    }
    let efforts = Efforts::of(model, config)?;
    let mut motors = Vec::new();
    if model.nu() == 0 {
        for j in 0..model.jnt_type().len() {
            let Some(name) = model.name(Kind::Joint, j) else { continue };
            if follows(model, j) || draft.split.contains(name) {
                continue;
            }
            motors.push(Motor {
                name: name.to_owned(),
                is_nameless: true,
                attribute: "joint",
                target: name.to_owned(),
                gear: 1.0,
                limit: [-efforts.joint(j), efforts.joint(j)],
                servo: None,
                force: None,
            });
        }
        let limits = || motors.iter().map(|m| m.limit[1]);
        let (lo, hi) = (limits().fold(f64::INFINITY, f64::min), limits().fold(0.0, f64::max));
        draft.assumed.push(format!(
            "the source has no actuators: {} motors of {}",
            motors.len(),
            efforts.words(lo, hi)
        ));
    } else {
        for a in 0..model.nu() {
            if let Some(m) = motor(draft, model, a, config, &efforts, changes.moved.contains(&a)) {
                motors.push(m);
            }
        }
    }
    if motors.is_empty() {
        let message = "no joint can be driven: all actuators pull at sites or bodies; add <motor joint=\"…\"/> for each joint, or remove <actuator> so that the import makes motors".to_owned();
        return Err(Error::Unfit { message, path: config.source.clone() });
    }
    let (damping, armature) = changed_joints(draft, model, &changes);
    let texts = |values: BTreeMap<String, f64>| -> BTreeMap<String, String> {
        values.into_iter().map(|(name, value)| (name, value.to_string())).collect()
    };
    let ranges = slide_ranges(draft, &endless, &motors);
    let limited = ranges.keys().map(|name| (name.clone(), "true".to_owned())).collect();
    let attributes = [
        ("damping", texts(damping)),
        ("armature", texts(armature)),
        ("limited", limited),
        ("range", ranges),
    ];
    number_alike(draft, model, &mut motors);
    let mut xml = without_actuators(draft, config)?;
    for (attribute, values) in attributes {
        xml = text::with_joints(&xml, attribute, &values).map_err(|e| {
            let joint = match e {
                text::JointsError::NoJoint(name) => name,
                text::JointsError::Xml(e) => e.to_string(),
            };
            let message = format!(
                "the servo of joint \"{joint}\" needs another {attribute} of the joint, but no <joint> of this name is written; write it out, or import with --actuators torque"
            );
            Error::Unfit { message, path: config.source.clone() }
        })?;
    }
    draft.xml = xml;
    let mut section = String::from("<actuator>");
    motors.iter().for_each(|m| m.write(&mut section));
    section.push_str("</actuator>");
    draft.append(&section, &config.source)
}

/// Gives actuators names of their own: a nameless one got that of what it pulls at, which another one may have, too.
fn number_alike(draft: &mut Draft, model: &Model, motors: &mut [Motor]) {
    let written: BTreeSet<&str> =
        (0..model.nu()).filter_map(|a| model.name(Kind::Actuator, a)).collect();
    let mut taken = BTreeSet::new();
    for motor in motors {
        if taken.insert(motor.name.clone())
            && (!motor.is_nameless || !written.contains(&*motor.name))
        {
            continue;
        }
        let free = |name: &String| !taken.contains(name) && !written.contains(name.as_str());
        let names = (2..).map(|n| format!("{}_{n}", motor.name));
        let Some(name) = names.into_iter().find(free) else { continue };
        draft
            .changed
            .push(format!("a nameless actuator of \"{}\" is called \"{name}\"", motor.target));
        taken.insert(name.clone());
        motor.name = name;
    }
}

/// The slides without stops that position servos drive, by name.
fn endless_slides(draft: &Draft, model: &Model) -> BTreeSet<String> {
    let slide = |a: usize| {
        let Some(Transmission::Joint(j)) = model.transmission(a) else { return None };
        let endless = model.joint_type(j) == Some(Joint::Slide) && model.jnt_limited()[j] == 0;
        let servo = servo_law(draft, model, a).is_some_and(|law| law.is_position());
        let pulls = model.actuator_gear()[6 * a] != 0.0;
        model.name(Kind::Joint, j).filter(|_| endless && servo && pulls)
    };
    (0..model.nu()).filter_map(slide).map(str::to_owned).collect()
}

/// The ranges of these slides: as far as their servos go. The place of a slide with a range is seen
/// by policies, which a servo needs; without one, only its motion is.
fn slide_ranges(
    draft: &mut Draft,
    endless: &BTreeSet<String>,
    motors: &[Motor],
) -> BTreeMap<String, String> {
    let of = |m: &&Motor| m.attribute == "joint" && endless.contains(&m.target);
    let range = |m: &Motor| ordered(m.limit.map(|v| v / m.gear));
    let ranges: BTreeMap<_, _> = motors.iter().filter(of).map(|m| (&m.target, range(m))).collect();
    for (name, [lo, hi]) in &ranges {
        draft
            .changed
            .push(format!("slide \"{name}\" ends where its servo does: {lo:.4} to {hi:.4}"));
    }
    ranges.into_iter().map(|(name, [lo, hi])| (name.clone(), format!("{lo} {hi}"))).collect()
}

/// Whether an equality moves the joint, or holds it where it is.
fn follows(model: &Model, joint: usize) -> bool {
    crate::ties::ties(model).iter().any(|tie| tie.follower == joint)
        || crate::ties::held(model).contains(&joint)
}

/// The motor in place of an actuator; `undamped` if its damping is that of its joint now.
fn motor(
    draft: &mut Draft,
    model: &Model,
    a: usize,
    config: &ImportConfig,
    efforts: &Efforts,
    undamped: bool,
) -> Option<Motor> {
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
    let is_nameless = called.is_none();
    let gear = model.actuator_gear()[6 * a];
    let gain = model.actuator_gainprm()[10 * a];
    if is_damper(model, a) {
        draft.dropped.push(format!("actuator \"{name}\": a damper only brakes"));
        return None;
    }
    let plain = |limit: [f64; 2]| {
        let (name, target) = (name.clone(), target.clone());
        Motor { name, is_nameless, attribute, target, gear, limit, servo: None, force: None }
    };
    let force = force_range(draft, model, a, gear);
    if let Some(law) = servo_law(draft, model, a)
        && config.servos == Servos::Keep
    {
        let limit = servo_range(draft, model, a, &law, &name);
        let mut law = law;
        if undamped {
            law.bias[2] = 0.0;
        }
        return Some(Motor { servo: Some(law), force, ..plain(limit) });
    }
    let effort = efforts.actuator(model, a);
    if draft.effortless.contains(&target) {
        let words = efforts.words(effort, effort);
        draft.assumed.push(format!("joint \"{target}\" gives no effort: a motor of {words}"));
        let limit = [-effort, effort];
        return Some(plain(limit));
    }
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
        (false, _, None) if let Some((what, [lo, hi])) = strength(model, a) => {
            draft.changed.push(format!("{what} \"{name}\" became a motor of {lo} to {hi}"));
            [lo, hi]
        }
        (motor, _, None) => {
            let words = efforts.words(effort, effort);
            let what = match model.actuator_gaintype()[a] {
                _ if motor => "motor without limits",
                MUSCLE => "muscle of unknown strength",
                _ => "servo without a force limit",
            };
            draft.assumed.push(format!("\"{name}\" ({what}) became a motor of {words}"));
            [-effort, effort]
        }
    };
    Some(plain(limit))
}

/// `mjGAIN_FIXED` and `mjGAIN_MUSCLE`.
const FIXED: i32 = 0;
const MUSCLE: i32 = 2;
/// `mjDYN_FILTER`.
const FILTER: i32 = 2;

/// Whether the force of an actuator is only its control times the speed of its joint.
fn is_damper(model: &Model, a: usize) -> bool {
    const AFFINE: i32 = 1; // mjGAIN_AFFINE
    const NONE: i32 = 0; // mjBIAS_NONE
    let gain = &model.actuator_gainprm()[10 * a..10 * a + 3];
    model.actuator_gaintype()[a] == AFFINE
        && model.actuator_biastype()[a] == NONE
        && gain[..2] == [0.0; 2]
        && gain[2] < 0.0
}

/// What an actuator with dynamics is, and the forces that it reaches: a filter, such as the pressure
/// of a cylinder, arrives at its control after a while. A muscle only pulls; the motor in its place
/// pushes as well, because antagonists would otherwise fight each other.
fn strength(model: &Model, a: usize) -> Option<(&'static str, [f64; 2])> {
    let gain = &model.actuator_gainprm()[10 * a..10 * (a + 1)];
    let bias = &model.actuator_biasprm()[10 * a..10 * a + 3];
    match (model.actuator_gaintype()[a], model.actuator_dyntype()[a]) {
        (FIXED, FILTER) if bias.iter().all(|b| *b == 0.0) => {
            let range = ctrlrange(model, a)?.map(|ctrl| ctrl * gain[0]);
            Some(("filtered actuator", ordered(range)))
        }
        // A negative peak force means that it is a multiple of the inertia that the muscle sees.
        (MUSCLE, _) if gain[2] > 0.0 => Some(("muscle, which only pulls,", [-gain[2], gain[2]])),
        _ => None,
    }
}

/// Limits of an actuator's force: its own, reduced to those of its joint.
fn force_range(draft: &Draft, model: &Model, a: usize, gear: f64) -> Option<[f64; 2]> {
    let own = (model.actuator_forcelimited()[a] != 0)
        .then(|| [model.actuator_forcerange()[2 * a], model.actuator_forcerange()[2 * a + 1]]);
    let joint = match model.transmission(a) {
        Some(Transmission::Joint(j)) if gear != 0.0 => {
            model.name(Kind::Joint, j).and_then(|n| draft.words.torque.get(n))
        }
        _ => None,
    };
    let joint = joint.map(|[lo, hi]| ordered([lo / gear, hi / gear]));
    match (own, joint) {
        (Some([a, b]), Some([lo, hi])) => Some([a.max(lo), b.min(hi)]),
        (own, joint) => own.or(joint),
    }
}

/// The law of a servo, including attributes of later versions; `None` for motors and for actuators
/// with dynamics.
fn servo_law(draft: &Draft, model: &Model, a: usize) -> Option<Law> {
    let mut law = Law::of(model, a).filter(|l| !l.is_motor())?;
    let words = draft.words.servos.get(a).copied().unwrap_or_default();
    let stiffness = -law.bias[1];
    if let Some(kv) = words.kv {
        law.bias[2] = -kv;
    } else if let Some(ratio) = words.dampratio
        && let Some(Transmission::Joint(j)) = model.transmission(a)
        && stiffness > 0.0
    {
        let gear = model.actuator_gear()[6 * a];
        let mass = model.dof_M0()[model.jnt_dofadr()[j] as usize] / (gear * gear);
        law.bias[2] = -2.0 * ratio * (stiffness * mass).sqrt();
    }
    Some(law)
}

/// The new damping and armature of joints by name, which are said.
fn changed_joints(
    draft: &mut Draft,
    model: &Model,
    changes: &Bearable,
) -> (BTreeMap<String, f64>, BTreeMap<String, f64>) {
    let name = |joint: usize| model.name(Kind::Joint, joint).map(str::to_owned);
    let named = |values: &BTreeMap<usize, f64>| -> BTreeMap<String, f64> {
        values.iter().filter_map(|(joint, value)| Some((name(*joint)?, *value))).collect()
    };
    let (damping, armature) = (named(&changes.damping), named(&changes.armature));
    if !damping.is_empty() {
        let names: Vec<&str> = damping.keys().map(String::as_str).collect();
        draft.changed.push(format!(
            "the damping of servos became that of their joints, where steps of 5 ms would not \
             bear it: {}",
            names.join(", ")
        ));
    }
    if !armature.is_empty() {
        let names: Vec<String> =
            armature.iter().map(|(name, value)| format!("{name} {value}")).collect();
        draft.changed.push(format!(
            "joints got more armature, where steps of 5 ms would not bear stiffness or damping of their \
             servos: {}",
            names.join(", ")
        ));
    }
    (damping, armature)
}

/// The control range of a servo: its own, else the range of its joint or tendon, else a guess.
fn servo_range(draft: &mut Draft, model: &Model, a: usize, law: &Law, name: &str) -> [f64; 2] {
    /// The range of a velocity servo, and of a joint without limits, if the source gives none.
    const SPEED: f64 = 2.0;
    const ROOM: f64 = std::f64::consts::PI;
    let inherits = draft.words.servos.get(a).and_then(|w| w.inherits);
    if let Some(range) = ctrlrange(model, a).filter(|_| inherits.is_none()) {
        return range;
    }
    if !law.is_position() {
        draft.assumed.push(format!("velocity servo \"{name}\" has no limits: +-{SPEED}"));
        return [-SPEED, SPEED];
    }
    let gear = model.actuator_gear()[6 * a];
    // `inheritrange` is a share of the range, about its middle.
    let share = |[lo, hi]: [f64; 2]| {
        let (middle, half) = (0.5 * (lo + hi), 0.5 * (hi - lo) * inherits.unwrap_or(1.0));
        ordered([gear * (middle - half), gear * (middle + half)])
    };
    match model.transmission(a) {
        Some(Transmission::Joint(j)) if model.jnt_limited()[j] != 0 => {
            share([model.jnt_range()[2 * j], model.jnt_range()[2 * j + 1]])
        }
        Some(Transmission::Tendon(t)) if model.tendon_limited()[t] != 0 => {
            share([model.tendon_range()[2 * t], model.tendon_range()[2 * t + 1]])
        }
        _ => {
            draft.assumed.push(format!("position servo \"{name}\" has no limits: +-{ROOM:.4}"));
            [-ROOM, ROOM]
        }
    }
}

fn ordered([a, b]: [f64; 2]) -> [f64; 2] {
    [a.min(b), a.max(b)]
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
    let Ok(bare) = crate::compile(&bare, assets) else { return false };
    bare.nq() == full.nq()
        && bare.nu() == full.nu()
        && bare.body_mass() == full.body_mass()
        && bare.body_inertia() == full.body_inertia()
        && bare.body_ipos() == full.body_ipos()
        && bare.body_pos() == full.body_pos()
        && bare.ngeom() < full.ngeom()
}
