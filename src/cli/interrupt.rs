//! Ctrl-C: the first asks the job to stop at the next safe point, the second ends it.

use crate::exit::Exit;
use crate::progress::Cancel;

/// A flag that Ctrl-C (or SIGTERM) raises.
pub(super) fn cancel_on_ctrl_c() -> Cancel {
    let cancel = Cancel::default();
    let flag = cancel.clone();
    // Fails only where a handler stands already: then that one is in charge.
    ctrlc::set_handler(move || {
        if flag.is_cancelled() {
            std::process::exit(i32::from(Exit::Interrupted.code()));
        }
        flag.cancel();
    })
    .ok();
    cancel
}
