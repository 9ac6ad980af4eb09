//! The studio: a local web app to author keyframes and watch a policy perform them.
//!
//! One process, one loopback port. The parts, from the outside in:
//!
//! | module | owns |
//! |---|---|
//! | [`guard`] | who may talk to us: Host, Origin, token |
//! | [`server`] | port, routes, time limits, the end |
//! | [`protocol`] | what is said, precisely |
//! | `api`, `socket`, [`viser`] | requests, the editor channel, the 3D viewport |
//! | [`session`] | the thread that owns the document |
//! | [`document`], [`journal`] | clip + history + file; what survives a kill |
//! | [`live`], `takes` | the rollout's frames, and what each client has yet to see; rollouts kept |
//! | [`worker`] | the simulation, in a process of its own |
//! | [`pictures`] | rendered stills, by a second child |
//! | [`jobs`], `exchange`, `shelf` | collect, train, import, export as child processes; their files |
//! | `intake`, `folders` | clips that come as files; where they lie |
//!
//! Two promises shape it: an edit is acknowledged only when it is on disk, and nothing that
//! a model or a client does can take the document along.

mod api;
pub mod document;
pub mod error;
pub mod exchange;
mod export;
mod folders;
mod gallery;
pub mod guard;
pub mod hub;
mod intake;
pub mod jobs;
pub mod journal;
pub mod live;
mod pages;
pub mod pictures;
pub mod protocol;
mod recent;
pub mod server;
pub mod session;
pub mod shelf;
mod socket;
mod takes;
pub mod viser;
pub mod worker;

pub use error::Error;
pub use pages::{has_page, has_viser};
pub use recent::state_dir;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicUsize;
use std::time::Duration;

use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::watch;

use guard::Guard;
use hub::Hub;
use live::Live;
use protocol::RolloutSettings;
use server::App;
use session::{Ask, Session};
use viser::Viewport;
use worker::WorkerHandle;

use crate::rollout::PolicyName;

/// How the studio is started.
#[derive(Clone, Debug)]
pub struct StudioConfig {
    /// A clip to open.
    pub clip_path: Option<PathBuf>,
    /// A robot to start an empty clip for.
    pub robot: Option<String>,
    /// Learned model to perform with.
    pub model_path: Option<PathBuf>,
    /// Port; 0 for any.
    pub port: u16,
    /// This program, for the children.
    pub binary: PathBuf,
    /// Journals of unsaved clips, recent files.
    pub state_dir: PathBuf,
    /// Where relative paths start.
    pub folder: PathBuf,
}

/// Time for clients and jobs to hear of the end.
const FAREWELL: Duration = Duration::from_millis(300);

/// Runs the studio until SIGINT or SIGTERM. As soon as connections are accepted, `ready` gets
/// the address, token included, and the address for a browser that it starts, with a code that
/// is good for one use.
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
    let (listener, port) = server::bind(config.port).await?;
    let guard = Arc::new(Guard::new(port).map_err(Error::Server)?);
    let hub = Hub::new();
    let live = Live::new(hub.clone());
    let sink: Arc<dyn worker::WorkerSink> = Arc::<Live>::clone(&live);
    let worker = WorkerHandle::start(config.binary.clone(), sink).map_err(Error::Server)?;
    let recent = Arc::new(recent::Recent::load(&config.state_dir));
    let session = Session::start(
        config.state_dir.clone(),
        config.folder.clone(),
        hub.clone(),
        Arc::clone(&live),
        worker.clone(),
        Arc::clone(&recent),
    )
    .map_err(Error::Server)?;
    let app = Arc::new(App {
        guard: Arc::clone(&guard),
        hub: hub.clone(),
        live: Arc::clone(&live),
        worker: worker.clone(),
        session: session.clone(),
        recent,
        viewport: Viewport::start(Arc::clone(&live), worker.clone(), hub.clone()),
        jobs: jobs::Jobs::new(hub, config.binary.clone()),
        pictures: pictures::Pictures::new(config.binary.clone(), &config.state_dir)
            .map_err(Error::Server)?,
        uploads: Arc::new(exchange::Uploads::new().map_err(Error::Server)?),
        state_dir: config.state_dir.clone(),
        folder: config.folder.clone(),
        clients: AtomicUsize::new(0),
        next_client: AtomicUsize::new(0),
        ending: ending.clone(),
    });
    // A clip that cannot be opened is an error of the command line, not of a page.
    let opened = first_document(&config, &session).await;
    let mut terminate = signal(SignalKind::terminate()).map_err(Error::Server)?;
    let mut interrupt = signal(SignalKind::interrupt()).map_err(Error::Server)?;
    let result = match opened {
        Ok(()) => {
            let router = server::router(Arc::clone(&app));
            let serving = tokio::spawn(server::serve(listener, router, ending));
            let address =
                |s: &guard::Secret| format!("http://127.0.0.1:{port}/#token={}", s.reveal());
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
    app.pictures.shutdown();
    session.ask(Ask::Shutdown).await.ok();
    worker.shutdown();
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
        session.ask(|r| Ask::Settings(settings, r)).await?;
    }
    if let Some(path) = &config.clip_path {
        if let Some(robot) = config.robot.clone() {
            session.ask(|r| Ask::Know(robot, r)).await?;
        }
        let named = path.to_str().and_then(|name| gallery::open(name).ok());
        let path = config.folder.join(path);
        match named {
            // As everywhere on the command line, a file goes before a task of that name.
            Some(clip) if !path.exists() => {
                session.ask(|r| Ask::New(Box::new(clip), r)).await?;
            }
            _ => {
                session.ask(|r| Ask::Open(path, r)).await?;
            }
        }
    } else if let Some(robot) = config.robot.clone() {
        let (length, name) = (100, String::new());
        session.ask(|reply| Ask::Blank { robot, length, name, reply }).await?;
    } else {
        // What a killed studio had open; what was put away waits in the gallery.
        session.ask(Ask::Recover).await?;
    }
    Ok(())
}
