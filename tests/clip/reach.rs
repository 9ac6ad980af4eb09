//! End-effector goals: what clips with them command, and what the command line makes of them.

use std::fs;
use std::path::Path;

use robert::clip::*;
use robert::robot::Robot;
use robert::rollout::ClipFacts as _;

use crate::run::{call, robert};

const TOOL: &str = "end_effector";

fn example(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/clips").join(name);
    fs::read_to_string(path).unwrap()
}

/// Where a point of the robot is when the joints have a row's values, m.
fn place(robot: &Robot, row: &[f32], point: &Point) -> [f64; 3] {
    let state: Vec<f64> = row.iter().map(|v| f64::from(*v)).collect();
    let tree = robot.kinematics();
    tree.place(&state, &tree.point(point).unwrap()).pos
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// Greatest change of a joint between two frames, rad.
fn jump(command: &Command, frame: u32) -> f64 {
    let (a, b) = (command.row(frame), command.row(frame + 1));
    a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max)
}

#[test]
fn the_tool_draws_the_square_that_its_corners_say() {
    let robot = Robot::builtin("ur5e").unwrap();
    let clip = Clip::parse(&example("square.clip.json")).unwrap();
    assert_eq!(clip.to_text(), example("square.clip.json"), "robert clip fmt");
    let command = robot.compile(&clip).unwrap();
    let tool = Point::Site(TOOL.into());
    let corners: Vec<(u32, [f64; 3])> =
        clip.keys.iter().filter_map(|k| Some((k.frame, k.reach.first()?.pos))).collect();
    assert_eq!(corners.len(), 5);
    let mut worst = 0.0_f64;
    for pair in corners.windows(2) {
        let [(from, a), (to, b)] = [pair[0], pair[1]];
        for frame in from..=to {
            // Ten frames of hold, then the straight line.
            let s = (f64::from(frame) - f64::from(from + 9)).max(0.0) / f64::from(to - from - 9);
            let line: Vec<f64> = a.iter().zip(b).map(|(a, b)| a + s * (b - a)).collect();
            let at = place(&robot, command.row(frame), &tool);
            worst = worst.max(distance(at, line.try_into().unwrap()));
        }
    }
    assert!(worst < 2e-5, "{worst} m off the square");
    for frame in 30..190 {
        assert!(jump(&command, frame) < 0.03, "frame {frame}: {}", jump(&command, frame));
        assert_eq!(command.sight(frame), Sight::Full);
    }
    assert!(command.reached().iter().all(|r| r.reached && r.joints.len() == 5));
    let lints = lint(&clip, &command, &robot.joint_table(), None);
    assert_eq!(lints, []);
}

#[test]
fn a_key_for_joints_that_do_not_move_a_point_leaves_its_path() {
    let robot = Robot::builtin("shadow_hand").unwrap();
    let tip = Point::Site("fftip".into());
    let at = |values: [(&str, f64); 2]| {
        let mut q = robot.home();
        for (joint, v) in values {
            q[robot.joint_index(joint).unwrap()] = v;
        }
        let row: Vec<f32> = q.iter().map(|v| *v as f32).collect();
        Reach { point: tip.clone(), pos: place(&robot, &row, &tip), quat: None }
    };
    let mut clip = Clip::new(robot.clip_ref(), 41);
    clip.fill = Fill::Linear;
    let ends = [at([("FFJ3", 0.2), ("FFJ2", 0.1)]), at([("FFJ3", 0.8), ("FFJ2", 0.6)])];
    for (frame, reach) in [0, 40].into_iter().zip(ends.clone()) {
        clip.keys.push(Key { reach: vec![reach], ..Key::with(frame, Goal::Open) });
    }
    let between = |joint: &str, value: f64| {
        let mut row: Row = vec![None; clip.dim()];
        row[robot.joint_index(joint).unwrap()] = Some(value);
        let mut clip = clip.clone();
        clip.keys.insert(1, Key::with(20, Goal::Q(row)));
        robot.compile(&clip).unwrap()
    };
    let off_path = |command: &Command, frame: u32| {
        let s = f64::from(frame) / 40.0;
        let line = [0, 1, 2].map(|i| ends[0].pos[i] + s * (ends[1].pos[i] - ends[0].pos[i]));
        distance(place(&robot, command.row(frame), &tip), line)
    };
    let thumb = between("THJ4", 0.5);
    for frame in 0..=40 {
        assert!(off_path(&thumb, frame) < 2e-4, "frame {frame}: {}", off_path(&thumb, frame));
    }
    assert_eq!(thumb.row(20)[robot.joint_index("THJ4").unwrap()], 0.5);
    let finger = between("FFJ3", 1.2);
    assert_eq!(finger.row(20)[robot.joint_index("FFJ3").unwrap()], 1.2);
    assert!(off_path(&finger, 20) > 0.01, "this key moves the tip off the path");
}

