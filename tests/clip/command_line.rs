//! `robert clip`, as people and scripts call it.

use std::fs;

use robert::clip::{Clip, Goal};

use crate::run::{Ran, call, robert};

/// A second call in the folder of the first.
fn again(ran: &Ran, args: &[&str]) -> (i32, String, String) {
    call(ran.dir.path(), args)
}

fn new_arm() -> Ran {
    robert().args(["clip", "new", "--robot", "ur5e", "--secs", "3", "-o", "a.clip.json"]).succeeds()
}

#[test]
fn new_clip_is_formatted_checked_and_not_overwritten() {
    let ran = new_arm();
    assert_eq!(again(&ran, &["clip", "fmt", "--check", "a.clip.json"]).0, 0);
    let (code, out, _) = again(&ran, &["clip", "info", "--json", "a.clip.json"]);
    let info: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!((code, &info["frames"], &info["robot"]), (0, &60.into(), &"ur5e".into()));
    let (code, _, err) = again(&ran, &["clip", "new", "--robot", "ur5e", "-o", "a.clip.json"]);
    assert_eq!(code, 2);
    assert!(err.contains("--force"), "{err}");
    let (code, _, err) = again(&ran, &["clip", "new", "--robot", "ur5f"]);
    assert_eq!(code, 3, "{err}");
}

#[test]
fn check_has_places_levels_and_fixes() {
    let ran = new_arm();
    let ops = r#"[
        {"op": "keys.add", "args": {"keys": [{"frame": 10, "q": [9, 0, 0, 0, 0]}]}},
        {"op": "keys.hold", "args": {"frames": [10], "hold": 50}}
    ]"#;
    fs::write(ran.path("ops.json"), ops).unwrap();
    let (code, out, err) =
        again(&ran, &["clip", "apply", "a.clip.json", "ops.json", "-i", "--json"]);
    assert_eq!(code, 0, "{err}");
    let applied: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(applied["first_changed_frame"], 10);
    let (code, out, _) = again(&ran, &["clip", "check", "a.clip.json"]);
    assert_eq!(code, 4);
    let text = fs::read_to_string(ran.path("a.clip.json")).unwrap();
    let line = 1 + text.lines().position(|l| l.contains("\"frame\": 10,")).unwrap();
    assert!(out.contains(&format!("a.clip.json:{line}:25: error[joint-limit]: ")), "{out}");
    assert!(out.contains("fix: Clamp to the limits"), "{out}");
    let (_, out, _) = again(&ran, &["clip", "check", "--json", "a.clip.json"]);
    let report: serde_json::Value = serde_json::from_str(&out).unwrap();
    let lint = &report["files"][0]["lints"][0];
    assert_eq!((&lint["rule"], &lint["line"]), (&"joint-limit".into(), &line.into()));
    // A script can carry a fix out by itself.
    fs::write(ran.path("fix.json"), lint["mends"][0]["op"].to_string()).unwrap();
    assert_eq!(again(&ran, &["clip", "apply", "a.clip.json", "fix.json", "-i"]).0, 0);
    assert_eq!(again(&ran, &["clip", "check", "a.clip.json"]).0, 0, "warnings only");
    assert_eq!(again(&ran, &["clip", "check", "--strict", "a.clip.json"]).0, 4);
    assert_eq!(again(&ran, &["clip", "check", "--strict", "--fix", "a.clip.json"]).0, 0);
    // What apply said about undoing leads back.
    fs::write(ran.path("undo.json"), applied["undo"].to_string()).unwrap();
    fs::write(ran.path("b.clip.json"), &text).unwrap();
    assert_eq!(again(&ran, &["clip", "apply", "b.clip.json", "undo.json", "-i"]).0, 0);
    robert_new_equals(&ran, "b.clip.json");
}

fn robert_new_equals(ran: &Ran, name: &str) {
    let fresh = new_arm();
    let read = |p| fs::read_to_string(p).unwrap();
    assert_eq!(read(ran.path(name)), read(fresh.path("a.clip.json")));
}

