//! Edits, live rollouts and deaths of the simulation, with how long each took: the course of
//! things is asserted, the times, which depend on the machine, are only printed.
//!
//! A test run does a few of each; for figures, all examples and as many as the environment says:
//!
//! `ROBERT_EDITS=60 ROBERT_DEATHS=100 cargo test --release --test it studio::measure -- --nocapture --test-threads 1`

use std::time::{Duration, Instant};

use rustix::process::Signal;
use serde_json::{Value, json};

use super::client::{Studio, signal, try_signal};

/// So many as the environment asks for, else a few.
fn times(name: &str) -> Option<u32> {
    std::env::var(name).ok().and_then(|n| n.parse().ok())
}

fn ms(d: Duration) -> f64 {
    (d.as_secs_f64() * 1e4).round() / 10.0
}

fn share(times: &mut [Duration], share: f64) -> f64 {
    times.sort();
    let at = (times.len() as f64 * share) as usize;
    times.get(at.min(times.len().saturating_sub(1))).map_or(f64::NAN, |d| ms(*d))
}

/// Processor time of a process and its children so far, seconds.
fn cpu_secs(pid: u32) -> f64 {
    let text = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap();
    let fields: Vec<&str> = text.rsplit_once(')').unwrap().1.split_whitespace().collect();
    fields[11..13].iter().map(|f| f.parse::<f64>().unwrap()).sum::<f64>() / 100.0
}

