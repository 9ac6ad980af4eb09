//! Progress of long work on stderr: a bar with ETA on a terminal, a line every ten
//! seconds elsewhere (a log file full of redrawn bars helps nobody).

use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::progress::Progress;

const LINE_EVERY: Duration = Duration::from_secs(10);
/// Between two events of `--jsonl`.
const EVENT_EVERY: Duration = Duration::from_millis(200);

/// Draws a [`Progress`] for a person.
#[derive(Debug)]
pub(super) struct Bar {
    bar: ProgressBar,
    plain: Option<Mutex<Plain>>,
    /// With `--jsonl`: when the last event was written.
    events: Option<Mutex<Plain>>,
    what: String,
    unit: String,
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
        let template = format!(
            "{{prefix}} {{wide_bar:.cyan/dim}} {{percent:>3}}% {{human_pos}}/{{human_len}} {unit}  ETA {{eta}}  {{msg}}"
        );
        if let Ok(style) = ProgressStyle::with_template(&template) {
            bar.set_style(style.progress_chars("━╸─"));
        }
        bar.set_prefix(what.to_owned());
        let now = Instant::now();
        let plain = (!tty && !quiet).then(|| Mutex::new(Plain { start: now, last: now }));
        let events = lines.then(|| Mutex::new(Plain { start: now, last: now }));
        Bar { bar, plain, events, what: what.to_owned(), unit: unit.to_owned() }
    }

    /// One event of `--jsonl`, unless the last was a moment ago.
    fn tell(&self, done: u64, total: u64, note: &str) {
        let Some(Ok(mut times)) = self.events.as_ref().map(Mutex::lock) else { return };
        // The first and the last always: a short job must not look as if nothing happened.
        let due = times.last == times.start || times.last.elapsed() >= EVENT_EVERY;
        if !due && done < total {
            return;
        }
        times.last = Instant::now();
        let secs = times.start.elapsed().as_secs_f64();
        let event = serde_json::json!({
            "event": "progress", "what": self.what, "unit": self.unit,
            "done": done, "total": total, "secs": secs, "note": note,
        });
        super::out::event(&event).ok();
    }

    /// Removes the bar.
    pub(super) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Progress for Bar {
    fn tick(&self, done: u64, total: u64, note: &str) {
        self.tell(done, total, note);
        self.bar.set_length(total);
        self.bar.set_position(done);
        if !self.bar.is_hidden() {
            self.bar.set_message(note.to_owned());
        }
        let Some(Ok(mut plain)) = self.plain.as_ref().map(Mutex::lock) else { return };
        if plain.last.elapsed() < LINE_EVERY {
            return;
        }
        plain.last = Instant::now();
        let share = done as f64 / total.max(1) as f64;
        let left = plain.start.elapsed().as_secs_f64() * (1.0 - share) / share.max(1e-9);
        eprintln!(
            "{}: {done}/{total} ({:.0}%), {left:.0} s left  {note}",
            self.what,
            share * 100.0
        );
    }

    fn log(&self, line: &str) {
        if self.events.is_some() {
            super::out::event(&serde_json::json!({"event": "log", "line": line})).ok();
        }
        self.bar.suspend(|| eprintln!("{line}"));
    }

    fn figures(&self, point: &serde_json::Value) {
        if self.events.is_some() {
            super::out::event(&serde_json::json!({"event": "figures", "figures": point})).ok();
        }
    }
}
