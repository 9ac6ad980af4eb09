//! The handle of the worker: typed questions.

use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Sender, channel};
use std::time::Duration;

use super::codec;
use super::message::{Question, WorkerRequest};
use super::supervisor::{self, Inbox, Reply, WorkerSink, gone};
use crate::protocol::Error;

/// A handle for questions to the worker. Clones use the same worker.
#[derive(Clone, Debug)]
pub(crate) struct WorkerHandle {
    inbox: Sender<Inbox>,
}

impl WorkerHandle {
    /// Starts the supervisor, which starts the child. `binary` is this program.
    ///
    /// # Errors
    /// If the operating system cannot start the thread.
    pub(crate) fn start(binary: PathBuf, sink: Arc<dyn WorkerSink>) -> io::Result<WorkerHandle> {
        Ok(WorkerHandle { inbox: supervisor::start(binary, sink, None)? })
    }

    /// As [`WorkerHandle::start`], but the child is started at the first question and ended after
    /// `rest` without one, because it is needed only now and then and uses memory.
    ///
    /// # Errors
    /// If the operating system cannot start the thread.
    pub(crate) fn start_resting(
        binary: PathBuf,
        sink: Arc<dyn WorkerSink>,
        rest: Duration,
    ) -> io::Result<WorkerHandle> {
        Ok(WorkerHandle { inbox: supervisor::start(binary, sink, Some(rest))? })
    }

    /// Asks without waiting for an answer.
    pub(crate) fn tell(&self, request: impl Into<WorkerRequest>) {
        self.inbox.send(Inbox::Ask { request: request.into(), reply: None }).ok();
    }

    /// Asks, and calls back with the answer.
    pub(crate) fn ask_with<Q: Question>(
        &self,
        question: Q,
        reply: impl FnOnce(Result<Q::Answer, Error>) + Send + 'static,
    ) {
        let read = |body: serde_bytes::ByteBuf| {
            codec::decode(&body).map_err(|e| gone(&format!("it speaks nonsense ({e})")))
        };
        let reply: Reply = Box::new(move |answer| reply(answer.and_then(read)));
        self.inbox.send(Inbox::Ask { request: question.into(), reply: Some(reply) }).ok();
    }

    /// Asks a question and waits for the answer, in an asynchronous context.
    ///
    /// # Errors
    /// [`Error::Worker`], [`Error::Simulation`].
    pub(crate) async fn ask<Q: Question>(&self, question: Q) -> Result<Q::Answer, Error> {
        let (tx, rx) = tokio::sync::oneshot::channel();
        self.ask_with(question, move |answer| {
            tx.send(answer).ok();
        });
        rx.await.unwrap_or_else(|_| Err(gone("it has been shut down")))
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
        let (tx, rx) = channel();
        self.ask_with(question, move |answer| {
            tx.send(answer).ok();
        });
        rx.recv_timeout(patience).unwrap_or_else(|_| Err(gone("it does not answer")))
    }

    /// Starts a new child after the supervisor gave up.
    pub(crate) fn restart(&self) {
        self.inbox.send(Inbox::Restart).ok();
    }

    /// Ends the child and the supervisor.
    pub(crate) fn shutdown(&self) {
        self.inbox.send(Inbox::Shutdown).ok();
    }
}
