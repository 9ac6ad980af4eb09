//! The formats of `robert export`.

use clap::ValueEnum;

use crate::take::What;
use crate::take::export::{Bodies, LeRobotVersion, UrMove};

/// The format to write.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Format {
    /// Rows of joint values: frame, time, mask, one column per joint.
    Csv,
    /// One document with everything except the body poses.
    Json,
    /// The take itself, for Foxglove, Lichtblick, Rerun.
    Mcap,
    /// A `<keyframe>` block: full states of the simulator; see --with-model.
    Mjcf,
    /// ROS 2 `trajectory_msgs/JointTrajectory`, YAML; an action's goal with --goal.
    Ros,
    /// A folder for `ros2 bag play`: /joint_states, and the trajectory as one message.
    Bag,
    /// A recording for the viser client.
    Viser,
    /// A page with client and recording inside.
    Html,
    /// glTF 2.0 for Blender, Unreal, Unity, three.js: meshes, two animations.
    Glb,
    /// Motion capture text for Blender, MotionBuilder, Houdini.
    Bvh,
    /// USD text for Isaac Sim, Omniverse, usdview.
    Usda,
    /// LAFAN rows: base and joints, no header.
    Lafan,
    /// Motion file of BeyondMimic and mjlab.
    Npz,
    /// URScript for a UR5e.
    Ur,
    /// A LeRobot dataset; several takes become its episodes.
    Lerobot,
    /// A Minari dataset, of takes or of collected data.
    Minari,
}

impl Format {
    /// The word after `--to`.
    pub(super) fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |v| v.get_name().to_owned())
    }

    /// Goes to stdout where no file is named.
    pub(super) fn is_printed(self) -> bool {
        matches!(self, Format::Csv | Format::Json | Format::Mjcf | Format::Ros)
    }

    /// Can hold the command instead of the reached motion.
    pub(super) fn has_command(self) -> bool {
        self.is_printed() || self == Format::Ur
    }

    /// Several takes become one output.
    pub(super) fn gathers(self) -> bool {
        matches!(self, Format::Lerobot | Format::Minari)
    }

    /// Ending of the file, or of the folder's name.
    pub(super) fn suffix(self) -> &'static str {
        match self {
            Format::Csv => "csv",
            Format::Json => "json",
            Format::Mcap => "mcap",
            Format::Mjcf => "xml",
            Format::Ros => "yaml",
            Format::Bag => "bag",
            Format::Viser => "viser",
            Format::Html => "html",
            Format::Glb => "glb",
            Format::Bvh => "bvh",
            Format::Usda => "usda",
            // The same shape exists with the quaternion in another order: the name says which.
            Format::Lafan => "lafan.csv",
            Format::Npz => "npz",
            Format::Ur => "script",
            Format::Lerobot => "lerobot",
            Format::Minari => "minari",
        }
    }
}

/// [`What`] as it is typed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum WhatArg {
    /// The motion that the simulation reached.
    Achieved,
    /// The command of the clip.
    Command,
}

impl From<WhatArg> for What {
    fn from(arg: WhatArg) -> What {
        match arg {
            WhatArg::Achieved => What::Achieved,
            WhatArg::Command => What::Command,
        }
    }
}

/// [`Bodies`] as it is typed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum BodiesArg {
    /// Depth first: MuJoCo, mjlab.
    Mujoco,
    /// Breadth first: PhysX, Isaac Lab.
    Isaac,
}

impl From<BodiesArg> for Bodies {
    fn from(arg: BodiesArg) -> Bodies {
        match arg {
            BodiesArg::Mujoco => Bodies::Mujoco,
            BodiesArg::Isaac => Bodies::Isaac,
        }
    }
}

/// [`UrMove`] as it is typed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum UrArg {
    /// A target every 50 ms.
    Servoj,
    /// From key to key.
    Movej,
}

impl From<UrArg> for UrMove {
    fn from(arg: UrArg) -> UrMove {
        match arg {
            UrArg::Servoj => UrMove::Servoj,
            UrArg::Movej => UrMove::Movej,
        }
    }
}

/// The content of the action column of an episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum ActionArg {
    /// The position reached one frame later.
    Position,
    /// The controls, N m or N.
    Torque,
}

/// [`LeRobotVersion`] as it is typed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum VersionArg {
    /// LeRobot 0.4 and later.
    #[value(name = "3.0", alias = "3")]
    V3,
    /// LeRobot up to 0.3, openpi, GR00T.
    #[value(name = "2.1", alias = "2")]
    V2,
}

impl From<VersionArg> for LeRobotVersion {
    fn from(arg: VersionArg) -> LeRobotVersion {
        match arg {
            VersionArg::V3 => LeRobotVersion::V3,
            VersionArg::V2 => LeRobotVersion::V2,
        }
    }
}
