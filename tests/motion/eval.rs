//! `robert eval`.

use serde_json::{Value, json};

use super::HOP;
use crate::render::catches;
use crate::run::{binary, robert};

/// `results[i]` of a report, by policy.
fn result<'a>(report: &'a Value, policy: &str) -> &'a Value {
    let results = report["results"].as_array().unwrap();
    results.iter().find(|r| r["policy"] == policy).unwrap_or_else(|| panic!("no {policy}"))
}

fn mean(report: &Value, policy: &str) -> f64 {
    result(report, policy)["precision_mean"].as_f64().unwrap()
}

#[test]
fn the_arm_holds_its_gates_on_any_number_of_threads() {
    let report = |threads: &str| {
        let ran = robert()
            .args(["eval", "--robot", "ur5e", "--suite", "manual", "-q", "--json"])
            .args(["--policy", "zero,pd,computed-torque", "--threads", threads])
            .succeeds();
        let mut json = ran.json();
        for r in json["results"].as_array_mut().unwrap() {
            for t in r["tasks"].as_array_mut().unwrap() {
                t.as_object_mut().unwrap().remove("wall_secs");
            }
        }
        json
    };
    let (one, three) = (report("1"), report("3"));
    assert_eq!(one["results"], three["results"]);
    let (zero, pd, ct) = (mean(&one, "zero"), mean(&one, "pd"), mean(&one, "computed-torque"));
    assert!(zero >= 0.05 && pd <= 0.015 && ct <= 0.002, "{zero} {pd} {ct}");
    let ct = result(&one, "computed-torque");
    assert_eq!((ct["suite"].as_str(), ct["uses_model"].as_bool()), (Some("manual"), Some(true)));
    let names: Vec<&str> =
        ct["tasks"].as_array().unwrap().iter().map(|t| t["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["reacher", "swing", "hang", "front_back"]);
    for key in ["precision", "masked_mae", "p95", "mean_abs_du"] {
        assert!(ct["tasks"][2][key].is_number(), "{key}");
    }
    assert!(ct["ci95"].is_null(), "one seed has no interval");
}

#[test]
fn the_puck_holds_its_gates() {
    let ran = robert()
        .args(["eval", "--robot", "pointmass", "--suite", "manual", "extra", "-q", "--json"])
        .args(["--policy", "pd", "computed-torque"])
        .succeeds();
    let report = ran.json();
    assert_eq!(report["results"].as_array().unwrap().len(), 4, "two suites, two policies");
    for policy in ["pd", "computed-torque"] {
        assert!(mean(&report, policy) < 0.005, "{policy}");
        for task in result(&report, policy)["tasks"].as_array().unwrap() {
            assert!(task["precision"].as_f64().unwrap() < 0.005, "{policy} {}", task["name"]);
        }
    }
}

#[test]
fn the_hand_holds_its_gate_on_a_task_and_a_clip_file() {
    let clip = |name: &str| {
        format!("{}/assets/clips/shadow_hand/{name}.clip.json", env!("CARGO_MANIFEST_DIR"))
    };
    let ran = robert()
        .args(["eval", "--policy", "pd", "--max-precision", "0.04", "--json", "-q"])
        .args(["--suite".to_owned(), "shadow_hand/rsp".to_owned(), clip("piano")])
        .succeeds();
    let report = ran.json();
    assert_eq!(
        (&report["robot"], &report["results"][0]["suite"]),
        (&"shadow_hand".into(), &"files".into())
    );
    assert_eq!(report["results"][0]["tasks"].as_array().unwrap().len(), 2);
}

#[test]
fn a_missed_threshold_is_exit_4_after_the_table() {
    let ran = robert()
        .file("clips/hop.clip.json", HOP)
        .args(["eval", "--suite", "clips", "-p", "zero,ilqr", "--max-precision", "0.01"])
        .fails(4);
    assert!(ran.stderr.contains("zero on clips: 0."), "{}", ran.stderr);
    assert!(!ran.stderr.contains("ilqr on"), "{}", ran.stderr);
    for word in ["hop", "ilqr (m)", "* 0.", "mean |du|", "uses a model"] {
        assert!(ran.stdout.contains(word), "{word}: {}", ran.stdout);
    }
    robert()
        .file("clips/hop.clip.json", HOP)
        .args(["eval", "--suite", "clips", "-p", "ilqr", "--max-precision", "0.01"])
        .succeeds();
}

#[test]
fn seeds_give_an_interval_and_files_hold_every_row() {
    let ran = robert()
        .file("hop.clip.json", HOP)
        .args(["eval", "--suite", "hop.clip.json", "-p", "predictive-sampling,pd+guide"])
        .args(["--seeds", "3", "--csv", "rows.csv", "--out", "found", "--json", "-q"])
        .succeeds();
    let report = ran.json();
    assert!(result(&report, "predictive-sampling")["ci95"].as_f64().unwrap() > 0.0);
    assert_eq!(result(&report, "pd+guide")["ci95"].as_f64(), Some(0.0), "no draws, no spread");
    let read = |name| std::fs::read_to_string(ran.path(name)).unwrap();
    assert_eq!(read("rows.csv").lines().count(), 3);
    assert_eq!(read("rows.csv"), read("found/results.csv"));
    // Nine commanded frames a policy, with a header.
    assert_eq!(read("found/errors.csv").lines().count(), 19);
    let saved: Value = serde_json::from_str(&read("found/results.json")).unwrap();
    assert_eq!(saved, report);
}

#[test]
fn mistakes_are_named() {
    let says = |args: &[&str], code: i32, words: &[&str]| {
        let ran = robert()
            .file("empty/readme.txt", "")
            .args(["eval", "--policy", "zero", "--suite"])
            .args(args)
            .fails(code);
        for word in words {
            assert!(ran.stderr.contains(word), "{args:?}: {word} not in {}", ran.stderr);
        }
    };
    says(&["manual"], 2, &["--robot"]);
    says(&["hard", "--robot", "ur5e"], 2, &["hard", "manual, extra, validation"]);
    says(&["empty"], 3, &["empty", ".clip.json"]);
    says(&["test", "--robot", "ur5e"], 2, &["--data"]);
    says(&["manual", "--robot", "ur5e", "--max-precision", "nan"], 2, &["--max-precision"]);
    says(&["test", "--robot", "ur5e", "--data", "nowhere"], 3, &["nowhere"]);
}

#[test]
fn a_clip_of_another_robot_is_named() {
    let eval = |robot: &str| {
        robert()
            .file("clips/first.clip.json", HOP)
            .file("clips/second.clip.json", HOP)
            .args(["eval", "--robot", robot, "--policy", "pd", "--suite", "clips"])
    };
    eval("pointmass").succeeds();
    let said = eval("ur5e").fails(3).stderr;
    assert!(said.contains("first: the clip (2 joints) is not for robot ur5e"), "{said}");
}

#[test]
fn tasks_tell_their_excess_their_gaps_and_their_jams() {
    let ran = robert()
        .args(["eval", "--robot", "pointmass", "--suite", "drawn,touch", "-q", "--json"])
        .args(["--policy", "zero,pd"])
        .succeeds();
    let report = ran.json();
    let results = report["results"].as_array().unwrap();
    assert_eq!(results.len(), 4);
    for result in results {
        let (mut sum, mut floors) = (0.0, 0.0);
        for t in result["tasks"].as_array().unwrap() {
            let (p, floor) = (t["precision"].as_f64().unwrap(), t["floor"].as_f64().unwrap());
            // Of a floor that nobody can see, an excess would be no share.
            assert_eq!(t["excess"].is_number(), floor > 1e-5, "{t}");
            let excess = t["excess"].as_f64().unwrap_or((p - floor) / floor);
            assert!((excess - (p - floor) / floor).abs() < 1e-9 * excess.abs().max(1.0), "{t}");
            assert!(t["moving"].is_number() && t["jams"].is_array(), "{t}");
            sum += p;
            floors += floor;
        }
        let mean = result["excess_mean"].as_f64().unwrap();
        assert!((mean - (sum - floors) / floors).abs() < 1e-6 * mean.abs().max(1.0), "{result}");
    }
    let task = |policy: &str, name: &str| {
        let tasks = result(&report, policy)["tasks"].as_array().unwrap();
        tasks.iter().find(|t| t["name"] == name).unwrap().clone()
    };
    // Who does not move stays where nobody wants it to be, and has no way to measure.
    let (still, pd) = (task("zero", "park"), task("pd", "park"));
    assert!(!still["jams"].as_array().unwrap().is_empty(), "{still}");
    assert!(still["gap"]["path"].is_null() && still["gap"]["gaps"].as_u64() > Some(3), "{still}");
    assert_eq!(pd["jams"].as_array().unwrap().len(), 0);
    let path = pd["gap"]["path"].as_f64().unwrap();
    assert!((1.0..1.3).contains(&path), "{pd}");
    assert!(pd["gap"]["jerk"].as_f64() < Some(3.0), "{pd}");
    assert!(pd["gap"]["jerk_worst"]["value"].as_f64() < Some(4.0), "{pd}");
}

#[test]
fn floors_of_other_clips_are_measured_and_left_out_on_request() {
    let eval = |more: &[&str]| {
        let args = ["eval", "--suite", "hop.clip.json", "-q", "--json", "--policy"];
        robert().file("hop.clip.json", HOP).args(args).args(more).succeeds().json()
    };
    let floor = |report: &Value, i: usize| report["results"][i]["tasks"][0]["floor"].clone();
    let alone = eval(&["pd"]);
    let measured = floor(&alone, 0).as_f64().unwrap();
    assert!(measured > 0.0 && alone["results"][0]["tasks"][0]["excess"].as_f64() > Some(0.0));
    // The same figure as that of iLQR in the table.
    let both = eval(&["pd,ilqr"]);
    assert_eq!(floor(&both, 0), result(&both, "ilqr")["precision_mean"]);
    assert!((floor(&both, 0).as_f64().unwrap() - measured).abs() < 1e-12);
    assert_eq!(result(&both, "ilqr")["tasks"][0]["excess"].as_f64(), Some(0.0));
    for without in [&["pd", "--no-floor"][..], &["pd", "--plant", "mass=1.2"]] {
        let report = eval(without);
        assert!(floor(&report, 0).is_null() && report["results"][0]["excess_mean"].is_null());
        assert!(report["results"][0]["tasks"][0]["jams"].is_null());
    }
}

#[test]
fn suites_have_other_names_and_final_is_the_other_halves() {
    let report = |suite: &str| {
        let args = ["eval", "--robot", "pointmass", "--policy", "zero", "-q", "--json", "--suite"];
        robert().args(args).args([suite]).succeeds().json()
    };
    let names = |report: &Value| -> Vec<String> {
        let tasks = report["results"].as_array().unwrap().iter();
        let tasks = tasks.flat_map(|r| r["tasks"].as_array().unwrap());
        tasks.map(|t| t["name"].as_str().unwrap().to_owned()).collect()
    };
    let all = report("final");
    assert_eq!(all["results"][0]["suite"], "final");
    let halves = report("drawn-final,fast-final,touch-final");
    assert_eq!(names(&all), names(&halves));
    assert!(names(&all).iter().all(|n| !names(&report("drawn,fast,touch")).contains(n)));
    assert_eq!(report("heldout")["results"][0]["suite"], "validation");
}

/// Waits until a child has used so many seconds of processor time, however many others work beside it.
fn works(child: &mut std::process::Child, secs: u64) {
    // User and system time are the fields 14 and 15, in hundredths of a second.
    let used = |stat: &str| -> u64 {
        let after = stat.rsplit(')').next().unwrap();
        after.split_whitespace().skip(11).take(2).map(|t| t.parse::<u64>().unwrap()).sum()
    };
    let path = format!("/proc/{}/stat", child.id());
    while used(&std::fs::read_to_string(&path).unwrap()) < 100 * secs {
        assert!(child.try_wait().unwrap().is_none(), "it ended by itself");
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
}

#[test]
fn an_interruption_keeps_what_was_finished() {
    // The first policy takes less than a second, the second one half a minute.
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("complete.svg"), "of a complete evaluation").unwrap();
    let mut child = std::process::Command::new(binary())
        .args(["eval", "--robot", "pointmass", "--suite", "manual", "-q", "--json"])
        .args(["--policy", "pd,predictive-sampling", "--seeds", "10", "--threads", "1"])
        .args(["--csv", "all.csv", "--out", "out", "--plot", "complete.svg"])
        .current_dir(dir.path())
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    while !catches(child.id(), 2) {
        assert!(child.try_wait().unwrap().is_none(), "it ended by itself");
        std::thread::yield_now();
    }
    // What the first policy needs many times over.
    works(&mut child, 5);
    let pid = child.id().to_string();
    assert!(std::process::Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
    let out = child.wait_with_output().unwrap();
    let stderr = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(130), "{stderr}");
    assert!(stderr.contains("interrupted after") && stderr.contains("of 300 rollouts"), "{stderr}");
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(report["interrupted"], true);
    assert!(mean(&report, "pd") < 0.005);
    let slow = result(&report, "predictive-sampling");
    assert!(slow["precision_mean"].is_null());
    let last = &slow["tasks"][14];
    assert_eq!(last["error"], "interrupted");
    assert!(last["precision"].is_null() && last["jams"].is_null());
    let csv = std::fs::read_to_string(dir.path().join("all.csv")).unwrap();
    assert!(csv.lines().last().unwrap().ends_with(",,interrupted"), "{csv}");
    let before = std::fs::read_to_string(dir.path().join("complete.svg")).unwrap();
    assert_eq!(before, "of a complete evaluation");
    assert!(dir.path().join("out/results.json").exists());
}

#[test]
fn an_interruption_while_floors_are_measured_tells_what_is_known() {
    let dir = tempfile::tempdir().unwrap();
    let long = |name: &str, length: u32| {
        let joints = r#"["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2"]"#;
        let text = format!(
            r#"{{"format": "robert-clip/1", "name": "{name}", "robot": {{"id": "ur5e", "joints": {joints}}},
            "fps": 20, "length": {length}, "fill": "linear", "keys": [{{"frame": 0, "q": [-1.5, -1.5, 1.5, -1.5, -1.5]}},
            {{"frame": {}, "q": [-1.2, -1.4, 1.4, -1.5, -1.5]}}]}}"#,
            length - 1
        );
        std::fs::write(dir.path().join(format!("{name}.clip.json")), text).unwrap();
    };
    long("a", 8);
    long("b", 20_000);
    let mut child = std::process::Command::new(binary())
        .args(["eval", "--suite", "a.clip.json,b.clip.json", "-q", "--json", "--policy", "pd"])
        .args(["--threads", "1", "--csv", "all.csv"])
        .current_dir(dir.path())
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    while !catches(child.id(), 2) {
        assert!(child.try_wait().unwrap().is_none(), "it ended by itself");
        std::thread::yield_now();
    }
    works(&mut child, 5);
    let pid = child.id().to_string();
    assert!(std::process::Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
    let out = child.wait_with_output().unwrap();
    let stderr = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(130), "{stderr}");
    assert!(stderr.contains("interrupted while the floors were measured"), "{stderr}");
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!((&report["interrupted"], &report["suites"][0]["tasks"]), (&json!(true), &json!(2)));
    let tasks = &result(&report, "pd")["tasks"];
    assert!(tasks[0]["floor"].is_number() && tasks[1]["floor"].is_null(), "{tasks}");
    assert!(tasks.as_array().unwrap().iter().all(|t| t["error"] == "interrupted"), "{tasks}");
    assert!(!dir.path().join("all.csv").exists(), "nothing is known that a table could hold");
}
