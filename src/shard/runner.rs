//! Performs cells in this process, and keeps what several of them need: robot, data, clips.

use std::path::Path;

use robert_base::progress::Cancel;

use super::checkpoints::Checkpoints;
use super::context::Context;
use super::{
    Accept, Cell, Error, Machine, Manifest, Plan, Spec, collecting, evaluating, folder, training,
};

/// How a shard was completed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Done {
    /// The shard was performed by this call.
    Now,
    /// The shard was performed by an earlier call.
    Before,
}

/// An opened plan, for work on this machine.
#[derive(Debug)]
pub struct Runner {
    context: Context,
    accept: Accept,
    machine: Machine,
    common: String,
}

impl Runner {
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
        let common = plan.common();
        let context = Context::new(dir, plan, threads, checkpoint_secs, cancel)?;
        Ok(Runner { context, accept, machine, common })
    }

    /// The plan.
    pub fn plan(&self) -> &Plan {
        &self.context.plan
    }

    /// Whether a shard was finished or a checkpoint was saved since the beginning.
    pub fn has_advanced(&self) -> bool {
        self.context.advanced.get()
    }

    /// Performs a shard unless it is done. It may be killed at any time.
    ///
    /// # Errors
    /// Those of the work; [`Error::Stopped`] after a stop was requested.
    pub fn run(&self, index: usize) -> Result<Done, Error> {
        let context = &self.context;
        let cell = context.plan.cell(index)?;
        if context.cancel.is_cancelled() {
            return Err(Error::Stopped { index });
        }
        let name = Plan::name_of(&self.common, index, cell);
        let parent = context.plan.parent_of(&context.dir, index);
        let target = parent.join(&name);
        let done = |found: &Manifest| {
            found.index == index && context.plan.foreign(found, self.accept).is_none()
        };
        if folder::whole(&target).is_ok_and(|found| done(&found)) {
            return Ok(Done::Before);
        }
        let temporary = folder::temporary(&parent, index)?;
        let out = temporary.path().join("out");
        std::fs::create_dir(&out).map_err(super::error::write_error(&out))?;
        let checkpoints = Checkpoints::new(&context.dir, &name);
        let found = match (&context.plan.spec, cell) {
            (Spec::Collect(spec), Cell::Collect { seed, transitions }) => {
                collecting::perform(context, spec, *seed, *transitions, &out)
            }
            (Spec::Eval(spec), Cell::Eval { suite, policy, seed, tasks, clips_sha256 }) => {
                let part = evaluating::Part { suite, policy, seed: *seed, tasks, clips_sha256 };
                evaluating::perform(context, spec, &part, &out)
            }
            (Spec::Sweep(spec) | Spec::Train(spec), Cell::Train { values, seed }) => {
                let run = temporary.path().join("run");
                training::perform(context, spec, values, *seed, &run, &out, &checkpoints)
            }
            _ => {
                let why = format!("shard {index} is of another kind than the spec");
                return Err(Error::Plan { why, path: context.dir.clone() });
            }
        };
        let lost = match found {
            Err(_) if context.cancel.is_cancelled() => return Err(Error::Stopped { index }),
            found => found?,
        };
        let manifest = Manifest::of(&out, index, &name, cell, &self.machine, lost)?;
        folder::publish(&out, &target, &manifest)?;
        checkpoints.clear();
        context.advance();
        Ok(Done::Now)
    }
}
