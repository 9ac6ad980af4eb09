//! What a hand in the 3D viewport does: the viser client's messages as it sends them.

use serde::Serialize;
use serde_json::{Value, json};

use super::client::{CLIP, Socket, Studio};
use super::viewport::{messages, until};

#[derive(Serialize)]
#[serde(tag = "type")]
enum Say<'a> {
    SceneNodeDragMessage {
        phase: &'a str,
        name: &'a str,
        start_position: [f64; 3],
        end_position: [f64; 3],
        button: &'a str,
        modifier: Option<&'a str>,
        owner: &'a str,
    },
    ViewerCameraMessage {
        wxyz: [f64; 4],
        position: [f64; 3],
        fov: f64,
        image_height: u32,
        image_width: u32,
    },
}

fn say(socket: &mut Socket, message: &Say<'_>) {
    socket.send_frame(2, &rmp_serde::to_vec_named(message).unwrap()).unwrap();
}

pub(super) fn drag(
    viser: &mut Socket,
    (phase, modifier): (&str, Option<&str>),
    name: &str,
    (start_position, end_position): ([f64; 3], [f64; 3]),
) {
    let (button, owner) = ("left", "");
    say(
        viser,
        &Say::SceneNodeDragMessage {
            phase,
            name,
            start_position,
            end_position,
            button,
            modifier,
            owner,
        },
    );
}

fn released(page: &mut Socket) -> Value {
    loop {
        let event = page.event("joint");
        if event["done"] == true {
            return event;
        }
    }
}

fn numbers(v: &Value) -> Vec<f64> {
    v.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

fn rotate(q: &[f64], v: [f64; 3]) -> [f64; 3] {
    let u = [q[1], q[2], q[3]];
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let t = cross(u, v).map(|x| 2.0 * x);
    let ut = cross(u, t);
    [0, 1, 2].map(|k| v[k] + q[0] * t[k] + ut[k])
}

fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|k| a[k] + b[k])
}

/// An arm on stage: its 3D client, a page, the name of a mesh of each body, where bodies are.
struct Scene {
    _dir: tempfile::TempDir,
    studio: Studio,
    viser: Socket,
    page: Socket,
    scene: Vec<Value>,
    facts: Value,
}

impl Scene {
    fn set() -> Scene {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("a.clip.json"), CLIP).unwrap();
        let studio = Studio::start(dir.path(), &["a.clip.json"]);
        studio.rolled_out(0);
        let mut viser = studio.connect_with("/viser/", Some("viser-v1.1.1"), "&tab=here");
        let scene = until(&mut viser, |m| {
            m["type"] == "MeshMessage" && m["name"].as_str().unwrap().starts_with("/command")
        });
        let page = studio.socket();
        let facts = studio.get("/api/robot/ur5e").json();
        Scene { _dir: dir, studio, viser, page, scene, facts }
    }

    fn mesh(&self, part: &str) -> String {
        let names = self.scene.iter().filter(|m| m["type"] == "MeshMessage");
        let mut names = names.filter_map(|m| m["name"].as_str());
        names.find(|n| n.starts_with("/robot/") && n.contains(part)).unwrap().to_owned()
    }

    fn body(&self, part: &str) -> usize {
        let bodies = self.facts["bodies"].as_array().unwrap();
        bodies.iter().position(|b| b["name"].as_str().unwrap().contains(part)).unwrap()
    }

    /// Position and quaternion of a body in a pose.
    fn place(&self, q: &[f64], body: usize) -> ([f64; 3], Vec<f64>) {
        let rows = self.studio.post("/api/kinematics", &json!({"q": [q]})).json();
        let row = numbers(&rows[0]);
        let p = &row[7 * body..7 * body + 7];
        ([p[0], p[1], p[2]], p[3..].to_vec())
    }

    fn tip(&self, q: &[f64]) -> [f64; 3] {
        let site = &self.facts["ik_sites"][0];
        let (pos, quat) = self.place(q, site["body"].as_u64().unwrap() as usize);
        let own = numbers(&site["pos"]);
        add(pos, rotate(&quat, [own[0], own[1], own[2]]))
    }
}

