//! Only our own page and whoever has the token get in.

use std::fmt::Write as _;

use super::client::{CLIP, Studio};

struct Row {
    host: Vec<String>,
    origin: Option<String>,
    token: Option<String>,
    request: &'static str,
    expected: fn(u16) -> bool,
    what: String,
}

const REQUESTS: [&str; 7] = ["asset", "get", "post", "plain", "put", "socket", "preflight"];

fn bytes(row: &Row) -> Vec<u8> {
    let (method, path, extra, body) = match row.request {
        "asset" => ("GET", "/", "", ""),
        "get" => ("GET", "/api/clip", "", ""),
        "post" => ("POST", "/api/undo", "Content-Type: application/json\r\n", ""),
        "plain" => ("POST", "/api/ops", "Content-Type: text/plain\r\n", "{\"ops\":[]}"),
        "put" => ("PUT", "/api/clip", "", CLIP),
        "socket" => (
            "GET",
            "/api/ws",
            "Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\n\
             Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n",
            "",
        ),
        _ => ("OPTIONS", "/api/clip", "Access-Control-Request-Method: PUT\r\n", ""),
    };
    let mut text = format!("{method} {path} HTTP/1.1\r\n");
    for host in &row.host {
        write!(text, "Host: {host}\r\n").unwrap();
    }
    if let Some(origin) = &row.origin {
        write!(text, "Origin: {origin}\r\n").unwrap();
    }
    if let Some(token) = &row.token {
        write!(text, "Authorization: Bearer {token}\r\n").unwrap();
    }
    let connection = if row.request == "socket" { "Upgrade" } else { "close" };
    write!(text, "{extra}Connection: {connection}\r\nContent-Length: {}\r\n\r\n", body.len())
        .unwrap();
    (text + body).into_bytes()
}

/// What gets through when everything is right.
fn passes(request: &str) -> fn(u16) -> bool {
    match request {
        "asset" | "get" | "post" | "put" => |s| s == 200,
        "plain" => |s| s == 415,
        "socket" => |s| s == 101,
        _ => |s| s == 405,
    }
}

fn rows(studio: &Studio, other_run: &str) -> Vec<Row> {
    let p = studio.port;
    let mut rows = Vec::new();
    let wrong = "0".repeat(64);
    let tokens: [(&str, Option<&str>); 4] = [
        ("right", Some(&studio.token)),
        ("wrong", Some(&wrong)),
        ("absent", None),
        ("other run", Some(other_run)),
    ];
    for host in [format!("127.0.0.1:{p}"), format!("localhost:{p}"), format!("[::1]:{p}")] {
        let origins: [(Option<String>, bool); 8] = [
            (None, true),
            (Some(format!("http://{host}")), true),
            (Some("null".into()), false),
            (Some("http://evil.com".into()), false),
            (Some(format!("https://{host}")), false),
            (Some(format!("http://127.0.0.1:{}", p ^ 1)), false),
            (Some("file://".into()), false),
            (Some(format!("http://{host}.evil.com")), false),
        ];
        for (origin, own) in &origins {
            for (name, token) in &tokens {
                for request in REQUESTS {
                    let expected: fn(u16) -> bool = match (own, request, *name) {
                        (false, ..) => |s| s == 403,
                        (true, "asset", _) | (true, _, "right") => passes(request),
                        _ => |s| s == 401,
                    };
                    rows.push(Row {
                        host: vec![host.clone()],
                        origin: origin.clone(),
                        token: token.map(str::to_owned),
                        request,
                        expected,
                        what: format!("{host} {origin:?} {name} {request}"),
                    });
                }
            }
        }
    }
    let strangers: [Vec<String>; 12] = [
        vec![format!("evil.com:{p}")],
        vec![format!("127.0.0.1.evil.com:{p}")],
        vec![format!("localhost.evil.com:{p}")],
        vec![format!("0.0.0.0:{p}")],
        vec![format!("attacker:{p}")],
        vec![format!("2130706433:{p}")],
        vec![format!("127.1:{p}")],
        vec!["127.0.0.1".into()],
        vec![format!("127.0.0.1:{}", p ^ 1)],
        vec![],
        vec![format!("127.0.0.1:{p}"), "evil.com".into()],
        vec![String::new()],
    ];
    for host in &strangers {
        for token in [Some(studio.token.clone()), None] {
            for request in REQUESTS {
                rows.push(Row {
                    host: host.clone(),
                    origin: host.first().map(|h| format!("http://{h}")),
                    token: token.clone(),
                    request,
                    // hyper itself refuses an empty Host with 400.
                    expected: |s| s == 403 || s == 400,
                    what: format!("stranger {host:?} {request}"),
                });
            }
        }
    }
    rows
}

