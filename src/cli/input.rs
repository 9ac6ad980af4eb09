//! The inputs and outputs of commands: files, pipes (`<(…)`), and `-` for stdin and stdout.
//!
//! A pipe can be read only once, but a command reads its input several times (is it a take, a clip,
//! a table?). So the content of a pipe is kept.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use super::failure::{Failure, Outcome};
use super::out;
use crate::clip::{Clip, Parsed, parse_bytes};
use crate::take::Take;
use crate::{fsio, limits};

/// The name `-`: stdin as an input, stdout as an output.
pub(super) const STANDARD: &str = "-";

/// Whether this name means stdin or stdout.
pub(super) fn is_standard(path: &Path) -> bool {
    path == Path::new(STANDARD)
}

/// Whether there is something to read.
pub(super) fn exists(path: &Path) -> bool {
    is_standard(path) || path.exists()
}

/// Its name in messages.
pub(super) fn place(path: &Path) -> PathBuf {
    if is_standard(path) { PathBuf::from("stdin") } else { path.to_owned() }
}

/// The whole content, at most `cap` bytes.
pub(super) fn read(path: &Path, cap: u64) -> Outcome<Vec<u8>> {
    static KEPT: Mutex<BTreeMap<PathBuf, Vec<u8>>> = Mutex::new(BTreeMap::new());
    if !is_standard(path) && !is_pipe(path) {
        return Ok(fsio::read_capped(path, cap)?);
    }
    let mut kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(bytes) = kept.get(path) {
        return Ok(bytes.clone());
    }
    let bytes = if is_standard(path) {
        all(std::io::stdin().lock(), path)?
    } else {
        let fail = |source| fsio::Error::Read { source, path: path.to_owned() };
        all(File::open(path).map_err(fail)?, path)?
    };
    if bytes.len() as u64 > cap {
        return Err(Failure::invalid(format!("{}: more than {cap} bytes", place(path).display())));
    }
    kept.insert(path.to_owned(), bytes.clone());
    Ok(bytes)
}

/// The largest input of any command.
const INPUT_BYTES: u64 = limits::TAKE_BYTES;

fn all(from: impl std::io::Read, path: &Path) -> Outcome<Vec<u8>> {
    let mut bytes = Vec::new();
    let fail = |source| fsio::Error::Read { source, path: place(path) };
    from.take(INPUT_BYTES + 1).read_to_end(&mut bytes).map_err(fail)?;
    Ok(bytes)
}

/// Whether the path is a pipe that the shell made for this command. Named pipes are refused, as is
/// everything else that is not a regular file, because nobody may ever write to them.
pub(super) fn is_pipe(path: &Path) -> bool {
    let from_shell = ["/dev/fd", "/proc/self/fd", "/dev/stdin", "/dev/stdout"];
    from_shell.iter().any(|p| path.starts_with(p)) && path.metadata().is_ok_and(|m| !m.is_file())
}

/// Its first bytes; nothing if it cannot be read.
pub(super) fn head(path: &Path, length: usize) -> Vec<u8> {
    let mut head = Vec::new();
    if is_standard(path) || is_pipe(path) {
        head = read(path, INPUT_BYTES).unwrap_or_default();
        head.truncate(length);
    } else if let Ok(file) = fsio::open_regular(path) {
        file.take(length as u64).read_to_end(&mut head).ok();
    }
    head
}

/// A clip with the places of its values.
pub(super) fn clip(path: &Path) -> Outcome<Parsed> {
    let bytes = read(path, limits::CLIP_BYTES)?;
    Ok(parse_bytes(bytes).map_err(|e| e.in_file(&place(path)))?)
}

/// A whole take.
pub(super) fn take(path: &Path) -> Outcome<Take> {
    let bytes = read(path, limits::TAKE_BYTES)?;
    Ok(Take::from_mcap(&bytes).map_err(|e| e.in_file(&place(path)))?)
}

/// Reads a TOML table that gives joints other names.
pub(super) fn names(path: &Path) -> Outcome<BTreeMap<String, String>> {
    let wrong =
        |e: &dyn std::fmt::Display| Failure::invalid(format!("{}: {e}", place(path).display()));
    let text = String::from_utf8(read(path, limits::CLIP_BYTES)?).map_err(|e| wrong(&e))?;
    toml::from_str(&text).map_err(|e| wrong(&e))
}

/// Writes a file atomically, or writes into an existing pipe or device, or to stdout.
pub(super) fn write(path: &Path, bytes: &[u8]) -> Outcome {
    if is_standard(path) {
        return out::bytes(bytes);
    }
    // A pipe cannot be replaced by a finished file.
    if is_pipe(path) {
        let fail = |source| fsio::Error::Write { source, path: path.to_owned() };
        return Ok(std::fs::write(path, bytes).map_err(fail)?);
    }
    Ok(fsio::write_atomic(path, bytes)?)
}

/// Writes a clip back to the file that it was read from. If another program has changed the file
/// since then, it is refused. `before` is the content that was read.
pub(super) fn rewrite(path: &Path, before: &[u8], text: &str) -> Outcome {
    if !is_standard(path)
        && !is_pipe(path)
        && fsio::read_capped(path, limits::CLIP_BYTES).is_ok_and(|now| now != before)
    {
        return Err(Failure::invalid(format!(
            "another program has changed this file meanwhile; it was left alone, run the \
             command again: {}",
            path.display()
        )));
    }
    write(path, text.as_bytes())
}

/// Writes a clip to a file, or to stdout.
pub(super) fn write_clip(path: &Path, clip: &Clip) -> Outcome {
    write(path, clip.to_text().as_bytes())
}

/// Reports what was done: on stdout, unless the result itself goes there.
pub(super) fn say(stdout_taken: bool, text: &str) -> Outcome {
    if stdout_taken {
        out::aside(text);
        return Ok(());
    }
    out::line(text)
}
