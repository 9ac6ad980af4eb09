//! Arm tasks. The plant can sustain 1.5 rad/s at its big joints (less against gravity) and 2.8
//! rad/s at the wrists; every motion stays within.

use std::f64::consts::TAU;

use robert::clip::Clip;
use robert::robot::Robot;
use robert::rollout::tasks::author::{Authored, blank, dense, middles, sequence, thinned};

/// Joint order: pan, lift, elbow, `wrist_1`, `wrist_2`.
type Pose = [f64; 5];

pub(super) fn tasks(robot: &Robot) -> Vec<Authored> {
    let mut tasks = Vec::new();
    let mut add = |suite, name, clip| tasks.push(Authored { name, suite, clip });

    let reacher = dense(
        robot,
        "reacher",
        "The bent arm swings to the left and right about its base.",
        200,
        |t| vec![1.2 * (TAU * t / 8.0).sin(), -1.571, 1.571, -1.571, -1.571],
    );
    let swing = dense(
        robot,
        "swing",
        "The stretched arm swings forward and back at the shoulder, against gravity.",
        200,
        |t| vec![0.0, -1.571 + 0.6 * (TAU * t / 4.0).sin(), 0.0, -1.571, 0.0],
    );
    let hang = keyed(
        robot,
        "hang",
        "The elbow bends to one side and the other; the way between is left open.",
        &[("rest", REST), ("left", elbow(0.7)), ("right", elbow(-0.7))],
        "rest",
        &[("left", 20, 20), ("right", 20, 20)].repeat(3),
    );
    let front_back = keyed(
        robot,
        "front and back",
        "The base turns between two places; the way between is left open.",
        &[("start", [1.5, -0.9, 1.0, -1.571, 0.0]), ("front", pan(0.9)), ("back", pan(2.0))],
        "start",
        &[("front", 15, 25), ("back", 15, 25)].repeat(3),
    );
    add("manual", "reacher", reacher.clone());
    add("manual", "swing", swing.clone());
    add("manual", "hang", hang.clone());
    add("manual", "front_back", front_back.clone());

    add(
        "extra",
        "hang_wide",
        keyed(
            robot,
            "hang, wide",
            "As hang, twice as far: 45 open frames between holds, more than a policy sees.",
            &[("rest", REST), ("left", elbow(1.4)), ("right", elbow(-1.4))],
            "rest",
            &[("left", 45, 20), ("right", 45, 20)].repeat(2),
        ),
    );
    add(
        "extra",
        "front_back_wide",
        keyed(
            robot,
            "front and back, wide",
            "As front and back, nearly twice as far: 30 open frames between holds.",
            &[("start", [1.5, -0.9, 1.0, -1.571, 0.0]), ("front", pan(0.6)), ("back", pan(2.5))],
            "start",
            &[("front", 30, 25), ("back", 30, 25)].repeat(3),
        ),
    );
    add(
        "extra",
        "reacher_sparse",
        thinned(&reacher, 15, "reacher, sparse", "As reacher, with every 15th frame visible."),
    );
    add(
        "extra",
        "swing_sparse",
        thinned(&swing, 10, "swing, sparse", "As swing, with every 10th frame visible."),
    );
    add(
        "extra",
        "hang_high_mask",
        middles(
            &hang,
            "hang, high mask",
            "As hang, with only the middle frame of each hold visible.",
        ),
    );
    add(
        "extra",
        "front_back_high_mask",
        middles(
            &front_back,
            "front and back, high mask",
            "As front and back, with only the middle frame of each hold visible.",
        ),
    );

    validation(robot, &mut add);
    tasks
}

