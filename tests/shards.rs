//! Shards through the binary: any order, kills, damage, foreign machines, queues.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use robert::fsio::sha256_hex;
use robert::rng::{Rng, Stream};
use serde_json::Value;

use crate::floors::files;
use crate::run::{binary, call};

/// A spec of these lines, as a file.
fn spec(dir: &Path, text: &str) -> PathBuf {
    let path = dir.join("spec.toml");
    std::fs::write(&path, text).unwrap();
    path
}

const COLLECT: &str =
    "kind = \"collect\"\nrobot = \"pointmass\"\ntransitions = 2_040\nshards = 20\n";
const EVAL: &str = "kind = \"eval\"\nrobot = \"pointmass\"\nsuites = [\"manual\"]\n\
                    policies = [\"zero\", \"pd\"]\nseeds = 2\nplant = \"mass=0.8..1.2\"\ntasks_per_shard = 5\n";

/// Plans into `dir/name`; the number of shards.
fn plan(dir: &Path, text: &str, name: &str) -> usize {
    let path = spec(dir, text);
    let (code, out, err) =
        call(dir, &["shard", "plan", path.to_str().unwrap(), "--out", name, "--json"]);
    assert_eq!(code, 0, "{err}");
    serde_json::from_str::<Value>(&out).unwrap()["shards"].as_u64().unwrap() as usize
}

fn ok(dir: &Path, args: &[&str]) -> String {
    let (code, out, err) = call(dir, args);
    assert_eq!(code, 0, "{args:?}: {err}{out}");
    out
}

fn status(dir: &Path, name: &str) -> Value {
    serde_json::from_str(&ok(dir, &["shard", "status", name, "--json"])).unwrap()
}

/// Paths and hashes of all files of a folder.
fn content(dir: &Path) -> BTreeMap<PathBuf, String> {
    let short = |p: &PathBuf| p.strip_prefix(dir).unwrap().to_owned();
    files(dir).iter().map(|p| (short(p), sha256_hex(&std::fs::read(p).unwrap()))).collect()
}

fn indices(value: &Value) -> Vec<u64> {
    value.as_array().unwrap().iter().map(|i| i.as_u64().unwrap()).collect()
}

/// The folder of a shard.
fn shard(dir: &Path, name: &str, index: usize) -> PathBuf {
    let start = format!("{index:06}-");
    let all = std::fs::read_dir(dir.join(name).join("shards")).unwrap();
    let named = |p: &PathBuf| p.file_name().unwrap().to_str().unwrap().starts_with(&start);
    all.map(|e| e.unwrap().path()).find(named).unwrap()
}

#[test]
fn any_order_and_any_number_of_processes_give_the_same_set() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    for (text, shards) in [(COLLECT, 20), (EVAL, 12)] {
        std::fs::remove_dir_all(dir.join("pool")).ok();
        std::fs::remove_dir_all(dir.join("hand")).ok();
        assert_eq!(plan(dir, text, "pool"), shards);
        plan(dir, text, "hand");
        ok(dir, &["shard", "submit", "pool", "--backend", "local", "--jobs", "2"]);
        let last = (shards - 1).to_string();
        ok(dir, &["shard", "run", "hand", "--index", &last]);
        ok(dir, &["shard", "run", "hand", "--index", "3", "--count", "4"]);
        let again = ok(dir, &["shard", "run", "hand", "--index", "5"]);
        assert!(again.contains("done before"), "{again}");
        ok(dir, &["shard", "run", "hand", "--index", "0", "--count", "1000", "--threads", "2"]);
        assert_eq!(indices(&status(dir, "hand")["done"]).len(), shards);
        for name in ["pool", "hand"] {
            ok(dir, &["shard", "merge", name, "--out", &format!("out-{name}")]);
        }
        assert_eq!(content(&dir.join("out-pool")), content(&dir.join("out-hand")));
    }
    // Two policies, 15 tasks, two seeds; the same means as `robert eval`.
    let merged: Value =
        serde_json::from_slice(&std::fs::read(dir.join("out-pool/results.json")).unwrap()).unwrap();
    let eval = ok(
        dir,
        &[
            "eval",
            "--robot",
            "pointmass",
            "--suite",
            "manual",
            "-p",
            "zero,pd",
            "--seeds",
            "2",
            "--plant",
            "mass=0.8..1.2",
            "--json",
        ],
    );
    let eval: Value = serde_json::from_str(&eval).unwrap();
    for i in 0..2 {
        let (a, b) = (&merged["results"][i], &eval["results"][i]);
        assert_eq!(a["policy"], b["policy"]);
        for field in ["precision_mean", "ci95"] {
            assert_eq!(a[field], b[field], "{field}");
            assert!(a[field].is_number());
        }
    }
    let rows = std::fs::read_to_string(dir.join("out-pool/rows.csv")).unwrap();
    assert_eq!(rows.lines().count(), 1 + 2 * 2 * 15);
}

