//! Training and its benchmarks through the binary.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use robert::rng::{Rng, Stream};

use crate::run::{binary, call, robert};

#[test]
fn settings_that_do_not_exist_are_named() {
    let base = ["train", "--robot", "pointmass", "--data", "nowhere"];
    let ran = robert().args(base).args(["--preset", "huge"]).fails(2);
    assert!(ran.stderr.contains("huge") && ran.stderr.contains("ur-small"));
    let ran = robert().args(base).args(["--set", "learning_rate=1"]).fails(2);
    assert!(ran.stderr.contains("learning_rate") && ran.stderr.contains("weight_decay"));
    let ran = robert().args(base).args(["--set", "skip=gated", "--set", "lr=fast"]).fails(2);
    assert!(ran.stderr.contains("lr=fast"));
    // Sizes that make no network are seen before any data.
    for (bad, what) in [
        (&["heads=3"][..], "heads"),
        (&["width=20"], "width"),
        (&["bins=97"], "bins"),
        (&["ridge_history=31"], "ridge_history"),
        (&["layers=0"], "layers"),
        (&["width=8192", "layers=64", "heads=8"], "weights"),
        (&["preset=ur-small"], "--preset"),
        (&["steps=2000000000000"], "steps"),
    ] {
        let set = bad.iter().flat_map(|s| ["--set", s]);
        let ran = robert().args(base).args(set).fails(2);
        assert!(ran.stderr.contains(what), "{bad:?}: {}", ran.stderr);
    }
}

#[test]
fn a_dataset_that_is_missing_is_invalid_input() {
    let ran = robert().args(["train", "--robot", "pointmass", "--data", "nowhere"]).fails(3);
    assert!(ran.stderr.contains("nowhere"));
}

#[test]
fn a_model_that_is_missing_or_damaged_is_invalid_input() {
    let eval = |model: &str| {
        robert()
            .file("bad.safetensors", b"not a model")
            .args(["eval", "--robot", "ur5e", "--suite", "manual", "--policy", model])
    };
    assert!(eval("robert:bad.safetensors").fails(3).stderr.contains("bad.safetensors"));
    assert!(eval("ridge:none.safetensors").fails(3).stderr.contains("none.safetensors"));
}

#[test]
fn a_robot_without_a_trained_policy_says_what_to_name() {
    let dir = tempfile::tempdir().unwrap();
    let arm = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/arm.urdf");
    let (code, _, stderr) = call(dir.path(), &["import", arm, "--out", "arm"]);
    assert_eq!(code, 0, "{stderr}");
    let eval = ["eval", "--robot", "arm", "--suite", "trial", "--policy", "robert"];
    let (code, _, stderr) = call(dir.path(), &eval);
    assert_eq!(code, 5, "{stderr}");
    assert!(stderr.contains("robert:PATH"), "{stderr}");
}

#[test]
fn reference_files_cover_every_variant() {
    let ran = robert().args(["bench", "reference", "--out", "ref"]).succeeds();
    assert_eq!(ran.stdout.lines().count(), 17);
    assert!(ran.path("ref/k10-skip_off-replace-all.safetensors").exists());
}

#[test]
fn bench_infer_reports_json() {
    let args = ["bench", "infer", "--size", "s", "--secs", "0.2", "--json"];
    let report = robert().args(args).succeeds().json();
    assert_eq!(report["sizes"][0]["size"], "S");
    assert!(report["sizes"][0]["ms"].as_f64().unwrap() > 0.0);
    assert!(report["peak_gflops"].as_f64().unwrap() > 0.0);
    for bad in [["--secs", "NaN"], ["--secs", "0"], ["--batch", "0"], ["--batch", "70000"]] {
        assert!(robert().args(["bench", "train"]).args(bad).fails(2).stderr.contains(bad[0]));
    }
}

/// A run so small that a test can afford it.
const TINY: [&str; 17] = [
    "train",
    "--robot",
    "pointmass",
    "--data",
    "data",
    "--set",
    "layers=1",
    "--set",
    "width=16",
    "--set",
    "heads=1",
    "--set",
    "batch=8",
    "--set",
    "average=0.9",
    "--set",
    "ridge_history=2",
];

