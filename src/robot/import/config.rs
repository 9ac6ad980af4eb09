//! Options of an import, and its report.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::Serialize;

/// The source of an import, and its options.
#[derive(Clone, Debug)]
pub struct ImportConfig {
    /// The URDF or MJCF file.
    pub source: PathBuf,
    /// Its name in the robot's description; by default that of the file.
    pub source_name: Option<String>,
    /// The folder to make; it must not exist yet, or be empty.
    pub out: PathBuf,
    /// The folder that must contain all includes and meshes; by default the source's own.
    pub root: Option<PathBuf>,
    /// Folders of ROS packages by name, for `package://NAME/…`.
    pub packages: BTreeMap<String, PathBuf>,
    /// The robot's id; by default the folder's name.
    pub id: Option<String>,
    /// Hold a floating base still.
    pub fixed_base: bool,
    /// Height of a URDF's root above the floor, m.
    pub base_height_m: f64,
    /// Force limit of joints whose source names none, N m or N; `None` sizes it so that the motors
    /// carry the robot.
    pub effort: Option<f64>,
    /// Joints to weld where they are.
    pub weld: Vec<String>,
    /// Bodies to leave out, with everything that refers to them (MJCF).
    pub without: Vec<String>,
    /// Leave out meshes whose files are missing, also those that collide, and textures.
    pub without_meshes: bool,
    /// The treatment of position and velocity servos.
    pub servos: Servos,
    /// The treatment of joints whose source does not describe the drive.
    pub drives: Drives,
    /// The binary that checks models; see [`crate::check::executable`].
    pub checker: PathBuf,
}

impl ImportConfig {
    /// An import with the default of every option: the base is as in the file, at height 0,
    /// nothing is welded or left out, servos stay, and missing drives are modelled.
    pub fn new(
        source: impl Into<PathBuf>,
        out: impl Into<PathBuf>,
        checker: impl Into<PathBuf>,
    ) -> ImportConfig {
        ImportConfig {
            source: source.into(),
            source_name: None,
            out: out.into(),
            root: None,
            packages: BTreeMap::new(),
            id: None,
            fixed_base: false,
            base_height_m: 0.0,
            effort: None,
            weld: Vec::new(),
            without: Vec::new(),
            without_meshes: false,
            servos: Servos::default(),
            drives: Drives::default(),
            checker: checker.into(),
        }
    }
}

/// The treatment of position and velocity servos.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Servos {
    /// They stay: the action is their control.
    #[default]
    Keep,
    /// Motors with the same force limit replace them.
    Torque,
}

/// The treatment of joints that full torque would accelerate without end, because their source
/// names neither the inertia nor the damping of a drive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Drives {
    /// They get inertia and damping in proportion to the torque limit.
    #[default]
    Modelled,
    /// They stay as the file describes them.
    File,
}

/// The imported robot, and everything that was dropped, assumed or changed.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Report {
    /// The robot's id.
    pub id: String,
    /// The folder.
    pub folder: PathBuf,
    /// `urdf` or `mjcf`.
    pub format: String,
    /// Sha-256 of the source's text, its files, and the options; see [`super::mark`].
    pub source_sha256: String,
    /// Numbers in a state.
    pub state_dim: usize,
    /// Numbers in an action.
    pub action_dim: usize,
    /// Bodies, the world not counted.
    pub bodies: usize,
    /// Mesh and texture files taken over.
    pub files: usize,
    /// Total mass, kg.
    pub mass_kg: f64,
    /// The mass of the bodies that a joint moves, kg.
    pub moving_kg: f64,
    /// Parts of the source that are not in the result.
    pub dropped: Vec<String>,
    /// Figures that the source did not give.
    pub assumed: Vec<String>,
    /// Parts of the source that are in the result in another form.
    pub changed: Vec<String>,
    /// Implausible properties of the robot.
    pub warnings: Vec<String>,
}
