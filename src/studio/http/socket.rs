//! `/api/ws`: one editor client.
//!
//! Requests are handled one at a time, so a client that sends too many fills its own socket and not
//! our queues. If the disk does not answer while an edit is written, the client soon continues
//! without the answer, so that it sees the edits of others. Outgoing messages are in the bounded
//! stream of the hub, or are taken from the store when the socket has room. Nothing is kept for a
//! client that does not read.

use robert_base::json;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use axum::extract::State;
use axum::extract::ws::{Message, Utf8Bytes, WebSocket, WebSocketUpgrade};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::value::RawValue;
use tokio::sync::broadcast::Receiver;
use tokio::sync::broadcast::error::{RecvError, TryRecvError};
use tokio::task::JoinSet;

use super::answer::Refused;
use super::basics::{current_state, current_view};
use super::op;
use super::server::ended;
use crate::document::Edit;
use crate::protocol;
use crate::protocol::{Edited, Error, ErrorBody, Event, Outcome, STUDIO_OPS, Sent, StudioOp};
use crate::session::{Author, Write};
use crate::state::App;
use robert_base::limits;
use robert_clip::Op;

/// A client that reads nothing for this long is disconnected.
const PATIENCE: Duration = Duration::from_secs(10);

/// Time for the last message to a client.
const FAREWELL: Duration = Duration::from_millis(500);

/// Between signs of life.
const PING: Duration = Duration::from_secs(10);

/// An edit that takes longer than this is waiting for a disk.
const PROMPT: Duration = Duration::from_millis(250);

/// The total time to wait for an edit, as over HTTP.
const EDIT: Duration = Duration::from_secs(limits::BODY_SECS);

/// Edits of one client that may wait for a disk.
const LATE: usize = 16;

/// Between two batches of frames.
const UPDATE: Duration = Duration::from_millis(16);

/// Upgrades, if there is room.
pub(crate) async fn editor(State(app): State<Arc<App>>, upgrade: WebSocketUpgrade) -> Response {
    let before = app.clients.now.fetch_add(1, Ordering::SeqCst);
    let seat = Seat(Arc::clone(&app));
    if before >= limits::CLIENTS {
        return Refused::from(Error::Full { what: "clients", cap: limits::CLIENTS })
            .into_response();
    }
    upgrade
        .max_message_size(limits::WS_MESSAGE_BYTES)
        .max_frame_size(limits::WS_FRAME_BYTES)
        .max_write_buffer_size(limits::WS_WRITE_BYTES)
        .on_upgrade(move |socket| async move {
            let number = app.clients.all.fetch_add(1, Ordering::SeqCst) as u64 + 1;
            let mut client = Client::new(app, socket, number);
            client.serve().await;
            client.leave().await;
            drop(seat);
        })
}

/// Counts a client while it is connected.
struct Seat(Arc<App>);

impl Drop for Seat {
    fn drop(&mut self) {
        self.0.clients.now.fetch_sub(1, Ordering::SeqCst);
    }
}

struct Client {
    app: Arc<App>,
    socket: WebSocket,
    number: u64,
    /// Requests whose edit has been made but not yet been sent to this client.
    unacked: Vec<(u64, u64)>,
    /// Requests whose edit waits for a disk.
    late: JoinSet<(u64, Made)>,
    /// Whether this client is dragging, which all clients see as a preview.
    previewing: bool,
}

/// What has become of an edit.
type Made = Result<Edited, Error>;

/// The socket is closed or stuck.
struct Gone;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Wire<'a> {
    id: u64,
    op: String,
    #[serde(borrow, default)]
    args: Option<&'a RawValue>,
}

impl Client {
    fn new(app: Arc<App>, socket: WebSocket, number: u64) -> Client {
        Client { app, socket, number, unacked: Vec::new(), late: JoinSet::new(), previewing: false }
    }