/// Goes on in `cut`, with as many evaluations as it began with.
const RESUME: [&str; 5] = ["train", "--resume", "cut", "--checkpoint-mins", "0.001"];

fn tiny<'a>(extra: &[&'a str]) -> Vec<&'a str> {
    TINY.into_iter().chain(extra.iter().copied()).collect()
}

/// Collects a little noise into `data`.
fn collect(dir: &Path) {
    let args = ["collect", "--robot", "pointmass", "--transitions", "4000", "--out", "data"];
    let (code, _, stderr) = call(dir, &args);
    assert_eq!(code, 0, "{stderr}");
}

/// Kills while training in a test run; `ROBERT_KILLS=20` for the long one.
fn kills() -> u64 {
    std::env::var("ROBERT_KILLS").ok().and_then(|k| k.parse().ok()).unwrap_or(3)
}

#[test]
fn a_run_that_is_not_there_cannot_go_on() {
    let dir = tempfile::tempdir().unwrap();
    let (code, _, stderr) = call(dir.path(), &["train", "--resume", "runs/none"]);
    assert_eq!(code, 3, "{stderr}");
    assert!(stderr.contains("there is no run here") && stderr.contains("runs/none"), "{stderr}");
}

#[test]
fn killed_at_any_step_and_resumed_gives_the_same_file() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    collect(dir);
    let steps = format!("steps={}", 1000 * kills());
    let rest = ["--set", &steps, "--evaluations", "0", "--checkpoint-mins", "0.001", "--out"];
    let began = Instant::now();
    let (code, _, stderr) = call(dir, &tiny(&[&rest[..], &["whole", "--threads", "1"]].concat()));
    assert_eq!(code, 0, "{stderr}");
    let span = began.elapsed();
    let start = tiny(&[&rest[..], &["cut"]].concat());
    let mut rng = Rng::new(1, Stream::Test, 5);
    let mut done = 0;
    for round in 0..10 * kills() {
        let fresh = !dir.join("cut/ckpt/last.safetensors").exists();
        if fresh {
            // Killed before there was anything to go on from: begin again.
            std::fs::remove_dir_all(dir.join("cut")).ok();
        }
        let mut cut = Command::new(binary())
            .args(if fresh { &start[..] } else { &RESUME[..] })
            .args(["--threads", if round % 2 == 0 { "1" } else { "2" }])
            .current_dir(dir)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        // Every other beginning is cut at any time, before the first checkpoint too.
        while fresh && round % 2 == 1 && cut.try_wait().unwrap().is_none() {
            if dir.join("cut/ckpt/last.safetensors").exists() {
                break;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        // Long enough to get on, on a machine of any speed; short enough to be cut.
        std::thread::sleep(span.mul_f64((0.3 + rng.uniform()) / kills() as f64));
        let ended = cut.try_wait().unwrap().is_some();
        cut.kill().ok();
        cut.wait().unwrap();
        // A kill before the first checkpoint leaves nothing to go on from: it does not count.
        done += u64::from(!ended && dir.join("cut/ckpt/last.safetensors").exists());
        if ended || done == kills() {
            break;
        }
    }
    assert!(done > 0, "no kill came between the first checkpoint and the end");
    let (code, _, stderr) = call(dir, &RESUME);
    assert_eq!(code, 0, "{stderr}");
    let sha = |run: &str| {
        robert::fsio::sha256_hex(&std::fs::read(dir.join(run).join("model.safetensors")).unwrap())
    };
    assert_eq!(sha("whole"), sha("cut"), "after {done} kills");
    let metrics = std::fs::read_to_string(dir.join("cut/metrics.jsonl")).unwrap();
    assert!(!metrics.contains("\"evaluation\""), "none was asked for when it began");
}

#[test]
fn ctrl_c_keeps_a_checkpoint_and_says_how_to_go_on() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    collect(dir);
    let rest = ["--set", "steps=100000", "--evaluations", "0", "--out", "cut"];
    let mut child = Command::new(binary())
        .args(tiny(&rest))
        .current_dir(dir)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let began = Instant::now();
    while !dir.join("cut/ckpt/last.safetensors").exists() {
        assert!(began.elapsed().as_secs() < 300, "no first checkpoint");
        std::thread::sleep(Duration::from_millis(20));
    }
    std::thread::sleep(Duration::from_millis(500));
    let pid = rustix::process::Pid::from_child(&child);
    rustix::process::kill_process(pid, rustix::process::Signal::INT).unwrap();
    let mut stderr = String::new();
    std::io::Read::read_to_string(&mut child.stderr.take().unwrap(), &mut stderr).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130), "{stderr}");
    assert!(stderr.contains("--resume cut"), "{stderr}");
    let after = stderr.split("stopped at step ").nth(1).unwrap();
    let stopped: u64 = after.split(';').next().unwrap().parse().unwrap();
    let card = robert::net::checkpoint::read_card(&dir.join("cut/model.safetensors")).unwrap();
    assert_eq!(card.training.step, stopped, "of the last step, not of the timer");
}

