//! Ctrl-C: the first asks the job to stop at the next safe point, the second ends it.

use std::sync::OnceLock;

use crate::exit::Exit;
use crate::progress::Cancel;

/// The flag that Ctrl-C (or SIGTERM) raises. There is one for the whole process.
pub(super) fn cancel_on_ctrl_c() -> Cancel {
    static FLAG: OnceLock<Cancel> = OnceLock::new();
    let flag = FLAG.get_or_init(|| {
        let cancel = Cancel::default();
        let flag = cancel.clone();
        let installed = ctrlc::set_handler(move || {
            if flag.is_cancelled() {
                std::process::exit(i32::from(Exit::Interrupted.code()));
            }
            flag.cancel();
        });
        if let Err(e) = installed {
            tracing::warn!("Ctrl-C will end the program at once: {e}");
        }
        cancel
    });
    flag.clone()
}

/// A flag that is raised by Ctrl-C and by SIGUSR1, with which a queue warns before the time limit.
/// The second flag says that it was the queue.
pub(super) fn cancel_on_warning() -> (Cancel, Cancel) {
    let (cancel, warned) = (cancel_on_ctrl_c(), Cancel::default());
    let (stop, flag) = (cancel.clone(), warned.clone());
    let listen = move || -> std::io::Result<()> {
        use tokio::signal::unix::{SignalKind, signal};
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        runtime.block_on(async {
            let mut warnings = signal(SignalKind::user_defined1())?;
            while warnings.recv().await.is_some() {
                flag.cancel();
                stop.cancel();
            }
            Ok(())
        })
    };
    let thread = std::thread::Builder::new().name("warning".into());
    let started = thread.spawn(move || {
        if let Err(e) = listen() {
            tracing::warn!("a warning of the queue (SIGUSR1) will end the program at once: {e}");
        }
    });
    if let Err(e) = started {
        tracing::warn!("a warning of the queue (SIGUSR1) will end the program at once: {e}");
    }
    (cancel, warned)
}
