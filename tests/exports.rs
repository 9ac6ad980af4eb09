//! `robert export` and `robert clip convert` with the formats of other programs.

use std::path::Path;

use crate::run::{Ran, call, robert};

const CLIP: &str = "ur5e/reacher";

/// A take of the arm, its bytes.
fn take() -> Vec<u8> {
    let ran = robert().args(["rollout", CLIP, "-p", "pd", "--out", "a.mcap", "-q"]).succeeds();
    std::fs::read(ran.path("a.mcap")).unwrap()
}

fn exported(take: &[u8], to: &str, out: &str, more: &[&str]) -> Ran {
    let args = ["export", "a.mcap", "--to", to, "-o", out, "--json"];
    robert().file("a.mcap", take).args(args).args(more).succeeds()
}

/// Every format reports its files, which are there, and says what they mean.
#[test]
fn every_format_is_written_twice_the_same() {
    let take = take();
    for (to, out) in [
        ("glb", "a.glb"),
        ("bvh", "a.bvh"),
        ("usda", "a.usda"),
        ("lafan", "a.lafan.csv"),
        ("npz", "a.npz"),
        ("ros", "a.yaml"),
        ("bag", "bag"),
        ("ur", "a.script"),
        ("lerobot", "set"),
        ("minari", "root"),
    ] {
        let (first, second) = (exported(&take, to, out, &[]), exported(&take, to, out, &[]));
        let report = first.json();
        assert_eq!(report["format"], to);
        let files: Vec<String> = serde_json::from_value(report["files"].clone()).unwrap();
        assert!(!files.is_empty() && report["frames"].as_u64().unwrap() > 0, "{to}: {report}");
        for file in &files {
            let read = |ran: &Ran| std::fs::read(ran.path(file)).unwrap();
            assert!(read(&first) == read(&second), "{to}: {file} differs");
        }
        assert!(first.stderr.contains("open it:  "), "{to}: {}", first.stderr);
        assert!(first.stderr.contains(out), "{to}: {}", first.stderr);
    }
}

#[test]
fn clips_are_performed_and_several_are_gathered() {
    let ran = robert()
        .args(["export", CLIP, "ur5e/hang", "-p", "pd", "--to", "lerobot", "-o", "set", "--json"])
        .succeeds();
    let info = std::fs::read(ran.path("set/meta/info.json")).unwrap();
    let info: serde_json::Value = serde_json::from_slice(&info).unwrap();
    assert_eq!((info["total_episodes"].as_u64(), info["total_tasks"].as_u64()), (Some(2), Some(2)));
    let ran = robert()
        .args(["export", CLIP, "ur5e/hang", "-p", "pd", "--to", "bvh", "-o", "motion", "--json"])
        .succeeds();
    assert!(ran.path("motion/reacher.bvh").is_file() && ran.path("motion/hang.bvh").is_file());
    assert_eq!(ran.json()["files"].as_array().unwrap().len(), 2);
}