/// Other motions: the suite that compares models.
fn validation(robot: &Robot, add: &mut impl FnMut(&'static str, &'static str, Clip)) {
    add(
        "validation",
        "ellipse_air",
        dense(
            robot,
            "ellipse in the air",
            "The tool goes round while the base turns to and fro.",
            200,
            |t| {
                let w = TAU * t / 5.0;
                vec![
                    0.6 * w.sin(),
                    -1.4 + 0.25 * w.cos(),
                    1.4 + 0.35 * w.sin(),
                    -1.2 - 0.3 * w.cos(),
                    -1.571,
                ]
            },
        ),
    );
    add(
        "validation",
        "wrist_wave",
        dense(
            robot,
            "wrist wave",
            "The arm stands still and the two wrists wave, out of step.",
            200,
            |t| {
                vec![
                    0.4,
                    -1.571,
                    1.2,
                    -1.3 + 0.5 * (TAU * t / 2.5).sin(),
                    0.7 * (TAU * t / 3.2).sin(),
                ]
            },
        ),
    );
    add(
        "validation",
        "drift",
        dense(
            robot,
            "drift",
            "All joints at once, slowly, in periods that do not fit together.",
            260,
            |t| {
                vec![
                    0.9 * (TAU * t / 11.0).sin(),
                    -1.5 + 0.3 * (TAU * t / 7.0).sin(),
                    1.1 + 0.5 * (TAU * t / 9.0).sin(),
                    -1.4 + 0.6 * (TAU * t / 5.0).sin(),
                    -0.8 + 0.8 * (TAU * t / 6.3).sin(),
                ]
            },
        ),
    );
    let pick: [(&str, Pose); 5] = [
        ("above_a", [-0.4, -1.2, 1.5, -1.9, -1.571]),
        ("down_a", [-0.4, -0.9, 1.6, -2.2, -1.571]),
        ("above_b", [0.5, -1.2, 1.5, -1.9, -1.571]),
        ("down_b", [0.5, -0.9, 1.6, -2.2, -1.571]),
        ("ready", [0.0, -1.4, 1.4, -1.571, -1.571]),
    ];
    let once = [
        ("above_a", 14, 8),
        ("down_a", 12, 12),
        ("above_a", 14, 6),
        ("above_b", 18, 8),
        ("down_b", 12, 12),
        ("above_b", 14, 6),
    ];
    add(
        "validation",
        "pick_place",
        keyed(
            robot,
            "pick and place",
            "Down at one place, up, over and down at the other; ways left open.",
            &pick,
            "ready",
            &once.repeat(2),
        ),
    );
    let steps: Vec<(String, Pose)> = (0..8)
        .map(|i| (format!("step_{i}"), [-0.9 + 0.25 * f64::from(i), -1.3, 1.3, -1.571, -1.571]))
        .collect();
    let named: Vec<(&str, Pose)> = steps.iter().map(|(n, q)| (n.as_str(), *q)).collect();
    let climb: Vec<(&str, u32, u32)> = named.iter().skip(1).map(|(n, _)| (*n, 10, 12)).collect();
    add(
        "validation",
        "stairs",
        keyed(
            robot,
            "stairs",
            "Seven equal turns of the base with a rest after each.",
            &named,
            "step_0",
            &climb,
        ),
    );
    add(
        "validation",
        "salute",
        keyed(
            robot,
            "salute",
            "Elbow and wrists move together between three poses.",
            &[
                ("stand", [0.0, -1.571, 0.0, -1.571, 0.0]),
                ("bow", [0.0, -1.4, 0.8, -0.8, 0.5]),
                ("turn", [0.7, -1.7, 0.4, -2.0, -0.6]),
            ],
            "stand",
            &[("bow", 19, 15), ("turn", 19, 15), ("stand", 19, 15)].repeat(2),
        ),
    );
}

const REST: Pose = [0.0, -1.571, 0.0, -1.571, 0.0];

fn elbow(angle: f64) -> Pose {
    [0.0, -1.571, angle, -1.571, 0.0]
}

fn pan(angle: f64) -> Pose {
    [angle, -0.6, 1.0, -1.571, 0.0]
}

/// Named poses and the times at which they are held: (pose, open frames, held frames).
fn keyed(
    robot: &Robot,
    title: &str,
    notes: &str,
    poses: &[(&str, Pose)],
    start: &str,
    steps: &[(&str, u32, u32)],
) -> Clip {
    let mut clip = blank(robot, title, notes, 1);
    clip.poses = poses
        .iter()
        .map(|(name, q)| ((*name).to_owned(), q.iter().map(|v| Some(*v)).collect()))
        .collect();
    sequence(&mut clip, start, steps);
    clip
}