/// End-effector goals in a folder of clips are solved, with the figures of `robert eval`.
#[test]
fn clips_with_end_effector_goals_are_evaluated() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let clip = include_str!("../examples/clips/square.clip.json");
    std::fs::create_dir(dir.join("mine")).unwrap();
    std::fs::write(dir.join("mine/square.clip.json"), clip).unwrap();
    let text = "kind = \"eval\"\nrobot = \"ur5e\"\nsuites = [\"mine\"]\npolicies = [\"pd+ilc\"]\n";
    assert_eq!(plan(dir, text, "work"), 1);
    ok(dir, &["shard", "run", "work", "--index", "0"]);
    let merged = ok(dir, &["shard", "merge", "work", "--out", "all", "--json"]);
    let merged: Value = serde_json::from_str(&merged).unwrap();
    let eval = ["eval", "--suite", "mine", "--policy", "pd+ilc", "--no-floor", "--json"];
    let eval: Value = serde_json::from_str(&ok(dir, &eval)).unwrap();
    let (ours, theirs) = (&merged["summary"][0], &eval["results"][0]);
    assert!(ours["precision_mean"].as_f64().unwrap() > 0.0);
    assert_eq!(ours["precision_mean"], theirs["precision_mean"]);
}

#[test]
fn a_merged_collection_is_a_dataset() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    plan(dir, COLLECT, "w");
    ok(dir, &["shard", "submit", "w", "--backend", "local", "--merge", "data"]);
    ok(dir, &["dataset", "check", "data"]);
    // The motion needs no second place, unless copies are asked for; both are the same set.
    ok(dir, &["shard", "merge", "w", "--out", "copies", "--copy"]);
    let names = |dir: &Path| {
        use std::os::unix::fs::MetadataExt;
        dir.join("shards/000007.safetensors").metadata().unwrap().nlink()
    };
    assert_eq!((names(&dir.join("data")), names(&dir.join("copies"))), (2, 1));
    let merged = |name: &str| std::fs::read(dir.join(name).join("merged.json")).unwrap();
    assert!(merged("data") == merged("copies"));
    let manifest = robert::dataset::Manifest::load(&dir.join("data")).unwrap();
    assert!(manifest.totals.frames >= 2_040 && manifest.shards.len() == 20);
    // A shard is what `robert collect` records with its seed.
    let collect = ["collect", "--robot", "pointmass", "--transitions", "102", "--out", "one"];
    ok(dir, &[&collect[..], &["--seed", "7"]].concat());
    let read = |path: PathBuf| std::fs::read_to_string(path.join("manifest.json")).unwrap();
    assert_eq!(read(shard(dir, "w", 7).join("data")), read(dir.join("one")));
}

#[test]
fn what_is_missing_or_damaged_is_named_and_run_again() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    plan(dir, EVAL, "w");
    ok(dir, &["shard", "submit", "w", "--backend", "local"]);
    ok(dir, &["shard", "merge", "w", "--out", "whole"]);
    // A flipped byte in a result and in a manifest, a file that is gone, a shard that is gone.
    let flip = |path: PathBuf| {
        let mut bytes = std::fs::read(&path).unwrap();
        let at = bytes.len() / 2;
        bytes[at] ^= 1;
        std::fs::write(&path, bytes).unwrap();
    };
    flip(shard(dir, "w", 2).join("rows.json"));
    flip(shard(dir, "w", 4).join("manifest.json"));
    std::fs::remove_file(shard(dir, "w", 6).join("rows.json")).unwrap();
    std::fs::remove_dir_all(shard(dir, "w", 7)).unwrap();
    let found = status(dir, "w");
    assert_eq!(indices(&found["corrupt"]), [2, 4, 6]);
    assert_eq!(indices(&found["missing"]), [7]);
    let (code, out, err) = call(dir, &["shard", "merge", "w", "--out", "again"]);
    assert_eq!(code, 4, "{err}");
    assert_eq!(out, "2 corrupt\n4 corrupt\n6 corrupt\n7 missing\n");
    assert!(err.contains("missing: 7") && err.contains("corrupt: 2 4 6"), "{err}");
    assert!(!dir.join("again").exists(), "a partial result got the final name");
    assert_eq!(ok(dir, &["shard", "missing", "w"]), "2\n4\n6\n7\n");
    let args = ["shard", "submit", "w", "--backend", "slurm", "--dry-run"];
    let script = ok(dir, &args);
    assert!(script.contains("--array=0-3%16"), "{script}");
    let sent = ok(dir, &["shard", "submit", "w", "--backend", "local"]);
    assert_eq!(sent, "4 shards done, 8 done before\n");
    ok(dir, &["shard", "merge", "w", "--out", "again"]);
    assert_eq!(content(&dir.join("whole")), content(&dir.join("again")));
    // A merge is replaced by a later one, and nothing else is.
    ok(dir, &["shard", "merge", "w", "--out", "again"]);
    std::fs::create_dir(dir.join("mine")).unwrap();
    std::fs::write(dir.join("mine/notes"), "").unwrap();
    assert_eq!(call(dir, &["shard", "merge", "w", "--out", "mine"]).0, 2);
}