#[test]
fn a_run_is_listed_shown_compared_and_drawn() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    collect(dir);
    for (out, lr) in [("runs/a", "lr=1e-3"), ("runs/b", "lr=1e-4")] {
        let rest = ["--set", "steps=4", "--set", lr, "--evaluations", "1", "--out", out, "--json"];
        let (code, stdout, stderr) = call(dir, &tiny(&rest));
        assert_eq!(code, 0, "{stderr}");
        let report: serde_json::Value = serde_json::from_str(&stdout).unwrap();
        // Four steps may well be worse than the linear prediction that they start from.
        let best = report["result"]["best"][1].as_f64().unwrap();
        assert!(best <= report["result"]["linear"].as_f64().unwrap(), "{report}");
        let png = std::fs::read(dir.join(out).join("curves.png")).unwrap();
        assert!(png.starts_with(b"\x89PNG"));
    }
    let (code, text, _) = call(dir, &["runs", "ls"]);
    assert!(code == 0 && text.contains("pointmass") && text.lines().count() >= 4, "{text}");
    let (code, text, _) = call(dir, &["runs", "show", "runs/a"]);
    assert_eq!(code, 0);
    for part in ["best, step ", "last, step 4", "linear prediction", "manual/circle", "at a stop"] {
        assert!(text.contains(part), "no {part:?} in {text}");
    }
    // Nothing touches in this plane: no error of zero there.
    let contact = text.lines().find(|l| l.contains("in contact")).unwrap();
    assert!(contact.trim_end().ends_with('-'), "{contact}");
    let (_, json, _) = call(dir, &["runs", "show", "runs/a", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let precision = |found: &serde_json::Value| found["precision"].as_f64().unwrap();
    let all = [&json["linear"], &json["evaluations"][0]["found"]].map(precision);
    assert_eq!(precision(&json["best"]["found"]), all[0].min(all[1]));
    let (code, text, _) = call(dir, &["runs", "compare", "runs/a", "runs/b", "-o", "c.png"]);
    assert_eq!(code, 0);
    let line = text.lines().find(|l| l.trim_start().starts_with("lr")).unwrap();
    assert!(line.contains("0.001") && line.contains("0.0001"), "{line}");
    assert!(!text.contains("weight_decay"), "only what differs: {text}");
    assert!(dir.join("c.png").exists());
    let (code, text, _) = call(dir, &["runs", "compare", "runs/a", "runs/b", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!((code, json["runs"].as_array().unwrap().len()), (0, 2));
    let linear = json["runs"][0]["linear"]["precision"].as_f64().unwrap();
    assert!(linear > 0.0 && linear < 1.0, "{linear}");
    let (code, _, stderr) = call(dir, &["runs", "show", "data"]);
    assert!(code == 3 && stderr.contains("config.toml"), "{stderr}");
}

const SWEEP: &str = r#"
title = "masks"
robot = "pointmass"
data = "data"
preset = "pm-tiny"
seeds = [0, 1]
x = "mask"
suites = ["test"]
cases = 1
[set]
steps = 2
layers = 1
width = 16
heads = 1
batch = 4
ridge_history = 2
[grid]
mask = ["none", "cl-uniform"]
corrupt = [0.0, 0.5]
"#;

#[test]
fn a_sweep_trains_every_point_and_goes_on_where_it_was() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    collect(dir);
    std::fs::write(dir.join("s.toml"), SWEEP).unwrap();
    let sweep = ["sweep", "s.toml", "--out", "sweep", "--json"];
    let (code, stdout, stderr) = call(dir, &sweep);
    assert_eq!(code, 0, "{stderr}");
    let report: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    let rows = report["rows"].as_array().unwrap();
    assert_eq!((rows.len(), &report["complete"]), (4, &true.into()));
    for row in rows {
        assert_eq!(row["seeds"], 2);
        let test = &row["suites"]["test"];
        assert!(test["mean"].as_f64().unwrap() > 0.0 && test["ci95"].as_f64().is_some(), "{row}");
        assert!(row["suites"]["test_high_mask"]["mean"].as_f64().is_some());
    }
    assert!(dir.join("sweep/sweep.png").exists());
    assert_eq!(std::fs::read_to_string(dir.join("sweep/table.csv")).unwrap().lines().count(), 5);
    // The local pool, and shards of a plan, make the same bits.
    let (code, stdout, stderr) =
        call(dir, &["sweep", "s.toml", "--out", "pooled", "--json", "--jobs", "2"]);
    assert_eq!(code, 0, "{stderr}");
    let pooled: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(pooled["rows"], report["rows"]);
    let bytes = |path: &str| std::fs::read(dir.join(path)).unwrap();
    assert_eq!(bytes("pooled/table.csv"), bytes("sweep/table.csv"));
    std::fs::write(dir.join("plan.toml"), format!("kind = \"sweep\"\n{SWEEP}")).unwrap();
    for step in [
        &["shard", "plan", "plan.toml", "--out", "work", "-q"][..],
        &["shard", "submit", "work", "--backend", "local", "--merge", "merged", "-q"],
    ] {
        let (code, _, stderr) = call(dir, step);
        assert_eq!(code, 0, "{stderr}");
    }
    let merged: serde_json::Value = serde_json::from_slice(&bytes("merged/results.json")).unwrap();
    assert_eq!(merged["rows"], report["rows"]);
    for seed in ["seed-0", "seed-1"] {
        let weights = |of: &str| {
            let path = format!("{of}/points/corrupt-0.5_mask-cl-uniform/{seed}/model.safetensors");
            let net = robert::net::checkpoint::load(&dir.join(path), None).unwrap().net;
            net.weights.iter().map(|w| w.to_bits()).collect::<Vec<_>>()
        };
        let want = weights("sweep");
        assert!(weights("pooled") == want && weights("merged") == want, "{seed}");
    }
    // One point is lost; only that one is measured again, with the same figures.
    let point = dir.join("sweep/points/corrupt-0.5_mask-none");
    let written = |file: &str| std::fs::metadata(point.join(file)).unwrap().modified().unwrap();
    let before = written("seed-0/result.json");
    std::fs::remove_dir_all(point.join("seed-1")).unwrap();
    let (code, again, stderr) = call(dir, &sweep);
    assert_eq!(code, 0, "{stderr}");
    let again: serde_json::Value = serde_json::from_str(&again).unwrap();
    assert_eq!(again["rows"], report["rows"]);
    assert_eq!(written("seed-0/result.json"), before);
    // A point whose training is done is only judged.
    std::fs::remove_file(point.join("seed-0/result.json")).unwrap();
    let (code, again, stderr) = call(dir, &sweep);
    assert_eq!(code, 0, "{stderr}");
    let again: serde_json::Value = serde_json::from_str(&again).unwrap();
    assert_eq!(again["rows"], report["rows"]);
    assert!(again["rows"][0]["nmse_clear"]["mean"].as_f64().is_some(), "{again}");
    // Other settings do not mix with what is there, nor do other data.
    std::fs::write(dir.join("s.toml"), SWEEP.replace("steps = 2", "steps = 3")).unwrap();
    let (code, _, stderr) = call(dir, &sweep);
    assert!(code == 3 && stderr.contains("other settings"), "{stderr}");
    std::fs::write(dir.join("s.toml"), SWEEP).unwrap();
    let other = ["collect", "--robot", "pointmass", "--transitions", "4000", "--seed", "1"];
    let (code, _, stderr) = call(dir, &[&other[..], &["--out", "other"]].concat());
    assert_eq!(code, 0, "{stderr}");
    let on_other = [&sweep[..], &["--data", "other"]].concat();
    let (code, _, stderr) = call(dir, &on_other);
    assert!(code == 3 && stderr.contains("belongs to other data"), "{stderr}");
    std::fs::remove_file(dir.join("sweep/data/source")).unwrap();
    let (code, _, stderr) = call(dir, &sweep);
    assert!(code == 3 && stderr.contains("choose another --out"), "{stderr}");
    let results = std::fs::read_to_string(dir.join("sweep/results.json")).unwrap();
    let results: serde_json::Value = serde_json::from_str(&results).unwrap();
    assert_eq!(results["data"], "data");
    assert_eq!(results["data_sha256"].as_str().map(str::len), Some(64));
}

#[test]
fn a_sweep_with_evaluations_judges_the_best_model_of_each_run() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    collect(dir);
    // Trained much too fast: the first evaluation is better than the last.
    let of = |evaluations: u64| {
        let hot = format!("evaluations = {evaluations}\n{SWEEP}")
            .replace("suites = [\"test\"]", "suites = [\"manual\"]")
            .replace("steps = 2", "steps = 6\nlr = 1.0")
            .replace("seeds = [0, 1]", "seeds = [0]")
            .replace("\"none\", ", "")
            .replace("[0.0, 0.5]", "[0.0]");
        std::fs::write(dir.join("hot.toml"), hot).unwrap();
        let out = format!("with-{evaluations}");
        let (code, stdout, stderr) = call(dir, &["sweep", "hot.toml", "--out", &out, "--json"]);
        assert_eq!(code, 0, "{stderr}");
        let report: serde_json::Value = serde_json::from_str(&stdout).unwrap();
        (report["rows"][0]["suites"]["manual"]["mean"].as_f64(), report)
    };
    let ((last, without), (best, with)) = (of(0), of(6));
    assert!(best.unwrap() < last.unwrap_or(f64::INFINITY), "{best:?} {last:?}");
    assert!(without["sweep"]["evaluations"].is_null() && with["sweep"]["evaluations"] == 6);
    let model = "robert:with-6/points/corrupt-0_mask-cl-uniform/seed-0/ckpt/best.safetensors";
    let eval = ["eval", "--robot", "pointmass", "--suite", "manual", "--policy", model];
    let (code, stdout, stderr) = call(dir, &[&eval[..], &["--no-floor", "--json"]].concat());
    assert_eq!(code, 0, "{stderr}");
    let found: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    let precision = found["results"][0]["precision_mean"].as_f64();
    assert!((precision.unwrap() - best.unwrap()).abs() < 1e-9, "{precision:?} {best:?}");
    // Results of the last and of the best model do not mix.
    let (code, _, stderr) = call(dir, &["sweep", "hot.toml", "--out", "with-0"]);
    assert!(code == 3 && stderr.contains("other settings"), "{stderr}");
}

#[test]
fn self_correction_adds_what_was_reached_and_survives_a_stop() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    collect(dir);
    let rest = ["--set", "steps=4", "--set", "self_tasks=3", "--self-correct", "1"];
    let rest = [&rest[..], &["--evaluations", "0", "--out"]].concat();
    let model = |run: &str| std::fs::read(dir.join(run).join("model.safetensors")).unwrap();
    for (out, threads) in [("one", "1"), ("two", "2")] {
        let args = tiny(&[&rest[..], &[out, "--threads", threads]].concat());
        let (code, _, stderr) = call(dir, &args);
        assert_eq!(code, 0, "{stderr}");
        assert!(stderr.contains("performing 3 tasks"), "{stderr}");
    }
    assert_eq!(model("one"), model("two"), "one thread or two");
    let (code, text, _) = call(dir, &["dataset", "info", "one/self/round-1", "--json"]);
    let info: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(code, 0);
    assert!(text.contains("330"), "3 tasks of 110 frames: {info}");
    let (code, _, _) =
        call(dir, &tiny(&["--set", "steps=4", "--evaluations", "0", "--out", "off"]));
    assert_eq!(code, 0);
    assert_ne!(model("one"), model("off"), "what was reached was learned from");
}

