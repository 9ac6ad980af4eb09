//! The child process: it sets its limits, then runs two threads.
//!
//! The performer owns the rollout, and between two frames it answers the questions for which a drag
//! waits (poses, inverse kinematics). The other thread settles poses and compiles other robots. The
//! main thread only reads, so that the parent can always ask whether the child is alive.

use std::io;
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::sync::mpsc::{Sender, channel};

use super::codec;
use super::message::{Envelope, Ping, WorkerRequest};
use super::out::Out;
use super::performer::Performer;
use super::slow;
use robert_base::child;
use robert_base::child::{OnParentExit, Rights};
use robert_base::fsio;
use robert_base::limits;

/// Serves the parent until it hangs up. The socket is file descriptor 0, which is the safe way to
/// pass one on. Nothing else here reads standard input.
///
/// # Errors
/// When the socket is none.
pub fn run() -> io::Result<()> {
    confine()?;
    let socket = UnixStream::from(io::stdin().as_fd().try_clone_to_owned()?);
    let out = Out::new(socket.try_clone()?);
    let (fast, fast_requests) = channel();
    let (slow, slow_requests) = channel();
    let performer = Performer::new(out.clone());
    let named = |name: &str| std::thread::Builder::new().name(name.into());
    named("performer").spawn(move || performer.run(&fast_requests))?;
    let slow_out = out.clone();
    named("slow").spawn(move || slow::run(&slow_requests, &slow_out))?;
    let mut input = io::BufReader::new(socket);
    while let Some(envelope) = codec::read::<Envelope>(&mut input)? {
        if let WorkerRequest::Ping(_) = envelope.request {
            out.send::<Ping>(envelope.id, Ok(()))?;
            continue;
        }
        let thread: &Sender<Envelope> = if envelope.request.is_slow() { &slow } else { &fast };
        if thread.send(envelope).is_err() {
            break;
        }
    }
    Ok(())
}

/// Gives up the rights with which a broken model could do harm.
fn confine() -> io::Result<()> {
    // A thread that panics must end the process. Then the parent starts a new one, whereas a child
    // with one dead thread would only be silent.
    let usual = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        usual(info);
        std::process::exit(101);
    }));
    child::follow_parent(OnParentExit::Now)?;
    // Graphics drivers keep compiled shaders in the user's cache and talk to devices.
    let scratch = std::env::current_dir()?;
    let cache = fsio::cache_dir();
    let caches = cache.parent().map_or_else(|| cache.clone(), std::path::Path::to_owned);
    child::confine(&Rights {
        memory_bytes: Some(limits::WORKER_MEMORY_BYTES),
        file_bytes: Some(limits::CHILD_FILE_BYTES),
        writes: Some(vec![scratch, caches, "/dev".into(), "/proc/self".into()]),
        ..Rights::default()
    })
}
