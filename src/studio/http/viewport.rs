//! The socket of the 3D view: one viser client.

use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::body::Bytes;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{Message as Frame, WebSocket, WebSocketUpgrade};
use axum::extract::{RawQuery, State};
use axum::response::{IntoResponse, Response};

use super::answer::Refused;
use super::pages;
use super::server::ended;
use crate::state::App;
use crate::viewport::Incoming;
use robert_base::limits;
use robert_take::viser::{Message, SUBPROTOCOL, frame};

/// Between two frames to a client.
const FLUSH: Duration = Duration::from_micros(16_667);

/// The limit for bytes of arrays in one frame: a large robot is sent in parts.
const FRAME_BYTES: usize = 4 << 20;

/// Characters of a page's name.
const TAB: usize = 32;

/// A client that reads nothing for this long is disconnected.
const PATIENCE: Duration = Duration::from_secs(30);

/// The client's page, or its socket: the client derives the address of one from the other.
pub(crate) async fn route(
    State(app): State<Arc<App>>,
    RawQuery(query): RawQuery,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    let Ok(upgrade) = upgrade else { return pages::viser() };
    let tab = tab(query.as_deref().unwrap_or_default());
    let seat = match app.viewport.seat() {
        Ok(seat) => seat,
        Err(full) => return Refused::from(full).into_response(),
    };
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

/// The page that a client belongs to, by the name that the page chose.
fn tab(query: &str) -> Option<String> {
    let name = query.split('&').find_map(|pair| pair.strip_prefix("tab="))?;
    let sane = |c: char| c.is_ascii_alphanumeric();
    (name.len() <= TAB && !name.is_empty() && name.chars().all(sane)).then(|| name.to_owned())
}

async fn serve(app: Arc<App>, mut socket: WebSocket, tab: Option<String>) {
    if socket.protocol().and_then(|p| p.to_str().ok()) != Some(SUBPROTOCOL) {
        socket.send(Frame::Close(None)).await.ok();
        return;
    }
    let begin = Instant::now();
    let mut changed = app.viewport.watch();
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
                        app.viewport.hear(tab.clone(), said);
                    }
                }
                Some(Ok(Frame::Close(_)) | Err(_)) | None => return,
                Some(Ok(_)) => {}
            },
            change = changed.changed(), if due.is_none() => {
                if change.is_err() {
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

/// Sends messages in frames of bounded size; the first batch ends with `ReplayDoneMessage`.
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
