//! The way to the simulation.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use super::robot_context::RobotContext;
use super::rollout_store::RolloutStore;
use super::worker::{Dense, Perform, Question, SetPolicy, Stop, WorkerHandle, WorkerSink};
use crate::protocol::{Error, Hub, RobotFacts, RolloutSettings};
use robert_clip::{Clip, Command};
use robert_net::Threads;

/// The simulation. Clones share it.
#[derive(Clone, Debug)]
pub(crate) struct Simulation {
    /// The simulated rollout, for reading.
    pub(crate) rollout: Arc<RolloutStore>,
    worker: WorkerHandle,
    /// The folder where a model's relative path starts.
    folder: PathBuf,
}

impl Simulation {
    /// Starts the worker. `binary` is this program; pinned takes are kept in `state_dir`.
    ///
    /// # Errors
    /// If the operating system cannot start the thread.
    pub(crate) fn start(
        binary: PathBuf,
        folder: PathBuf,
        state_dir: &Path,
        hub: Hub,
    ) -> std::io::Result<Simulation> {
        let rollout = RolloutStore::open(hub, state_dir.join("takes"));
        let sink: Arc<dyn WorkerSink> = Arc::<RolloutStore>::clone(&rollout);
        let worker = WorkerHandle::start(binary, sink)?;
        Ok(Simulation { rollout, worker, folder })
    }

    /// The robot of the open document.
    pub(crate) fn robot(&self) -> Option<Arc<RobotContext>> {
        self.rollout.robot()
    }

    /// Sets the robot of the open document; rollouts of another robot are removed.
    pub(crate) fn set_robot(&self, facts: Option<RobotFacts>) {
        self.rollout.set_robot(facts.map(RobotContext::new).map(Arc::new));
    }

    /// Sets how rollouts are made from now on.
    pub(crate) fn set_settings(&self, settings: RolloutSettings) {
        self.rollout.set_settings(settings.clone());
        let mut policy = settings.config();
        // There is one rollout at a time, and a person waits for it.
        policy.inference.threads = Threads::Faster;
        // A text that names no file is the name of a model that comes with the program or the
        // robot.
        let full =
            |p: String| Some(self.folder.join(&p)).filter(|f| f.exists()).unwrap_or(p.into());
        policy.model_path = settings.model_path.map(full);
        self.worker.tell(SetPolicy { policy, seed: settings.seed });
    }

    /// Performs a version of the document.
    pub(crate) fn perform(&self, rev: u64, clip: &Clip, command: &Command) {
        let generation = self.rollout.begin(rev, command, Some(clip));
        let command = Dense::of(command);
        self.worker.tell(Perform { generation, compare: true, command });
    }

    /// Performs the result of an edit without storing it. While a key is dragged, `auto` keeps the
    /// policy that was best before.
    pub(crate) fn preview(&self, command: &Command) {
        let generation = self.rollout.begin(0, command, None);
        let command = Dense::of(command);
        self.worker.tell(Perform { generation, compare: false, command });
    }

    /// Stops performing.
    pub(crate) fn cancel(&self) {
        self.worker.tell(Stop);
        self.rollout.cancel();
    }

    /// Asks a question and waits for the answer.
    ///
    /// # Errors
    /// [`Error::Worker`], [`Error::Simulation`].
    pub(crate) async fn ask<Q: Question>(&self, question: Q) -> Result<Q::Answer, Error> {
        self.worker.ask(question).await
    }

    /// Asks a question and waits for the answer, on a thread that may block.
    ///
    /// # Errors
    /// [`Error::Worker`], [`Error::Simulation`].
    pub(crate) fn ask_blocking<Q: Question>(
        &self,
        question: Q,
        patience: Duration,
    ) -> Result<Q::Answer, Error> {
        self.worker.ask_blocking(question, patience)
    }

    /// Asks, and calls back with the answer.
    pub(crate) fn ask_with<Q: Question>(
        &self,
        question: Q,
        reply: impl FnOnce(Result<Q::Answer, Error>) + Send + 'static,
    ) {
        self.worker.ask_with(question, reply);
    }

    /// Starts a new worker after one has died too often.
    pub(crate) fn restart(&self) {
        self.worker.restart();
    }

    /// Ends the worker.
    pub(crate) fn shutdown(&self) {
        self.worker.shutdown();
    }
}
