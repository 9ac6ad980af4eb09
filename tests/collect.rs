//! Collecting and datasets, through the command line.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use crate::run::{binary, call, robert};

const SMALL: [&str; 10] = [
    "collect",
    "--robot",
    "pointmass",
    "--agent",
    "rnd,noise",
    "--agent-steps",
    "1000",
    "--transitions",
    "4000",
    "--json",
];

fn collect(dir: &Path, out: &str, extra: &[&str]) -> serde_json::Value {
    let done = Command::new(binary())
        .args(SMALL)
        .args(["--out", out])
        .args(extra)
        .current_dir(dir)
        .output()
        .unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    serde_json::from_slice(&done.stdout).unwrap()
}

/// Kills at growing distances; then the folder must hold what one undisturbed run makes.
#[test]
fn thirty_kills_change_no_bit() {
    let dir = tempfile::tempdir().unwrap();
    let whole = collect(dir.path(), "whole", &["--threads", "1"]);
    let (mut kills, mut wait) = (0, 5);
    while kills < 30 {
        let mut child = Command::new(binary())
            .args(SMALL)
            .args(["--out", "killed", "--resume"])
            .current_dir(dir.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(wait));
        let finished = child.try_wait().unwrap();
        child.kill().ok();
        child.wait().unwrap();
        // Kill -9 at 5, 10, ... ms of a run; a finished one is begun anew.
        if finished.is_some() {
            std::fs::remove_dir_all(dir.path().join("killed")).unwrap();
        }
        kills += 1;
        wait = 5 + (wait + 17) % 160;
    }
    let killed = collect(dir.path(), "killed", &["--resume"]);
    assert_eq!(whole["manifest_sha256"], killed["manifest_sha256"]);
    let read = |name: &str| std::fs::read(dir.path().join(name)).unwrap();
    let file = "shards/rnd-00000.safetensors";
    assert!(read(&format!("whole/{file}")) == read(&format!("killed/{file}")));
}

#[test]
fn damage_is_named_and_mended() {
    let dir = tempfile::tempdir().unwrap();
    let first = collect(dir.path(), "d", &[]);
    assert_eq!(first["totals"]["frames"], 4000);
    assert_eq!(first["agents"][0]["curve"].as_array().unwrap().len(), 2);
    let (code, text, _) = call(dir.path(), &["dataset", "check", "d"]);
    assert_eq!((code, text.contains("shards are whole")), (0, true), "{text}");

    let shard = dir.path().join("d/shards/rnd-00001.safetensors");
    let mut bytes = std::fs::read(&shard).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 4;
    std::fs::write(&shard, &bytes).unwrap();
    std::fs::write(dir.path().join("d/shards/noise-00000.safetensors"), &bytes[..500]).unwrap();
    let (code, text, err) = call(dir.path(), &["dataset", "check", "d"]);
    assert_eq!(code, 3);
    assert!(text.contains("rnd-00001") && text.contains("noise-00000"), "{text}");
    assert!(text.contains("differs from its sha256") && text.contains("500 bytes"), "{text}");
    assert!(err.contains("2 of 3 shards"), "{err}");
    let again = collect(dir.path(), "d", &["--resume"]);
    assert_eq!(first["manifest_sha256"], again["manifest_sha256"]);
}

#[test]
fn views_are_lists_over_the_same_shards() {
    let dir = tempfile::tempdir().unwrap();
    collect(dir.path(), "d", &[]);
    let view = |args: &[&str]| -> serde_json::Value {
        let (code, text, err) = call(dir.path(), args);
        assert_eq!(code, 0, "{err}");
        serde_json::from_str(&text).unwrap()
    };
    let tenth = view(&["dataset", "shrink", "3", "d", "--out", "v/third", "--json"]);
    assert_eq!(tenth["totals"]["episodes"], 16_u64.div_ceil(3));
    assert!(!dir.path().join("v/third/shards").exists(), "no frames are copied");
    let (code, ..) = call(dir.path(), &["dataset", "check", "v/third"]);
    assert_eq!(code, 0);
    let half = ["dataset", "corrupt", "0.5", "d", "--out", "half", "--seed", "2", "--json"];
    let (a, b) = (view(&half), view(&half));
    assert_eq!(a["manifest_sha256"], b["manifest_sha256"]);
    assert_eq!(a["totals"]["episodes"], 16);
    let text = std::fs::read_to_string(dir.path().join("half/manifest.json")).unwrap();
    assert_eq!(text.matches("\"part\":\"test\"").count(), 1);

    collect(dir.path(), "e", &["--seed", "6"]);
    let x = view(&["dataset", "merge", "d", "e", "--out", "m", "--json"]);
    let y = view(&["dataset", "merge", "e", "d", "--out", "m2", "--equal", "--json"]);
    assert_eq!(x["totals"]["frames"], 8000);
    assert_eq!(y["statistics"]["agents"]["rnd"], y["statistics"]["agents"]["noise"]);
    let (code, _, err) = call(dir.path(), &["dataset", "shrink", "2", "d", "--out", "d"]);
    assert_eq!((code, err.contains("another folder")), (2, true), "{err}");

    let (code, ..) = call(dir.path(), &["dataset", "plot", "m", "--out", "m.png"]);
    assert_eq!(code, 0);
    let png = std::fs::read(dir.path().join("m.png")).unwrap();
    assert!(png.starts_with(b"\x89PNG") && png.len() > 20_000);
}

#[test]
fn bad_requests_are_refused_before_work_begins() {
    let ran = robert().args(["collect", "--robot", "nobody", "--out", "x"]).run();
    assert_eq!(ran.code, 3, "{}", ran.stderr);
    let ran = robert().args(["collect", "--robot", "ur5e", "--agent", "ppo", "--out", "x"]).run();
    assert_eq!((ran.code, ran.stderr.contains("rnd, icm, apt")), (2, true), "{}", ran.stderr);
    let small = ["collect", "--robot", "ur5e", "--transitions", "10", "--out", "x"];
    let ran = robert().args(small).fails(2);
    assert!(ran.stderr.contains("51 or more"), "{}", ran.stderr);
    assert!(!ran.path("x").exists());
    let ran = robert().args(["dataset", "info", "nowhere"]).fails(3);
    assert!(ran.stderr.contains("nowhere"));
}
