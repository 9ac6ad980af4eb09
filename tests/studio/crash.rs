//! Kill it at any moment: what was acknowledged is there.

use std::time::{Duration, Instant};

use robert::rng::{Rng, Stream};
use serde_json::json;

use super::client::{CLIP, Socket, Studio, key};
use crate::clip::generate;

/// Kills in a test run; `ROBERT_KILLS=200` for the long one.
fn kills() -> u64 {
    std::env::var("ROBERT_KILLS").ok().and_then(|k| k.parse().ok()).unwrap_or(24)
}

fn round(seed: u64) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.clip.json");
    // Not in our own layout: undoing everything must give back these very bytes.
    let text = CLIP.replace("\n    {", "\n        {");
    std::fs::write(&path, &text).unwrap();
    let mut studio = Studio::start(dir.path(), &["a.clip.json"]);
    let mut rng = Rng::new(seed, Stream::Test, 70);
    let until = Duration::from_millis(rng.below(400));
    let port_token = (studio.port, studio.token.clone());
    let mut socket = studio.socket();
    let (acked, sent) = std::thread::scope(|scope| {
        let editing = scope.spawn(move || {
            let (mut acked, mut sent) = (0, 0);
            loop {
                sent += 1;
                let done = match sent % 7 {
                    3 => try_ask(
                        &mut socket,
                        "keys.add",
                        &key(sent % 50 + 5, 0.01 * f64::from(sent)),
                    ),
                    _ => try_ask(&mut socket, "clip.rename", &json!({"name": format!("n{sent}")})),
                };
                if !done {
                    return (acked, sent);
                }
                acked = sent;
            }
        });
        std::thread::sleep(until);
        studio.kill();
        editing.join().unwrap()
    });
    let studio = Studio::start(dir.path(), &["a.clip.json"]);
    assert_ne!((studio.port, studio.token.clone()), port_token);
    let state = studio.state();
    let done = state["document"]["history"]["done"].as_u64().unwrap();
    assert!(
        u64::from(acked) <= done && done <= u64::from(sent),
        "seed {seed}: {acked} acknowledged, {sent} sent, {done} there"
    );
    if done > 0 {
        assert_eq!(state["document"]["restored"]["edits"], done, "seed {seed}");
        let named = (1..=done).rev().find(|n| n % 7 != 3).map(|n| format!("n{n}"));
        let name = state["document"]["clip"]["name"].as_str().unwrap_or_default();
        assert_eq!(name, named.as_deref().unwrap_or("start"), "seed {seed}");
    }
    let mut socket = studio.socket();
    socket.ask("history.goto", &json!({"done": 0}));
    assert_eq!(String::from_utf8(studio.get("/api/clip").body).unwrap(), text, "seed {seed}");
    assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
}

/// Whether it was acknowledged before the end.
fn try_ask(socket: &mut Socket, op: &str, args: &serde_json::Value) -> bool {
    let text = json!({"id": 1, "op": op, "args": args}).to_string();
    if socket.send_frame(1, text.as_bytes()).is_err() {
        return false;
    }
    loop {
        let Some(payload) = socket.read() else { return false };
        let event: serde_json::Value = serde_json::from_slice(&payload).unwrap();
        assert_ne!(event["event"], "reply", "refused: {event}");
        if event["event"] == "edit" {
            return true;
        }
    }
}

#[test]
fn kill_at_any_moment_loses_no_acknowledged_edit() {
    let next = std::sync::atomic::AtomicU64::new(0);
    std::thread::scope(|scope| {
        for _ in 0..3 {
            scope.spawn(|| {
                loop {
                    let seed = next.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                    if seed >= kills() {
                        return;
                    }
                    round(seed);
                }
            });
        }
    });
}

/// Rounds of two hundred edits; `ROBERT_ROUNDS=100` for the long test.
fn rounds() -> u64 {
    std::env::var("ROBERT_ROUNDS").ok().and_then(|k| k.parse().ok()).unwrap_or(2)
}

