//! A plant that no simulation survives: an arm of a hundredth of its mass and damping, with motors a
//! hundred times as strong. Whoever acts on it, the frame is named, and no number that is none
//! reaches a result.

use robert::explore::AgentKind;
use robert::rollout::PolicyName;

use crate::run::robert;

const PLANT: &str = "mass=0.01,damping=0.01,gear=100";

#[test]
fn every_policy_ends_with_the_frame_at_which_the_simulation_diverged() {
    let mut diverged = 0;
    for name in PolicyName::all().map(PolicyName::as_str) {
        if ["nearest", "mlp-inverse"].contains(&name) {
            continue; // They need a fit.
        }
        let ran = robert()
            .args(["rollout", "ur5e/reacher", "-p", name, "--plant", PLANT, "--json"])
            .run();
        if ran.code == 0 {
            let precision = ran.json()["precision"].as_f64();
            assert!(precision.is_some_and(f64::is_finite), "{name}: {precision:?}");
            continue;
        }
        assert_eq!(ran.code, 1, "{name}: {}", ran.stderr);
        let told = ran.stderr.lines().find(|l| l.starts_with("error: frame ")).unwrap_or_default();
        assert!(told.contains("the simulation diverged at"), "{name}: {}", ran.stderr);
        assert!(ran.stdout.is_empty(), "{name}: {}", ran.stdout);
        diverged += 1;
    }
    assert!(diverged >= 5, "{diverged}");
}

#[test]
fn every_collector_says_that_the_robot_does_not_last() {
    let plants = "mass=0.01..0.01,damping=0.01..0.01,gear=100..100";
    for kind in AgentKind::ALL {
        let ran = robert()
            .args(["collect", "--robot", "ur5e", "--agent", kind.name(), "--transitions", "2000"])
            .args(["--agent-steps", "100", "--plants", plants, "--out", "data"])
            .fails(1);
        assert!(ran.stderr.contains("implausible states"), "{}: {}", kind.name(), ran.stderr);
        let made = std::fs::read_dir(ran.path("data/shards")).map_or(0, Iterator::count);
        assert_eq!(made, 0, "{}", kind.name());
    }
}
