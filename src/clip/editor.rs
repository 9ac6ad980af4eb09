//! A clip that is being edited, with unlimited undo, named entries, and the changes of each edit.

use std::ops::Range;
use std::sync::Arc;

use super::apply::{OpError, edited};
use super::command::Command;
use super::compile::compile_for;
use super::delta::Delta;
use super::document::Clip;
use super::flaw::Invalid;
use super::history::{Entry, History};
use super::joints::JointTable;
use super::op::Op;

/// The result of an edit, an undo or a redo.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// Version of the document afterwards; rises with every change.
    pub rev: u64,
    /// The edit in words.
    pub label: String,
    /// The difference, for other views of the document.
    pub patch: Delta,
    /// First compiled frame that differs, if any does.
    pub first_changed_frame: Option<u32>,
    /// First step of a rollout that can differ.
    pub first_changed_step: Option<u32>,
}

/// A step of a recorded history.
#[derive(Clone, Debug)]
pub enum Step {
    /// An edit, and the difference that it made.
    Edit {
        /// Its label in the history.
        label: String,
        /// The difference that it made. An edit that changes nothing also has a place in the
        /// history.
        patch: Box<Delta>,
    },
    /// The last step was undone.
    Undo,
    /// It was redone.
    Redo,
}

/// A clip, its compiled command and its history.
///
/// ```
/// use robert_clip::{Clip, Editor, Key, KeysMove, Op, RobotRef};
///
/// let joints = vec!["x".to_owned(), "y".to_owned()];
/// let robot = RobotRef { id: "pointmass".to_owned(), joints, ..RobotRef::default() };
/// let mut clip = Clip::new(robot, 41);
/// clip.keys = vec![Key::new(0, &[0.0, 0.0]), Key::new(20, &[0.3, -0.1])];
/// let mut editor = Editor::new(clip, None)?;
/// editor.apply(&Op::KeysMove(KeysMove { frames: vec![20], df: 5, ..KeysMove::default() }))?;
/// assert_eq!(editor.clip().keys[1].frame, 25);
/// editor.undo()?;
/// assert_eq!(editor.clip().keys[1].frame, 20);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Editor {
    clip: Arc<Clip>,
    command: Arc<Command>,
    table: Option<Arc<JointTable>>,
    history: History,
    rev: u64,
}

/// A version of a clip that is being edited. Clones share it, and later edits do not change it.
#[derive(Clone, Debug)]
pub struct Version {
    /// Its number.
    pub rev: u64,
    /// The clip.
    pub clip: Arc<Clip>,
    /// The clip, compiled.
    pub command: Arc<Command>,
    /// What is known about the robot.
    pub table: Option<Arc<JointTable>>,
}

impl Version {
    /// The command as an edit would leave it.
    ///
    /// # Errors
    /// [`OpError`].
    pub fn preview(&self, op: &Op) -> Result<Command, OpError> {
        let table = self.table.as_deref();
        Ok(compile_for(&edited(&self.clip, op, table)?, table)?)
    }
}

impl Editor {
    /// Starts with this clip. The table is needed to mirror, and to solve end-effector goals.
    ///
    /// # Errors
    /// [`Invalid`] when the clip breaks a rule.
    pub fn new(mut clip: Clip, table: Option<JointTable>) -> Result<Editor, Invalid> {
        clip.normalize();
        let command = compile_for(&clip, table.as_ref())?.into();
        let table = table.map(Arc::new);
        Ok(Editor { clip: clip.into(), command, table, history: History::default(), rev: 0 })
    }

    /// The clip.
    pub fn clip(&self) -> &Clip {
        &self.clip
    }

    /// The clip, compiled.
    pub fn command(&self) -> &Command {
        &self.command
    }

    /// The facts about the robot's joints.
    pub fn table(&self) -> Option<&JointTable> {
        self.table.as_deref()
    }

    /// The version of now.
    pub fn version(&self) -> Version {
        let (clip, command) = (Arc::clone(&self.clip), Arc::clone(&self.command));
        Version { rev: self.rev, clip, command, table: self.table.clone() }
    }

    /// Version of the document.
    pub fn rev(&self) -> u64 {
        self.rev
    }

    /// The number of edits, and how many of them are done (the rest can be redone).
    pub fn history(&self) -> (usize, usize) {
        (self.history.len(), self.history.done())
    }

    /// The labels of these edits, oldest first.
    pub fn labels(&self, edits: Range<usize>) -> Vec<String> {
        self.history.labels(edits)
    }

    /// The difference that edit number `i` made, and its label; `None` if there is none.
    pub fn recorded(&self, i: usize) -> Option<(String, Delta)> {
        self.history.entry(i).ok().map(|e| (e.label, e.redo))
    }

