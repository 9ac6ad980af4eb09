//! The disk is full at any moment: the old file stands, the path is named, nothing is left
//! lying about, and the same command succeeds once there is room.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use crate::run::binary;
use crate::studio::CLIP;

/// Runs with files of at most `blocks` times 512 bytes. A write beyond is an error, not a
/// signal, as on a full disk.
fn limited(dir: &Path, blocks: u64, args: &[&str]) -> Output {
    let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" \"$@\"");
    Command::new("sh")
        .args(["-c", &script])
        .arg(binary())
        .args(args)
        .current_dir(dir)
        .env("NO_COLOR", "1")
        .env("XDG_CACHE_HOME", dir.join("cache"))
        .output()
        .unwrap()
}

/// All files below a folder, those of the cache aside.
fn files(dir: &Path) -> Vec<String> {
    let mut found = Vec::new();
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() && !path.ends_with("cache") {
            found.extend(files(&path));
        } else {
            found.push(path.display().to_string());
        }
    }
    found.sort();
    found
}

/// Runs a command with ever more room until it succeeds. `old` is what stands at `made`.
fn until_success(dir: &Path, made: &str, old: &[u8], step: u64, args: &[&str]) {
    let before = files(dir);
    let mut failures = 0;
    for blocks in (0..).step_by(step as usize) {
        let out = limited(dir, blocks, args);
        let text = String::from_utf8_lossy(&out.stderr).into_owned();
        if out.status.success() {
            assert!(failures > 0, "{args:?}: it was never short of room");
            assert_ne!(fs::read(dir.join(made)).unwrap(), old);
            return;
        }
        failures += 1;
        assert!(failures < 400, "{args:?}: {text}");
        assert_eq!(out.status.code(), Some(1), "{args:?}, {blocks} blocks: {text}");
        assert!(text.contains("error: cannot write") && text.contains(made), "{text}");
        assert_eq!(text.matches("File too large").count(), 1, "told once: {text}");
        assert_eq!(fs::read(dir.join(made)).unwrap(), old, "{blocks} blocks");
        assert_eq!(files(dir), before, "{blocks} blocks");
    }
}

#[test]
fn a_clip_an_export_and_a_take_are_whole_or_as_they_were() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    fs::write(at("a.clip.json"), CLIP).unwrap();
    fs::write(at("op.json"), r#"{"op": "clip.rename", "args": {"name": "changed"}}"#).unwrap();
    let notes = format!(r#"{{"op": "clip.notes", "args": {{"notes": "{}"}}}}"#, "x".repeat(9000));
    fs::write(at("notes.json"), notes).unwrap();
    for name in ["old.csv", "old.mcap"] {
        fs::write(at(name), "old").unwrap();
    }
    until_success(
        dir.path(),
        "old.csv",
        b"old",
        1,
        &["clip", "convert", "a.clip.json", "old.csv", "--force"],
    );
    let rollout = ["rollout", "a.clip.json", "--policy", "pd", "-o", "old.mcap"];
    until_success(dir.path(), "old.mcap", b"old", 16, &rollout);
    let apply = ["clip", "apply", "a.clip.json", "notes.json", "--in-place"];
    until_success(dir.path(), "a.clip.json", CLIP.as_bytes(), 1, &apply);
}