#[test]
fn another_processor_and_another_build_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    plan(dir, EVAL, "w");
    ok(dir, &["shard", "run", "w", "--index", "0", "--count", "12"]);
    let path = dir.join("w/plan.json");
    let text = std::fs::read_to_string(&path).unwrap();
    let own: Value = serde_json::from_str(&text).unwrap();
    for (field, flag) in [("numerics", "--any-processor"), ("binary_sha256", "--any-build")] {
        let mut other = own.clone();
        other[field] = "another".into();
        std::fs::write(&path, other.to_string()).unwrap();
        let run = ["shard", "run", "w", "--index", "1"];
        let (code, _, err) = call(dir, &run);
        assert_eq!(code, 5, "{err}");
        assert!(err.contains(flag), "{err}");
        ok(dir, &[&run[..], &[flag]].concat());
        // It is whole, and not of the plan's kind; a merge wants it again, unless told otherwise.
        assert_eq!(indices(&status(dir, "w")["foreign"]), [1]);
        let (code, out, _) = call(dir, &["shard", "merge", "w", "--out", "m", "--json"]);
        assert_eq!(code, 4);
        let found: Value = serde_json::from_str(&out).unwrap();
        assert_eq!(indices(&found["foreign"]), [1]);
        ok(dir, &[&["shard", "run", "w", "--index", "0", "--count", "12"][..], &[flag]].concat());
        ok(dir, &["shard", "merge", "w", "--out", "m", flag]);
        std::fs::remove_dir_all(dir.join("m")).unwrap();
    }
}

#[test]
fn a_plan_for_avx2_has_equal_bits_on_wider_processors() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let text = "kind = \"eval\"\nrobot = \"pointmass\"\nsuites = [\"manual\"]\n\
                policies = [\"robert\"]\ntasks_per_shard = 3\n";
    let path = spec(dir, text);
    let args = ["shard", "plan", path.to_str().unwrap(), "--numerics", "avx2", "--out"];
    let (code, _, err) = call(dir, &[&args[..], &["forced"]].concat());
    if code == 5 {
        eprintln!("skipped: {err}");
        return;
    }
    ok(dir, &["shard", "run", "forced", "--index", "0"]);
    // A processor with AVX2 only, as far as this program can tell.
    let narrow = |args: &[&str]| {
        let mut command = Command::new(binary());
        let out = command.args(args).env("ROBERT_SIMD", "avx2").current_dir(dir).output().unwrap();
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    };
    narrow(&["shard", "plan", path.to_str().unwrap(), "--out", "narrow"]);
    narrow(&["shard", "run", "narrow", "--index", "0"]);
    let rows = |name: &str| std::fs::read(shard(dir, name, 0).join("rows.json")).unwrap();
    assert_eq!(rows("forced"), rows("narrow"));
    let kind = |name: &str| {
        let text = std::fs::read(dir.join(name).join("plan.json")).unwrap();
        serde_json::from_slice::<Value>(&text).unwrap()["numerics"].clone()
    };
    assert_eq!((kind("forced"), kind("narrow")), ("avx2".into(), "avx2".into()));
}