#[test]
fn only_the_right_rows_pass() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("a.clip.json"), CLIP).unwrap();
    let studio = Studio::start(dir.path(), &["a.clip.json"]);
    let other_dir = tempfile::tempdir().unwrap();
    let other = Studio::start(other_dir.path(), &[]);
    let rows = rows(&studio, &other.token);
    assert!(rows.len() > 700, "{}", rows.len());
    let mut wrong = Vec::new();
    for row in &rows {
        let answer = studio.raw(&bytes(row));
        if !(row.expected)(answer.status) {
            wrong.push(format!("{}: {}", row.what, answer.status));
        }
        if answer.status != 400 {
            assert!(answer.header("access-control-allow-origin").is_none(), "{}", row.what);
            assert_eq!(answer.header("x-content-type-options"), Some("nosniff"), "{}", row.what);
            assert!(answer.header("content-security-policy").is_some(), "{}", row.what);
        }
    }
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), rows.len(), wrong.join("\n"));
}

#[test]
fn the_token_is_exchanged_for_a_strict_cookie() {
    let dir = tempfile::tempdir().unwrap();
    let studio = Studio::start(dir.path(), &[]);
    let answer = studio.call("POST", "/api/session", None);
    assert_eq!(answer.status, 204);
    let cookie = answer.header("set-cookie").unwrap().to_owned();
    assert!(cookie.contains("HttpOnly") && cookie.contains("SameSite=Strict"));
    assert!(!cookie.contains(&studio.token), "the cookie is a secret of its own");
    let pair = cookie.split(';').next().unwrap();
    let get = |extra: &str| {
        let text = format!(
            "GET /api/state HTTP/1.1\r\nHost: 127.0.0.1:{}\r\nCookie: {pair}\r\n{extra}\
             Connection: close\r\n\r\n",
            studio.port
        );
        studio.raw(text.as_bytes()).status
    };
    assert_eq!(get(""), 200);
    assert_eq!(get("Sec-Fetch-Site: same-origin\r\n"), 200);
    // A page of another local port is "same-site": the cookie comes along, we say no.
    assert_eq!(get("Sec-Fetch-Site: same-site\r\n"), 403);
    let socket = |origin: &str| {
        let text = format!(
            "GET /api/ws HTTP/1.1\r\nHost: 127.0.0.1:{p}\r\nCookie: {pair}\r\n{origin}\
             Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n\
             Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n",
            p = studio.port
        );
        studio.raw(text.as_bytes()).status
    };
    assert_eq!(socket(&format!("Origin: http://127.0.0.1:{}\r\n", studio.port)), 101);
    assert_eq!(socket("Origin: http://evil.com\r\n"), 403);
    assert_eq!(socket(""), 403);
    // The target of the request line counts, too.
    let absolute = format!(
        "GET http://evil.com/ HTTP/1.1\r\nHost: 127.0.0.1:{}\r\nConnection: close\r\n\r\n",
        studio.port
    );
    assert_eq!(studio.raw(absolute.as_bytes()).status, 403);
}

#[test]
fn heads_and_bodies_have_caps() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("a.clip.json"), CLIP).unwrap();
    let studio = Studio::start(dir.path(), &["a.clip.json"]);
    let head = |bytes: usize| {
        let rest = "GET / HTTP/1.1\r\nHost: x\r\nX: \r\n\r\n".len();
        let text = format!("GET / HTTP/1.1\r\nHost: x\r\nX: {}\r\n\r\n", "y".repeat(bytes - rest));
        studio.raw(text.as_bytes()).status
    };
    // What comes in one piece may be a little longer, since it is read already.
    assert_ne!(head(robert::limits::HEAD_BYTES), 431, "it is read, and refused for its host");
    assert_eq!(head(robert::limits::HEAD_BYTES + 4_096), 431);
    let body = |bytes: usize| {
        let rest = "{\"path\":\"\"}".len();
        let text = format!("{{\"path\":\"{}\"}}", "a".repeat(bytes - rest));
        studio.call("POST", "/api/open", Some(&text)).status
    };
    let most = robert::limits::REQUEST_BYTES;
    assert_eq!(body(most + 1), 413);
    assert_ne!(body(most), 413, "it is read, and refused for its path");
    for path in ["/ui/../Cargo.toml", "/ui/%2e%2e/Cargo.toml", "/etc/passwd", "/viser/../x"] {
        assert_eq!(studio.get(path).status, 404, "{path}");
    }
    let nested = format!("{{\"ops\":{}", "[".repeat(100_000));
    let refused = studio.call("POST", "/api/ops", Some(&nested));
    assert!(matches!(refused.status, 400 | 422), "{refused:?}");
    assert_eq!(studio.get("/api/clip").status, 200);
}
