//! The trained policies in the program still do what their cards say. A change to features,
//! masks or the robots that moves these figures has broken every model ever trained.

use serde_json::Value;

use crate::run::robert;

/// Every model, as `robert models ls` says it is used, on two of its tasks: the first of `manual`
/// and the last of `extra`. Its figures are those of results/ROBOT.json; the limit is 1.5 times
/// them, which leaves room for another processor and for nothing worse.
#[test]
fn shipped_models_perform_as_measured() {
    let listed = robert().args(["models", "ls", "--json"]).succeeds().json();
    for model in listed.as_array().unwrap() {
        let name = |key: &str| model[key].as_str().unwrap();
        let (id, policy) = (name("robot"), name("policy"));
        let file = format!("{}/results/{id}.json", env!("CARGO_MANIFEST_DIR"));
        let measured: Value = serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap();
        for (suite, last) in [("manual", false), ("extra", true)] {
            let suite = &measured["suites"][suite];
            let tasks = suite["tasks"].as_array().unwrap();
            let figures = suite["policies"][policy]["tasks"].as_array();
            let figures = figures.unwrap_or_else(|| panic!("{id}: {policy} was not measured"));
            let at = if last { tasks.len() - 1 } else { 0 };
            let (task, figure) = (tasks[at].as_str().unwrap(), figures[at][0].as_f64().unwrap());
            let clip = format!("{}/{task}", id.trim_end_matches("_light"));
            let args = ["rollout", &clip, "--robot", id, "--policy", policy, "--json"];
            let got = robert().args(args).succeeds().json();
            let precision = got["precision"].as_f64().unwrap();
            assert!(
                precision < 1.5 * figure + 1e-5,
                "{id} {policy} {task}: {precision}, was {figure}"
            );
            assert!(precision > 0.0, "{id} {policy} {task}");
        }
    }
}

#[test]
fn models_are_listed_shown_and_named() {
    let ran = robert().args(["models", "ls", "--json"]).run();
    assert_eq!(ran.code, 0, "{}", ran.stderr);
    let rows: Vec<serde_json::Value> = serde_json::from_str(&ran.stdout).unwrap();
    let of = |robot: &str| rows.iter().find(|r| r["robot"] == robot && r["default"] == true);
    for robot in ["ur5e", "shadow_hand"] {
        let row = of(robot).unwrap_or_else(|| panic!("no model of {robot}"));
        assert!(row["bytes"].as_u64().unwrap() < 25_000_000);
        let shown = robert().args(["models", "show", &format!("{robot}/robert")]).run();
        assert!(shown.stdout.contains("seed"), "{}", shown.stdout);
    }
    for row in &rows {
        let agents = row["data"]["agents"].as_object().unwrap();
        assert!(!agents.is_empty() && agents.values().all(|n| n.as_u64() > Some(100_000)), "{row}");
        assert_eq!(row["data"]["sha256"].as_str().unwrap().len(), 64, "{row}");
    }
    let asked: Vec<_> =
        rows.iter().filter(|r| r["robot"] == "ur5e").map(|r| &r["policy"]).collect();
    assert_eq!(asked, ["robert:adaptive+guide", "robert:faithful", "robert"]);
    let ran = robert().args(["rollout", "ur5e/swing", "--policy", "robert:nobody"]).run();
    assert_eq!(ran.code, 3, "{}", ran.stderr);
    assert!(ran.stderr.contains("nobody"), "{}", ran.stderr);
}