#[test]
fn every_mistake_in_a_spec_is_found_by_the_plan() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let sweep = std::fs::read_to_string(example("sweep")).unwrap();
    for (text, code, what) in [
        (EVAL.replace("\"pd\"", "\"dp\""), 2, "dp"),
        (EVAL.replace("\"pd\"", "\"robert:none.safetensors\""), 3, "none.safetensors"),
        (EVAL.replace("manual", "manuel"), 2, "manuel"),
        (EVAL.replace("seeds = 2", "seeds = 0"), 3, "seeds"),
        (EVAL.replace("seeds = 2", "seeds = 9_000_000_000_000_000_000"), 3, "shards; 1 to 100000"),
        (COLLECT.replace("shards = 20", "shards = 1_000_000_000"), 3, "shards = 1000000000"),
        (EVAL.replace("mass=0.8..1.2", "mess=1"), 2, "mess"),
        (EVAL.replace("seeds", "sedes"), 3, "spec.toml:5:1"),
        (COLLECT.replace("2_040", "1_000"), 3, "shard 0"),
        (COLLECT.replace("pointmass", "pointless"), 3, "pointless"),
        (sweep.replace("\"none\"]", "\"nun\"]"), 2, "mask=nun"),
        (sweep.replace("transitions = 4_000", "transitions = 60"), 3, "shard 0"),
        (sweep.replace("x = \"width\"", "x = \"height\""), 3, "[grid]"),
        (sweep.replace("[collect]", "[recording]"), 3, "recording"),
    ] {
        let path = spec(dir, &text);
        let args = ["shard", "plan", path.to_str().unwrap(), "--out", "w"];
        let (found, _, err) = call(dir, &args);
        assert!(err.contains(what), "{what}: {found} {err}");
        assert_eq!(found, code, "{what}: {err}");
        assert!(!dir.join("w/plan.json").exists(), "{what}: a plan was written");
    }
    assert_eq!(call(dir, &["shard", "status", "nowhere"]).0, 3);
    plan(dir, EVAL, "w");
    assert_eq!(call(dir, &["shard", "run", "w", "--index", "12"]).0, 2);
}

fn example(kind: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("examples/shards/{kind}.toml"))
}

#[test]
fn the_examples_of_training_run_and_merge() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    for (kind, shards) in [("sweep", 8), ("train", 4)] {
        let text = std::fs::read_to_string(example(kind)).unwrap();
        assert_eq!(plan(dir, &text, kind), shards);
        ok(dir, &["shard", "submit", kind, "--backend", "local", "-q"]);
        let out = format!("out-{kind}");
        ok(dir, &["shard", "merge", kind, "--out", &out]);
        let results = std::fs::read(dir.join(&out).join("results.json")).unwrap();
        let results: Value = serde_json::from_slice(&results).unwrap();
        let rows = results["rows"].as_array().unwrap();
        assert_eq!(rows.len(), if kind == "sweep" { 4 } else { 1 });
        let suites = rows[0]["suites"].as_object().unwrap();
        assert_eq!(suites.len(), 3);
        assert!(suites.values().all(|s| s["mean"].as_f64().unwrap() > 0.0), "{suites:?}");
        assert!(
            !dir.join(kind).join("checkpoints").read_dir().is_ok_and(|mut d| d.next().is_some())
        );
    }
    assert!(dir.join("out-sweep/points/mask-none_width-32/seed-1/model.safetensors").exists());
    assert!(dir.join("out-sweep/sweep.svg").exists());
    assert!(dir.join("out-train/points/seed-3/model.safetensors").exists());
}

/// One tiny run that takes about a second.
const TRAIN: &str = "kind = \"train\"\nrobot = \"pointmass\"\npreset = \"pm-tiny\"\nseeds = [5]\n\
                     suites = [\"test\"]\ncases = 2\n[set]\nsteps = 1200\nbatch = 8\nlayers = 1\nwidth = 16\nheads = 1\n[collect]\ntransitions = 4_000\n";

/// Starts a shard.
fn start(dir: &Path, name: &str, index: &str) -> std::process::Child {
    Command::new(binary())
        .args(["shard", "run", name, "--index", index, "--threads", "1"])
        .args(["--checkpoint-mins", "0.001"])
        .current_dir(dir)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

fn signal(child: &std::process::Child, signal: rustix::process::Signal) {
    rustix::process::kill_process(rustix::process::Pid::from_child(child), signal).unwrap();
}

#[test]
fn a_warned_training_shard_goes_on_from_its_checkpoint_with_the_same_bits() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    plan(dir, TRAIN, "whole");
    plan(dir, TRAIN, "cut");
    ok(dir, &["shard", "run", "whole", "--index", "0"]);
    let saved = || dir.join("cut/checkpoints").read_dir().is_ok_and(|mut d| d.next().is_some());
    let mut warned = 0;
    for kind in [rustix::process::Signal::USR1, rustix::process::Signal::TERM] {
        let mut child = start(dir, "cut", "0");
        while !saved() && child.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_millis(5));
        }
        std::thread::sleep(Duration::from_millis(100));
        if child.try_wait().unwrap().is_none() {
            signal(&child, kind);
            let status = child.wait().unwrap();
            warned += i32::from(status.code() == Some(130));
            assert!([Some(130), Some(0)].contains(&status.code()), "{status}");
        }
    }
    assert!(warned > 0, "the run ended before it was warned");
    assert!(saved());
    ok(dir, &["shard", "run", "cut", "--index", "0"]);
    assert_eq!(content(&shard(dir, "whole", 0)), content(&shard(dir, "cut", 0)));
}

