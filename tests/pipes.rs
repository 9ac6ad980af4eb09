//! `-` and the shell's pipes stand where files do.

use std::process::Command;

use super::motion::HOP;
use super::run::{binary, robert};

/// Runs a line of bash in a folder with a clip.
fn bash(line: &str) -> (Option<i32>, String, String) {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("hop.clip.json"), HOP).unwrap();
    let path = format!("{}:{}", binary().parent().unwrap().display(), env!("PATH"));
    let out = Command::new("bash")
        .args(["-c", line])
        .env("PATH", path)
        .current_dir(dir.path())
        .output()
        .unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    // Nothing is ever written to a file of that name.
    assert!(!dir.path().join("-").exists(), "{line}");
    (out.status.code(), text(&out.stdout), text(&out.stderr))
}

fn succeeds(line: &str) -> String {
    let (code, out, err) = bash(line);
    assert_eq!(code, Some(0), "{line}: {err}");
    out
}

#[test]
fn clips_and_takes_come_from_stdin_and_pipes() {
    let plain = succeeds("robert rollout hop.clip.json --policy pd --csv -");
    for line in [
        "robert rollout - --policy pd --csv - < hop.clip.json",
        "robert rollout <(cat hop.clip.json) --policy pd --csv -",
        "robert clip fmt - < hop.clip.json | robert rollout - --policy pd --csv -",
    ] {
        assert_eq!(succeeds(line), plain, "{line}");
    }
    let performed = succeeds("robert export hop.clip.json --policy pd --to csv");
    for line in [
        "robert rollout hop.clip.json --policy pd --out - | robert export - --to csv",
        "robert export <(robert rollout hop.clip.json --policy pd --out -) --to csv -o -",
    ] {
        assert_eq!(succeeds(line), performed, "{line}");
    }
    let eval = "robert eval --suite <(cat hop.clip.json) --policy pd --no-floor --csv -";
    let table = succeeds(eval);
    assert!(table.starts_with("suite,task,policy") && table.contains(",hop,"), "{table}");
}

