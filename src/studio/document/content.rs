//! The open document: clip, history, journal, file.
//!
//! It is plain and synchronous, and the writer's thread is its only owner. Every change is in the
//! journal before it is reported to anyone. After a save the journal contains only the saved text,
//! because earlier edits are in the file.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::places::{is_same_file, open_journal};
use super::replayed::Replayed;
use crate::document::journal::{Journal, Record};
use crate::protocol::{Error, Restored};
use robert_base::fsio;
use robert_clip as clip;
use robert_clip::{Batch, Change, Clip, Command, Delta, Editor, Op, Version};

/// One request of a client to the document.
#[derive(Clone, Debug)]
pub(crate) enum Edit {
    /// A clip operation.
    Op(Box<Op>),
    /// Takes the last edit back.
    Undo,
    /// Does it again.
    Redo,
    /// Undoes or redoes until this many edits are done.
    Goto(usize),
}

/// A clip with its history, journal and file.
#[derive(Debug)]
pub(crate) struct Document {
    pub(super) editor: Editor,
    pub(super) journal: Journal,
    pub(super) path: Option<PathBuf>,
    /// The saved file: its content, and its exact bytes, so that an undone edit gives the same file
    /// again even if its author wrote it in another layout.
    pub(super) saved: Clip,
    pub(super) saved_text: Arc<str>,
    /// Whether the clip was never saved and is worth keeping, such as a new clip.
    pub(super) untitled: bool,
    pub(super) restored: Option<Restored>,
    /// Whether redo is refused. After a failed journal write the edit was undone and must not be
    /// redone, since the journal does not contain it.
    pub(super) redo_blocked: bool,
    pub(super) replayed: Replayed,
}

/// A step of the history.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Done {
    Edit,
    Undo,
    Redo,
}

impl Document {
    /// From now on the next start does not reopen this document after a kill.
    pub(crate) fn put_aside(&mut self) {
        self.mark(Record::Closed);
    }

    /// From now on the next start reopens this document after a kill.
    pub(crate) fn taken_up(&mut self) {
        self.mark(Record::Opened);
    }

    pub(super) fn mark(&mut self, record: Record) {
        if let Err(e) = self.journal.append(&[record]) {
            tracing::warn!("what the next start takes up may be wrong: {e}");
        }
    }

    pub(super) fn base(&self) -> Record {
        Record::Base { text: self.saved_text.to_string(), path: self.path.clone() }
    }

    /// The clip.
    pub(crate) fn clip(&self) -> &Clip {
        self.editor.clip()
    }

    /// The clip, compiled.
    pub(crate) fn command(&self) -> &Command {
        self.editor.command()
    }

    /// The version of now.
    pub(crate) fn version(&self) -> Version {
        self.editor.version()
    }

    /// Its file.
    pub(crate) fn path(&self) -> Option<&Path> {
        self.path.as_deref()
    }

    /// The number of edits, and how many are done.
    pub(crate) fn history(&self) -> (usize, usize) {
        self.editor.history()
    }

    /// The names of these edits, oldest first.
    pub(crate) fn labels(&self, edits: std::ops::Range<usize>) -> Vec<String> {
        self.editor.labels(edits)
    }

    /// Whether anything would be lost without the journal.
    pub(crate) fn is_dirty(&self) -> bool {
        self.editor.clip() != &self.saved
    }

    /// What was recovered when the document was opened.
    pub(crate) fn restored(&self) -> Option<&Restored> {
        self.restored.as_ref()
    }

    /// The content of the file, or the initial content of a clip without a file.
    pub(crate) fn saved_text(&self) -> Arc<str> {
        Arc::clone(&self.saved_text)
    }

    /// The text that saving would write.
    pub(crate) fn text(&self) -> String {
        if self.is_dirty() { self.clip().to_text() } else { self.saved_text.to_string() }
    }

    /// Carries out several requests, perhaps of different clients, with one `fdatasync`. Each gets
    /// its answer. If the journal fails, all successful ones are taken back and get that error.
    pub(crate) fn edit(&mut self, edits: &[Edit]) -> Vec<Result<Vec<Change>, Error>> {
        let mut records = Vec::new();
        let mut steps = Vec::new();
        let replayed = self.replayed;
        let mut answers: Vec<Result<Vec<Change>, Error>> = Vec::with_capacity(edits.len());
        for edit in edits {
            answers.push(self.one(edit, &mut records, &mut steps));
        }
        if records.is_empty() {
            return answers;
        }
        if let Err(error) = self.journal.append(&records) {
            self.take_back(&steps);
            self.replayed = replayed;
            let text = match error {
                // The path and what was not done are said by each answer itself.
                Error::Journal { source, .. } => source.to_string(),
                other => other.to_string(),
            };
            for answer in &mut answers {
                if answer.as_ref().is_ok_and(|changes| !changes.is_empty()) {
                    let source = std::io::Error::other(text.clone());
                    *answer = Err(Error::Journal { source, path: self.journal.path().to_owned() });
                }
            }
        }
        answers
    }