#[test]
fn a_checkpoint_that_cannot_be_copied_does_not_cost_the_training() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    plan(dir, TRAIN, "whole");
    plan(dir, TRAIN, "full");
    ok(dir, &["shard", "run", "whole", "--index", "0"]);
    // A file in the place of the folder refuses every copy, as a full disk would.
    std::fs::write(dir.join("full/checkpoints"), "").unwrap();
    let ran = Command::new(binary())
        .args(["shard", "run", "full", "--index", "0", "--checkpoint-mins", "0.001"])
        .current_dir(dir)
        .output()
        .unwrap();
    let stderr = String::from_utf8_lossy(&ran.stderr);
    assert!(ran.status.success() && stderr.contains("a checkpoint was not copied"), "{stderr}");
    assert_eq!(content(&shard(dir, "whole", 0)), content(&shard(dir, "full", 0)));
}

/// Kills in a test run; `ROBERT_KILLS=30` for the long one.
fn kills() -> u64 {
    std::env::var("ROBERT_KILLS").ok().and_then(|k| k.parse().ok()).unwrap_or(5)
}

#[test]
fn kills_leave_nothing_partial_and_two_at_once_do_no_harm() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    plan(dir, TRAIN, "whole");
    ok(dir, &["shard", "run", "whole", "--index", "0"]);
    ok(dir, &["shard", "merge", "whole", "--out", "out-whole"]);
    plan(dir, TRAIN, "cut");
    let mut rng = Rng::new(1, Stream::Test, 23);
    let mut landed = 0;
    for _ in 0..20 * kills() {
        // Two processes of one shard, killed at different times.
        let mut both = [start(dir, "cut", "0"), start(dir, "cut", "0")];
        for child in &mut both {
            std::thread::sleep(Duration::from_secs_f64(0.05 + 0.25 * rng.uniform()));
            landed += u64::from(child.try_wait().unwrap().is_none());
            child.kill().ok();
            child.wait().unwrap();
        }
        let found = status(dir, "cut");
        assert!(indices(&found["corrupt"]).is_empty(), "{found}");
        if !indices(&found["done"]).is_empty() {
            std::fs::remove_dir_all(shard(dir, "cut", 0)).unwrap();
        }
        if landed >= kills() {
            break;
        }
    }
    assert!(landed >= kills());
    let mut both = [start(dir, "cut", "0"), start(dir, "cut", "0")];
    for child in &mut both {
        assert!(child.wait().unwrap().success());
    }
    ok(dir, &["shard", "merge", "cut", "--out", "out-cut"]);
    assert_eq!(content(&dir.join("out-whole")), content(&dir.join("out-cut")));
    let left = std::fs::read_dir(dir.join("cut/shards")).unwrap().count();
    assert_eq!(left, 1, "temporary folders of dead processes stay");
}

/// Replaces what depends on the machine.
fn plain(text: &str, dir: &Path) -> String {
    let real = dir.canonicalize().unwrap();
    let text = text.replace(real.to_str().unwrap(), "/DIR").replace(dir.to_str().unwrap(), "/DIR");
    text.replace(binary().to_str().unwrap(), "robert")
}

/// Compares with a golden file; `ROBERT_BLESS=1` writes it.
fn golden(name: &str, text: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name);
    if std::env::var_os("ROBERT_BLESS").is_some() {
        std::fs::write(&path, text).unwrap();
    }
    assert_eq!(text, std::fs::read_to_string(&path).unwrap(), "{name}");
}

