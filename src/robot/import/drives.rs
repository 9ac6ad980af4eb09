//! Adds inertia and damping of a drive to joints whose file names none, or too little.
//!
//! Real arms are geared: the rotors of their motors have inertia, and the available torque falls
//! with speed until nothing is left. Many files contain neither, so their joints reach hundreds of
//! radians per second under full torque. No torque that is constant for a frame of 50 ms can
//! control such a joint: position feedback, a learned inverse and computed torque all fail (errors
//! of 0.3 to 18 rad on six public arms; 0.0015 to 0.0044 with the drive below and the linear
//! regression).
//!
//! Such joints therefore get inertia and damping in proportion to their torque limit. The damping
//! is the torque limit divided by the speed limit, which is the speed at which no torque is left. A
//! motor that needs most of its torque to carry its load, as that of a lift, would never come near
//! this speed, so there what is left beside the load is spent at the speed limit.

use std::collections::BTreeMap;

use roxmltree::Node;

use super::config::{Drives, ImportConfig};
use super::draft::Draft;
use super::plausible::loads;
use crate::derive::digits;
use crate::motors::{torque_limit, weaker_torque};
use crate::text::Edits;
use crate::{Error, preparse};
use robert_mujoco::{Joint, Kind, Model};

/// The speed under full torque, rad/s or m/s, above which a joint counts as undamped.
const FREE_SPEED: f64 = 20.0;
/// The acceleration under full torque, rad/s^2 or m/s^2, from which one frame moves the joint too
/// far (0.05 rad). A robot with such a joint is reported to lack its drives.
const TOO_FAST: f64 = 40.0;
/// The armature per unit of torque limit from which a file counts as describing a rotor, s^2.
const OWN_ROTOR: f64 = 0.001;
/// The reflected inertia of an added drive per unit of its torque limit, s^2.
const ROTOR: f64 = 0.003;
/// The speed limit of a drive whose source gives none: of a hinge, rad/s, and of a slide, m/s.
const SPEED: [f64; 2] = [2.0, 0.5];
/// A drive without a speed limit in its source needs at least this time to cross its range,
/// seconds.
pub(super) const CROSSING_SECS: f64 = 0.5;
/// A speed limit above this is considered a placeholder: of joints with stops and of slides, rad/s or
/// m/s, and of wheels, which are faster.
pub(super) const PLACEHOLDER: f64 = 40.0;
const PLACEHOLDER_OF_WHEEL: f64 = 1000.0;
/// The share of its torque limit from which a motor's load counts.
const LOADED: f64 = 0.5;
/// The share of its torque limit for which the damping is made at least, whatever the load is.
const LEAST_LEFT: f64 = 0.1;
/// The number of digits that are written.
const DIGITS: i32 = 4;

/// The drive of one joint.
struct Drive {
    armature: f64,
    damping: f64,
    /// Speed at which the torque is spent.
    speed: f64,
    /// The speed limit in the source, rad/s or m/s.
    allowed: Option<f64>,
    /// The speed in the source that is none.
    placeholder: Option<f64>,
    torque: f64,
    /// The part of the torque that carries the load, if it is most of it; else 0.
    load: f64,
    /// Under full torque, without the drive.
    acceleration: f64,
    /// What the file gives: armature and damping.
    file: [f64; 2],
}

/// Adds drives to joints without one in the file, and reports them; with `--drives file` they are
/// only reported. Returns whether the draft has changed.
pub(super) fn model(
    draft: &mut Draft,
    model: &Model,
    config: &ImportConfig,
) -> Result<bool, Error> {
    let mut found: BTreeMap<String, Drive> = BTreeMap::new();
    for (id, load) in loads(model)?.iter().enumerate() {
        let Some(name) = model.name(Kind::Joint, id) else { continue };
        if let Some(drive) =
            missing(model, id, draft, load.usual_weight(), draft.speeds.get(name).copied())
        {
            found.insert(name.to_owned(), drive);
        }
    }
    if !found.values().any(|d| d.acceleration > TOO_FAST) {
        return Ok(false);
    }
    let names = list(found.keys().map(String::as_str));
    if config.drives == Drives::File {
        draft.warnings.push(format!(
            "{names} run faster than {FREE_SPEED} rad/s (or m/s) under full torque, which no torque that \
             is held for 50 ms may control; without --drives file they get the drive that the file \
             leaves out"
        ));
        return Ok(false);
    }
    let doc = preparse::parse(&draft.xml, &config.source)?;
    let mut edits = Edits::default();
    for node in doc.descendants().filter(|n| n.has_tag_name("joint")) {
        let in_body = |n: &Node<'_, '_>| n.parent().is_some_and(|p| p.has_tag_name("body"));
        let named = node.attribute("name").filter(|_| in_body(&node));
        let Some(drive) = named.and_then(|n| found.get(n)) else { continue };
        edits.set(node, "armature", &drive.armature.to_string());
        edits.set(node, "damping", &drive.damping.to_string());
    }
    let xml = edits.apply(&draft.xml);
    drop(doc);
    draft.xml = xml;
    say(draft, &found);
    Ok(true)
}

