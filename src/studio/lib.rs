//! The studio: a local web app to author keyframes and watch a policy perform them.
//!
//! It is one process with one loopback port. The rooms, from the outside in:
//!
//! | room | owns |
//! |---|---|
//! | `http` | port, routes, guard, the editor's socket, the viewport's socket: thin handlers |
//! | `state` | the handles that requests need |
//! | `session` | the thread that answers for the document, and the writer that owns it |
//! | `viewport` | the 3D scene and the gestures in it |
//! | `simulation` | the worker process, the rollout's frames, takes |
//! | `jobs` | collect, train, evaluate, import and export as child processes |
//! | `workspace` | folders, recent files, examples, imports, exports, pictures |
//! | `document` | clip, history, file, and the journal, which survives a kill |
//! | [`protocol`] | the messages between studio and clients |
//!
//! Three guarantees shape it: an edit is acknowledged only when it is on disk, no failure of a model
//! or a client can destroy the document, and only edits and saves wait for a disk.

mod document;
mod http;
mod jobs;
pub mod protocol;
mod session;
mod simulation;
mod state;
mod viewport;
mod workspace;

pub use http::{has_page, has_viser};
pub use protocol::Error;
pub use simulation::run_worker;
pub use workspace::state_dir;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::watch;

use http::Guard;
use jobs::Jobs;
use protocol::{Hub, RolloutSettings};
use session::{Session, SessionCommand, Write};
use simulation::Simulation;
use state::{App, Clients};
use viewport::Viewport;
use workspace::{Workspace, gallery};

use robert_rollout::PolicyName;

/// Options for starting the studio.
#[derive(Clone, Debug)]
pub struct StudioConfig {
    /// A clip to open.
    pub clip_path: Option<PathBuf>,
    /// A robot for which an empty clip is started.
    pub robot: Option<String>,
    /// Learned model to perform with.
    pub model_path: Option<PathBuf>,
    /// Port; 0 for any.
    pub port: u16,
    /// This program, for the children.
    pub binary: PathBuf,
    /// Journals of unsaved clips, recent files.
    pub state_dir: PathBuf,
    /// The folder where relative paths start.
    pub folder: PathBuf,
}

/// The time in which clients and jobs learn that the studio ends.
const FAREWELL: Duration = Duration::from_millis(300);
/// The time that the session has for its last writes.
const LAST_WRITES: Duration = Duration::from_millis(1500);

/// Runs the studio until SIGINT or SIGTERM. As soon as connections are accepted, `ready` gets two
/// addresses: one with the token, and one for the browser that the studio starts, with a code that
/// can be used once.
///
/// # Errors
/// [`Error::Bind`], [`Error::Clip`], [`Error::Locked`], [`Error::Server`].
pub fn run(config: StudioConfig, ready: impl FnOnce(&str, &str)) -> Result<(), Error> {
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .map_err(Error::Server)?;
    let result = runtime.block_on(serve(config, ready));
    runtime.shutdown_timeout(FAREWELL);
    result
}

async fn serve(config: StudioConfig, ready: impl FnOnce(&str, &str)) -> Result<(), Error> {
    let (end, ending) = watch::channel(false);
    let (listener, port) = http::bind(config.port).await?;
    let guard = Arc::new(Guard::new(port).map_err(Error::Server)?);
    let hub = Hub::new();
    let StudioConfig { folder, binary, state_dir, .. } = config.clone();
    let simulation = Simulation::start(binary.clone(), folder.clone(), &state_dir, hub.clone());
    let simulation = simulation.map_err(Error::Server)?;
    let workspace = Workspace::new(folder, state_dir, binary.clone()).map_err(Error::Server)?;
    let workspace = Arc::new(workspace);
    let session = session::start(Arc::clone(&workspace), hub.clone(), simulation.clone());
    let session = session.map_err(Error::Server)?;
    let app = Arc::new(App {
        guard: Arc::clone(&guard),
        hub: hub.clone(),
        session: session.clone(),
        simulation: simulation.clone(),
        viewport: Viewport::start(simulation.clone(), hub.clone()),
        jobs: Jobs::new(hub, binary),
        workspace,
        clients: Clients::default(),
        ending: ending.clone(),
    });
    // A clip that cannot be opened is reported on the command line, not in the page.
    let opened = first_document(&config, &session).await;
    let mut terminate = signal(SignalKind::terminate()).map_err(Error::Server)?;
    let mut interrupt = signal(SignalKind::interrupt()).map_err(Error::Server)?;
    let result = match opened {
        Ok(()) => {
            let router = http::router(Arc::clone(&app));
            let serving = tokio::spawn(http::serve(listener, router, ending));
            let address =
                |s: &http::guard::Secret| format!("http://127.0.0.1:{port}/#token={}", s.reveal());
            ready(&address(guard.token()), &address(guard.code()));
            tokio::select! {
                _ = terminate.recv() => {}
                _ = interrupt.recv() => {}
            }
            end.send(true).ok();
            serving.await.ok();
            Ok(())
        }
        Err(e) => Err(e),
    };
    app.jobs.stop();
    app.workspace.pictures.shutdown();
    // The studio ends even if a disk does not answer; acknowledged edits are in the journal.
    tokio::time::timeout(LAST_WRITES, session.write(Write::Shutdown)).await.ok();
    simulation.shutdown();
    tokio::time::sleep(Duration::from_millis(50)).await;
    result
}

async fn first_document(config: &StudioConfig, session: &Session) -> Result<(), Error> {
    if let Some(path) = &config.model_path {
        let settings = RolloutSettings {
            policy: PolicyName::Robert,
            model_path: Some(path.display().to_string()),
            ..RolloutSettings::default()
        };
        session.ask(|r| SessionCommand::Settings(settings, r)).await?;
    }
    if let Some(path) = &config.clip_path {
        if let Some(robot) = config.robot.clone() {
            session.write(|r| Write::Know(robot, r)).await?;
        }
        let named = path.to_str().and_then(|name| gallery::open(name).ok());
        let path = config.folder.join(path);
        match named {
            // As everywhere on the command line, a file has precedence over a task of that name.
            Some(clip) if !path.exists() => {
                session.write(|r| Write::New(Box::new(clip), r)).await?;
            }
            _ => {
                session.write(|r| Write::Open(path, r)).await?;
            }
        }
    } else if let Some(robot) = config.robot.clone() {
        let (length, name) = (100, String::new());
        session.write(|reply| Write::Blank { robot, length, name, reply }).await?;
    } else {
        // The document of a killed studio is opened again; documents that were put away wait in the
        // gallery.
        session.write(Write::Recover).await?;
    }
    Ok(())
}