#[test]
fn refusals_name_file_and_place() {
    let ran = new_arm();
    fs::write(ran.path("ops.json"), "[\n {\"op\": \"keys.mvoe\", \"args\": {}}\n]").unwrap();
    let (code, _, err) = again(&ran, &["clip", "apply", "a.clip.json", "ops.json"]);
    assert_eq!(code, 3);
    assert!(err.starts_with("error: ops.json:2:") && err.contains("keys.move"), "{err}");
    fs::write(ran.path("ops.json"), "{\"op\": \"keys.delete\", \"args\": {\"frames\": [7]}}")
        .unwrap();
    let (code, _, err) = again(&ran, &["clip", "apply", "a.clip.json", "ops.json"]);
    assert_eq!(code, 3);
    assert!(err.contains("edit 0 (keys.delete): there is no key at frame 7"), "{err}");
    fs::write(ran.path("a.csv"), "frame,shoulder_pan\n0,x\n").unwrap();
    let (code, _, err) =
        again(&ran, &["clip", "convert", "a.csv", "b.clip.json", "--like", "a.clip.json"]);
    assert_eq!(code, 3, "{err}");
    assert!(err.starts_with("error: a.csv:"), "{err}");
    let (code, _, err) = again(&ran, &["clip", "convert", "a.csv", "b.clip.json"]);
    assert_eq!(code, 2, "{err}");
    let (code, _, _) = again(&ran, &["clip", "check", "none.clip.json", "a.clip.json"]);
    assert_eq!(code, 3, "a missing file");
}

#[test]
fn conversions_keep_the_command() {
    let ran = new_arm();
    let ops = r#"{"op": "batch", "args": {"ops": [
        {"op": "keys.add", "args": {"keys": [
            {"frame": 13, "q": [0.1, -1.2, 1.234567, 0.333333, 2], "fill": "cubic"},
            {"frame": 59, "q": [-0.1, -1.4, 1, 0, 1]}]}},
        {"op": "mask.set", "args": {"from": 20, "to": 30, "masked": true}}]}}"#;
    fs::write(ran.path("ops.json"), ops).unwrap();
    assert_eq!(again(&ran, &["clip", "apply", "a.clip.json", "ops.json", "-i"]).0, 0);
    for end in ["csv", "xml", "yaml", "json"] {
        let there = format!("a.{end}");
        let back = format!("{end}.clip.json");
        let (code, _, err) = again(&ran, &["clip", "convert", "a.clip.json", &there]);
        assert_eq!(code, 0, "{err}");
        let (code, _, err) =
            again(&ran, &["clip", "convert", &there, &back, "--like", "a.clip.json"]);
        assert_eq!(code, 0, "{err}");
        let (_, out, _) = again(&ran, &["clip", "diff", "a.clip.json", &back]);
        assert_eq!(out.lines().last(), Some("the commanded motion is the same"), "{end}: {out}");
    }
}

#[test]
fn angles_of_a_csv_may_be_degrees_and_options_of_other_formats_are_refused() {
    let ran = new_arm();
    assert_eq!(again(&ran, &["clip", "convert", "a.clip.json", "a.csv"]).0, 0);
    let csv = fs::read_to_string(ran.path("a.csv")).unwrap();
    let joint = csv.lines().next().unwrap().split(',').position(|name| name == "elbow").unwrap();
    let mut rows: Vec<Vec<String>> =
        csv.lines().map(|row| row.split(',').map(str::to_owned).collect()).collect();
    rows[1][joint] = "-90".to_owned();
    let rows: Vec<String> = rows.iter().map(|row| row.join(",")).collect();
    fs::write(ran.path("b.csv"), rows.join("\n")).unwrap();
    let to = ["clip", "convert", "b.csv", "b.clip.json", "--like", "a.clip.json"];
    let (code, _, err) = again(&ran, &[&to[..], &["--degrees"]].concat());
    assert_eq!(code, 0, "{err}");
    let clip = Clip::load(&ran.path("b.clip.json")).unwrap();
    let place = clip.robot.joints.iter().position(|name| name == "elbow").unwrap();
    let Goal::Q(row) = &clip.keys[0].goal else { panic!("{:?}", clip.keys[0]) };
    assert!((row[place].unwrap() + std::f64::consts::FRAC_PI_2).abs() < 1e-6, "{row:?}");
    for option in [&["--fps", "30"][..], &["--thin", "0"], &["--episode", "1"]] {
        let (code, _, err) = again(&ran, &[&to[..], &["--force"], option].concat());
        assert!(code == 2 && err.contains(option[0]), "{code} {err}");
    }
}

