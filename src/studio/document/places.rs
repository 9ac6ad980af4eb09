//! The path of a clip file's journal.

use std::path::{Path, PathBuf};

use crate::document::journal::{Damage, Journal, Record};
use crate::protocol::Error;
use robert_base::fsio;

/// An open journal and what it holds.
pub(super) type Found = (Journal, Vec<Record>, Damage);

pub(crate) fn open_journal(clip: &Path, state_dir: &Path) -> Result<Found, Error> {
    let [beside, elsewhere] = journal_places(clip, state_dir);
    // Opening creates a journal, but must not create the clip's folder.
    if !beside.parent().is_some_and(Path::is_dir) {
        let source = std::io::Error::from(std::io::ErrorKind::NotFound);
        return Err(fsio::Error::Read { source, path: clip.to_owned() }.into());
    }
    match Journal::open(&beside) {
        Err(Error::Journal { source, .. })
            if matches!(
                source.kind(),
                std::io::ErrorKind::PermissionDenied | std::io::ErrorKind::ReadOnlyFilesystem
            ) =>
        {
            std::fs::create_dir_all(state_dir)
                .map_err(|source| Error::Journal { source, path: elsewhere.clone() })?;
            Journal::open(&elsewhere)
        }
        other => other,
    }
}

/// Whether two paths lead to the same file, or would if it were there.
pub(crate) fn is_same_file(a: &Path, b: &Path) -> bool {
    a == b || fsio::resolved(a) == fsio::resolved(b)
}

/// The possible paths of a clip file's journal: beside it, or in the state folder if its own folder
/// cannot be written. A file has one journal, whichever link leads to it.
pub(super) fn journal_places(clip: &Path, state_dir: &Path) -> [PathBuf; 2] {
    let clip = fsio::resolved(clip);
    let mut name = clip.file_name().unwrap_or_default().to_owned();
    name.push(".autosave");
    let hash = fsio::sha256_hex(clip.as_os_str().as_encoded_bytes());
    let short = hash.get(..16).unwrap_or(&hash);
    [clip.with_file_name(&name), state_dir.join(format!("{short}.autosave"))]
}
