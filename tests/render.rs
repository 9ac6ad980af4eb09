//! `robert render` and `robert plot` through the binary.
//!
//! Pictures need a Vulkan driver; where there is none `robert render` says so with exit 5
//! and these tests have nothing to look at.

use std::process::{Command, Stdio};

use crate::motion::HOP;
use crate::run::{Ran, binary, robert};

const SMALL: [&str; 6] = ["--size", "160x120", "--quality", "preview", "--renderer", "cpu"];

/// Renders the small clip, which must succeed; `None` without a driver.
fn render(more: &[&str]) -> Option<Ran> {
    let ran = robert()
        .file("hop.clip.json", HOP)
        .args(["render", "hop.clip.json", "-q"])
        .args(SMALL)
        .args(more)
        .run();
    if ran.code == 5 {
        assert!(ran.stderr.contains("Vulkan") || ran.stderr.contains("adapter"), "{}", ran.stderr);
        return None;
    }
    assert_eq!(ran.code, 0, "{more:?}: {}", ran.stderr);
    Some(ran)
}

fn png_size(bytes: &[u8]) -> (u32, u32) {
    assert_eq!(&bytes[..8], b"\x89PNG\r\n\x1a\n");
    let number = |at: usize| u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap());
    (number(16), number(20))
}

#[test]
fn stills_and_strips_have_their_size_and_say_so() {
    let Some(ran) = render(&["-o", "a.png", "-p", "computed-torque", "--json"]) else { return };
    let report = ran.json();
    let bytes = std::fs::read(ran.path("a.png")).unwrap();
    assert_eq!(png_size(&bytes), (160, 120));
    assert_eq!((report["frames"].as_u64(), report["width"].as_u64()), (Some(1), Some(160)));
    assert_eq!(report["bytes"].as_u64(), Some(bytes.len() as u64));
    let precision = report["precision"][0].as_f64().unwrap();
    assert!(precision > 0.0 && precision < 0.01, "{precision}");
    assert_eq!(report["unit"][0], "m");

    let ran = render(&["-o", "s.png", "--strip", "4", "--kinematic", "--json"]).unwrap();
    assert_eq!(ran.json()["frames"].as_u64(), Some(4));
    let (width, height) = png_size(&std::fs::read(ran.path("s.png")).unwrap());
    assert!(width >= 4 * 160 && height >= 120, "{width}x{height}");
    assert_eq!(ran.json()["precision"][0].as_f64(), Some(0.0), "poses that nobody performed");

    let some = ["-o", "s.png", "--strip", "3", "--frames", "5..20", "--kinematic", "--json"];
    assert_eq!(render(&some).unwrap().json()["frames"].as_u64(), Some(3), "three of the fifteen");

    let ran = render(&["-o", "c.png", "--compare", "hop.clip.json", "--frames", "3"]).unwrap();
    let (width, _) = png_size(&std::fs::read(ran.path("c.png")).unwrap());
    assert!(width >= 320, "two pictures side by side: {width}");
}

#[test]
fn a_legend_that_has_no_room_is_not_dropped_in_silence() {
    let told = |size: &str| {
        let args = ["render", "hop.clip.json", "-o", "a.png", "--kinematic", "--size", size];
        let ran = robert().file("hop.clip.json", HOP).args(args).args(["--renderer", "cpu"]).run();
        (ran.code, ran.stderr)
    };
    let (code, small) = told("320x240");
    if code == 5 {
        return;
    }
    assert!(small.contains("320x240 px are too few for the legend"), "{small}");
    assert!(!told("640x480").1.contains("legend"));
}

/// Red is an arm that has no joints, beside one that has.
const PAIR: &str = r#"<mujoco><compiler angle="radian" autolimits="true"/><worldbody>
  <body name="left" pos="0 .6 .3"><joint name="lift" axis="0 1 0" range="-1 1" damping="5"/>
    <geom type="capsule" fromto="0 0 0 .4 0 0" size=".03"/></body>
  <geom type="capsule" fromto="0 -.6 .3 .4 -.6 .3" size=".03" rgba="1 0 0 1"/>
  </worldbody><actuator><motor joint="lift" ctrlrange="-9 9"/></actuator></mujoco>"#;

