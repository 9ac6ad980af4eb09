//! The interface of the viewport for clients and requests.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use tokio::sync::{mpsc, oneshot, watch};

use super::incoming::Incoming;
use super::message::ViewportMessage;
use super::run;
use super::shared::Shared;
use super::stage::Stage;
use crate::protocol::{DrawRequest, Error, Hovered, Hub, Pin, StudioOp};
use crate::simulation::Simulation;
use robert_base::limits;
use robert_take::viser::Message;

/// Messages that may wait for the stage.
const INBOX: usize = 256;

/// The viewport, shared by its clients.
#[derive(Debug)]
pub(crate) struct Viewport {
    shared: Arc<Shared>,
    stage: mpsc::Sender<ViewportMessage>,
    clients: AtomicUsize,
}

/// Counts a client while it is connected.
#[derive(Debug)]
pub(crate) struct Seat(Arc<Viewport>);

impl Drop for Seat {
    fn drop(&mut self) {
        self.0.clients.fetch_sub(1, Ordering::SeqCst);
    }
}

impl Viewport {
    /// Starts the stage.
    pub(crate) fn start(simulation: Simulation, hub: Hub) -> Arc<Viewport> {
        let (tx, rx) = mpsc::channel(INBOX);
        let shared = Arc::new(Shared::new());
        let stage = Stage::new(Arc::clone(&shared), simulation, hub, tx.clone());
        tokio::spawn(run::run(stage, rx));
        Arc::new(Viewport { shared, stage: tx, clients: AtomicUsize::new(0) })
    }

    /// A place for one more client.
    ///
    /// # Errors
    /// [`Error::Full`].
    pub(crate) fn seat(self: &Arc<Viewport>) -> Result<Seat, Error> {
        let before = self.clients.fetch_add(1, Ordering::SeqCst);
        let seat = Seat(Arc::clone(self));
        if before >= limits::CLIENTS {
            return Err(Error::Full { what: "viewports", cap: limits::CLIENTS });
        }
        Ok(seat)
    }

    /// Wakes whenever the scene has changed.
    pub(crate) fn watch(&self) -> watch::Receiver<u64> {
        self.shared.watch()
    }

    /// The messages that a client has missed since a stamp, and the stamp from now on. From 0: what
    /// a new client needs.
    pub(crate) fn since(&self, seen: u64) -> (Vec<Message>, u64) {
        self.shared.since(seen)
    }

    /// Joints that are locked: no drag moves them.
    pub(crate) fn locked(&self) -> Vec<String> {
        self.shared.locked()
    }

    /// Sites that inverse kinematics keeps in place.
    pub(crate) fn pins(&self) -> Vec<Pin> {
        self.shared.pins()
    }

    /// The place in the world of a line over a page's picture: x, y, z in m, and seconds.
    ///
    /// # Errors
    /// [`Error::Request`] where the plane cannot be seen.
    pub(crate) async fn sketch(&self, ask: &DrawRequest) -> Result<Vec<[f64; 4]>, Error> {
        let full = |_| Error::Full { what: "requests to the viewport", cap: INBOX };
        let (reply, answer) = oneshot::channel();
        let (tab, points, site) = (ask.tab.clone(), ask.points.clone(), ask.site.clone());
        let message = ViewportMessage::Sketch(tab, points, ask.plane, site, reply);
        self.stage.try_send(message).map_err(full)?;
        answer.await.unwrap_or_else(|_| Err(Error::request("the studio is shutting down")))
    }

    /// A message of a page's 3D client. If the stage's inbox is full, moves are dropped, since the
    /// next one contains the newer pose.
    pub(crate) fn hear(&self, tab: Option<String>, said: Incoming) {
        self.stage.try_send(ViewportMessage::Client(tab, said)).ok();
    }

    /// Carries out a request of a page to the viewport.
    ///
    /// # Errors
    /// [`Error::Full`] in a storm of requests.
    pub(crate) async fn tell(&self, op: StudioOp) -> Result<(), Error> {
        let full = |_| Error::Full { what: "requests to the viewport", cap: INBOX };
        let (done, finished) = oneshot::channel();
        self.stage.try_send(ViewportMessage::View(op, done)).map_err(full)?;
        // The stage ends only with the studio, and then nobody waits for the answer.
        finished.await.ok();
        Ok(())
    }

    /// The part of the robot under a page's pointer; `at` is 0 to 1 from the top left corner of its
    /// viewport.
    pub(crate) async fn under(&self, tab: &str, at: [f64; 2]) -> Option<Hovered> {
        let (reply, answer) = oneshot::channel();
        self.stage.try_send(ViewportMessage::Hover(tab.to_owned(), at, reply)).ok()?;
        answer.await.ok().flatten()
    }
}
