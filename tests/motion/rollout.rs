//! `robert rollout`.

use super::HOP;
use crate::run::robert;

#[test]
fn json_has_what_scripts_read() {
    let ran = robert().args(["rollout", "ur5e/reacher", "--policy", "pd", "--json"]).succeeds();
    let r = ran.json();
    let precision = r["precision"].as_f64().unwrap();
    assert!(precision > 1e-6 && precision < 0.015, "{precision}");
    assert_eq!(r["frames"], 201);
    assert!(r["masked_mae"].is_null(), "nothing is masked");
    assert!(r["wall_secs"].as_f64().unwrap() > 0.0 && r["moving"].as_f64().unwrap() > 0.0);
    assert_eq!((r["policy"].as_str(), r["unit"].as_str()), (Some("pd"), Some("rad")));
    assert_eq!(r["per_frame"].as_array().unwrap().len(), 201);
    assert!(r["unreachable"].is_null(), "a key at every frame is not settled");
    let joints = r["per_joint"].as_array().unwrap();
    let mean = joints.iter().map(|j| j["error"].as_f64().unwrap()).sum::<f64>() / 5.0;
    assert!((mean - precision).abs() < 1e-12, "joints weigh alike: {mean} {precision}");
}

/// Keys for the index finger alone: the joints of `q` are FFJ4 to FFJ1.
fn index_finger() -> String {
    let clip =
        robert().args(["clip", "new", "--robot", "shadow_hand", "--name", "index"]).succeeds();
    let mut clip: serde_json::Value = serde_json::from_str(&clip.stdout).unwrap();
    let others = vec![serde_json::Value::Null; 18];
    let poses = [[0.2, 0.8, 0.6, 0.6], [0.0, 1.2, 1.0, 1.0], [-0.1, 0.4, 0.3, 0.3]];
    clip["length"] = 45.into();
    clip["keys"] = std::iter::once(serde_json::json!({"frame": 0, "q": vec![0.0; 22]}))
        .chain(poses.iter().enumerate().map(|(i, pose)| {
            let mut q: Vec<serde_json::Value> = pose.iter().map(|&v| v.into()).collect();
            q.extend(others.clone());
            serde_json::json!({"frame": 10 * (i + 1), "q": q, "hold": 3})
        }))
        .collect::<Vec<_>>()
        .into();
    clip.to_string()
}

#[test]
fn unless_told_otherwise_the_nearest_of_several_performs() {
    let clip = index_finger();
    let check = robert().file("index.clip.json", &clip).args(["clip", "check", "index.clip.json"]);
    check.succeeds();
    let ran = robert()
        .file("index.clip.json", &clip)
        .args(["rollout", "index.clip.json", "--json", "-q"])
        .succeeds();
    let r = ran.json();
    let error = r["precision"].as_f64().unwrap();
    assert!(error < 0.005, "keys for one finger are met where they can be reached: {error}");
    assert_eq!(r["chosen"], r["policy"]);
    assert!(r["ms_per_frame"].is_null(), "its frames were simulated while policies were compared");
    let plain = robert()
        .file("index.clip.json", &clip)
        .args(["rollout", "index.clip.json", "--json", "-q", "-p", "robert"])
        .succeeds()
        .json();
    let [ms, secs] = ["ms_per_frame", "wall_secs"].map(|key| plain[key].as_f64().unwrap());
    assert!(ms * plain["frames"].as_f64().unwrap() < 1e3 * secs, "the model was loaded as well");
    let tried = r["tried"].as_array().unwrap();
    let score = |t: &serde_json::Value| t["judged"].as_f64().unwrap() + t["gaps"].as_f64().unwrap();
    let own = tried.iter().find(|t| t["policy"] == r["chosen"]).unwrap();
    assert!(tried.iter().all(|t| score(own) <= score(t)), "{tried:?}");
    for name in ["robert", "robert+smooth", "ridge", "pd"] {
        assert!(tried.iter().any(|t| t["policy"] == name), "{name}: {tried:?}");
    }
    // A named one is performed, and repeated, alone and to the same bits.
    let chosen = r["chosen"].as_str().unwrap();
    assert!(chosen.ends_with("+ilc"), "{chosen}");
    let again = robert()
        .file("index.clip.json", &clip)
        .args(["rollout", "index.clip.json", "--json", "-q", "-p", chosen])
        .succeeds();
    assert_eq!(again.json()["precision"], r["precision"]);
    let alone = again.json()["tried"].as_array().unwrap().len();
    assert_eq!(alone, 2, "once, and with corrected goals");
}

