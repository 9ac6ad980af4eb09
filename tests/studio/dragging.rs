//! Previews while a key, a tangent and a diamond of the 3D path are dragged by a client that draws nothing.
//!
//! A test run drags each for a moment; for figures, on both robots, for as long as the environment says:
//!
//! `ROBERT_DRAG_SECS=5 cargo test --test it dragging -- --nocapture`

use std::f64::consts::TAU;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::client::{Socket, Studio};
use super::hand::drag;
use super::viewport::until;

/// Frames that one preview simulates: from 20 before the first changed frame to the clip's end.
const FRAMES: usize = 100;
const AHEAD: usize = 20;
/// The key that is dragged.
const KEY: usize = 4;

/// An example with smooth curves between its keys, cut so that editing one key simulates so many frames.
fn clip(example: &str) -> Value {
    let file = format!("{}/assets/clips/{example}.clip.json", env!("CARGO_MANIFEST_DIR"));
    let mut clip: Value = serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap();
    let poses = clip["poses"].take();
    let keys = clip["keys"].as_array_mut().unwrap();
    let length = keys[KEY - 1]["frame"].as_u64().unwrap() as usize + 1 - AHEAD + FRAMES;
    keys.retain(|k| k["frame"].as_u64().unwrap() < length as u64);
    for key in keys {
        let q = if key["q"].is_null() { &poses[key["pose"].as_str().unwrap()] } else { &key["q"] };
        *key = json!({"frame": key["frame"], "q": q});
    }
    clip.as_object_mut().unwrap().remove("poses");
    clip["length"] = json!(length);
    clip["fill"] = json!("cubic");
    clip
}

/// Previews a second of what `op` edits when the hand is at an angle.
fn previews(
    page: &mut Socket,
    time: Duration,
    mut op: impl FnMut(&mut Socket, f64) -> Value,
) -> f64 {
    let begin = Instant::now();
    let mut count = 0;
    while count == 0 || begin.elapsed() < time {
        let op = op(page, begin.elapsed().as_secs_f64() * TAU);
        page.ask("preview", &json!({ "op": op }));
        loop {
            let event = page.event("rollout.state");
            if event["phase"] == "done" && event["rev"] == 0 {
                break;
            }
        }
        count += 1;
    }
    f64::from(count) / begin.elapsed().as_secs_f64()
}

fn dragged(example: &str, site: &str, radius: f64, time: Duration) -> Value {
    let dir = tempfile::tempdir().unwrap();
    let clip = clip(example);
    std::fs::write(dir.path().join("a.clip.json"), clip.to_string()).unwrap();
    let studio = Studio::start(dir.path(), &["a.clip.json"]);
    let mut page = studio.socket();
    page.ask("rollout.set", &json!({"policy": "robert"}));
    studio.rolled_out(0);
    let key = &clip["keys"][KEY];
    let (frame, joint) = (&key["frame"], clip["robot"]["joints"][1].as_str().unwrap());
    let own = key["q"][1].as_f64().unwrap();

    let a_key = previews(
        &mut page,
        time,
        |_, turn| json!({"op": "keys.set", "args": {"frame": frame, "values": {joint: own + 0.02 * turn.cos()}}}),
    );
    let a_tangent = previews(&mut page, time, |_, turn| {
        let args = json!({"frames": [frame], "joints": [joint], "tangent": 0.5 * turn.cos()});
        json!({"op": "tangent.set", "args": args})
    });
    let name = format!("/path/key/{frame}");
    page.ask("view.select", &json!({"site": site}));
    page.ask("view.show", &json!({"path": true}));
    let mut viser = studio.connect_with("/viser/", Some("viser-v1.1.1"), "&tab=here");
    let placed = |m: &Value| m["type"] == "SetPositionMessage" && m["name"] == name;
    let scene = until(&mut viser, placed);
    let at = scene.iter().find(|m| placed(m)).unwrap()["position"].clone();
    let tip: [f64; 3] = serde_json::from_value(at).unwrap();
    drag(&mut viser, ("start", None), &name, (tip, tip));
    let a_diamond = previews(&mut page, time, |page, turn| {
        let to = [tip[0] + radius * (turn.cos() - 1.0), tip[1], tip[2] + radius * turn.sin()];
        drag(&mut viser, ("update", None), &name, (tip, to));
        let values = page.event("joint")["values"].take();
        json!({"op": "keys.set", "args": {"frame": frame, "values": values}})
    });
    json!({
        "example": example, "frames": FRAMES,
        "key_per_sec": a_key, "tangent_per_sec": a_tangent, "diamond_per_sec": a_diamond,
    })
}

#[test]
fn previews_follow_a_key_a_tangent_and_a_diamond() {
    let secs = std::env::var("ROBERT_DRAG_SECS").ok().and_then(|n| n.parse().ok());
    let time = Duration::from_secs_f64(secs.unwrap_or(0.0));
    println!("{}", dragged("ur5e/hang", "end_effector", 0.05, time));
    if secs.is_some() {
        println!("{}", dragged("shadow_hand/fire", "thtip", 0.01, time));
    }
}