#[test]
fn a_reach_that_is_too_far_says_how_far_and_where() {
    let ran = robert()
        .file(
            "square.clip.json",
            example("square.clip.json").replace("[0.58, 0.22, 1.95]", "[1.2, 0.22, 1.95]"),
        )
        .args(["clip", "check", "--json", "--all", "square.clip.json"])
        .run();
    let report: serde_json::Value = ran.json();
    let lints = report["files"][0]["lints"].as_array().unwrap();
    let missed: Vec<_> = lints.iter().filter(|l| l["rule"] == "unreachable").collect();
    let at_key = missed.iter().find(|l| l["pointer"] == "/keys/3/reach/0").unwrap();
    assert_eq!(at_key["frames"], serde_json::json!([110, 111]));
    let message = at_key["message"].as_str().unwrap();
    assert!(message.starts_with("key at frame 110: end_effector stays "), "{message}");
    let mm: f64 = message.split(' ').find_map(|w| w.parse().ok().filter(|v| *v > 200.0)).unwrap();
    // 0.957 m from the shoulder is the most; the goal is 1.3 m away.
    assert!((200.0..450.0).contains(&mm), "{message}");
    // The first fix stores what is reached, and nothing is left of the finding.
    fs::write(ran.path("fix.json"), at_key["mends"][0]["op"].to_string()).unwrap();
    let dir = ran.dir.path();
    assert_eq!(call(dir, &["clip", "apply", "square.clip.json", "fix.json", "-i"]).0, 0);
    let (_, out, _) = call(dir, &["clip", "check", "--all", "square.clip.json"]);
    assert!(!out.contains("unreachable"), "{out}");
}

#[test]
fn joints_that_do_not_move_the_point_are_on_the_line_between_their_keys() {
    let robot = Robot::builtin("shadow_hand").unwrap();
    let mut clip = Clip::new(robot.clip_ref(), 61);
    let mut closed: Row = robot.home().into_iter().map(Some).collect();
    let ring = robot.joint_index("RFJ3").unwrap();
    closed[ring] = Some(0.8);
    clip.keys.push(Key::with(0, Goal::Q(robot.home().into_iter().map(Some).collect())));
    clip.keys.push(Key {
        reach: vec![Reach::site("fftip", [0.03, 0.03, 0.3])],
        ..Key::with(30, Goal::Open)
    });
    clip.keys.push(Key::with(60, Goal::Q(closed)));
    let command = robot.compile(&clip).unwrap();
    assert!((command.row(30)[ring] - 0.4).abs() < 1e-6, "{}", command.row(30)[ring]);
}

#[test]
fn a_finger_and_the_thumb_meet_near_the_pose_of_the_key() {
    let robot = Robot::builtin("shadow_hand").unwrap();
    let mut clip = Clip::new(robot.clip_ref(), 60);
    let open: Row = robot.home().into_iter().map(Some).collect();
    clip.keys.push(Key::with(0, Goal::Q(open.clone())));
    // A pinch that the hand can make: where both tips are in this pose, moved together.
    let mut pinch = robot.home();
    for (joint, v) in
        [("FFJ3", 0.9), ("FFJ2", 0.8), ("FFJ1", 0.5), ("THJ5", 0.3), ("THJ4", 1.1), ("THJ1", 0.5)]
    {
        pinch[robot.joint_index(joint).unwrap()] = v;
    }
    let row: Vec<f32> = pinch.iter().map(|v| *v as f32).collect();
    let [a, b] = ["fftip", "thtip"].map(|s| place(&robot, &row, &Point::Site(s.into())));
    let between: Vec<f64> = a.iter().zip(b).map(|(a, b)| 0.5 * (a + b)).collect();
    let pos: [f64; 3] = between.try_into().unwrap();
    let reach = vec![Reach::site("fftip", pos), Reach::site("thtip", pos)];
    let mut own = open.clone();
    let little = robot.joint_index("LFJ3").unwrap();
    own[little] = Some(0.4);
    clip.keys.push(Key { reach, ..Key::with(30, Goal::Q(own)).held(30) });
    let command = robot.compile(&clip).unwrap();
    for tip in ["fftip", "thtip"] {
        let off = distance(place(&robot, command.row(30), &Point::Site(tip.into())), pos);
        assert!(off < 2e-3, "{tip} is {off} m off");
    }
    assert!(
        (command.row(30)[little] - 0.4).abs() < 1e-6,
        "the other fingers have their own values"
    );
    let middle = robot.joint_index("MFJ3").unwrap();
    assert!((command.row(30)[middle]).abs() < 1e-6);
}

