//! The simulation is a process of its own: it may die, the document may not.

use std::time::{Duration, Instant};

use robert::limits;
use rustix::process::Signal;
use serde_json::{Value, json};

use super::client::{CLIP, Studio, key, signal};
use crate::children::limit;

fn open(dir: &tempfile::TempDir) -> Studio {
    std::fs::write(dir.path().join("a.clip.json"), CLIP).unwrap();
    Studio::start(dir.path(), &["a.clip.json"])
}

fn worker(studio: &Studio, phase: &str) -> Value {
    let begin = Instant::now();
    loop {
        let worker = studio.state()["worker"].clone();
        if worker["phase"] == phase {
            return worker;
        }
        assert!(begin.elapsed() < Duration::from_secs(10), "{worker}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn a_dead_simulation_takes_nothing_along() {
    let dir = tempfile::tempdir().unwrap();
    let studio = open(&dir);
    studio.rolled_out(0);
    let mut socket = studio.socket();
    for (n, kind) in [Signal::ABORT, Signal::STOP].into_iter().enumerate() {
        let before = worker(&studio, "ready");
        signal(before["pid"].as_u64().unwrap() as u32, kind);
        let begin = Instant::now();
        let ack = socket.ask("keys.add", &key(40 + n as u32, 0.1));
        assert!(begin.elapsed() < Duration::from_millis(500), "editing waits for nobody");
        let rollout = studio.rolled_out(ack["rev"].as_u64().unwrap());
        assert_eq!(rollout["state"]["phase"], "done");
        assert!(begin.elapsed() < Duration::from_secs(4), "{kind:?}: {:?}", begin.elapsed());
        let after = worker(&studio, "ready");
        assert_eq!(after["deaths"], n as u64 + 1);
        assert_ne!(after["pid"], before["pid"]);
    }
    signal(worker(&studio, "ready")["pid"].as_u64().unwrap() as u32, Signal::KILL);
    let stopped = worker(&studio, "stopped");
    assert!(stopped["reason"].as_str().unwrap().contains("3 times"), "{stopped}");
    assert_eq!(studio.post("/api/settle", &json!({"q": [0, 0, 0, 0, 0]})).status, 503);
    assert_eq!(socket.ask("keys.add", &key(50, 0.2))["event"], "edit");
    socket.ask("worker.restart", &json!({}));
    let state = studio.state();
    let rollout = studio.rolled_out(state["document"]["rev"].as_u64().unwrap());
    assert_eq!(rollout["q"].as_array().unwrap().len(), 60);
    assert_eq!(state["document"]["history"]["done"], 3);
}

#[test]
fn the_simulation_has_the_limits_that_are_written_down() {
    let dir = tempfile::tempdir().unwrap();
    let studio = open(&dir);
    studio.rolled_out(0);
    let pid = worker(&studio, "ready")["pid"].as_u64().unwrap() as u32;
    assert_eq!(limit(pid, "Max address space"), Some(limits::WORKER_MEMORY_BYTES));
    assert_eq!(limit(pid, "Max file size"), Some(limits::CHILD_FILE_BYTES));
    // Each request grants its share anew, counted from what is spent already.
    let cpu = limit(pid, "Max cpu time").unwrap();
    let share = limits::WORKER_CPU_SECS;
    assert!((share..share + 60).contains(&cpu), "{cpu}");
}

#[test]
fn an_edit_simulates_only_what_it_can_change() {
    let dir = tempfile::tempdir().unwrap();
    let studio = open(&dir);
    let before = studio.rolled_out(0);
    let mut socket = studio.socket();
    let ack = socket.ask("keys.add", &key(55, -1.0));
    assert_eq!(ack["first_changed_frame"], 31);
    let after = studio.rolled_out(1);
    assert_eq!(after["state"]["resumed_at"], 11);
    for frame in 0..=11 {
        assert_eq!(before["q"][frame], after["q"][frame]);
    }
    assert_ne!(before["q"][59], after["q"][59]);
    // A preview rolls out without touching the document, and ends.
    let op = json!({"op": "keys.add", "args": key(20, 0.5)});
    socket.ask("preview", &json!({"op": op}));
    let begin = Instant::now();
    while studio.get("/api/rollout").json()["state"]["rev"] != 0 {
        assert!(begin.elapsed() < Duration::from_secs(5));
    }
    socket.ask("preview.end", &json!({}));
    assert_eq!(studio.rolled_out(1)["q"], after["q"], "bit for bit");
    assert_eq!(studio.state()["document"]["history"]["done"], 1);
}

#[test]
fn every_policy_performs_and_settings_are_shared() {
    let dir = tempfile::tempdir().unwrap();
    let studio = open(&dir);
    let mut socket = studio.socket();
    let mut other = studio.socket();
    for policy in ["zero", "pd", "computed-torque"] {
        socket.ask("rollout.set", &json!({"policy": policy}));
        assert_eq!(other.event("rollout.settings")["policy"], policy);
        let rollout = studio.rolled_out(0);
        assert_eq!(rollout["state"]["policy"], policy);
        assert_eq!(rollout["state"]["phase"], "done");
    }
    let bad = socket.ask("rollout.set", &json!({"policy": "magic"}));
    assert_eq!(bad["error"]["code"], "request");
}

#[test]
fn poses_are_judged_by_simulation_and_can_be_solved() {
    let dir = tempfile::tempdir().unwrap();
    let studio = open(&dir);
    let begin = Instant::now();
    while studio.state()["document"]["findings"]["simulated"] != true {
        assert!(begin.elapsed() < Duration::from_secs(20));
        std::thread::sleep(Duration::from_millis(20));
    }
    let robot = studio.get("/api/robot/ur5e").json();
    let site = robot["ik_sites"][0].clone();
    let q = robot["table"]["rest"].clone();
    let settled = studio.post("/api/settle", &json!({"q": q})).json();
    assert!(settled["worst"].as_f64().unwrap() < 0.5, "{settled}");
    let bodies = studio.post("/api/kinematics", &json!({"q": [q]})).json();
    let n = robot["bodies"].as_array().unwrap().len();
    assert_eq!(bodies[0].as_array().unwrap().len(), 7 * n);
    // A place that is in reach: where another pose has the site.
    let near: Vec<f64> = q.as_array().unwrap().iter().map(|v| v.as_f64().unwrap() + 0.2).collect();
    let bodies = studio.post("/api/kinematics", &json!({"q": [near]})).json();
    let body = 7 * site["body"].as_u64().unwrap() as usize;
    let at = |k: usize| bodies[0][body + k].as_f64().unwrap();
    let (w, u) = (at(3), [at(4), at(5), at(6)]);
    let p: Vec<f64> = site["pos"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    let cross = |a: &[f64], b: &[f64]| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let t = cross(&u, &p).map(|v| 2.0 * v);
    let ut = cross(&u, &t);
    let pos: Vec<f64> = (0..3).map(|k| at(k) + p[k] + w * t[k] + ut[k]).collect();
    let site = site["name"].clone();
    let found = studio.post("/api/ik", &json!({"q": q, "site": site, "pos": pos})).json();
    assert!(found["distance_m"].as_f64().unwrap() < 1e-3, "{found}");
    assert_eq!(
        studio.post("/api/ik", &json!({"q": q, "site": "nose", "pos": [0, 0, 0]})).status,
        422
    );
    assert_eq!(studio.post("/api/kinematics", &json!({"q": [[0.0]]})).status, 400);
}

/// A page that is told of another document forgets the rollout of the last one. So what it hears of the
/// rollout comes later.
#[test]
fn a_document_is_told_before_its_rollout() {
    let dir = tempfile::tempdir().unwrap();
    let studio = open(&dir);
    studio.socket().ask("rollout.set", &json!({"policy": "pd"}));
    let mut pages: Vec<_> = (0..8).map(|_| studio.socket()).collect();
    for _ in 0..25 {
        let opened = studio.post("/api/new", &json!({"text": CLIP})).json()["opened"].clone();
        assert!(opened.is_u64());
        let generation = studio.rolled_out(0)["state"]["gen"].clone();
        for page in &mut pages {
            let mut told = false;
            loop {
                let event = page.json();
                told = told || event["document"]["opened"] == opened;
                if event["event"] == "rollout.state"
                    && event["gen"] == generation
                    && event["phase"] == "done"
                {
                    assert!(told, "the rollout came before document {opened}");
                    break;
                }
            }
        }
    }
}
