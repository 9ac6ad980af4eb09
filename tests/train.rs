//! Training and its benchmarks through the binary.

use crate::run::robert;

#[test]
fn settings_that_do_not_exist_are_named() {
    let base = ["train", "--robot", "pointmass", "--data", "nowhere"];
    let ran = robert().args(base).args(["--preset", "huge"]).fails(2);
    assert!(ran.stderr.contains("huge") && ran.stderr.contains("ur-small"));
    let ran = robert().args(base).args(["--set", "learning_rate=1"]).fails(2);
    assert!(ran.stderr.contains("learning_rate") && ran.stderr.contains("weight_decay"));
    let ran = robert().args(base).args(["--set", "skip=gated", "--set", "lr=fast"]).fails(2);
    assert!(ran.stderr.contains("lr=fast"));
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
    assert!(eval("robert").fails(5).stderr.contains("robert:PATH"));
}

#[test]
fn reference_files_cover_every_variant() {
    let ran = robert().args(["bench", "reference", "--out", "ref"]).succeeds();
    assert_eq!(ran.stdout.lines().count(), 16);
    assert!(ran.path("ref/k10-skip_off-replace-all.safetensors").exists());
}

#[test]
fn bench_infer_reports_json() {
    let args = ["bench", "infer", "--size", "s", "--secs", "0.2", "--json"];
    let report = robert().args(args).succeeds().json();
    assert_eq!(report["sizes"][0]["size"], "S");
    assert!(report["sizes"][0]["ms"].as_f64().unwrap() > 0.0);
    assert!(report["peak_gflops"].as_f64().unwrap() > 0.0);
}
