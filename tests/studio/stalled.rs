//! A disk that does not answer: who writes waits or is told, and nobody else notices.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use serde_json::json;

use super::client::{CLIP, Studio, key};

/// Takes the place of the calls that wait for a disk: while the file `STALLED` is there, they do
/// not return.
const DISK: &str = r#"
#define _GNU_SOURCE
#include <stdlib.h>
#include <sys/syscall.h>
#include <unistd.h>
static void answer(void) {
  const char *stalled = getenv("STALLED");
  while (stalled && access(stalled, F_OK) == 0) usleep(10000);
}
int fdatasync(int fd) { answer(); return syscall(SYS_fdatasync, fd); }
int fsync(int fd) { answer(); return syscall(SYS_fsync, fd); }
"#;

/// What a reader may wait: long for a page, far less than the two seconds after which readers once
/// gave the session up.
const SOON: Duration = Duration::from_millis(1500);

/// A studio with a clip on a disk that stalls while `dir/stalled` is there.
fn open(dir: &Path) -> (Studio, PathBuf) {
    std::fs::write(dir.join("disk.c"), DISK).unwrap();
    let built = Command::new("cc")
        .args(["-shared", "-fPIC", "-O1", "-o", "disk.so", "disk.c"])
        .current_dir(dir)
        .status();
    assert!(built.unwrap().success());
    std::fs::write(dir.join("a.clip.json"), CLIP).unwrap();
    let stalled = dir.join("stalled");
    let settings = [("LD_PRELOAD", dir.join("disk.so")), ("STALLED", stalled.clone())];
    let settings = settings.each_ref().map(|(name, path)| (*name, path.as_path()));
    let studio = Studio::try_start_with(dir, &["a.clip.json"], &settings).unwrap();
    studio.socket().ask("rollout.set", &json!({"policy": "computed-torque"}));
    (studio, stalled)
}

/// All that needs no disk is answered soon, with the document as it was last acknowledged.
fn reads_and_previews(studio: &Studio, keys: usize) {
    let mut socket = studio.socket();
    let soon = |what: &str, work: &mut dyn FnMut()| {
        let begin = Instant::now();
        work();
        assert!(begin.elapsed() < SOON, "{what}: {:?}", begin.elapsed());
    };
    soon("state", &mut || {
        let shown = studio.state()["document"]["clip"]["keys"].as_array().unwrap().len();
        assert_eq!(shown, keys, "what is not on disk is shown to nobody");
    });
    soon("clip", &mut || {
        let clip = studio.get("/api/clip").json();
        assert_eq!(clip["keys"].as_array().unwrap().len(), keys);
    });
    soon("export", &mut || assert_eq!(studio.get("/api/export?format=csv").status, 200));
    soon("preview", &mut || {
        let op = json!({"op": {"op": "keys.add", "args": key(20, 0.3)}});
        let answer = socket.ask("preview", &op);
        assert!(answer["error"].is_null(), "{answer}");
        assert!(socket.ask("preview.end", &json!({}))["error"].is_null());
    });
    soon("settings", &mut || {
        assert!(socket.ask("rollout.set", &json!({"policy": "pd"}))["error"].is_null());
    });
}

#[test]
fn a_disk_that_does_not_answer_holds_up_nobody_who_reads_or_previews() {
    let dir = tempfile::tempdir().unwrap();
    let (studio, stalled) = open(dir.path());
    let studio = &studio;
    let ops = |frame: u32| json!({"ops": [{"op": "keys.add", "args": key(frame, 0.1)}]});
    assert_eq!(studio.post("/api/ops", &ops(40)).status, 200);
    std::thread::scope(|s| {
        std::fs::write(&stalled, "").unwrap();
        let edit = s.spawn(|| studio.post("/api/ops", &ops(45)));
        let mut socket = studio.socket();
        let waiting = socket.send("keys.add", &key(50, 0.2));
        std::thread::sleep(Duration::from_millis(300));
        reads_and_previews(studio, 3);
        // Who waits for an edit goes on as well.
        let begin = Instant::now();
        let preview = json!({"op": {"op": "keys.add", "args": key(20, 0.3)}});
        assert!(socket.ask("preview", &preview)["error"].is_null());
        assert!(begin.elapsed() < SOON, "{:?}", begin.elapsed());
        assert!(!edit.is_finished());
        std::fs::remove_file(&stalled).unwrap();
        assert_eq!(edit.join().unwrap().status, 200);
        let answer = socket.answer(waiting);
        assert!(answer["error"].is_null(), "{answer}");
        let keys = studio.state()["document"]["clip"]["keys"].as_array().unwrap().len();
        assert_eq!(keys, 5, "acknowledged in order");
        // Saving waits for the same disk.
        std::fs::write(&stalled, "").unwrap();
        let save = s.spawn(|| studio.post("/api/save", &json!({})));
        std::thread::sleep(Duration::from_millis(300));
        reads_and_previews(studio, 5);
        assert!(!save.is_finished());
        std::fs::remove_file(&stalled).unwrap();
        assert_eq!(save.join().unwrap().status, 200);
        assert_eq!(studio.state()["document"]["dirty"], false);
    });
}

#[test]
fn a_disk_that_never_answers_ends_no_request_late_and_no_studio_late() {
    let dir = tempfile::tempdir().unwrap();
    let (studio, stalled) = open(dir.path());
    let ops = json!({"ops": [{"op": "keys.add", "args": key(40, 0.1)}]});
    std::fs::write(&stalled, "").unwrap();
    let mut socket = studio.socket();
    let waiting = socket.send("keys.add", &key(50, 0.2));
    let begin = Instant::now();
    // The socket is read meanwhile, as a page does: one that answers no ping for 30 s is closed.
    let answer = std::thread::scope(|s| {
        let answer = s.spawn(|| socket.answer(waiting));
        assert_eq!(studio.post("/api/ops", &ops).status, 408);
        assert!(begin.elapsed() < Duration::from_secs(33), "{:?}", begin.elapsed());
        answer.join().unwrap()
    });
    assert!(answer["error"]["message"].as_str().unwrap().contains("has not answered"), "{answer}");
    std::thread::sleep(Duration::from_millis(500));
    // From then on nothing more is taken, and that is said at once.
    let begin = Instant::now();
    let refused = studio.post("/api/ops", &ops);
    assert_eq!(refused.status, 500);
    assert!(refused.json()["message"].as_str().unwrap().contains("nothing was changed"));
    assert!(begin.elapsed() < SOON, "{:?}", begin.elapsed());
    reads_and_previews(&studio, 2);
    let (_, took, _) = studio.terminate();
    assert!(took < Duration::from_secs(4), "{took:?}");
}