#[test]
fn options_of_a_network_are_refused_elsewhere() {
    let eval = |policy: &str| {
        robert().args(["eval", "--robot", "ur5e", "--suite", "manual", "--policy", policy])
    };
    assert!(eval("pd+ensemble=3").fails(2).stderr.contains("robert"));
    assert!(eval("robert:x+ensemble=40").fails(2).stderr.contains("1 to 21"));
    assert!(eval("robert:x+ahead=0+guide").fails(2).stderr.contains("ahead takes 1 to 20"));
    assert!(eval("robert:x+sample+mean").fails(2).stderr.contains("exclude each other"));
    assert!(eval("pd+ahead=2").fails(2).stderr.contains("only for robert"));
    assert!(eval("robert:x+observer=101").fails(2).stderr.contains("0 to 100 percent"));
    assert!(eval("pd+observer=30").fails(2).stderr.contains("only for robert and ridge"));
    assert!(eval("pd+sampel").fails(2).stderr.contains("+sample"));
    assert!(eval("robert:x+foo").fails(2).stderr.contains("+sample"));
    assert!(
        eval("robert:x+sample+ahead=2+ensemble=3+guide").fails(3).stderr.contains("no model x")
    );
}

/// A run of a tiny network, with this environment.
fn on(dir: &Path, environment: [(&str, &str); 2], args: &[&str]) -> (Option<i32>, String, String) {
    let train = ["train", "--robot", "pointmass", "--data", "data", "--evaluations", "2"];
    with(dir, environment, &[&train[..], args].concat())
}

