//! A running studio, raw HTTP and a raw WebSocket: nothing between the test and the bytes.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, ChildStderr, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::run::binary;

/// A studio; ends with this value.
#[derive(Debug)]
pub(super) struct Studio {
    child: Child,
    pub(super) port: u16,
    pub(super) token: String,
    pub(super) startup: Duration,
    _stdout: BufReader<ChildStdout>,
    stderr: Option<ChildStderr>,
}

/// One answer.
#[derive(Debug)]
pub(super) struct Answer {
    pub(super) status: u16,
    pub(super) head: String,
    pub(super) body: Vec<u8>,
}

impl Answer {
    pub(super) fn json(&self) -> Value {
        serde_json::from_slice(&self.body)
            .unwrap_or_else(|e| panic!("{e}: {}", String::from_utf8_lossy(&self.body)))
    }

    pub(super) fn header(&self, name: &str) -> Option<&str> {
        self.head.lines().find_map(|l| {
            let (n, v) = l.split_once(':')?;
            n.eq_ignore_ascii_case(name).then_some(v.trim())
        })
    }
}

impl Studio {
    /// Starts with its state in `dir/state`.
    pub(super) fn start(dir: &Path, args: &[&str]) -> Studio {
        let studio =
            Self::try_start(dir, args).unwrap_or_else(|stderr| panic!("no studio: {stderr}"));
        // A shipped network takes its time in a build without optimisation.
        studio.socket().ask("rollout.set", &json!({"policy": "computed-torque"}));
        studio
    }

    /// The same, or what it said instead.
    pub(super) fn try_start(dir: &Path, args: &[&str]) -> Result<Studio, String> {
        Self::try_start_with(dir, args, &[])
    }

    /// With these settings in its environment.
    pub(super) fn try_start_with(
        dir: &Path,
        args: &[&str],
        settings: &[(&str, &Path)],
    ) -> Result<Studio, String> {
        let begin = Instant::now();
        let mut child = Command::new(binary())
            .args(["studio", "--no-open", "--port", "0"])
            .args(args)
            .current_dir(dir)
            .env("ROBERT_STATE_DIR", dir.join("state"))
            .env("ROBERT_LOG", "error")
            .envs(settings.iter().copied())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut stdout = BufReader::new(child.stdout.take().unwrap());
        let mut stderr = child.stderr.take();
        let mut line = String::new();
        stdout.read_line(&mut line).unwrap();
        let Some((address, token)) = line.trim().split_once("/#token=") else {
            let mut text = String::new();
            stderr.take().unwrap().read_to_string(&mut text).unwrap();
            child.wait().unwrap();
            return Err(text);
        };
        let port = address.rsplit(':').next().unwrap().parse().unwrap();
        let (token, startup) = (token.to_owned(), begin.elapsed());
        Ok(Studio { child, port, token, startup, _stdout: stdout, stderr })
    }

    pub(super) fn pid(&self) -> u32 {
        self.child.id()
    }

    /// As a power cut would.
    pub(super) fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// SIGTERM; exit code and the time it took.
    pub(super) fn terminate(self) -> (i32, Duration, String) {
        self.end(rustix::process::Signal::TERM)
    }

    /// The same with this signal.
    pub(super) fn end(mut self, by: rustix::process::Signal) -> (i32, Duration, String) {
        let begin = Instant::now();
        signal(self.pid(), by);
        let status = self.child.wait().unwrap();
        let mut text = String::new();
        self.stderr.take().unwrap().read_to_string(&mut text).unwrap();
        (status.code().unwrap_or(-1), begin.elapsed(), text)
    }

