//! Tabs, undo, files, bad input.

use std::time::Duration;

use serde_json::{Value, json};

use super::client::{CLIP, Studio, key};
use crate::run::robert;
use robert::limits;

fn open(dir: &tempfile::TempDir) -> Studio {
    std::fs::write(dir.path().join("a.clip.json"), CLIP).unwrap();
    Studio::start(dir.path(), &["a.clip.json"])
}

#[test]
fn two_tabs_stay_in_step() {
    let dir = tempfile::tempdir().unwrap();
    let studio = open(&dir);
    let (mut one, mut two) = (studio.socket(), studio.socket());
    let ack = one.ask("keys.add", &key(45, 0.3));
    let seen = two.event("edit");
    assert_eq!((&ack["rev"], &ack["patch"]), (&seen["rev"], &seen["patch"]));
    assert_eq!(seen["by"], one.client);
    let back = two.ask("undo", &json!({}));
    assert_eq!(one.event("edit")["rev"], back["rev"]);
    assert_eq!(back["patch"]["keys_removed"], json!([45]));
    let refused = one.ask("keys.add", &json!({"keys": [{"frame": 9, "q": [1]}]}));
    assert_eq!(refused["error"]["code"], "invalid");
    let unknown = one.ask("keys.dance", &json!({}));
    assert_eq!(unknown["error"]["code"], "request");
    // Both tabs see what each of them would read afresh.
    assert_eq!(one.ask("redo", &json!({}))["rev"], two.event("edit")["rev"]);
    assert_eq!(studio.state()["document"]["history"]["done"], 1);
    assert_eq!(studio.state()["clients"], 2);
}

#[test]
fn the_seventeenth_client_is_turned_away() {
    let dir = tempfile::tempdir().unwrap();
    let studio = open(&dir);
    let sockets: Vec<_> = (0..16).map(|_| studio.socket()).collect();
    let text = format!(
        "GET /api/ws?token={} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\nConnection: Upgrade\r\n\
         Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\n\
         Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n",
        studio.token, studio.port
    );
    assert_eq!(studio.raw(text.as_bytes()).status, 429);
    drop(sockets);
    std::thread::sleep(Duration::from_millis(100));
    studio.socket();
}

#[test]
fn saving_writes_the_canonical_text() {
    let dir = tempfile::tempdir().unwrap();
    let studio = open(&dir);
    studio.socket().ask("keys.add", &key(45, 0.3));
    assert_eq!(studio.state()["document"]["dirty"], true);
    assert_eq!(studio.post("/api/save", &json!({})).status, 200);
    assert_eq!(studio.state()["document"]["dirty"], false);
    drop(studio);
    let text = std::fs::read_to_string(dir.path().join("a.clip.json")).unwrap();
    let formatted = robert().file("a.clip.json", &text).args(["clip", "fmt", "a.clip.json"]).run();
    assert_eq!(formatted.code, 0, "{}", formatted.stderr);
    assert_eq!(std::fs::read_to_string(formatted.path("a.clip.json")).unwrap(), text);
}

