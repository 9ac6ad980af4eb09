//! Policies that need no training, through the binary: from noise to a table.

use std::path::Path;

use crate::run::{call, robert};

fn json(dir: &Path, args: &[&str]) -> serde_json::Value {
    let (code, out, err) = call(dir, args);
    assert_eq!(code, 0, "{args:?}: {err}");
    serde_json::from_str(&out).unwrap_or_else(|e| panic!("{e}: {out}"))
}

/// Precision of a policy over a suite, from the report of an evaluation.
fn precision(report: &serde_json::Value, suite: &str, policy: &str) -> f64 {
    let results = report["results"].as_array().unwrap();
    let found = results.iter().find(|r| r["suite"] == suite && r["policy"] == policy);
    found.unwrap_or_else(|| panic!("{policy} on {suite}"))["precision_mean"].as_f64().unwrap()
}

#[test]
fn noise_makes_three_policies_that_perform() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let collect = ["collect", "--robot", "pointmass", "--transitions", "30000", "--out", "d", "-q"];
    assert_eq!(call(dir, &collect).0, 0);
    for policy in ["ridge", "nearest", "mlp-inverse"] {
        let args = ["fit", policy, "--data", "d", "--json", "--robot", "pointmass"];
        let mut args = args.to_vec();
        match policy {
            "mlp-inverse" => args.extend(["--steps", "400", "--width", "24"]),
            "nearest" => args.extend(["--frames", "10000"]),
            _ => {}
        }
        let report = json(dir, &args);
        let file = dir.join(report["out"].as_str().unwrap());
        assert_eq!(report["policy"], policy);
        assert!(report["held_out"][0].as_f64().unwrap() < 0.6, "{report}");
        if policy != "ridge" {
            args.extend(["--out", "again"]);
            json(dir, &args);
            let read = |path: &Path| std::fs::read(path).unwrap();
            assert!(read(&file) == read(&dir.join("again")), "{policy} has other bits");
        }
    }

    let policies = "zero,ridge:d,nearest:d,mlp-inverse:d,ridge:d+guide,mlp-inverse:d+guide";
    let args = ["eval", "--robot", "pointmass", "--suite", "manual,test", "--data", "d"];
    let mut args = args.to_vec();
    args.extend(["--cases", "2", "--policy", policies, "--json", "-q"]);
    let report = json(dir, &args);
    let manual = |policy| precision(&report, "manual", policy);
    assert!(manual("ridge") < 0.001, "{}", manual("ridge"));
    for policy in ["nearest", "mlp-inverse", "mlp-inverse+guide"] {
        assert!(manual(policy) < 0.2 * manual("zero"), "{policy}: {}", manual(policy));
    }
    for suite in ["test", "test_low_mask", "test_high_mask"] {
        assert!(precision(&report, suite, "ridge") < 0.2 * precision(&report, suite, "zero"));
    }
    let high = report["results"].as_array().unwrap();
    let high = high.iter().find(|r| r["suite"] == "test_high_mask").unwrap();
    assert!(high["tasks"][0]["masked_mae"].as_f64().is_some(), "the truth behind masks is known");

    // The lookup needs no fit, and a folder is hashed as the file that is read in it.
    std::fs::remove_file(dir.join("d/nearest.safetensors")).unwrap();
    for policy in ["nearest:d", "ridge:d", "mlp-inverse:d/mlp-inverse.safetensors"] {
        let args = ["export", "circle", "-p", policy, "--to", "json", "-o", "-", "-q"];
        let take = json(dir, &args);
        assert_eq!(take["provenance"]["policy_sha256"].as_str().unwrap().len(), 64, "{policy}");
    }

    // Another robot's data, another policy's file, no file.
    let rollout = |policy: &str| {
        let (code, _, err) = call(dir, &["rollout", "reacher", "-p", policy]);
        (code, err)
    };
    for policy in ["ridge:d", "nearest:d", "mlp-inverse:d"] {
        let (code, err) = rollout(policy);
        assert_eq!(code, 3, "{policy}: {err}");
        assert!(err.contains("pointmass") && err.contains("ur5e"), "{err}");
    }
    let (code, err) = rollout("mlp-inverse:d/ridge.safetensors");
    assert!(code == 3 && err.contains("no card"), "{err}");
    let (code, err) = rollout("nearest:nowhere");
    assert!(code == 3 && err.contains("nowhere"), "{err}");
    // A packed model has an observer of its own.
    let pack = |percent: &str| {
        call(dir, &["models", "pack", "d", "-o", "packed.safetensors", "--observer", percent])
    };
    assert_eq!(pack("101").0, 2);
    assert_eq!(pack("30").0, 0);
    let card = json(dir, &["models", "show", "packed.safetensors", "--json"]);
    assert_eq!(card["observer"], 30);
    let (_, shown, _) = call(dir, &["models", "show", "packed.safetensors"]);
    assert!(shown.contains("30 %"), "{shown}");

    let (code, _, err) = call(dir, &["fit", "ridge", "--data", "d", "--robot", "ur5e"]);
    assert!(code == 3 && err.contains("pointmass"), "{err}");
}

#[test]
fn a_fit_names_what_it_lacks() {
    let ran = robert().args(["fit", "ridge", "--data", "nowhere"]).fails(3);
    assert!(ran.stderr.contains("nowhere"));
    let base = ["eval", "--robot", "pointmass", "--suite", "manual", "--policy"];
    for (policy, word) in [("nearest", "nearest:PATH"), ("mlp-inverse", "mlp-inverse:PATH")] {
        let ran = robert().args(base).args([policy]).fails(2);
        let maker = format!("robert fit {policy} --data");
        assert!(ran.stderr.contains(word) && ran.stderr.contains(&maker), "{}", ran.stderr);
    }
    let ran = robert()
        .args(["eval", "--robot", "pointmass", "--suite", "test", "--policy", "pd"])
        .fails(2);
    assert!(ran.stderr.contains("--data"));
}
