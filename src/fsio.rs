//! Files that are either the old or the new version, never something between.
//!
//! Temporary file in the same folder, write, fsync, rename, fsync of the folder: the
//! order that survives a crash on every journalling file system (Pillai et al., OSDI'14;
//! rename alone may leave an empty file).

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use crate::exit::{Exit, HasExit};

/// A file operation that failed, with its path.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The file could not be read.
    #[error("cannot read {path}: {source}", path = path.display())]
    Read {
        /// What the system said.
        source: io::Error,
        /// The file.
        path: PathBuf,
    },
    /// The file could not be written; what stood there before is untouched.
    #[error("cannot write {path}: {source}", path = path.display())]
    Write {
        /// What the system said.
        source: io::Error,
        /// The file.
        path: PathBuf,
    },
    /// The file is larger than its cap in [`crate::limits`].
    #[error("{path} has {bytes} bytes, more than the {cap} that are read", path = path.display())]
    TooLarge {
        /// Its size.
        bytes: u64,
        /// The cap.
        cap: u64,
        /// The file.
        path: PathBuf,
    },
}

impl HasExit for Error {
    fn exit(&self) -> Exit {
        match self {
            Error::Read { .. } | Error::TooLarge { .. } => Exit::Invalid,
            Error::Write { .. } => Exit::Failed,
        }
    }
}

/// Writes `path` atomically: `fill` gets a buffered writer; nothing is visible at `path`
/// until all of it is on disk.
///
/// # Errors
/// [`Error::Write`]; the old file, if any, is intact and the temporary one removed.
pub fn write_atomic_with(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>,
) -> Result<(), Error> {
    let fail = |source| Error::Write { source, path: path.to_owned() };
    let dir = folder_of(path);
    fs::create_dir_all(dir).map_err(fail)?;
    let temp = tempfile::Builder::new().prefix(".robert-").tempfile_in(dir);
    let temp = temp.map_err(|e| fail(nameless(&e)))?;
    let mut out = BufWriter::with_capacity(1 << 20, temp.as_file());
    fill(&mut out).map_err(fail)?;
    out.flush().map_err(fail)?;
    drop(out);
    publish_mode(temp.as_file()).map_err(fail)?;
    temp.as_file().sync_all().map_err(fail)?;
    temp.persist(path).map_err(|e| fail(e.error))?;
    sync_folder(dir).map_err(fail)
}

/// Whether a file could be written at `path`, found out before what it will hold is made.
/// Nothing is left behind.
///
/// # Errors
/// [`Error::Write`]: the folder is missing or cannot be written to, or `path` is a folder.
pub fn writable(path: &Path) -> Result<(), Error> {
    let fail = |source| Error::Write { source, path: path.to_owned() };
    let dir = folder_of(path);
    if path.is_dir() {
        return Err(fail(io::Error::other("it is a folder")));
    }
    if !dir.is_dir() {
        return Err(fail(io::Error::other(format!("there is no folder {}", dir.display()))));
    }
    let probe = tempfile::Builder::new().prefix(".robert-").tempfile_in(dir);
    probe.map(drop).map_err(|e| fail(nameless(&e)))
}

/// What the system said, without the temporary file's name.
fn nameless(e: &io::Error) -> io::Error {
    io::Error::from(e.kind())
}

/// Writes these bytes atomically.
///
/// # Errors
/// [`Error::Write`].
pub fn write_atomic(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    write_atomic_with(path, |out| out.write_all(bytes))
}

/// Reads a whole file of at most `cap` bytes.
///
/// # Errors
/// [`Error::Read`], [`Error::TooLarge`].
pub fn read_capped(path: &Path, cap: u64) -> Result<Vec<u8>, Error> {
    use io::Read;
    let fail = |source| Error::Read { source, path: path.to_owned() };
    let file = File::open(path).map_err(fail)?;
    let bytes = file.metadata().map_err(fail)?.len();
    if bytes > cap {
        return Err(Error::TooLarge { bytes, cap, path: path.to_owned() });
    }
    // The length is only a hint (a pipe or a growing file says 0): the cap binds the read.
    let mut buf = Vec::with_capacity(bytes as usize);
    file.take(cap + 1).read_to_end(&mut buf).map_err(fail)?;
    if buf.len() as u64 > cap {
        return Err(Error::TooLarge { bytes: buf.len() as u64, cap, path: path.to_owned() });
    }
    Ok(buf)
}

/// Sha-256 of these bytes as 64 hex digits.
pub fn sha256_hex(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

/// Sha-256 of a file, read in pieces.
///
/// # Errors
/// [`Error::Read`].
pub fn sha256_file(path: &Path) -> Result<String, Error> {
    let fail = |source| Error::Read { source, path: path.to_owned() };
    let mut file = File::open(path).map_err(fail)?;
    let mut hash = Sha256::new();
    let mut buf = vec![0_u8; 1 << 20];
    loop {
        let n = io::Read::read(&mut file, &mut buf).map_err(fail)?;
        if n == 0 {
            return Ok(hex(&hash.finalize()));
        }
        hash.update(buf.get(..n).unwrap_or_default());
    }
}

/// Where this program may keep what it can make again: `$XDG_CACHE_HOME/robert` or
/// `~/.cache/robert`, a folder under the system's temporary one as a last resort.
pub fn cache_dir() -> PathBuf {
    let set = |name| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    set("XDG_CACHE_HOME")
        .or_else(|| set("HOME").map(|h| h.join(".cache")))
        .unwrap_or_else(std::env::temp_dir)
        .join("robert")
}

fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write as _;
    bytes.iter().fold(String::with_capacity(64), |mut s, b| {
        write!(s, "{b:02x}").ok();
        s
    })
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    }
}

fn sync_folder(dir: &Path) -> io::Result<()> {
    File::open(dir)?.sync_all()
}

/// Temporary files are private; a finished file gets the usual 0644 less the umask's share.
fn publish_mode(file: &File) -> io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    file.set_permissions(fs::Permissions::from_mode(0o644))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replaces_whole_or_not_at_all() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("deep/a.txt");
        write_atomic(&path, b"one").unwrap();
        let failed = write_atomic_with(&path, |out| {
            out.write_all(b"half")?;
            Err(io::Error::other("no space"))
        });
        assert!(matches!(failed, Err(Error::Write { .. })));
        assert_eq!(fs::read(&path).unwrap(), b"one");
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1, "temporary left");
        write_atomic(&path, b"two").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
    }

    #[test]
    fn cap_binds() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("b");
        write_atomic(&path, &[7; 10]).unwrap();
        assert_eq!(read_capped(&path, 10).unwrap().len(), 10);
        assert!(matches!(read_capped(&path, 9), Err(Error::TooLarge { bytes: 10, cap: 9, .. })));
    }

    #[test]
    fn sha_is_the_standard_one() {
        let empty = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";
        assert_eq!(sha256_hex(b""), empty);
    }
}
