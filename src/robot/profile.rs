//! Knowledge about a robot beyond its MJCF: names, groups, poses, mirror, speed.
//!
//! A profile is a TOML file beside the model. Every field may be left out: it is derived from the
//! model if possible ([`super::derive`]), and has a simple default otherwise. A written value that
//! contradicts the model is an error and is never overruled silently.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};
use toml::Spanned;

use super::error::{Error, line_column};
use robert_base::limits;
use robert_base::units::Unit;

/// Value of `format` in a profile.
pub const FORMAT: &str = "robert-robot/1";
/// Name of the profile in a robot's folder.
pub const PROFILE_FILE: &str = "profile.toml";
/// Name of the model in a robot's folder, unless the profile names another.
pub const MODEL_FILE: &str = "robot.xml";
/// Distance to a joint's limit that counts as near, rad or m.
pub const NEAR_LIMIT: f64 = 0.1;

/// One coordinate of the state: a hinge or slide joint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointSpec {
    /// Name, as in the model.
    pub name: String,
    /// Radians or metres.
    pub unit: Unit,
    /// Limits; absent for a joint without limits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub range: Option<[f64; 2]>,
    /// Greatest sustained speed that exploration and trial clips ask for, rad/s or m/s.
    pub speed_limit: f64,
    /// Greatest speed that the motors give, rad/s or m/s, if it is above the speed limit. Clips may ask
    /// for it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub top_speed: Option<f64>,
    /// Mean acceleration from rest to nearly this speed at full torque, rad/s² or m/s²; absent if
    /// it was not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub acceleration_limit: Option<f64>,
}

/// The target of an actuator, by name.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Drive {
    /// A joint.
    Joint(String),
    /// A tendon: the coupled joints of that name.
    Tendon(String),
    /// Something else (a site, a body) that only the simulator knows.
    Other(String),
}

/// One coordinate of the action: a motor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuatorSpec {
    /// Name, as in the model.
    pub name: String,
    /// The joint or tendon that it pulls.
    pub drive: Drive,
    /// Control range, N m or N: an action of -1..1 is scaled to it.
    pub ctrlrange: [f64; 2],
}

/// A group of joints: a finger, a limb, all knuckles.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct Group {
    /// Short name.
    pub name: String,
    /// Name for people.
    #[serde(default)]
    pub title: String,
    /// Members in state order.
    pub joints: Vec<String>,
}

/// Joints that do not move freely against each other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum Coupling {
    /// One cord pulls several joints: they share a force, and their differences are free.
    Tendon {
        /// Name of the tendon.
        name: String,
        /// Members.
        joints: Vec<String>,
        /// Length is the sum of coefficient times coordinate.
        coefs: Vec<f64>,
        /// Limits of the length, if any.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        range: Option<[f64; 2]>,
    },
    /// One joint follows another: `follower = offset + multiplier * leader`.
    Mimic {
        /// The joint that follows; it has no motor.
        follower: String,
        /// The joint that leads.
        leader: String,
        /// Offset, rad or m.
        offset: f64,
        /// Factor.
        multiplier: f64,
    },
}

/// One row of a mirror table: `target = offset + sign * source`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MirrorRow {
    /// The joint that receives the value.
    pub target: String,
    /// The joint whose value is mirrored.
    pub source: String,
    /// 1 or -1.
    pub sign: f64,
    /// Offset, rad or m.
    #[serde(default)]
    pub offset: f64,
}

/// The rule that mirrors a pose, or the reason why there is none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MirrorSpec {
    /// The table; joints without a row keep their value.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub table: Vec<MirrorRow>,
    /// Why there is no table.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub none: String,
}

/// The default view, as in `MuJoCo`'s free camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct Camera {
    /// The point at the centre of the view, m.
    pub lookat: [f64; 3],
    /// Distance from it, m.
    pub distance: f64,
    /// Direction of view about z from +x, rad.
    pub azimuth_rad: f64,
    /// Direction of view against the horizon, rad; negative looks down.
    pub elevation_rad: f64,
    /// Vertical field of view, rad.
    pub fovy_rad: f64,
}

/// Gains and duration of the drive that settles a pose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SettleSpec {
    /// Stiffness by joint, N m/rad or N/m.
    pub kp: Vec<f64>,
    /// Damping by joint that is added to the joint's own, N m s/rad or N s/m.
    pub kd: Vec<f64>,
    /// Control steps to drive.
    pub frames: u32,
    /// Residual of a joint above which a pose counts as not reached, rad or m.
    pub tolerance: f64,
}

/// Changes to the model that belong to this profile.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Physics {
    /// Simulate without the geoms that do not collide. They must have no mass.
    #[serde(default)]
    pub discard_visual: bool,
    /// Joint damping that replaces the model's, N m s/rad or N s/m.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub damping: BTreeMap<String, f64>,
}

/// A pose: values of the joints that it names. The others have the value of the home pose, or else
/// zero (or the nearest allowed value).
pub type PoseSpec = BTreeMap<String, f64>;