/// The browser's banner says what the shell says.
#[test]
fn bad_files_give_the_text_of_the_command_line() {
    let dir = tempfile::tempdir().unwrap();
    let studio = open(&dir);
    let swap = |from: &str, to: &str| CLIP.replace(from, to).into_bytes();
    let bad: Vec<Vec<u8>> = vec![
        Vec::new(),
        b"{".to_vec(),
        b"\xff\xfe{}".to_vec(),
        b"\xef\xbb\xbf{}".to_vec(),
        b"null".to_vec(),
        b"[]".to_vec(),
        "[".repeat(100_000).into_bytes(),
        swap("robert-clip/1", "robert-clip/9"),
        swap("robert-clip/1", "bvh"),
        swap("\"fps\": 20", "\"fps\": 30"),
        swap("\"fps\": 20", "\"fps\": -1"),
        swap("\"length\": 60", "\"length\": 0"),
        swap("\"length\": 60", "\"length\": 1e9"),
        swap("\"length\": 60", "\"length\": 20"),
        swap("\"linear\"", "\"spline\""),
        swap("-1.57,", "NaN,"),
        swap("-1.57,", "1e999,"),
        swap("-1.57,", "Infinity,"),
        swap("-1.57,", "\"x\","),
        swap("-1.57, -1.57,", "-1.57,"),
        swap("\"frame\": 30", "\"frame\": 0"),
        swap("\"frame\": 30", "\"frame\": -3"),
        swap("\"frame\": 30", "\"frame\": 2.5"),
        swap("\"frame\": 30", "\"fram\": 30"),
        swap("\"frame\": 30, \"q\"", "\"frame\": 30, \"pose\": \"x\", \"q\""),
        swap("\"frame\": 30, \"q\": [-1.2, -1.4, 1.4, -1.5, -1.5]", "\"frame\": 30"),
        swap(
            "\"frame\": 30, \"q\": [-1.2, -1.4, 1.4, -1.5, -1.5]",
            "\"frame\": 30, \"pose\": \"no\"",
        ),
        swap("\"elbow\"", "\"shoulder_pan\""),
        swap("\"elbow\"", "7"),
        swap("\"id\": \"ur5e\", ", ""),
        swap("\"keys\"", "\"kyes\""),
        swap("\"keys\"", "\"masks\": [{\"from\": 9, \"to\": 3}], \"keys\""),
        swap("\"keys\"", "\"masks\": [{\"from\": 1, \"to\": 3, \"joints\": [\"nose\"]}], \"keys\""),
        swap("\"keys\"", "\"markers\": [{\"frame\": 900, \"name\": \"x\"}], \"keys\""),
        swap("\"keys\"", "\"poses\": {\"a\": [1]}, \"keys\""),
        swap("\"keys\"", "\"start\": {\"pose\": \"no\"}, \"keys\""),
        swap("\"keys\"", "\"keys\": [], \"keys\""),
        swap("]\n}", "]\n} trailing"),
        swap("\"q\": [-1.2", "\"hold\": 0, \"q\": [-1.2"),
        swap("\"q\": [-1.2", "\"fill\": 3, \"q\": [-1.2"),
        swap("-1.2,", "1e300,"),
    ];
    assert!(bad.len() >= 40, "{}", bad.len());
    for (i, text) in bad.iter().enumerate() {
        let name = format!("bad{i}.clip.json");
        std::fs::write(dir.path().join(&name), text).unwrap();
        let full = dir.path().join(&name);
        let cli = robert()
            .args([std::ffi::OsStr::new("rollout"), full.as_os_str()])
            .args(["--policy", "zero"])
            .fails(3);
        let begin = std::time::Instant::now();
        let api = studio.post("/api/open", &json!({"path": name}));
        assert!(begin.elapsed() < Duration::from_secs(1), "{i}");
        assert_eq!(api.status, 422, "{i}: {api:?}");
        let body = api.json();
        let message = body["message"].as_str().unwrap();
        assert!(cli.stderr.contains(message), "{i}:\n cli {}\n api {message}", cli.stderr);
        assert!(body["place"]["line"].as_u64().unwrap() >= 1, "{i}: {body}");
        assert!(message.contains(&name), "{i}: no path in {message}");
    }
    assert_eq!(studio.state()["document"]["clip"]["name"], "start", "the old clip is still open");
}

#[test]
fn no_number_that_is_none_gets_to_the_robot() {
    let dir = tempfile::tempdir().unwrap();
    let studio = open(&dir);
    for bad in ["NaN", "Infinity", "-Infinity", "1e999", "-1e999", "1e308", "\"NaN\"", "null"] {
        let row = format!("[{bad},0,0,0,0]");
        let bodies = [
            (
                "POST",
                "/api/ops",
                format!(
                    "{{\"ops\":[{{\"op\":\"keys.add\",\"args\":{{\"keys\":[{{\"frame\":5,\"q\":{row}}}]}}}}]}}"
                ),
            ),
            (
                "POST",
                "/api/ops",
                format!(
                    "{{\"ops\":[{{\"op\":\"clip.start\",\"args\":{{\"start\":{{\"q\":{row}}}}}}}]}}"
                ),
            ),
            (
                "POST",
                "/api/ops",
                format!(
                    "{{\"ops\":[{{\"op\":\"keys.scale\",\"args\":{{\"frames\":[30],\"pivot\":0,\"factor\":{bad}}}}}]}}"
                ),
            ),
            (
                "POST",
                "/api/ops",
                format!(
                    "{{\"ops\":[{{\"op\":\"patch\",\"args\":{{\"keys_put\":[{{\"frame\":7,\"q\":{row}}}]}}}}]}}"
                ),
            ),
            ("POST", "/api/kinematics", format!("{{\"q\":[{row}]}}")),
            ("POST", "/api/settle", format!("{{\"q\":{row}}}")),
            (
                "POST",
                "/api/ik",
                format!("{{\"q\":{row},\"site\":\"attachment_site\",\"pos\":[0,0,0]}}"),
            ),
            (
                "POST",
                "/api/ik",
                format!("{{\"q\":[0,0,0,0,0],\"site\":\"attachment_site\",\"pos\":[{bad},0,0]}}"),
            ),
            ("PUT", "/api/clip", CLIP.replace("-1.2,", &format!("{bad},"))),
        ];
        for (method, path, body) in bodies {
            let answer = studio.call(method, path, Some(&body));
            // Clips may leave a joint open (null); nothing else may pass.
            let open = bad == "null" && (path == "/api/ops" || path == "/api/clip");
            assert!(
                open || (400..500).contains(&answer.status),
                "{bad} {path} {body}: {}",
                answer.status
            );
        }
        let mut socket = studio.socket();
        for op in ["view.pose", "view.frame", "view.play", "preview"] {
            let args = match op {
                "view.pose" => format!("{{\"q\":{row}}}"),
                "view.frame" => format!("{{\"frame\":{bad}}}"),
                "view.play" => format!("{{\"frame\":0,\"speed\":{bad}}}"),
                _ => format!(
                    "{{\"op\":{{\"op\":\"keys.add\",\"args\":{{\"keys\":[{{\"frame\":5,\"q\":{row}}}]}}}}}}"
                ),
            };
            let text = format!("{{\"id\":1,\"op\":\"{op}\",\"args\":{args}}}");
            socket.send_frame(1, text.as_bytes()).unwrap();
            socket.event("reply");
        }
        socket.ask("preview.end", &json!({}));
    }
    let rev = studio.state()["document"]["rev"].as_u64().unwrap();
    let rollout = studio.rolled_out(rev);
    assert_eq!(rollout["state"]["phase"], "done");
    let frames = rollout["q"].as_array().unwrap();
    assert_eq!(frames.len(), 60);
    let finite = |row: &Value| {
        row.as_array().unwrap().iter().all(|v| v.as_f64().is_some_and(f64::is_finite))
    };
    assert!(frames.iter().all(finite));
}