    pub(super) fn raw(&self, bytes: &[u8]) -> Answer {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(100))).unwrap();
        stream.write_all(bytes).unwrap();
        read_answer(&mut BufReader::new(stream))
    }

    /// With the right token.
    pub(super) fn call(&self, method: &str, path: &str, body: Option<&str>) -> Answer {
        let body = body.unwrap_or_default();
        let text = format!(
            "{method} {path} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\nAuthorization: Bearer {}\r\n\
             Content-Type: application/json\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{body}",
            self.port,
            self.token,
            body.len()
        );
        self.raw(text.as_bytes())
    }

    pub(super) fn get(&self, path: &str) -> Answer {
        self.call("GET", path, None)
    }

    pub(super) fn post(&self, path: &str, body: &Value) -> Answer {
        self.call("POST", path, Some(&body.to_string()))
    }

    pub(super) fn state(&self) -> Value {
        self.get("/api/state").json()
    }

    /// Waits until the rollout of this version is done.
    pub(super) fn rolled_out(&self, rev: u64) -> Value {
        let begin = Instant::now();
        loop {
            let rollout = self.get("/api/rollout").json();
            let state = &rollout["state"];
            if state["rev"] == rev && (state["phase"] == "done" || state["phase"] == "failed") {
                return rollout;
            }
            assert!(begin.elapsed() < Duration::from_secs(30), "no rollout: {state}");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    pub(super) fn socket(&self) -> Socket {
        let mut socket = self.connect("/api/ws", None);
        let hello = socket.json();
        assert_eq!(hello["event"], "hello");
        socket.client = hello["client"].as_u64().unwrap();
        socket
    }

    pub(super) fn connect(&self, path: &str, protocol: Option<&str>) -> Socket {
        self.connect_with(path, protocol, "")
    }

    /// With more in the query.
    pub(super) fn connect_with(&self, path: &str, protocol: Option<&str>, query: &str) -> Socket {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        // A flood that the server stops reading must end, not hang the test.
        stream.set_write_timeout(Some(Duration::from_secs(5))).unwrap();
        stream.set_nodelay(true).unwrap();
        let protocol =
            protocol.map(|p| format!("Sec-WebSocket-Protocol: {p}\r\n")).unwrap_or_default();
        let text = format!(
            "GET {path}?token={}{query} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\nConnection: Upgrade\r\n\
             Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\n{protocol}\
             Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n",
            self.token, self.port
        );
        stream.write_all(text.as_bytes()).unwrap();
        let mut reader = BufReader::new(stream);
        let mut head = String::new();
        while !head.ends_with("\r\n\r\n") {
            assert!(reader.read_line(&mut head).unwrap() > 0, "closed: {head}");
        }
        assert!(head.starts_with("HTTP/1.1 101"), "{head}");
        Socket { reader, head, next_id: 0, client: 0 }
    }
}

impl Drop for Studio {
    fn drop(&mut self) {
        self.child.kill().ok();
        self.child.wait().ok();
    }
}

pub(super) fn signal(pid: u32, signal: rustix::process::Signal) {
    assert!(try_signal(pid, signal), "there is no process {pid}");
}

/// Whether there is such a process.
pub(super) fn try_signal(pid: u32, signal: rustix::process::Signal) -> bool {
    let pid = rustix::process::Pid::from_raw(i32::try_from(pid).unwrap()).unwrap();
    rustix::process::kill_process(pid, signal).is_ok()
}

fn read_answer(reader: &mut impl BufRead) -> Answer {
    let mut head = String::new();
    while !head.ends_with("\r\n\r\n") {
        if reader.read_line(&mut head).unwrap_or(0) == 0 {
            break;
        }
    }
    let status = head.split(' ').nth(1).and_then(|s| s.parse().ok()).unwrap_or(0);
    let mut answer = Answer { status, head, body: Vec::new() };
    if status == 101 {
        return answer;
    }
    match answer.header("content-length").and_then(|l| l.parse().ok()) {
        Some(length) => {
            answer.body = vec![0; length];
            reader.read_exact(&mut answer.body).unwrap();
        }
        None => {
            reader.read_to_end(&mut answer.body).ok();
        }
    }
    answer
}

/// An open WebSocket.
#[derive(Debug)]
pub(super) struct Socket {
    reader: BufReader<TcpStream>,
    pub(super) head: String,
    next_id: u64,
    pub(super) client: u64,
}

impl Socket {
    /// A message in one masked frame, as clients must send.
    pub(super) fn send_frame(&mut self, opcode: u8, payload: &[u8]) -> std::io::Result<()> {
        self.send_piece(0x80 | opcode, payload)
    }

    /// A frame with this first byte: 0x80 for the last of a message, and the opcode.
    pub(super) fn send_piece(&mut self, first: u8, payload: &[u8]) -> std::io::Result<()> {
        let mut bytes = vec![first];
        match payload.len() {
            n @ 0..126 => bytes.push(0x80 | n as u8),
            n @ 126..65536 => {
                bytes.push(0x80 | 0x7e);
                bytes.extend((n as u16).to_be_bytes());
            }
            n => {
                bytes.push(0x80 | 0x7f);
                bytes.extend((n as u64).to_be_bytes());
            }
        }
        let mask = [7, 77, 177, 211];
        bytes.extend(mask);
        bytes.extend(payload.iter().enumerate().map(|(i, b)| b ^ mask[i % 4]));
        self.reader.get_mut().write_all(&bytes)
    }

    pub(super) fn send(&mut self, op: &str, args: &Value) -> u64 {
        self.next_id += 1;
        let text = json!({"id": self.next_id, "op": op, "args": args}).to_string();
        self.send_frame(1, text.as_bytes()).unwrap();
        self.next_id
    }

    /// The next data frame; `None` when closed.
    pub(super) fn read(&mut self) -> Option<Vec<u8>> {
        loop {
            let mut head = [0; 2];
            self.reader.read_exact(&mut head).ok()?;
            let len = match head[1] & 0x7f {
                126 => {
                    let mut b = [0; 2];
                    self.reader.read_exact(&mut b).ok()?;
                    u64::from(u16::from_be_bytes(b))
                }
                127 => {
                    let mut b = [0; 8];
                    self.reader.read_exact(&mut b).ok()?;
                    u64::from_be_bytes(b)
                }
                n => u64::from(n),
            };
            let mut payload = vec![0; len as usize];
            self.reader.read_exact(&mut payload).ok()?;
            match head[0] & 0x0f {
                9 => self.send_frame(10, &payload).ok()?,
                8 => return None,
                _ => return Some(payload),
            }
        }
    }

    pub(super) fn json(&mut self) -> Value {
        let payload = self.read().expect("the socket is open");
        serde_json::from_slice(&payload).unwrap()
    }

    /// The next event of this name.
    pub(super) fn event(&mut self, name: &str) -> Value {
        loop {
            let event = self.json();
            if event["event"] == name {
                return event;
            }
        }
    }

    /// Sends and waits for the acknowledgement: an `edit` of ours, or a `reply`.
    pub(super) fn ask(&mut self, op: &str, args: &Value) -> Value {
        let id = self.send(op, args);
        self.answer(id)
    }

    pub(super) fn answer(&mut self, id: u64) -> Value {
        loop {
            let event = self.json();
            let ours = event["event"] == "edit" && event["by"] == self.client;
            if event["id"] == id && (ours || event["event"] == "reply") {
                return event;
            }
        }
    }
}

/// A small clip of the UR5e.
pub(crate) const CLIP: &str = r#"{
  "format": "robert-clip/1",
  "name": "start",
  "robot": {"id": "ur5e", "joints": ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2"]},
  "fps": 20, "length": 60, "fill": "linear",
  "keys": [
    {"frame": 0, "q": [-1.57, -1.57, 1.57, -1.57, -1.57]},
    {"frame": 30, "q": [-1.2, -1.4, 1.4, -1.5, -1.5]}
  ]
}
"#;

/// A key for it.
pub(super) fn key(frame: u32, pan: f64) -> Value {
    json!({"keys": [{"frame": frame, "q": [pan, -1.5, 1.5, -1.5, -1.5]}], "replace": true})
}
