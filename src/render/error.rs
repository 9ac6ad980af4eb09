//! What can go wrong while drawing, and what to do about it.

use std::path::PathBuf;

use crate::exit::{Exit, HasExit};

/// A picture that could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// No Vulkan or OpenGL driver answers; the message is the line to run.
    #[error(
        "no Vulkan or OpenGL driver found ({reason}). Debian/Ubuntu: sudo apt install mesa-vulkan-drivers (software) or your GPU driver; check: vulkaninfo --summary"
    )]
    NoAdapter {
        /// What the search said.
        reason: String,
    },
    /// No graphics card answers, and nothing else was to be taken.
    #[error(
        "no graphics card found ({reason}): use --renderer auto, which draws on the processor instead"
    )]
    NoGpu {
        /// What the search said.
        reason: String,
    },
    /// The driver refused or lost the device.
    #[error("the graphics driver failed ({adapter}): {reason}")]
    Device {
        /// Name of the adapter.
        adapter: String,
        /// What the driver said.
        reason: String,
    },
    /// A picture without pixels, or with more than the cap.
    #[error("a picture of {width}x{height} px cannot be drawn: each edge must be 1 to {max_px} px")]
    Size {
        /// Width asked for.
        width: u32,
        /// Height asked for.
        height: u32,
        /// The longest edge that this machine and the caps allow.
        max_px: u32,
    },
    /// The frame has another number of poses than the scene has geoms.
    #[error("{what} has {poses} poses, but the scene has {geoms} geoms")]
    PoseCount {
        /// Which pose list (achieved, ghost 0, ...).
        what: String,
        /// Poses given.
        poses: usize,
        /// Geoms of the scene.
        geoms: usize,
    },
    /// A pose, camera or trail holds NaN or infinity.
    #[error("{what} contains a number that is not finite: the simulation has probably diverged")]
    NotFinite {
        /// Which value, with the geom's name where it is a pose.
        what: String,
    },
    /// A mesh whose faces do not fit its vertices.
    #[error("mesh {mesh}: {reason}")]
    Mesh {
        /// Name of the mesh.
        mesh: String,
        /// What is wrong.
        reason: String,
    },
    /// More geoms than are drawn.
    #[error("the scene has {geoms} geoms; at most {cap} can be drawn")]
    Geoms {
        /// Geoms of the scene.
        geoms: usize,
        /// The cap.
        cap: usize,
    },
    /// The model names no such camera or body.
    #[error("no {kind} named {name:?}; there are: {known}")]
    Unknown {
        /// `camera` or `body`.
        kind: &'static str,
        /// The name asked for.
        name: String,
        /// The names there are.
        known: String,
    },
    /// The robot refused a state, or its drawing model does not compile.
    #[error(transparent)]
    Robot(Box<crate::robot::Error>),
    /// The simulator failed.
    #[error(transparent)]
    Simulator(Box<crate::mujoco::Error>),
    /// Pictures of different size in one film.
    #[error("frame {frame} has {got_width}x{got_height} px, but the film has {width}x{height}")]
    FrameSize {
        /// Index of the frame.
        frame: u64,
        /// Its width.
        got_width: u32,
        /// Its height.
        got_height: u32,
        /// Width of the film.
        width: u32,
        /// Height of the film.
        height: u32,
    },
    /// A film that its format cannot hold.
    #[error(
        "an .mp4 of {width}x{height} px cannot be encoded: edges must be {least} to {long} px, the shorter one at most {short}"
    )]
    FilmSize {
        /// Width of the film.
        width: u32,
        /// Height of the film.
        height: u32,
        /// The shortest edge there can be.
        least: u32,
        /// The longest.
        long: u32,
        /// The longest of the shorter edge.
        short: u32,
    },
    /// A film without frames.
    #[error("a film needs at least one frame")]
    NoFrames,
    /// The file name ends in nothing that can be written.
    #[error("unknown suffix of {path}: use {known}", path = path.display())]
    Format {
        /// The endings there are.
        known: &'static str,
        /// The file.
        path: PathBuf,
    },
    /// An encoder failed.
    #[error("cannot encode {format}: {reason}")]
    Encode {
        /// `png`, `mp4`, ...
        format: &'static str,
        /// What the encoder said.
        reason: String,
    },
    /// The file could not be written.
    #[error(transparent)]
    File(#[from] crate::fsio::Error),
}

impl Error {
    // Boxed: these are large and rare.
    pub(super) fn robot(e: crate::robot::Error) -> Error {
        Error::Robot(Box::new(e))
    }

    pub(super) fn simulator(e: crate::mujoco::Error) -> Error {
        Error::Simulator(Box::new(e))
    }
}

impl HasExit for Error {
    fn exit(&self) -> Exit {
        match self {
            Error::NoAdapter { .. } | Error::NoGpu { .. } => Exit::Missing,
            Error::Size { .. }
            | Error::FilmSize { .. }
            | Error::Format { .. }
            | Error::Unknown { .. } => Exit::Usage,
            Error::NotFinite { .. }
            | Error::Mesh { .. }
            | Error::Geoms { .. }
            | Error::PoseCount { .. } => Exit::Invalid,
            Error::Device { .. }
            | Error::FrameSize { .. }
            | Error::NoFrames
            | Error::Encode { .. } => Exit::Failed,
            Error::Robot(e) => e.exit(),
            Error::Simulator(e) => e.exit(),
            Error::File(e) => e.exit(),
        }
    }
}
