//! Folders for files that are needed only while this process runs.

use std::fs::File;
use std::io;
use std::path::Path;

use rustix::fs::{FlockOperation, flock};

use crate::fsio;

/// A folder in the system's folder for temporary files, removed on drop. It is locked where the file
/// system allows it, so that [`fsio::sweep`] can tell it from one that a killed process has left.
#[derive(Debug)]
pub struct Scratch {
    folder: tempfile::TempDir,
    _lock: File,
}

impl Scratch {
    /// An empty folder. The first one of a process also removes what killed processes have left.
    ///
    /// # Errors
    /// The error of the operating system.
    pub fn new() -> io::Result<Scratch> {
        Scratch::within(&std::env::temp_dir())
    }

    fn within(parent: &Path) -> io::Result<Scratch> {
        fsio::sweep_once(parent);
        let prefix = format!("{}scratch-", fsio::TEMPORARY);
        let folder = tempfile::Builder::new().prefix(&prefix).tempdir_in(parent)?;
        let lock = File::open(folder.path())?;
        // Without a lock it may be swept once nothing has been written into it for a day.
        flock(&lock, FlockOperation::NonBlockingLockExclusive).ok();
        Ok(Scratch { folder, _lock: lock })
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{Duration, SystemTime};

    #[test]
    fn what_a_killed_process_left_is_swept_and_what_is_in_use_stays() {
        let parent = tempfile::tempdir().unwrap();
        let used = Scratch::within(parent.path()).unwrap();
        let left = parent.path().join(format!("{}scratch-left", fsio::TEMPORARY));
        std::fs::create_dir(&left).unwrap();
        let old = SystemTime::now() - Duration::from_hours(48);
        for folder in [used.path(), &left] {
            std::fs::write(folder.join("file"), "").unwrap();
            File::open(folder).unwrap().set_modified(old).unwrap();
        }
        fsio::sweep(parent.path());
        assert!(used.path().join("file").exists() && !left.exists());
        let path = used.path().to_owned();
        drop(used);
        assert!(!path.exists());
    }
}