/// What each reader gives back of what each writer wrote, with every frame kept.
#[test]
fn recorded_motion_comes_back() {
    let take = take();
    let csv = robert().file("a.mcap", &take).args(["export", "a.mcap", "--to", "csv"]).succeeds();
    let want = rows(&csv.stdout);
    for (to, out, more, off) in [
        ("lafan", "a.lafan.csv", &["--fps", "20"][..], 1.1e-6),
        ("npz", "a.npz", &[], 1.5e-6),
        ("bvh", "a.bvh", &[], 1.5e-6),
        ("bag", "bag", &[], 1.1e-6),
        ("lerobot", "set", &[], 1.5e-6),
    ] {
        let fps: &[&str] = if to == "npz" { &["--fps", "20"] } else { &[] };
        let ran = exported(&take, to, out, fps);
        let dir = ran.dir.path();
        let args = ["clip", "convert", out, "b.clip.json", "--robot", "ur5e", "--thin", "0"];
        let (code, _, err) = call(dir, &[&args[..], more].concat());
        assert_eq!(code, 0, "{to}: {err}");
        let (_, text, _) = call(dir, &["clip", "convert", "b.clip.json", "-", "--to", "csv"]);
        let got = rows(&text);
        assert_eq!(got.len(), want.len(), "{to}");
        for (f, (a, b)) in got.iter().zip(&want).enumerate() {
            let far = a.iter().zip(b).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
            assert!(far <= off, "{to} frame {f}: {far}");
        }
        // Thinned, keys stay within the tolerance.
        let args = ["clip", "convert", out, "c.clip.json", "--robot", "ur5e", "--thin", "0.02"];
        assert_eq!(call(dir, &[&args[..], more].concat()).0, 0, "{to}");
        let clip = std::fs::read_to_string(dir.join("c.clip.json")).unwrap();
        let keys = clip.matches("\"frame\":").count();
        assert!(keys > 3 && keys < want.len() / 2, "{to}: {keys} keys of {} frames", want.len());
        let (_, text, _) = call(dir, &["clip", "convert", "c.clip.json", "-", "--to", "csv"]);
        for (f, (a, b)) in rows(&text).iter().zip(&want).enumerate() {
            let far = a.iter().zip(b).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
            assert!(far <= 0.020_01, "{to} frame {f}: {far}");
        }
    }
}

/// A robot whose trunk turns about three hinges, its arm about two, and whose flag no motor moves.
const TRUNK: &str = r#"<mujoco>
  <compiler angle="radian" autolimits="true"/>
  <worldbody>
    <body name="trunk" pos="0 0 .5">
      <joint name="yaw" axis="0 0 1" range="-1.2 1.2" damping="20"/>
      <joint name="pitch" axis="0 1 0" range="-1 1" damping="20"/>
      <joint name="roll" axis="1 .1 0" range="-1 1" damping="20"/>
      <geom type="capsule" fromto="0 0 0 0 0 .3" size=".04" mass="2"/>
      <body name="arm" pos="0 0 .4" euler="0 .2 0">
        <joint name="shoulder" axis="0 1 .2" range="-1 1" damping="5"/>
        <joint name="twist" axis="1 0 0" range="-1 1" damping="5"/>
        <geom type="capsule" fromto=".05 0 0 .3 0 0" size=".03" mass="1"/>
        <body name="flag" pos=".4 0 0">
          <joint name="left/flap" axis="0 0 1" range="-1 1" damping="1"/>
          <geom type="box" size=".05 .01 .05" pos=".06 0 0" mass=".1"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="yaw" ctrlrange="-90 90"/>
    <motor joint="pitch" ctrlrange="-90 90"/>
    <motor joint="roll" ctrlrange="-90 90"/>
    <motor joint="shoulder" ctrlrange="-30 30"/>
    <motor joint="twist" ctrlrange="-30 30"/>
  </actuator>
</mujoco>"#;

/// A take of this robot.
fn of_trunk() -> Ran {
    let clip = r#"{"format": "robert-clip/1", "name": "bow",
      "robot": {"id": "trunk", "joints": ["yaw", "pitch", "roll", "shoulder", "twist", "left/flap"]},
      "fps": 20, "length": 60, "fill": "linear",
      "keys": [{"frame": 0, "q": [0, 0, 0, 0, 0, 0]}, {"frame": 40, "q": [0.9, 0.5, -0.6, 0.7, -0.8, 0.1]}]}"#;
    robert()
        .file("trunk/robot.xml", TRUNK)
        .file("bow.clip.json", clip)
        .args(["rollout", "bow.clip.json", "--robot", "trunk", "-p", "pd", "--out", "a.mcap", "-q"])
        .succeeds()
}