#[test]
fn edits_and_conversions_go_through_pipes() {
    let ops = r#"'{"op": "keys.hold", "args": {"frames": [12], "hold": 4}}'"#;
    let out = succeeds(&format!("robert clip apply hop.clip.json <(echo {ops})"));
    assert!(out.contains(r#""hold": 4"#), "{out}");
    assert_eq!(succeeds(&format!("echo {ops} | robert clip apply hop.clip.json - -o -")), out);
    assert_eq!(succeeds(&format!("robert clip apply - <(echo {ops}) < hop.clip.json")), out);
    let csv = succeeds("robert clip convert hop.clip.json - --to csv");
    assert!(csv.starts_with("frame,"), "{csv}");
    assert_eq!(succeeds("robert clip convert - - --to csv < hop.clip.json"), csv);
    let back = succeeds(
        "robert clip convert hop.clip.json - --to csv | robert clip convert - - --from csv --robot pointmass",
    );
    assert!(back.contains("robert-clip/1"), "{back}");
    succeeds("robert clip diff <(cat hop.clip.json) - --exit-code < hop.clip.json");
    succeeds("robert clip check - < hop.clip.json && robert clip info - < hop.clip.json");
    let plot =
        succeeds("robert rollout hop.clip.json --policy pd --out - | robert plot joints - -o -");
    assert!(plot.contains("<svg"), "{plot}");
}

#[test]
fn a_fixed_clip_from_stdin_goes_to_stdout() {
    let far = HOP.replace("0.2, -0.1", "3, -0.1");
    let line = format!("robert clip check --fix - <<'END'\n{far}\nEND");
    let (code, out, err) = bash(&line);
    assert_eq!(code, Some(0), "{err}");
    assert!(out.starts_with('{') && out.contains("robert-clip/1"), "{out}");
    assert!(err.contains("stdin: fixed") && err.contains("the clip now lasts"), "{err}");
}

#[test]
fn models_come_from_stdin_and_pictures_go_to_stdout() {
    let model = r#"<mujoco><worldbody><body><joint name=\"a\"/><geom size=\".1\"/></body></worldbody><actuator><motor joint=\"a\" ctrlrange=\"-1 1\"/></actuator></mujoco>"#;
    for line in [
        format!("echo \"{model}\" | robert import - --out arm --json"),
        format!("robert import <(echo \"{model}\") --out arm --json"),
    ] {
        let report = succeeds(&line);
        assert!(
            report.contains(r#""action_dim":1"#) || report.contains(r#""action_dim": 1"#),
            "{report}"
        );
    }
    // Meshes are found as if the model lay in the current folder.
    let tetrahedron = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    let meshed = model
        .replace("<worldbody>", r#"<asset><mesh name=\"m\" file=\"m.obj\"/></asset><worldbody>"#)
        .replace(r#"size=\".1\""#, r#"type=\"mesh\" mesh=\"m\""#);
    let line = format!(
        "printf '{tetrahedron}' > m.obj; echo \"{meshed}\" | robert import - --out arm --json"
    );
    let report = succeeds(&line);
    assert!(report.contains(r#""files":1"#) || report.contains(r#""files": 1"#), "{report}");
    // The limit of includes and meshes does not move the model.
    let inner = format!(
        "mkdir sub; printf '{tetrahedron}' > sub/m.obj; cd sub; echo \"{meshed}\" | robert import - --root .. --out arm"
    );
    succeeds(&inner);
    let missing =
        format!("echo \"{meshed}\" | robert import - --out arm; code=$?; ls -A; exit $code");
    let (code, left, error) = bash(&missing);
    assert_eq!(code, Some(3), "{error}");
    assert!(error.contains("m.obj") && error.contains("stdin"), "{error}");
    assert!(!error.contains(".robert-tmp") && !left.contains(".robert-tmp"), "{error}{left}");

    let (code, _, error) = bash("echo '<mujoco><body/></mujoco>' | robert import - --out arm");
    assert_eq!(code, Some(3), "{error}");
    assert!(error.contains("stdin") && !error.contains(".robert-tmp"), "{error}");
    let (code, _, error) = bash(&format!("echo \"{model}\" | robert new - --out arm"));
    assert_eq!(code, Some(2), "{error}");
    assert!(error.contains("robert import -"), "{error}");

    let file = "robert render hop.clip.json --kinematic --size 64x64 -o hop.png";
    let same = format!(
        "{file} >&2 && robert render - --kinematic --size 64x64 -o - < hop.clip.json | cmp - hop.png"
    );
    succeeds(&same);
    let (code, _, error) = bash("robert render hop.clip.json --kinematic -o - --json");
    assert_eq!(code, Some(2), "{error}");
}

#[test]
fn stdin_holds_one_thing_and_stdout_too() {
    let twice = "robert clip apply - - < hop.clip.json";
    assert_eq!(bash(twice).0, Some(2));
    let two = "robert rollout hop.clip.json --policy pd --csv - --json";
    assert_eq!(bash(two).0, Some(2));
    // What is no clip says where it came from.
    let (code, _, err) = bash("echo '{' | robert clip check -");
    assert!(code == Some(3) && err.contains("stdin:"), "{err}");
    let gone = robert().args(["clip", "check", "gone.clip.json"]).fails(3);
    assert!(gone.stderr.contains("gone.clip.json"), "{}", gone.stderr);
}

#[test]
fn messages_that_nobody_can_hear_end_no_work() {
    let dir = tempfile::tempdir().unwrap();
    for args in [
        &["collect", "--robot", "pointmass", "--transitions", "2000", "--out", "data"][..],
        &["fit", "ridge", "--data", "data", "--out", "fit"],
        &[
            "train",
            "--robot",
            "pointmass",
            "--data",
            "data",
            "--preset",
            "instant",
            "--set",
            "steps=2",
            "--out",
            "run",
        ],
        &["rollout", "circle", "-p", "pd", "-o", "circle.mcap"],
        &["export", "circle.mcap", "--to", "glb", "-o", "circle.glb"],
    ] {
        let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
        let out = std::process::Command::new(crate::run::binary())
            .args(args)
            .current_dir(dir.path())
            .stdin(std::process::Stdio::null())
            .stderr(full)
            .output()
            .unwrap();
        assert_eq!(out.status.code(), Some(0), "{args:?}");
    }
}

#[test]
fn json_lines_are_for_commands_that_print_json() {
    let ran = robert().args(["--jsonl", "completions", "bash"]).fails(2);
    assert!(ran.stderr.contains("--jsonl is only for commands that have --json"), "{}", ran.stderr);
    let ran = robert().args(["robots", "ls", "--jsonl"]).succeeds();
    assert_eq!(ran.stdout.lines().count(), 1, "{}", ran.stdout);
    // An argument behind `--` is no option.
    let ran = robert().args(["robots", "show", "--", "--jsonl"]).fails(3);
    assert!(ran.stdout.is_empty() && ran.stderr.contains("--jsonl"), "{}", ran.stderr);
}