#[test]
fn the_choice_is_told_to_people_too() {
    let ran = robert().file("hop.clip.json", HOP).args(["rollout", "hop.clip.json"]).succeeds();
    assert!(
        ran.stdout.contains("chosen by simulating") && ran.stdout.contains("pd "),
        "{}",
        ran.stdout
    );
}

#[test]
fn twice_the_same_bytes() {
    for policy in ["predictive-sampling", "ilqr", "pd+guide+refine"] {
        let once = || {
            let ran = robert()
                .file("hop.clip.json", HOP)
                .args(["rollout", "hop.clip.json", "--seed", "5", "-q", "--json"])
                .args(["--policy", policy, "--out", "hop.mcap", "--csv", "hop.csv"])
                .succeeds();
            let mut json = ran.json();
            assert_eq!(json["unreachable"], serde_json::json!([]), "it can hold each of its poses");
            for time in ["wall_secs", "ms_per_frame"] {
                json.as_object_mut().unwrap().remove(time);
            }
            let read = |name| std::fs::read(ran.path(name)).unwrap();
            (json, read("hop.mcap"), read("hop.csv"))
        };
        let (a, b) = (once(), once());
        assert!(a == b, "{policy}: {} {}", a.0, b.0);
        assert!(a.1.starts_with(b"\x89MCAP0"));
        let table = String::from_utf8(a.2).unwrap();
        assert!(table.starts_with("frame,time,mask,x,y\n0,0,0,0,0\n"), "{table}");
        assert_eq!(table.lines().count(), 22);
    }
}

#[test]
fn seeds_and_plants_change_the_motion() {
    let precision = |more: &[&str]| {
        let ran = robert()
            .file("hop.clip.json", HOP)
            .args(["rollout", "hop.clip.json", "--json", "-q"])
            .args(more)
            .succeeds();
        ran.json()["precision"].as_f64().unwrap()
    };
    let sampled = |seed| precision(&["-p", "predictive-sampling", "--seed", seed]);
    assert_ne!(sampled("1").to_bits(), sampled("2").to_bits());
    let (right, wrong) = (
        precision(&["-p", "computed-torque"]),
        precision(&["-p", "computed-torque", "--plant", "mass=1.5,damping=1.5,gear=0.8"]),
    );
    assert!(right < 2e-4 && wrong > 10.0 * right, "{right} {wrong}");
    let (open, refined) = (precision(&["-p", "zero"]), precision(&["-p", "zero", "--refine"]));
    assert!(refined < 0.01 * open, "{refined} {open}");
}

#[test]
fn people_get_a_summary_and_progress_goes_elsewhere() {
    let ran = robert()
        .file("hop.clip.json", HOP)
        .args(["rollout", "hop.clip.json", "-p", "ilqr"])
        .succeeds();
    for word in ["ilqr on pointmass", "Precision", "end of holds", "21 frames"] {
        assert!(ran.stdout.contains(word), "{word}: {}", ran.stdout);
    }
}

