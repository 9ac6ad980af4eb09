//! What a film is made of, and what every encoder of one does.

use std::path::Path;

use super::ending;
use crate::render::{Error, Picture};

/// The format of a film.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FilmFormat {
    /// H.264 in MP4: small, plays everywhere.
    Mp4,
    /// 256 colours: plays where nothing else does.
    Gif,
    /// Lossless.
    Apng,
}

impl FilmFormat {
    /// From the ending of a path; a `.png` is a still and gives none.
    pub fn of(path: &Path) -> Option<FilmFormat> {
        match ending(path).as_str() {
            "mp4" => Some(FilmFormat::Mp4),
            "gif" => Some(FilmFormat::Gif),
            "apng" => Some(FilmFormat::Apng),
            _ => None,
        }
    }
}

/// What a film is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Film {
    /// The format.
    pub format: FilmFormat,
    /// Frames a second.
    pub fps: u32,
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Frames there will be.
    pub frames: u32,
}

/// Turns pictures into the bytes of a file.
pub(super) trait Encode {
    fn push(&mut self, picture: &Picture) -> Result<(), Error>;
    fn finish(self: Box<Self>) -> Result<Vec<u8>, Error>;
}