#[test]
fn the_scripts_for_clusters_are_the_golden_ones() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    plan(dir, COLLECT, "w");
    let plan_kind = {
        let text = std::fs::read(dir.join("w/plan.json")).unwrap();
        serde_json::from_slice::<Value>(&text).unwrap()["numerics"].as_str().unwrap().to_owned()
    };
    let base = ["shard", "submit", "w", "--backend"];
    // 20 shards in packs of three are seven tasks, and a site with four indices needs two arrays.
    let slurm = [
        "slurm",
        "--dry-run",
        "--pack",
        "3",
        "--limit",
        "2",
        "--max-array",
        "4",
        "--merge",
        "out",
        "--",
        "--partition=short",
    ];
    let text = plain(&ok(dir, &[&base[..], &slurm].concat()), dir);
    let lines = ok(dir, &[&["--jsonl"], &base[..], &slurm].concat());
    assert!(!lines.contains("--json"), "an option of this program went to sbatch: {lines}");
    golden("shards.sbatch", &text.replace(&plan_kind, "KIND"));
    let list = files(&dir.join("w/submit"));
    assert_eq!(list.len(), 1, "a dry run sends nothing: {list:?}");
    let lines = std::fs::read_to_string(&list[0]).unwrap();
    assert_eq!(lines, "0-2\n3-5\n6-8\n9-11\n12-14\n15-17\n18-19\n");
    let pods = ["kubernetes", "--image", "robert:1", "--claim", "work", "--pack", "4"];
    golden("shards.yaml", &ok(dir, &[&base[..], &pods].concat()));
    let other = ok(dir, &[&base[..], &pods, &["--any-build"]].concat());
    assert!(other.contains("--threads 1 --any-build\n"), "{other}");
    // A task of the list, as the queue would call it.
    let tasks = list[0].to_str().unwrap();
    let out = ok(dir, &["shard", "run", "w", "--tasks", tasks, "--task", "6"]);
    assert_eq!(out, "shard 18: done\nshard 19: done\n");
    assert_eq!(call(dir, &["shard", "run", "w", "--tasks", tasks, "--task", "7"]).0, 3);
}

#[test]
fn an_option_that_a_backend_does_not_have_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    plan(dir, EVAL, "w");
    for (backend, options) in [
        ("kubernetes", "--jobs=2 --time=1:00 --warn=60 --merge=out --max-array=9 --json"),
        ("local", "--pack=2 --limit=2 --mem=1G --time=1:00 --image=a --claim=b --dry-run"),
        ("slurm", "--jobs=2 --image=a --claim=b"),
    ] {
        for option in options.split(' ') {
            let (code, _, err) = call(dir, &["shard", "submit", "w", "--backend", backend, option]);
            let flag = option.split('=').next().unwrap();
            assert!(err.contains(flag) && err.contains("only for"), "{backend} {option}: {err}");
            assert_eq!(code, 2, "{backend} {option}");
        }
    }
    let sbatch = ["shard", "submit", "w", "--backend", "local", "--", "--partition=short"];
    assert_eq!(call(dir, &sbatch).0, 2);
    assert_eq!(indices(&status(dir, "w")["missing"]).len(), 12);
}

/// No queue is asked when every shard is done.
#[test]
fn repeating_a_submission_to_slurm_merges_what_is_done() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    plan(dir, EVAL, "w");
    ok(dir, &["shard", "run", "w", "--index", "0", "--count", "12"]);
    let submit = ["shard", "submit", "w", "--backend", "slurm", "--merge", "out"];
    assert_eq!(ok(dir, &[&submit[..], &["--dry-run"]].concat()), "");
    assert!(!dir.join("out").exists());
    assert_eq!(ok(dir, &submit), "0 shards done, 12 done before\n");
    assert!(dir.join("out/merged.json").is_file());
    let report = ok(dir, &[&submit[..], &["--json"]].concat());
    let report: Value = serde_json::from_str(&report).unwrap();
    assert_eq!(report, serde_json::json!({ "done": 0, "done_before": 12 }));
}

#[test]
fn gnu_parallel_runs_what_is_missing() {
    if Command::new("parallel").arg("--version").output().is_err() {
        eprintln!("skipped: GNU parallel is not installed (apt-get install parallel)");
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    plan(dir, EVAL, "w");
    let line =
        "\"$0\" shard missing w | parallel -j2 --joblog log.tsv \"$0\" shard run w --index {}";
    let status = Command::new("bash").args(["-c", line]).arg(binary()).current_dir(dir).output();
    let status = status.unwrap();
    assert!(status.status.success(), "{}", String::from_utf8_lossy(&status.stderr));
    assert_eq!(indices(&self::status(dir, "w")["done"]).len(), 12);
}
