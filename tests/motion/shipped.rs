//! The trained policies in the program still do what their cards say. A change to features,
//! masks or the robots that moves these figures has broken every model ever trained.

use crate::run::robert;

/// The default policy of each robot on one of its tasks; the limit is what was measured and
/// a little.
#[test]
fn shipped_policies_perform_as_measured() {
    for (task, limit) in [("ur5e/swing", 0.0006), ("shadow_hand/four", 0.0005)] {
        let ran = robert().args(["rollout", task, "--json"]).run();
        assert_eq!(ran.code, 0, "{task}: {}", ran.stderr);
        let got: serde_json::Value = serde_json::from_str(&ran.stdout).unwrap();
        let precision = got["precision"].as_f64().unwrap();
        assert!(precision < limit, "{task}: {precision}");
        assert!(ran.stderr.contains("robert") || got["policy"] == "robert", "{task}: {got}");
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
    let asked: Vec<_> =
        rows.iter().filter(|r| r["robot"] == "ur5e").map(|r| &r["policy"]).collect();
    assert_eq!(asked, ["robert:adaptive+guide", "robert:faithful", "robert"]);
    let ran = robert().args(["rollout", "ur5e/swing", "--policy", "robert:nobody"]).run();
    assert_eq!(ran.code, 3, "{}", ran.stderr);
    assert!(ran.stderr.contains("nobody"), "{}", ran.stderr);
}