fn resident_mb(pid: u32) -> f64 {
    let text = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
    let line = text.lines().find(|l| l.starts_with("VmRSS:")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse::<f64>().unwrap() / 1024.0
}

/// The worker's process, as soon as it is there: the studio answers before it has started it.
fn worker_pid(studio: &Studio) -> u32 {
    let begin = Instant::now();
    loop {
        let worker = studio.state()["worker"].clone();
        if let Some(pid) = worker["pid"].as_u64() {
            return pid as u32;
        }
        assert!(begin.elapsed() < Duration::from_secs(30), "{worker}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// One example: edits at its middle, from sending to acknowledgement and to the first new
/// frame; then the whole of it anew.
fn editing(studio: &Studio, id: &str, policy: Option<&str>, edits: u32) -> Value {
    let path = format!("/api/gallery/{}", id.replace('/', "%2F"));
    let view = studio.post(&path, &json!({})).json();
    let mut socket = studio.socket();
    if let Some(policy) = policy {
        socket.ask("rollout.set", &json!({"policy": policy}));
    }
    let rev = studio.state()["document"]["rev"].as_u64().unwrap();
    studio.rolled_out(rev);
    let keys = view["clip"]["keys"].as_array().unwrap();
    let middle = &keys[keys.len() / 2]["frame"];
    let joint = view["clip"]["robot"]["joints"][0].as_str().unwrap();
    let (mut acks, mut firsts) = (Vec::new(), Vec::new());
    for n in 0..edits {
        let begin = Instant::now();
        let values = json!({joint: 0.002 * f64::from(n % 7)});
        let sent = socket.send("keys.set", &json!({"frame": middle, "values": values}));
        let (mut ack, mut first) = (None, None);
        while ack.is_none() || first.is_none() {
            let event = socket.json();
            match event["event"].as_str() {
                Some("edit" | "reply") if event["id"] == sent => {
                    ack = Some(begin.elapsed());
                    if event["event"] == "reply" {
                        break;
                    }
                }
                Some("rollout.frames") if ack.is_some() => first = Some(begin.elapsed()),
                _ => {}
            }
        }
        acks.extend(ack);
        firsts.extend(first);
        std::thread::sleep(Duration::from_millis(30));
    }
    // From the first frame on: another seed is another rollout.
    let mut whole = Vec::new();
    for seed in 1..6 {
        let mut settings = studio.state()["rollout"].clone();
        settings["seed"] = json!(seed);
        let begin = Instant::now();
        socket.send("rollout.set", &settings);
        let before = studio.get("/api/rollout").json()["state"]["gen"].clone();
        loop {
            let event = socket.event("rollout.state");
            if event["phase"] == "done" && event["gen"].as_u64() >= before.as_u64() {
                break;
            }
        }
        whole.push(begin.elapsed());
    }
    // A key is dragged: previews of a tail of about 100 frames, each after the last.
    let first = &keys[0]["frame"];
    let op = |n: u32| json!({"op": {"op": "keys.set", "args": {"frame": middle, "values": {joint: 0.003 * f64::from(n % 11)}}}});
    let begin = Instant::now();
    let mut previews = 0;
    while begin.elapsed() < Duration::from_secs(3) {
        socket.ask("preview", &op(previews));
        loop {
            let event = socket.event("rollout.state");
            if event["phase"] == "done" && event["rev"] == 0 {
                break;
            }
        }
        previews += 1;
    }
    json!({
        "example": id, "policy": policy.unwrap_or("default"), "first_key": first,
        "frames": view["clip"]["length"], "edited_frame": middle,
        "ack_ms_p50": share(&mut acks, 0.5), "ack_ms_p99": share(&mut acks, 0.99),
        "first_frame_ms_p50": share(&mut firsts, 0.5), "first_frame_ms_p95": share(&mut firsts, 0.95),
        "whole_ms_p50": share(&mut whole, 0.5),
        "previews_per_sec": f64::from(previews) / begin.elapsed().as_secs_f64(),
    })
}

#[test]
fn edits_are_acknowledged_and_rolled_out() {
    let asked = times("ROBERT_EDITS");
    let dir = tempfile::tempdir().unwrap();
    let studio = Studio::try_start(dir.path(), &[]).unwrap();
    println!("{}", json!({"startup_ms": ms(studio.startup)}));
    let examples = [
        ("pointmass/star", None),
        ("ur5e/hang", None),
        ("shadow_hand/fire", None),
        ("ur5e/hang", Some("computed-torque")),
        ("shadow_hand/fire", Some("computed-torque")),
    ];
    for (id, policy) in examples.into_iter().take(if asked.is_some() { 5 } else { 1 }) {
        println!("{}", editing(&studio, id, policy, asked.unwrap_or(8)));
    }
    if asked.is_none() {
        return;
    }
    // With a document open and nobody there.
    std::thread::sleep(Duration::from_secs(3));
    let pids = [studio.pid(), worker_pid(&studio)];
    let before: f64 = pids.iter().map(|p| cpu_secs(*p)).sum();
    std::thread::sleep(Duration::from_secs(20));
    let busy = pids.iter().map(|p| cpu_secs(*p)).sum::<f64>() - before;
    println!(
        "{}",
        json!({"idle_percent_of_a_core": busy / 20.0 * 100.0, "server_mb": resident_mb(pids[0]), "worker_mb": resident_mb(pids[1])})
    );
}

/// Every signal that ends a process unless it is caught. (A stopped one is in `simulation`.)
const DEADLY: [Signal; 22] = [
    Signal::SEGV,
    Signal::ABORT,
    Signal::BUS,
    Signal::FPE,
    Signal::ILL,
    Signal::KILL,
    Signal::TRAP,
    Signal::SYS,
    Signal::XCPU,
    Signal::QUIT,
    Signal::HUP,
    Signal::INT,
    Signal::TERM,
    Signal::USR1,
    Signal::USR2,
    Signal::ALARM,
    Signal::VTALARM,
    Signal::PROF,
    Signal::IO,
    Signal::POWER,
    Signal::XFSZ,
    Signal::STKFLT,
];

/// Whether this process ignores a signal, as its children do then: one that was started in the background
/// may ignore INT and QUIT.
fn is_ignored(signal: Signal) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let mask = status.lines().find_map(|l| l.strip_prefix("SigIgn:")).unwrap();
    let mask = u64::from_str_radix(mask.trim(), 16).unwrap();
    mask >> (signal.as_raw() - 1) & 1 == 1
}

#[test]
fn deaths_of_the_simulation_cost_no_edit() {
    let deadly: Vec<Signal> = DEADLY.into_iter().filter(|kind| !is_ignored(*kind)).collect();
    let deaths = times("ROBERT_DEATHS").unwrap_or(deadly.len() as u32);
    let dir = tempfile::tempdir().unwrap();
    let studio = Studio::start(dir.path(), &["--robot", "ur5e"]);
    let mut socket = studio.socket();
    let mut again = Vec::new();
    for n in 0..deaths {
        let name = format!("death {n}");
        let kind = deadly[n as usize % deadly.len()];
        let pid = worker_pid(&studio);
        signal(pid, kind);
        let begin = Instant::now();
        let ack = socket.ask("clip.rename", &json!({"name": name}));
        assert_eq!(ack["event"], "edit");
        // Three deaths within a minute are too many for it; a person starts it again.
        let phase = loop {
            let state = studio.state();
            let phase = state["worker"]["phase"].as_str().unwrap().to_owned();
            if phase != "restarting" && state["worker"]["deaths"] == n + 1 {
                break phase;
            }
            assert!(begin.elapsed() < Duration::from_secs(30), "{kind:?} kills nothing: {state}");
            if [Signal::SEGV, Signal::BUS].contains(&kind) && state["worker"]["pid"] == pid {
                // The first one only takes Rust's handler of stack overflows away: a fault of the
                // program itself would come again at once. One that is sent before the handler has
                // run is the same one to the kernel, so it is sent until it kills.
                try_signal(pid, kind);
            }
            std::thread::sleep(Duration::from_millis(2));
        };
        if phase == "stopped" {
            assert!(studio.state()["worker"]["reason"].as_str().unwrap().contains("3 times"));
            socket.ask("worker.restart", &json!({}));
        }
        studio.rolled_out(u64::from(n) + 1);
        again.push(begin.elapsed());
        assert_eq!(studio.state()["document"]["clip"]["name"], name);
    }
    println!(
        "{}",
        json!({"deaths": deaths, "preview_again_ms_p50": share(&mut again, 0.5), "ms_max": share(&mut again, 1.0)})
    );
}