#[test]
fn from_above_the_arm_that_stands_still_is_in_the_picture_too() {
    let clip = r#"{"format": "robert-clip/1", "name": "lift", "robot": {"id": "pair", "joints": ["lift"]},
        "fps": 20, "length": 20, "fill": "linear", "keys": [{"frame": 0, "q": [0]}, {"frame": 19, "q": [0.5]}]}"#;
    let args = ["render", "lift.clip.json", "--robot", "pair", "--kinematic", "-o", "a.png", "-q"];
    let ran = robert()
        .file("pair/robot.xml", PAIR)
        .file("lift.clip.json", clip)
        .args(args)
        .args(["--camera", "top", "--overlay", "none", "--renderer", "cpu", "--size", "160x120"])
        .run();
    if ran.code == 5 {
        return;
    }
    assert_eq!(ran.code, 0, "{}", ran.stderr);
    let file = std::io::BufReader::new(std::fs::File::open(ran.path("a.png")).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    let step = info.color_type.samples();
    let red: Vec<usize> = pixels
        .chunks_exact(step)
        .enumerate()
        .filter(|(_, p)| p[0] / 2 > p[1].max(p[2]) && p[0] > 90)
        .map(|(i, _)| i / info.width as usize)
        .collect();
    assert!(red.len() > 50, "{} red pixels", red.len());
    assert!(red.iter().all(|y| (1..119).contains(y)), "it is cut off");
}

#[test]
fn films_have_every_frame() {
    for (name, magic) in [("a.gif", &b"GIF89a"[..]), ("a.apng", b"\x89PNG"), ("a.mp4", b"")] {
        let Some(ran) = render(&["-o", name, "--kinematic", "--json"]) else { return };
        assert_eq!(ran.json()["frames"].as_u64(), Some(21), "{name}");
        let bytes = std::fs::read(ran.path(name)).unwrap();
        assert!(bytes.starts_with(magic), "{name}");
        if name == "a.mp4" {
            assert_eq!(&bytes[4..8], b"ftyp");
        }
    }
}

/// A take is shown as it was performed: the very picture of the clip that made it.
#[test]
fn a_take_is_drawn_as_its_rollout() {
    let Some(of_clip) = render(&["-o", "a.png", "-p", "pd", "--frames", "9"]) else { return };
    let made = robert()
        .file("hop.clip.json", HOP)
        .args(["rollout", "hop.clip.json", "-p", "pd", "--out", "hop.mcap", "-q"])
        .succeeds();
    let take = std::fs::read(made.path("hop.mcap")).unwrap();
    let of_take = robert()
        .file("hop.mcap", &take)
        .args(["render", "hop.mcap", "-o", "a.png", "--frames", "9", "-q"])
        .args(SMALL)
        .succeeds();
    let read = |ran: &Ran| std::fs::read(ran.path("a.png")).unwrap();
    assert!(read(&of_clip) == read(&of_take), "the pictures differ");
    let other = render(&["-o", "a.png", "-p", "zero", "--frames", "9"]).unwrap();
    assert!(read(&of_clip) != read(&other), "every policy looks the same");
    for (more, word) in [(["-p", "zero"], "--policy"), (["--seed", "3"], "--seed")] {
        let ran = robert()
            .file("hop.mcap", &take)
            .args(["render", "hop.mcap", "-o", "a.png"])
            .args(SMALL)
            .args(more)
            .fails(2);
        assert!(ran.stderr.contains(word) && ran.stderr.contains("is a take"), "{}", ran.stderr);
    }
    // A policy is named as it was typed, and one that performs the clip beside a take is welcome.
    let beside = |more: &[&str]| {
        let ran = robert().file("hop.mcap", &take).file("hop.clip.json", HOP);
        ran.args(["render", "-o", "b.png", "--frames", "9", "-q"]).args(SMALL).args(more)
    };
    let both = ["hop.clip.json", "--compare", "hop.mcap"];
    let ran = beside(&both).args(["--compare-policy", "zero"]).fails(2);
    assert!(ran.stderr.contains("hop.mcap is a take"), "{}", ran.stderr);
    assert!(ran.stderr.contains("; --compare-policy is only for clips"), "{}", ran.stderr);
    beside(&both).args(["-p", "zero"]).succeeds();
    let ran = robert()
        .file("hop.mcap", &take[..take.len() / 2])
        .args(["render", "hop.mcap", "-o", "a.png"])
        .fails(3);
    assert!(ran.stderr.contains("hop.mcap: byte "), "{}", ran.stderr);
}