const FIRST: [f64; 5] = [-1.57, -1.57, 1.57, -1.57, -1.57];
const JOINTS: [&str; 5] = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2"];

fn posed(values: &Value) -> Vec<f64> {
    let at = |(name, rest): (&&str, &f64)| values[*name].as_f64().unwrap_or(*rest);
    JOINTS.iter().zip(&FIRST).map(at).collect()
}

#[test]
fn alt_pulls_the_end_effector_and_leaves_locked_joints() {
    let mut s = Scene::set();
    let bindings = s.scene.iter().find(|m| m["type"] == "SetSceneNodeDragBindingsMessage").unwrap();
    let modifiers: Vec<&Value> =
        bindings["bindings"].as_array().unwrap().iter().map(|b| &b["modifier"]).collect();
    assert!(modifiers.contains(&&json!("alt")) && modifiers.contains(&&json!("shift")));

    let forearm = s.mesh("forearm");
    let tip = s.tip(&FIRST);
    let way = [0.03, -0.02, 0.04];
    let pull = |s: &mut Scene| {
        let at = [0.1, 0.1, 0.5];
        drag(&mut s.viser, ("start", Some("alt")), &forearm, (at, at));
        // The client's start position moves along with the link: it must not matter.
        drag(&mut s.viser, ("update", Some("alt")), &forearm, ([9.0; 3], add(at, way)));
        drag(&mut s.viser, ("end", Some("alt")), &forearm, ([9.0; 3], add(at, way)));
        released(&mut s.page)
    };
    let event = pull(&mut s);
    assert_eq!(event["tab"], "here", "only that page makes the edit");
    let reached = s.tip(&posed(&event["values"]));
    for k in 0..3 {
        assert!((reached[k] - tip[k] - way[k]).abs() < 2e-3, "{reached:?} from {tip:?}");
    }
    s.page.ask("view.pose", &json!({"q": null}));

    s.page.ask("view.lock", &json!({"joints": ["elbow", "nose"]}));
    assert_eq!(s.studio.state()["locked"], json!(["elbow"]));
    let event = pull(&mut s);
    assert!(event["values"]["elbow"].is_null(), "{event}");
    assert!(event["values"].as_object().unwrap().len() >= 3, "the others reach as far: {event}");
    let reached = s.tip(&posed(&event["values"]));
    let left: f64 = (0..3).map(|k| (reached[k] - tip[k] - way[k]).powi(2)).sum::<f64>().sqrt();
    assert!(left < 0.054, "nearer than where it was: {left}");
}

#[test]
fn a_dragged_link_turns_as_far_as_the_pointer_and_shift_a_fifth() {
    let mut s = Scene::set();
    let (mesh, body) = (s.mesh("forearm"), s.body("forearm"));
    let axis = &s.facts["axes"][2];
    assert_eq!(axis["body"], body);
    let (pos, quat) = s.place(&FIRST, body);
    let own = |v: &Value| {
        let v = numbers(v);
        rotate(&quat, [v[0], v[1], v[2]])
    };
    let (anchor, axis) = (add(pos, own(&axis["pos"])), own(&axis["axis"]));
    // A point across the axis, and where it is after 0.4 rad.
    let across = if axis[2].abs() < 0.9 { [0.0, 0.0, 1.0] } else { [1.0, 0.0, 0.0] };
    let along: f64 = (0..3).map(|k| across[k] * axis[k]).sum();
    let arm = [0, 1, 2].map(|k| 0.2 * (across[k] - along * axis[k]));
    let turned = |a: f64| {
        let (sin, cos) = (a / 2.0).sin_cos();
        add(anchor, rotate(&[cos, axis[0] * sin, axis[1] * sin, axis[2] * sin], arm))
    };
    for (modifier, share) in [(None, 1.0), (Some("shift"), 0.2)] {
        let from = turned(0.0);
        drag(&mut s.viser, ("start", modifier), &mesh, (from, from));
        for a in [0.1, 0.2, 0.3, 0.4] {
            // As the client does: the grabbed point of the moved link, and the pointer.
            drag(&mut s.viser, ("update", modifier), &mesh, (turned(a * share), turned(a)));
        }
        drag(&mut s.viser, ("end", modifier), &mesh, (turned(0.4 * share), turned(0.4)));
        let event = released(&mut s.page);
        let elbow = event["values"]["elbow"].as_f64().unwrap() - FIRST[2];
        assert!((elbow - 0.4 * share).abs() < 0.02, "{modifier:?}: {elbow}");
        s.page.ask("view.pose", &json!({"q": null}));
    }

    // A locked link leaves the turn to the one that it hangs on.
    s.page.ask("view.lock", &json!({"joints": ["elbow"]}));
    let from = turned(0.0);
    drag(&mut s.viser, ("start", None), &mesh, (from, from));
    drag(&mut s.viser, ("end", None), &mesh, (from, turned(0.3)));
    let event = released(&mut s.page);
    assert!(event["values"]["elbow"].is_null(), "{event}");
    assert!(!event["values"]["shoulder_lift"].is_null(), "{event}");
}

