//! Files in: folders that can be looked into, clips of other formats, the window of its own.

use std::os::unix::fs::{PermissionsExt, symlink};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::json;

use super::client::{CLIP, Studio, key};
use crate::run::{binary, call};

#[test]
fn folders_show_clips_and_nothing_outside() {
    let dir = tempfile::tempdir().unwrap();
    let mine = dir.path().join("mine");
    std::fs::create_dir_all(mine.join("walks")).unwrap();
    std::fs::write(mine.join("walks/a.clip.json"), CLIP).unwrap();
    std::fs::write(dir.path().join("above.clip.json"), CLIP).unwrap();
    symlink(dir.path(), mine.join("up")).unwrap();
    let studio = Studio::start(&mine, &[]);
    let seen = studio.get("/api/files").json();
    assert!(seen["folders"].as_array().unwrap().contains(&json!("walks")), "{seen}");
    assert!(!seen.to_string().contains("above"), "{seen}");
    assert!(!seen["folders"].as_array().unwrap().contains(&json!("up")), "{seen}");
    let seen = studio.get("/api/files?dir=walks").json();
    assert_eq!(seen["files"][0]["clip"]["robot"], "ur5e", "{seen}");
    for bad in
        ["..", "walks%2F..%2F..", "up", "%2Fetc", "%2e%2e", "walks%00", "walks%2Fa.clip.json"]
    {
        let answer = studio.get(&format!("/api/files?dir={bad}"));
        assert!((400..500).contains(&answer.status), "{bad}: {answer:?}");
        assert!(!String::from_utf8_lossy(&answer.body).contains("above"), "{bad}");
    }
    // Another folder, because it was named.
    let root = dir.path().display().to_string().replace('/', "%2F");
    let seen = studio.get(&format!("/api/files?root={root}")).json();
    assert_eq!(seen["files"][0]["name"], "above.clip.json", "{seen}");
    assert!((400..500).contains(&studio.get("/api/files?root=%2Fno%2Fsuch").status));
    let text = "GET /api/files HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n";
    assert_eq!(studio.raw(text.as_bytes()).status, 403, "the guard stands before it");
}

#[test]
fn a_file_of_any_format_becomes_a_clip_with_the_errors_of_the_shell() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("a.clip.json"), CLIP).unwrap();
    for ending in ["csv", "xml", "yaml", "json"] {
        let to = format!("back.{ending}");
        let (code, _, err) = call(dir.path(), &["clip", "convert", "a.clip.json", &to]);
        assert_eq!(code, 0, "{ending}: {err}");
    }
    let studio = Studio::start(dir.path(), &[]);
    let text = |name: &str| std::fs::read_to_string(dir.path().join(name)).unwrap();
    let refused = studio.call("POST", "/api/clips?name=back.csv", Some(&text("back.csv")));
    assert_eq!(refused.status, 400, "whose is it?");
    for name in ["back.csv", "back.xml", "back.yaml", "back.json", "a.clip.json"] {
        let sent = format!("/api/clips?name=C:%5Cfake%5C{name}&robot=ur5e");
        let view = studio.call("POST", &sent, Some(&text(name)));
        assert_eq!(view.status, 200, "{name}: {view:?}");
        let clip = view.json()["clip"].clone();
        assert_eq!(clip["robot"]["id"], "ur5e", "{name}");
        assert_eq!(clip["name"], if name == "a.clip.json" { "start" } else { "back" });
        // The goals are those that were written.
        let path = format!("/api/clips?path={name}&robot=ur5e");
        let again = studio.call("POST", &path, None);
        assert_eq!(again.json()["clip"], clip, "{name} from the folder");
        if name != "a.clip.json" {
            let command = |body: Vec<u8>| {
                let csv = String::from_utf8(body).unwrap();
                csv.lines().map(|l| l.trim().to_owned()).collect::<Vec<_>>()
            };
            let got = command(studio.get("/api/export?format=csv").body);
            assert_eq!(got, command(text("back.csv").into_bytes()), "{name}");
        }
    }
    // With a clip open, its robot is taken.
    let view = studio.call("POST", "/api/clips?name=back.csv", Some(&text("back.csv")));
    assert_eq!(view.status, 200, "{view:?}");
    // The same words as on the command line, at the same place.
    for (name, bad) in [
        ("bad.csv", "frame,time,mask,shoulder_pan\n0,0,0,1\n0,0,0,2\n"),
        ("bad.xml", "<mujoco><keyframe><key qpos='1 2'/></keyframe></mujoco>"),
        ("bad.yaml", "joint_names: [a]\n"),
        ("bad.clip.json", "{\n  \"format\": 7\n}"),
    ] {
        std::fs::write(dir.path().join(name), bad).unwrap();
        let (code, _, err) =
            call(dir.path(), &["clip", "convert", name, "out.clip.json", "--robot", "ur5e"]);
        assert_eq!(code, 3, "{name}: {err}");
        let said = studio.call("POST", &format!("/api/clips?name={name}&robot=ur5e"), Some(bad));
        assert!((400..500).contains(&said.status), "{name}");
        let message = said.json()["message"].as_str().unwrap().to_owned();
        assert_eq!(message, err.trim().trim_start_matches("error: "), "{name}");
    }
    for odd in ["x.exe", "", ".csv", "csv"] {
        let status = studio.call("POST", &format!("/api/clips?name={odd}"), Some("1")).status;
        assert_eq!(status, 400, "{odd:?}");
    }
    let head = format!(
        "POST /api/clips?name=big.csv&robot=ur5e HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n\
         Authorization: Bearer {}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
        studio.port,
        studio.token,
        (16 << 20) + 1
    );
    let mut request = head.into_bytes();
    request.resize(request.len() + (16 << 20) + 1, b'1');
    assert_eq!(studio.raw(&request).status, 413, "one byte too many");
}

