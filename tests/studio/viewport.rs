//! The 3D viewport's socket, as the viser client meets it.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::{Value, json};

use super::client::{CLIP, Socket, Studio};

/// Messages of one binary frame.
pub(super) fn messages(frame: &[u8]) -> Vec<Value> {
    let word = |at: usize| u64::from_le_bytes(frame[at..at + 8].try_into().unwrap()) as usize;
    let (inner, packed) = (word(0), word(8));
    let inner = zstd::bulk::decompress(&frame[16..16 + packed], inner).unwrap();
    let map: Value = rmp_serde::from_slice(&inner).unwrap();
    assert!(map["timestampSec"].as_f64().unwrap() >= 0.0);
    let mut at = 16 + packed;
    for length in map["binaryBufferLengths"].as_array().unwrap() {
        at = at.next_multiple_of(8) + length.as_u64().unwrap() as usize;
    }
    assert_eq!(at, frame.len(), "the buffers fill the frame");
    map["messages"].as_array().unwrap().clone()
}

/// Reads until a message fits.
pub(super) fn until(socket: &mut Socket, fits: impl Fn(&Value) -> bool) -> Vec<Value> {
    let mut all = Vec::new();
    loop {
        all.extend(messages(&socket.read().unwrap()));
        if all.iter().any(&fits) {
            return all;
        }
    }
}

#[derive(Serialize)]
#[serde(tag = "type")]
enum Say {
    TransformControlsDragStartMessage {
        name: String,
        owner: String,
    },
    TransformControlsUpdateMessage {
        name: String,
        wxyz: [f64; 4],
        position: [f64; 3],
        owner: String,
    },
    TransformControlsDragEndMessage {
        name: String,
        owner: String,
    },
    SceneNodeClickMessage {
        name: String,
        instance_index: Option<u32>,
    },
    ViewerCameraMessage {
        fov: f64,
    },
}

fn say(socket: &mut Socket, message: &Say) {
    socket.send_frame(2, &rmp_serde::to_vec_named(message).unwrap()).unwrap();
}

#[test]
fn the_scene_comes_first_and_a_gizmo_turns_its_joint() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("a.clip.json"), CLIP).unwrap();
    let studio = Studio::start(dir.path(), &["a.clip.json"]);
    studio.rolled_out(0);
    let mut viser = studio.connect("/viser/", Some("viser-v1.1.1"));
    assert!(viser.head.to_lowercase().contains("sec-websocket-protocol: viser-v1.1.1"));
    let scene = until(&mut viser, |m| {
        m["type"] == "MeshMessage" && m["name"].as_str().unwrap().starts_with("/command")
    });
    let kinds = scene.iter().fold(BTreeMap::new(), |mut n, m| {
        *n.entry(m["type"].as_str().unwrap().to_owned()).or_insert(0) += 1;
        n
    });
    assert_eq!(scene[0]["wxyz"], json!([0.5, -0.5, 0.5, 0.5]), "up first");
    assert!(kinds["MeshMessage"] >= 10 && kinds["FrameMessage"] >= 10, "{kinds:?}");
    assert!(kinds.contains_key("SetCameraPositionMessage"), "{kinds:?}");

    let mut page = studio.socket();
    page.ask("view.select", &json!({"joint": "shoulder_pan"}));
    let news = until(&mut viser, |m| m["type"] == "SetOrientationMessage" && m["name"] == "/gizmo");
    let find =
        |kind: &str| news.iter().find(|m| m["type"] == kind && m["name"] == "/gizmo").unwrap();
    let props = &find("TransformControlsMessage")["props"];
    assert_eq!(props["active_axes"], json!([true, true, false]), "one ring");
    let numbers = |v: &Value| -> Vec<f64> {
        v.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
    };
    let q = numbers(&find("SetOrientationMessage")["wxyz"]);
    let p = numbers(&find("SetPositionMessage")["position"]);
    let (name, owner) = ("/gizmo".to_owned(), String::new());
    say(&mut viser, &Say::ViewerCameraMessage { fov: 1.0 });
    say(
        &mut viser,
        &Say::TransformControlsDragStartMessage { name: name.clone(), owner: owner.clone() },
    );
    // A quarter of a radian about the ring's own axis, in the gizmo's frame.
    let turn = |a: f64| {
        let (c, s) = ((a / 2.0).cos(), (a / 2.0).sin());
        [q[0] * c - q[3] * s, q[1] * c + q[2] * s, q[2] * c - q[1] * s, q[3] * c + q[0] * s]
    };
    for a in [0.1, 0.25] {
        say(
            &mut viser,
            &Say::TransformControlsUpdateMessage {
                name: name.clone(),
                wxyz: turn(a),
                position: [p[0], p[1], p[2]],
                owner: owner.clone(),
            },
        );
    }
    say(&mut viser, &Say::TransformControlsDragEndMessage { name, owner });
    let event = loop {
        let event = page.event("joint");
        if event["done"] == true {
            break event;
        }
    };
    let pan = event["values"]["shoulder_pan"].as_f64().unwrap();
    assert!((pan - (-1.57 + 0.25)).abs() < 1e-4, "{event}");

    page.ask("view.select", &json!({}));
    let link = scene
        .iter()
        .filter_map(|m| m["name"].as_str())
        .find(|n| n.starts_with("/robot/") && n.contains("forearm") && n.matches('/').count() == 3)
        .unwrap()
        .to_owned();
    say(&mut viser, &Say::SceneNodeClickMessage { name: link, instance_index: None });
    let selected = loop {
        let selected = page.event("select");
        if !selected["body"].is_null() {
            break selected;
        }
    };
    assert_eq!(selected["joint"], "elbow", "{selected}");
}