#[test]
fn fmt_and_diff_speak_to_scripts() {
    let ran = new_arm();
    let text = fs::read_to_string(ran.path("a.clip.json")).unwrap();
    fs::write(ran.path("b.clip.json"), text.replace(": ", ":   ").replace('\n', "\n\n")).unwrap();
    assert_eq!(again(&ran, &["clip", "fmt", "--check", "b.clip.json"]).0, 4);
    assert_eq!(again(&ran, &["clip", "diff", "--exit-code", "a.clip.json", "b.clip.json"]).0, 0);
    assert_eq!(again(&ran, &["clip", "fmt", "b.clip.json"]).0, 0);
    assert_eq!(fs::read_to_string(ran.path("b.clip.json")).unwrap(), text);
    fs::write(ran.path("c.clip.json"), text.replace("\"length\": 60", "\"length\": 61")).unwrap();
    let (code, out, _) =
        again(&ran, &["clip", "diff", "--exit-code", "a.clip.json", "c.clip.json"]);
    assert_eq!(code, 4);
    assert!(out.contains("length: 60 -> 61 frames"), "{out}");
    let (code, out, _) = again(&ran, &["clip", "upgrade", "c.clip.json"]);
    assert_eq!((code, out.as_str()), (0, "c.clip.json: robert-clip/1 is up to date\n"));
}

/// `diff a b` as an edit of a gives b, and the way back gives a.
#[test]
fn a_difference_is_an_edit_that_leads_there() {
    let ran = new_arm();
    let ops = r#"[
        {"op": "keys.add", "args": {"keys": [{"frame": 13, "q": [0.1, -1.2, 1, 0, 2], "hold": 3}]}},
        {"op": "mask.set", "args": {"from": 20, "to": 30, "masked": true}},
        {"op": "pose.delete", "args": {"name": "home"}},
        {"op": "markers.add", "args": {"frame": 5, "name": "here"}},
        {"op": "clip.start", "args": {"start": {"q": [0, 0, 0, 0, 0]}}},
        {"op": "clip.rename", "args": {"name": "other"}}
    ]"#;
    fs::write(ran.path("ops.json"), ops).unwrap();
    let (code, text, err) = again(&ran, &["clip", "apply", "a.clip.json", "ops.json"]);
    assert_eq!(code, 0, "{err}");
    fs::write(ran.path("b.clip.json"), &text).unwrap();
    for [from, to] in [["a.clip.json", "b.clip.json"], ["b.clip.json", "a.clip.json"]] {
        let (code, patch, err) = again(&ran, &["clip", "diff", "--json", from, to]);
        assert_eq!((code, err.as_str()), (0, ""));
        fs::write(ran.path("p.json"), patch).unwrap();
        let (code, there, err) = again(&ran, &["clip", "apply", from, "p.json"]);
        assert_eq!(code, 0, "{err}");
        assert_eq!(there, fs::read_to_string(ran.path(to)).unwrap(), "{from} to {to}");
    }
    let (_, same, _) = again(&ran, &["clip", "diff", "--json", "a.clip.json", "a.clip.json"]);
    fs::write(ran.path("p.json"), same).unwrap();
    assert_eq!(again(&ran, &["clip", "apply", "a.clip.json", "p.json", "-i"]).0, 0);
    robert_new_equals(&ran, "a.clip.json");
    // What no edit changes is said.
    let other = text.replace("\"ur5e\"", "\"ur5e_light\"");
    fs::write(ran.path("c.clip.json"), other).unwrap();
    let (_, _, err) = again(&ran, &["clip", "diff", "--json", "b.clip.json", "c.clip.json"]);
    assert!(err.contains("robot differs"), "{err}");
}

#[test]
fn what_is_no_clip_is_counted() {
    let ran = new_arm();
    fs::write(ran.path("bad.clip.json"), "{").unwrap();
    let (code, out, err) =
        again(&ran, &["clip", "check", "--json", "bad.clip.json", "a.clip.json"]);
    assert_eq!(code, 3, "{err}");
    let report: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(
        (&report["errors"], &report["unreadable"][0]["path"]),
        (&1.into(), &"bad.clip.json".into())
    );
    let said = report["unreadable"][0]["error"].as_str().unwrap();
    assert!(said.starts_with("bad.clip.json:1:"), "{said}");
    assert_eq!(report["files"].as_array().unwrap().len(), 1);
    // Only what was found is told. A gap that the program leads through is no warning; an unknown robot is.
    assert_eq!(again(&ran, &["clip", "check", "--strict", "a.clip.json"]).0, 0);
    let text = fs::read_to_string(ran.path("a.clip.json")).unwrap();
    fs::write(ran.path("b.clip.json"), text.replace("\"ur5e\"", "\"nobody\"")).unwrap();
    let (code, _, err) = again(&ran, &["clip", "check", "--strict", "b.clip.json"]);
    assert_eq!((code, err.as_str()), (4, "error: 1 warning\n"));
}

