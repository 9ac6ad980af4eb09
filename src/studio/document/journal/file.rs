//! The file of a journal.

use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::ops::{Deref, DerefMut};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::{fs, io};

use rustix::fs::{FlockOperation, flock};

use super::record::{Damage, Record};
use super::scan::{MAGIC, Position, Scan, scan};
use crate::protocol::Error;
use robert_base::fsio;
use robert_base::limits;

/// An open, locked journal.
#[derive(Debug)]
pub(crate) struct Journal {
    file: Locked,
    path: PathBuf,
    /// The length of the part that is known to be complete.
    len: u64,
    /// The position of the next record among all.
    position: Position,
}

impl Journal {
    /// Opens (or creates) a journal, locks it, and reads its content. A damaged one stays as it is
    /// until [`Journal::repair`], which must be called before anything else is written.
    ///
    /// # Errors
    /// [`Error::Locked`] when another process has it, [`Error::NotAJournal`] when something
    /// else has its name (which is left as it is), [`Error::Journal`].
    pub(crate) fn open(path: &Path) -> Result<(Journal, Vec<Record>, Damage), Error> {
        let fail = |source| Error::Journal { source, path: path.to_owned() };
        let foreign = |what: String| Error::NotAJournal { what, path: path.to_owned() };
        let file = lock(path)?;
        let len = file.metadata().map_err(fail)?.len();
        if len > limits::JOURNAL_BYTES {
            return Err(foreign(format!("it has {len} bytes")));
        }
        let mut bytes = Vec::with_capacity(len as usize);
        (&file.0).take(limits::JOURNAL_BYTES).read_to_end(&mut bytes).map_err(fail)?;
        let Scan { records, damage, position } =
            scan(&bytes).ok_or_else(|| foreign("it holds something else".into()))?;
        Ok((Journal { file, path: path.to_owned(), len, position }, records, damage))
    }

    /// Removes damage from the file. A copy of the file as it was found is kept beside it.
    ///
    /// # Errors
    /// [`Error::Journal`].
    pub(crate) fn repair(&mut self, records: &[Record], damage: &mut Damage) -> Result<(), Error> {
        if *damage == Damage::default() {
            return Ok(());
        }
        let kept = self.keep()?;
        let path = self.path.display();
        tracing::warn!("{path}: {}; kept as {}", damage.words(), kept.display());
        damage.kept = Some(kept);
        self.rewrite(records)
    }

    /// The path of the journal.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Bytes in it.
    #[cfg(test)]
    pub(crate) fn bytes(&self) -> u64 {
        self.len
    }

    /// Appends records, all of them or none, and returns when they are on disk.
    ///
    /// # Errors
    /// [`Error::Journal`].
    pub(crate) fn append(&mut self, records: &[Record]) -> Result<(), Error> {
        let fail = |source| Error::Journal { source, path: self.path.clone() };
        let mut bytes = if self.len == 0 { MAGIC.to_vec() } else { Vec::new() };
        let mut position = self.position;
        for record in records {
            position.encode(record, &mut bytes).map_err(fail)?;
        }
        if self.len + bytes.len() as u64 > limits::JOURNAL_BYTES {
            return Err(fail(io::Error::other("the journal is full; save the clip")));
        }
        let written = self.file.write_all(&bytes).and_then(|()| self.file.sync_data());
        if let Err(source) = written {
            // A half-written record must not stand before the next one.
            let error = Error::Journal { source, path: self.path.clone() };
            self.cut().ok();
            return Err(error);
        }
        self.position = position;
        self.len += bytes.len() as u64;
        Ok(())
    }

    /// Replaces the content by these records, atomically.
    ///
    /// # Errors
    /// [`Error::Journal`]; the old content stands then.
    pub(crate) fn rewrite(&mut self, records: &[Record]) -> Result<(), Error> {
        let fail = |source| Error::Journal { source, path: self.path.clone() };
        let mut bytes = MAGIC.to_vec();
        let mut position = Position::default();
        for record in records {
            position.encode(record, &mut bytes).map_err(fail)?;
        }
        let dir = folder(&self.path);
        let mut temp =
            tempfile::Builder::new().prefix(fsio::TEMPORARY).tempfile_in(dir).map_err(fail)?;
        temp.as_file_mut().write_all(&bytes).map_err(fail)?;
        temp.as_file().sync_all().map_err(fail)?;
        // It is locked before it gets its name, so that it is never unlocked under that name.
        flock(temp.as_file(), FlockOperation::NonBlockingLockExclusive)
            .map_err(|e| fail(e.into()))?;
        self.file = Locked(temp.persist(&self.path).map_err(|e| fail(e.error))?);
        self.len = bytes.len() as u64;
        self.position = position;
        self.file.seek(SeekFrom::End(0)).map_err(fail)?;
        File::open(dir).and_then(|d| d.sync_all()).map_err(fail)
    }

