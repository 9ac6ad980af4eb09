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
    json(dir, &[&SMALL[..], &["--out", out], extra].concat())
}

fn json(dir: &Path, args: &[&str]) -> serde_json::Value {
    let (code, text, err) = call(dir, args);
    assert_eq!(code, 0, "{err}");
    serde_json::from_str(&text).unwrap()
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
fn damage_is_named_and_repaired() {
    let dir = tempfile::tempdir().unwrap();
    let first = collect(dir.path(), "d", &[]);
    assert_eq!(first["totals"]["frames"], 4000);
    assert_eq!(first["agents"][0]["curve"].as_array().unwrap().len(), 2);
    let coverage = std::fs::read(dir.path().join("d/coverage.png")).unwrap();
    assert!(coverage.starts_with(b"\x89PNG"), "where the data lie, beside them");
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
    assert!(err.contains("2 of 3 shards") && err.contains("--resume"), "{err}");
    assert!(err.contains("rnd-00001.safetensors"), "{err}");
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
    // The shards of a collection would be lost without its manifest; a view is made again.
    let (code, _, err) = call(dir.path(), &["dataset", "shrink", "2", "e", "--out", "d"]);
    assert_eq!((code, err.contains("only its manifest describes")), (2, true), "{err}");
    view(&["dataset", "merge", "d", "e", "--out", "m", "--json"]);

    let (code, _, err) =
        call(dir.path(), &["dataset", "pick", "d", "--frames", "1", "--out", "few/er"]);
    assert_eq!((code, err.contains("shortest trajectory has 250 frames")), (2, true), "{err}");
    assert!(!dir.path().join("few").exists());
    let (code, _, err) = call(dir.path(), &["dataset", "merge", "d", "v/third", "--out", "few"]);
    assert_eq!((code, err.contains("two inputs")), (3, true), "{err}");
    assert!(!dir.path().join("few").exists());
    std::fs::write(dir.path().join("file"), "x").unwrap();
    for args in [
        &["dataset", "shrink", "2", "d", "--out", "file"][..],
        &["collect", "--robot", "pointmass", "--out", "file"],
    ] {
        let (code, _, err) = call(dir.path(), args);
        assert_eq!((code, err.contains("is a file")), (2, true), "{err}");
    }

    let (code, ..) = call(dir.path(), &["dataset", "plot", "m", "--out", "m.png"]);
    assert_eq!(code, 0);
    let png = std::fs::read(dir.path().join("m.png")).unwrap();
    assert!(png.starts_with(b"\x89PNG") && png.len() > 20_000);
}

#[test]
fn a_manifest_that_was_altered_does_not_pass() {
    let dir = tempfile::tempdir().unwrap();
    let (code, ..) = call(
        dir.path(),
        &["collect", "--robot", "pointmass", "--transitions", "1000", "--out", "d"],
    );
    assert_eq!(code, 0);
    let path = dir.path().join("d/manifest.json");
    let good = std::fs::read_to_string(&path).unwrap();
    for (old, new, named) in [
        ("\"start\":250", "\"start\":100", "episodes[1]"),
        ("\"frames\": 1000", "\"frames\": 0", "totals.frames"),
        ("\"noise\": 1000", "\"noise\": 999", "statistics.agents"),
    ] {
        assert!(good.contains(old), "{good}");
        std::fs::write(&path, good.replacen(old, new, 1)).unwrap();
        let (code, text, err) = call(dir.path(), &["dataset", "check", "d"]);
        assert_eq!((code, (text + &err).contains(named)), (3, true), "{err}");
    }
    let mut m: serde_json::Value = serde_json::from_str(&good).unwrap();
    m["episodes"] = serde_json::json!([]);
    std::fs::write(&path, m.to_string()).unwrap();
    let (code, _, err) = call(dir.path(), &["dataset", "plot", "d", "--out", "d.png"]);
    assert_eq!((code, err.contains("nothing to draw")), (3, true), "{err}");
    assert!(!dir.path().join("d.png").exists());
    let (code, _, err) = call(dir.path(), &["dataset", "split", "d", "--out", "s"]);
    assert_eq!((code, err.contains("no trajectory")), (2, true), "{err}");
}

#[test]
fn trained_agents_serve_another_amount() {
    let dir = tempfile::tempdir().unwrap();
    let rnd = "collect --robot pointmass --agent rnd --agent-steps 1000 --set hidden=16 --json";
    let rnd: Vec<&str> = rnd.split(' ').collect();
    let with = |more: &[&str]| json(dir.path(), &[&rnd[..], more].concat());
    let first = with(&["--transitions", "4000", "--out", "a"]);
    let second = with(&["--transitions", "6000", "--out", "b", "--agents-from", "a"]);
    assert_eq!(second["totals"]["frames"], 6000);
    assert_eq!(first["agents"], second["agents"]);
    let snapshot = "agents/rnd/snapshot-000001000.safetensors";
    let read = |name: &str| std::fs::read(dir.path().join(name).join(snapshot)).unwrap();
    assert!(read("a") == read("b"));
}

/// The library, Python, the studio and `robert new` have the same default.
#[test]
fn a_robot_that_is_not_built_in_is_recorded_with_babbling() {
    let dir = tempfile::tempdir().unwrap();
    let arm = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/arm.urdf");
    let (code, _, err) = call(dir.path(), &["import", arm, "--out", "arm"]);
    assert_eq!(code, 0, "{err}");
    for (robot, agent) in [("arm", "babble"), ("pointmass", "noise")] {
        let data = format!("{robot}-data");
        let few = ["collect", "--robot", robot, "--transitions", "60", "--out", &data, "--json"];
        json(dir.path(), &few);
        let spec =
            format!("kind = \"collect\"\nrobot = \"{robot}\"\ntransitions = 60\nshards = 1\n");
        std::fs::write(dir.path().join("spec.toml"), spec).unwrap();
        let (work, all) = (format!("{robot}-work"), format!("{robot}-all"));
        for args in [
            &["shard", "plan", "spec.toml", "--out", &work][..],
            &["shard", "run", &work, "--index", "0"],
            &["shard", "merge", &work, "--out", &all],
        ] {
            let (code, _, err) = call(dir.path(), args);
            assert_eq!(code, 0, "{err}");
        }
        for data in [&data, &all] {
            let text = std::fs::read(dir.path().join(data).join("manifest.json")).unwrap();
            let manifest: serde_json::Value = serde_json::from_slice(&text).unwrap();
            let agents = manifest["statistics"]["agents"].as_object().unwrap();
            assert_eq!(agents.keys().collect::<Vec<_>>(), [agent], "{data}");
        }
    }
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
    let most = u64::MAX.to_string();
    let large = ["collect", "--robot", "ur5e", "--transitions", &most, "--out", "x"];
    let ran = robert().args(large).fails(2);
    assert!(ran.stderr.contains("or less") && !ran.path("x").exists(), "{}", ran.stderr);
    let ran = robert().args(["dataset", "info", "nowhere"]).fails(3);
    assert!(ran.stderr.contains("nowhere"));
}