#[test]
fn the_commands_take_such_clips() {
    let ran = robert()
        .file("square.clip.json", example("square.clip.json"))
        .args(["clip", "check", "--strict", "square.clip.json"])
        .succeeds();
    let dir = ran.dir.path();
    let fine = |args: &[&str]| {
        let (code, out, err) = call(dir, args);
        assert_eq!(code, 0, "{args:?}: {out}{err}");
        out
    };
    fine(&["clip", "fmt", "--check", "square.clip.json"]);
    let info: serde_json::Value =
        serde_json::from_str(&fine(&["clip", "info", "--json", "square.clip.json"])).unwrap();
    assert_eq!(info["blind"], serde_json::json!([]));
    let told = fine(&["rollout", "square.clip.json", "--policy", "computed-torque", "--json"]);
    let told: serde_json::Value = serde_json::from_str(&told).unwrap();
    assert!(told.to_string().contains("computed-torque"), "{told}");
    fine(&["export", "square.clip.json", "--to", "csv", "--policy", "pd", "-o", "square.csv"]);
    assert_eq!(fs::read_to_string(ran.path("square.csv")).unwrap().lines().count(), 201);
    fine(&["clip", "convert", "square.clip.json", "command.csv"]);
    // Joint values in place of goals command the same at the keys.
    fs::write(
        ran.path("bake.json"),
        r#"{"op": "keys.bake", "args": {"frames": [30, 70, 110, 150, 190]}}"#,
    )
    .unwrap();
    fine(&["clip", "apply", "square.clip.json", "bake.json", "-o", "baked.clip.json"]);
    let robot = Robot::builtin("ur5e").unwrap();
    let [goals, baked] = ["square.clip.json", "baked.clip.json"]
        .map(|name| robot.compile(&Clip::load(&ran.path(name)).unwrap()).unwrap());
    for frame in [30, 39, 70, 110, 150, 199] {
        assert_eq!(goals.row(frame), baked.row(frame), "frame {frame}");
    }
    assert_ne!(goals.row(55), baked.row(55), "between joint values the tool leaves the line");
    // A site that the robot does not have is refused where it stands.
    let typo = example("square.clip.json").replacen("end_effector", "end_efector", 1);
    fs::write(ran.path("typo.clip.json"), typo).unwrap();
    for command in [&["clip", "check", "typo.clip.json"][..], &["rollout", "typo.clip.json"]] {
        let (code, _, err) = call(dir, command);
        assert_eq!(code, 3, "{err}");
        assert!(err.contains("no site \"end_efector\"; did you mean \"end_effector\"?"), "{err}");
    }
    // Without its robot no joint values can be found.
    let stranger = example("square.clip.json").replace("\"ur5e\"", "\"my_arm\"");
    fs::write(ran.path("stranger.clip.json"), stranger).unwrap();
    let (code, _, err) = call(dir, &["clip", "check", "stranger.clip.json"]);
    assert_eq!(code, 3);
    assert!(err.contains("--robot"), "{err}");
}

/// As many goals as a clip may have, none of which the arm can reach.
#[test]
fn goals_out_of_reach_cost_two_seconds_at_most() {
    let robot = Robot::builtin("ur5e").unwrap();
    let mut clip = Clip::new(robot.clip_ref(), 5000);
    let home = robot.home();
    let goals = robert::limits::CLIP_REACHES as u32;
    clip.keys.extend((0..goals).map(|frame| {
        let reach = vec![Reach::site(TOOL, [0.3 + 0.03 * f64::from(frame % 7), 0.0, 0.3])];
        Key { reach, ..Key::new(frame, &home) }
    }));
    let begin = super::cpu();
    let command = robot.compile(&clip).unwrap();
    let took = super::cpu().saturating_sub(begin);
    assert!(took.as_secs_f64() < 2.0, "{took:?}");
    assert_eq!(command.reached().len(), goals as usize, "each is told");
}

#[test]
fn edits_keep_end_effector_goals() {
    let robot = Robot::builtin("ur5e").unwrap();
    let clip = Clip::parse(&example("square.clip.json")).unwrap();
    let mut editor = Editor::new(clip.clone(), Some(robot.joint_table())).unwrap();
    let before = editor.command().clone();
    let moved = Reach::site(TOOL, [0.58, 0.06, 2.0]);
    let set = KeysSet { frame: 70, reach: Some(vec![moved]), ..KeysSet::default() };
    let change = editor.apply(&Op::KeysSet(set)).unwrap();
    assert_eq!(change.first_changed_frame, Some(40), "the path from the corner before is another");
    let nowhere = KeysSet {
        frame: 70,
        reach: Some(vec![Reach::site("nose", [0.0; 3])]),
        ..KeysSet::default()
    };
    assert!(editor.apply(&Op::KeysSet(nowhere)).is_err());
    assert_eq!(editor.history(), (1, 1), "a refused edit leaves nothing in the history");
    let none = KeysSet { frame: 110, reach: Some(vec![]), ..KeysSet::default() };
    editor.apply(&Op::KeysSet(none)).unwrap();
    let Goal::Q(row) = &editor.clip().key(110).unwrap().goal else { panic!("joint values") };
    assert!(row.iter().all(Option::is_some));
    editor.undo().unwrap();
    editor.undo().unwrap();
    assert_eq!((editor.clip(), editor.command()), (&clip, &before));
    let mirror = Op::KeysMirror(KeysFrames { frames: vec![70] });
    assert!(matches!(editor.apply(&mirror), Err(OpError::Mirror { .. })));
}
