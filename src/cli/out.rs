//! Results on stdout: one JSON document, or a table for people.

use std::io::{self, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use comfy_table::{CellAlignment, ContentArrangement, LineStyle, Table, TableStyle};
use serde::Serialize;

use super::escape;
use super::failure::Outcome;
use crate::progress::JobEvent;

/// Whether stdout takes JSON lines (`--jsonl`). Set once, before any command runs.
static LINES: AtomicBool = AtomicBool::new(false);

/// From now on results and progress are JSON lines.
pub(super) fn in_lines() {
    LINES.store(true, Ordering::Relaxed);
}

/// Whether results and progress are JSON lines.
pub(super) fn is_in_lines() -> bool {
    LINES.load(Ordering::Relaxed)
}

/// A path as a word for the shell, in quotes where it needs them.
pub(super) fn word(path: &Path) -> String {
    let text = path.to_string_lossy();
    shlex::try_quote(&text).map_or_else(|_| text.to_string(), std::borrow::Cow::into_owned)
}

/// Prints one event of `--jsonl`.
pub(super) fn event(event: &JobEvent) -> Outcome {
    // Through a value, so that the members of every event are sorted by name.
    json_text(&serde_json::to_value(event).map_err(io::Error::other)?.to_string())
}

/// Prints one pretty JSON document; with `--jsonl` as the event `result`.
pub(super) fn json(value: &impl Serialize) -> Outcome {
    if is_in_lines() {
        let result = serde_json::to_value(value).map_err(io::Error::other)?;
        return event(&JobEvent::Result { result });
    }
    json_text(&serde_json::to_string_pretty(value).map_err(io::Error::other)?)
}

fn json_text(text: &str) -> Outcome {
    bytes(format!("{}\n", escape::json(text)).as_bytes())
}

/// Prints a line for people. It may contain names from foreign files.
pub(super) fn line(text: &str) -> Outcome {
    bytes(format!("{}\n", escape::plain(text)).as_bytes())
}

/// Prints a line on stderr. Unlike `eprintln!` it does not panic if nobody reads any more or the
/// disk of a log is full: a message must not end the work.
pub(super) fn aside(line: impl std::fmt::Display) {
    writeln!(io::stderr(), "{}", escape::plain(&line.to_string())).ok();
}

/// Writes to stdout. A closed pipe (`| head`) is not an error, and the command still ends with its
/// own exit code.
pub(super) fn bytes(bytes: &[u8]) -> Outcome {
    let mut out = io::stdout().lock();
    match out.write_all(bytes).and_then(|()| out.flush()) {
        Err(e) if e.kind() != io::ErrorKind::BrokenPipe => Err(e.into()),
        _ => Ok(()),
    }
}

const STYLE: TableStyle =
    TableStyle::new().header_separator(LineStyle::none().fill('─').junction('─'));

/// A table without vertical lines: header, rule, rows.
pub(super) fn table(header: &[&str]) -> Table {
    let mut t = Table::new();
    t.load_style(STYLE)
        .set_content_arrangement(ContentArrangement::Dynamic)
        .set_header(header.to_vec());
    t
}

/// A number in a table or a sentence; a dash if there is none.
pub(super) fn number(x: Option<f64>, digits: usize) -> String {
    x.map_or_else(|| "-".to_owned(), |x| format!("{x:.digits$}"))
}

/// Aligns all columns except the first `texts` to the right.
pub(super) fn right(t: &mut Table, texts: usize) {
    for column in t.column_iter_mut().skip(texts) {
        column.set_cell_alignment(CellAlignment::Right);
    }
}
