//! Robots: model, profile, import, inverse kinematics.
//!
//! A [`Robot`] is an MJCF model plus a [`Profile`] (a TOML file beside it) with knowledge beyond
//! the physics: groups, named poses, mirror, camera. The point mass, the UR5e (with two dampings)
//! and the Shadow Hand are built in. [`mod@import`] makes a folder of the same kind from a foreign
//! URDF or MJCF.
//!
//! The state consists of the coordinates of all joints in model order. The action is one number in
//! -1..1 per motor, scaled to its control range. Two models are compiled from one text: the
//! simulated one without geoms that are only drawn (which makes stepping the arm twice as fast),
//! and the drawn one with all geoms.
//!
//! Rejected: describing robots in Rust (users could not add their own), and deriving everything
//! from the model (no model contains a mirror table or the name of a pose).

mod apart;
mod asset_dirs;
mod bounds;
mod builtin;
pub mod check;
mod complete;
mod couplings;
mod dae;
mod default_pose;
mod derive;
mod driven;
mod error;
mod folder;
mod foreign;
mod golden;
mod gravity;
mod groups;
mod ik;
pub mod import;
mod keys;
mod kinematics;
mod law;
mod lenient;
mod loops;
mod mesh;
mod mirror;
mod missing;
mod motors;
mod origin;
mod pace;
mod pairs;
mod plant;
mod position_servo;
pub mod preparse;
mod profile;
mod reference;
mod response;
mod rings;
mod servo;
mod servos;
mod settle;
mod tendons;
mod text;
mod ties;

pub use builtin::NOTICE;
pub use derive::derive;
pub use error::Error;
pub use gravity::Gravity;
pub use law::Law;
pub use loops::{Loops, Transmission};
pub use plant::{PlantConfig, PlantRange};
pub use position_servo::PositionServo;
pub use profile::{
    ActuatorSpec, Camera, Coupling, Drive, FORMAT, Group, JointSpec, MODEL_FILE, MirrorRow,
    MirrorSpec, NEAR_LIMIT, PROFILE_FILE, Physics, PoseSpec, Profile, SettleSpec, valid_id,
};
pub use response::Response;
pub use robert_kinematics::{IkConfig, IkResult, Kinematics, Point, Target};
pub use servo::Servo;
pub use settle::Settled;

use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use robert_base::fsio;
use robert_base::units::Unit;
use robert_mujoco::{Data, Kind, Model, index};

/// One coordinate of the state.
#[derive(Clone, Debug, PartialEq)]
pub struct StateJoint {
    /// Name, as in the model.
    pub name: String,
    /// Radians or metres.
    pub unit: Unit,
    /// Limits; infinite for an unbounded joint.
    pub range: [f64; 2],
    /// Whether it turns or slides without end.
    pub unbounded: bool,
    /// Greatest sustained speed that exploration and trial clips ask for, rad/s or m/s.
    pub speed_limit: f64,
    /// Greatest speed that the motors give, rad/s or m/s: at least the speed limit.
    pub top_speed: f64,
    /// Mean acceleration from rest to nearly this speed at full torque, rad/s² or m/s²; infinite if
    /// it was not measured.
    pub acceleration_limit: f64,
    /// Id in the model.
    pub id: usize,
    /// Index in qpos.
    pub qposadr: usize,
    /// Index in qvel.
    pub dofadr: usize,
}

/// One coordinate of the action.
#[derive(Clone, Debug, PartialEq)]
pub struct Actuator {
    /// Name, as in the model.
    pub name: String,
    /// The joint or tendon that it acts on.
    pub drive: Drive,
    /// Control range, N m or N.
    pub ctrlrange: [f64; 2],
    /// Whether its control is a force (and not a target position, for example).
    pub is_motor: bool,
    /// The law that turns its control into force; `None` for muscles and other dynamics.
    pub law: Option<Law>,
}

/// Files that a model refers to (meshes, textures): name and content.
pub(crate) type Assets = Vec<(String, Vec<u8>)>;

/// A robot ready to be simulated; immutable, shared by reference between threads.
///
/// ```
/// use robert_robot::Robot;
///
/// let arm = Robot::builtin("ur5e")?;
/// assert_eq!((arm.state_dim(), arm.action_dim()), (5, 5));
/// // The pose in which the arm settles when it is commanded to its home pose.
/// let settled = arm.settle(&arm.home())?;
/// assert_eq!(settled.reached.len(), arm.state_dim());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Robot {
    profile: Profile,
    /// The MJCF with the profile's changes, all geoms included.
    mjcf: String,
    assets: Assets,
    sha256: String,
    model: Arc<Model>,
    scene: OnceLock<Arc<Model>>,
    joints: Vec<StateJoint>,
    actuators: Vec<Actuator>,
    kinematics: OnceLock<Kinematics>,
    tracking: OnceLock<Vec<Servo>>,
    folder: Option<PathBuf>,
}