#[test]
fn as_many_pins_and_points_are_asked_for_as_the_limits_say() {
    let dir = tempfile::tempdir().unwrap();
    let studio = open(&dir);
    let full = |answer: super::client::Answer| {
        let text = String::from_utf8_lossy(&answer.body).into_owned();
        assert_ne!(answer.status, 500, "{text}");
        text.contains("too many")
    };
    let ik = |pins: usize| {
        let pins = vec![json!({"site": "attachment_site"}); pins];
        full(studio.post("/api/ik", &json!({"q": [0, 0, 0, 0, 0], "pins": pins})))
    };
    assert_eq!([ik(limits::PINS), ik(limits::PINS + 1)], [false, true]);
    let draw = |points: usize| {
        let points: Vec<_> = (0..points).map(|n| json!([0.4, 0.5, n])).collect();
        let body = json!({"tab": "t", "q": [0, 0, 0, 0, 0], "site": "attachment_site",
            "plane": "ground", "points": points, "tolerance_m": 0.01});
        full(studio.post("/api/draw", &body))
    };
    assert_eq!([draw(limits::DRAWN_POINTS), draw(limits::DRAWN_POINTS + 1)], [false, true]);
}

#[test]
fn the_gallery_opens_and_exports() {
    let dir = tempfile::tempdir().unwrap();
    let studio = Studio::start(dir.path(), &[]);
    assert!(studio.state()["document"].is_null());
    assert_eq!(studio.get("/api/clip").status, 404);
    let items = studio.get("/api/gallery").json();
    let featured: Vec<&Value> =
        items.as_array().unwrap().iter().filter(|i| i["featured"] == true).collect();
    assert_eq!(featured.len(), 6);
    let view = studio.post("/api/gallery/pointmass/star", &json!({}));
    assert_eq!(view.status, 200, "{view:?}");
    let rollout = studio.rolled_out(0);
    assert_eq!(rollout["state"]["phase"], "done");
    assert!(rollout["state"]["mae"].as_f64().unwrap() < 0.1);
    for format in ["json", "csv", "command", "achieved-csv"] {
        let file = studio.get(&format!("/api/export?format={format}"));
        assert_eq!(file.status, 200, "{format}");
        assert!(file.body.len() > 100 && file.header("content-disposition").is_some());
        if format.ends_with("csv") {
            assert!(file.body.starts_with(b"frame,time,mask,x,y\n"), "{format}");
            assert!(file.body.windows(9).any(|w| w.starts_with(b"\n2,0.1,")), "{format}");
        }
    }
    assert_eq!(studio.get("/api/export?format=usd").status, 400);
    assert_eq!(studio.post("/api/gallery/pointmass/none", &json!({})).status, 404);
    let robots = studio.get("/api/robots").json();
    assert!(robots.as_array().unwrap().iter().any(|r| r["id"] == "shadow_hand"));
    let hand = studio.get("/api/robot/shadow_hand").json();
    assert_eq!(hand["table"]["joints"].as_array().unwrap().len(), 22);
    assert_eq!(studio.get("/api/robot/nobody").status, 422);
}
