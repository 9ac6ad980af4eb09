//! Clips: reading, editing, checking, converting.

mod command_line;
mod edits;
mod fuzz;
pub(crate) mod generate;
mod hostile;
mod layers;
mod lints;
mod reach;
mod robots;
mod schema;
mod tracks;

/// Processor time of this thread so far: a busy machine is no hang.
pub(crate) fn cpu() -> std::time::Duration {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanos = text.split_whitespace().next().and_then(|n| n.parse().ok()).unwrap_or(0);
    std::time::Duration::from_nanos(nanos)
}

#[test]
fn the_clock_of_these_tests_runs() {
    let start = cpu();
    let mut x = 1_u64;
    while x != 0 && cpu().saturating_sub(start).as_millis() < 5 {
        x = x.wrapping_mul(3) | 1;
    }
    assert!(cpu() > start);
}