    /// Removes the file when its content is no longer needed.
    pub(crate) fn remove(self) {
        fs::remove_file(&self.path).ok();
    }

    /// Empties the file, and keeps a copy of its content.
    ///
    /// # Errors
    /// [`Error::Journal`].
    pub(crate) fn set_aside(&mut self) -> Result<PathBuf, Error> {
        let kept = self.keep()?;
        self.rewrite(&[])?;
        Ok(kept)
    }

    /// Keeps a copy of its content.
    ///
    /// # Errors
    /// [`Error::Journal`].
    pub(crate) fn keep(&mut self) -> Result<PathBuf, Error> {
        let fail = |source| Error::Journal { source, path: self.path.clone() };
        let mut bytes = Vec::new();
        self.file.seek(SeekFrom::Start(0)).map_err(fail)?;
        (&self.file.0).take(limits::JOURNAL_BYTES).read_to_end(&mut bytes).map_err(fail)?;
        self.file.seek(SeekFrom::Start(self.len)).map_err(fail)?;
        keep(&self.path, &bytes).map_err(fail)
    }

    fn cut(&mut self) -> io::Result<()> {
        self.file.set_len(self.len)?;
        self.file.seek(SeekFrom::Start(self.len))?;
        self.file.sync_data()
    }
}

/// A locked file. Closing it would not be enough: a process that is being started has a copy of every
/// open file for a moment, and the lock would last as long.
#[derive(Debug)]
struct Locked(File);

impl Deref for Locked {
    type Target = File;

    fn deref(&self) -> &File {
        &self.0
    }
}

impl DerefMut for Locked {
    fn deref_mut(&mut self) -> &mut File {
        &mut self.0
    }
}

impl Drop for Locked {
    fn drop(&mut self) {
        // Closing it follows in any case.
        flock(&self.0, FlockOperation::Unlock).ok();
    }
}

/// The file at `path`, opened and locked.
fn lock(path: &Path) -> Result<Locked, Error> {
    let fail = |source: io::Error| match fs::symlink_metadata(path) {
        Ok(found) if !found.is_file() => {
            Error::NotAJournal { what: source.to_string(), path: path.to_owned() }
        }
        _ => Error::Journal { source, path: path.to_owned() },
    };
    // Another process may replace or remove the file between open and lock.
    for _ in 0..16 {
        let file = fsio::open_private(path).map_err(fail)?;
        let file = match flock(&file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => Locked(file),
            Err(rustix::io::Errno::WOULDBLOCK) => {
                return Err(Error::Locked { path: path.to_owned() });
            }
            Err(e) => return Err(fail(e.into())),
        };
        let same = fs::symlink_metadata(path)
            .and_then(|there| Ok(there.ino() == file.metadata()?.ino()))
            .unwrap_or(false);
        if same {
            return Ok(file);
        }
    }
    Err(Error::Locked { path: path.to_owned() })
}

/// Keeps these bytes beside the journal, in a new file.
fn keep(path: &Path, bytes: &[u8]) -> io::Result<PathBuf> {
    const COPIES: u32 = 1000;
    for n in 1..COPIES {
        let mut name = path.file_name().unwrap_or_default().to_owned();
        name.push(if n == 1 { ".damaged".to_owned() } else { format!(".damaged-{n}") });
        let kept = path.with_file_name(name);
        match OpenOptions::new().write(true).create_new(true).mode(0o600).open(&kept) {
            Ok(mut file) => {
                file.write_all(bytes)?;
                file.sync_all()?;
                return Ok(kept);
            }
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
            Err(e) => return Err(e),
        }
    }
    Err(io::Error::other(format!("there are {COPIES} damaged copies of it already")))
}

