//! The files of a robot that a page has sent.

use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::protocol::Error;
use robert_base::limits;
use robert_base::scratch::Scratch;

/// The uploaded files of the newest robot.
#[derive(Debug)]
pub(crate) struct Uploads {
    held: Mutex<Held>,
}

/// Uploaded files in a folder of their own. An import that reads them keeps the folder.
#[derive(Debug)]
struct Held {
    dir: Arc<Scratch>,
    bytes: u64,
    files: usize,
}

impl Held {
    fn new() -> std::io::Result<Held> {
        Ok(Held { dir: Arc::new(Scratch::new()?), bytes: 0, files: 0 })
    }
}

impl Uploads {
    /// An empty set of uploads.
    ///
    /// # Errors
    /// If the folder cannot be made.
    pub(crate) fn new() -> std::io::Result<Uploads> {
        Ok(Uploads { held: Mutex::new(Held::new()?) })
    }

    /// The folder of the uploads. It is removed when nobody holds it and other files were sent.
    pub(crate) fn folder(&self) -> Arc<Scratch> {
        Arc::clone(&self.lock().dir)
    }

    fn lock(&self) -> MutexGuard<'_, Held> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Stores a file; `first` begins another robot.
    ///
    /// # Errors
    /// [`Error::Full`], [`Error::Request`], [`Error::Server`].
    pub(crate) fn put(&self, name: &str, first: bool, bytes: &[u8]) -> Result<(), Error> {
        let mut held = self.lock();
        if first {
            *held = Held::new().map_err(Error::Server)?;
        }
        let path = upload_path(held.dir.path(), name)?;
        let (total, files) = (held.bytes + bytes.len() as u64, held.files + 1);
        if total > limits::UPLOAD_BYTES {
            return Err(Error::Full {
                what: "bytes in one robot",
                cap: limits::UPLOAD_BYTES as usize,
            });
        }
        if files > limits::PROJECT_FILES {
            return Err(Error::Full { what: "files in one robot", cap: limits::PROJECT_FILES });
        }
        if let Some(dir) = path.parent() {
            std::fs::create_dir_all(dir).map_err(Error::Server)?;
        }
        std::fs::write(&path, bytes).map_err(Error::Server)?;
        (held.bytes, held.files) = (total, files);
        Ok(())
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
        assert_eq!(std::fs::read_dir(uploads.folder().path()).unwrap().count(), 1);
        uploads.lock().bytes = limits::UPLOAD_BYTES - 2;
        let full = uploads.put("two.stl", false, b"123");
        assert!(matches!(full, Err(Error::Full { what: "bytes in one robot", .. })), "{full:?}");
        uploads.put("three.stl", false, b"12").unwrap();
    }

    #[test]
    fn an_import_keeps_its_files_when_the_next_robot_is_sent() {
        let uploads = Uploads::new().unwrap();
        uploads.put("arm.urdf", true, b"one").unwrap();
        let one = uploads.folder();
        uploads.put("arm.urdf", true, b"two").unwrap();
        assert_eq!(std::fs::read(one.path().join("arm.urdf")).unwrap(), b"one");
        assert_eq!(std::fs::read(uploads.folder().path().join("arm.urdf")).unwrap(), b"two");
        let gone = one.path().to_owned();
        drop(one);
        assert!(!gone.exists());
    }
}