/// The drive that a joint lacks; `None` if the file describes one, or no torque limit is known.
fn missing(
    model: &Model,
    id: usize,
    draft: &Draft,
    weight: f64,
    named: Option<f64>,
) -> Option<Drive> {
    let torque = torque_limit(model, id).filter(|t| *t > 0.0)?;
    let dof = usize::try_from(model.jnt_dofadr()[id]).ok()?;
    let (armature, damping) = (model.dof_armature()[dof], model.dof_damping()[dof]);
    let rotor = armature >= OWN_ROTOR * torque && !draft.rotors_assumed;
    if damping * FREE_SPEED >= torque || rotor {
        return None;
    }
    let slides = model.joint_type(id) == Some(Joint::Slide);
    let limited = model.jnt_limited()[id] != 0;
    let fastest = if limited || slides { PLACEHOLDER } else { PLACEHOLDER_OF_WHEEL };
    let placeholder = named.filter(|v| *v > fastest);
    let named = named.filter(|_| placeholder.is_none());
    let guess = if limited {
        let range = model.jnt_range()[2 * id + 1] - model.jnt_range()[2 * id];
        SPEED[usize::from(slides)].min(range / CROSSING_SECS)
    } else {
        SPEED[usize::from(slides)]
    };
    let speed = named.unwrap_or(guess);
    // A drive for the stronger direction would leave the joint hardly any speed in the other one.
    let weaker = weaker_torque(model, id).unwrap_or(torque);
    let carries_most = named.is_some() && weight > LOADED * weaker && weight < weaker;
    let load = if carries_most { weight } else { 0.0 };
    let left = (weaker - load).max(LEAST_LEFT * weaker);
    let damping_of_drive = digits(damping.max(left / speed).max(torque / FREE_SPEED), DIGITS);
    Some(Drive {
        armature: digits(armature.max(ROTOR * weaker), DIGITS),
        damping: damping_of_drive,
        speed: (weaker - load) / damping_of_drive,
        allowed: named,
        placeholder,
        torque: weaker,
        load,
        acceleration: torque / model.dof_M0()[dof].max(1e-12),
        file: [if draft.rotors_assumed { 0.0 } else { armature }, damping],
    })
}

fn say(draft: &mut Draft, found: &BTreeMap<String, Drive>) {
    let line = |(name, d): (&String, &Drive)| {
        let from = match d.placeholder {
            Some(speed) => format!("assumed, because {speed} in the file is a placeholder"),
            None => match d.allowed {
                Some(speed) if (speed / d.speed - 1.0).abs() < 0.01 => {
                    "as the file says".to_owned()
                }
                Some(speed) => format!("the file allows {speed}"),
                None => "assumed".to_owned(),
            },
        };
        let instead = |file: f64, now: f64| {
            let raised = file > 0.0 && file < now;
            if raised { format!(" instead of {}", digits(file, DIGITS)) } else { String::new() }
        };
        let [armature, damping] = [instead(d.file[0], d.armature), instead(d.file[1], d.damping)];
        let spent = match d.load {
            0.0 => d.torque.to_string(),
            load => {
                format!("{} of {}, beside its load,", digits(d.torque - load, DIGITS), d.torque)
            }
        };
        format!(
            "{name}: armature {}{armature}, damping {}{damping} ({spent} spent at {:.3}, {from})",
            d.armature, d.damping, d.speed
        )
    };
    draft.assumed.push(format!(
        "the drive of {} joints, of which the file says nothing or too little for torque at 20 Hz to \
         hold them (--drives file takes the file at its word): {}",
        found.len(),
        found.iter().map(line).collect::<Vec<_>>().join("; ")
    ));
}

fn list<'a>(names: impl Iterator<Item = &'a str>) -> String {
    names.map(|n| format!("\"{n}\"")).collect::<Vec<_>>().join(", ")
}
