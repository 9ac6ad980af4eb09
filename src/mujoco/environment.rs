//! The only change to the process environment. It is here because it needs `unsafe`.

use std::ffi::OsStr;

/// Sets an environment variable unless the user has set it. Call it at the very start of `main`,
/// while the process has one thread. Reading the environment at the same time would be a data race,
/// which is why the standard library calls this unsafe.
///
/// Mesa's device-select layer prints two lines that begin with `error:` on every headless machine,
/// and only `NODEVICE_SELECT=1` keeps it from being loaded.
pub fn set_env_at_start(name: &str, value: &str) {
    let threads = std::fs::read_dir("/proc/self/task").map_or(1, Iterator::count);
    if threads == 1 && std::env::var_os(OsStr::new(name)).is_none() {
        // SAFETY: one thread, so nobody reads the environment meanwhile.
        unsafe { std::env::set_var(name, value) }
    }
}