#[test]
fn mistakes_are_named() {
    let says = |args: &[&str], code: i32, words: &[&str]| {
        let ran = robert().file("hop.clip.json", HOP).args(["rollout"]).args(args).fails(code);
        for word in words {
            assert!(ran.stderr.contains(word), "{args:?}: {word} not in {}", ran.stderr);
        }
        assert!(ran.stdout.is_empty());
    };
    says(
        &["hop.clip.json", "-o", "hop.mp4"],
        2,
        &["MCAP", "robert render hop.clip.json -o hop.mp4"],
    );
    says(&["hop.clip.json", "-p", "magic"], 2, &["magic", "computed-torque"]);
    says(&["hop.clip.json", "-p", "pd+x"], 2, &["+x"]);
    says(&["hop.clip.json", "-p", "ridge:."], 5, &["no model in .", "robert fit ridge"]);
    says(&["hop.clip.json", "--plant", "wind=2"], 2, &["wind", "mass=1.25"]);
    says(&["hop.clip.json", "--robot", "ur5e"], 3, &["(2 joints)", "ur5e (5 joints)", "--robot"]);
    says(&["hop.clip.json", "--robot", "ur6"], 3, &["ur6"]);
    says(&["gone.clip.json"], 3, &["gone.clip.json"]);
    says(&["recher"], 2, &["ur5e/reacher"]);
    let bad = HOP.replace("\"hold\": 9", "\"hold\": -9");
    let ran = robert().file("bad.clip.json", bad).args(["rollout", "bad.clip.json"]).fails(3);
    assert!(ran.stderr.contains("bad.clip.json:8:"), "{}", ran.stderr);
    let short = HOP
        .replace("\"length\": 21", "\"length\": 1")
        .replace(",\n    {\"frame\": 12, \"q\": [0.2, -0.1], \"hold\": 9}", "");
    let ran = robert().file("short.clip.json", short).args(["rollout", "short.clip.json"]).fails(3);
    assert!(ran.stderr.contains("at least 2"), "{}", ran.stderr);
}

#[test]
fn a_motion_that_breaks_off_says_what_is_wrong_with_its_clip() {
    let hand = robert::robot::Robot::builtin("shadow_hand").unwrap();
    let joints: Vec<&str> = hand.joints().iter().map(|j| j.name.as_str()).collect();
    let clip = serde_json::json!({"format": "robert-clip/1", "fps": 20, "length": 21,
        "robot": {"id": "shadow_hand", "joints": joints, "units": vec!["rad"; joints.len()]},
        "keys": [{"frame": 0, "q": vec![5e4; joints.len()], "hold": 21}]});
    let ran = robert().file("far.clip.json", clip.to_string());
    let stderr = ran.args(["rollout", "far.clip.json", "-p", "pd"]).fails(1).stderr;
    assert!(stderr.contains("diverged") && stderr.contains("FFJ4 50000 is outside"), "{stderr}");
}

#[test]
fn a_clip_that_asks_for_nothing_says_so() {
    let empty = HOP
        .replace("{\"frame\": 12, \"q\": [0.2, -0.1], \"hold\": 9}", "")
        .replace("[0, 0]},", "[0, 0]}");
    let run = |args: &[&str]| robert().file("hop.clip.json", &empty).args(args).succeeds();
    let ran = run(&["rollout", "hop.clip.json", "-p", "pd"]);
    assert!(ran.stdout.contains("no goals after frame 0"), "{}", ran.stdout);
    let ran = run(&["rollout", "hop.clip.json", "-p", "pd", "--json"]).json();
    assert!(ran["precision"].is_null() && ran["why_none"].is_string(), "{ran}");
    let ran = run(&["eval", "--suite", "hop.clip.json", "-p", "pd"]);
    assert!(ran.stdout.contains("nothing to measure"), "{}", ran.stdout);
}

#[test]
fn a_robot_of_ones_own_is_asked_for() {
    let clip = HOP.replace("\"pointmass\"", "\"my_arm\"");
    for args in [
        &["rollout", "hop.clip.json"][..],
        &["render", "hop.clip.json", "-o", "a.png", "--kinematic"],
        &["export", "hop.clip.json", "--to", "csv"],
        &["eval", "--suite", "hop.clip.json", "-p", "pd"],
    ] {
        let ran = robert().file("hop.clip.json", &clip).args(args).fails(3);
        for word in ["my_arm", "--robot DIR"] {
            assert!(ran.stderr.contains(word), "{args:?}: {}", ran.stderr);
        }
    }
}

