//! The result of a writer, and writing it to disk.

use std::path::{Path, PathBuf};
use std::{fs, io};

use rustix::fs::{CWD, RenameFlags, renameat_with};

use super::super::error::Error;
use robert_base::fsio;

/// One file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct File {
    /// The path below the output; empty if the output is this single file.
    pub name: String,
    /// Its content.
    pub bytes: Vec<u8>,
}

/// A folder that belongs to the export alone.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Folder {
    /// Path below the output; empty for the output itself.
    pub path: String,
    /// A file that every export of the format contains: a folder with it may be replaced.
    pub marker: &'static str,
}

/// The files of one format.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Export {
    /// All of them.
    pub files: Vec<File>,
    /// The folder that the files form, if they do.
    pub folder: Option<Folder>,
    /// Frames (rows, points) in them.
    pub frames: usize,
    /// The meaning of the numbers: units, order, rate, losses. One sentence each.
    pub meaning: Vec<String>,
    /// The command that opens it; [`Export::OUT`] stands for the path.
    pub open: String,
}

impl Export {
    /// Represents the path of the output in [`Export::open`].
    pub const OUT: &str = "{out}";

    /// An export that is one file.
    pub fn single(bytes: Vec<u8>, frames: usize, open: impl Into<String>) -> Export {
        let files = vec![File { name: String::new(), bytes }];
        Export { files, folder: None, frames, meaning: Vec::new(), open: open.into() }
    }

    /// Adds a sentence about the meaning of the numbers.
    #[must_use]
    pub fn says(mut self, sentence: impl Into<String>) -> Export {
        self.meaning.push(sentence.into());
        self
    }

    /// Bytes of all files.
    pub fn bytes(&self) -> usize {
        self.files.iter().map(|f| f.bytes.len()).sum()
    }

    /// Writes everything below `out`, completely or not at all, and returns the paths. A folder of
    /// an earlier export is replaced; any other folder with content is left alone.
    ///
    /// # Errors
    /// [`Error::Occupied`], [`Error::File`].
    pub fn write(&self, out: &Path) -> Result<Vec<PathBuf>, Error> {
        let Some(folder) = &self.folder else {
            for file in &self.files {
                fsio::write_atomic(out, &file.bytes)?;
            }
            return Ok(vec![out.to_owned()]);
        };
        let target = below(out, &folder.path);
        let failed = |path: &Path| {
            let path = path.to_owned();
            move |source| Error::File(fsio::Error::Write { source, path })
        };
        let parent = match target.parent() {
            Some(p) if !p.as_os_str().is_empty() => p.to_owned(),
            _ => PathBuf::from("."),
        };
        let taken = target.read_dir().is_ok_and(|mut d| d.next().is_some()) || target.is_file();
        if taken && !target.join(folder.marker).is_file() {
            return Err(Error::Occupied { marker: folder.marker, path: target });
        }
        std::fs::create_dir_all(&parent).map_err(failed(&target))?;
        // It is beside the target, so that the last step is a rename.
        let fresh = tempfile::Builder::new()
            .prefix(&format!("{}export-", fsio::TEMPORARY))
            .tempdir_in(&parent)
            .map_err(failed(&target))?;
        let mut paths = Vec::with_capacity(self.files.len());
        for file in &self.files {
            let inside = file.name.strip_prefix(&folder.path).map(|n| n.trim_start_matches('/'));
            let path = match inside {
                Some(name) => fresh.path().join("new").join(name),
                // Beside the folder: the marks of a namespace.
                None => below(out, &file.name),
            };
            // Messages name the path that the user gave, not the temporary one.
            let place = below(out, &file.name);
            if let Some(dir) = path.parent() {
                std::fs::create_dir_all(dir).map_err(failed(&place))?;
            }
            fsio::write_atomic(&path, &file.bytes).map_err(|e| match e {
                fsio::Error::Write { source, .. } => failed(&place)(source),
                other => Error::File(other),
            })?;
            paths.push(place);
        }
        put_in_place(fresh.path(), &target).map_err(failed(&target))?;
        // What was there before is removed only now.
        fsio::sync_folder(&parent).map_err(failed(&target))?;
        Ok(paths)
    }
}

/// Renames `fresh/new` to `target`. An older entry of that name is removed with `fresh`, but only
/// once the new folder is in place.
fn put_in_place(fresh: &Path, target: &Path) -> io::Result<()> {
    let (new, old) = (fresh.join("new"), fresh.join("old"));
    if !target.exists() {
        return fs::rename(new, target);
    }
    // Both names are exchanged at once: a kill between two renames would leave neither.
    if renameat_with(CWD, &new, CWD, target, RenameFlags::EXCHANGE).is_ok() {
        return Ok(());
    }
    // Not every file system can.
    fs::rename(target, &old)?;
    fs::rename(new, target).inspect_err(|_| drop(fs::rename(&old, target)))
}

fn below(out: &Path, name: &str) -> PathBuf {
    if name.is_empty() { out.to_owned() } else { out.join(name) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn export(path: &str, names: &[&str]) -> Export {
        let file = |n: &&str| File { name: (*n).to_owned(), bytes: n.as_bytes().to_vec() };
        let mut made = Export::single(Vec::new(), 1, "");
        made.files = names.iter().map(file).collect();
        made.folder = Some(Folder { path: path.to_owned(), marker: "mark" });
        made
    }

    #[test]
    fn a_folder_is_replaced_whole_and_strangers_are_left_alone() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("set");
        let paths = export("", &["mark", "a/b"]).write(&out).unwrap();
        assert_eq!(paths, [out.join("mark"), out.join("a/b")]);
        export("", &["mark", "c"]).write(&out).unwrap();
        assert!(out.join("c").is_file() && !out.join("a").exists());
        let mine = dir.path().join("mine");
        std::fs::create_dir(&mine).unwrap();
        std::fs::write(mine.join("thesis"), "x").unwrap();
        let e = export("", &["mark"]).write(&mine).unwrap_err();
        assert!(matches!(e, Error::Occupied { .. }) && mine.join("thesis").is_file());
        // Nothing is left behind.
        let left: Vec<_> = dir.path().read_dir().unwrap().map(|e| e.unwrap().file_name()).collect();
        assert_eq!(left.len(), 2, "{left:?}");
    }

    #[test]
    fn files_beside_the_folder_stay_where_they_are() {
        let dir = tempfile::tempdir().unwrap();
        let made = export("space/set", &["space/meta", "space/set/mark", "space/set/x"]);
        made.write(dir.path()).unwrap();
        made.write(dir.path()).unwrap();
        for name in ["space/meta", "space/set/mark", "space/set/x"] {
            assert!(dir.path().join(name).is_file(), "{name}");
        }
    }
}