    async fn serve(&mut self) {
        let mut events = self.app.hub.listen();
        let mut rollout = self.app.simulation.rollout.watch();
        let mut ending = self.app.ending.clone();
        let mut ping = tokio::time::interval(PING);
        let mut heard = Instant::now();
        let mut seen = 0;
        let mut shown = tokio::time::Instant::now();
        let mut due: Option<tokio::time::Instant> = None;
        let state = current_state(&self.app).await;
        let hello = Event::Hello { client: self.number, state: Box::new(state) };
        if self.send(&hello).await.is_err() {
            return;
        }
        rollout.mark_changed();
        loop {
            let done = tokio::select! {
                message = self.socket.recv() => {
                    heard = Instant::now();
                    match message {
                        Some(Ok(Message::Text(text))) => self.request(&text).await,
                        Some(Ok(Message::Binary(_))) => self.refuse_binary().await,
                        Some(Ok(Message::Ping(_) | Message::Pong(_))) => Ok(()),
                        Some(Ok(Message::Close(_)) | Err(_)) | None => Err(Gone),
                    }
                }
                event = events.recv() => match event {
                    Ok(sent) => self.pass_on(sent).await,
                    Err(RecvError::Lagged(_)) => {
                        events = events.resubscribe();
                        // A page that gets another document forgets the rollout of the last one.
                        (seen, due) = (0, Some(tokio::time::Instant::now()));
                        self.start_afresh().await
                    }
                    Err(RecvError::Closed) => Err(Gone),
                },
                Some(Ok((id, made))) = self.late.join_next() => {
                    // Its event may have come already, or been missed: this answer holds by itself.
                    let answer = made.map(|edited| Some(Outcome::Unchanged { rev: edited.rev }));
                    self.reply(id, answer).await
                }
                _ = rollout.changed() => {
                    // Frames that arrive faster than the screen refreshes are joined; nobody waits
                    // for the last one.
                    let now = tokio::time::Instant::now();
                    let next = if self.app.simulation.rollout.rests() { now } else { now.max(shown + UPDATE) };
                    due = Some(due.map_or(next, |due| due.min(next)));
                    Ok(())
                }
                () = sleep_until(due), if due.is_some() => {
                    due = None;
                    shown = tokio::time::Instant::now();
                    self.update(&mut events, &mut seen).await
                }
                _ = ping.tick() => {
                    if heard.elapsed() > 3 * PING {
                        Err(Gone)
                    } else {
                        self.send_message(Message::Ping(axum::body::Bytes::new())).await
                    }
                }
                () = ended(&mut ending) => Err(Gone),
            };
            if done.is_err() {
                // A client that has read nothing so far does not read the last message either.
                // Without a time limit this task, and the client's place, would stay for ever.
                tokio::time::timeout(FAREWELL, self.socket.send(Message::Close(None))).await.ok();
                return;
            }
        }
    }

    /// A drag ends when the page that makes it disconnects.
    async fn leave(&mut self) {
        if self.previewing
            && let Err(e) = op::studio_op(&self.app, StudioOp::PreviewEnd {}).await
        {
            tracing::warn!("a preview was not ended: {e}");
        }
    }

    /// The client is too far behind: it gets the whole document, and the acknowledgements that it
    /// missed.
    async fn start_afresh(&mut self) -> Result<(), Gone> {
        let document = current_view(&self.app).await;
        self.send(&Event::Document { document }).await?;
        for (id, rev) in std::mem::take(&mut self.unacked) {
            let result = Some(Outcome::Unchanged { rev });
            self.send(&Event::Reply { id, result, error: None }).await?;
        }
        Ok(())
    }

    /// Sends what is new of the rollout, after all events that came before it: a page that is told of
    /// another document forgets the rollout of the last one.
    async fn update(&mut self, events: &mut Receiver<Sent>, seen: &mut u64) -> Result<(), Gone> {
        let update = loop {
            let update = self.app.simulation.rollout.update(*seen);
            match events.try_recv() {
                Ok(sent) => self.pass_on(sent).await?,
                Err(TryRecvError::Lagged(_)) => {
                    *events = events.resubscribe();
                    *seen = 0;
                    self.start_afresh().await?;
                }
                Err(TryRecvError::Empty | TryRecvError::Closed) => break update,
            }
        };
        *seen = update.seen;
        for event in [update.frames, update.state].into_iter().flatten() {
            self.send(&event).await?;
        }
        Ok(())
    }

    async fn pass_on(&mut self, sent: Sent) -> Result<(), Gone> {
        let own = sent.acknowledges.filter(|(by, _)| *by == self.number);
        if let Some((_, id)) = own {
            self.unacked.retain(|(waiting, _)| *waiting != id);
        }
        self.send_text(sent.text).await
    }

