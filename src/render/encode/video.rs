//! Encodes a film frame by frame on its own thread.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::JoinHandle;

use super::ENDINGS;
use super::film::{Film, FilmFormat};
use super::stream::FilmStream;
use crate::{Error, Picture};

/// The most frames that wait for the encoder.
const WAITING: usize = 4;

/// A finished film.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Written {
    /// Frames in it.
    pub frames: u64,
    /// Its size.
    pub bytes: u64,
    /// Its path.
    pub path: PathBuf,
}

/// Encodes a film on its own thread and writes it atomically.
#[derive(Debug)]
pub struct VideoWriter {
    pictures: Option<SyncSender<Picture>>,
    worker: Option<JoinHandle<Result<Vec<u8>, Error>>>,
    film: Film,
    pushed: u64,
    path: PathBuf,
}

impl VideoWriter {
    /// A film at `path`; the format is that of `film`.
    ///
    /// # Errors
    /// [`Error::Format`] for an unknown suffix; [`Error::FilmSize`],
    /// [`Error::Encode`].
    pub fn create(path: &Path, film: Film) -> Result<VideoWriter, Error> {
        if FilmFormat::of(path).is_none() {
            return Err(Error::Format { known: ENDINGS, path: path.to_owned() });
        }
        film.format.check_size(film.width, film.height)?;
        let (send, receive) = sync_channel::<Picture>(WAITING);
        let worker = std::thread::Builder::new()
            .name("encode".into())
            .spawn(move || {
                let mut stream = FilmStream::new(&film)?;
                for picture in receive {
                    stream.push(&picture)?;
                }
                stream.finish()
            })
            .map_err(|e| Error::Encode { format: "film", reason: e.to_string() })?;
        Ok(VideoWriter {
            pictures: Some(send),
            worker: Some(worker),
            film,
            pushed: 0,
            path: path.to_owned(),
        })
    }

    /// Passes the next frame to the encoder; waits if the encoder is behind.
    ///
    /// # Errors
    /// [`Error::FrameSize`], and any error of the encoder.
    pub fn push(&mut self, picture: Picture) -> Result<(), Error> {
        if (picture.width, picture.height) != (self.film.width, self.film.height) {
            return Err(Error::FrameSize {
                frame: self.pushed,
                got_width: picture.width,
                got_height: picture.height,
                width: self.film.width,
                height: self.film.height,
            });
        }
        let sent = self.pictures.as_ref().is_some_and(|p| p.send(picture).is_ok());
        if !sent {
            return Err(self.join().err().unwrap_or(Error::NoFrames));
        }
        self.pushed += 1;
        Ok(())
    }

    /// Waits for the encoder and puts the file in place.
    ///
    /// # Errors
    /// [`Error::NoFrames`], [`Error::Encode`], [`Error::File`].
    pub fn finish(mut self) -> Result<Written, Error> {
        self.pictures = None;
        if self.pushed == 0 {
            self.join().ok();
            return Err(Error::NoFrames);
        }
        let bytes = self.join()?;
        robert_base::fsio::write_atomic(&self.path, &bytes)?;
        Ok(Written { frames: self.pushed, bytes: bytes.len() as u64, path: self.path.clone() })
    }

    fn join(&mut self) -> Result<Vec<u8>, Error> {
        self.pictures = None;
        let Some(worker) = self.worker.take() else { return Err(Error::NoFrames) };
        worker.join().unwrap_or_else(|_panic| {
            Err(Error::Encode { format: "film", reason: "the encoder panicked".to_owned() })
        })
    }
}

impl Drop for VideoWriter {
    fn drop(&mut self) {
        // An abandoned film leaves no thread behind.
        if self.worker.is_some() {
            self.join().ok();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::tests::film;

    #[test]
    fn frames_must_fit_and_a_film_needs_one() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.mp4");
        let config = Film { format: FilmFormat::Mp4, fps: 20, width: 64, height: 48, frames: 1 };
        let mut w = VideoWriter::create(&path, config).unwrap();
        let wrong = w.push(Picture::filled(10, 10, [0; 3]));
        assert!(matches!(wrong, Err(Error::FrameSize { .. })));
        assert!(matches!(w.finish(), Err(Error::NoFrames)));
        assert!(!path.exists());
        assert!(VideoWriter::create(&dir.path().join("a.avi"), config).is_err());
    }

    #[test]
    fn a_film_is_refused_before_its_first_frame() {
        for (w, h) in [(16, 16), (3840, 2160), (2160, 3840), (640, 480)] {
            FilmFormat::Mp4.check_size(w, h).unwrap();
        }
        for (w, h) in [(15, 64), (1, 1), (3841, 1080), (3846, 1080), (2161, 2161), (8192, 16)] {
            let e = FilmFormat::Mp4.check_size(w, h).unwrap_err();
            assert!(e.to_string().contains(&format!("{w}x{h}")), "{e}");
            FilmFormat::Apng.check_size(w, h).unwrap();
        }
        let film = Film { format: FilmFormat::Mp4, fps: 20, width: 1, height: 1, frames: 1 };
        let dir = tempfile::tempdir().unwrap();
        let made = VideoWriter::create(&dir.path().join("a.mp4"), film);
        assert!(matches!(made, Err(Error::FilmSize { .. })));
    }

    /// The encoder supports all sizes that the check accepts.
    #[test]
    fn the_outermost_sizes_are_encoded() {
        let dir = tempfile::tempdir().unwrap();
        for (width, height) in [(16, 16), (17, 16), (3840, 2160), (2160, 3840)] {
            let path = dir.path().join("a.mp4");
            let film = Film { format: FilmFormat::Mp4, fps: 20, width, height, frames: 1 };
            let mut w = VideoWriter::create(&path, film).unwrap();
            w.push(Picture::filled(width, height, [90, 120, 200])).unwrap();
            assert_eq!(w.finish().unwrap().frames, 1, "{width}x{height}");
        }
    }

    #[test]
    fn every_format_is_written_whole() {
        let dir = tempfile::tempdir().unwrap();
        for (name, format) in
            [("a.mp4", FilmFormat::Mp4), ("a.gif", FilmFormat::Gif), ("a.apng", FilmFormat::Apng)]
        {
            let path = dir.path().join(name);
            let config = Film { format, fps: 20, width: 63, height: 48, frames: 12 };
            let mut w = VideoWriter::create(&path, config).unwrap();
            for p in film(12, 63, 48) {
                w.push(p).unwrap();
            }
            let written = w.finish().unwrap();
            assert_eq!(written.frames, 12);
            assert_eq!(written.bytes, std::fs::metadata(&path).unwrap().len());
        }
    }
}
