//! The state of each shard, judged by its files alone.

use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::{Accept, Manifest, Plan, folder};

/// The content of a shard's place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum State {
    /// A whole shard of this plan.
    Done,
    /// Nothing.
    Missing,
    /// A damaged shard, and the problem.
    Corrupt(String),
    /// A complete shard made by another kind of processor or another program; the text names which.
    Foreign(String),
}

/// The states of all shards, by index.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Survey {
    /// One for each shard.
    pub states: Vec<State>,
}

/// Reads and hashes the files of every shard. A damaged one is a state, not an error.
pub fn survey(dir: &Path, plan: &Plan, accept: Accept) -> Survey {
    inspect(dir, plan, accept).0
}

/// The survey, and the manifests of all whole shards by index.
pub(super) fn inspect(dir: &Path, plan: &Plan, accept: Accept) -> (Survey, Vec<Option<Manifest>>) {
    let common = plan.common();
    let next = AtomicUsize::new(0);
    let work = || {
        let mut mine = Vec::new();
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(cell) = plan.cells.get(index) else { return mine };
            let place = plan.parent_of(dir, index).join(Plan::name_of(&common, index, cell));
            mine.push((index, state(&place, plan, index, accept)));
        }
    };
    let threads = std::thread::available_parallelism().map_or(1, usize::from).min(16);
    let mut found: Vec<(usize, (State, Option<Manifest>))> = std::thread::scope(|scope| {
        let handles: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        let each = handles.into_iter().map(std::thread::ScopedJoinHandle::join);
        each.flat_map(|r| r.unwrap_or_else(|panic| std::panic::resume_unwind(panic))).collect()
    });
    found.sort_by_key(|(index, _)| *index);
    let (states, manifests) = found.into_iter().map(|(_, each)| each).unzip();
    (Survey { states }, manifests)
}

fn state(place: &Path, plan: &Plan, index: usize, accept: Accept) -> (State, Option<Manifest>) {
    if !place.exists() {
        return (State::Missing, None);
    }
    match folder::whole(place) {
        Err(why) => (State::Corrupt(why), None),
        Ok(found) => (judge(&found, plan, index, accept), Some(found)),
    }
}

fn judge(found: &Manifest, plan: &Plan, index: usize, accept: Accept) -> State {
    if found.index != index {
        return State::Corrupt(format!("it is shard {}", found.index));
    }
    plan.foreign(found, accept).map_or(State::Done, State::Foreign)
}

impl Survey {
    fn of(&self, wanted: impl Fn(&State) -> bool) -> Vec<usize> {
        self.states.iter().enumerate().filter(|(_, s)| wanted(s)).map(|(i, _)| i).collect()
    }

    /// Indices of whole shards.
    pub fn done(&self) -> Vec<usize> {
        self.of(|s| *s == State::Done)
    }

    /// Indices without files.
    pub fn missing(&self) -> Vec<usize> {
        self.of(|s| *s == State::Missing)
    }

    /// Indices of damaged shards.
    pub fn corrupt(&self) -> Vec<usize> {
        self.of(|s| matches!(s, State::Corrupt(_)))
    }

    /// Indices of shards by another kind of processor or another program.
    pub fn foreign(&self) -> Vec<usize> {
        self.of(|s| matches!(s, State::Foreign(_)))
    }

    /// Indices to run: everything that is not done.
    pub fn left(&self) -> Vec<usize> {
        self.of(|s| *s != State::Done)
    }
}
