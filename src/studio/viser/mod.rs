//! The 3D viewport: our side of the viser 1.1.1 protocol.
//!
//! | module | owns |
//! |---|---|
//! | `framing` | where the camera stands |
//! | `hand` | what a hand in the viewport does |
//! | `incoming` | what the client says |
//! | `look` | what a pointer is over |
//! | `retained` | the scene, and what each client has yet to see of it |
//! | `scene` | a robot as nodes |
//! | `shell` | the outline of the selected link |
//! | `stage` | what is shown |
//!
//! The messages and their encoding are in [`crate::take::viser`]. The client checks nothing
//! and reconnects by itself; every connection gets the whole scene first.

mod framing;
mod hand;
mod incoming;
mod look;
mod retained;
mod scene;
mod shell;
mod space;
mod stage;

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use axum::body::Bytes;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{Message as Frame, WebSocket, WebSocketUpgrade};
use axum::extract::{RawQuery, State};
use axum::response::{IntoResponse, Response};
use tokio::sync::{mpsc, oneshot, watch};

use super::api::Refused;
use super::error::Error;
use super::hub::Hub;
use super::live::Live;
use super::pages;
use super::protocol::StudioOp;
use super::server::{App, ended};
use super::worker::WorkerHandle;
use crate::limits;
use crate::take::viser::{Message, SUBPROTOCOL, frame};
use incoming::Incoming;
pub use look::Hovered;
use retained::Retained;
use stage::{Say, Stage};

/// Messages that may wait for the stage.
const INBOX: usize = 256;
/// Between two frames to a client.
const FLUSH: Duration = Duration::from_micros(16_667);
/// Bytes of arrays in one frame: a big robot comes in parts.
const FRAME_BYTES: usize = 4 << 20;
/// Characters of a page's name.
const TAB: usize = 32;
/// A client that takes nothing for so long is gone.
const PATIENCE: Duration = Duration::from_secs(30);

/// The viewport, shared by its clients.
#[derive(Debug)]
pub struct Viewport {
    scene: Mutex<Retained>,
    changed: watch::Sender<u64>,
    stage: mpsc::Sender<Say>,
    clients: AtomicUsize,
}

impl Viewport {
    /// Starts the stage.
    pub fn start(live: Arc<Live>, worker: WorkerHandle, hub: Hub) -> Arc<Viewport> {
        let (tx, rx) = mpsc::channel(INBOX);
        let viewport = Arc::new(Viewport {
            scene: Mutex::default(),
            changed: watch::Sender::new(0),
            stage: tx.clone(),
            clients: AtomicUsize::new(0),
        });
        let stage = Stage::new(Arc::clone(&viewport), live, worker, hub, tx);
        tokio::spawn(stage.run(rx));
        viewport
    }

    /// Changes the scene; clients hear of it when anything is new.
    fn edit<T>(&self, change: impl FnOnce(&mut Retained) -> T) -> T {
        let (result, stamp) = {
            let mut scene = self.scene.lock().unwrap_or_else(PoisonError::into_inner);
            let result = change(&mut scene);
            (result, scene.stamp())
        };
        self.changed.send_if_modified(|known| {
            let newer = *known < stamp;
            *known = stamp;
            newer
        });
        result
    }

    fn since(&self, seen: u64) -> (Vec<Message>, u64) {
        self.scene.lock().unwrap_or_else(PoisonError::into_inner).since(seen)
    }

    /// What a page's pointer is over; 0 to 1 from the top left corner of its viewport.
    pub async fn under(&self, tab: &str, at: [f64; 2]) -> Option<Hovered> {
        let (reply, answer) = oneshot::channel();
        self.stage.try_send(Say::Hover(tab.to_owned(), at, reply)).ok()?;
        answer.await.ok().flatten()
    }

    /// 3D clients connected.
    pub fn clients(&self) -> usize {
        self.clients.load(Ordering::SeqCst)
    }
}

/// The client's page, or its socket: it derives the address of one from the other.
pub(super) async fn route(
    State(app): State<Arc<App>>,
    RawQuery(query): RawQuery,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    let Ok(upgrade) = upgrade else { return pages::viser() };
    let tab = tab(query.as_deref().unwrap_or_default());
    let before = app.viewport.clients.fetch_add(1, Ordering::SeqCst);
    let seat = Seat(Arc::clone(&app.viewport));
    if before >= limits::CLIENTS {
        let full = Error::Full { what: "viewports", cap: limits::CLIENTS };
        return Refused::from(full).into_response();
    }
    upgrade
        .protocols([SUBPROTOCOL])
        .max_message_size(limits::WS_MESSAGE_BYTES)
        .max_frame_size(limits::WS_FRAME_BYTES)
        .max_write_buffer_size(limits::WS_WRITE_BYTES * 8)
        .on_upgrade(move |socket| async move {
            serve(app, socket, tab).await;
            drop(seat);
        })
}

