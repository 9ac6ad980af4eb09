//! The server: one loopback port, a router, and the shutdown.
//!
//! `axum::serve` has no time limit for a request's head, so the accept loop is our own. It allows a
//! head of 16 KiB within 5 s and a bounded number of connections, and puts the guard before every
//! route.

use std::collections::BTreeMap;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use axum::Router;
use hyper::service::{Service, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Semaphore, oneshot, watch};

use crate::protocol::Error;
use robert_base::limits;

/// The time that a new connection waits after an old one was closed to make room for it.
const ROOM_PATIENCE: Duration = Duration::from_millis(200);

/// Binds the port; 0 takes any.
///
/// # Errors
/// [`Error::Bind`].
pub(crate) async fn bind(port: u16) -> Result<(TcpListener, u16), Error> {
    let fail = |source| Error::Bind { port, source };
    let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
    let listener = TcpListener::bind(address).await.map_err(fail)?;
    let port = listener.local_addr().map_err(fail)?.port();
    Ok((listener, port))
}

/// Connections without a request so far, the oldest first. If there is no room for another
/// connection, the oldest of these is closed, so clients that only connect cannot keep others out.
#[derive(Clone, Default)]
struct Silent(Arc<Mutex<BTreeMap<u64, oneshot::Sender<()>>>>);

impl Silent {
    fn lock(&self) -> MutexGuard<'_, BTreeMap<u64, oneshot::Sender<()>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn add(&self, number: u64) -> oneshot::Receiver<()> {
        let (end, ended) = oneshot::channel();
        self.lock().insert(number, end);
        ended
    }

    /// The connection has sent a request, or is closed.
    fn remove(&self, number: u64) {
        self.lock().remove(&number);
    }

    /// Ends one; false when there is none.
    fn end_oldest(&self) -> bool {
        self.lock().pop_first().is_some_and(|(_, end)| end.send(()).is_ok())
    }
}

/// Serves until `ending` turns true.
pub(crate) async fn serve(
    listener: TcpListener,
    router: Router,
    mut ending: watch::Receiver<bool>,
) {
    let room = Arc::new(Semaphore::new(limits::CONNECTIONS));
    let silent = Silent::default();
    let mut number = 0;
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            () = ended(&mut ending) => return,
        };
        let Ok((stream, _)) = accepted else {
            // For example, no file descriptors are left; others will be closed.
            tokio::time::sleep(Duration::from_millis(20)).await;
            continue;
        };
        let permit = match Arc::clone(&room).try_acquire_owned() {
            Ok(permit) => permit,
            Err(_) if silent.end_oldest() => {
                let place = Arc::clone(&room).acquire_owned();
                let Ok(Ok(permit)) = tokio::time::timeout(ROOM_PATIENCE, place).await else {
                    continue;
                };
                permit
            }
            Err(_) => continue,
        };
        stream.set_nodelay(true).ok();
        number += 1;
        let (router, silent) = (router.clone(), silent.clone());
        let mut ending = ending.clone();
        tokio::spawn(async move {
            tokio::select! {
                () = connection(stream, router, silent, number) => {}
                () = ended(&mut ending) => {}
            }
            drop(permit);
        });
    }
}

/// Returns when the studio ends.
pub(crate) async fn ended(ending: &mut watch::Receiver<bool>) {
    ending.wait_for(|end| *end).await.ok();
}

async fn connection(stream: TcpStream, router: Router, silent: Silent, number: u64) {
    let end = silent.add(number);
    let router = TowerToHyperService::new(router);
    let heard = silent.clone();
    let service = service_fn(move |request: hyper::Request<hyper::body::Incoming>| {
        heard.remove(number);
        router.call(request)
    });
    let serving = hyper::server::conn::http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(Duration::from_secs(limits::HEAD_SECS))
        .max_buf_size(limits::HEAD_BYTES)
        .serve_connection(TokioIo::new(stream), service)
        .with_upgrades();
    let mut serving = std::pin::pin!(serving);
    let result = tokio::select! {
        result = &mut serving => result,
        // After its first request nobody can end it any more, and this branch is disabled.
        Ok(()) = end => return,
    };
    silent.remove(number);
    if let Err(e) = result {
        tracing::debug!("a connection ended: {e}");
    }
}
