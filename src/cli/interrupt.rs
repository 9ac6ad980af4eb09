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
