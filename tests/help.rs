//! The examples of `--help` do what they say.

use std::path::Path;
use std::process::Command;

use super::run::{binary, call, robert};

/// Pages whose examples run here. Those of the others take minutes or a screen; that they
/// parse is tested where the command line is.
const PAGES: [&str; 18] = [
    "clip",
    "clip new",
    "clip check",
    "clip fmt",
    "clip info",
    "clip apply",
    "clip diff",
    "clip convert",
    "clip schema",
    "clip upgrade",
    "rollout",
    "eval",
    "export",
    "tasks ls",
    "tasks show",
    "models ls",
    "robots show",
    "robots settle",
];

/// What cannot run here: other programs, what is not made here, pages with pictures.
const ELSEWHERE: [&str; 4] = ["my_arm", "--to html", "runs/", "robert tasks trial"];

/// A command line as the shell gets it: without the remark behind it, jq and what costs time.
fn command(line: &str) -> String {
    let line = line.trim().split("   ").next().unwrap_or_default();
    let line = line.split(" | jq").next().unwrap_or_default();
    line.replace("--suite manual", "--suite small")
        .replace("--seeds 8", "--seeds 2")
        .replace("--seeds 4", "--seeds 2")
}

/// A folder with the files that the examples name.
fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let run = |args: &[&str]| {
        let (code, _, err) = call(dir.path(), args);
        assert_eq!(code, 0, "{args:?}: {err}");
    };
    let new = ["clip", "new", "--robot", "ur5e", "--secs", "1", "-o", "first.clip.json"];
    run(&new);
    std::fs::create_dir_all(at("assets/clips/ur5e")).unwrap();
    std::fs::create_dir_all(at("small")).unwrap();
    std::fs::create_dir_all(at("my-clips")).unwrap();
    for copy in [
        "wave.clip.json",
        "fist.clip.json",
        "old.clip.json",
        "new.clip.json",
        "a.clip.json",
        "b.clip.json",
        "small/short.clip.json",
        "my-clips/short.clip.json",
        "assets/clips/ur5e/short.clip.json",
    ] {
        std::fs::copy(at("first.clip.json"), at(copy)).unwrap();
    }
    for file in ["log.csv", "plan.yaml", "scene.xml"] {
        run(&["clip", "convert", "wave.clip.json", file]);
    }
    run(&["rollout", "wave.clip.json", "--policy", "zero", "--out", "wave.mcap"]);
    std::fs::write(at("ops.json"), r#"{"op": "keys.hold", "args": {"frames": [0], "hold": 5}}"#)
        .unwrap();
    std::fs::remove_file(at("first.clip.json")).unwrap();
    dir
}

fn shell(dir: &Path, line: &str) -> (Option<i32>, String) {
    let path = format!("{}:{}", binary().parent().unwrap().display(), env!("PATH"));
    let out = Command::new("sh")
        .args(["-c", line])
        .env("PATH", path)
        .env("NO_COLOR", "1")
        .current_dir(dir)
        .output()
        .unwrap();
    (out.status.code(), String::from_utf8_lossy(&out.stderr).into_owned())
}

#[test]
fn examples_of_the_help_run() {
    let mut ran = 0;
    for page in PAGES {
        let args: Vec<&str> = page.split(' ').chain(["--help"]).collect();
        let help = robert().args(args).succeeds().stdout;
        let examples = help.split("\nExamples:\n").nth(1).unwrap_or_else(|| panic!("{page}"));
        // The examples of a page follow each other.
        let dir = folder();
        for line in examples.lines().take_while(|l| l.starts_with("  ")) {
            if ELSEWHERE.iter().any(|e| line.contains(e)) {
                continue;
            }
            let line = command(line);
            // It makes the clip that the others begin with; here that is there already.
            let line = line.replace("-o wave.clip.json", "-o wave.clip.json --force");
            let (code, err) = shell(dir.path(), &line);
            // 4 is an answer: files differ, a limit was missed, findings remain.
            let asked = ["--exit-code", "--max-precision", "--strict"];
            let may = asked.iter().any(|a| line.contains(a)) && code == Some(4);
            assert!(code == Some(0) || may, "{page}: {line}: {code:?} {err}");
            ran += 1;
        }
    }
    assert!(ran > 35, "{ran}");
}
