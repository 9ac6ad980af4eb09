//! The child's connection to its parent, and its limit of processor time.

use std::io;
use std::os::unix::net::UnixStream;
use std::sync::{Arc, Mutex, PoisonError};

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

use super::codec;
use super::message::{Question, Refusal, SimulationEvent, WorkerMessage};
use robert_base::limits;

/// The socket to the parent. Clones share it.
#[derive(Clone)]
pub(super) struct Out(Arc<Mutex<UnixStream>>);

impl Out {
    pub(super) fn new(socket: UnixStream) -> Out {
        Out(Arc::new(Mutex::new(socket)))
    }

    fn write(&self, message: &WorkerMessage) -> io::Result<()> {
        let mut socket = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        codec::write(&mut *socket, message)
    }

    /// Sends the answer to a question of this kind.
    pub(super) fn send<Q: Question>(
        &self,
        id: u64,
        answer: Result<Q::Answer, Refusal>,
    ) -> io::Result<()> {
        self.write(&match answer {
            Ok(answer) => WorkerMessage::Answer(id, codec::encode(&answer)?),
            Err(refusal) => WorkerMessage::Refused(id, refusal),
        })
    }

    /// Sends an answer and ignores errors: a parent that has ended needs no answer, and the next
    /// read will fail.
    pub(super) fn answer<Q: Question>(&self, id: u64, answer: Result<Q::Answer, Refusal>) {
        self.send::<Q>(id, answer).ok();
    }

    /// Tells what nobody asked for.
    pub(super) fn tell(&self, event: SimulationEvent) {
        self.write(&WorkerMessage::Event(event)).ok();
    }
}

/// Grants another share of processor time. An endless loop in one request then ends the process,
/// but many short requests do not.
pub(super) fn grant_cpu() {
    let Ok(stat) = std::fs::read_to_string("/proc/self/stat") else { return };
    // After the name in parentheses the 12th and 13th fields are user and system ticks.
    let Some((_, fields)) = stat.rsplit_once(')') else { return };
    let ticks: u64 =
        fields.split_whitespace().skip(11).take(2).filter_map(|f| f.parse::<u64>().ok()).sum();
    let maximum = getrlimit(Resource::Cpu).maximum;
    let current = Some(ticks / 100 + limits::WORKER_CPU_SECS);
    setrlimit(Resource::Cpu, Rlimit { current, maximum }).ok();
}