    /// Replays a recorded history. If it is `whole`, differences are applied in place and the
    /// result is checked once, so it takes only the time of reading them. Otherwise each step is
    /// checked. A step that can no longer be applied becomes a step without changes, and the
    /// numbers of such steps are returned.
    ///
    /// # Errors
    /// [`OpError`] never in practice, because the steps are checked one by one if necessary.
    pub fn replay(&mut self, steps: &[Step], whole: bool) -> Result<Vec<usize>, OpError> {
        if whole {
            let (next, history) = at_once(&self.clip, steps)?;
            if let (Ok(()), Ok(command)) = (next.validate(), compile_for(&next, self.table())) {
                (self.clip, self.command, self.history) = (next.into(), command.into(), history);
                self.rev += steps.len() as u64;
                return Ok(Vec::new());
            }
        }
        let (next, history, skipped) = one_by_one(&self.clip, steps)?;
        self.command = compile_for(&next, self.table())?.into();
        (self.clip, self.history) = (next.into(), history);
        self.rev += steps.len() as u64;
        Ok(skipped)
    }

    /// The clip to which [`Editor::replay`] leads. It is not compiled, so its robot may be unknown.
    ///
    /// # Errors
    /// As [`Editor::replay`].
    pub fn replayed(clip: &Clip, steps: &[Step], whole: bool) -> Result<Clip, OpError> {
        if whole
            && let (next, _) = at_once(clip, steps)?
            && next.validate().is_ok()
        {
            return Ok(next);
        }
        Ok(one_by_one(clip, steps)?.0)
    }

    /// Applies one edit. An edit that changes nothing leaves no entry.
    ///
    /// # Errors
    /// [`OpError`]; the clip is then unchanged.
    pub fn apply(&mut self, op: &Op) -> Result<Change, OpError> {
        let next = edited(&self.clip, op, self.table())?;
        let command = compile_for(&next, self.table())?;
        let redo = Delta::between(&self.clip, &next);
        let label = op.label();
        if !redo.is_empty() {
            let undo = Delta::between(&next, &self.clip);
            self.history.push(Entry { label: label.clone(), undo, redo: redo.clone() });
        }
        Ok(self.take_over(next, command, label, redo))
    }

    /// Undoes the last edit; `None` if there is none.
    ///
    /// # Errors
    /// [`OpError`] never in practice: the older clip was valid, and only old steps are read from a
    /// file.
    pub fn undo(&mut self) -> Result<Option<Change>, OpError> {
        let Some(entry) = self.history.last().map_err(|e| unreadable(&e))? else { return Ok(None) };
        let (next, command) = self.patched(&entry.undo)?;
        self.history.step_back();
        let label = format!("Undo: {}", entry.label);
        Ok(Some(self.take_over(next, command, label, entry.undo)))
    }

    /// Redoes the next undone edit; `None` if there is none.
    ///
    /// # Errors
    /// [`OpError`] never in practice.
    pub fn redo(&mut self) -> Result<Option<Change>, OpError> {
        let Some(entry) = self.history.next().map_err(|e| unreadable(&e))? else { return Ok(None) };
        let (next, command) = self.patched(&entry.redo)?;
        self.history.step_on();
        let label = format!("Redo: {}", entry.label);
        Ok(Some(self.take_over(next, command, label, entry.redo)))
    }

    fn patched(&self, delta: &Delta) -> Result<(Clip, Command), OpError> {
        let next = edited(&self.clip, &Op::Patch(Box::new(delta.clone())), None)?;
        let command = compile_for(&next, self.table())?;
        Ok((next, command))
    }

    fn take_over(&mut self, next: Clip, command: Command, label: String, patch: Delta) -> Change {
        let first_changed_frame = command.first_changed_frame(&self.command);
        let first_changed_step = command.first_changed_step(&self.command);
        self.clip = next.into();
        self.command = command.into();
        self.rev += u64::from(!patch.is_empty());
        Change { rev: self.rev, label, patch, first_changed_frame, first_changed_step }
    }
}

/// The clip and the history after these steps; the clip is not validated.
fn at_once(clip: &Clip, steps: &[Step]) -> Result<(Clip, History), OpError> {
    let (mut next, mut history) = (clip.clone(), History::default());
    for step in steps {
        walk(&mut next, &mut history, step)?;
    }
    next.normalize();
    Ok((next, history))
}

/// The clip and the history after these steps, and the numbers of those that can no longer be applied.
fn one_by_one(clip: &Clip, steps: &[Step]) -> Result<(Clip, History, Vec<usize>), OpError> {
    let (mut clip, mut history, mut skipped) = (clip.clone(), History::default(), Vec::new());
    for (number, step) in steps.iter().enumerate() {
        let fits = match step {
            Step::Edit { patch, .. } => {
                let mut next = clip.clone();
                patch.put(&mut next);
                next.normalize();
                next.validate().is_ok()
            }
            Step::Undo | Step::Redo => true,
        };
        let nothing = match step {
            Step::Edit { label, .. } => Step::Edit { label: label.clone(), patch: Box::default() },
            other => other.clone(),
        };
        if !fits {
            skipped.push(number);
        }
        walk(&mut clip, &mut history, if fits { step } else { &nothing })?;
        clip.normalize();
    }
    Ok((clip, history, skipped))
}

