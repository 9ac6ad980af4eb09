//! The handles that requests need.

use std::sync::Arc;
use std::sync::atomic::AtomicUsize;

use tokio::sync::watch;

use crate::http::Guard;
use crate::jobs::Jobs;
use crate::protocol::Hub;
use crate::session::Session;
use crate::simulation::Simulation;
use crate::viewport::Viewport;
use crate::workspace::{Workspace, robot_folders};

/// Everything that requests share.
#[derive(Debug)]
pub(crate) struct App {
    /// The checks.
    pub(crate) guard: Arc<Guard>,
    /// The events.
    pub(crate) hub: Hub,
    /// The document.
    pub(crate) session: Session,
    /// The rollout, and questions about robots.
    pub(crate) simulation: Simulation,
    /// The 3D viewport.
    pub(crate) viewport: Arc<Viewport>,
    /// Long jobs.
    pub(crate) jobs: Jobs,
    /// Files.
    pub(crate) workspace: Arc<Workspace>,
    /// Editor clients.
    pub(crate) clients: Clients,
    /// Turns true at the end.
    pub(crate) ending: watch::Receiver<bool>,
}

/// Editor clients.
#[derive(Debug, Default)]
pub(crate) struct Clients {
    /// The number of connections that are open.
    pub(crate) now: AtomicUsize,
    /// The number of connections so far.
    pub(crate) all: AtomicUsize,
}

impl App {
    /// The source from which a robot is loaded: the one that the open document uses, else the
    /// program or a folder beside it, else the given text.
    pub(crate) fn robot_source(&self, id: String) -> String {
        let Workspace { folder, state_dir, .. } = &*self.workspace;
        match self.simulation.robot() {
            Some(robot) if robot.id == id => robot.source.clone(),
            _ => robot_folders::source(&id, folder, state_dir).unwrap_or(id),
        }
    }
}