#[test]
fn mistakes_are_named_before_any_work() {
    let says = |args: &[&str], code: i32, words: &[&str]| {
        let ran = robert().file("hop.clip.json", HOP).args(["render"]).args(args).run();
        if ran.code == 5 {
            return;
        }
        assert_eq!(ran.code, code, "{args:?}: {}", ran.stderr);
        for word in words {
            assert!(ran.stderr.contains(word), "{args:?}: {word} not in {}", ran.stderr);
        }
        assert!(ran.stdout.is_empty());
    };
    says(&["hop.clip.json", "-o", "a.bmp"], 2, &["a.bmp", ".mp4"]);
    for unused in
        ["--policy=pd", "--guide=smooth", "--refine", "--plant=mass=2", "--seed=3", "--threads=2"]
    {
        let flag = unused.split('=').next().unwrap();
        says(&["hop.clip.json", "-o", "a.png", "--kinematic", unused], 2, &["--kinematic", flag]);
    }
    says(&["hop.clip.json", "-o", "a.png", "-p", "magic"], 2, &["magic", "computed-torque"]);
    says(&["hop.clip.json", "-o", "a.mp4", "--strip", "4"], 2, &["strip", ".png"]);
    says(&["hop.clip.json", "-o", "a.png", "--overlay", "hats"], 2, &["hats", "ghost"]);
    says(&["hop.clip.json", "-o", "a.png", "--frames", "21"], 3, &["21", "0 to 20"]);
    says(&["hop.clip.json", "-o", "a.png", "--camera", "follow:nobody"], 2, &["nobody"]);
    let fits = ["fit", "fixed", "top", "orbit", "follow:BODY"];
    says(&["hop.clip.json", "-o", "a.png", "--camera", "nope"], 2, &fits);
    says(&["hop.clip.json", "-o", "a.mp4", "--size", "1x1"], 2, &["1x1", "--size", ".apng"]);
    let wide = ["hop.clip.json", "-o", "a.mp4", "--size", "1920x1080", "--compare"];
    says(&[&wide[..], &["hop.clip.json"]].concat(), 2, &["3846x1080", "--size", ".apng"]);
    let large = ["hop.clip.json", "-o", "a.png", "--size", "8192x8192", "--strip", "64"];
    says(&large, 2, &["49182x90172", "--size"]);
    let wide = ["hop.clip.json", "-o", "a.png", "--size", "8193x16"];
    says(&wide, 2, &["8193x16", "each edge must be 1 to 8192 px"]);
    says(&["hop.clip.json", "-o", "no/a.png"], 1, &["no/a.png", "there is no folder no"]);
    says(&["hop.clip.json", "-o", "hop.clip.json/a.mp4"], 1, &["hop.clip.json/a.mp4"]);
    says(&["fire", "-o", "a.png", "--robot", "ur5e"], 2, &["ur5e", "shadow_hand"]);
    says(&["hop.clip.json", "-o", "a.png", "--frames", "0..80"], 2, &["80 frames", "--strip"]);
    says(&["gone.clip.json", "-o", "a.png"], 3, &["gone.clip.json"]);
    says(&["gone.mcap", "-o", "a.png"], 3, &["gone.mcap"]);
}

/// Whether the process handles this signal by itself.
pub(crate) fn catches(pid: u32, signal: u32) -> bool {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    let mask = status.lines().find_map(|l| l.strip_prefix("SigCgt:")).unwrap_or("0");
    u64::from_str_radix(mask.trim(), 16).unwrap_or(0) >> (signal - 1) & 1 == 1
}

#[test]
fn ctrl_c_ends_a_film_with_130_and_leaves_no_file() {
    if render(&["-o", "a.png", "--kinematic"]).is_none() {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let long = HOP.replace("\"length\": 21", "\"length\": 20000");
    std::fs::write(dir.path().join("long.clip.json"), long).unwrap();
    let mut child = Command::new(binary())
        .args(["render", "long.clip.json", "-o", "long.gif", "--kinematic"])
        .args(SMALL)
        .current_dir(dir.path())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    while !catches(child.id(), 2) {
        assert!(child.try_wait().unwrap().is_none(), "it ended by itself");
        std::thread::yield_now();
    }
    let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
    let out = child.wait_with_output().unwrap();
    let stderr = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(130), "{stderr}");
    assert!(stderr.contains("stopped after"), "{stderr}");
    let left: Vec<_> =
        std::fs::read_dir(dir.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left, ["long.clip.json"], "something half-written stayed");
}

