//! What the page asks for beside edits: pictures, exports, jobs, imports, scripts.

use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::client::{CLIP, Studio, key};
use crate::run::{binary, call};

#[path = "../../examples/studio_client.rs"]
#[allow(unreachable_pub)]
mod example;

fn open(dir: &tempfile::TempDir) -> Studio {
    std::fs::write(dir.path().join("a.clip.json"), CLIP).unwrap();
    Studio::start(dir.path(), &["a.clip.json"])
}

fn ended(studio: &Studio, job: &Value) -> Value {
    let begin = Instant::now();
    loop {
        let now = studio.get(&format!("/api/jobs/{}", job["id"])).json();
        if now["phase"] != "running" && now["phase"] != "cancelling" {
            return now;
        }
        assert!(begin.elapsed() < Duration::from_secs(120), "{now}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Width and height of a JPEG.
fn size(jpeg: &[u8]) -> (u32, u32) {
    assert_eq!(&jpeg[..3], &[0xff, 0xd8, 0xff]);
    let at = jpeg.windows(2).position(|w| w == [0xff, 0xc0]).unwrap();
    let two = |i: usize| u32::from(jpeg[at + i]) << 8 | u32::from(jpeg[at + i + 1]);
    (two(7), two(5))
}

#[test]
fn pictures_are_painted_without_keeping_an_edit_waiting() {
    let dir = tempfile::tempdir().unwrap();
    let studio = open(&dir);
    studio.rolled_out(0);
    let worker = studio.state()["worker"]["pid"].clone();
    let first = std::thread::scope(|scope| {
        let painting = scope.spawn(|| studio.get("/api/still.jpg?frame=0&w=320&h=200"));
        // The driver starts meanwhile, which takes half a second and more.
        let renamed = studio
            .post("/api/ops", &json!({"ops": [{"op": "clip.notes", "args": {"notes": "x"}}]}));
        assert_eq!(renamed.status, 200);
        painting.join().unwrap()
    });
    if first.status == 500 {
        // A machine without a graphics driver says what to install.
        let message = first.json()["message"].to_string();
        assert!(message.contains("apt"), "{message}");
        return;
    }
    assert_eq!(first.status, 200, "{first:?}");
    assert_eq!(first.header("content-type"), Some("image/jpeg"));
    assert_eq!(size(&first.body), (320, 200));
    let last = studio.get("/api/still.jpg?frame=59&w=320&h=200");
    assert_ne!(first.body, last.body, "the arm has moved");
    assert_eq!(size(&studio.get("/api/still.jpg?frame=5&w=161&h=99&draft=true").body), (161, 99));
    let of = |what: &str| {
        let answer = studio.get(&format!("/api/still.jpg?frame=20&w=320&h=200&draft=true{what}"));
        assert_eq!(answer.status, 200, "{what}");
        answer.body
    };
    let pictures = [
        of(""),
        of("&achieved=false"),
        of("&achieved=false&command=false"),
        of("&ghosts=true"),
        of("&pose=0.5,-1.2,1.0,-1.5,-1.5"),
        of("&pose=0.6,-1.2,1.0,-1.5,-1.5"),
    ];
    for (i, a) in pictures.iter().enumerate() {
        assert!(pictures.iter().skip(i + 1).all(|b| a != b), "picture {i} is like another");
    }
    for wrong in ["&pose=1,2", "&pose=a,b,c,d,e", "&pose=NaN,0,0,0,0", "&achieved=7"] {
        assert_eq!(studio.get(&format!("/api/still.jpg?frame=0{wrong}")).status, 400, "{wrong}");
    }
    let pose = studio.get("/api/pose.jpg?pose=upright");
    assert_eq!(size(&pose.body), (152, 114));
    assert_eq!(studio.get("/api/pose.jpg?pose=nobody").status, 404);
    assert_eq!(studio.get("/api/still.jpg?w=9&h=9").status, 400);
    assert_eq!(studio.get("/api/still.jpg?w=99999&h=20").status, 400);
    let card = studio.get("/api/gallery-picture.jpg?id=pointmass%2Fstar");
    assert_eq!(size(&card.body), (480, 300));
    assert_eq!(studio.get("/api/gallery-picture.jpg?id=no%2Fsuch").status, 404);
    let error = studio.get("/api/gallery-error?id=pointmass%2Fstar").json();
    assert_eq!(error["unit"], "m");
    assert!(error["value"].as_f64().is_some_and(|e| e > 0.0 && e < 0.01), "{error}");
    assert_eq!(studio.get("/api/gallery-error?id=pointmass%2Fstar").json(), error, "noted");
    assert_eq!(studio.get("/api/gallery-error?id=no%2Fsuch").status, 404);
    assert_eq!(studio.state()["worker"]["pid"], worker, "the simulation has no part in it");
}

#[test]
fn an_export_is_a_job_with_progress_and_can_be_cancelled() {
    let dir = tempfile::tempdir().unwrap();
    let studio = open(&dir);
    let job = studio.post("/api/exports", &json!({"format": "csv"})).json();
    let done = ended(&studio, &job);
    assert_eq!(done["phase"], "done", "{done}");
    assert_eq!(done["progress"]["total"], 59);
    assert_eq!(done["last"]["event"], "result");
    let file = studio.get(&format!("/api/jobs/{}/file", job["id"]));
    let text = String::from_utf8(file.body.clone()).unwrap();
    assert_eq!(text.lines().count(), 61, "a head and a row a frame");
    assert!(file.header("content-disposition").unwrap().contains("start.csv"));
    // The same motion as on the page.
    let rollout = studio.rolled_out(0);
    let row: Vec<f64> =
        text.lines().last().unwrap().split(',').skip(3).map(|v| v.parse().unwrap()).collect();
    for (a, b) in row.iter().zip(rollout["q"][59].as_array().unwrap()) {
        assert!((a - b.as_f64().unwrap()).abs() < 1e-6);
    }
    // Into the folder, where the dialog says.
    let job = studio.post("/api/exports", &json!({"format": "mcap", "path": "out/a.mcap"})).json();
    assert_eq!(ended(&studio, &job)["phase"], "done");
    assert_eq!(&std::fs::read(dir.path().join("out/a.mcap")).unwrap()[1..5], b"MCAP");
    let asked = json!({"format": "mp4", "size": [1280, 720], "path": "a.mp4"});
    let film = studio.post("/api/exports", &asked).json();
    let refused = studio.post("/api/exports", &asked);
    assert_eq!(refused.status, 400, "two jobs must not write one file: {refused:?}");
    assert_eq!(studio.get(&format!("/api/jobs/{}/file", film["id"])).status, 404, "not yet");
    studio.post(&format!("/api/jobs/{}/cancel", film["id"]), &json!({}));
    let phase = ended(&studio, &film)["phase"].clone();
    assert!(phase == "interrupted" || phase == "done", "{phase}");
    assert_eq!(studio.post("/api/exports", &json!({"format": "vhs"})).status, 400);
}

#[test]
fn an_export_replaces_no_file_unasked() {
    let dir = tempfile::tempdir().unwrap();
    let studio = open(&dir);
    std::fs::write(dir.path().join("a.csv"), "of an earlier session").unwrap();
    std::fs::create_dir(dir.path().join("bag")).unwrap();
    for (format, path) in [("csv", "a.csv"), ("bag", "bag")] {
        let refused = studio.post("/api/exports", &json!({"format": format, "path": path}));
        let code = refused.json()["code"].clone();
        assert_eq!((refused.status, code.as_str()), (409, Some("exists")), "{refused:?}");
    }
    let kept = std::fs::read_to_string(dir.path().join("a.csv")).unwrap();
    assert_eq!(kept, "of an earlier session");
    assert_eq!(studio.get("/api/jobs").json(), json!([]), "nothing was started");
    let asked = json!({"format": "csv", "path": "a.csv", "replace": true});
    let job = studio.post("/api/exports", &asked).json();
    assert_eq!(ended(&studio, &job)["phase"], "done");
    assert!(std::fs::read_to_string(dir.path().join("a.csv")).unwrap().starts_with("frame,"));
}

#[test]
fn formats_that_a_robot_cannot_have_say_why() {
    let dir = tempfile::tempdir().unwrap();
    let studio = open(&dir);
    studio.rolled_out(0);
    let why = || {
        let formats = studio.get("/api/formats").json();
        let formats = formats.as_array().unwrap().clone().into_iter();
        let whys = formats.filter(|f| !f["why"].is_null());
        whys.map(|f| (f["format"].clone(), f["why"].clone())).collect::<Vec<_>>()
    };
    assert!(why().is_empty(), "the arm can have all: {:?}", why());
    studio.post("/api/gallery/pointmass%2Fstar", &json!({}));
    studio.rolled_out(0);
    let of_others = json!("only for a UR5e: this robot has other joints");
    assert_eq!(why(), [(json!("ur"), of_others)]);
}

#[test]
fn a_take_is_exported_beside_what_is_performed_now() {
    let dir = tempfile::tempdir().unwrap();
    let studio = open(&dir);
    studio.rolled_out(0);
    let mut page = studio.socket();
    let take = studio.get("/api/takes").json()["takes"][0].clone();
    page.ask("rollout.set", &json!({"policy": "zero"}));
    page.ask("keys.add", &key(30, -1.0));
    studio.rolled_out(1);
    let options = |compare: Value| json!({"format": "apng", "size": [96, 64], "frames": [0, 2], "overlay": "caption", "camera": "top", "compare": compare});
    let job = studio.post("/api/exports", &options(json!({"take": take["id"]}))).json();
    let done = ended(&studio, &job);
    assert_eq!(done["phase"], "done", "{done}");
    // Each picture is that of its own clip and policy: twice as wide, two errors.
    let told = done["lines"].as_array().unwrap().iter().find(|l| l["event"] == "result").unwrap();
    let result = &told["result"];
    assert!(result["width"].as_u64().unwrap() >= 192, "{result}");
    let errors = result["precision"].as_array().unwrap();
    assert_eq!(errors.len(), 2, "{result}");
    assert!(
        (errors[1].as_f64().unwrap() - take["mae"].as_f64().unwrap()).abs() < 1e-9,
        "{result} {take}"
    );
    let now = studio.get("/api/rollout").json();
    assert!((errors[0].as_f64().unwrap() - now["state"]["mae"].as_f64().unwrap()).abs() < 1e-9);
    let file = studio.get(&format!("/api/jobs/{}/file", job["id"]));
    assert_eq!(&file.body[..4], b"\x89PNG");
    // Another seed, and what is not there.
    page.ask("rollout.set", &json!({"policy": "zero", "seed": 7}));
    let refused = studio.post("/api/exports", &options(json!({"take": take["id"]})));
    assert_eq!(refused.status, 400, "{refused:?}");
    assert_eq!(studio.post("/api/exports", &options(json!({"take": 999}))).status, 404);
    let job = studio.post("/api/exports", &options(json!({"file": "a.clip.json"}))).json();
    assert_eq!(ended(&studio, &job)["phase"], "done");
}

#[test]
fn a_collection_that_was_stopped_is_found_and_goes_on_alone() {
    let dir = tempfile::tempdir().unwrap();
    let collect = [
        "collect",
        "--robot",
        "pointmass",
        "--agent",
        "noise,uniform",
        "--transitions",
        "4k",
        "--seed",
        "3",
        "--json",
    ];
    let (code, whole, err) = call(dir.path(), &[&collect[..], &["--out", "data/whole"]].concat());
    assert_eq!(code, 0, "{err}");
    // As a kill in the middle leaves it: asked for, nothing made.
    std::fs::create_dir_all(dir.path().join("data/half")).unwrap();
    std::fs::copy(
        dir.path().join("data/whole/collect.json"),
        dir.path().join("data/half/collect.json"),
    )
    .unwrap();
    let studio = Studio::start(dir.path(), &[]);
    let shelf = studio.get("/api/shelf").json();
    let begun = &shelf["begun"][0];
    assert_eq!((&begun["path"], &begun["robot"]), (&json!("data/half"), &json!("pointmass")));
    assert_eq!(
        (&begun["agents"], &begun["transitions"]),
        (&json!(["noise", "uniform"]), &json!(4000))
    );
    assert_eq!(shelf["data"].as_array().unwrap().len(), 1);
    let args = ["--robot", "pointmass", "--out", "data/half", "--resume"];
    let job = studio.post("/api/jobs", &json!({"kind": "collect", "args": args})).json();
    let done = ended(&studio, &job);
    assert_eq!(done["phase"], "done", "{done}");
    let shelf = studio.get("/api/shelf").json();
    assert!(shelf["begun"].as_array().unwrap().is_empty(), "{shelf}");
    let whole: Value = serde_json::from_str(&whole).unwrap();
    for data in shelf["data"].as_array().unwrap() {
        assert_eq!(data["sha256"], whole["manifest_sha256"], "the same options, the same bits");
    }
}

#[test]
fn a_training_runs_stops_and_goes_on() {
    let dir = tempfile::tempdir().unwrap();
    let studio = Studio::start(dir.path(), &[]);
    let args = ["--robot", "pointmass", "--transitions", "12000", "--out", "data/pm"];
    let job = studio.post("/api/jobs", &json!({"kind": "collect", "args": args})).json();
    let done = ended(&studio, &job);
    assert_eq!(done["phase"], "done", "{done}");
    assert!(done["progress"]["done"].as_u64().unwrap() > 0, "{done}");
    assert_eq!(studio.get("/api/shelf").json()["data"][0]["path"], "data/pm");
    let args = [
        "--robot",
        "pointmass",
        "--data",
        "data/pm",
        "--preset",
        "pm-tiny",
        "--out",
        "runs/a",
        "--evaluations",
        "0",
        "--threads",
        "1",
        // The closed form of a puck's long history, and large batches, take minutes without
        // optimisation.
        "--set",
        "skip=off",
        "--set",
        "batch=4",
    ];
    let job = studio.post("/api/jobs", &json!({"kind": "train", "args": args})).json();
    let path = format!("/api/jobs/{}", job["id"]);
    let begin = Instant::now();
    let figures = |job: &Value| {
        let lines = job["lines"].as_array().unwrap();
        lines.iter().filter(|l| l["event"] == "figures").count()
    };
    while figures(&studio.get(&path).json()) == 0 {
        let now = studio.get(&path).json();
        assert_eq!(now["phase"], "running", "{now}");
        assert!(begin.elapsed() < Duration::from_secs(120), "{now}");
        std::thread::sleep(Duration::from_millis(50));
    }
    studio.post(&format!("{path}/cancel"), &json!({}));
    assert_eq!(ended(&studio, &job)["phase"], "interrupted");
    let step = studio.get("/api/shelf").json()["runs"][0]["step"].as_u64().unwrap();
    assert!(step > 0);
    let again = studio.post(&format!("{path}/resume"), &json!({})).json();
    assert_eq!(again["args"].as_array().unwrap().last().unwrap(), "runs/a");
    let path = format!("/api/jobs/{}", again["id"]);
    let begin = Instant::now();
    while figures(&studio.get(&path).json()) == 0 {
        assert!(begin.elapsed() < Duration::from_secs(120));
        std::thread::sleep(Duration::from_millis(50));
    }
    studio.post(&format!("{path}/cancel"), &json!({}));
    assert_eq!(ended(&studio, &again)["phase"], "interrupted");
    let curves = studio.get("/api/curves?path=runs%2Fa").json();
    let steps: Vec<u64> =
        curves.as_array().unwrap().iter().filter_map(|l| l["step"].as_u64()).collect();
    assert!(steps.windows(2).all(|w| w[0] < w[1]), "one curve: {steps:?}");
    assert!(*steps.last().unwrap() > step, "it went on");
}

#[test]
fn a_robot_is_imported_and_authored_for() {
    let dir = tempfile::tempdir().unwrap();
    let studio = Studio::start(dir.path(), &[]);
    let urdf = r#"<robot name="one"><link name="base"/><link name="arm">
        <inertial><mass value="1"/><origin xyz="0 0 .2"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>
        <visual><origin xyz="0 0 .2"/><geometry><box size=".05 .05 .4"/></geometry></visual></link>
        <joint name="lift" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
        <limit lower="-1" upper="1" effort="20" velocity="3"/></joint></robot>"#;
    let put = studio.call("PUT", "/api/upload?path=one%2Fone.urdf&first=true", Some(urdf));
    assert_eq!(put.status, 204, "{put:?}");
    for bad in ["..%2Fx.urdf", "%2Fetc%2Fx", "a%5Cb", ""] {
        let refused = studio.call("PUT", &format!("/api/upload?path={bad}"), Some("x"));
        assert_eq!(refused.status, 400, "{bad}");
    }
    let body = json!({"file": "one/one.urdf", "uploaded": true, "id": "one_joint"});
    let done = ended(&studio, &studio.post("/api/import", &body).json());
    assert_eq!(done["phase"], "done", "{done}");
    let robots = studio.get("/api/robots").json();
    let mine = robots.as_array().unwrap().iter().find(|r| r["id"] == "one_joint").unwrap().clone();
    assert_eq!(mine["builtin"], false);
    let view = studio.post("/api/new", &json!({"robot": mine["source"]})).json();
    assert_eq!(view["table"]["joints"][0]["name"], "lift");
    assert!(view["policies"].as_array().unwrap().iter().any(|p| p["default"] == true));
    assert_eq!(studio.get("/api/robot/one_joint").status, 200);
    let refused = studio.post("/api/import", &json!({"file": "x.urdf", "id": "ur5e"}));
    assert_eq!(refused.status, 400);
    let missing = studio.post("/api/import", &json!({"file": "x.urdf", "id": "mine"})).json();
    let failed = ended(&studio, &missing);
    assert_eq!(failed["phase"], "failed");
    assert!(failed["log"].to_string().contains("x.urdf"), "{failed}");
}

#[test]
fn the_example_clients_work() {
    let dir = tempfile::tempdir().unwrap();
    let studio = Studio::start(dir.path(), &[]);
    let address = format!("http://127.0.0.1:{}/#token={}", studio.port, studio.token);
    let (before, after) = example::later(&example::Studio::at(&address).unwrap()).unwrap();
    assert!(before > 0.0 && after > 0.0 && before != after, "{before} {after}");
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/studio_client.py");
    let ran = std::process::Command::new("python3").args([script, &address]).output().unwrap();
    let out = String::from_utf8_lossy(&ran.stdout).into_owned();
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    assert!(out.contains("mean error 0."), "{out}");
    // And a studio of its own.
    let ran = std::process::Command::new("python3")
        .arg(script)
        .env("ROBERT_BIN", binary())
        .env("ROBERT_STATE_DIR", dir.path().join("own"))
        .current_dir(dir.path())
        .output()
        .unwrap();
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
}