#[test]
fn playing_moves_the_robot_sixty_times_a_second() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("a.clip.json"), CLIP).unwrap();
    let studio = Studio::start(dir.path(), &["a.clip.json"]);
    studio.rolled_out(0);
    let mut viser = studio.connect("/viser", Some("viser-v1.1.1"));
    until(&mut viser, |m| m["type"] == "ReplayDoneMessage");
    let mut page = studio.socket();
    page.ask("view.play", &json!({"frame": 0.0, "speed": 1.0}));
    let begin = std::time::Instant::now();
    let mut frames = 0;
    while begin.elapsed() < std::time::Duration::from_secs(1) {
        let moved = messages(&viser.read().unwrap());
        frames += u32::from(
            moved.iter().any(|m| m["name"].as_str().is_some_and(|n| n.starts_with("/robot/"))),
        );
    }
    assert!(frames >= 25, "{frames} pictures in a second");
}

#[test]
fn another_version_of_the_client_is_turned_away() {
    let dir = tempfile::tempdir().unwrap();
    let studio = Studio::start(dir.path(), &[]);
    assert!(studio.connect("/viser/", Some("viser-v9.9.9")).read().is_none());
    assert!(studio.connect("/viser/", None).read().is_none());
    let mut fuzz = studio.connect("/viser/", Some("viser-v1.1.1"));
    fuzz.read().unwrap();
    for n in 0..200_u8 {
        fuzz.send_frame(2, &[n, n ^ 0x5a, 0xc1, n.wrapping_mul(31)]).unwrap();
    }
    assert_eq!(studio.get("/api/state").status, 200);
}

/// Free viewport of the page at three window sizes, pixels: what the panels leave.
const WINDOWS: [(f64, f64); 3] = [(770.0, 332.0), (896.0, 344.0), (1120.0, 456.0)];