#[test]
fn a_take_is_no_format_to_convert_to() {
    let ran = new_arm();
    let (code, _, err) = again(&ran, &["clip", "convert", "a.clip.json", "x", "--to", "mcap"]);
    assert!(code == 2 && err.contains("[possible values: clip, csv, mjcf, ros, json]"), "{err}");
    let (code, _, err) = again(&ran, &["clip", "convert", "a.clip.json", "a.mcap"]);
    assert!(code == 2 && err.contains("robert export a.clip.json --to mcap -o a.mcap"), "{err}");
}

#[test]
fn a_length_below_zero_is_named() {
    let ran = robert().args(["clip", "new", "--robot", "ur5e", "--secs", "-1"]).fails(2);
    assert!(ran.stderr.contains("--secs takes a number above 0"), "{}", ran.stderr);
}

#[test]
fn a_pose_in_degrees_is_recognised_and_read() {
    let ran = new_arm();
    let ops =
        r#"{"op": "keys.add", "args": {"keys": [{"frame": 10, "q": [30, -70, 30, -60, 20]}]}}"#;
    fs::write(ran.path("ops.json"), ops).unwrap();
    assert_eq!(again(&ran, &["clip", "apply", "a.clip.json", "ops.json", "-i"]).0, 0);
    let (_, out, _) = again(&ran, &["clip", "check", "a.clip.json"]);
    assert!(out.contains("clips are in rad: are these degrees?"), "{out}");
    let (_, out, _) = again(&ran, &["clip", "check", "--fix", "a.clip.json"]);
    assert!(out.contains("Read the pose as degrees"), "{out}");
    let clip = fs::read_to_string(ran.path("a.clip.json")).unwrap();
    assert!(clip.contains("[0.523599, -1.22173, 0.523599, -1.047198, 0.349066]"), "{clip}");
}

#[test]
fn every_command_has_examples() {
    for command in ["new", "check", "fmt", "info", "apply", "diff", "convert", "schema", "upgrade"]
    {
        let ran = robert().args(["clip", command, "--help"]).succeeds();
        assert!(ran.stdout.contains("Example"), "{command}");
        assert!(ran.stdout.contains(&format!("robert clip {command}")), "{command}");
    }
}

