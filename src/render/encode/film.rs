//! The parameters of a film, and the interface of its encoders.

use std::path::Path;

use super::ending;
use crate::{Error, Picture};

/// The format of a film.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FilmFormat {
    /// H.264 in MP4: small, and plays everywhere.
    Mp4,
    /// 256 colours, for places that show no films.
    Gif,
    /// Lossless.
    Apng,
}

impl FilmFormat {
    /// From the suffix of a path; `None` for stills such as `.png`.
    pub fn of(path: &Path) -> Option<FilmFormat> {
        match ending(path).as_str() {
            "mp4" => Some(FilmFormat::Mp4),
            "gif" => Some(FilmFormat::Gif),
            "apng" => Some(FilmFormat::Apng),
            _ => None,
        }
    }
}

/// The parameters of a film.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Film {
    /// The format.
    pub format: FilmFormat,
    /// Frames a second.
    pub fps: u32,
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Total number of frames.
    pub frames: u32,
}

/// Turns pictures into the bytes of a file.
pub(super) trait Encode {
    fn push(&mut self, picture: &Picture) -> Result<(), Error>;
    fn finish(self: Box<Self>) -> Result<Vec<u8>, Error>;
}