/// The program with this environment.
fn with(
    dir: &Path,
    environment: [(&str, &str); 2],
    args: &[&str],
) -> (Option<i32>, String, String) {
    let ran =
        Command::new(binary()).current_dir(dir).envs(environment).args(args).output().unwrap();
    let text = |x: &[u8]| String::from_utf8_lossy(x).into_owned();
    (ran.status.code(), text(&ran.stdout), text(&ran.stderr))
}

/// Evaluates the best model of a run on a short clip: the report, and what was said.
fn evaluated(
    dir: &Path,
    environment: [(&str, &str); 2],
    run: &str,
    more: &[&str],
) -> (serde_json::Value, String) {
    let key = |frame, x| format!("{{\"frame\": {frame}, \"q\": [{x}, 0]}}");
    let clip = format!(
        "{{\"format\": \"robert-clip/1\", \"robot\": {{\"id\": \"pointmass\", \"joints\": [\"x\", \"y\"], \"units\": [\"m\", \"m\"]}}, \"fps\": 20, \"length\": 31, \"fill\": \"linear\", \"keys\": [{}, {}]}}",
        key(0, 0.0),
        key(30, 0.2)
    );
    std::fs::write(dir.join("a.clip.json"), clip).unwrap();
    let policy = format!("robert:{run}");
    let args =
        ["eval", "--suite", "a.clip.json", "--policy", &policy, "--seeds", "5", "--no-floor"];
    let (code, stdout, stderr) = with(dir, environment, &[&args[..], &["--json"], more].concat());
    assert_eq!(code, Some(0), "{stderr}");
    (serde_json::from_str(&stdout).unwrap(), stderr)
}

