//! The formats of exports: which the page offers, and what a file of each contains.

use crate::protocol::{ExportFormat, ExportKind};
use crate::simulation::RobotContext;
use robert_base::units::Unit;
use robert_take::export::{JointedBody, bvh_unfit, fits_ur};

/// All of them, in the order in which the page shows them.
pub(crate) const FORMATS: &[ExportFormat] = &[
    film("mp4", "Film", "MP4, H.264: command and achieved motion with captions", "mp4"),
    film("apng", "Sharp film", "APNG: every pixel as rendered, larger", "apng"),
    film("gif", "Animated picture", "GIF for pages and chats", "gif"),
    of(ExportKind::Picture, "strip", "Film strip", "moments in one PNG", "png"),
    of(ExportKind::Picture, "png", "Picture", "the playhead as a PNG", "png"),
    take("mcap", "Take", "MCAP for Foxglove, Lichtblick, Rerun", "mcap"),
    take("html", "Page", "one HTML file that plays the take anywhere", "html"),
    take("csv", "Achieved motion", "CSV: frame, time, mask and one column for each joint", "csv"),
    of(
        ExportKind::Clip,
        "command",
        "Command table",
        "CSV of the commanded motion, masked cells empty",
        "command.csv",
    ),
    of(ExportKind::Clip, "json", "Clip", "keyframes in the format robert-clip/1", "clip.json"),
    take("mjcf", "MuJoCo keys", "MJCF <keyframe> of the achieved motion", "xml"),
    take("ros", "ROS 2 trajectory", "JointTrajectory with velocities, YAML", "yaml"),
    of(ExportKind::Folder, "bag", "ROS 2 bag", "a folder for ros2 bag play", "bag"),
    of(
        ExportKind::Folder,
        "lerobot",
        "LeRobot dataset",
        "a folder with this motion as one episode",
        "lerobot",
    ),
    of(
        ExportKind::Folder,
        "minari",
        "Minari dataset",
        "a folder with this motion as one episode",
        "minari",
    ),
    take("glb", "3D animation", "glTF for Blender, Unreal, three.js, slides", "glb"),
    take("bvh", "Motion capture", "BVH for Blender, MotionBuilder, Houdini", "bvh"),
    take("usda", "USD", "for Isaac Sim, Omniverse, usdview", "usda"),
    take("npz", "Tracking file", "NPZ of BeyondMimic and mjlab, 50 Hz", "npz"),
    take("lafan", "LAFAN rows", "CSV of base and joints for retargeting tools", "lafan.csv"),
    take("ur", "URScript", "a program for the controller of a UR arm", "script"),
    take("viser", "Viser recording", "for the client of viser", "viser"),
];

const fn of(
    kind: ExportKind,
    format: &'static str,
    title: &'static str,
    about: &'static str,
    ending: &'static str,
) -> ExportFormat {
    ExportFormat { format, title, about, ending, kind, why: None }
}

const fn film(
    format: &'static str,
    title: &'static str,
    about: &'static str,
    ending: &'static str,
) -> ExportFormat {
    of(ExportKind::Film, format, title, about, ending)
}

const fn take(
    format: &'static str,
    title: &'static str,
    about: &'static str,
    ending: &'static str,
) -> ExportFormat {
    of(ExportKind::Take, format, title, about, ending)
}

/// All of them as a robot can have them; without a robot, as they are.
pub(crate) fn offered(robot: Option<&RobotContext>) -> Vec<ExportFormat> {
    let told =
        |f: &ExportFormat| ExportFormat { why: robot.and_then(|r| why(f.format, r)), ..f.clone() };
    FORMATS.iter().map(told).collect()
}

/// Why a robot cannot have a format.
fn why(format: &str, robot: &RobotContext) -> Option<String> {
    let joints = &robot.table.joints;
    match format {
        "ur" if !fits_ur(joints.iter().map(|j| j.name.as_str())) => {
            Some("only for a UR5e: this robot has other joints".to_owned())
        }
        "bvh" => {
            let joint = |j: &usize| (joints[*j].unit == Unit::M, robot.axes[*j].pos.into());
            // The first body is the world.
            let bodies = robot.bodies.iter().skip(1).map(|body| JointedBody {
                name: &body.name,
                is_root: body.parent == 0,
                joints: body.joints.iter().map(joint).collect(),
            });
            bvh_unfit(&bodies.collect::<Vec<_>>())
        }
        _ => None,
    }
}

/// The format of this name.
pub(crate) fn named(format: &str) -> Option<&'static ExportFormat> {
    FORMATS.iter().find(|f| f.format == format)
}