    pub(super) fn one(
        &mut self,
        edit: &Edit,
        records: &mut Vec<Record>,
        steps: &mut Vec<Done>,
    ) -> Result<Vec<Change>, Error> {
        match edit {
            Edit::Op(op) => {
                let change = self.editor.apply(op)?;
                if change.patch.is_empty() {
                    return Ok(Vec::new());
                }
                self.redo_blocked = false;
                self.replayed.push();
                steps.push(Done::Edit);
                records.push(written_out(&change));
                Ok(vec![change])
            }
            Edit::Undo => {
                let change = self.editor.undo()?;
                if let Some(change) = &change {
                    let known = self.replayed.undo();
                    steps.push(Done::Undo);
                    records.push(if known { Record::Undo } else { written_out(change) });
                }
                Ok(change.into_iter().collect())
            }
            Edit::Redo if self.redo_blocked => Ok(Vec::new()),
            Edit::Redo => {
                let change = self.editor.redo()?;
                if let Some(change) = &change {
                    let known = self.replayed.redo();
                    steps.push(Done::Redo);
                    records.push(if known { Record::Redo } else { written_out(change) });
                }
                Ok(change.into_iter().collect())
            }
            Edit::Goto(done) => {
                let before = (self.clip().clone(), self.command().clone());
                let mut steps_made = 0;
                let mut last = None;
                loop {
                    let now = self.editor.history().1;
                    let step = match now.cmp(done) {
                        std::cmp::Ordering::Greater => self.one(&Edit::Undo, records, steps),
                        std::cmp::Ordering::Less => self.one(&Edit::Redo, records, steps),
                        std::cmp::Ordering::Equal => break,
                    };
                    let step = match step {
                        // The steps so far are made, and clients must hear of them.
                        Err(_) if steps_made > 0 => break,
                        step => step?,
                    };
                    let Some(step) = step.into_iter().next() else { break };
                    steps_made += 1;
                    last = Some(step);
                }
                let Some(last) = last else { return Ok(Vec::new()) };
                if steps_made == 1 {
                    return Ok(vec![last]);
                }
                // To a client, hundreds of steps are one change.
                Ok(vec![Change {
                    rev: last.rev,
                    label: format!("Go to edit {done}"),
                    patch: Delta::between(&before.0, self.clip()),
                    first_changed_frame: self.command().first_changed_frame(&before.1),
                    first_changed_step: self.command().first_changed_step(&before.1),
                }])
            }
        }
    }

    pub(super) fn take_back(&mut self, steps: &[Done]) {
        for step in steps.iter().rev() {
            let done = match step {
                Done::Edit | Done::Redo => self.editor.undo(),
                Done::Undo => self.editor.redo(),
            };
            // An inverse of an edit that was just valid is valid; the clip stands either way.
            done.ok();
            self.redo_blocked |= *step == Done::Edit;
        }
    }

    /// Writes the file, under a new name if one is given.
    ///
    /// # Errors
    /// [`Error::Untitled`], [`Error::Exists`] and [`Error::Changed`] unless `replace`, [`Error::File`],
    /// [`Error::Locked`], [`Error::Journal`].
    pub(crate) fn save(
        &mut self,
        to: Option<&Path>,
        replace: bool,
        state_dir: &Path,
    ) -> Result<(), Error> {
        let target = match to {
            Some(p) => std::path::absolute(p)
                .map_err(|source| fsio::Error::Write { source, path: p.to_owned() })?,
            None => self.path.clone().ok_or(Error::Untitled)?,
        };
        let text = self.text();
        let moved = !self.path.as_deref().is_some_and(|own| is_same_file(own, &target));
        if moved && !replace && target.exists() {
            return Err(Error::Exists { path: target });
        }
        if !moved && !replace && self.is_changed_on_disk(&target) {
            return Err(Error::Changed { path: target });
        }
        let journal = if moved { Some(journal_of(&target, state_dir)?) } else { None };
        if let Err(e) = fsio::write_atomic(&target, text.as_bytes()) {
            if let Some((journal, true)) = journal {
                journal.remove();
            }
            return Err(e.into());
        }
        if let Some((journal, _)) = journal {
            std::mem::replace(&mut self.journal, journal).remove();
        }
        self.path = Some(target);
        self.saved = self.clip().clone();
        self.saved_text = text.into();
        self.untitled = false;
        self.restored = None;
        self.rebase()
    }

