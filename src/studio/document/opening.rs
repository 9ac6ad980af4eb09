//! Makes a document: from a file, from a journal, or new.

use std::path::{Path, PathBuf};

use super::content::{Document, invalid};
use super::places::{Found, open_journal};
use super::replayed::Replayed;
use crate::document::journal::{Damage, Journal, Record};
use crate::protocol::{Error, Restored};
use robert_base::fsio;
use robert_clip as clip;
use robert_clip::{Clip, Editor, JointTable, Step};

impl Restored {
    fn of(edits: usize, file_changed: bool, damage: Damage) -> Restored {
        let Damage { torn_bytes, lost, kept } = damage;
        Restored { edits, torn_bytes, lost, kept, file_changed }
    }
}

impl Document {
    /// A document before its journal is replayed. Without a path it is untitled.
    fn at(
        path: Option<PathBuf>,
        editor: Editor,
        journal: Journal,
        saved: Clip,
        saved_text: String,
    ) -> Document {
        Document {
            editor,
            journal,
            untitled: path.is_none(),
            path,
            saved,
            saved_text: saved_text.into(),
            restored: None,
            redo_blocked: false,
            replayed: Replayed::default(),
        }
    }

    /// Opens a clip file and applies the journal beside it.
    ///
    /// # Errors
    /// [`Error::Clip`] with path:line:col, [`Error::Locked`], [`Error::Journal`].
    pub(crate) fn open(
        path: &Path,
        state_dir: &Path,
        table: impl FnOnce(&Clip) -> Option<JointTable>,
    ) -> Result<Document, Error> {
        let path = std::path::absolute(path)
            .map_err(|source| fsio::Error::Read { source, path: path.to_owned() })?;
        let found = open_journal(&path, state_dir)?;
        Document::from_file(path, found, table)
    }

    pub(super) fn from_file(
        path: PathBuf,
        (mut journal, records, mut damage): Found,
        table: impl FnOnce(&Clip) -> Option<JointTable>,
    ) -> Result<Document, Error> {
        let text = fsio::read_capped(&path, robert_base::limits::CLIP_BYTES);
        let on_disk = match text {
            Ok(bytes) => clip::parse_bytes(bytes.clone())
                .map(|p| (p.clip, String::from_utf8_lossy(&bytes).into_owned()))
                .map_err(|e| Error::from(e.in_file(&path))),
            Err(e) => Err(e.into()),
        };
        journal.repair(&records, &mut damage)?;
        let edits = edits(&records);
        let base = match (records.first(), &on_disk) {
            // Nothing of the journal is in use, and another program has changed the file.
            (Some(Record::Base { text, .. }), Ok((_, found)))
                if text != found && damage.lost.is_empty() && all_undone(&records) =>
            {
                None
            }
            (Some(Record::Base { text, .. }), _) if edits > 0 => Some(text.clone()),
            // Both copies of the base are damaged: the content is that of the file.
            (Some(_), Ok((_, text))) if edits > 0 => Some(text.clone()),
            _ => None,
        };
        // A base that is not a valid clip is useless, and must not prevent opening the file.
        let start = match base {
            Some(text) => match Clip::parse(&text) {
                Ok(start) => Some((start, text)),
                Err(e) if on_disk.is_ok() => {
                    damage.lost.push(format!("the journal's text is no clip ({e})"));
                    damage.kept = Some(journal.set_aside()?);
                    None
                }
                Err(e) => return Err(e.in_file(journal.path()).into()),
            },
            None => None,
        };
        let Some((start, base)) = start else {
            // Nothing unsaved: the file is the document.
            let (saved, saved_text) = match on_disk {
                Ok(found) => found,
                Err(e) => {
                    journal.remove();
                    return Err(e);
                }
            };
            let editor = Editor::new(saved.clone(), table(&saved)).map_err(invalid)?;
            let mut document = Document::at(Some(path), editor, journal, saved, saved_text);
            document.rebase()?;
            if damage != Damage::default() {
                document.restored = Some(Restored::of(0, false, damage));
            }
            return Ok(document);
        };
        let file_changed = on_disk.as_ref().map_or(true, |(_, text)| *text != base);
        let editor = Editor::new(start.clone(), table(&start)).map_err(invalid)?;
        let (saved, saved_text) = match on_disk {
            Ok(found) if file_changed => found,
            _ => (start, base),
        };
        let mut document = Document::at(Some(path), editor, journal, saved, saved_text);
        document.replay(&records, &mut damage)?;
        document.restored = document.recovered(&records, file_changed, damage);
        if records.last() == Some(&Record::Closed) {
            document.taken_up();
        }
        Ok(document)
    }

