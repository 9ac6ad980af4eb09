//! Unlimited undo in bounded memory. The newest steps are in memory, and older ones are in an
//! unnamed file that disappears with the process.

use std::collections::VecDeque;
use std::fs::File;
use std::io;
use std::ops::Range;
use std::os::unix::fs::FileExt;

use serde::{Deserialize, Serialize};

use super::delta::Delta;
use robert_base::fsio;

/// Steps in memory; a few hundred bytes each, unless they change much at once.
const RECENT: usize = 1_000;
/// Bytes of steps in memory, by their length in the file.
const RECENT_BYTES: usize = 8 << 20;

/// One step of a history.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Entry {
    pub(super) label: String,
    pub(super) undo: Delta,
    pub(super) redo: Delta,
}

/// All steps, oldest first. Some at the end may be undone.
#[derive(Debug, Default)]
pub(super) struct History {
    /// Steps from number `offsets.len()` on, and the length of each.
    recent: VecDeque<(Entry, usize)>,
    recent_bytes: usize,
    /// Byte offsets of the older steps in the file.
    offsets: Vec<u64>,
    /// Length of the used part of the file.
    file_bytes: u64,
    file: Option<File>,
    done: usize,
}

impl History {
    /// The number of steps that are done; the rest can be redone.
    pub(super) fn done(&self) -> usize {
        self.done
    }

    /// All steps.
    pub(super) fn len(&self) -> usize {
        self.offsets.len() + self.recent.len()
    }

    /// Adds a step and discards the undone ones.
    pub(super) fn push(&mut self, entry: Entry) {
        self.forget_undone();
        let bytes = size(&entry);
        self.recent_bytes += bytes;
        self.recent.push_back((entry, bytes));
        self.done += 1;
        if self.recent.len() > RECENT || self.recent_bytes > RECENT_BYTES {
            // Half of them are moved at once, so that most steps need no file access.
            let until = self.recent.len() / 2;
            if let Err(e) = self.put_away(until) {
                tracing::debug!("older steps stay in memory: {e}");
            }
        }
    }

    /// The step that an undo reverses.
    ///
    /// # Errors
    /// When an older one cannot be read back.
    pub(super) fn last(&self) -> io::Result<Option<Entry>> {
        self.done.checked_sub(1).map_or(Ok(None), |i| self.entry(i).map(Some))
    }

    /// The step that a redo repeats.
    ///
    /// # Errors
    /// As [`History::last`].
    pub(super) fn next(&self) -> io::Result<Option<Entry>> {
        if self.done < self.len() { self.entry(self.done).map(Some) } else { Ok(None) }
    }

    /// The last step was undone.
    pub(super) fn step_back(&mut self) {
        debug_assert!(self.done > 0, "there is a step to undo");
        self.done -= 1;
    }

    /// The next step was redone.
    pub(super) fn step_on(&mut self) {
        debug_assert!(self.done < self.len(), "there is a step to redo");
        self.done += 1;
    }

    /// The labels of these steps.
    pub(super) fn labels(&self, steps: Range<usize>) -> Vec<String> {
        let known = |i| self.entry(i).map_or_else(|_| "?".to_owned(), |e| e.label);
        (steps.start..steps.end.min(self.len())).map(known).collect()
    }

    /// Step number `i`.
    pub(super) fn entry(&self, i: usize) -> io::Result<Entry> {
        if let Some((entry, _)) = i.checked_sub(self.offsets.len()).and_then(|i| self.recent.get(i))
        {
            return Ok(entry.clone());
        }
        let missing = || io::Error::other("this step is missing");
        let from = *self.offsets.get(i).ok_or_else(missing)?;
        let to = self.offsets.get(i + 1).copied().unwrap_or(self.file_bytes);
        let mut bytes = vec![0; (to - from) as usize];
        self.file.as_ref().ok_or_else(missing)?.read_exact_at(&mut bytes, from)?;
        Ok(serde_json::from_slice(&bytes)?)
    }

    fn forget_undone(&mut self) {
        let kept = self.done.saturating_sub(self.offsets.len());
        for (_, bytes) in self.recent.drain(kept.min(self.recent.len())..) {
            self.recent_bytes -= bytes;
        }
        if let Some(&end) = self.offsets.get(self.done) {
            self.offsets.truncate(self.done);
            self.file_bytes = end;
        }
    }

    /// Moves the oldest steps in memory to the file.
    fn put_away(&mut self, count: usize) -> io::Result<()> {
        if self.file.is_none() {
            let dir = fsio::cache_dir();
            let made = std::fs::create_dir_all(&dir).and_then(|()| tempfile::tempfile_in(&dir));
            self.file = Some(made.or_else(|_| tempfile::tempfile())?);
        }
        let file = self.file.as_ref().ok_or_else(|| io::Error::other("no file"))?;
        let mut bytes = Vec::new();
        let mut starts = Vec::new();
        for (entry, _) in self.recent.iter().take(count) {
            starts.push(self.file_bytes + bytes.len() as u64);
            serde_json::to_writer(&mut bytes, entry)?;
        }
        file.write_all_at(&bytes, self.file_bytes)?;
        self.file_bytes += bytes.len() as u64;
        self.offsets.extend(starts);
        for (_, bytes) in self.recent.drain(..count) {
            self.recent_bytes -= bytes;
        }
        Ok(())
    }
}

/// Approximate size of a step, by keys and rows.
fn size(entry: &Entry) -> usize {
    [&entry.undo, &entry.redo].into_iter().map(Delta::weight).sum::<usize>() + entry.label.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(n: usize) -> Entry {
        let delta = |name: String| Delta { name: Some(name), ..Delta::default() };
        Entry {
            label: format!("step {n}"),
            undo: delta(format!("{}", n.wrapping_sub(1))),
            redo: delta(format!("{n}")),
        }
    }

    #[test]
    fn ten_thousand_steps_are_there_and_few_are_in_memory() {
        let mut history = History::default();
        for n in 0..10_000 {
            history.push(entry(n));
        }
        assert!(history.recent.len() <= RECENT, "{}", history.recent.len());
        assert_eq!(history.len(), 10_000);
        for n in (0..10_000).rev() {
            assert_eq!(history.last().unwrap().unwrap(), entry(n));
            history.step_back();
        }
        assert_eq!(history.last().unwrap(), None);
        for n in 0..20 {
            assert_eq!(history.next().unwrap().unwrap(), entry(n));
            history.step_on();
        }
        assert_eq!(history.labels(18..21), ["step 18", "step 19", "step 20"]);
        // A new edit replaces the redo steps, beginning at a step in the file.
        for n in 20_000..25_000 {
            history.push(entry(n));
        }
        assert_eq!(history.len(), 5_020);
        for n in (20_000..25_000).rev().chain((0..20).rev()) {
            assert_eq!(history.last().unwrap().unwrap(), entry(n));
            history.step_back();
        }
    }

    #[test]
    fn large_steps_leave_memory_sooner() {
        let mut history = History::default();
        for n in 0..40 {
            let notes = Some("x".repeat(1 << 20));
            let undo = Delta { notes, ..Delta::default() };
            history.push(Entry { undo, ..entry(n) });
        }
        assert!(history.recent_bytes <= RECENT_BYTES, "{}", history.recent_bytes);
        assert_eq!(history.len(), 40);
        assert_eq!(history.entry(0).unwrap().undo.notes.unwrap().len(), 1 << 20);
    }
}