    /// Whether the file differs from what was last read or written here. A deleted file has no
    /// content that saving would overwrite.
    fn is_changed_on_disk(&self, path: &Path) -> bool {
        match fsio::read_capped(path, robert_base::limits::CLIP_BYTES) {
            Ok(bytes) => bytes != self.saved_text.as_bytes(),
            Err(fsio::Error::Read { source, .. }) => source.kind() != std::io::ErrorKind::NotFound,
            Err(_) => true,
        }
    }

    /// Replaces the content by that of the file as it is now, as an edit.
    ///
    /// # Errors
    /// [`Error::Untitled`], [`Error::Clip`] with path:line:col, [`Error::Request`] when the file
    /// is of another robot, and those of [`Document::edit`].
    pub(crate) fn reload(&mut self) -> Result<Vec<Change>, Error> {
        let path = self.path.clone().ok_or(Error::Untitled)?;
        let bytes = fsio::read_capped(&path, robert_base::limits::CLIP_BYTES)?;
        let text = String::from_utf8_lossy(&bytes).into_owned();
        let read = clip::parse_bytes(bytes).map_err(|e| e.in_file(&path))?.clip;
        if !self.takes_content_of(&read) {
            let what = "the file has another robot or other extensions now; close it and open it";
            return Err(Error::request(what));
        }
        let patch = Delta::between(self.clip(), &read);
        let mut changes = Vec::new();
        if !patch.is_empty() {
            let op = relabelled("Read the file again", &patch);
            changes = self.edit(&[Edit::Op(Box::new(op))]).pop().unwrap_or(Ok(changes))?;
        }
        self.saved = read;
        self.saved_text = text.into();
        self.restored = None;
        self.rebase()?;
        Ok(changes)
    }

    /// Whether edits can turn the clip into this one: they change neither robot nor extensions.
    pub(crate) fn takes_content_of(&self, other: &clip::Clip) -> bool {
        other.robot == self.clip().robot && other.x == self.clip().x
    }

    /// Restarts the journal from the saved content.
    pub(super) fn rebase(&mut self) -> Result<(), Error> {
        self.journal.rewrite(&[self.base()])?;
        self.replayed = Replayed::default();
        Ok(())
    }

    /// Discards the unsaved edits of a restored document.
    ///
    /// # Errors
    /// As [`Document::edit`].
    pub(crate) fn discard(&mut self) -> Result<Vec<Change>, Error> {
        let patch = Delta::between(self.clip(), &self.saved);
        self.restored = None;
        if patch.is_empty() {
            return Ok(Vec::new());
        }
        let op = relabelled("Discard unsaved changes", &Box::new(patch));
        self.edit(&[Edit::Op(Box::new(op))]).pop().unwrap_or_else(|| Ok(Vec::new()))
    }

    /// Closes the document. Unsaved edits stay in the journal, which records that this was no kill.
    /// Without unsaved edits the journal is removed.
    pub(crate) fn close(mut self) {
        let keep = if self.untitled { self.editor.history().1 > 0 } else { self.is_dirty() };
        if keep {
            self.put_aside();
        } else {
            self.journal.remove();
        }
    }
}

/// The journal of another clip file, which this document will replace, and whether it is new.
fn journal_of(target: &Path, state_dir: &Path) -> Result<(Journal, bool), Error> {
    let (mut journal, records, _) = open_journal(target, state_dir)?;
    let is_edit = |r: &Record| matches!(r, Record::Edit { .. } | Record::Undo | Record::Redo);
    if records.iter().any(is_edit) {
        if target.exists() {
            return Err(Error::request(format!(
                "{} has edits that are not saved; open it and save or discard them, or choose another name",
                target.display()
            )));
        }
        // Its clip is gone, so nobody can open it.
        journal.keep()?;
    }
    Ok((journal, records.is_empty()))
}

pub(super) fn invalid(e: clip::Invalid) -> Error {
    Error::Op(e.into())
}

pub(super) fn written_out(change: &Change) -> Record {
    Record::Edit { label: change.label.clone(), patch: Box::new(change.patch.clone()) }
}

pub(super) fn relabelled(label: &str, patch: &Delta) -> Op {
    Op::Batch(Batch { label: label.to_owned(), ops: vec![Op::Patch(Box::new(patch.clone()))] })
}
