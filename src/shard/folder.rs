//! Temporary folders beside a shard's place, and the rename that publishes them.
//!
//! Everything is written to `.tmp-INDEX-HOST-PID-RANDOM` in the same folder, synced, and renamed.
//! A rename is atomic within a file system. There are no locks: on many network file systems they
//! are local or hang.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use robert_base::fsio;

use super::error::write_error;
use super::{Error, Manifest};

/// The prefix of the names of temporary folders.
const TEMPORARY: &str = ".tmp-";
/// The number of attempts to publish into a place where other processes publish too.
const TRIES: usize = 5;

/// A temporary folder for this index in `parent`, removed on drop.
pub(super) fn temporary(parent: &Path, index: usize) -> Result<tempfile::TempDir, Error> {
    fs::create_dir_all(parent).map_err(write_error(parent))?;
    sweep(parent, index);
    let prefix = format!("{TEMPORARY}{index:06}-{}-{}-", host(), std::process::id());
    tempfile::Builder::new().prefix(&prefix).tempdir_in(parent).map_err(write_error(parent))
}

/// Removes what killed processes of this machine have left of this index.
fn sweep(parent: &Path, index: usize) {
    let mine = format!("{TEMPORARY}{index:06}-{}-", host());
    for entry in fs::read_dir(parent).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let Some(rest) = name.strip_prefix(&mine) else { continue };
        let pid = rest.split('-').next().and_then(|p| p.parse().ok());
        let Some(pid) = pid.and_then(rustix::process::Pid::from_raw) else { continue };
        if rustix::process::test_kill_process(pid) == Err(rustix::io::Errno::SRCH) {
            fs::remove_dir_all(entry.path()).ok();
        }
    }
}

/// The host's name with plain characters only.
pub(super) fn host() -> String {
    let uname = rustix::system::uname();
    let name = uname.nodename().to_string_lossy();
    name.chars().filter(char::is_ascii_alphanumeric).take(32).collect()
}

/// Writes a manifest into `made` and renames the folder to `target`. A complete shard with the same
/// content at `target` stays; a damaged or foreign one is replaced.
///
/// # Errors
/// [`Error::Differs`] for other content from the same kind of machine, [`Error::Files`].
pub(super) fn publish(made: &Path, target: &Path, manifest: &Manifest) -> Result<(), Error> {
    let file = made.join(super::manifest::FILE);
    fs::write(&file, manifest.text()).map_err(write_error(&file))?;
    sync(made).map_err(write_error(made))?;
    let parent = target.parent().unwrap_or(Path::new("."));
    let mut last = None;
    for _ in 0..TRIES {
        match fs::rename(made, target) {
            Ok(()) => {
                File::open(parent).and_then(|f| f.sync_all()).map_err(write_error(parent))?;
                return Ok(());
            }
            Err(e) => last = Some(e),
        }
        // Another process was here first, or a network file system repeated a rename that had
        // succeeded. The files show which.
        if !target.exists() {
            continue;
        }
        match whole(target) {
            Ok(found) if found == *manifest => return Ok(()),
            Ok(found) if same_machine(&found, manifest) => {
                let other = aside(made, parent, "differs")?;
                return Err(Error::Differs {
                    index: manifest.index,
                    path: target.to_owned(),
                    other,
                });
            }
            Ok(_) | Err(_) => replace(target, parent, manifest)?,
        }
    }
    let source = last.unwrap_or_else(|| io::Error::other("the place is taken"));
    Err(fsio::Error::Write { source, path: target.to_owned() }.into())
}

fn same_machine(a: &Manifest, b: &Manifest) -> bool {
    (&a.numerics, &a.binary_sha256) == (&b.numerics, &b.binary_sha256)
}

/// The manifest of a folder whose files all match it.
///
/// # Errors
/// What is wrong.
pub(super) fn whole(dir: &Path) -> Result<Manifest, String> {
    let manifest = Manifest::read(dir)?;
    for f in &manifest.files {
        let path = dir.join(&f.path);
        let bytes = fs::metadata(&path).map_err(|e| format!("{}: {e}", f.path))?.len();
        if bytes != f.bytes {
            return Err(format!("{} has {bytes} bytes, not {}", f.path, f.bytes));
        }
        if fsio::sha256_file(&path).map_err(|e| e.to_string())? != f.sha256 {
            return Err(format!("{} was altered", f.path));
        }
    }
    Ok(manifest)
}

/// Moves a damaged or foreign shard away. If it turns out to be a good one that another process has
/// just published, it is moved back.
fn replace(target: &Path, parent: &Path, manifest: &Manifest) -> Result<(), Error> {
    let moved = match aside(target, parent, "replaced") {
        Ok(moved) => moved,
        // Another process was faster.
        Err(_) if !target.exists() => return Ok(()),
        Err(e) => return Err(e),
    };
    if whole(&moved).is_ok_and(|found| found == *manifest) && fs::rename(&moved, target).is_ok() {
        return Ok(());
    }
    fs::remove_dir_all(&moved).map_err(write_error(&moved))
}

/// Renames a folder to a unique name in `parent`.
fn aside(from: &Path, parent: &Path, why: &str) -> Result<PathBuf, Error> {
    let name = from.file_name().unwrap_or_default().to_string_lossy();
    let name = name.trim_start_matches('.').to_owned();
    let to = parent.join(format!(".{why}-{name}-{}-{}", host(), std::process::id()));
    fs::rename(from, &to).map_err(write_error(from))?;
    Ok(to)
}

/// Writes the whole file system of `dir` to disk. For ten thousand files it takes a hundredth of the
/// time of a call for each.
pub(super) fn sync_all(dir: &Path) -> io::Result<()> {
    #[cfg(target_os = "linux")]
    return Ok(rustix::fs::syncfs(File::open(dir)?)?);
    #[cfg(not(target_os = "linux"))]
    sync(dir)
}

/// Syncs all files and folders in `dir`.
pub(super) fn sync(dir: &Path) -> io::Result<()> {
    for entry in fs::read_dir(dir)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            sync(&entry.path())?;
        } else {
            File::open(entry.path())?.sync_all()?;
        }
    }
    File::open(dir)?.sync_all()
}

/// Copies all files of a folder.
pub(super) fn copy(from: &Path, to: &Path) -> Result<(), Error> {
    fs::create_dir_all(to).map_err(write_error(to))?;
    let unreadable = |source| fsio::Error::Read { source, path: from.to_owned() };
    for entry in fs::read_dir(from).map_err(unreadable)? {
        let entry = entry.map_err(unreadable)?;
        let (a, b) = (entry.path(), to.join(entry.file_name()));
        if entry.file_type().map_err(unreadable)?.is_dir() {
            copy(&a, &b)?;
        } else {
            fs::copy(&a, &b).map_err(write_error(&b))?;
        }
    }
    Ok(())
}

/// A hard link to a file, or a copy where that is asked for or the file system has no links.
pub(super) fn link_file(from: &Path, to: &Path, copy: bool) -> Result<(), Error> {
    if copy || fs::hard_link(from, to).is_err() {
        fs::copy(from, to).map_err(write_error(to))?;
    }
    Ok(())
}