/// A complete profile; see the module.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Profile {
    /// Always [`FORMAT`].
    pub format: String,
    /// Identifier, as on the command line and in clips.
    pub id: String,
    /// Name for people.
    pub title: String,
    /// A sentence or two.
    pub about: String,
    /// Source and licence of figures and meshes.
    pub licence: String,
    /// The model: a file of the folder, or `builtin:ID`.
    pub model: String,
    /// Name of the home pose.
    pub home: String,
    /// Distance to a limit that counts as near, rad or m.
    pub near_limit: f64,
    /// Changes to the model.
    pub physics: Physics,
    /// The state, in order.
    pub joints: Vec<JointSpec>,
    /// The action, in order.
    pub actuators: Vec<ActuatorSpec>,
    /// Fingers, limbs and the like.
    pub groups: Vec<Group>,
    /// Tendons and mimics.
    pub couplings: Vec<Coupling>,
    /// The mirror table.
    pub mirror: MirrorSpec,
    /// Sites that inverse kinematics can move.
    pub ik_sites: Vec<String>,
    /// The default view.
    pub camera: Camera,
    /// The settling drive.
    pub settle: SettleSpec,
    /// Named poses.
    pub poses: BTreeMap<String, PoseSpec>,
}

/// A profile as written: anything may be missing.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Written {
    pub(super) format: Option<Spanned<String>>,
    pub(super) id: Option<Spanned<String>>,
    pub(super) title: Option<String>,
    pub(super) about: Option<String>,
    pub(super) licence: Option<String>,
    pub(super) model: Option<String>,
    pub(super) home: Option<String>,
    pub(super) near_limit: Option<f64>,
    pub(super) physics: Physics,
    pub(super) joints: Option<Vec<WrittenJoint>>,
    pub(super) actuators: Option<Vec<ActuatorSpec>>,
    pub(super) groups: Option<Vec<Group>>,
    pub(super) couplings: Option<Vec<Coupling>>,
    pub(super) mirror: Option<MirrorSpec>,
    pub(super) ik_sites: Option<Vec<String>>,
    pub(super) camera: Option<Camera>,
    pub(super) settle: WrittenSettle,
    pub(super) poses: BTreeMap<String, PoseSpec>,
}

/// A joint as written: only the name is required.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct WrittenJoint {
    pub(super) name: String,
    pub(super) unit: Option<Unit>,
    pub(super) range: Option<[f64; 2]>,
    pub(super) speed_limit: Option<f64>,
    pub(super) top_speed: Option<f64>,
    pub(super) acceleration_limit: Option<f64>,
}

/// Settle values as written: one number for all joints, or one per joint.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct WrittenSettle {
    pub(super) kp: Option<OneOrMany>,
    pub(super) kd: Option<OneOrMany>,
    pub(super) frames: Option<u32>,
    pub(super) tolerance: Option<f64>,
}

/// One number for all joints, or one per joint.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub(super) enum OneOrMany {
    One(f64),
    Many(Vec<f64>),
}

impl Written {
    /// Parses TOML; names line and column of the first mistake.
    pub(super) fn parse(text: &str, path: &Path) -> Result<Written, Error> {
        let at = |message: String, byte: usize| {
            let (line, column) = line_column(text, byte);
            Error::Profile { message, line, column, path: path.to_owned() }
        };
        let written: Written = toml::from_str(text).map_err(|e| {
            let byte = e.span().map_or(0, |s| s.start);
            at(e.message().to_owned(), byte)
        })?;
        match &written.format {
            Some(format) if format.get_ref() == FORMAT => {}
            Some(format) => {
                let other = format.get_ref();
                return Err(at(
                    format!("format is \"{other}\", this program reads \"{FORMAT}\""),
                    format.span().start,
                ));
            }
            None => return Err(at(format!("format is missing; add format = \"{FORMAT}\""), 0)),
        }
        if let Some(id) = &written.id
            && !valid_id(id.get_ref())
        {
            let (id, byte) = (id.get_ref(), id.span().start);
            return Err(at(
                format!("id \"{id}\" must be lower-case letters, digits, '_' or '-', at most 64"),
                byte,
            ));
        }
        Ok(written)
    }
}

/// Whether a text is a valid robot id in paths and on command lines.
pub fn valid_id(id: &str) -> bool {
    !id.is_empty()
        && id.len() <= 64.min(limits::NAME_BYTES)
        && id
            .bytes()
            .all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_' || b == b'-')
}

impl Profile {
    /// The profile as TOML, in the order of the fields above.
    ///
    /// # Errors
    /// [`Error::Mismatch`] if a value has no form in TOML.
    pub fn to_toml(&self) -> Result<String, Error> {
        toml::to_string(self).map_err(|e| Error::Mismatch {
            message: format!("the profile cannot be written: {e}"),
            path: PROFILE_FILE.into(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Written, Error> {
        Written::parse(text, Path::new("p.toml"))
    }

    #[test]
    fn mistakes_have_a_place() {
        let e = parse("format = \"robert-robot/1\"\nid = \"x\"\nhomee = \"rest\"\n").unwrap_err();
        assert!(matches!(&e, Error::Profile { line: 3, column: 1, .. }), "{e}");
        assert!(e.to_string().starts_with("p.toml:3:1: "), "{e}");
        let e = parse("format = \"robert-robot/9\"").unwrap_err();
        assert!(e.to_string().contains("robert-robot/1"), "{e}");
        assert!(parse("").is_err());
        assert!(parse("format = \"robert-robot/1\"\nid = \"A b\"").is_err());
        assert!(parse("format = \"robert-robot/1\"").is_ok());
    }

    #[test]
    fn ids_are_plain() {
        assert!(valid_id("shadow_hand-2"));
        for bad in ["", "A", "a/b", "..", "a b", &"x".repeat(65)] {
            assert!(!valid_id(bad), "{bad}");
        }
    }
}
