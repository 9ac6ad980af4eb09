//! Pipes, devices, links and modes: what is no regular file is refused at once and left as
//! it is, and a saved file keeps what its owner gave it.

use std::fs;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::Path;

use crate::run::{Robert, robert};
use crate::studio::CLIP;

fn pipe(path: &Path) {
    rustix::fs::mkfifoat(rustix::fs::CWD, path, rustix::fs::Mode::RUSR).unwrap();
}

#[test]
fn a_pipe_is_refused_wherever_a_file_is_read() {
    for args in [
        &["clip", "check", "pipe"][..],
        &["rollout", "pipe"],
        &["import", "pipe", "--out", "bot"],
        &["robots", "show", "bot"],
        &["rollout", "--policy", "robert:pipe", "a.clip.json"],
        &["clip", "convert", "--from", "clip", "pipe", "a.csv"],
        &["studio", "--no-open", "pipe"],
    ] {
        let call = robert().file("a.clip.json", CLIP).file("bot/readme", "").args(args);
        pipe(&call.path("pipe"));
        pipe(&call.path("bot/robot.xml"));
        let ran = call.run();
        assert!(ran.code == 3 || ran.code == 5, "{args:?}: {} {}", ran.code, ran.stderr);
        assert!(ran.stderr.contains("pipe") || ran.stderr.contains("bot"), "{}", ran.stderr);
    }
}

#[test]
fn a_device_is_not_replaced_by_a_file() {
    let ran = robert()
        .args(["clip", "new", "--robot", "pointmass", "--secs", "5", "--force", "-o", "/dev/zero"])
        .run();
    assert_ne!(ran.code, 0);
    assert!(ran.stderr.contains("it is a device, not a regular file"), "{}", ran.stderr);
    assert!(!fs::metadata("/dev/zero").unwrap().is_file());
}

fn rename(call: Robert, name: &str) -> Robert {
    let op = r#"{"op": "clip.rename", "args": {"name": "changed"}}"#;
    call.file("op.json", op).args(["clip", "apply", name, "op.json", "--in-place"])
}

#[test]
fn an_edited_clip_keeps_its_mode_and_its_link() {
    let call = rename(robert().file("real/a.clip.json", CLIP), "link.clip.json");
    let real = call.path("real/a.clip.json");
    fs::set_permissions(&real, fs::Permissions::from_mode(0o600)).unwrap();
    symlink("real/a.clip.json", call.path("link.clip.json")).unwrap();
    let ran = call.succeeds();
    assert!(fs::read_to_string(ran.path("real/a.clip.json")).unwrap().contains("changed"));
    assert!(fs::symlink_metadata(ran.path("link.clip.json")).unwrap().is_symlink());
    let mode = fs::metadata(ran.path("real/a.clip.json")).unwrap().permissions().mode();
    assert_eq!(mode & 0o777, 0o600);
}

#[test]
fn what_has_the_journals_name_and_is_none_stays_as_it_is() {
    type Prepare = fn(&Path);
    let cases: [(&str, Prepare); 5] = [
        ("a symbolic link", |j| symlink("../victim", j).unwrap()),
        ("a symbolic link", |j| symlink("../missing", j).unwrap()),
        ("a symbolic link", |j| symlink("/dev/zero", j).unwrap()),
        ("a pipe", pipe),
        ("it holds something else", |j| fs::write(j, "somebody's notes").unwrap()),
    ];
    for (what, prepare) in cases {
        let call = robert().file("clips/wave.clip.json", CLIP).file("victim", "precious").args([
            "studio",
            "--no-open",
            "clips/wave.clip.json",
        ]);
        let journal = call.path("clips/wave.clip.json.autosave");
        prepare(&journal);
        let kind = fs::symlink_metadata(&journal).unwrap().file_type();
        let ran = call.fails(3);
        assert!(ran.stderr.contains(what) && ran.stderr.contains("move it away"), "{}", ran.stderr);
        let journal = ran.path("clips/wave.clip.json.autosave");
        assert_eq!(fs::symlink_metadata(&journal).unwrap().file_type(), kind);
        assert_eq!(fs::read(ran.path("victim")).unwrap(), b"precious");
        assert!(!ran.path("missing").exists());
        if kind.is_file() {
            assert_eq!(fs::read(&journal).unwrap(), b"somebody's notes");
        }
        assert_eq!(fs::read_to_string(ran.path("clips/wave.clip.json")).unwrap(), CLIP);
    }
}

#[test]
fn opening_what_is_not_there_makes_nothing() {
    let ran = robert().args(["studio", "--no-open", "no/such/folder/a.clip.json"]).fails(3);
    assert!(
        ran.stderr.contains("cannot read") && ran.stderr.contains("a.clip.json"),
        "{}",
        ran.stderr
    );
    assert!(!ran.path("no").exists());
}
