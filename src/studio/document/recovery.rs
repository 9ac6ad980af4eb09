//! Journals of documents that are not open: drafts, and documents of a killed studio.

use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use super::content::Document;
use super::opening::steps;
use super::places::{Found, journal_places, open_journal};
use crate::document::journal::{Damage, Journal, Record};
use crate::protocol::{Draft, Error};
use robert_base::fsio;
use robert_clip::{Clip, Editor, JointTable};

/// The number of attempts to open a draft that seems to be in use, and the time between two.
const LOCK_TRIES: u32 = 10;

const LOCK_PAUSE: Duration = Duration::from_millis(20);

/// The journal of a clip that is not open anywhere.
struct Waiting {
    journal: Journal,
    records: Vec<Record>,
    damage: Damage,
}

impl Document {
    /// The newest unsaved clip that was open in a killed studio, if there is one. Clips that a
    /// studio closed by itself are among the drafts.
    pub(crate) fn orphan(
        state_dir: &Path,
        mut table: impl FnMut(&Clip) -> Option<JointTable>,
    ) -> Option<Document> {
        // It is opened only once. A journal that is closed and reopened at once can seem to be in
        // use, because a child process that is starting holds its lock until it has loaded its own
        // program.
        let abandoned = Self::waiting(state_dir).into_iter().filter(|(draft, _)| draft.abandoned);
        // One that cannot be read stays among the drafts.
        abandoned.map(|(_, waiting)| waiting).find_map(|Waiting { journal, records, damage }| {
            Document::from_journal(journal, &records, damage, &mut table).ok()
        })
    }

    /// Opens a clip file if a studio was killed with it open; `None` if not.
    ///
    /// # Errors
    /// As [`Document::open`].
    pub(crate) fn left_open(
        path: &Path,
        state_dir: &Path,
        table: impl FnOnce(&Clip) -> Option<JointTable>,
    ) -> Result<Option<Document>, Error> {
        let path = std::path::absolute(path)
            .map_err(|source| fsio::Error::Read { source, path: path.to_owned() })?;
        if !path.is_file() || !journal_places(&path, state_dir).iter().any(|j| j.is_file()) {
            return Ok(None);
        }
        // Opened once: see `orphan`.
        let found = open_journal(&path, state_dir)?;
        if found.1.is_empty() && found.2 == Damage::default() {
            found.0.remove();
            return Ok(None);
        }
        if found.1.last() == Some(&Record::Closed) {
            return Ok(None);
        }
        Document::from_file(path, found, table).map(Some)
    }

    /// Clips that were never saved and are not open anywhere, the newest first. Journals without an
    /// edit are removed.
    pub(crate) fn drafts(state_dir: &Path) -> Vec<Draft> {
        // A search holds the journals' locks: of two searches at once, each would miss some
        // journals.
        static LOOKING: Mutex<()> = Mutex::new(());
        let _one = LOOKING.lock().unwrap_or_else(PoisonError::into_inner);
        Self::waiting(state_dir).into_iter().map(|(draft, _)| draft).collect()
    }

    fn waiting(state_dir: &Path) -> Vec<(Draft, Waiting)> {
        let Ok(found) = std::fs::read_dir(state_dir) else { return Vec::new() };
        let number = |path: &Path| -> Option<u32> {
            path.file_name()?
                .to_str()?
                .strip_prefix("untitled-")?
                .strip_suffix(".autosave")?
                .parse()
                .ok()
        };
        let mut list: Vec<(Duration, (Draft, Waiting))> = found
            .filter_map(|e| e.ok().map(|e| e.path()))
            .filter_map(|path| {
                let number = number(&path)?;
                let changed = std::fs::metadata(&path).and_then(|m| m.modified()).ok()?;
                let (journal, records, damage) = Journal::open(&path).ok()?;
                let whole = damage == Damage::default();
                if whole && matches!(records.as_slice(), [Record::Base { path: None, .. }]) {
                    journal.remove();
                    return None;
                }
                let clip = drafted(&records, &damage)?;
                // A clock that was wrong may have dated it before 1970.
                let since = changed.duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
                let draft = Draft {
                    number,
                    name: clip.name.clone(),
                    robot: clip.robot.id.clone(),
                    keys: clip.keys.len(),
                    changed_secs: since.as_secs(),
                    abandoned: records.last() != Some(&Record::Closed),
                };
                Some((since, (draft, Waiting { journal, records, damage })))
            })
            .collect();
        // Finer than the displayed seconds, because numbers are used again.
        list.sort_by_key(|(since, (d, _))| std::cmp::Reverse((*since, d.number)));
        list.into_iter().map(|(_, draft)| draft).collect()
    }

    /// Opens an unsaved clip again.
    ///
    /// # Errors
    /// [`Error::NotFound`], [`Error::Locked`] when it is open elsewhere, [`Error::Journal`].
    pub(crate) fn draft(
        state_dir: &Path,
        number: u32,
        table: impl FnOnce(&Clip) -> Option<JointTable>,
    ) -> Result<Document, Error> {
        let (journal, records, damage) = draft_journal(state_dir, number)?;
        let mut document = Document::from_journal(journal, &records, damage, table)?;
        if records.last() == Some(&Record::Closed) {
            document.taken_up();
        }
        Ok(document)
    }

    /// Discards an unsaved clip.
    ///
    /// # Errors
    /// As [`Document::draft`].
    pub(crate) fn drop_draft(state_dir: &Path, number: u32) -> Result<(), Error> {
        draft_journal(state_dir, number)?.0.remove();
        Ok(())
    }
}

/// The journal of an unsaved clip.
fn draft_journal(state_dir: &Path, number: u32) -> Result<Found, Error> {
    let path = state_dir.join(format!("untitled-{number}.autosave"));
    if !path.is_file() {
        return Err(Error::NotFound { what: format!("unsaved clip {number}") });
    }
    // A search for drafts may still hold the lock: see `orphan`.
    let mut tries = 0;
    loop {
        match Journal::open(&path) {
            Err(Error::Locked { .. }) if tries < LOCK_TRIES => tries += 1,
            opened => return opened,
        }
        std::thread::sleep(LOCK_PAUSE);
    }
}

/// The clip that results from the records of a draft; the journal stays as it is.
fn drafted(records: &[Record], damage: &Damage) -> Option<Clip> {
    let Some(Record::Base { text, path: None }) = records.first() else { return None };
    Editor::replayed(&Clip::parse(text).ok()?, &steps(records), damage.lost.is_empty()).ok()
}