    async fn send(&mut self, event: &Event) -> Result<(), Gone> {
        match protocol::text(event) {
            Some(text) => self.send_text(text).await,
            None => Ok(()),
        }
    }

    async fn send_text(&mut self, text: Utf8Bytes) -> Result<(), Gone> {
        self.send_message(Message::Text(text)).await
    }

    async fn send_message(&mut self, message: Message) -> Result<(), Gone> {
        match tokio::time::timeout(PATIENCE, self.socket.send(message)).await {
            Ok(Ok(())) => Ok(()),
            _ => Err(Gone),
        }
    }

    async fn refuse_binary(&mut self) -> Result<(), Gone> {
        let error = ErrorBody::from(&Error::request("messages are JSON text"));
        self.send(&Event::Reply { id: 0, result: None, error: Some(error) }).await
    }

    async fn request(&mut self, text: &str) -> Result<(), Gone> {
        let wire: Wire<'_> = match serde_json::from_str(text) {
            Ok(wire) => wire,
            Err(e) => {
                let what = format!("a request is {{\"id\", \"op\", \"args\"}}: {e}");
                let error = Some(ErrorBody::from(&Error::request(what)));
                return self.send(&Event::Reply { id: 0, result: None, error }).await;
            }
        };
        let answer = self.carry_out(&wire).await;
        self.reply(wire.id, answer).await
    }

    async fn reply(&mut self, id: u64, answer: Result<Option<Outcome>, Error>) -> Result<(), Gone> {
        match answer {
            Ok(None) => Ok(()),
            Ok(result) => self.send(&Event::Reply { id, result, error: None }).await,
            Err(e) => {
                let error = Some(ErrorBody::from(&e));
                self.send(&Event::Reply { id, result: None, error }).await
            }
        }
    }

    /// `None`: the answer is in the stream of events.
    async fn carry_out(&mut self, wire: &Wire<'_>) -> Result<Option<Outcome>, Error> {
        let author = Author { client: self.number, id: Some(wire.id) };
        let edit = if STUDIO_OPS.contains(&wire.op.as_str()) {
            match studio_op(wire)? {
                StudioOp::Undo {} => Edit::Undo,
                StudioOp::Redo {} => Edit::Redo,
                StudioOp::HistoryGoto { done } => Edit::Goto(done),
                other => {
                    match other {
                        StudioOp::Preview { .. } => self.previewing = true,
                        StudioOp::PreviewEnd {} => self.previewing = false,
                        _ => {}
                    }
                    return Ok(Some(op::studio_op(&self.app, other).await?));
                }
            }
        } else {
            Edit::Op(Box::new(clip_op(wire)?))
        };
        if self.late.len() >= LATE {
            return Err(Error::Full { what: "edits that wait for the disk", cap: LATE });
        }
        let session = self.app.session.clone();
        let mut edited = Box::pin(async move {
            let made = session.write(|reply| Write::Edit(author, edit, reply));
            let timely = tokio::time::timeout(EDIT, made).await;
            timely.unwrap_or(Err(Error::Waiting { waited: EDIT }))
        });
        let Ok(made) = tokio::time::timeout(PROMPT, &mut edited).await else {
            let id = wire.id;
            self.late.spawn(async move { (id, edited.await) });
            return Ok(None);
        };
        let edited = made?;
        if edited.patches.is_empty() {
            return Ok(Some(Outcome::Unchanged { rev: edited.rev }));
        }
        self.unacked.push((wire.id, edited.rev));
        Ok(None)
    }
}

async fn sleep_until(due: Option<tokio::time::Instant>) {
    if let Some(due) = due {
        tokio::time::sleep_until(due).await;
    }
}

/// Converts a request to `{"op", "args"}`, which the typed enums read.
fn tagged<T: serde::de::DeserializeOwned>(wire: &Wire<'_>) -> Result<T, Error> {
    let args = wire.args.map_or("{}", RawValue::get);
    let op = json::line(&wire.op);
    serde_json::from_str(&format!("{{\"op\":{op},\"args\":{args}}}"))
        .map_err(|e| Error::request(format!("{}: {e}", wire.op)))
}

fn studio_op(wire: &Wire<'_>) -> Result<StudioOp, Error> {
    tagged(wire)
}

fn clip_op(wire: &Wire<'_>) -> Result<Op, Error> {
    tagged(wire)
}