fn folder(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use super::super::scan::MARK;
    use super::*;
    use robert_clip::Delta;

    fn sample() -> Vec<Record> {
        let patch = Delta { name: Some("wave".into()), ..Delta::default() };
        vec![
            Record::Base { text: "{}".into(), path: None },
            Record::Edit { label: "Rename".into(), patch: Box::new(patch) },
            Record::Undo,
            Record::Redo,
        ]
    }

    fn open(path: &Path) -> (Journal, Vec<Record>, Damage) {
        Journal::open(path).unwrap()
    }

    #[test]
    fn a_closed_journal_is_free_while_a_starting_process_has_a_copy_of_its_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.autosave");
        let (mut journal, _, _) = open(&path);
        let copy = journal.file.try_clone().unwrap();
        assert!(matches!(Journal::open(&path), Err(Error::Locked { .. })));
        journal.rewrite(&sample()).unwrap();
        let rewritten = journal.file.try_clone().unwrap();
        drop(journal);
        assert_eq!(open(&path).1.len(), 4);
        drop((copy, rewritten));
    }

    #[test]
    fn a_journal_that_is_too_long_is_neither_read_nor_continued() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.autosave");
        let (mut journal, _, _) = open(&path);
        journal.append(&sample()[..1]).unwrap();
        let bytes = fs::metadata(&path).unwrap().len();
        journal.append(&sample()[1..2]).unwrap();
        let edit = fs::metadata(&path).unwrap().len() - bytes;
        journal.len = limits::JOURNAL_BYTES - edit;
        journal.append(&sample()[1..2]).unwrap();
        assert!(journal.append(&sample()[2..3]).is_err());
        drop(journal);
        // Sparse: it takes no room.
        let file = fs::File::options().write(true).open(&path).unwrap();
        file.set_len(limits::JOURNAL_BYTES + 1).unwrap();
        assert!(matches!(Journal::open(&path), Err(Error::NotAJournal { .. })));
        assert_eq!(fs::metadata(&path).unwrap().len(), limits::JOURNAL_BYTES + 1);
    }

    #[test]
    fn a_damaged_tail_is_cut_and_kept_and_writing_goes_on() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.autosave");
        let (mut journal, none, _) = open(&path);
        assert!(none.is_empty());
        journal.append(&sample()[..2]).unwrap();
        drop(journal);
        let mut bytes = fs::read(&path).unwrap();
        bytes.extend_from_slice(&MARK);
        bytes.extend_from_slice(&[9, 0]);
        fs::write(&path, &bytes).unwrap();
        let (mut journal, records, mut damage) = open(&path);
        assert_eq!((records.len(), damage.torn_bytes), (2, 6));
        assert_eq!(fs::read(&path).unwrap(), bytes, "reading changes nothing");
        journal.repair(&records, &mut damage).unwrap();
        assert_eq!(fs::read(damage.kept.unwrap()).unwrap(), bytes);
        journal.append(&sample()[2..]).unwrap();
        assert!(matches!(Journal::open(&path), Err(Error::Locked { .. })));
        drop(journal);
        let (_, records, damage) = open(&path);
        assert_eq!((records, damage), (sample(), Damage::default()));
    }

    #[test]
    fn rewriting_keeps_the_lock() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.autosave");
        let (mut journal, ..) = open(&path);
        journal.append(&sample()).unwrap();
        journal.rewrite(&sample()[..1]).unwrap();
        assert!(matches!(Journal::open(&path), Err(Error::Locked { .. })));
        journal.append(&sample()[2..3]).unwrap();
        drop(journal);
        let (journal, records, _) = open(&path);
        assert_eq!(records, [sample()[0].clone(), Record::Undo]);
        journal.remove();
        assert!(!path.exists());
    }

    #[test]
    fn what_is_no_journal_of_ours_is_left_as_it_is() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        fs::write(at("victim"), "precious").unwrap();
        std::os::unix::fs::symlink("victim", at("link")).unwrap();
        std::os::unix::fs::symlink("nothing", at("dangling")).unwrap();
        std::os::unix::fs::symlink("/dev/zero", at("endless")).unwrap();
        rustix::fs::mkfifoat(rustix::fs::CWD, at("pipe"), rustix::fs::Mode::RUSR).unwrap();
        fs::create_dir(at("folder")).unwrap();
        for name in ["victim", "link", "dangling", "endless", "pipe", "folder"] {
            let e = Journal::open(&at(name)).unwrap_err();
            assert!(matches!(e, Error::NotAJournal { .. }), "{name}: {e}");
        }
        assert_eq!(fs::read(at("victim")).unwrap(), b"precious");
        assert!(!at("nothing").exists());
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 6, "nothing was made");
    }
}