/// BVH has the rotation of a body, from which the angles of several hinges must be found.
#[test]
fn two_and_three_hinges_of_a_body_come_back_from_bvh() {
    let ran = of_trunk();
    let run = |args: &[&str]| {
        let (code, out, err) = call(ran.dir.path(), args);
        assert_eq!(code, 0, "{args:?}: {err}");
        out
    };
    run(&["export", "a.mcap", "--robot", "trunk", "--to", "bvh", "-o", "a.bvh"]);
    run(&["clip", "convert", "a.bvh", "b.clip.json", "--robot", "trunk", "--thin", "0"]);
    let want = rows(&run(&["export", "a.mcap", "--robot", "trunk", "--to", "csv"]));
    let got = rows(&run(&["clip", "convert", "b.clip.json", "-", "--to", "csv"]));
    assert_eq!(got.len(), want.len());
    for (f, (a, b)) in got.iter().zip(&want).enumerate() {
        let far = a.iter().zip(b).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
        assert!(far <= 1.5e-6, "frame {f}: {a:?} {b:?}");
    }
    assert!(want[50].iter().take(5).all(|q| q.abs() > 0.3), "they moved: {:?}", want[50]);
}

/// A controller refuses the name of a joint that it cannot command.
#[test]
fn joints_without_a_motor_are_not_commanded() {
    let ran = of_trunk();
    let run = |args: &[&str]| {
        let all = [&["export", "a.mcap", "--robot", "trunk"][..], args].concat();
        let (code, out, err) = call(ran.dir.path(), &all);
        assert_eq!(code, 0, "{args:?}: {err}");
        (out, err)
    };
    for what in ["achieved", "command"] {
        let (yaml, told) = run(&["--to", "ros", "--what", what]);
        assert!(yaml.contains("twist") && !yaml.contains("flap"), "{what}: {yaml}");
        assert!(told.contains("no motor moves them directly: left/flap."), "{what}: {told}");
    }
    run(&["--to", "bag", "-o", "bag"]);
    let args = ["clip", "convert", "bag", "b.clip.json", "--robot", "trunk", "--thin", "0"];
    assert_eq!(call(ran.dir.path(), &args).0, 0, "the states in a bag have all joints");
    let clip = std::fs::read_to_string(ran.path("b.clip.json")).unwrap();
    assert!(clip.contains("left/flap"), "{clip}");
    run(&["--to", "lerobot", "-o", "set"]);
    let info = std::fs::read(ran.path("set/meta/info.json")).unwrap();
    let info: serde_json::Value = serde_json::from_slice(&info).unwrap();
    let names = |feature: &str| info["features"][feature]["names"].to_string();
    assert!(names("observation.state").contains("left_flap.pos"), "{info}");
    assert!(names("action").contains("twist.pos") && !names("action").contains("flap"), "{info}");
    assert_eq!(info["features"]["action"]["shape"], serde_json::json!([5]));
}

/// Values of a CSV without its three leading columns.
fn rows(text: &str) -> Vec<Vec<f64>> {
    let row = |line: &str| line.split(',').skip(3).map(|c| c.parse().unwrap()).collect();
    text.lines().skip(1).map(row).collect()
}

