//! Performs cells in this process, and keeps what several of them need: robot, data, clips.

use std::cell::{Cell as Flag, OnceCell, RefCell};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use robert_base::progress::Cancel;
use robert_clip::Clip;
use robert_dataset::{Dataset, Verify};
use robert_robot::Robot;

use super::checkpoints::Checkpoints;
use super::{
    Accept, Cell, Error, Machine, Manifest, Plan, Spec, collecting, evaluating, folder, planning,
    training,
};

/// How a shard came to be done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Done {
    /// By this call.
    Now,
    /// By an earlier one.
    Before,
}

/// A plan, opened for work on this machine.
#[derive(Debug)]
pub struct Workshop {
    pub(super) dir: PathBuf,
    pub(super) plan: Plan,
    pub(super) robot: Arc<Robot>,
    pub(super) threads: usize,
    /// Seconds between published checkpoints of a training shard.
    pub(super) checkpoint_secs: f64,
    pub(super) cancel: Cancel,
    accept: Accept,
    machine: Machine,
    common: String,
    /// Whether anything was finished or saved, so that a repetition would get further.
    advanced: Flag<bool>,
    data: OnceCell<PathBuf>,
    pub(super) suites: RefCell<BTreeMap<String, Vec<(String, Clip)>>>,
    pub(super) models: RefCell<BTreeSet<String>>,
}

impl Workshop {
    /// Opens the plan in `dir`.
    ///
    /// # Errors
    /// [`Error::Plan`], [`Error::Processor`], [`Error::Build`], [`Error::Input`] for a robot that
    /// has changed.
    pub fn open(
        dir: &Path,
        accept: Accept,
        threads: usize,
        checkpoint_secs: f64,
        cancel: &Cancel,
    ) -> Result<Self, Error> {
        let plan = Plan::load(dir)?;
        let machine = plan.admit(accept)?;
        let robot = Arc::new(Robot::load(plan.spec.robot())?);
        if plan.inputs.get("robot") != Some(&planning::fingerprint(&robot)?) {
            return Err(Error::Input { what: format!("the robot {}", plan.spec.robot()) });
        }
        let common = plan.common();
        Ok(Workshop {
            dir: dir.to_owned(),
            plan,
            robot,
            threads,
            checkpoint_secs,
            cancel: cancel.clone(),
            accept,
            machine,
            common,
            advanced: Flag::new(false),
            data: OnceCell::new(),
            suites: RefCell::default(),
            models: RefCell::default(),
        })
    }

    /// The plan.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Whether a shard was finished or a checkpoint was saved since the beginning.
    pub fn has_advanced(&self) -> bool {
        self.advanced.get()
    }

    pub(super) fn advance(&self) {
        self.advanced.set(true);
    }

    /// Performs a shard unless it is done. It may be killed at any time.
    ///
    /// # Errors
    /// Those of the work; [`Error::Stopped`] after a stop was requested.
    pub fn run(&self, index: usize) -> Result<Done, Error> {
        let cell = self.plan.cell(index)?;
        if self.cancel.is_cancelled() {
            return Err(Error::Stopped { index });
        }
        let name = Plan::name_of(&self.common, index, cell);
        let parent = self.plan.parent_of(&self.dir, index);
        let target = parent.join(&name);
        let done = |found: &Manifest| {
            found.index == index && self.plan.foreign(found, self.accept).is_none()
        };
        if folder::whole(&target).is_ok_and(|found| done(&found)) {
            return Ok(Done::Before);
        }
        let temporary = folder::temporary(&parent, index)?;
        let out = temporary.path().join("out");
        std::fs::create_dir(&out).map_err(super::error::write_error(&out))?;
        let checkpoints = Checkpoints::new(&self.dir, &name);
        let found = match (&self.plan.spec, cell) {
            (Spec::Collect(spec), Cell::Collect { seed, transitions }) => {
                collecting::perform(self, spec, *seed, *transitions, &out)
            }
            (Spec::Eval(spec), Cell::Eval { suite, policy, seed, tasks, clips_sha256 }) => {
                let part = evaluating::Part { suite, policy, seed: *seed, tasks, clips_sha256 };
                evaluating::perform(self, spec, &part, &out)
            }
            (Spec::Sweep(spec) | Spec::Train(spec), Cell::Train { values, seed }) => {
                let run = temporary.path().join("run");
                training::perform(self, spec, values, *seed, &run, &out, &checkpoints)
            }
            _ => {
                let why = format!("shard {index} is of another kind than the spec");
                return Err(Error::Plan { why, path: self.dir.clone() });
            }
        };
        let lost = match found {
            Err(_) if self.cancel.is_cancelled() => return Err(Error::Stopped { index }),
            found => found?,
        };
        let manifest = Manifest::of(&out, index, &name, cell, &self.machine, lost)?;
        folder::publish(&out, &target, &manifest)?;
        checkpoints.clear();
        self.advance();
        Ok(Done::Now)
    }

    /// The dataset of a training plan, verified once per process.
    pub(super) fn data(&self) -> Result<&Path, Error> {
        if let Some(known) = self.data.get() {
            return Ok(known);
        }
        let Some(path) = self.plan.data_in(&self.dir) else {
            return Err(Error::Plan { why: "it names no data".to_owned(), path: self.dir.clone() });
        };
        let data = Dataset::open(&path, Verify::Full)?;
        if self.plan.inputs.get("data") != Some(&data.manifest().sha256()) {
            return Err(Error::Input { what: format!("the data in {}", path.display()) });
        }
        Ok(self.data.get_or_init(|| path))
    }
}