impl Robot {
    /// Ids of the built-in robots.
    pub fn builtin_ids() -> impl Iterator<Item = &'static str> {
        builtin::BUILTIN.iter().map(|b| b.id)
    }

    /// A built-in robot.
    ///
    /// # Errors
    /// [`Error::Unknown`].
    pub fn builtin(id: &str) -> Result<Robot, Error> {
        let found = builtin::find(id).ok_or_else(|| unknown(id))?;
        let path = PathBuf::from(format!("builtin:{id}/{PROFILE_FILE}"));
        let written = profile::Written::parse(found.profile, &path)?;
        let xml = match (&written.model, found.model) {
            (_, Some(xml)) => xml,
            (Some(model), None) => builtin_model(model, &path)?,
            (None, None) => return Err(unknown(id)),
        };
        Robot::assemble(written, xml, Assets::new(), id, &path, None)
    }

    /// The robot's identifier.
    pub fn id(&self) -> &str {
        &self.profile.id
    }

    /// The complete profile.
    pub fn profile(&self) -> &Profile {
        &self.profile
    }

    /// Numbers in a state.
    pub fn state_dim(&self) -> usize {
        self.joints.len()
    }

    /// Numbers in an action.
    pub fn action_dim(&self) -> usize {
        self.actuators.len()
    }

    /// The state, in order.
    pub fn joints(&self) -> &[StateJoint] {
        &self.joints
    }

    /// The action, in order.
    pub fn actuators(&self) -> &[Actuator] {
        &self.actuators
    }

    /// The model to simulate. It has no purely visual geoms.
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// The model to draw: the same bodies, joints and sites, with all geoms. Compiled on the
    /// first call.
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub fn scene_model(&self) -> Result<&Arc<Model>, Error> {
        if !self.profile.physics.discard_visual {
            return Ok(&self.model);
        }
        if let Some(scene) = self.scene.get() {
            return Ok(scene);
        }
        let scene = Arc::new(compile(&self.mjcf, &self.assets)?);
        Ok(self.scene.get_or_init(|| scene))
    }

    /// The MJCF text, all geoms included.
    pub fn mjcf(&self) -> &str {
        &self.mjcf
    }

    /// The folder that the robot was loaded from; `None` for built-in robots.
    pub fn folder(&self) -> Option<&Path> {
        self.folder.as_deref()
    }

    /// Sha-256 of the MJCF text (and of the meshes, if there are any). Two robots with the same
    /// value are the same plant.
    pub fn model_sha256(&self) -> &str {
        &self.sha256
    }

    /// Copies the state out of a simulation; `state` is (`state_dim`).
    pub fn read_state(&self, data: &Data, state: &mut [f64]) {
        debug_assert_eq!(state.len(), self.joints.len(), "state has the wrong length");
        let qpos = data.qpos();
        for (out, joint) in state.iter_mut().zip(&self.joints) {
            *out = qpos[joint.qposadr];
        }
    }

    /// The state of a simulation; (`state_dim`).
    pub fn state(&self, data: &Data) -> Vec<f64> {
        let mut state = vec![0.0; self.joints.len()];
        self.read_state(data, &mut state);
        state
    }

    /// Joint velocities of a simulation in state order; (`state_dim`).
    pub fn velocity(&self, data: &Data) -> Vec<f64> {
        let qvel = data.qvel();
        self.joints.iter().map(|j| qvel[j.dofadr]).collect()
    }

    /// Sets the state of a simulation; velocities are unchanged.
    ///
    /// # Errors
    /// [`Error::Length`]; [`Error::Simulator`] for values that are not finite.
    pub fn write_state(&self, data: &mut Data, state: &[f64]) -> Result<(), Error> {
        self.check_len("state", state.len(), self.joints.len())?;
        let mut qpos = data.qpos().to_vec();
        for (joint, v) in self.joints.iter().zip(state) {
            if let Some(q) = qpos.get_mut(joint.qposadr) {
                *q = *v;
            }
        }
        Ok(data.set_qpos(&qpos)?)
    }

    /// Sets the controls from an action: clamped to -1..1, then scaled to the control ranges.
    ///
    /// # Errors
    /// [`Error::Length`]; [`Error::Simulator`] for values that are not finite.
    pub fn apply_action(&self, data: &mut Data, action: &[f64]) -> Result<(), Error> {
        Ok(data.set_ctrl(&self.ctrl_of(action)?)?)
    }

    /// Controls of an action, N m or N; (`action_dim`).
    ///
    /// # Errors
    /// [`Error::Length`]. A value that is not finite is passed on; [`Data::set_ctrl`] refuses it.
    pub fn ctrl_of(&self, action: &[f64]) -> Result<Vec<f64>, Error> {
        self.check_len("action", action.len(), self.actuators.len())?;
        Ok(self
            .actuators
            .iter()
            .zip(action)
            .map(|(a, v)| {
                let [lo, hi] = a.ctrlrange;
                // Centre plus half span: exact for the symmetric ranges of motors.
                0.5 * (lo + hi) + 0.5 * (hi - lo) * v.clamp(-1.0, 1.0)
            })
            .collect())
    }

    /// The action that gives these controls, clamped to -1..1; (`action_dim`).
    ///
    /// # Errors
    /// [`Error::Length`].
    pub fn action_of(&self, ctrl: &[f64]) -> Result<Vec<f64>, Error> {
        self.check_len("ctrl", ctrl.len(), self.actuators.len())?;
        Ok(self
            .actuators
            .iter()
            .zip(ctrl)
            .map(|(a, v)| {
                let [lo, hi] = a.ctrlrange;
                ((v - 0.5 * (lo + hi)) / (0.5 * (hi - lo)).max(f64::MIN_POSITIVE)).clamp(-1.0, 1.0)
            })
            .collect())
    }

    /// Index of a joint in the state.
    ///
    /// # Errors
    /// [`Error::UnknownJoint`].
    pub fn joint_index(&self, name: &str) -> Result<usize, Error> {
        self.joints.iter().position(|j| j.name == name).ok_or_else(|| Error::UnknownJoint {
            robot: self.id().to_owned(),
            joint: name.to_owned(),
            known: list(self.joints.iter().map(|j| j.name.as_str())),
        })
    }

    /// A named pose; (`state_dim`).
    ///
    /// # Errors
    /// [`Error::UnknownPose`].
    pub fn pose(&self, name: &str) -> Result<Vec<f64>, Error> {
        let poses = &self.profile.poses;
        let pose = poses.get(name).ok_or_else(|| Error::UnknownPose {
            robot: self.id().to_owned(),
            pose: name.to_owned(),
            known: list(poses.keys().map(String::as_str)),
        })?;
        let home = poses.get(&self.profile.home);
        Ok(self
            .joints
            .iter()
            .map(|j| {
                let named = pose.get(&j.name).or_else(|| home?.get(&j.name)).copied();
                named.unwrap_or_else(|| 0.0_f64.clamp(j.range[0], j.range[1]))
            })
            .collect())
    }

    /// The home pose; (`state_dim`).
    pub fn home(&self) -> Vec<f64> {
        self.pose(&self.profile.home)
            .unwrap_or_else(|e| unreachable!("a robot without its home pose is not read: {e}"))
    }

    /// Names of the poses, sorted.
    pub fn pose_names(&self) -> impl Iterator<Item = &str> {
        self.profile.poses.keys().map(String::as_str)
    }

    /// Joints of the state that are within the profile's threshold of a limit.
    pub fn near_limits(&self, state: &[f64]) -> Vec<usize> {
        let near = self.profile.near_limit;
        self.joints
            .iter()
            .zip(state)
            .enumerate()
            .filter(|(_, (j, v))| **v < j.range[0] + near || **v > j.range[1] - near)
            .map(|(i, _)| i)
            .collect()
    }

    /// Id of a site of the model.
    ///
    /// # Errors
    /// [`Error::UnknownPoint`].
    pub fn site(&self, name: &str) -> Result<usize, Error> {
        self.model.id(Kind::Site, name).ok_or_else(|| self.unknown_point(name))
    }

    fn unknown_point(&self, name: &str) -> Error {
        let sites = (0..self.model.nsite()).filter_map(|s| self.model.name(Kind::Site, s));
        let bodies = (1..self.model.nbody()).filter_map(|b| self.model.name(Kind::Body, b));
        Error::UnknownPoint {
            robot: self.id().to_owned(),
            name: name.to_owned(),
            known: list(sites.chain(bodies)),
        }
    }

    fn check_len(&self, what: &'static str, got: usize, want: usize) -> Result<(), Error> {
        if got == want {
            return Ok(());
        }
        Err(Error::Length { robot: self.id().to_owned(), what, got, want })
    }

    /// Compiles the model and completes the profile. All constructors end here.
    fn assemble(
        written: profile::Written,
        xml: &str,
        assets: Assets,
        id: &str,
        path: &Path,
        folder: Option<PathBuf>,
    ) -> Result<Robot, Error> {
        let mismatch = |message: String| Error::Mismatch { message, path: path.to_owned() };
        let mjcf =
            text::with_joints(xml, "damping", &written.physics.damping).map_err(|e| match e {
                text::JointsError::Xml(e) => mismatch(format!("the model does not parse: {e}")),
                text::JointsError::NoJoint(name) => mismatch(format!(
                    "physics.damping contains joint \"{name}\", which the model does not have"
                )),
            })?;
        let stepped = if written.physics.discard_visual {
            text::discard_visual(&mjcf)
                .map_err(|e| mismatch(format!("the model does not parse: {e}")))?
        } else {
            mjcf.clone()
        };
        let model = Arc::new(compile(&stepped, &assets)?);
        let profile = complete::complete(written, &model, id, path)?;
        let joints: Vec<StateJoint> = profile
            .joints
            .iter()
            .enumerate()
            .map(|(id, j)| StateJoint {
                name: j.name.clone(),
                unit: j.unit,
                range: j.range.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]),
                unbounded: j.range.is_none(),
                speed_limit: j.speed_limit,
                top_speed: j.top_speed.unwrap_or(0.0).max(j.speed_limit),
                acceleration_limit: j.acceleration_limit.unwrap_or(f64::INFINITY),
                id,
                qposadr: index(model.jnt_qposadr()[id]),
                dofadr: index(model.jnt_dofadr()[id]),
            })
            .collect();
        let actuators = profile
            .actuators
            .iter()
            .enumerate()
            .map(|(i, a)| Actuator {
                name: a.name.clone(),
                drive: a.drive.clone(),
                ctrlrange: a.ctrlrange,
                is_motor: motors::is_motor(&model, i),
                law: Law::of(&model, i),
            })
            .collect();
        let sha256 = fingerprint(&mjcf, &assets);
        let scene = OnceLock::new();
        let tracking = OnceLock::new();
        let kinematics = OnceLock::new();
        Ok(Robot {
            profile,
            mjcf,
            assets,
            sha256,
            model,
            scene,
            joints,
            actuators,
            kinematics,
            tracking,
            folder,
        })
    }
}