/// Any edits there are, in any order, undo and redo among them; then the power fails.
fn two_hundred_edits(seed: u64) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.clip.json");
    let text = CLIP.replace("\n    {", "\n        {");
    std::fs::write(&path, &text).unwrap();
    let mut studio = Studio::start(dir.path(), &["a.clip.json"]);
    let mut socket = studio.socket();
    socket.ask("rollout.set", &json!({"policy": "zero", "auto": false}));
    let mut rng = Rng::new(seed, Stream::Test, 71);
    let mut clip = robert::clip::Clip::parse(&text).unwrap();
    let (mut taken, mut refused) = (0, 0);
    for n in 0..200 {
        let answer = match rng.below(10) {
            0 => socket.ask("undo", &json!({})),
            1 => socket.ask("redo", &json!({})),
            _ => {
                let op = serde_json::to_value(generate::op(&mut rng, &clip, true)).unwrap();
                socket.ask(op["op"].as_str().unwrap(), &op["args"])
            }
        };
        if answer["error"].is_null() {
            taken += 1;
        } else {
            refused += 1;
        }
        // Edits that make sense need the clip as it is now; a glance now and then is enough.
        if n % 4 == 0 {
            let now = String::from_utf8(studio.get("/api/clip").body).unwrap();
            clip = robert::clip::Clip::parse(&now).unwrap();
        }
    }
    assert!(taken > 60 && refused > 0, "seed {seed}: {taken} taken, {refused} refused");
    let before = (studio.get("/api/clip").body, studio.state()["document"]["clip"].clone());
    studio.kill();
    let studio = Studio::start(dir.path(), &["a.clip.json"]);
    assert_eq!(studio.get("/api/clip").body, before.0, "seed {seed}");
    assert_eq!(studio.state()["document"]["clip"], before.1, "seed {seed}");
    let mut socket = studio.socket();
    socket.ask("history.goto", &json!({"done": 0}));
    assert_eq!(String::from_utf8(studio.get("/api/clip").body).unwrap(), text, "seed {seed}");
    assert_eq!(std::fs::read_to_string(&path).unwrap(), text, "seed {seed}");
}

#[test]
fn two_hundred_edits_of_any_kind_survive_a_kill() {
    for seed in 0..rounds() {
        two_hundred_edits(seed);
    }
}

#[test]
fn an_unsaved_clip_comes_back_and_can_be_saved() {
    let dir = tempfile::tempdir().unwrap();
    let mut studio = Studio::start(dir.path(), &["--robot", "pointmass"]);
    assert_eq!(
        studio
            .post("/api/ops", &json!({"ops": [{"op": "clip.rename", "args": {"name": "mine"}}]}))
            .status,
        200
    );
    studio.kill();
    let studio = Studio::start(dir.path(), &[]);
    let state = studio.state();
    assert_eq!(state["document"]["clip"]["name"], "mine");
    assert_eq!(state["document"]["restored"]["edits"], 1);
    assert_eq!(studio.post("/api/save", &json!({})).status, 409);
    // Another file of that name is not replaced unless that is said.
    std::fs::write(dir.path().join("mine.clip.json"), "dear to someone").unwrap();
    let refused = studio.post("/api/save", &json!({"path": "mine.clip.json"}));
    assert_eq!(
        (refused.status, refused.json()["code"].as_str()),
        (409, Some("exists")),
        "{refused:?}"
    );
    assert_eq!(std::fs::read(dir.path().join("mine.clip.json")).unwrap(), b"dear to someone");
    let saved = studio.post("/api/save", &json!({"path": "mine.clip.json", "replace": true}));
    assert_eq!(saved.status, 200, "{saved:?}");
    let text = std::fs::read(dir.path().join("mine.clip.json")).unwrap();
    assert_eq!(studio.get("/api/clip").body, text);
    assert_eq!(studio.get("/api/recent").json()[0]["name"], "mine");
    let (code, ..) = studio.terminate();
    assert_eq!(code, 0);
    assert!(!dir.path().join("mine.clip.json.autosave").exists(), "nothing unsaved is left");
}