    /// What came back without the user's knowledge. Who closed a clip knows of its unsaved edits, but
    /// not that another program has changed the file since.
    fn recovered(
        &self,
        records: &[Record],
        file_changed: bool,
        damage: Damage,
    ) -> Option<Restored> {
        let is_known = records.last() == Some(&Record::Closed) && !file_changed;
        let is_news = self.is_dirty() && !is_known;
        let edits = self.history().1;
        (is_news || damage != Damage::default()).then(|| Restored::of(edits, file_changed, damage))
    }

    /// A document without a file, journalled in the state folder.
    ///
    /// # Errors
    /// [`Error::Journal`], [`Error::Clip`].
    pub(crate) fn new(
        clip: Clip,
        state_dir: &Path,
        table: Option<JointTable>,
    ) -> Result<Document, Error> {
        std::fs::create_dir_all(state_dir)
            .map_err(|source| fsio::Error::Write { source, path: state_dir.to_owned() })?;
        for number in 1..10_000 {
            let path = state_dir.join(format!("untitled-{number}.autosave"));
            match Journal::open(&path) {
                Ok((journal, records, damage)) if records.is_empty() && damage.lost.is_empty() => {
                    let saved_text = clip.to_text();
                    let editor = Editor::new(clip, table).map_err(invalid)?;
                    let saved = editor.clip().clone();
                    let mut document = Document::at(None, editor, journal, saved, saved_text);
                    document.rebase()?;
                    return Ok(document);
                }
                Ok(_) | Err(Error::Locked { .. } | Error::NotAJournal { .. }) => {}
                Err(e) => return Err(e),
            }
        }
        Err(Error::Full { what: "unsaved clips", cap: 10_000 })
    }

    pub(super) fn from_journal(
        mut journal: Journal,
        records: &[Record],
        mut damage: Damage,
        table: impl FnOnce(&Clip) -> Option<JointTable>,
    ) -> Result<Document, Error> {
        let Some(Record::Base { text, path: None }) = records.first() else {
            return Err(Error::NotFound { what: "an unsaved clip in this journal".into() });
        };
        let start = Clip::parse(text).map_err(Error::from)?;
        journal.repair(records, &mut damage)?;
        let facts = table(&start);
        let editor = Editor::new(start.clone(), facts).map_err(invalid)?;
        let mut document = Document::at(None, editor, journal, start, text.clone());
        document.replay(records, &mut damage)?;
        document.restored = document.recovered(records, false, damage);
        Ok(document)
    }

    /// Replays the history. After damage the journal is written again, so that the journal and the
    /// document continue from the same steps.
    pub(super) fn replay(&mut self, records: &[Record], damage: &mut Damage) -> Result<(), Error> {
        let steps = steps(records);
        self.replayed = Replayed::of(&steps);
        let skipped = self.editor.replay(&steps, damage.lost.is_empty())?;
        for number in &skipped {
            let what = "leans on what was lost, and is lost too";
            damage.lost.push(format!("edit {} {what}", number + 1));
        }
        if !damage.lost.is_empty() {
            self.write_anew()?;
        }
        Ok(())
    }

    /// Writes the steps from the saved content to the current one into the journal.
    pub(super) fn write_anew(&mut self) -> Result<(), Error> {
        let (len, done) = self.editor.history();
        let mut records = vec![self.base()];
        records.extend((0..len).filter_map(|i| {
            let (label, patch) = self.editor.recorded(i)?;
            Some(Record::Edit { label, patch: Box::new(patch) })
        }));
        records.extend((done..len).map(|_| Record::Undo));
        self.journal.rewrite(&records)?;
        self.replayed = Replayed { done, len, apart: false };
        Ok(())
    }
}

/// The steps of the history that the records contain.
pub(super) fn steps(records: &[Record]) -> Vec<Step> {
    let step = |record: &Record| match record {
        Record::Base { .. } | Record::Closed | Record::Opened => None,
        Record::Edit { label, patch } => {
            Some(Step::Edit { label: label.clone(), patch: patch.clone() })
        }
        Record::Undo => Some(Step::Undo),
        Record::Redo => Some(Step::Redo),
    };
    records.iter().filter_map(step).collect()
}

/// Edits, undos and redos among the records.
pub(super) fn edits(records: &[Record]) -> usize {
    let counts = |r: &&Record| matches!(r, Record::Edit { .. } | Record::Undo | Record::Redo);
    records.iter().filter(counts).count()
}

/// Whether the content that the records lead to is that of their base.
fn all_undone(records: &[Record]) -> bool {
    let Replayed { done, apart, .. } = Replayed::of(&steps(records));
    done == 0 && !apart
}
