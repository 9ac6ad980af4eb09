//! The state of each shard, judged by its files alone.

use std::path::Path;

use robert_base::parallel;

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
    let threads = parallel::cores().min(16);
    let found = parallel::each(threads, &plan.cells, |index, cell| {
        let name = Plan::name_of(&common, index, cell);
        state(&plan.parent_of(dir, index).join(name), plan, index, accept)
    });
    let (states, manifests) = found.into_iter().unzip();
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