#[test]
fn only_a_killed_studio_is_taken_up_again_and_a_robot_goes_before_it() {
    let dir = tempfile::tempdir().unwrap();
    let rename = |studio: &Studio, name: &str| {
        let ops = json!({"ops": [{"op": "clip.rename", "args": {"name": name}}]});
        assert_eq!(studio.post("/api/ops", &ops).status, 200);
    };
    // Ended by hand: the clip is kept, but the next start is a start.
    let studio = Studio::start(dir.path(), &["--robot", "pointmass"]);
    rename(&studio, "put away");
    assert_eq!(studio.terminate().0, 0);
    let studio = Studio::start(dir.path(), &[]);
    assert!(studio.state()["document"].is_null(), "the gallery, not the clip of last week");
    let drafts = studio.get("/api/drafts").json();
    assert_eq!((&drafts[0]["name"], &drafts[0]["abandoned"]), (&json!("put away"), &json!(false)));
    drop(studio);
    // Killed, and started for another robot: that robot, and the clip waits.
    let mut studio = Studio::start(dir.path(), &["--robot", "pointmass"]);
    rename(&studio, "killed");
    studio.kill();
    let studio = Studio::start(dir.path(), &["--robot", "ur5e"]);
    assert_eq!(studio.state()["document"]["clip"]["robot"]["id"], "ur5e");
    let drafts = studio.get("/api/drafts").json();
    let killed = drafts.as_array().unwrap().iter().find(|d| d["name"] == "killed").unwrap();
    assert_eq!(killed["abandoned"], true);
    assert_eq!(studio.terminate().0, 0);
    // Nobody has seen it yet: a plain start brings it, even after that one ended well.
    let studio = Studio::start(dir.path(), &[]);
    assert_eq!(studio.state()["document"]["clip"]["name"], "killed");
    assert_eq!(studio.state()["document"]["restored"]["edits"], 1);
    assert_eq!(studio.terminate().0, 0);
    assert!(Studio::start(dir.path(), &[]).state()["document"].is_null());
}

#[test]
fn a_plain_start_brings_the_file_that_a_killed_studio_had_open() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["a", "b"] {
        std::fs::write(dir.path().join(format!("{name}.clip.json")), CLIP).unwrap();
    }
    let mut studio = Studio::start(dir.path(), &["a.clip.json"]);
    studio.socket().ask("clip.rename", &json!({"name": "killed"}));
    studio.kill();
    // Another file in between, and that studio ended well.
    assert_eq!(Studio::start(dir.path(), &["b.clip.json"]).terminate().0, 0);
    let studio = Studio::start(dir.path(), &[]);
    let document = studio.state()["document"].clone();
    assert!(document["path"].as_str().unwrap().ends_with("a.clip.json"), "{document}");
    assert_eq!(
        (&document["clip"]["name"], &document["restored"]["edits"]),
        (&json!("killed"), &json!(1))
    );
    assert_eq!(studio.terminate().0, 0);
    assert!(Studio::start(dir.path(), &[]).state()["document"].is_null(), "put away this time");
    let studio = Studio::start(dir.path(), &["a.clip.json"]);
    let document = studio.state()["document"].clone();
    assert_eq!(document["clip"]["name"], "killed", "and still there");
    assert!(document["restored"].is_null() && document["dirty"] == true, "{document}");
}

#[test]
fn terminates_quickly_and_a_second_one_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("a.clip.json"), CLIP).unwrap();
    let studio = Studio::start(dir.path(), &["a.clip.json"]);
    studio.socket().ask("clip.rename", &json!({"name": "unsaved"}));
    let refused = Studio::try_start(dir.path(), &["a.clip.json"]).unwrap_err();
    assert!(refused.contains("another studio has this clip open"), "{refused}");
    let begin = Instant::now();
    let token = studio.token.clone();
    let (code, _, log) = studio.terminate();
    assert_eq!(code, 0);
    assert!(begin.elapsed() < Duration::from_secs(2));
    assert!(!log.contains(&token), "the token was logged");
    let studio = Studio::start(dir.path(), &["a.clip.json"]);
    assert_eq!(studio.state()["document"]["clip"]["name"], "unsaved");
    // Ctrl-C is no other end.
    studio.socket().ask("clip.rename", &json!({"name": "interrupted"}));
    let (code, time, _) = studio.end(rustix::process::Signal::INT);
    assert!(code == 0 && time < Duration::from_secs(2), "{code} after {time:?}");
    // A killed one leaves its lock to nobody.
    let mut studio = Studio::start(dir.path(), &["a.clip.json"]);
    assert_eq!(studio.state()["document"]["clip"]["name"], "interrupted");
    studio.kill();
    Studio::start(dir.path(), &["a.clip.json"]);
}