/// A `chromium` that notes how it was called.
fn pretend(bin: &std::path::Path, name: &str) {
    let script = format!("#!/bin/sh\nprintf '%s\\n' \"{name} $*\" >> \"$CALLS\"\n");
    std::fs::write(bin.join(name), script).unwrap();
    std::fs::set_permissions(bin.join(name), std::fs::Permissions::from_mode(0o755)).unwrap();
}

#[test]
fn app_opens_a_window_of_its_own_and_falls_back_to_the_browser() {
    for (browsers, args, wanted) in [
        (&["chromium", "xdg-open"][..], &["--app"][..], "chromium --app=URL"),
        (&["microsoft-edge", "xdg-open"], &["--app"], "microsoft-edge --app=URL"),
        (&["xdg-open"], &["--app"], "xdg-open URL"),
        (&["chromium", "xdg-open"], &[], "xdg-open URL"),
    ] {
        let dir = tempfile::tempdir().unwrap();
        let bin = dir.path().join("bin");
        std::fs::create_dir(&bin).unwrap();
        browsers.iter().for_each(|b| pretend(&bin, b));
        let calls = dir.path().join("calls");
        let mut child = Command::new(binary())
            .arg("studio")
            .args(args)
            .current_dir(dir.path())
            .env("PATH", &bin)
            .env("CALLS", &calls)
            .env("ROBERT_STATE_DIR", dir.path().join("state"))
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut line = String::new();
        let mut out = std::io::BufReader::new(child.stdout.take().unwrap());
        std::io::BufRead::read_line(&mut out, &mut line).unwrap();
        let begin = Instant::now();
        let called = loop {
            let found = std::fs::read_to_string(&calls).unwrap_or_default();
            if found.ends_with('\n') || begin.elapsed() > Duration::from_secs(20) {
                break found;
            }
            std::thread::sleep(Duration::from_millis(10));
        };
        child.kill().unwrap();
        child.wait().unwrap();
        let (address, token) = line.trim().split_once("#token=").unwrap();
        let (start, code) = called.trim().split_once("#token=").unwrap();
        assert_eq!(format!("{start}#"), wanted.replace("URL", &format!("{address}#")));
        assert!(!called.contains(token), "everybody can read it: {browsers:?} {args:?}");
        assert_eq!(code.len(), token.len());
    }
    // Without a browser to open there is no window to be had.
    let (code, _, err) = call(std::env::temp_dir().as_path(), &["studio", "--app", "--no-open"]);
    assert_eq!(code, 2, "{err}");
}

#[test]
fn a_file_that_another_program_changed_is_not_overwritten_without_a_word() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("wave.clip.json");
    std::fs::write(&path, CLIP).unwrap();
    let studio = Studio::start(dir.path(), &["wave.clip.json"]);
    let mut socket = studio.socket();
    socket.ask("keys.add", &key(45, 0.3));
    let other = CLIP.replace("\"start\"", "\"theirs\"");
    assert_ne!(other, CLIP);
    std::fs::write(&path, &other).unwrap();
    let refused = studio.post("/api/save", &json!({}));
    assert_eq!((refused.status, refused.json()["code"].clone()), (409, json!("changed")));
    assert_eq!(std::fs::read_to_string(&path).unwrap(), other);
    assert_eq!(studio.post("/api/reload", &json!({})).status, 200);
    let state = studio.state();
    assert_eq!(state["document"]["clip"]["name"], "theirs");
    assert_eq!(state["document"]["dirty"], false);
    studio.post("/api/undo", &json!({}));
    assert_eq!(studio.state()["document"]["clip"]["name"], "start");
    assert_eq!(studio.post("/api/save", &json!({})).status, 200);
    std::fs::write(&path, &other).unwrap();
    assert_eq!(studio.post("/api/save", &json!({"replace": true})).status, 200);
    assert_ne!(std::fs::read_to_string(&path).unwrap(), other);
}