#[test]
fn what_does_not_fit_is_refused_with_its_reason() {
    let take = take();
    let fails = |args: &[&str], code: i32, words: &str| {
        let ran = robert().file("a.mcap", &take).file("note/x", "y").args(args).fails(code);
        assert!(ran.stderr.contains(words), "{args:?}: {}", ran.stderr);
    };
    let export = |more: &[&'static str]| [&["export", "a.mcap", "--to"][..], more].concat();
    fails(&export(&["glb", "--goal"]), 2, "--goal is for --to ros");
    fails(&export(&["csv", "--video", "64x64"]), 2, "--video is for --to lerobot");
    for (flag, value, of) in [
        ("--bodies", "mujoco", "npz"),
        ("--ur-move", "servoj", "ur"),
        ("--action", "position", "lerobot"),
        ("--lerobot-version", "3.0", "lerobot"),
        ("--viser-client", "note/x", "html"),
    ] {
        fails(&export(&["csv", flag, value]), 2, &format!("{flag} is for --to {of}"));
    }
    fails(&export(&["ros", "--lead-in=-1", "-o", "a.yaml"]), 2, "--lead-in takes 0 to 3600");
    fails(&export(&["lerobot", "-o", "-"]), 2, "a folder cannot go to stdout");
    fails(&export(&["lerobot", "-o", "note"]), 2, "no earlier export");
    fails(&["export", "pointmass/circle", "-p", "pd", "--to", "ur"], 3, "the joints of a UR5e");
    let read = |more: &[&'static str]| [&["clip", "convert"][..], more].concat();
    fails(&read(&["x.lafan.csv", "b.clip.json", "--robot", "ur5e"]), 2, "does not say its rate");
    fails(&read(&["a.mcap", "b.bvh"]), 2, "robert export a.mcap");
    let ran = robert()
        .file("w.lafan.csv", "0,0,1,0,0,0,1,0,0\n")
        .args(["clip", "convert", "w.lafan.csv", "b.clip.json", "--robot", "ur5e", "--fps", "30"])
        .fails(3);
    assert!(ran.stderr.contains("w.lafan.csv: line 1: 9 columns"), "{}", ran.stderr);
}

/// A command leaves as a trajectory for a real controller and comes back as it was, two
/// seconds later.
#[test]
fn a_goal_with_a_lead_in_comes_back_later() {
    let take = take();
    let more = ["--what", "command", "--goal", "--lead-in", "2"];
    let ran = exported(&take, "ros", "a.yaml", &more);
    let dir = ran.dir.path();
    let args = ["clip", "convert", "a.yaml", "b.clip.json", "--robot", "ur5e"];
    assert_eq!(call(dir, &args).0, 0);
    let command = |file: &str, what: &[&str]| {
        let (code, text, err) =
            call(dir, &[&["clip", "convert", file, "-", "--to", "csv"], what].concat());
        assert_eq!(code, 0, "{err}");
        let row = |l: &str| l.splitn(4, ',').nth(3).map(str::to_owned);
        text.lines().skip(1).filter(|l| !l.starts_with("-1,")).filter_map(row).collect::<Vec<_>>()
    };
    let (before, after) = (command("a.mcap", &[]), command("b.clip.json", &[]));
    assert_eq!(after.len(), before.len() + 40);
    assert!(
        after[40..].iter().zip(&before).all(|(a, b)| a == b || b.is_empty()),
        "{:?}",
        &after[40..44]
    );
}

/// Collected data becomes a Minari dataset of as many episodes.
#[test]
fn collected_data_becomes_datasets() {
    let ran = robert()
        .args([
            "collect",
            "--robot",
            "pointmass",
            "--agent",
            "noise",
            "--transitions",
            "2k",
            "--out",
            "data",
            "-q",
        ])
        .succeeds();
    let dir = ran.dir.path();
    for (to, count) in [("minari", "part-0.parquet"), ("lerobot", "info.json")] {
        let (code, out, err) = call(dir, &["export", "data", "--to", to, "-o", to, "--json"]);
        assert_eq!(code, 0, "{err}");
        let report: serde_json::Value = serde_json::from_str(&out).unwrap();
        let files: Vec<String> = serde_json::from_value(report["files"].clone()).unwrap();
        assert!(files.iter().any(|f| f.ends_with(count)), "{files:?}");
        assert!(files.iter().all(|f| Path::new(&dir.join(f)).is_file()));
        assert_eq!(report["frames"], 2000);
    }
    let (code, _, err) = call(dir, &["export", "data", "--to", "glb", "-o", "a.glb"]);
    assert_eq!(code, 2);
    assert!(err.contains("data is a folder") && err.contains("--to lerobot"), "{err}");
}
