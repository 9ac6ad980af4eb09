//! One ordered stream of events to all clients.
//!
//! An event is serialised once. The stream is bounded: a client that is behind by more than its
//! length is told so and gets the whole document again.

use axum::extract::ws::Utf8Bytes;
use tokio::sync::broadcast;

use super::event::Event;

/// Events that a client may be behind.
const LAG: usize = 256;

/// An event on its way.
#[derive(Clone, Debug)]
pub struct Sent {
    /// It, as JSON.
    pub text: Utf8Bytes,
    /// Client and request that it acknowledges.
    pub acknowledges: Option<(u64, u64)>,
}

/// The stream.
#[derive(Clone, Debug)]
pub struct Hub(broadcast::Sender<Sent>);

impl Hub {
    /// A stream that nobody listens to yet.
    pub fn new() -> Hub {
        Hub(broadcast::Sender::new(LAG))
    }

    /// Sends to all who listen.
    pub fn send(&self, event: &Event) {
        if self.0.receiver_count() > 0
            && let Some(text) = text(event)
        {
            let acknowledges = match event {
                Event::Edit { by, id: Some(id), .. } => Some((*by, *id)),
                _ => None,
            };
            self.0.send(Sent { text, acknowledges }).ok();
        }
    }

    /// Listens from now on.
    pub fn listen(&self) -> broadcast::Receiver<Sent> {
        self.0.subscribe()
    }
}

/// An event as JSON.
pub fn text(event: &Event) -> Option<Utf8Bytes> {
    match serde_json::to_string(event) {
        Ok(text) => Some(text.into()),
        Err(e) => {
            tracing::error!("an event cannot be written: {e}");
            None
        }
    }
}

impl Default for Hub {
    fn default() -> Self {
        Hub::new()
    }
}