/// The page that a client belongs to, as the page has named itself.
fn tab(query: &str) -> Option<String> {
    let name = query.split('&').find_map(|pair| pair.strip_prefix("tab="))?;
    let sane = |c: char| c.is_ascii_alphanumeric();
    (name.len() <= TAB && !name.is_empty() && name.chars().all(sane)).then(|| name.to_owned())
}

/// Counts a client as long as it lives.
struct Seat(Arc<Viewport>);

impl Drop for Seat {
    fn drop(&mut self) {
        self.0.clients.fetch_sub(1, Ordering::SeqCst);
    }
}

async fn serve(app: Arc<App>, mut socket: WebSocket, tab: Option<String>) {
    if socket.protocol().and_then(|p| p.to_str().ok()) != Some(SUBPROTOCOL) {
        socket.send(Frame::Close(None)).await.ok();
        return;
    }
    let begin = Instant::now();
    let mut changed = app.viewport.changed.subscribe();
    let mut ending = app.ending.clone();
    let (messages, mut seen) = app.viewport.since(0);
    changed.mark_unchanged();
    if send(&mut socket, messages, true, begin).await.is_err() {
        return;
    }
    let mut shown = tokio::time::Instant::now();
    let mut due: Option<tokio::time::Instant> = None;
    loop {
        tokio::select! {
            message = socket.recv() => match message {
                Some(Ok(Frame::Binary(bytes))) => {
                    if let Some(said) = Incoming::read(&bytes)
                        && said != Incoming::Unknown
                    {
                        // A full stage drops moves; the next one holds the newer pose.
                        app.viewport.stage.try_send(Say::Client(tab.clone(), said)).ok();
                    }
                }
                Some(Ok(Frame::Close(_)) | Err(_)) | None => return,
                Some(Ok(_)) => {}
            },
            news = changed.changed(), if due.is_none() => {
                if news.is_err() {
                    return;
                }
                due = Some(tokio::time::Instant::now().max(shown + FLUSH));
            }
            () = tokio::time::sleep_until(due.unwrap_or(shown)), if due.is_some() => {
                due = None;
                shown = tokio::time::Instant::now();
                let (messages, stamp) = app.viewport.since(seen);
                seen = stamp;
                if send(&mut socket, messages, false, begin).await.is_err() {
                    return;
                }
            }
            () = ended(&mut ending) => return,
        }
    }
}

/// Sends messages in frames of bounded size; the first batch ends with the replay's end.
async fn send(
    socket: &mut WebSocket,
    messages: Vec<Message>,
    first: bool,
    begin: Instant,
) -> Result<(), ()> {
    let mut batches: Vec<Vec<Message>> = Vec::new();
    let (mut batch, mut bytes) = (Vec::new(), 0);
    for message in messages {
        bytes += array_bytes(&message);
        batch.push(message);
        if bytes > FRAME_BYTES {
            batches.push(std::mem::take(&mut batch));
            bytes = 0;
        }
    }
    if first {
        batch.push(Message::ReplayDoneMessage {});
    }
    if !batch.is_empty() {
        batches.push(batch);
    }
    for batch in batches {
        let secs = begin.elapsed().as_secs_f64();
        // Compressing a scene takes milliseconds; poses take microseconds.
        let encoded = if first {
            tokio::task::spawn_blocking(move || frame(&batch, secs))
                .await
                .map_err(|_panicked| ())?
        } else {
            frame(&batch, secs)
        };
        let bytes = match encoded {
            Ok(bytes) => bytes,
            Err(e) => {
                tracing::error!("the scene cannot be sent: {e}");
                return Err(());
            }
        };
        let sent = socket.send(Frame::Binary(Bytes::from(bytes)));
        match tokio::time::timeout(PATIENCE, sent).await {
            Ok(Ok(())) => {}
            _ => return Err(()),
        }
    }
    Ok(())
}

fn array_bytes(message: &Message) -> usize {
    match message {
        Message::MeshMessage(n) => n.props.vertices.len_bytes() + n.props.faces.len_bytes(),
        _ => 0,
    }
}

/// A request about what the viewport shows.
///
/// # Errors
/// [`Error::Request`] for numbers that are none, [`Error::Full`] in a storm of requests.
pub(super) fn view_op(app: &App, op: StudioOp) -> Result<(), Error> {
    let full = |_| Error::Full { what: "requests to the viewport", cap: INBOX };
    app.viewport.stage.try_send(Say::View(op)).map_err(full)
}