/// Two takes of the small clip and what plot makes of them.
fn plotted(args: &[&str]) -> Ran {
    let take = |policy: &str| {
        let made = robert()
            .file("hop.clip.json", HOP)
            .args(["rollout", "hop.clip.json", "-p", policy, "--out", "t.mcap", "-q"])
            .succeeds();
        std::fs::read(made.path("t.mcap")).unwrap()
    };
    let csv = robert()
        .file("hop.clip.json", HOP)
        .args(["export", "hop.clip.json", "-p", "pd", "--to", "csv", "-q"])
        .succeeds()
        .stdout;
    let command = robert()
        .file("hop.clip.json", HOP)
        .args(["export", "hop.clip.json", "-p", "pd", "--to", "csv", "--what", "command", "-q"])
        .succeeds()
        .stdout;
    robert()
        .file("pd.mcap", take("pd"))
        .file("zero.mcap", take("zero"))
        .file("pd.csv", csv)
        .file("command.csv", command)
        .args(["plot"])
        .args(args)
        .run()
}

#[test]
fn motions_are_plotted_from_takes_and_from_tables() {
    let svg = |args: &[&str]| {
        let ran = plotted(&[args, &["-o", "p.svg"]].concat());
        assert_eq!(ran.code, 0, "{args:?}: {}", ran.stderr);
        assert_eq!(ran.stdout, "p.svg\n");
        let text = std::fs::read_to_string(ran.path("p.svg")).unwrap();
        assert!(text.starts_with("<svg") && text.trim_end().ends_with("</svg>"), "{args:?}");
        text
    };
    let take = svg(&["precision", "a=pd.mcap"]);
    let metres = ["a=pd.csv", "--command", "command.csv", "--unit", "m"];
    let table = svg(&[&["precision"], &metres[..]].concat());
    assert_eq!(take, table, "a take and its tables are one motion");
    let two = svg(&["precision", "pd.mcap", "zero.mcap"]);
    assert!(two.contains("zero") && two.len() > take.len());
    assert_eq!(svg(&["joints", "pd.mcap"]), svg(&[&["joints", "pd.csv"], &metres[1..]].concat()));
    assert_eq!(svg(&["xy", "a=pd.mcap"]), svg(&[&["xy"], &metres[..]].concat()));
    let ran = plotted(&["coverage", "pd.mcap", "-o", "c.png"]);
    assert_eq!(ran.code, 0, "{}", ran.stderr);
    png_size(&std::fs::read(ran.path("c.png")).unwrap());
    let ran = plotted(&["precision", "pd.csv", "-o", "p.svg"]);
    assert_eq!(ran.code, 2);
    assert!(ran.stderr.contains("--command"), "{}", ran.stderr);
    let ran = plotted(&["joints", "pd.csv", "--only", "z", "-o", "p.svg"]);
    assert_eq!(ran.code, 3);
    assert!(ran.stderr.contains("\"z\"") && ran.stderr.contains("x, y"), "{}", ran.stderr);
}

/// A take knows its units; a table is taken for rad unless told.
#[test]
fn axes_have_the_units_of_what_is_drawn() {
    let texts = |args: &[&str]| -> Vec<String> {
        let ran = plotted(&[args, &["-o", "p.svg"]].concat());
        assert_eq!(ran.code, 0, "{args:?}: {}", ran.stderr);
        let svg = std::fs::read_to_string(ran.path("p.svg")).unwrap();
        let lines = svg.lines().map(str::trim).filter(|l| !l.contains('<'));
        lines.filter(|l| l.contains("(m)") || l.contains("rad")).map(str::to_owned).collect()
    };
    for what in ["joints", "precision", "coverage", "xy"] {
        let said = texts(&[what, "pd.mcap"]);
        assert!(said.iter().any(|t| t.contains("(m)")), "{what}: {said:?}");
        assert!(!said.iter().any(|t| t.contains("rad")), "{what}: {said:?}");
    }
    assert_eq!(texts(&["xy", "pd.mcap"]), ["y (m)", "x (m)"]);
    assert_eq!(texts(&["xy", "pd.csv"]), ["y (rad)", "x (rad)"]);
    assert_eq!(texts(&["xy", "pd.csv", "--unit", "mrad"]), ["y (mrad)", "x (mrad)"]);
}

