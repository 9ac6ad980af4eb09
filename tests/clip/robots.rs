//! `robert clip check` on every robot in the program: each rule fires where it should, names
//! a line of the file, and its fix fixes it.

use std::fs;

use robert::clip::{Clip, Key};
use robert::robot::Robot;
use robert::rollout::ClipFacts as _;
use serde_json::Value;

use crate::run::call;

struct Bench {
    dir: tempfile::TempDir,
    robot: Robot,
}

impl Bench {
    fn new(id: &str) -> Bench {
        Bench { dir: tempfile::tempdir().unwrap(), robot: Robot::builtin(id).unwrap() }
    }

    fn robert(&self, args: &[&str]) -> (i32, String, String) {
        call(self.dir.path(), args)
    }

    /// Home, changed at some joints.
    fn pose(&self, changes: &[(usize, f64)]) -> Vec<f64> {
        let mut q = self.robot.home();
        for (j, v) in changes {
            q[*j] = *v;
        }
        q
    }

    /// Keys of (frame, hold, pose) as a file.
    fn write(&self, length: u32, keys: &[(u32, u32, Vec<f64>)]) {
        let mut clip = Clip::new(self.robot.clip_ref(), length);
        clip.keys = keys.iter().map(|(f, hold, q)| Key::new(*f, q).held(*hold)).collect();
        fs::write(self.dir.path().join("a.clip.json"), clip.to_text()).unwrap();
    }

    fn lints(&self, more: &[&str]) -> Vec<Value> {
        let (code, out, err) =
            self.robert(&[&["clip", "check", "--json", "a.clip.json"], more].concat());
        assert!(code == 0 || code == 4, "{code}: {err}");
        let report: Value = serde_json::from_str(&out).unwrap();
        report["files"][0]["lints"].as_array().unwrap().clone()
    }

    fn of(&self, rule: &str, more: &[&str]) -> Vec<Value> {
        self.lints(more).into_iter().filter(|l| l["rule"] == rule).collect()
    }

    /// The rule finds something on the line with `on` in it, and carrying out the first
    /// fix, again and again, ends it.
    fn fires_and_is_fixed(&self, rule: &str, on: &str, more: &[&str]) {
        let id = self.robot.id();
        let mut found = self.of(rule, more);
        assert!(!found.is_empty(), "{id}: {rule} was not found");
        let text = fs::read_to_string(self.dir.path().join("a.clip.json")).unwrap();
        let line = found[0]["line"].as_u64().unwrap() as usize;
        let said = text.lines().nth(line - 1).unwrap();
        assert!(said.contains(on), "{id} {rule}: line {line} is {said}");
        let col = found[0]["col"].as_u64().unwrap() as usize;
        assert!(col >= 1 && col <= said.chars().count(), "{id} {rule}: column {col} of {said}");
        for _ in 0..20 {
            let Some(first) = found.first() else { return };
            let fix = &first["mends"][0]["op"];
            assert!(fix.is_object(), "{id} {rule}: no fix: {first}");
            fs::write(self.dir.path().join("fix.json"), fix.to_string()).unwrap();
            let (code, _, err) = self.robert(&["clip", "apply", "a.clip.json", "fix.json", "-i"]);
            assert_eq!(code, 0, "{id} {rule}: {err}");
            found = self.of(rule, more);
        }
        panic!("{id} {rule}: still there after twenty fixes: {}", found[0]);
    }
}

#[test]
fn speeds_limits_and_blind_spans_on_every_robot() {
    for id in Robot::builtin_ids() {
        let b = Bench::new(id);
        let home = b.robot.home();
        // The joint with the longest way for its speed.
        let ways = b.robot.joints().iter().zip(&home).map(|(j, h)| {
            let far = match j.unbounded {
                true => h + 5.0,
                false if h - j.range[0] > j.range[1] - h => j.range[0],
                false => j.range[1],
            };
            (far, (far - h).abs() / j.speed_limit)
        });
        let (k, (far, _)) = ways.enumerate().max_by(|(_, a), (_, b)| a.1.total_cmp(&b.1)).unwrap();
        let joint = &b.robot.joints()[k];
        // Across in a tenth of a second.
        b.write(40, &[(0, 10, b.pose(&[])), (11, 29, b.pose(&[(k, far)]))]);
        b.fires_and_is_fixed("joint-speed", "\"frame\": 11", &[]);
        b.write(61, &[(0, 1, b.pose(&[])), (60, 1, b.pose(&[]))]);
        b.fires_and_is_fixed("blind-span", "\"frame\": 60", &[]);
        if !joint.unbounded {
            b.write(20, &[(0, 20, b.pose(&[(k, joint.range[1] + 0.2)]))]);
            b.fires_and_is_fixed("joint-limit", "\"frame\": 0", &[]);
            assert_eq!(b.robert(&["clip", "check", "a.clip.json"]).0, 0);
        }
    }
}

