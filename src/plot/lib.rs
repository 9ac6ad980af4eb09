//! Charts in a common style, as PNG and SVG, from plain data.
//!
//! All figures of the program are drawn here (precision over time, command and reached motion,
//! training curves, evaluation bars, coverage of a dataset), so that charts from different commands
//! fit together in a paper. There are no robot types: callers pass numbers.
//!
//! Rules of the style: a unit on every axis; colours that colour-blind readers can tell apart
//! name the joint or the method; the pattern names the kind (achieved solid, commanded dashed or
//! crosses); spans without goal are hatched; a band is a 95 % interval.

mod axis;
mod charts;
mod draw;
mod figure;
pub mod font;
mod lettering;
pub mod palette;

pub use axis::Axis;
pub use charts::{
    Curve, JointTrack, bars, coverage, curves, histogram, joints, one_scale, precision, xy,
};
pub use figure::{Dash, Figure, Layer, Mark, Panel};
pub use lettering::Letterer;
pub use palette::Theme;

/// Number of the text colour.
pub const INK: usize = usize::MAX;

use std::path::PathBuf;

use robert_base::exit::{Exit, HasExit};

/// A chart that could not be drawn.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A figure without panels.
    #[error("there is nothing to plot: no data were given")]
    Empty,
    /// Too many panels for one file.
    #[error(
        "a chart of {width}x{height} points is too large (at most {cap} an edge): plot fewer panels"
    )]
    Large {
        /// Width.
        width: u32,
        /// Height.
        height: u32,
        /// The longest edge.
        cap: u32,
    },
    /// The drawing library failed.
    #[error("cannot draw the chart: {0}")]
    Draw(String),
    /// The file name ends in neither.
    #[error("unknown suffix of {path}: use .png or .svg", path = path.display())]
    Format {
        /// The file.
        path: PathBuf,
    },
    /// The file could not be written.
    #[error(transparent)]
    File(#[from] robert_base::fsio::Error),
}

impl Error {
    fn draw(e: impl std::fmt::Display) -> Error {
        Error::Draw(e.to_string())
    }
}

impl HasExit for Error {
    fn exit(&self) -> Exit {
        match self {
            Error::Empty | Error::Large { .. } => Exit::Invalid,
            Error::Draw(_) => Exit::Failed,
            Error::Format { .. } => Exit::Usage,
            Error::File(e) => e.exit(),
        }
    }
}
