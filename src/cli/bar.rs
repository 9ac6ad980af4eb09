//! Progress of long work on stderr: a bar with ETA on a terminal, a line every ten
//! seconds elsewhere (a log file full of redrawn bars helps nobody).

use std::io::IsTerminal;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::progress::{JobEvent, JobProgress, Progress};

const LINE_EVERY: Duration = Duration::from_secs(10);
/// Between two events of `--jsonl`.
const EVENT_EVERY: Duration = Duration::from_millis(200);

/// Estimates the time left from the speed since the first tick. Work before it (a fit, an
/// evaluation, an earlier session) has another speed and does not count.
#[derive(Debug, Default)]
struct TimeLeft(Mutex<Option<First>>);

/// The first tick of a count.
#[derive(Clone, Copy, Debug)]
struct First {
    done: u64,
    total: u64,
    at: Instant,
}

impl TimeLeft {
    /// Seconds from `now` to the end; `None` until something was done.
    fn left(&self, done: u64, total: u64, now: Instant) -> Option<f64> {
        let mut first = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        // Each part of the work starts its own count.
        let same = |f: &First| f.total == total && f.done <= done;
        let from = first.filter(same).unwrap_or(First { done, total, at: now });
        *first = Some(from);
        let made = Some(done - from.done).filter(|&n| n > 0)?;
        let spent = now.duration_since(from.at).as_secs_f64();
        Some(spent * total.saturating_sub(done) as f64 / made as f64)
    }
}

/// A time for people: `12 s`, `3 min 20 s`, `5 h 4 min`; a dash if it is unknown.
fn span(secs: Option<f64>) -> String {
    let Some(secs) = secs else { return "-".to_owned() };
    let s = secs.round() as u64;
    match s {
        0..60 => format!("{s} s"),
        60..3600 => format!("{} min {} s", s / 60, s % 60),
        _ => format!("{} h {} min", s / 3600, s / 60 % 60),
    }
}

/// Shows a [`Progress`] on a terminal.
#[derive(Debug)]
pub(super) struct Bar {
    bar: ProgressBar,
    time_left: TimeLeft,
    plain: Option<Mutex<Plain>>,
    /// The time of the last `--jsonl` event.
    events: Option<Mutex<Plain>>,
    /// The current phase of the job, and the unit in which it is counted.
    phase: Mutex<(String, String)>,
}

#[derive(Debug)]
struct Plain {
    start: Instant,
    last: Instant,
}

impl Bar {
    /// A bar titled `what`, counting `unit`.
    pub(super) fn new(what: &str, unit: &str, quiet: bool) -> Self {
        let lines = super::out::is_in_lines();
        let tty = std::io::stderr().is_terminal();
        let quiet = quiet || lines;
        let target = if tty && !quiet {
            ProgressDrawTarget::stderr_with_hz(10)
        } else {
            ProgressDrawTarget::hidden()
        };
        let bar = ProgressBar::with_draw_target(None, target);
        name(&bar, what, unit);
        let now = Instant::now();
        let plain = (!tty && !quiet).then(|| Mutex::new(Plain { start: now, last: now }));
        let events = lines.then(|| Mutex::new(Plain { start: now, last: now }));
        let phase = Mutex::new((what.to_owned(), unit.to_owned()));
        Bar { bar, time_left: TimeLeft::default(), plain, events, phase }
    }

    fn named(&self) -> (String, String) {
        self.phase.lock().map(|phase| phase.clone()).unwrap_or_default()
    }

    /// Writes one event of `--jsonl`, unless another was written a moment ago.
    fn tell(&self, done: u64, total: u64, note: &str) {
        let Some(Ok(mut times)) = self.events.as_ref().map(Mutex::lock) else { return };
        // The first and the last event are always written, so that a short job shows something.
        let due = times.last == times.start || times.last.elapsed() >= EVENT_EVERY;
        if !due && done < total {
            return;
        }
        times.last = Instant::now();
        let secs = times.start.elapsed().as_secs_f64();
        let (what, unit) = self.named();
        let progress = JobProgress { what, unit, done, total, secs, note: note.to_owned() };
        super::out::event(&JobEvent::Progress(progress)).ok();
    }

    /// Removes the bar.
    pub(super) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

fn name(bar: &ProgressBar, what: &str, unit: &str) {
    let template = format!(
        "{{prefix}} {{wide_bar:.cyan/dim}} {{percent:>3}}% {{human_pos}}/{{human_len}} {unit}  {{msg}}"
    );
    if let Ok(style) = ProgressStyle::with_template(&template) {
        bar.set_style(style.progress_chars("━╸─"));
    }
    bar.set_prefix(what.to_owned());
}

impl Progress for Bar {
    fn tick(&self, done: u64, total: u64, note: &str) {
        self.tell(done, total, note);
        let left = span(self.time_left.left(done, total, Instant::now()));
        self.bar.set_length(total);
        self.bar.set_position(done);
        if !self.bar.is_hidden() {
            self.bar.set_message(format!("ETA {left}  {note}"));
        }
        let Some(Ok(mut plain)) = self.plain.as_ref().map(Mutex::lock) else { return };
        if plain.last.elapsed() < LINE_EVERY {
            return;
        }
        plain.last = Instant::now();
        let percent = 100.0 * done as f64 / total.max(1) as f64;
        let (what, unit) = self.named();
        super::out::aside(format_args!(
            "{what}: {done}/{total} {unit} ({percent:.0}%), {left} left  {note}"
        ));
    }

    fn phase(&self, what: &str, unit: &str) {
        let Ok(mut phase) = self.phase.lock() else { return };
        *phase = (what.to_owned(), unit.to_owned());
        drop(phase);
        name(&self.bar, what, unit);
        // The estimate follows the current pace.
        self.bar.reset();
        *self.time_left.0.lock().unwrap_or_else(PoisonError::into_inner) = None;
        for times in [&self.plain, &self.events].into_iter().flatten() {
            if let Ok(mut times) = times.lock() {
                times.start = Instant::now();
                times.last = times.start;
            }
        }
    }

    fn log(&self, line: &str) {
        if self.events.is_some() {
            super::out::event(&JobEvent::Log { line: line.to_owned() }).ok();
        }
        self.bar.suspend(|| super::out::aside(line));
    }

    fn figures(&self, point: &serde_json::Value) {
        if self.events.is_some() {
            super::out::event(&JobEvent::Figures { figures: point.clone() }).ok();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_left_follows_the_pace_of_this_session() {
        let (time_left, start) = (TimeLeft::default(), Instant::now());
        let at = |secs| start + Duration::from_secs(secs);
        // Sixty seconds of fitting went before; an earlier session did 900 of 1000.
        assert_eq!(time_left.left(900, 1000, at(60)), None);
        assert_eq!(time_left.left(900, 1000, at(61)), None);
        assert_eq!(time_left.left(910, 1000, at(65)), Some(45.0));
        assert_eq!(time_left.left(1000, 1000, at(110)), Some(0.0));
        assert_eq!(time_left.left(0, 50, at(111)), None, "another part");
        assert_eq!(time_left.left(25, 50, at(121)), Some(10.0));
        let texts = [None, Some(12.4), Some(200.0), Some(18_245.0)].map(span);
        assert_eq!(texts, ["-", "12 s", "3 min 20 s", "5 h 4 min"]);
    }
}
