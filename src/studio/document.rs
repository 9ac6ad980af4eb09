//! The open document: clip, history, journal, file.
//!
//! Plain and synchronous; the session's thread is its only owner. Every change goes to the
//! journal before anyone hears of it. Saving rewrites the journal to the saved text
//! alone: what is on disk needs no second copy.

mod waiting;

use std::path::{Path, PathBuf};

use self::waiting::open_journal;
use super::error::Error;
use super::journal::{Damage, Journal, Record};
use crate::clip::{self, Batch, Change, Clip, Command, Delta, Editor, JointTable, Op, Step};
use crate::fsio;

/// What a start from a journal brought back.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Restored {
    /// Edits that had not been saved.
    pub edits: usize,
    /// Bytes of a torn record at the end, never acknowledged, that were dropped.
    pub torn_bytes: u64,
    /// What was damaged and could not be brought back, in words.
    pub lost: Vec<String>,
    /// Where the damaged journal is kept.
    pub kept: Option<PathBuf>,
    /// The file was changed by others since: saving overwrites that.
    pub file_changed: bool,
}

/// One thing that a client asks of the document.
#[derive(Clone, Debug)]
pub enum Edit {
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
pub struct Document {
    editor: Editor,
    journal: Journal,
    path: Option<PathBuf>,
    /// What the file holds: content, and its very bytes, so that an undone edit gives the
    /// same file again even where its author wrote it in another layout.
    saved: Clip,
    saved_text: String,
    /// Never saved, and not empty of value: a new clip.
    untitled: bool,
    restored: Option<Restored>,
    /// After a failed journal write the taken-back edit must not be redone: the journal
    /// does not know it.
    redo_blocked: bool,
    replayed: Replayed,
}

/// What was done to the history.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Done {
    Edit,
    Undo,
    Redo,
}

/// The history that a replay of the journal would have. It is shorter than the true one
/// after a save, and what it lacks must be written out as an edit.
#[derive(Clone, Copy, Debug, Default)]
struct Replayed {
    done: usize,
    len: usize,
    /// An undo went back beyond it; from there on the two histories do not match.
    apart: bool,
}

impl Replayed {
    fn push(&mut self) {
        self.done += 1;
        self.len = self.done;
    }

    fn undo(&mut self) -> bool {
        let known = !self.apart && self.done > 0;
        if known {
            self.done -= 1;
        } else {
            self.apart = true;
            self.push();
        }
        known
    }

    fn redo(&mut self) -> bool {
        let known = !self.apart && self.done < self.len;
        if known {
            self.done += 1;
        } else {
            self.push();
        }
        known
    }
}

/// An open journal and what it holds.
type Found = (Journal, Vec<Record>, Damage);

impl Restored {
    fn of(edits: usize, damage: Damage) -> Restored {
        let Damage { torn_bytes, lost, kept } = damage;
        Restored { edits, torn_bytes, lost, kept, file_changed: false }
    }
}

impl Document {
    /// Opens a clip file, with what a journal beside it has on top.
    ///
    /// # Errors
    /// [`Error::Clip`] with path:line:col, [`Error::Locked`], [`Error::Journal`].
    pub fn open(
        path: &Path,
        state_dir: &Path,
        table: impl FnOnce(&Clip) -> Option<JointTable>,
    ) -> Result<Document, Error> {
        let path = std::path::absolute(path)
            .map_err(|source| fsio::Error::Read { source, path: path.to_owned() })?;
        let found = open_journal(&path, state_dir)?;
        Document::from_file(path, found, table)
    }

