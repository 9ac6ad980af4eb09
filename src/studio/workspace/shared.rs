//! The studio's knowledge of files, shared by session and requests.

use std::path::{Path, PathBuf};

use super::pictures::Pictures;
use super::recent::Recent;
use super::uploads::Uploads;
use crate::protocol::Error;

/// The folder that the studio works in, and the paths of its other files.
#[derive(Debug)]
pub(crate) struct Workspace {
    /// The folder where relative paths start.
    pub(crate) folder: PathBuf,
    /// Journals of unsaved clips, recent files, kept pictures.
    pub(crate) state_dir: PathBuf,
    /// Recent files.
    pub(crate) recent: Recent,
    /// Files that a page has sent.
    pub(crate) uploads: Uploads,
    /// Pictures.
    pub(crate) pictures: Pictures,
}

impl Workspace {
    /// Makes the handles without starting a process. `binary` is this program.
    ///
    /// # Errors
    /// If the operating system cannot start the thread or make a temporary folder.
    pub(crate) fn new(
        folder: PathBuf,
        state_dir: PathBuf,
        binary: PathBuf,
    ) -> std::io::Result<Workspace> {
        let recent = Recent::load(&state_dir);
        let pictures = Pictures::new(binary, &state_dir)?;
        Ok(Workspace { folder, state_dir, recent, uploads: Uploads::new()?, pictures })
    }

    /// A path as the user typed it.
    ///
    /// # Errors
    /// [`Error::Request`] if the text is not a path.
    pub(crate) fn path(&self, typed: &str) -> Result<PathBuf, Error> {
        if typed.is_empty() || typed.contains('\0') {
            return Err(Error::request("this is no path"));
        }
        Ok(self.folder.join(Path::new(typed)))
    }
}
