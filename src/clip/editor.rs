//! A clip being edited: unlimited undo with named entries, and what each edit changed.

use super::apply::{OpError, edited};
use super::command::Command;
use super::compile::compile;
use super::delta::Delta;
use super::document::Clip;
use super::joints::JointTable;
use super::op::Op;
use super::validate::Invalid;

/// What an edit, an undo or a redo did.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// Version of the document afterwards; rises with every change.
    pub rev: u64,
    /// What was done, in words.
    pub label: String,
    /// The difference, for other views of the document.
    pub patch: Delta,
    /// First compiled frame that differs, if any does.
    pub first_changed_frame: Option<u32>,
    /// First step of a rollout that can differ.
    pub first_changed_step: Option<u32>,
}

#[derive(Clone, Debug)]
struct Entry {
    label: String,
    undo: Delta,
    redo: Delta,
}

/// A clip, its compiled command and its history.
#[derive(Clone, Debug)]
pub struct Editor {
    clip: Clip,
    command: Command,
    table: Option<JointTable>,
    entries: Vec<Entry>,
    done: usize,
    rev: u64,
}

impl Editor {
    /// Starts with this clip. The table is needed to mirror.
    ///
    /// # Errors
    /// [`Invalid`] when the clip breaks a rule.
    pub fn new(mut clip: Clip, table: Option<JointTable>) -> Result<Editor, Invalid> {
        clip.normalize();
        let command = compile(&clip)?;
        Ok(Editor { clip, command, table, entries: Vec::new(), done: 0, rev: 0 })
    }

    /// The clip.
    pub fn clip(&self) -> &Clip {
        &self.clip
    }

    /// The clip, compiled.
    pub fn command(&self) -> &Command {
        &self.command
    }

    /// What is known about the robot.
    pub fn table(&self) -> Option<&JointTable> {
        self.table.as_ref()
    }

    /// Version of the document.
    pub fn rev(&self) -> u64 {
        self.rev
    }

    /// Labels of all edits, oldest first, and how many of them are done (the rest can be
    /// redone).
    pub fn history(&self) -> (Vec<&str>, usize) {
        (self.entries.iter().map(|e| e.label.as_str()).collect(), self.done)
    }

    /// Carries out one edit. One that changes nothing leaves no entry.
    ///
    /// # Errors
    /// [`OpError`]; nothing has changed then.
    pub fn apply(&mut self, op: &Op) -> Result<Change, OpError> {
        let next = edited(&self.clip, op, self.table.as_ref())?;
        let redo = Delta::between(&self.clip, &next);
        let label = op.label();
        if !redo.is_empty() {
            let undo = Delta::between(&next, &self.clip);
            self.entries.truncate(self.done);
            self.entries.push(Entry { label: label.clone(), undo, redo: redo.clone() });
            self.done += 1;
        }
        self.take_over(next, label, redo)
    }

    /// Takes the last edit back; `None` when there is none.
    ///
    /// # Errors
    /// [`OpError`] never in practice: the older clip was valid.
    pub fn undo(&mut self) -> Result<Option<Change>, OpError> {
        let Some(entry) = self.done.checked_sub(1).and_then(|i| self.entries.get(i)).cloned()
        else {
            return Ok(None);
        };
        let next = self.patched(&entry.undo)?;
        self.done -= 1;
        self.take_over(next, format!("Undo: {}", entry.label), entry.undo).map(Some)
    }

    /// Does the next undone edit again; `None` when there is none.
    ///
    /// # Errors
    /// [`OpError`] never in practice.
    pub fn redo(&mut self) -> Result<Option<Change>, OpError> {
        let Some(entry) = self.entries.get(self.done).cloned() else { return Ok(None) };
        let next = self.patched(&entry.redo)?;
        self.done += 1;
        self.take_over(next, format!("Redo: {}", entry.label), entry.redo).map(Some)
    }

    fn patched(&self, delta: &Delta) -> Result<Clip, OpError> {
        edited(&self.clip, &Op::Patch(Box::new(delta.clone())), None)
    }

    fn take_over(&mut self, next: Clip, label: String, patch: Delta) -> Result<Change, OpError> {
        let command = compile(&next)?;
        let first_changed_frame = command.first_changed_frame(&self.command);
        let first_changed_step = command.first_changed_step(&self.command);
        self.clip = next;
        self.command = command;
        self.rev += u64::from(!patch.is_empty());
        Ok(Change { rev: self.rev, label, patch, first_changed_frame, first_changed_step })
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Key, KeysAdd, KeysMove, RobotRef};
    use super::*;

    #[test]
    fn history_is_named_and_forks() {
        let joints = vec!["a".to_owned()];
        let clip = Clip::new(RobotRef { id: "r".into(), joints, ..RobotRef::default() }, 100);
        let mut e = Editor::new(clip.clone(), None).unwrap();
        let add = |f| Op::KeysAdd(KeysAdd { keys: vec![Key::new(f, &[1.0])], replace: false });
        let change = e.apply(&add(40)).unwrap();
        assert_eq!((change.rev, change.first_changed_frame), (1, Some(0)), "the start follows it");
        e.apply(&add(60)).unwrap();
        let moved = KeysMove { frames: vec![60], df: 5, ..KeysMove::default() };
        let change = e.apply(&Op::KeysMove(moved)).unwrap();
        assert_eq!((change.first_changed_frame, change.first_changed_step), (Some(60), Some(40)));
        assert_eq!(e.history(), (vec!["Add key", "Add key", "Move key by +5"], 3));
        assert_eq!(e.undo().unwrap().unwrap().label, "Undo: Move key by +5");
        assert!(e.clip().key(60).is_some());
        e.undo().unwrap();
        e.redo().unwrap();
        assert_eq!(e.history().1, 2);
        e.undo().unwrap();
        e.apply(&add(70)).unwrap();
        assert_eq!(e.history(), (vec!["Add key", "Add key"], 2));
        assert!(e.apply(&add(70)).is_err());
        while e.undo().unwrap().is_some() {}
        assert_eq!(e.clip(), &clip);
    }
}