fn compile(xml: &str, assets: &Assets) -> Result<Model, Error> {
    let mut files: Vec<(&str, &[u8])> = vec![(MODEL_FILE, xml.as_bytes())];
    files.extend(assets.iter().map(|(n, b)| (n.as_str(), b.as_slice())));
    Ok(Model::from_assets(MODEL_FILE, &files)?)
}

/// The text's hash; with meshes, the hash of all hashes in order of name.
fn fingerprint(mjcf: &str, assets: &Assets) -> String {
    let own = fsio::sha256_hex(mjcf.as_bytes());
    if assets.is_empty() {
        return own;
    }
    let mut lines: Vec<String> =
        assets.iter().map(|(n, b)| format!("{n} {}\n", fsio::sha256_hex(b))).collect();
    lines.sort();
    fsio::sha256_hex(format!("{own}\n{}", lines.concat()).as_bytes())
}

fn builtin_model(reference: &str, path: &Path) -> Result<&'static str, Error> {
    let id = reference.strip_prefix("builtin:").unwrap_or_default();
    builtin::find(id).and_then(|b| b.model).ok_or_else(|| Error::Mismatch {
        message: format!("model is \"{reference}\", which is not a built-in robot"),
        path: path.to_owned(),
    })
}

fn unknown(name: &str) -> Error {
    let close = Robot::builtin_ids()
        .map(|id| (strsim::jaro_winkler(id, name), id))
        .filter(|(score, _)| *score > 0.8)
        .max_by(|a, b| a.0.total_cmp(&b.0));
    Error::Unknown {
        name: name.to_owned(),
        hint: close.map_or_else(String::new, |(_, id)| format!(" (did you mean \"{id}\"?)")),
        known: list(Robot::builtin_ids()),
    }
}

fn list<'a>(names: impl Iterator<Item = &'a str>) -> String {
    names.collect::<Vec<_>>().join(", ")
}