    fn from_file(
        path: PathBuf,
        (mut journal, records, mut damage): Found,
        table: impl FnOnce(&Clip) -> Option<JointTable>,
    ) -> Result<Document, Error> {
        let text = fsio::read_capped(&path, crate::limits::CLIP_BYTES);
        let on_disk = match text {
            Ok(bytes) => clip::parse_bytes(bytes.clone())
                .map(|p| (p.clip, String::from_utf8_lossy(&bytes).into_owned()))
                .map_err(|e| Error::from(e.in_file(&path))),
            Err(e) => Err(e.into()),
        };
        journal.repair(&records, &mut damage)?;
        let edits = edits(&records);
        let base = match (records.first(), &on_disk) {
            (Some(Record::Base { text, .. }), _) if edits > 0 => Some(text.clone()),
            // Both copies of the base are damaged: the file is what it was, if nobody else
            // has written it.
            (Some(_), Ok((_, text))) if edits > 0 => Some(text.clone()),
            _ => None,
        };
        // A base that is no clip is of no use, and must not keep the file from being opened.
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
            let mut document = Document {
                editor,
                journal,
                path: Some(path),
                saved,
                saved_text,
                untitled: false,
                restored: None,
                redo_blocked: false,
                replayed: Replayed::default(),
            };
            document.rebase()?;
            if damage != Damage::default() {
                document.restored = Some(Restored::of(0, damage));
            }
            return Ok(document);
        };
        let file_changed = on_disk.as_ref().map_or(true, |(_, text)| *text != base);
        let editor = Editor::new(start.clone(), table(&start)).map_err(invalid)?;
        let (saved, saved_text) = match on_disk {
            Ok(found) if file_changed => found,
            _ => (start, base),
        };
        let mut document = Document {
            editor,
            journal,
            path: Some(path),
            saved,
            saved_text,
            untitled: false,
            restored: None,
            redo_blocked: false,
            replayed: Replayed::default(),
        };
        document.replay(&records, &mut damage)?;
        document.restored = Some(Restored { file_changed, ..Restored::of(edits, damage) });
        if records.last() == Some(&Record::Closed) {
            document.taken_up();
        }
        Ok(document)
    }

    /// A document without a file, journalled in the state folder.
    ///
    /// # Errors
    /// [`Error::Journal`], [`Error::Clip`].
    pub fn new(clip: Clip, state_dir: &Path, table: Option<JointTable>) -> Result<Document, Error> {
        std::fs::create_dir_all(state_dir)
            .map_err(|source| fsio::Error::Write { source, path: state_dir.to_owned() })?;
        for number in 1..10_000 {
            let path = state_dir.join(format!("untitled-{number}.autosave"));
            match Journal::open(&path) {
                Ok((journal, records, damage)) if records.is_empty() && damage.lost.is_empty() => {
                    let saved_text = clip.to_text();
                    let editor = Editor::new(clip, table).map_err(invalid)?;
                    let saved = editor.clip().clone();
                    let mut document = Document {
                        editor,
                        journal,
                        path: None,
                        saved,
                        saved_text,
                        untitled: true,
                        restored: None,
                        redo_blocked: false,
                        replayed: Replayed::default(),
                    };
                    document.rebase()?;
                    return Ok(document);
                }
                Ok(_) | Err(Error::Locked { .. } | Error::NotAJournal { .. }) => {}
                Err(e) => return Err(e),
            }
        }
        Err(Error::Full { what: "unsaved clips", cap: 10_000 })
    }

    /// From now on a kill is one that the next start does not take up.
    pub fn put_aside(&mut self) {
        self.mark(Record::Closed);
    }

    /// From now on a kill is one with this clip open.
    pub fn taken_up(&mut self) {
        self.mark(Record::Opened);
    }

    fn mark(&mut self, record: Record) {
        if let Err(e) = self.journal.append(&[record]) {
            tracing::warn!("what the next start takes up may be wrong: {e}");
        }
    }

    fn from_journal(
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
        let mut document = Document {
            editor,
            journal,
            path: None,
            saved: start,
            saved_text: text.clone(),
            untitled: true,
            restored: None,
            redo_blocked: false,
            replayed: Replayed::default(),
        };
        document.replay(records, &mut damage)?;
        document.restored = Some(Restored::of(edits(records), damage));
        Ok(document)
    }

    /// Goes through the history. After damage the journal is written anew, so that what is on
    /// disk and what is here go on from the same steps.
    fn replay(&mut self, records: &[Record], damage: &mut Damage) -> Result<(), Error> {
        let steps = steps(records);
        for step in &steps {
            match step {
                Step::Edit { .. } => self.replayed.push(),
                Step::Undo => drop(self.replayed.undo()),
                Step::Redo => drop(self.replayed.redo()),
            }
        }
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

    /// Makes the journal say how to come from what is saved to what is here.
    fn write_anew(&mut self) -> Result<(), Error> {
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

    fn base(&self) -> Record {
        Record::Base { text: self.saved_text.clone(), path: self.path.clone() }
    }

    /// The clip.
    pub fn clip(&self) -> &Clip {
        self.editor.clip()
    }

    /// The clip, compiled.
    pub fn command(&self) -> &Command {
        self.editor.command()
    }

    /// What is known about its robot.
    pub fn table(&self) -> Option<&JointTable> {
        self.editor.table()
    }

    /// Version.
    pub fn rev(&self) -> u64 {
        self.editor.rev()
    }

    /// Its file.
    pub fn path(&self) -> Option<&Path> {
        self.path.as_deref()
    }

    /// How many edits there are, and how many are done.
    pub fn history(&self) -> (usize, usize) {
        self.editor.history()
    }

    /// What these edits are called, oldest first.
    pub fn labels(&self, edits: std::ops::Range<usize>) -> Vec<String> {
        self.editor.labels(edits)
    }

    /// Whether anything would be lost without the journal.
    pub fn is_dirty(&self) -> bool {
        self.editor.clip() != &self.saved
    }

    /// What the start brought back.
    pub fn restored(&self) -> Option<&Restored> {
        self.restored.as_ref()
    }

    /// The text that saving would write.
    pub fn text(&self) -> String {
        if self.is_dirty() { self.clip().to_text() } else { self.saved_text.clone() }
    }

    /// Carries out several requests, of different clients perhaps, with one `fdatasync`.
    /// Each gets its answer; when the journal fails, all that had succeeded are taken back
    /// and get that error.
    pub fn edit(&mut self, edits: &[Edit]) -> Vec<Result<Vec<Change>, Error>> {
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

    fn one(
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
                        std::cmp::Ordering::Greater => self.one(&Edit::Undo, records, steps)?,
                        std::cmp::Ordering::Less => self.one(&Edit::Redo, records, steps)?,
                        std::cmp::Ordering::Equal => break,
                    };
                    let Some(step) = step.into_iter().next() else { break };
                    steps_made += 1;
                    last = Some(step);
                }
                let Some(last) = last else { return Ok(Vec::new()) };
                if steps_made == 1 {
                    return Ok(vec![last]);
                }
                // Hundreds of steps are one change to whoever looks on.
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

    fn take_back(&mut self, steps: &[Done]) {
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

    /// The clip as an edit would leave it; nothing changes. For previews while dragging.
    ///
    /// # Errors
    /// [`Error::Op`].
    pub fn preview(&self, op: &Op) -> Result<Command, Error> {
        let next = clip::edited(self.clip(), op, self.table())?;
        clip::compile(&next).map_err(|e| Error::Op(e.into()))
    }

    /// Writes the file, under a new name where one is given.
    ///
    /// # Errors
    /// [`Error::Untitled`], [`Error::Exists`] unless `replace`, [`Error::File`],
    /// [`Error::Locked`], [`Error::Journal`].
    pub fn save(
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
        let moved = self.path.as_deref() != Some(&target);
        if moved && !replace && target.exists() {
            return Err(Error::Exists { path: target });
        }
        let journal = if moved { Some(open_journal(&target, state_dir)?.0) } else { None };
        fsio::write_atomic(&target, text.as_bytes())?;
        if let Some(journal) = journal {
            std::mem::replace(&mut self.journal, journal).remove();
        }
        self.path = Some(target);
        self.saved = self.clip().clone();
        self.saved_text = text;
        self.untitled = false;
        self.restored = None;
        self.rebase()
    }

    /// Makes the journal start from what is saved.
    fn rebase(&mut self) -> Result<(), Error> {
        self.journal.rewrite(&[self.base()])?;
        self.replayed = Replayed::default();
        Ok(())
    }

    /// Gives up unsaved edits of a restored document.
    ///
    /// # Errors
    /// As [`Document::edit`].
    pub fn discard(&mut self) -> Result<Vec<Change>, Error> {
        let patch = Delta::between(self.clip(), &self.saved);
        self.restored = None;
        if patch.is_empty() {
            return Ok(Vec::new());
        }
        let op = relabelled("Discard unsaved changes", &Box::new(patch));
        self.edit(&[Edit::Op(Box::new(op))]).pop().unwrap_or_else(|| Ok(Vec::new()))
    }

    /// Ends it. Unsaved edits stay in the journal, with a mark that this was no kill; without
    /// any the journal goes.
    pub fn close(mut self) {
        let keep = if self.untitled { self.editor.history().1 > 0 } else { self.is_dirty() };
        if keep {
            self.put_aside();
        } else {
            self.journal.remove();
        }
    }
}

fn invalid(e: clip::Invalid) -> Error {
    Error::Op(e.into())
}

fn written_out(change: &Change) -> Record {
    Record::Edit { label: change.label.clone(), patch: Box::new(change.patch.clone()) }
}

fn relabelled(label: &str, patch: &Delta) -> Op {
    Op::Batch(Batch { label: label.to_owned(), ops: vec![Op::Patch(Box::new(patch.clone()))] })
}

/// What the records say of the history.
fn steps(records: &[Record]) -> Vec<Step> {
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
fn edits(records: &[Record]) -> usize {
    let counts = |r: &&Record| matches!(r, Record::Edit { .. } | Record::Undo | Record::Redo);
    records.iter().filter(counts).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clip::{ClipRename, Key, KeysAdd, RobotRef};

    fn blank() -> Clip {
        let joints = vec!["a".to_owned(), "b".to_owned()];
        let mut clip = Clip::new(RobotRef { id: "r".into(), joints, ..RobotRef::default() }, 100);
        clip.keys.push(Key::new(0, &[0.0, 0.0]));
        clip
    }

    fn add(frame: u32) -> Edit {
        let keys = vec![Key::new(frame, &[0.5, 1.0])];
        Edit::Op(Box::new(Op::KeysAdd(KeysAdd { keys, replace: true })))
    }

    #[test]
    fn comes_back_with_history_and_undoes_to_the_same_bytes() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.clip.json");
        // Not our layout, yet it must come back as it was.
        let text = blank().to_text().replace('\n', "\n ").trim_end().to_owned();
        std::fs::write(&path, &text).unwrap();
        let mut doc = Document::open(&path, dir.path(), |_| None).unwrap();
        assert!(!doc.is_dirty() && doc.text() == text);
        let answers = doc.edit(&[add(20), add(40), Edit::Undo, add(50)]);
        assert!(answers.iter().all(Result::is_ok));
        let (clip, history) = (doc.clip().clone(), doc.history().0);
        drop(doc); // as a kill would
        let mut doc = Document::open(&path, dir.path(), |_| None).unwrap();
        assert_eq!((doc.clip(), doc.history().0), (&clip, history));
        assert_eq!(doc.restored().unwrap().edits, 4);
        doc.edit(&[Edit::Goto(0)]).pop().unwrap().unwrap();
        assert_eq!(doc.text(), text);
        doc.close();
        assert!(!path.with_file_name("a.clip.json.autosave").exists());
    }

    #[test]
    fn saving_compacts_and_moving_takes_the_lock_along() {
        let dir = tempfile::tempdir().unwrap();
        let mut doc = Document::new(blank(), dir.path(), None).unwrap();
        assert!(matches!(doc.save(None, false, dir.path()), Err(Error::Untitled)));
        doc.edit(&[add(30)]);
        let path = dir.path().join("b.clip.json");
        doc.save(Some(&path), false, dir.path()).unwrap();
        assert!(!doc.is_dirty());
        assert!(matches!(Document::open(&path, dir.path(), |_| None), Err(Error::Locked { .. })));
        assert_eq!(std::fs::read_to_string(&path).unwrap(), doc.clip().to_text());
        // The saved journal does not know this edit any more, and yet its undo is kept.
        for (edit, there) in [(Edit::Undo, false), (Edit::Redo, true), (Edit::Undo, false)] {
            doc.edit(&[edit]);
            let killed = dir.path().join("killed.clip.json");
            std::fs::copy(&path, &killed).unwrap();
            std::fs::copy(
                dir.path().join("b.clip.json.autosave"),
                dir.path().join("killed.clip.json.autosave"),
            )
            .unwrap();
            let back = Document::open(&killed, dir.path(), |_| None).unwrap();
            assert_eq!(back.clip().key(30).is_some(), there);
            assert_eq!(back.clip(), doc.clip());
        }
        assert!(Document::orphan(dir.path(), |_| None).is_none());
    }

    #[test]
    fn an_unsaved_clip_is_found_again() {
        let dir = tempfile::tempdir().unwrap();
        let mut doc = Document::new(blank(), dir.path(), None).unwrap();
        let rename = ClipRename { name: "wave".into() };
        doc.edit(&[Edit::Op(Box::new(Op::ClipRename(rename)))]);
        assert!(Document::orphan(dir.path(), |_| None).is_none(), "it is in use");
        // Another beside it: both stay within reach.
        let mut other = Document::new(blank(), dir.path(), None).unwrap();
        let rename = ClipRename { name: "nod".into() };
        other.edit(&[Edit::Op(Box::new(Op::ClipRename(rename)))]);
        let untouched = Document::new(blank(), dir.path(), None).unwrap();
        drop((doc, other, untouched));
        let mut names: Vec<String> =
            Document::drafts(dir.path()).into_iter().map(|d| d.name).collect();
        names.sort();
        assert_eq!(names, ["nod", "wave"]);
        let doc = Document::orphan(dir.path(), |_| None).unwrap();
        assert_eq!(doc.clip().name, "nod", "the newest");
        assert!(doc.is_dirty() && doc.path().is_none());
        let left = Document::drafts(dir.path());
        assert_eq!(left.len(), 1, "the other one is open: {left:?}");
        let number = left.first().unwrap().number;
        assert_eq!(Document::draft(dir.path(), number, |_| None).unwrap().clip().name, "wave");
        Document::drop_draft(dir.path(), number).unwrap();
        assert!(Document::drafts(dir.path()).is_empty());
        assert!(matches!(
            Document::draft(dir.path(), number, |_| None),
            Err(Error::NotFound { .. })
        ));
    }

    #[test]
    fn the_newest_draft_is_first_within_one_second_too() {
        let dir = tempfile::tempdir().unwrap();
        let mut docs = [(); 2].map(|()| Document::new(blank(), dir.path(), None).unwrap());
        for doc in &mut docs {
            doc.edit(&[add(20)]);
        }
        drop(docs);
        let mut numbers: Vec<u32> = Document::drafts(dir.path()).iter().map(|d| d.number).collect();
        numbers.sort_unstable();
        let second = std::time::SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(1 << 30);
        for (number, millis) in numbers.iter().zip([900, 100]) {
            let journal = dir.path().join(format!("untitled-{number}.autosave"));
            let file = std::fs::File::options().append(true).open(journal).unwrap();
            file.set_modified(second + std::time::Duration::from_millis(millis)).unwrap();
        }
        assert_eq!(Document::drafts(dir.path())[0].number, numbers[0]);
    }

    #[test]
    fn what_was_put_away_is_a_draft_and_what_was_killed_comes_back() {
        let dir = tempfile::tempdir().unwrap();
        let mut doc = Document::new(blank(), dir.path(), None).unwrap();
        doc.edit(&[add(20), add(40)]);
        doc.close();
        assert!(Document::orphan(dir.path(), |_| None).is_none(), "nothing was killed");
        let [draft] = &Document::drafts(dir.path())[..] else { panic!("it is kept") };
        assert!(!draft.abandoned);
        // Taken up again it is whole, and a kill before any further edit is a kill.
        let doc = Document::draft(dir.path(), draft.number, |_| None).unwrap();
        assert_eq!((doc.restored().unwrap().edits, doc.history().1), (2, 2));
        drop(doc);
        assert!(Document::drafts(dir.path())[0].abandoned);
        let doc = Document::orphan(dir.path(), |_| None).unwrap();
        assert_eq!(doc.clip().keys.len(), 3);
    }

    #[test]
    fn a_file_that_was_put_away_is_not_one_that_was_killed() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("wave.clip.json");
        std::fs::write(&file, blank().to_text()).unwrap();
        let open = || Document::open(&file, dir.path(), |_| None).unwrap();
        let left = || Document::left_open(&file, dir.path(), |_| None);
        assert!(left().unwrap().is_none());
        let mut doc = open();
        assert!(matches!(left(), Err(Error::Locked { .. })), "it is in use");
        doc.edit(&[add(20)]);
        drop(doc);
        let doc = left().unwrap().unwrap();
        assert_eq!(doc.restored().unwrap().edits, 1);
        doc.close();
        assert!(left().unwrap().is_none(), "its edits wait, but nothing was killed");
        let doc = open();
        assert_eq!(doc.restored().unwrap().edits, 1);
        drop(doc);
        let mut doc = left().unwrap().expect("killed before any further edit");
        assert_eq!((doc.restored().unwrap().edits, doc.history().1), (1, 1));
        doc.put_aside();
        drop(doc);
        assert!(left().unwrap().is_none(), "a start that failed on it is not repeated");
        let mut doc = open();
        doc.discard().unwrap();
        doc.close();
        assert!(left().unwrap().is_none());
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "no journal is left");
    }

    #[test]
    fn two_who_look_for_drafts_at_once_both_find_all() {
        let dir = tempfile::tempdir().unwrap();
        for _ in 0..4 {
            let mut doc = Document::new(blank(), dir.path(), None).unwrap();
            doc.edit(&[add(20)]);
            doc.close();
        }
        std::thread::scope(|scope| {
            for _ in 0..2 {
                scope.spawn(|| {
                    for _ in 0..50 {
                        assert_eq!(Document::drafts(dir.path()).len(), 4);
                    }
                });
            }
        });
    }

    #[test]
    fn a_refused_edit_leaves_no_record() {
        let dir = tempfile::tempdir().unwrap();
        let mut doc = Document::new(blank(), dir.path(), None).unwrap();
        let before = doc.journal.bytes();
        let answers = doc.edit(&[add(5000), Edit::Redo]);
        assert!(answers[0].is_err() && answers[1].as_ref().unwrap().is_empty());
        assert_eq!(doc.journal.bytes(), before);
    }

    #[test]
    fn one_damaged_record_costs_one_edit_and_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.clip.json");
        let journal = dir.path().join("a.clip.json.autosave");
        std::fs::write(&path, blank().to_text()).unwrap();
        let open = || Document::open(&path, dir.path(), |_| None).unwrap();
        let mut doc = open();
        for frame in 10..60 {
            doc.edit(&[add(frame)]);
        }
        doc.edit(&[Edit::Undo]);
        let whole = doc.clip().clone();
        drop(doc);
        let good = std::fs::read(&journal).unwrap();
        // A byte in each record, and in the base: hundreds of positions from end to end.
        for at in (0..good.len()).step_by(61) {
            let mut bad = good.clone();
            bad[at] ^= 0x20;
            std::fs::write(&journal, &bad).unwrap();
            let mut doc = open();
            let missing = whole.keys.iter().filter(|k| doc.clip().key(k.frame) != Some(*k)).count();
            let extra = doc.clip().keys.len() + missing - whole.keys.len();
            assert!(missing + extra <= 1, "byte {at}: {missing} missing, {extra} extra");
            let told = doc.restored().unwrap().clone();
            assert!(!told.lost.is_empty() || told.torn_bytes > 0, "byte {at}");
            assert_eq!(std::fs::read(told.kept.unwrap()).unwrap(), bad, "byte {at}");
            // It goes on from there, and comes back once more without a word.
            doc.edit(&[add(90)]);
            let clip = doc.clip().clone();
            drop(doc);
            let mut doc = open();
            assert_eq!(doc.clip(), &clip, "byte {at}");
            assert!(doc.restored().unwrap().lost.is_empty());
            while !doc.edit(&[Edit::Undo])[0].as_ref().unwrap().is_empty() {}
            assert_eq!(doc.clip(), &blank(), "byte {at}");
            drop(doc);
            for kept in std::fs::read_dir(dir.path()).unwrap() {
                let kept = kept.unwrap().path();
                if kept.to_string_lossy().contains(".damaged") {
                    std::fs::remove_file(kept).unwrap();
                }
            }
        }
    }

    #[test]
    fn a_damaged_draft_is_neither_emptied_nor_lost() {
        let dir = tempfile::tempdir().unwrap();
        let mut doc = Document::new(blank(), dir.path(), None).unwrap();
        doc.edit(&[add(20), add(40)]);
        drop(doc);
        let path = dir.path().join("untitled-1.autosave");
        let good = std::fs::read(&path).unwrap();
        let mut bad = good.clone();
        bad[60] ^= 1;
        std::fs::write(&path, &bad).unwrap();
        assert_eq!(Document::drafts(dir.path()).len(), 1);
        assert_eq!(std::fs::read(&path).unwrap(), bad, "a look changes nothing");
        let doc = Document::draft(dir.path(), 1, |_| None).unwrap();
        assert_eq!(doc.clip().keys.len(), 3);
        assert_eq!(doc.restored().unwrap().lost.len(), 1);
        drop(doc);
        // With both copies of the base gone there is no clip, yet the file stays.
        let mut bad = good.clone();
        let second = bad.len() / 2;
        bad[60..second].fill(b'x');
        std::fs::write(&path, &bad).unwrap();
        let other = Document::new(blank(), dir.path(), None).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), bad);
        drop(other);
    }

    #[test]
    fn a_journal_that_makes_no_sense_does_not_lock_the_clip_up() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.clip.json");
        let at = dir.path().join("a.clip.json.autosave");
        std::fs::write(&path, blank().to_text()).unwrap();
        let edit = Record::Edit { label: "x".into(), patch: Box::default() };
        let (mut journal, ..) = Journal::open(&at).unwrap();
        journal.append(&[Record::Base { text: "{".into(), path: None }, edit]).unwrap();
        drop(journal);
        let doc = Document::open(&path, dir.path(), |_| None).unwrap();
        assert_eq!(doc.clip(), &blank());
        let told = doc.restored().unwrap();
        assert!(told.lost[0].contains("is no clip") && told.kept.is_some(), "{told:?}");
    }

    #[test]
    fn a_draft_from_before_1970_is_found() {
        let dir = tempfile::tempdir().unwrap();
        let mut doc = Document::new(blank(), dir.path(), None).unwrap();
        doc.edit(&[add(20)]);
        doc.close();
        let file =
            std::fs::File::options().write(true).open(dir.path().join("untitled-1.autosave"));
        let long_ago = std::time::UNIX_EPOCH - std::time::Duration::from_hours(24);
        file.unwrap().set_modified(long_ago).unwrap();
        assert_eq!(Document::drafts(dir.path()).len(), 1);
    }
}