#[test]
fn a_graphics_card_trains_and_the_processor_goes_on() {
    let dir = tempfile::tempdir().unwrap();
    let at = dir.path();
    collect(at);
    let set =
        |steps| ["--set", steps, "--set", "layers=1", "--set", "width=32", "--set", "batch=16"];
    let software = [("ROBERT_GPU", "software"), ("ROBERT_NOTHING", "")];
    let both = |out, device| {
        let head = ["--out", out, "--device", device, "--json"];
        [&head[..], &set("steps=12")].concat()
    };
    let (code, stdout, stderr) = on(at, software, &both("card", "gpu"));
    assert_eq!(code, Some(0), "{stderr}");
    let found = robert::gpu::cards(true);
    let Some(card) = found.first() else {
        // Without any driver it says so, and trains.
        assert!(stderr.contains("training on the processor"), "{stderr}");
        println!("skipped: this machine has no software driver");
        return;
    };
    let report: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(report["result"]["device"], card.name.as_str());
    assert_eq!(report["result"]["step"], 12);
    assert!(stderr.contains(&card.name) && stderr.contains("MiB"), "{stderr}");

    // The same run on the processor: nearly the same weights.
    let (code, stdout, stderr) = on(at, software, &both("processor", "cpu"));
    assert_eq!(code, Some(0), "{stderr}");
    assert!(
        serde_json::from_str::<serde_json::Value>(&stdout).unwrap()["result"]["device"].is_null()
    );
    let weights = |run: &str| {
        let path = at.join(run).join("ckpt/last.safetensors");
        robert::net::checkpoint::load(&path, None).unwrap().net.weights.to_vec()
    };
    let (a, b) = (weights("card"), weights("processor"));
    let norm = |x: &mut dyn Iterator<Item = f32>| x.map(|x| f64::from(x * x)).sum::<f64>().sqrt();
    let off = norm(&mut a.iter().zip(&b).map(|(a, b)| a - b));
    assert!(off < 1e-3 * norm(&mut b.iter().copied()), "{off}");

    // The rollouts of an evaluation compute together, with nearly the processor's figures.
    let figure = |report: &serde_json::Value| report["results"][0]["precision_mean"].as_f64();
    let of = |more: &[&str]| evaluated(at, software, "card/model.safetensors", more).0;
    let (cpu, gpu, one) =
        (of(&[]), of(&["--device", "gpu"]), of(&["--device", "gpu", "--threads", "1"]));
    assert!(cpu["device"].is_null() && gpu["device"] == card.name.as_str());
    let (a, b) = (figure(&cpu).unwrap(), figure(&gpu).unwrap());
    assert!(a != b && (a - b).abs() < 1e-4 * a, "{a} {b}");
    assert_eq!(figure(&gpu), figure(&one), "alone or together");
    let bad =
        ["eval", "--robot", "pointmass", "--suite", "manual", "-p", "pd", "--device", "gpu:9"];
    let (code, _, stderr) = with(at, software, &bad);
    assert!(code == Some(2) && stderr.contains("gpu:0"), "{stderr}");

    // The points of a sweep train there as well, each in a process of its own.
    let two = SWEEP.replace(", \"cl-uniform\"", "").replace("[0.0, 0.5]", "[0.0]");
    std::fs::write(at.join("s.toml"), two).unwrap();
    let args = ["sweep", "s.toml", "--out", "sweep", "--jobs", "2", "--device", "gpu", "-q"];
    let (code, _, stderr) = with(at, software, &args);
    assert_eq!(code, Some(0), "{stderr}");
    let meta = at.join("sweep/points/corrupt-0_mask-none/seed-1/meta.json");
    let meta = std::fs::read_to_string(meta).unwrap();
    assert!(meta.contains(&card.name), "{meta}");

    // Resuming on the other device says that the last bits differ.
    for (run, device) in [("card", "cpu"), ("processor", "gpu")] {
        let (code, _, stderr) = on(at, software, &["--resume", run, "--device", device]);
        assert_eq!(code, Some(0), "{stderr}");
        assert!(stderr.contains("last bits differ"), "{stderr}");
    }
}