/// Applies one recorded step without checking the clip.
fn walk(clip: &mut Clip, history: &mut History, step: &Step) -> Result<(), OpError> {
    match step {
        Step::Edit { label, patch } => {
            let undo = patch.inverse(clip);
            patch.put(clip);
            history.push(Entry { label: label.clone(), undo, redo: (**patch).clone() });
        }
        Step::Undo => {
            if let Some(entry) = history.last().map_err(|e| unreadable(&e))? {
                entry.undo.put(clip);
                history.step_back();
            }
        }
        Step::Redo => {
            if let Some(entry) = history.next().map_err(|e| unreadable(&e))? {
                entry.redo.put(clip);
                history.step_on();
            }
        }
    }
    Ok(())
}

fn unreadable(e: &std::io::Error) -> OpError {
    OpError::Argument { what: format!("an old step cannot be read from disk: {e}") }
}

#[cfg(test)]
mod tests {
    use super::super::validate::CHECKS;
    use super::super::{Goal, Key, KeysAdd, KeysMove, KeysScale, RobotRef};
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
        assert_eq!(e.history(), (3, 3));
        assert_eq!(e.labels(0..9), ["Add key", "Add key", "Move key by +5"]);
        assert_eq!(e.undo().unwrap().unwrap().label, "Undo: Move key by +5");
        assert!(e.clip().key(60).is_some());
        e.undo().unwrap();
        e.redo().unwrap();
        assert_eq!(e.history().1, 2);
        e.undo().unwrap();
        e.apply(&add(70)).unwrap();
        assert_eq!(e.history(), (2, 2));
        assert!(e.apply(&add(70)).is_err());
        while e.undo().unwrap().is_some() {}
        assert_eq!(e.clip(), &clip);
    }

    #[test]
    fn a_key_for_some_joints_takes_nothing_from_the_others_where_it_lands() {
        let joints = vec!["a".to_owned(), "b".to_owned()];
        let clip = Clip::new(RobotRef { id: "r".into(), joints, ..RobotRef::default() }, 100);
        let mut e = Editor::new(clip, None).unwrap();
        let part = Key::with(30, Goal::Q(vec![Some(3.0), None])).held(5);
        let keys = vec![Key::new(10, &[1.0, 2.0]), part];
        e.apply(&Op::KeysAdd(KeysAdd { keys, replace: false })).unwrap();
        let moved = KeysMove { frames: vec![30], df: -20, replace: true, ..KeysMove::default() };
        e.apply(&Op::KeysMove(moved)).unwrap();
        let key = e.clip().key(10).unwrap();
        assert_eq!((e.clip().row(key).unwrap(), key.hold), (&vec![Some(3.0), Some(2.0)], 5));
    }

    #[test]
    fn holds_stay_in_proportion() {
        let joints = vec!["a".to_owned()];
        let clip = Clip::new(RobotRef { id: "r".into(), joints, ..RobotRef::default() }, 100);
        let mut e = Editor::new(clip, None).unwrap();
        let keys = vec![Key::new(0, &[0.0]), Key::new(20, &[1.0]).held(10)];
        e.apply(&Op::KeysAdd(KeysAdd { keys, replace: false })).unwrap();
        for (factor, frame, hold) in [(0.5, 10, 5), (2.0, 20, 10), (0.1, 2, 1)] {
            let frames = e.clip().keys.iter().map(|k| k.frame).collect();
            e.apply(&Op::KeysScale(KeysScale { frames, pivot: 0, factor, replace: false }))
                .unwrap();
            assert_eq!((e.clip().keys[1].frame, e.clip().keys[1].hold), (frame, hold));
        }
    }

    /// The whole clip is checked as often for 10,000 steps as for 100: replaying is linear.
    #[test]
    fn a_recorded_history_is_checked_once() {
        let joints = vec!["a".to_owned()];
        let clip = Clip::new(RobotRef { id: "r".into(), joints, ..RobotRef::default() }, 2000);
        let checks = |count: u32| {
            let step = |n: u32| match n % 10 {
                7 => Step::Undo,
                8 if n % 20 == 8 => Step::Redo,
                _ => {
                    let key = Key::new(n * 7 % 2000, &[f64::from(n)]);
                    let patch = Delta { keys_put: vec![key], ..Delta::default() };
                    Step::Edit { label: "Add key".to_owned(), patch: Box::new(patch) }
                }
            };
            let steps: Vec<Step> = (0..count).map(step).collect();
            let mut editor = Editor::new(clip.clone(), None).unwrap();
            let before = CHECKS.get();
            assert_eq!(editor.replay(&steps, true).unwrap(), Vec::<usize>::new());
            assert!(editor.clip().keys.len() > 50 && editor.history().0 > count as usize * 3 / 5);
            CHECKS.get() - before
        };
        assert_eq!(checks(10_000), checks(100));
        assert_eq!(checks(100), 2, "the clip, and again as it is compiled");
    }
}