#[test]
fn a_chart_of_two_robots_is_refused() {
    let arm = robert()
        .args(["export", "ur5e/reacher", "-p", "pd", "--to", "csv", "-q"])
        .succeeds()
        .stdout;
    let table = "frame,time,mask,x,y\n0,0,0,0.1,0.2\n1,0.05,0,0.2,0.3\n";
    let says = |args: &[&str], word: &str| {
        let ran = robert()
            .file("arm.csv", &arm)
            .file("puck.csv", table)
            .args(["plot"])
            .args(args)
            .args(["-o", "p.svg"])
            .fails(3);
        assert!(ran.stderr.contains(word), "{args:?}: {}", ran.stderr);
        assert!(!ran.path("p.svg").exists());
    };
    says(&["precision", "a=arm.csv", "b=puck.csv", "--command", "arm.csv"], "puck.csv");
    says(&["joints", "arm.csv", "--command", "puck.csv"], "arm.csv");
    says(&["xy", "arm.csv", "puck.csv"], "puck.csv");
}

/// Values that no axis can hold are left out; names may have an equals sign.
#[test]
fn odd_files_are_drawn_or_refused() {
    let huge = "frame,time,mask,x,y\n0,0,0,-1e308,0\n1,0.05,0,0.5,1\n2,0.1,0,1e308,2\n";
    let ran = robert()
        .file("huge.csv", huge)
        .args(["plot", "joints", "huge.csv", "-o", "p.svg"])
        .succeeds();
    let svg = std::fs::read_to_string(ran.path("p.svg")).unwrap();
    assert!(!svg.contains("NaN") && !svg.contains("inf") && !svg.contains("2147483647"));
    let metrics = "{\"step\": 1, \"loss\": 2}\n{\"step\": 2, \"loss\": 1}\n";
    robert()
        .file("lr=1e-3/metrics.jsonl", metrics)
        .args(["plot", "curves", "lr=1e-3/metrics.jsonl", "-o", "p.svg"])
        .succeeds();
    let bars = |groups: &str, mean: &str, ci95: &str| {
        format!(
            "{{\"groups\": [{groups}], \"sets\": [{{\"name\": \"a\", \"mean\": [{mean}], \"ci95\": [{ci95}]}}]}}"
        )
    };
    let drawn = |text: String| {
        robert().file("b.json", text).args(["plot", "bars", "b.json", "-o", "p.svg"])
    };
    drawn(bars("\"x\", \"y\"", "1, null", "")).succeeds();
    for text in [bars("", "", ""), bars("\"x\", \"y\"", "1", ""), bars("\"x\"", "1", "1, 2")] {
        let ran = drawn(text).fails(3);
        assert!(ran.stderr.contains("b.json: "), "{}", ran.stderr);
    }
    drawn("{\"groups\": [\"x\"], \"sets\": []}".to_owned()).fails(3);
}

#[test]
fn an_evaluation_draws_itself() {
    let eval = |name: &str| {
        robert().file("clips/hop.clip.json", HOP).args([
            "eval",
            "--suite",
            "clips",
            "-p",
            "zero,pd",
            "--seeds",
            "2",
            "--plant",
            "gear=0.8..1.2",
            "--json",
            "-q",
            "--plot",
            name,
        ])
    };
    let ran = eval("bars.svg").succeeds();
    let svg = std::fs::read_to_string(ran.path("bars.svg")).unwrap();
    for word in ["hop", "mean", "zero", "pd", "Precision (m)"] {
        assert!(svg.lines().any(|l| l.trim() == word), "{word}");
    }
    let ran = eval("bars.pdf").fails(2);
    assert!(ran.stderr.contains(".svg"), "{}", ran.stderr);
}

#[test]
fn an_evaluation_is_plotted_as_it_was_printed() {
    let report = robert()
        .file("clips/hop.clip.json", HOP)
        .args(["eval", "--suite", "clips", "-p", "zero,pd", "--json", "-q"])
        .succeeds()
        .stdout;
    let ran = robert()
        .file("eval.json", &report)
        .args(["plot", "bars", "eval.json", "-o", "b.svg"])
        .succeeds();
    let text = std::fs::read_to_string(ran.path("b.svg")).unwrap();
    for word in ["hop", "mean", "zero", "pd"] {
        assert!(text.contains(word), "{word}");
    }
    let ran = robert()
        .file("eval.json", &report)
        .args(["plot", "bars", "eval.json", "--suite", "manual", "-o", "b.svg"])
        .fails(3);
    assert!(ran.stderr.contains("clips"), "{}", ran.stderr);
    let ran = robert()
        .file("x.json", "{\n\"a\": }")
        .args(["plot", "bars", "x.json", "-o", "b.svg"])
        .fails(3);
    assert!(ran.stderr.contains("x.json:2:"), "{}", ran.stderr);
}
