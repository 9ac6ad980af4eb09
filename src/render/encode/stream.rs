//! A film that grows picture by picture in memory.

use super::film::{Encode, Film, FilmFormat};
use super::{apng, gif, mp4};
use crate::{Error, Picture};

impl FilmFormat {
    /// Whether a film of these pixels can be written.
    ///
    /// # Errors
    /// [`Error::FilmSize`].
    pub fn check_size(self, width: u32, height: u32) -> Result<(), Error> {
        match self {
            FilmFormat::Mp4 => mp4::check_size(width, height),
            FilmFormat::Gif | FilmFormat::Apng => Ok(()),
        }
    }
}

/// An encoder with what it has written so far.
pub struct FilmStream {
    encoder: Box<dyn Encode>,
}

impl std::fmt::Debug for FilmStream {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FilmStream").finish_non_exhaustive()
    }
}

impl FilmStream {
    /// A film of this make.
    ///
    /// # Errors
    /// [`Error::FilmSize`], [`Error::Encode`].
    pub fn new(film: &Film) -> Result<FilmStream, Error> {
        film.format.check_size(film.width, film.height)?;
        let encoder: Box<dyn Encode> = match film.format {
            FilmFormat::Mp4 => Box::new(mp4::Mp4::new(film)?),
            FilmFormat::Gif => Box::new(gif::Gif::new(film)?),
            FilmFormat::Apng => Box::new(apng::Apng::new(film)?),
        };
        Ok(FilmStream { encoder })
    }

    /// Adds the next picture; all have the film's size.
    ///
    /// # Errors
    /// [`Error::Encode`].
    pub fn push(&mut self, picture: &Picture) -> Result<(), Error> {
        self.encoder.push(picture)
    }

    /// The file.
    ///
    /// # Errors
    /// [`Error::Encode`].
    pub fn finish(self) -> Result<Vec<u8>, Error> {
        self.encoder.finish()
    }
}
