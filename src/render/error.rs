//! Errors of drawing, with their remedies.

use std::path::PathBuf;

use robert_base::exit::{Exit, HasExit};

/// A picture that could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// There is no Vulkan or OpenGL driver; the message contains the command that installs one.
    #[error(
        "no Vulkan or OpenGL driver found ({reason}). Debian/Ubuntu: sudo apt install mesa-vulkan-drivers (software) or your GPU driver; check: vulkaninfo --summary"
    )]
    NoAdapter {
        /// The reason.
        reason: String,
    },
    /// There is no graphics card, and the software driver was excluded.
    #[error(
        "no graphics card found ({reason}): use --renderer auto, which draws on the processor instead"
    )]
    NoGpu {
        /// The reason.
        reason: String,
    },
    /// The driver failed or lost the device.
    #[error("the graphics driver failed ({adapter}): {reason}")]
    Device {
        /// Name of the adapter.
        adapter: String,
        /// The driver's message.
        reason: String,
    },
    /// A picture without pixels, or with too many.
    #[error("a picture of {width}x{height} px cannot be drawn: each edge must be 1 to {max_px} px")]
    Size {
        /// Requested width.
        width: u32,
        /// Requested height.
        height: u32,
        /// The longest edge that this machine and our limits allow.
        max_px: u32,
    },
    /// The frame has another number of poses than the scene has geoms.
    #[error("{what} has {poses} poses, but the scene has {geoms} geoms")]
    PoseCount {
        /// The name of the pose list (achieved, ghost 0, ...).
        what: String,
        /// Poses given.
        poses: usize,
        /// Geoms of the scene.
        geoms: usize,
    },
    /// A pose, camera or trail contains NaN or infinity.
    #[error("{what} contains a number that is not finite: the simulation has probably diverged")]
    NotFinite {
        /// The value, with the geom's name if it is a pose.
        what: String,
    },
    /// A mesh whose faces do not fit its vertices.
    #[error("mesh {mesh}: {reason}")]
    Mesh {
        /// Name of the mesh.
        mesh: String,
        /// The problem, in words.
        reason: String,
    },
    /// Too many geoms.
    #[error("the scene has {geoms} geoms; at most {cap} can be drawn")]
    Geoms {
        /// Geoms of the scene.
        geoms: usize,
        /// The limit.
        cap: usize,
    },
    /// The model has no such camera or body.
    #[error("no {kind} named {name:?}; there are: {known}")]
    Unknown {
        /// `camera` or `body`.
        kind: &'static str,
        /// The requested name.
        name: String,
        /// The existing names.
        known: String,
    },
    /// A state does not fit the robot, or its drawing model does not compile.
    #[error(transparent)]
    Robot(Box<robert_robot::Error>),
    /// The simulator failed.
    #[error(transparent)]
    Simulator(Box<robert_mujoco::Error>),
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
    /// The format does not support this film size.
    #[error(
        "an .mp4 of {width}x{height} px cannot be encoded: edges must be {least} to {long} px, the shorter one at most {short}"
    )]
    FilmSize {
        /// Width of the film.
        width: u32,
        /// Height of the film.
        height: u32,
        /// The shortest allowed edge.
        least: u32,
        /// The largest allowed length of the longer edge.
        long: u32,
        /// The largest allowed length of the shorter edge.
        short: u32,
    },
    /// A film without frames.
    #[error("a film needs at least one frame")]
    NoFrames,
    /// The suffix is unknown.
    #[error("unknown suffix of {path}: use {known}", path = path.display())]
    Format {
        /// The supported suffixes.
        known: &'static str,
        /// The file.
        path: PathBuf,
    },
    /// An encoder failed.
    #[error("cannot encode {format}: {reason}")]
    Encode {
        /// `png`, `mp4`, ...
        format: &'static str,
        /// The encoder's message.
        reason: String,
    },
    /// The file could not be written.
    #[error(transparent)]
    File(#[from] robert_base::fsio::Error),
}

impl Error {
    // Boxed: these are large and rare.
    pub(super) fn robot(e: robert_robot::Error) -> Error {
        Error::Robot(Box::new(e))
    }

    pub(super) fn simulator(e: robert_mujoco::Error) -> Error {
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