#[test]
fn a_clip_that_another_program_changes_meanwhile_is_left_alone() {
    use std::io::Write;
    use std::process::{Command, Stdio};
    let ran =
        robert().args(["clip", "new", "--robot", "pointmass", "-o", "a.clip.json"]).succeeds();
    let path = ran.path("a.clip.json");
    let other = std::fs::read_to_string(&path).unwrap().replace("\"length\": ", "\"length\": 1");
    let mut child = Command::new(crate::run::binary())
        .args(["clip", "apply", "a.clip.json", "-", "-i"])
        .current_dir(ran.dir.path())
        .stdin(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdin = child.stdin.take().unwrap();
    // It has read the clip once it has taken more than a pipe holds.
    stdin.write_all(" ".repeat(200_000).as_bytes()).unwrap();
    std::fs::write(&path, &other).unwrap();
    stdin.write_all(br#"{"op": "clip.rename", "args": {"name": "x"}}"#).unwrap();
    drop(stdin);
    let ended = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert_eq!(ended.status.code(), Some(3), "{said}");
    assert!(said.contains("another program has changed this file"), "{said}");
    assert_eq!(std::fs::read_to_string(&path).unwrap(), other);
}

#[test]
fn clips_that_could_not_be_read_again_are_not_written() {
    let ran = robert()
        .args(["clip", "new", "--robot", "ur5e", "--name", "a\nb", "-o", "bad.clip.json"])
        .run();
    assert_eq!(ran.code, 3, "{}", ran.stderr);
    assert!(!ran.path("bad.clip.json").exists());
    let new = ["clip", "new", "--robot", "ur5e", "--name", " wave ", "-o", "wave.clip.json"];
    assert_eq!(again(&ran, &new).0, 0);
    let join = ["clip", "join", "wave.clip.json", "wave.clip.json", "-o", "two.clip.json"];
    let (code, _, err) = again(&ran, &join);
    assert_eq!(code, 0, "{err}");
    let joined = Clip::load(&ran.path("two.clip.json")).unwrap();
    assert!(joined.markers.iter().all(|m| m.name == "wave"), "{:?}", joined.markers);
}

#[test]
fn edits_with_keys_from_elsewhere_are_refused_before_anything_is_lost() {
    let ran = new_arm();
    let refused = |op: &str, said: &str| {
        fs::write(ran.path("op.json"), op).unwrap();
        let before = fs::read(ran.path("a.clip.json")).unwrap();
        let (code, _, err) = again(&ran, &["clip", "apply", "a.clip.json", "op.json", "-i"]);
        assert_eq!(code, 3, "{op}: {err}");
        assert!(err.contains(said), "{op}: {err}");
        assert_eq!(fs::read(ran.path("a.clip.json")).unwrap(), before);
    };
    let joint = &Clip::load(&ran.path("a.clip.json")).unwrap().robot.joints[0];
    refused(
        &format!(
            r#"{{"op":"keys.set","args":{{"frame":0,"pose":"nope","values":{{"{joint}":0.1}}}}}}"#
        ),
        "no pose \"nope\"",
    );
    refused(
        r#"{"op":"keys.paste","args":{"at":0,"keys":[{"frame":0,"pose":"nope"}],"replace":true}}"#,
        "no pose \"nope\"",
    );
    refused(
        r#"{"op":"keys.paste","args":{"at":0,"keys":[{"frame":0,"q":[0, null]}],"replace":true}}"#,
        "2 values",
    );
    refused(r#"{"op":"offsets.set","args":{"frame":3,"add":{},"hold":4}}"#, "no offset at frame 3");
}

#[test]
fn a_key_with_end_effector_goals_can_lose_its_last_value() {
    let ran = new_arm();
    let mut clip = Clip::load(&ran.path("a.clip.json")).unwrap();
    let joint = clip.robot.joints[0].clone();
    let ops = format!(
        r#"[{{"op":"keys.add","args":{{"keys":[{{"frame":20,"q":[0.2,null,null,null,null],
            "reach":[{{"site":"end_effector","pos":[0.5,0.2,1.9]}}]}}]}}}},
            {{"op":"keys.set","args":{{"frame":20,"values":{{"{joint}":null}}}}}}]"#
    );
    fs::write(ran.path("ops.json"), ops).unwrap();
    let (code, _, err) = again(&ran, &["clip", "apply", "a.clip.json", "ops.json", "-i"]);
    assert_eq!(code, 0, "{err}");
    clip = Clip::load(&ran.path("a.clip.json")).unwrap();
    let key = clip.key(20).unwrap();
    assert_eq!((&key.goal, key.reach.len()), (&Goal::Open, 1));
}

#[test]
fn a_table_with_two_starts_or_a_part_of_one_is_refused() {
    let ran = new_arm();
    assert_eq!(again(&ran, &["clip", "convert", "a.clip.json", "a.csv"]).0, 0);
    let text = fs::read_to_string(ran.path("a.csv")).unwrap();
    let (head, rows) = text.split_once('\n').unwrap();
    for (start, said) in [
        ("-1,-0.05,0,0,0,0,0,0\n-1,-0.05,0,0,0,0,0,1\n", "b.csv:3:1: "),
        ("-1,-0.05,0,0,0,0,0,\n", "b.csv:2:1: the start (frame -1) needs a value"),
    ] {
        fs::write(ran.path("b.csv"), format!("{head}\n{start}{rows}")).unwrap();
        let convert = ["clip", "convert", "b.csv", "b.clip.json", "--robot", "ur5e", "--force"];
        let (code, _, err) = again(&ran, &convert);
        assert!(code == 3 && err.contains(said), "{code}: {err}");
    }
    let (code, _, err) =
        again(&ran, &["clip", "convert", "a.clip.json", "c.csv", "--fill", "linear"]);
    assert!(code == 2 && err.contains("--fill"), "{code}: {err}");
}