#[test]
fn poses_are_judged_in_simulation_on_every_robot() {
    let hand = Bench::new("shadow_hand");
    let at = |name: &str| hand.robot.joint_index(name).unwrap();
    // One tendon bends both outer joints.
    let bent = hand.pose(&[(at("FFJ2"), 1.2)]);
    hand.write(20, &[(0, 20, bent.clone())]);
    hand.fires_and_is_fixed("coupled", "\"frame\": 0", &[]);
    // Of two fingers the one that is asked for more comes first, and a tenth that is not exact in binary is no more.
    let places = [("FFJ2", 0.4), ("FFJ1", 0.3), ("MFJ2", 0.5), ("LFJ2", 1.2)];
    hand.write(20, &[(0, 20, hand.pose(&places.map(|(name, q)| (at(name), q))))]);
    let found = hand.of("coupled", &[]);
    let first: Vec<&str> = found.iter().map(|l| l["joints"][0].as_str().unwrap()).collect();
    assert!(first.len() == 2 && first[0].contains("LF") && first[1].contains("MF"), "{first:?}");
    hand.write(20, &[(0, 20, bent)]);
    let told = &hand.of("unreachable", &["--simulate"])[0]["settled"];
    assert_eq!((&told["joint"], &told["held"]), (&"FFJ2".into(), &serde_json::json!([[0, 20]])));
    let far = told["distance"].as_f64().unwrap();
    let rests = told["q"][at("FFJ2")].as_f64().unwrap();
    assert!(far > 0.1 && (far - (1.2 - rests).abs()).abs() < 1e-9, "{told}");
    // The rollout says the same.
    let (code, out, err) =
        hand.robert(&["rollout", "a.clip.json", "-p", "computed-torque", "--json", "-q"]);
    assert_eq!(code, 0, "{err}");
    let report: Value = serde_json::from_str(&out).unwrap();
    let said = serde_json::json!([{"frames": [[0, 20]], "joint": "FFJ2", "distance": far}]);
    assert_eq!(report["unreachable"], said);
    hand.fires_and_is_fixed("unreachable", "\"frame\": 0", &["--simulate"]);
    // The thumb through the curled index finger.
    let mut fist = hand.robot.pose("rock").unwrap();
    for (name, v) in [("THJ5", 0.6), ("THJ4", 1.1), ("THJ2", 0.5), ("THJ1", 0.9)] {
        fist[at(name)] = v;
    }
    hand.write(20, &[(0, 20, fist)]);
    hand.fires_and_is_fixed("self-collision", "\"frame\": 0", &["--simulate"]);

    for id in ["ur5e", "ur5e_light"] {
        let arm = Bench::new(id);
        // Folded back onto itself.
        arm.write(20, &[(0, 20, arm.pose(&[(2, 3.1), (3, 1.5)]))]);
        arm.fires_and_is_fixed("self-collision", "\"frame\": 0", &["--simulate"]);
        arm.write(20, &[(0, 20, arm.pose(&[(2, 3.1), (3, 1.5)]))]);
        arm.fires_and_is_fixed("unreachable", "\"frame\": 0", &["--simulate"]);
    }

    // A puck that is asked to be a kilometre away.
    let puck = Bench::new("pointmass");
    puck.write(20, &[(0, 20, puck.pose(&[(0, 1000.0)]))]);
    puck.fires_and_is_fixed("unreachable", "\"frame\": 0", &["--simulate"]);
}

#[test]
fn a_clip_of_another_robot_is_handed_over_where_the_joints_are_the_same() {
    for id in Robot::builtin_ids() {
        let b = Bench::new(id);
        b.write(20, &[(0, 20, b.pose(&[]))]);
        assert_eq!(b.of("other-robot", &[]), Vec::<Value>::new());
        for other in Robot::builtin_ids().filter(|o| *o != id) {
            let found = b.of("other-robot", &["--robot", other]);
            assert_eq!(found[0]["level"], "error", "{id} as {other}");
            let text = fs::read_to_string(b.dir.path().join("a.clip.json")).unwrap();
            let line = found[0]["line"].as_u64().unwrap() as usize;
            assert!(text.lines().nth(line - 1).unwrap().contains("\"id\""), "{id} as {other}");
            let convert = ["clip", "convert", "a.clip.json", "b.clip.json", "--force", "--robot"];
            let (code, _, err) = b.robert(&[&convert[..], &[other]].concat());
            let joints = |r: &Robot| r.joints().iter().map(|j| j.name.clone()).collect::<Vec<_>>();
            if joints(&b.robot) == joints(&Robot::builtin(other).unwrap()) {
                assert_eq!(code, 0, "{err}");
                let (code, out, _) = b.robert(&["clip", "check", "--robot", other, "b.clip.json"]);
                assert_eq!((code, out.contains("other-robot")), (0, false), "{out}");
            } else {
                assert_eq!(code, 3, "{id} as {other}: {err}");
                assert!(err.contains("missing"), "{err}");
            }
        }
    }
}
