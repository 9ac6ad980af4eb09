//! Takes: kept by the server, shared by all pages, drawn beside what is performed now.

use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::client::{CLIP, Studio, key};
use super::viewport::until;

fn open(dir: &tempfile::TempDir) -> Studio {
    std::fs::write(dir.path().join("a.clip.json"), CLIP).unwrap();
    let studio = Studio::start(dir.path(), &["a.clip.json"]);
    // The policy that the robot has of its own may have begun before this one was chosen.
    let mut page = studio.socket();
    page.ask("rollout.set", &json!({"policy": "computed-torque"}));
    studio.rolled_out(0);
    studio
}

/// The list, once it begins with a take of this version.
fn of_rev(studio: &Studio, rev: u64) -> Value {
    let begin = Instant::now();
    loop {
        let takes = studio.get("/api/takes").json();
        if takes["takes"][0]["rev"] == rev {
            return takes;
        }
        assert!(begin.elapsed() < Duration::from_secs(20), "no take of {rev}: {takes}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn every_rollout_is_a_take_that_all_pages_know_and_that_outlives_the_clip() {
    let dir = tempfile::tempdir().unwrap();
    let studio = open(&dir);
    let first = of_rev(&studio, 0)["takes"][0].clone();
    assert_eq!((&first["policy"], &first["same_goals"]), (&json!("computed-torque"), &json!(true)));
    let before = studio.get("/api/rollout").json();
    assert_eq!(first["mae"], before["state"]["mae"]);
    let mut page = studio.socket();
    let mut other = studio.socket();
    // A drag is no take, the edit that it ends in is.
    for n in 0..3 {
        let op = json!({"op": {"op": "keys.add", "args": key(30, -1.0 + 0.1 * f64::from(n))}});
        page.ask("preview", &op);
    }
    page.ask("keys.add", &key(30, -1.0));
    studio.rolled_out(1);
    let takes = of_rev(&studio, 1);
    let ids: Vec<&Value> = takes["takes"].as_array().unwrap().iter().map(|t| &t["id"]).collect();
    let last = takes["takes"].as_array().unwrap().len() - 1;
    assert_eq!(ids[last], &first["id"], "the old one stays, at the end");
    assert_eq!(takes["takes"][last]["same_goals"], false, "its goals are not those of now");
    // Back to the same goals: the same performance is the same take.
    page.ask("undo", &json!({}));
    studio.rolled_out(2);
    assert_eq!(of_rev(&studio, 2)["takes"][0]["id"], first["id"]);
    assert_eq!(of_rev(&studio, 2)["takes"].as_array().unwrap().len(), last + 1);
    // A name pins; the other page hears of it, and so does one that comes later.
    page.ask("take.name", &json!({"id": first["id"], "name": "slow start"}));
    let named = loop {
        let told = other.event("takes");
        if told["takes"][0]["name"] == "slow start" {
            break told;
        }
    };
    assert_eq!(named["takes"][0]["pinned"], true);
    assert_eq!(studio.state()["takes"]["takes"][0]["name"], "slow start");
    let frames = studio.get(&format!("/api/takes/{}", first["id"])).json();
    assert_eq!(frames["q"], before["q"]);
    assert_eq!(frames["error"], before["error"]);
    // Another robot has none of these; they are there again with this one.
    assert_eq!(studio.post("/api/new", &json!({"robot": "pointmass"})).status, 200);
    let strangers = studio.get("/api/takes").json();
    assert!(
        strangers["takes"].as_array().unwrap().iter().all(|t| t["name"] != "slow start"),
        "{strangers}"
    );
    assert_eq!(studio.post("/api/open", &json!({"path": "a.clip.json"})).status, 200);
    let back = studio.get("/api/takes").json();
    assert!(back["takes"].as_array().unwrap().iter().any(|t| t["name"] == "slow start"), "{back}");
    // Refusals.
    for (op, args) in [
        ("take.pin", json!({"id": 999, "pinned": true})),
        ("take.name", json!({"id": first["id"], "name": "a\nb"})),
        ("take.compare", json!({"ids": [first["id"], 999]})),
        ("take.compare", json!({"ids": vec![first["id"].clone(); 5]})),
        ("take.remove", json!({"id": 999})),
    ] {
        assert!(page.ask(op, &args)["error"].is_object(), "{op} {args}");
    }
    assert_eq!(studio.get("/api/takes/999").status, 404);
    page.ask("take.remove", &json!({"id": first["id"]}));
    let left = studio.get("/api/takes").json();
    assert!(left["takes"].as_array().unwrap().iter().all(|t| t["id"] != first["id"]));
}

#[test]
fn a_take_stands_beside_the_robot_where_it_was() {
    let dir = tempfile::tempdir().unwrap();
    let studio = open(&dir);
    let first = of_rev(&studio, 0)["takes"][0]["id"].clone();
    let mut page = studio.socket();
    let mut viser = studio.connect("/viser/", Some("viser-v1.1.1"));
    let named = |m: &Value, root: &str| m["name"].as_str().is_some_and(|n| n.starts_with(root));
    let scene = until(&mut viser, |m| m["type"] == "FrameMessage" && named(m, "/command/"));
    let body = |m: &&Value| {
        m["type"] == "FrameMessage"
            && named(m, "/robot/")
            && m["name"].as_str().unwrap().matches('/').count() == 2
    };
    let tip = scene.iter().rfind(body).unwrap()["name"].as_str().unwrap();
    let tip = tip.trim_start_matches("/robot/");
    let place = |news: &[Value], root: &str| -> Vec<f64> {
        let name = format!("{root}/{tip}");
        let of = |m: &&Value| m["type"] == "SetPositionMessage" && m["name"] == name.as_str();
        let last = news.iter().rfind(of).unwrap();
        last["position"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
    };
    let moved = |root: &'static str| {
        let name = format!("{root}/{tip}");
        move |m: &Value| m["type"] == "SetPositionMessage" && m["name"] == name.as_str()
    };
    let apart =
        |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    // The scene at a new connection, once the tip is elsewhere than it was.
    let elsewhere = |than: &[f64]| {
        let begin = Instant::now();
        loop {
            let mut viser = studio.connect("/viser/", Some("viser-v1.1.1"));
            let here = place(&until(&mut viser, moved("/robot")), "/robot");
            if apart(&here, than) > 0.05 {
                return (viser, here);
            }
            assert!(begin.elapsed() < Duration::from_secs(20), "it stays at {here:?}");
        }
    };
    let (_, start) = elsewhere(&[f64::MAX; 3]);
    page.ask("view.frame", &json!({"frame": 40}));
    let (_, before) = elsewhere(&start);
    page.ask("keys.add", &key(30, 0.3));
    studio.rolled_out(1);
    of_rev(&studio, 1);
    let (mut viser, _) = elsewhere(&before);
    page.ask("take.compare", &json!({"ids": [first]}));
    let news = until(&mut viser, moved("/beside"));
    let meshes = news.iter().filter(|m| m["type"] == "MeshMessage" && named(m, "/beside/"));
    assert!(meshes.count() >= 5, "the whole robot enters");
    let beside = place(&news, "/beside");
    assert!(apart(&beside, &before) < 1e-6, "{beside:?} where it was: {before:?}");
    page.ask("take.compare", &json!({"ids": []}));
    until(&mut viser, |m| m["type"] == "RemoveSceneNodeMessage" && m["name"] == "/beside");
}