#[test]
fn without_a_graphics_card_the_processor_trains_and_says_why() {
    let dir = tempfile::tempdir().unwrap();
    collect(dir.path());
    // No driver can be loaded.
    let none = [("VK_ICD_FILENAMES", "/nowhere.json"), ("VK_DRIVER_FILES", "/nowhere.json")];
    for device in ["auto", "gpu"] {
        let args = ["--out", device, "--device", device, "--set", "steps=2", "--set", "batch=4"];
        let (code, _, stderr) = on(dir.path(), none, &args);
        assert_eq!(code, Some(0), "{stderr}");
        let lines = stderr.lines().filter(|l| l.contains("training on the processor")).count();
        assert_eq!(lines, 1, "{stderr}");
        let (with_cpu, _) = evaluated(dir.path(), none, "auto", &[]);
        let (report, stderr) = evaluated(dir.path(), none, "auto", &["--device", device]);
        assert_eq!(
            report["results"][0]["precision_mean"],
            with_cpu["results"][0]["precision_mean"]
        );
        let lines = stderr.lines().filter(|l| l.contains("the processor performs")).count();
        assert_eq!(lines, 1, "{stderr}");
    }
    let ran = robert().args(["train", "--robot", "pointmass", "--data", "x", "--device", "cuda"]);
    assert!(ran.fails(2).stderr.contains("gpu:N"));
}
