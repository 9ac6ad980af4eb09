//! The files of a robot that a page has sent.

use std::path::{Component, Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use crate::protocol::Error;
use robert_base::limits;
use robert_base::scratch::Scratch;

/// The uploaded files of a robot: one folder, removed when the studio ends.
#[derive(Debug)]
pub(crate) struct Uploads {
    dir: Scratch,
    held: Mutex<(u64, usize)>,
}

impl Uploads {
    /// An empty set of uploads.
    ///
    /// # Errors
    /// If the folder cannot be made.
    pub(crate) fn new() -> std::io::Result<Uploads> {
        Ok(Uploads { dir: Scratch::new()?, held: Mutex::default() })
    }

    /// The folder of the uploads.
    pub(crate) fn folder(&self) -> &Path {
        self.dir.path()
    }

    /// Stores a file; `first` removes those before.
    ///
    /// # Errors
    /// [`Error::Full`], [`Error::Request`], [`Error::Server`].
    pub(crate) fn put(&self, name: &str, first: bool, bytes: &[u8]) -> Result<(), Error> {
        let path = upload_path(self.folder(), name)?;
        let mut held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        if first {
            *held = (0, 0);
            for entry in std::fs::read_dir(self.folder()).map_err(Error::Server)?.flatten() {
                let old = entry.path();
                let gone = if old.is_dir() {
                    std::fs::remove_dir_all(old)
                } else {
                    std::fs::remove_file(old)
                };
                gone.map_err(Error::Server)?;
            }
        }
        held.0 += bytes.len() as u64;
        held.1 += 1;
        if held.0 > limits::UPLOAD_BYTES {
            return Err(Error::Full {
                what: "bytes in one robot",
                cap: limits::UPLOAD_BYTES as usize,
            });
        }
        if held.1 > limits::PROJECT_FILES {
            return Err(Error::Full { what: "files in one robot", cap: limits::PROJECT_FILES });
        }
        if let Some(dir) = path.parent() {
            std::fs::create_dir_all(dir).map_err(Error::Server)?;
        }
        std::fs::write(&path, bytes).map_err(Error::Server)
    }
}

/// The path of an uploaded file of a robot: below `root`, whatever its name is.
///
/// # Errors
/// [`Error::Request`] for a text that is not a name, or that leaves the folder.
pub(crate) fn upload_path(root: &Path, name: &str) -> Result<PathBuf, Error> {
    let path = Path::new(name);
    let plain = path.components().all(|c| matches!(c, Component::Normal(_)));
    let odd = name.is_empty() || name.len() > limits::NAME_BYTES || name.contains(['\0', '\\']);
    if !plain || odd {
        return Err(Error::request(format!("{name:?} is no file name inside a folder")));
    }
    Ok(root.join(path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uploads_stay_in_their_folder() {
        let root = Path::new("/r");
        assert_eq!(upload_path(root, "a/b.stl").unwrap(), Path::new("/r/a/b.stl"));
        for bad in ["", "..", "../x", "a/../../x", "/etc/passwd", "a\\b", "a\0", "./.."] {
            assert!(upload_path(root, bad).is_err(), "{bad:?}");
        }
        assert!(upload_path(root, &"x".repeat(300)).is_err());
    }

    #[test]
    fn as_much_is_uploaded_as_the_limits_say() {
        let uploads = Uploads::new().unwrap();
        for n in 0..limits::PROJECT_FILES {
            uploads.put(&format!("{n}.stl"), n == 0, b"").unwrap();
        }
        let full = uploads.put("more.stl", false, b"");
        assert!(matches!(full, Err(Error::Full { cap: limits::PROJECT_FILES, .. })), "{full:?}");
        uploads.put("first.stl", true, b"").unwrap();
        assert_eq!(std::fs::read_dir(uploads.folder()).unwrap().count(), 1);
        uploads.held.lock().unwrap().0 = limits::UPLOAD_BYTES - 2;
        uploads.put("two.stl", false, b"12").unwrap();
        let full = uploads.put("three.stl", false, b"3");
        assert!(matches!(full, Err(Error::Full { what: "bytes in one robot", .. })), "{full:?}");
    }
}