#[test]
fn whoever_reads_may_stop_reading() {
    use std::process::{Command, Stdio};
    let shut = |args: &[&str]| {
        let mut child = Command::new(crate::run::binary())
            .args(args)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        drop(child.stdout.take());
        let out = child.wait_with_output().unwrap();
        (out.status.code(), String::from_utf8_lossy(&out.stderr).into_owned())
    };
    assert_eq!(shut(&["robots", "ls", "--json"]), (Some(0), String::new()));
    assert_eq!(shut(&["completions", "bash"]), (Some(0), String::new()));
    let (code, err) = shut(&[
        "eval",
        "--robot",
        "pointmass",
        "--suite",
        "trial",
        "-p",
        "zero",
        "--max-precision",
        "0",
    ]);
    assert!(code == Some(4) && err.contains("Precision above 0"), "{code:?} {err}");
}

#[test]
fn tasks_are_listed_and_shown() {
    let ran = robert().args(["tasks", "ls", "--robot", "shadow_hand", "--json"]).succeeds();
    let tasks = ran.json();
    let fire = tasks.as_array().unwrap().iter().find(|t| t["task"] == "fire").unwrap().clone();
    assert_eq!((fire["suite"].as_str(), fire["frames"].as_u64()), (Some("manual"), Some(201)));
    let clip = robert().args(["tasks", "show", "shadow_hand/fire"]).succeeds().stdout;
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/assets/clips/shadow_hand/fire.clip.json");
    assert_eq!(clip, std::fs::read_to_string(file).unwrap());
    robert().file("fire.clip.json", clip).args(["clip", "check", "fire.clip.json"]).succeeds();
}

#[test]
fn a_clip_is_never_written_over_by_what_is_made_from_it() {
    for args in [
        ["rollout", "hop.clip.json", "-p", "pd", "-o", "hop.clip.json"],
        ["rollout", "hop.clip.json", "-p", "pd", "--csv", "./hop.clip.json"],
        ["export", "hop.clip.json", "--to", "csv", "-o", "hop.clip.json"],
    ] {
        let ran = robert().file("hop.clip.json", HOP).args(args).run();
        assert_eq!(ran.code, 2, "{args:?}: {}", ran.stderr);
        assert!(ran.stderr.contains("overwritten"), "{}", ran.stderr);
        let text = std::fs::read_to_string(ran.dir.path().join("hop.clip.json")).unwrap();
        assert_eq!(text, HOP);
    }
    // Nor is another clip, or a robot.
    let model = "<mujoco><worldbody/></mujoco>";
    for args in [
        ["rollout", "hop.clip.json", "-p", "pd", "-o", "other.clip.json"],
        ["rollout", "hop.clip.json", "-p", "pd", "--csv", "robot.xml"],
        ["export", "hop.clip.json", "--to", "mjcf", "-o", "robot.xml"],
        ["eval", "--suite=hop.clip.json", "-p", "pd", "--csv", "hop.clip.json"],
        ["eval", "--suite=hop.clip.json", "-p", "pd", "--csv", "robot.xml"],
        ["models", "pack", "runs/none", "--notes=a", "-o", "other.clip.json"],
    ] {
        let files = robert().file("hop.clip.json", HOP).file("other.clip.json", HOP);
        let ran = files.file("robot.xml", model).args(args).fails(2);
        assert!(ran.stderr.contains("would be lost"), "{}", ran.stderr);
        assert_eq!(std::fs::read_to_string(ran.path("other.clip.json")).unwrap(), HOP);
        assert_eq!(std::fs::read_to_string(ran.path("robot.xml")).unwrap(), model);
    }
    // What can be made again is replaced.
    let args = ["export", "hop.clip.json", "-p", "pd", "--to", "mjcf", "-o", "keys.xml"];
    let first = robert().file("hop.clip.json", HOP).args(args).succeeds();
    let keys = std::fs::read(first.path("keys.xml")).unwrap();
    robert().file("hop.clip.json", HOP).file("keys.xml", keys).args(args).succeeds();
}
