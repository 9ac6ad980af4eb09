//! The result of replaying a journal, without opening it.

use robert_clip::Step;

/// The history that a replay of the journal would have. After a save it is shorter than the true
/// one, and its missing steps must be written out as an edit.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Replayed {
    pub(super) done: usize,
    pub(super) len: usize,
    /// Whether an undo went back beyond the beginning of this history; from then on the two
    /// histories differ.
    pub(super) apart: bool,
}

impl Replayed {
    /// The history that these steps make.
    pub(super) fn of(steps: &[Step]) -> Replayed {
        let mut replayed = Replayed::default();
        for step in steps {
            match step {
                Step::Edit { .. } => replayed.push(),
                Step::Undo => drop(replayed.undo()),
                Step::Redo => drop(replayed.redo()),
            }
        }
        replayed
    }

    pub(super) fn push(&mut self) {
        self.done += 1;
        self.len = self.done;
    }

    pub(super) fn undo(&mut self) -> bool {
        let known = !self.apart && self.done > 0;
        if known {
            self.done -= 1;
        } else {
            self.apart = true;
            self.push();
        }
        known
    }

    pub(super) fn redo(&mut self) -> bool {
        let known = !self.apart && self.done < self.len;
        if known {
            self.done += 1;
        } else {
            self.push();
        }
        known
    }
}
