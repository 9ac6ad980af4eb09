//! Processor time, which other programs on a busy machine do not inflate.
//!
//! It is read from the clock of the thread or process. `/proc/thread-self/schedstat` and
//! `/proc/self/stat` are updated only every 4 to 10 ms or when the thread sleeps. With them, part
//! of one measurement was counted in the next one.

use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};

/// Time on the processor so far, of the calling thread.
pub(super) fn thread_cpu() -> Duration {
    read(ClockId::ThreadCPUTime)
}

/// Time on the processor so far, of all threads of this process.
pub(super) fn process_cpu() -> Duration {
    read(ClockId::ProcessCPUTime)
}

fn read(clock: ClockId) -> Duration {
    Duration::try_from(clock_gettime(clock)).unwrap_or_default()
}

/// The median; 0 for an empty slice.
pub(super) fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    match n {
        0 => 0.0,
        _ if n % 2 == 1 => values[n / 2],
        _ => 0.5 * (values[n / 2 - 1] + values[n / 2]),
    }
}