/// Bounds of the robot on the picture of its first camera, -1..1 both ways for a square.
fn seen(studio: &Studio, robot: &str) -> [f64; 4] {
    let view = studio.post("/api/new", &json!({"robot": robot})).json();
    let id = view["table"]["robot"].as_str().unwrap_or_else(|| panic!("{view}")).to_owned();
    let geometry = studio.get(&format!("/api/robot/{id}/geometry")).json();
    let numbers = |v: &Value| -> Vec<f64> {
        v.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
    };
    let bodies = geometry["bodies"].as_array().unwrap();
    let last = bodies.last().unwrap().as_str().unwrap().to_owned();
    let node = format!("/robot/{}", robert::take::viser::node_name(&last));
    let mut viser = studio.connect("/viser/", Some("viser-v1.1.1"));
    let mut scene = until(&mut viser, |m| m["name"] == node.as_str());
    while !scene.iter().any(|m| m["type"] == "SetCameraLookAtMessage") {
        scene.extend(messages(&viser.read().unwrap()));
    }
    let newest = |kind: &str| scene.iter().rev().find(|m| m["type"] == kind).unwrap();
    let eye = numbers(&newest("SetCameraPositionMessage")["position"]);
    let at = numbers(&newest("SetCameraLookAtMessage")["look_at"]);
    let fov = newest("SetCameraFovMessage")["fov"].as_f64().unwrap();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let cross = |a: &[f64], b: &[f64]| {
        vec![a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let unit = |a: Vec<f64>| {
        let n = dot(&a, &a).sqrt();
        a.into_iter().map(|v| v / n).collect::<Vec<f64>>()
    };
    let minus = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x - y).collect::<Vec<f64>>();
    let forward = unit(minus(&at, &eye));
    let right = unit(cross(&forward, &[0.0, 0.0, 1.0]));
    let up = cross(&right, &forward);
    let home = numbers(&geometry["home"]);
    let mut bounds = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];
    for mesh in geometry["meshes"].as_array().unwrap() {
        let body = mesh["body"].as_u64().unwrap() as usize;
        if body == 0 {
            continue;
        }
        let place = &home[7 * body..7 * body + 7];
        let (w, u) = (place[3], place[4..7].to_vec());
        for v in numbers(&mesh["vertices"]).chunks_exact(3) {
            let t: Vec<f64> = cross(&u, v).into_iter().map(|x| 2.0 * x).collect();
            let ut = cross(&u, &t);
            let p: Vec<f64> = (0..3).map(|k| place[k] + v[k] + w * t[k] + ut[k]).collect();
            let d = minus(&p, &eye);
            let depth = dot(&d, &forward) * (fov / 2.0).tan();
            let (x, y) = (dot(&d, &right) / depth, dot(&d, &up) / depth);
            bounds = [bounds[0].min(x), bounds[1].max(x), bounds[2].min(y), bounds[3].max(y)];
        }
    }
    bounds
}

#[test]
fn every_robot_is_in_view_at_every_window() {
    let dir = tempfile::tempdir().unwrap();
    let folder = |name: &str, xml: &str| {
        let path = dir.path().join(format!("{name}.xml"));
        std::fs::write(&path, xml).unwrap();
        let out = dir.path().join("robots").join(name);
        let ran = crate::run::robert()
            .args(["import", path.to_str().unwrap(), "--out", out.to_str().unwrap()])
            .succeeds();
        assert!(ran.stderr.is_empty() || out.is_dir(), "{}", ran.stderr);
        out.display().to_string()
    };
    let leg = r#"<mujoco><worldbody><body name="hip" pos="0 0 2"><joint name="swing" axis="0 1 0" range="-60 60" limited="true"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.8" size=".06"/><body name="shin" pos="0 0 -.8"><joint name="knee" axis="0 1 0" range="0 120" limited="true"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.7" size=".05"/></body></body></worldbody></mujoco>"#;
    let slider = r#"<mujoco><worldbody><body name="cart" pos="5 -3 .05"><joint name="x" type="slide" axis="1 0 0" range="-.1 .1" limited="true"/>
        <geom type="box" size=".02 .01 .01"/></body></worldbody></mujoco>"#;
    let own = [folder("leg", leg), folder("cart", slider)];
    let studio = Studio::start(dir.path(), &[]);
    let robots = ["pointmass", "ur5e", "shadow_hand"].map(str::to_owned).into_iter().chain(own);
    for robot in robots {
        let [x0, x1, y0, y1] = seen(&studio, &robot);
        for (width, height) in WINDOWS {
            let aspect = width / height;
            assert!(y0 >= -1.0 && y1 <= 1.0, "{robot}: {y0} to {y1}");
            assert!(x0 >= -aspect && x1 <= aspect, "{robot} {width}x{height}: {x0} to {x1}");
            let share = (x1 - x0) * (y1 - y0) / (4.0 * aspect);
            assert!(share >= 0.10, "{robot} {width}x{height}: {share:.3} of the viewport");
        }
    }
}
