//! Child processes end with their parent, whatever ends it, and may do little.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::run::{binary, robert};

/// Longer than anything takes here; only a failure waits for it.
const PATIENCE: Duration = Duration::from_secs(60);

fn alive(pid: u32) -> bool {
    // What has ended and was not waited for is a zombie.
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    stat.rsplit_once(") ").is_some_and(|(_, rest)| !rest.starts_with('Z'))
}

/// The present value of a limit of a process; `None` if it has none.
pub(crate) fn limit(pid: u32, name: &str) -> Option<u64> {
    let limits = fs::read_to_string(format!("/proc/{pid}/limits")).unwrap();
    let line = limits.lines().find_map(|l| l.strip_prefix(name)).unwrap();
    line.split_whitespace().next()?.parse().ok()
}

fn wait_until(what: &str, mut done: impl FnMut() -> bool) {
    let begin = Instant::now();
    while !done() {
        assert!(begin.elapsed() < PATIENCE, "{what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// A shell that starts a child of this program as ours do, and waits. Gives the child's pid.
fn shell(dir: &Path, command: &str) -> (Child, u32) {
    let script =
        format!("ROBERT_PARENT=$$ {} {command} >/dev/null & echo $!; wait", binary().display());
    let mut shell = Command::new("sh")
        .args(["-c", &script])
        .current_dir(dir)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(shell.stdout.take().unwrap()).read_line(&mut line).unwrap();
    (shell, line.trim().parse().unwrap())
}

#[test]
fn the_check_of_a_model_is_confined_and_ends_with_its_parent() {
    let dir = tempfile::tempdir().unwrap();
    // Opening a pipe that nobody writes waits for ever: the child stays to be looked at.
    let pipe = dir.path().join("pipe.xml");
    rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, rustix::fs::Mode::RUSR).unwrap();
    let (mut shell, pid) = shell(dir.path(), "__compile-check pipe.xml");
    let status = || fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    wait_until("it gives up its rights", || status().contains("NoNewPrivs:\t1"));
    wait_until("it may write nothing", || limit(pid, "Max file size") == Some(0));
    // The kernel counts; what counts here is that it was given our figures.
    use robert::limits;
    wait_until("its processor time is limited", || {
        limit(pid, "Max cpu time") == Some(limits::CHECK_CPU_SECS)
    });
    wait_until("its memory is limited", || {
        limit(pid, "Max address space") == Some(limits::CHECK_MEMORY_BYTES)
    });
    assert!(alive(pid));
    shell.kill().unwrap();
    shell.wait().unwrap();
    wait_until("it ends", || !alive(pid));
}

#[test]
fn the_check_of_a_model_sees_its_folder_alone() {
    let model = |file: &str| format!("<mujoco><include file=\"{file}\"/></mujoco>");
    let part = "<mujoco><worldbody><body><joint/><geom size=\".1\"/></body></worldbody></mujoco>";
    let landlocked = landlock::Ruleset::default();
    use landlock::{Access, RulesetAttr};
    let landlocked = landlocked
        .handle_access(landlock::AccessFs::from_all(landlock::ABI::V1))
        .and_then(landlock::Ruleset::create)
        .unwrap();
    let landlocked = std::thread::spawn(move || landlocked.restrict_self().unwrap().ruleset);
    let landlocked = landlocked.join().unwrap() != landlock::RulesetStatus::NotEnforced;
    for (file, sees) in [("part.xml", true), ("../secret.xml", !landlocked)] {
        let ran = robert()
            .file("in/a.xml", model(file))
            .file("in/part.xml", part)
            .file("secret.xml", part)
            .args(["__compile-check", "in/a.xml"])
            .succeeds();
        assert_eq!(ran.json()["class"] == "ok", sees, "{file}: {}", ran.stdout);
    }
}

#[test]
fn a_job_ends_with_its_parent_and_can_go_on() {
    let dir = tempfile::tempdir().unwrap();
    let collect = "collect --robot pointmass --agent noise --transitions 400M --out data";
    let (mut shell, pid) = shell(dir.path(), collect);
    wait_until("it begins", || dir.path().join("data").is_dir());
    shell.kill().unwrap();
    shell.wait().unwrap();
    wait_until("it ends", || !alive(pid));
}
