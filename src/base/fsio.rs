//! Atomic files: after a crash there is either the old or the new version, never a mixture.
//!
//! The order of operations is: temporary file in the same folder, write, fsync, rename, fsync of
//! the folder. It survives a crash on every journalling file system (Pillai et al., OSDI'14; rename
//! alone may leave an empty file). The new version keeps the mode of the old one and, if the system
//! allows it, its owner. A symbolic link stays a link.
//!
//! Only regular files are read or replaced. A pipe would block its reader for ever, and a device
//! must not become a file. They are refused before they are opened, and again afterwards, in case
//! the name then refers to something else.

use std::collections::BTreeSet;
use std::fs::{self, File, Metadata, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::os::unix::fs::{FileTypeExt, MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use rustix::fs::{FlockOperation, OFlags, flock};
use sha2::{Digest, Sha256};

use crate::exit::{Exit, HasExit};

/// A file operation that failed, with its path.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The file could not be read.
    #[error("cannot read {path}: {source}", path = path.display())]
    Read {
        /// The error of the operating system.
        source: io::Error,
        /// The file.
        path: PathBuf,
    },
    /// The file could not be written; the previous file is unchanged.
    #[error("cannot write {path}: {source}", path = path.display())]
    Write {
        /// The error of the operating system.
        source: io::Error,
        /// The file.
        path: PathBuf,
    },
    /// The file is larger than its limit in [`crate::limits`].
    #[error("{path} has {bytes} bytes; at most {cap} are read", path = path.display())]
    TooLarge {
        /// Its size.
        bytes: u64,
        /// The limit.
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
/// [`Error::Write`]; the old file, if any, is intact and the temporary one removed. If only the folder cannot be
/// synced, the new file is in place, but may be lost in a power cut.
pub fn write_atomic_with(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>,
) -> Result<(), Error> {
    let fail = |source| Error::Write { source, path: path.to_owned() };
    let target = follow_links(path).map_err(fail)?;
    let old = replaceable(&target).map_err(fail)?;
    let dir = folder_of(&target);
    fs::create_dir_all(dir).map_err(fail)?;
    sweep_once(dir);
    let temp = temporary(dir, old.as_ref()).map_err(fail)?;
    let mut out = BufWriter::with_capacity(1 << 20, temp.as_file());
    fill(&mut out).map_err(fail)?;
    out.flush().map_err(fail)?;
    drop(out);
    if let Some(old) = &old {
        keep_mode_and_owner(temp.as_file(), old).map_err(fail)?;
    }
    temp.as_file().sync_all().map_err(fail)?;
    temp.persist(&target).map_err(|e| fail(e.error))?;
    sync_folder(dir).map_err(fail)
}

/// A locked temporary file in `dir`. The lock shows [`sweep`] that it is still being written.
/// A new file gets the mode that the umask leaves it; a replacement is private until it
/// gets the mode of what it replaces.
fn temporary(dir: &Path, old: Option<&Metadata>) -> io::Result<tempfile::NamedTempFile> {
    let mode = if old.is_some() { 0o600 } else { 0o666 };
    let temp = tempfile::Builder::new()
        .prefix(TEMPORARY)
        .permissions(fs::Permissions::from_mode(mode))
        .tempfile_in(dir)
        .map_err(|e| nameless(&e))?;
    flock(temp.as_file(), FlockOperation::NonBlockingLockExclusive)?;
    Ok(temp)
}

/// A file in `dir` with these bytes, which is removed on drop.
///
/// # Errors
/// The error of the operating system, without the file's name.
pub fn temporary_with(dir: &Path, bytes: &[u8]) -> io::Result<tempfile::NamedTempFile> {
    sweep_once(dir);
    let temp = temporary(dir, None)?;
    temp.as_file().write_all(bytes)?;
    Ok(temp)
}

/// The prefix of the names of temporary files and folders. What bears it may be removed without a
/// question, so nobody else would choose it: `.robert-config` may well be somebody's own.
pub const TEMPORARY: &str = ".robert-tmp-";
/// Temporary files that are younger than this may have a writer that has not locked them yet.
const STALE: Duration = Duration::from_mins(1);

/// Removes temporary files and folders that killed processes have left in `dir`.
///
/// What is still being written is kept: a file stays if it is locked or was changed within the last
/// minute. Not every folder is locked, so one stays for a day, and longer if it is locked.
pub fn sweep(dir: &Path) {
    let Ok(entries) = fs::read_dir(dir) else { return };
    for entry in entries.flatten() {
        if !entry.file_name().as_encoded_bytes().starts_with(TEMPORARY.as_bytes()) {
            continue;
        }
        let path = entry.path();
        let Ok(found) = fs::symlink_metadata(&path) else { continue };
        let age = found.modified().ok().and_then(|t| t.elapsed().ok()).unwrap_or_default();
        let free = |opened: io::Result<File>| {
            opened.is_ok_and(|f| flock(&f, FlockOperation::NonBlockingLockExclusive).is_ok())
        };
        if found.is_dir() && age > 1440 * STALE && free(File::open(&path)) {
            fs::remove_dir_all(&path).ok();
        } else if found.is_file() && age > STALE && free(open_regular(&path)) {
            fs::remove_file(&path).ok();
        }
    }
}

/// Sweeps a folder when this process first writes there.
pub(crate) fn sweep_once(dir: &Path) {
    static SWEPT: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    if SWEPT.lock().unwrap_or_else(PoisonError::into_inner).insert(dir.to_owned()) {
        sweep(dir);
    }
}

/// Metadata of the entry at `path`, if a file may replace it; `None` if nothing is there.
fn replaceable(path: &Path) -> io::Result<Option<Metadata>> {
    match fs::symlink_metadata(path) {
        Ok(found) => regular(&found).map(|()| Some(found)),
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(e) => Err(e),
    }
}

/// The end of a chain of symbolic links. The last name need not exist.
fn follow_links(path: &Path) -> io::Result<PathBuf> {
    const LINKS: usize = 40;
    let mut target = path.to_owned();
    for _ in 0..LINKS {
        let is_link = fs::symlink_metadata(&target).is_ok_and(|m| m.is_symlink());
        if !is_link {
            return Ok(target);
        }
        let next = fs::read_link(&target)?;
        // An absolute link replaces the folder.
        target = folder_of(&target).join(next);
    }
    Err(rustix::io::Errno::LOOP.into())
}

/// The file that a path leads to, without links on the way; the file need not exist. A path that leads
/// nowhere stays as it is.
pub fn resolved(path: &Path) -> PathBuf {
    let end = follow_links(path).ok();
    let end =
        end.and_then(|end| Some(fs::canonicalize(folder_of(&end)).ok()?.join(end.file_name()?)));
    end.unwrap_or_else(|| path.to_owned())
}

/// Refuses everything that is not a regular file, with an error that names its kind.
fn regular(found: &Metadata) -> io::Result<()> {
    let kind = found.file_type();
    let what = if kind.is_file() {
        return Ok(());
    } else if kind.is_dir() {
        "a folder"
    } else if kind.is_fifo() {
        "a pipe"
    } else if kind.is_socket() {
        "a socket"
    } else if kind.is_symlink() {
        "a symbolic link"
    } else {
        "a device"
    };
    Err(io::Error::other(format!("it is {what}, not a regular file")))
}

/// Opens a regular file for reading. It never blocks, because pipes and devices are refused.
///
/// # Errors
/// The error of the operating system, or that it is not a regular file.
pub fn open_regular(path: &Path) -> io::Result<File> {
    // Opening some devices has an effect, so they are not even opened.
    regular(&fs::metadata(path)?)?;
    let file = OpenOptions::new().read(true).custom_flags(NONBLOCK).open(path)?;
    regular(&file.metadata()?)?;
    Ok(file)
}

const NONBLOCK: i32 = (OFlags::NONBLOCK.bits() | OFlags::NOCTTY.bits()) as i32;

/// Opens a private file of this program for reading and writing, and creates it (mode 0600) if it
/// does not exist. It never follows a symbolic link and never blocks.
///
/// # Errors
/// The error of the operating system, or that it is not a regular file.
pub fn open_private(path: &Path) -> io::Result<File> {
    if let Ok(found) = fs::symlink_metadata(path) {
        regular(&found)?;
    }
    let file = OpenOptions::new()
        .read(true)
        .write(true)
        .create(true)
        .truncate(false)
        .mode(0o600)
        .custom_flags(NONBLOCK | OFlags::NOFOLLOW.bits() as i32)
        .open(path)?;
    regular(&file.metadata()?)?;
    Ok(file)
}

/// Gives a replacement the mode of the old file, and its owner where the system allows it.
fn keep_mode_and_owner(new: &File, old: &Metadata) -> io::Result<()> {
    let made = new.metadata()?;
    if (made.uid(), made.gid()) != (old.uid(), old.gid()) {
        let uid = rustix::fs::Uid::from_raw(old.uid());
        let gid = rustix::fs::Gid::from_raw(old.gid());
        // Only root can change the owner. A member of a group can set the group.
        if rustix::fs::fchown(new, Some(uid), Some(gid)).is_err() {
            rustix::fs::fchown(new, None, Some(gid)).ok();
        }
    }
    new.set_permissions(fs::Permissions::from_mode(old.mode() & 0o777))
}

/// Checks whether a file could be written at `path`, before its content is computed. It leaves no
/// file behind.
///
/// # Errors
/// [`Error::Write`]: the folder is missing or cannot be written to, or `path` is a folder.
pub fn writable(path: &Path) -> Result<(), Error> {
    let fail = |source| Error::Write { source, path: path.to_owned() };
    let target = follow_links(path).map_err(fail)?;
    replaceable(&target).map_err(fail)?;
    let dir = folder_of(&target);
    if !dir.is_dir() {
        return Err(fail(io::Error::other(format!("there is no folder {}", dir.display()))));
    }
    temporary(dir, None).map(drop).map_err(fail)
}

/// The error of the operating system, without the temporary file's name.
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
    let file = open_regular(path).map_err(fail)?;
    let bytes = file.metadata().map_err(fail)?.len();
    if bytes > cap {
        return Err(Error::TooLarge { bytes, cap, path: path.to_owned() });
    }
    // The length is only a hint (a file may grow), so the limit applies to the read.
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
    let mut file = open_regular(path).map_err(fail)?;
    let mut hash = Sha256::new();
    let mut buf = vec![0_u8; 1 << 16];
    loop {
        let n = io::Read::read(&mut file, &mut buf).map_err(fail)?;
        if n == 0 {
            return Ok(hex(&hash.finalize()));
        }
        hash.update(buf.get(..n).unwrap_or_default());
    }
}

/// The folder for files that this program can make again: `$XDG_CACHE_HOME/robert` or
/// `~/.cache/robert`, else one in the system's temporary folder.
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

/// Syncs the names in a folder to the disk.
///
/// # Errors
/// As the system reports them.
pub fn sync_folder(dir: &Path) -> io::Result<()> {
    File::open(dir)?.sync_all()
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

    fn mode(path: &Path) -> u32 {
        fs::metadata(path).unwrap().mode() & 0o777
    }

    #[test]
    fn a_saved_file_keeps_its_mode_and_a_link_stays_a_link() {
        let dir = tempfile::tempdir().unwrap();
        let (path, link) = (dir.path().join("a"), dir.path().join("link"));
        fs::write(&path, "one").unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
        std::os::unix::fs::symlink("a", &link).unwrap();
        write_atomic(&link, b"two").unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!((fs::read(&path).unwrap(), mode(&path)), (b"two".to_vec(), 0o640));
        // A dangling link names the file to create.
        fs::remove_file(&path).unwrap();
        write_atomic(&link, b"three").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"three");
        // A new file gets the mode that the umask gives any new file.
        fs::write(dir.path().join("usual"), "").unwrap();
        assert_eq!(mode(&path), mode(&dir.path().join("usual")));
        std::os::unix::fs::symlink("loop", dir.path().join("loop")).unwrap();
        assert!(write_atomic(&dir.path().join("loop"), b"x").is_err());
    }

    #[test]
    fn pipes_sockets_and_devices_are_neither_read_nor_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let pipe = dir.path().join("pipe");
        rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, rustix::fs::Mode::RUSR).unwrap();
        let socket = dir.path().join("socket");
        let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        let paths = [&pipe, &socket, Path::new("/dev/null"), Path::new("/dev/zero"), dir.path()];
        for path in paths {
            let kind = fs::metadata(path).unwrap().file_type();
            let refusals = [
                read_capped(path, 10).err(),
                sha256_file(path).err(),
                write_atomic(path, b"x").err(),
                writable(path).err(),
            ];
            for refusal in refusals {
                let text = refusal.expect("it is no regular file").to_string();
                assert!(text.contains("not a regular file"), "{text}");
            }
            assert!(open_private(path).is_err());
            assert_eq!(fs::metadata(path).unwrap().file_type(), kind, "replaced");
        }
        let link = dir.path().join("link");
        std::os::unix::fs::symlink("file", &link).unwrap();
        assert!(open_private(&link).is_err() && !dir.path().join("file").exists());
    }

    #[test]
    fn only_what_nobody_writes_is_swept() {
        let dir = tempfile::tempdir().unwrap();
        let old = std::time::SystemTime::now() - Duration::from_hours(48);
        let make = |name: &str, aged: bool| {
            let file = File::create(dir.path().join(name)).unwrap();
            if aged {
                file.set_modified(old).unwrap();
            }
            file
        };
        make(".robert-tmp-stale", true);
        make(".robert-tmp-new", false);
        make("mine", true);
        make(".robert-config", true);
        let held = make(".robert-tmp-held", true);
        flock(&held, FlockOperation::NonBlockingLockExclusive).unwrap();
        for (name, aged) in [
            (".robert-tmp-import-stale", true),
            (".robert-tmp-import-new", false),
            (".robert-data", true),
        ] {
            let path = dir.path().join(name);
            fs::create_dir(&path).unwrap();
            fs::write(path.join("inside"), "x").unwrap();
            if aged {
                File::open(&path).unwrap().set_modified(old).unwrap();
            }
        }
        sweep(dir.path());
        let mut left: Vec<String> = fs::read_dir(dir.path())
            .unwrap()
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect();
        left.sort();
        let kept = [".robert-config", ".robert-data", "mine"];
        let new = [".robert-tmp-held", ".robert-tmp-import-new", ".robert-tmp-new"];
        assert_eq!(left, [&kept[..2], &new, &kept[2..]].concat());
    }

    #[test]
    fn sha_is_the_standard_one() {
        let empty = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";
        assert_eq!(sha256_hex(b""), empty);
    }
}
