//! Files and folders that a command is about to write.

use std::io::Read;
use std::path::Path;

use super::failure::{Failure, Outcome};
use super::input;
use crate::fsio;

/// Begins a robot's model that a command wrote and can write again.
pub(super) const WRITTEN: &str = "<!-- A robot's model with keyframes, written by robert. -->\n";

/// Refuses to overwrite one of the inputs, or a file that a person made. The result of an earlier command
/// may be replaced.
pub(super) fn may_write(inputs: &[String], out: Option<&Path>) -> Outcome {
    let Some(path) = out else { return Ok(()) };
    let Ok(there) = std::fs::canonicalize(path) else { return Ok(()) };
    let is_there = |input: &&String| std::fs::canonicalize(input).is_ok_and(|p| p == there);
    if let Some(input) = inputs.iter().find(is_there) {
        return Err(Failure::usage(format!(
            "{input} is the input and would be overwritten: name another output file"
        )));
    }
    may_replace(path)
}

/// Refuses to overwrite a file that no command could make again.
fn may_replace(path: &Path) -> Outcome {
    match made_by_hand(path) {
        Some(what) => Err(Failure::usage(format!(
            "{} is a {what} and would be lost: name another output file, or remove it first",
            path.display()
        ))),
        None => Ok(()),
    }
}

/// Whether a file can be written, before hours of work for it: [`may_replace`], and its folder takes files.
pub(super) fn may_create(path: &Path) -> Outcome {
    if input::is_standard(path) {
        return Ok(());
    }
    may_replace(path)?;
    Ok(fsio::writable(path)?)
}

/// Refuses an output folder that is a file.
pub(super) fn may_be_folder(out: &Path) -> Outcome {
    if out.exists() && !out.is_dir() {
        let path = out.display();
        return Err(Failure::usage(format!("--out must be a folder, but {path} is a file")));
    }
    Ok(())
}

/// The bytes of a file in which its kind is looked for: a licence may come first.
const HEAD: u64 = 65_536;

/// The kind of an existing file, if no command could make the file again.
fn made_by_hand(path: &Path) -> Option<&'static str> {
    let mut head = Vec::new();
    fsio::open_regular(path).ok()?.take(HEAD).read_to_end(&mut head).ok()?;
    let text = String::from_utf8_lossy(&head);
    if text.trim_start().starts_with('{') && text.contains("\"robert-clip/") {
        return Some("clip");
    }
    if text.contains(WRITTEN.trim_end()) {
        return None;
    }
    // Exports with their own `<mujoco>` element contain only keys.
    let root = |name: &str| {
        let mut after = text.match_indices(name).map(|(at, _)| &text[at + name.len()..]);
        after.any(|rest| rest.starts_with(|c: char| c.is_whitespace() || c == '>'))
    };
    let model = root("<robot") || text.contains("<worldbody") || text.contains("<compiler");
    (text.trim_start().starts_with('<') && model).then_some("robot's model")
}