#[test]
fn esc_gives_a_drag_up() {
    let mut s = Scene::set();
    let mesh = s.mesh("forearm");
    drag(&mut s.viser, ("start", None), &mesh, ([0.3, 0.0, 0.5], [0.3, 0.0, 0.5]));
    drag(&mut s.viser, ("update", None), &mesh, ([0.3, 0.0, 0.5], [0.3, 0.1, 0.6]));
    s.page.event("joint");
    s.page.send("view.cancel", &json!({}));
    assert_eq!(s.page.event("joint.cancelled")["tab"], "here");
    drag(&mut s.viser, ("update", None), &mesh, ([0.3, 0.0, 0.5], [0.3, 0.2, 0.6]));
    drag(&mut s.viser, ("end", None), &mesh, ([0.3, 0.0, 0.5], [0.3, 0.2, 0.6]));
    // Whatever is asked next is answered before any edit of the drag.
    s.page.send("view.select", &json!({"joint": "wrist_1"}));
    let next = loop {
        let event = s.page.json();
        assert_ne!(event["event"], "joint", "{event}");
        if event["event"] == "select" {
            break event;
        }
    };
    assert_eq!(next["joint"], "wrist_1");
    assert_eq!(s.studio.state()["document"]["rev"], 0);
}

#[test]
fn the_selected_link_is_outlined_hovering_names_it_and_f_frames_it() {
    let mut s = Scene::set();
    s.page.ask("view.select", &json!({"joint": "elbow"}));
    until(&mut s.viser, |m| m["type"] == "MeshMessage" && m["name"] == "/selected/shell");
    let far = |news: &[Value]| {
        let of = |kind: &str, field: &str| {
            numbers(&news.iter().rev().find(|m| m["type"] == kind).unwrap()[field])
        };
        let (eye, at) =
            (of("SetCameraPositionMessage", "position"), of("SetCameraLookAtMessage", "look_at"));
        eye.iter().zip(&at).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
    };
    let framed = |s: &mut Scene, preset: &str| {
        s.page.ask("view.camera", &json!({"preset": preset}));
        let news = until(&mut s.viser, |m| m["type"] == "SetCameraLookAtMessage");
        (far(&news), news)
    };
    let (whole, _) = framed(&mut s, "fit");
    let (link, _) = framed(&mut s, "selection");
    assert!(link < 0.7 * whole, "{link} m away instead of {whole}");
    s.page.ask("view.select", &json!({}));
    assert!((framed(&mut s, "selection").0 - whole).abs() < 1e-6, "nothing selected: all of it");

    // Straight at the middle of the forearm from 2 m away, along -x: z is down the picture's y.
    let (pos, quat) = s.place(&FIRST, s.body("forearm"));
    let middle = add(pos, rotate(&quat, [0.0, 0.0, 0.2]));
    say(
        &mut s.viser,
        &Say::ViewerCameraMessage {
            // Its x is -y, its y is -z, its z is x of the world.
            wxyz: [0.5, -0.5, 0.5, -0.5],
            position: add(middle, [-2.0, 0.0, 0.0]),
            fov: 0.8,
            image_height: 600,
            image_width: 900,
        },
    );
    let over = |x: f64, y: f64| s.studio.get(&format!("/api/hover?tab=here&x={x}&y={y}")).json();
    let begin = std::time::Instant::now();
    while over(0.5, 0.5).is_null() && begin.elapsed().as_secs() < 10 {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let found = over(0.5, 0.5);
    assert!(found["body"].as_str().unwrap().contains("forearm"), "{found}");
    assert_eq!(found["joint"], "elbow");
    assert_eq!(over(0.02, 0.02), Value::Null);
    assert_eq!(s.studio.get("/api/hover?tab=elsewhere&x=0.5&y=0.5").json(), Value::Null);
    assert_eq!(s.studio.get("/api/hover?tab=here&x=2&y=0.5").status, 400);
}

#[test]
fn links_of_the_command_are_coloured_by_their_error_and_actors_can_be_hidden() {
    let mut s = Scene::set();
    // Nobody moves: the command leaves the robot behind.
    s.page.ask("rollout.set", &json!({"policy": "zero"}));
    s.page.ask("keys.add", &json!({"keys": [{"frame": 40, "q": [0.6, -1.2, 1.0, -1.5, -1.5]}]}));
    s.studio.rolled_out(1);
    s.page.ask("view.frame", &json!({"frame": 40.0}));
    let news = until(&mut s.viser, |m| {
        m["type"] == "SceneNodeUpdateMessage" && m["name"].as_str().unwrap().contains("forearm")
    });
    let color = |news: &[Value]| {
        let found = news.iter().rev().find(|m| {
            m["type"] == "SceneNodeUpdateMessage" && m["name"].as_str().unwrap().contains("forearm")
        });
        numbers(&found.unwrap()["updates"]["color"])
    };
    let far = color(&news);
    assert!(far[0] > far[2], "reddish: {far:?}");
    // Where there is no goal there is no error.
    s.page.ask("mask.set", &json!({"from": 31, "to": 60, "masked": true}));
    s.studio.rolled_out(2);
    let news = until(&mut s.viser, |m| {
        m["type"] == "SceneNodeUpdateMessage" && m["name"].as_str().unwrap().contains("forearm")
    });
    let near = color(&news);
    assert!(near[2] > near[0], "blue again: {near:?}");

    for (what, root) in [("achieved", "/robot"), ("command", "/command"), ("ghosts", "/future")] {
        for on in [false, true] {
            if what == "ghosts" && !on {
                continue;
            }
            s.page.ask("view.frame", &json!({"frame": 10.0}));
            s.page.ask("view.show", &json!({what: on}));
            let shows = |m: &Value| {
                m["type"] == "SetSceneNodeVisibilityMessage"
                    && m["name"] == root
                    && m["visible"] == on
            };
            let mut left = 400;
            loop {
                let news = messages(&s.viser.read().unwrap());
                if news.iter().any(shows) {
                    break;
                }
                left -= 1;
                assert!(left > 0, "{what} {on} never comes");
            }
        }
    }
}

#[test]
fn a_preview_tells_how_fast_the_edit_makes_joints_go() {
    let mut s = Scene::set();
    let op = |df: i32| json!({"op": {"op": "keys.move", "args": {"frames": [30], "df": df}}});
    let near = s.page.ask("preview", &op(-28))["result"]["demand"].clone();
    let far = s.page.ask("preview", &op(20))["result"]["demand"].clone();
    assert_eq!(near["joint"], far["joint"], "the one with the longest way for its speed");
    assert_eq!(near["frames"], json!([0, 1]), "a line: from frame to frame");
    let (a, b) = (near["needed"].as_f64().unwrap(), far["needed"].as_f64().unwrap());
    assert!((a / b - 50.0 / 2.0).abs() < 0.1, "{near} {far}");
    let usual = near["usual"].as_f64().unwrap();
    assert!(usual > 0.0 && usual < near["max"].as_f64().unwrap(), "{near}");
    let joints = s.studio.state()["document"]["table"]["joints"].clone();
    for joint in joints.as_array().unwrap() {
        let (band, range) = (numbers(&joint["band"]), numbers(&joint["range"]));
        assert!(range[0] <= band[0] && band[0] < band[1] && band[1] <= range[1], "{joint}");
    }
}
