//! The state that all kinds of work share in a process: plan, robot, data, clips.

use std::cell::{Cell as Flag, OnceCell, RefCell};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use robert_base::progress::Cancel;
use robert_clip::Clip;
use robert_dataset::{Dataset, Verify};
use robert_robot::Robot;

use super::draft::fingerprint;
use super::{Error, Plan};

/// A plan, its robot, and what was read for it.
#[derive(Debug)]
pub(super) struct Context {
    pub(super) dir: PathBuf,
    pub(super) plan: Plan,
    pub(super) robot: Arc<Robot>,
    pub(super) threads: usize,
    /// Seconds between published checkpoints of a training shard.
    pub(super) checkpoint_secs: f64,
    pub(super) cancel: Cancel,
    /// Whether anything was finished or saved, so that another attempt would continue from there.
    pub(super) advanced: Flag<bool>,
    data: OnceCell<PathBuf>,
    /// Clips of built-in suites.
    pub(super) suites: RefCell<BTreeMap<String, Vec<(String, Clip)>>>,
    /// Policies whose models were found unchanged.
    pub(super) models: RefCell<BTreeSet<String>>,
}

impl Context {
    /// Loads the robot of a plan in `dir`.
    ///
    /// # Errors
    /// [`Error::Input`] for a robot that has changed.
    pub(super) fn new(
        dir: &Path,
        plan: Plan,
        threads: usize,
        checkpoint_secs: f64,
        cancel: &Cancel,
    ) -> Result<Self, Error> {
        let robot = Arc::new(Robot::load(plan.spec.robot())?);
        if plan.inputs.get("robot") != Some(&fingerprint(&robot)?) {
            return Err(Error::Input { what: format!("the robot {}", plan.spec.robot()) });
        }
        Ok(Context {
            dir: dir.to_owned(),
            plan,
            robot,
            threads,
            checkpoint_secs,
            cancel: cancel.clone(),
            advanced: Flag::new(false),
            data: OnceCell::new(),
            suites: RefCell::default(),
            models: RefCell::default(),
        })
    }

    pub(super) fn advance(&self) {
        self.advanced.set(true);
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
