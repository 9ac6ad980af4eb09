//! Planar shapes, in metres, 10 s each. The puck reaches at most 1 m/s. It needs a tenth of a
//! second to accelerate, so clips that start with a moving goal have an error at the start.

use std::f64::consts::{FRAC_PI_2, TAU};

use robert::clip::{Clip, Fill, Key};
use robert::robot::Robot;
use robert::rollout::tasks::author::{Authored, blank, dense, sequence, thinned};

const FRAMES: u32 = 200;

type Point = [f64; 2];

pub(super) fn tasks(robot: &Robot) -> Vec<Authored> {
    let mut tasks = Vec::new();
    let mut add = |suite, name, clip| tasks.push(Authored { name, suite, clip });
    let curve = |title: &str, notes: &str, q: fn(f64) -> Point| {
        dense(robot, title, notes, FRAMES, |t| q(t).to_vec())
    };

    let mut stay = blank(robot, "stay", "Stays where it is.", FRAMES);
    stay.keys = vec![Key::new(0, &[0.0, 0.0]).held(FRAMES + 1)];
    add("manual", "stay", stay);
    add(
        "manual",
        "line_x",
        curve("line x", "To and fro along x, period 5 s.", |t| [0.5 * (TAU * t / 5.0).sin(), 0.0]),
    );
    add(
        "manual",
        "line_y",
        curve("line y", "To and fro along y, period 5 s.", |t| [0.0, 0.5 * (TAU * t / 5.0).sin()]),
    );
    add(
        "manual",
        "diagonal",
        curve("diagonal", "To and fro along both, period 5 s.", |t| {
            [0.4 * (TAU * t / 5.0).sin(); 2]
        }),
    );
    let looped = |title: &str, notes: &str, corners: &[Point], leg: u32| {
        looped(robot, title, notes, corners, leg)
    };
    add(
        "manual",
        "triangle",
        looped(
            "triangle",
            "Side 1 m, 6 s a turn. The corners cannot be turned at speed: physics rounds them.",
            &ring(3, 1.0 / 3.0_f64.sqrt(), 1),
            40,
        ),
    );
    add(
        "manual",
        "square",
        looped(
            "square",
            "Side 1 m, 8 s a turn.",
            &[[-0.5, 0.5], [-0.5, -0.5], [0.5, -0.5], [0.5, 0.5]],
            40,
        ),
    );
    add(
        "manual",
        "pentagon",
        looped("pentagon", "Radius 0.6 m, 8 s a turn.", &ring(5, 0.6, 1), 32),
    );
    let circle = curve("circle", "Radius 0.5 m, 5 s a turn.", |t| {
        let (sin, cos) = (TAU * t / 5.0).sin_cos();
        [0.5 * cos, 0.5 * sin]
    });
    add("manual", "circle", circle.clone());
    add(
        "manual",
        "ellipse",
        curve("ellipse", "Half axes 0.8 and 0.4 m, 8 s a turn.", |t| {
            let (sin, cos) = (TAU * t / 8.0).sin_cos();
            [0.8 * cos, 0.4 * sin]
        }),
    );
    let star = looped("star", "Five points, radius 0.6 m, 10 s.", &ring(5, 0.6, 2), 40);
    add("manual", "star", star.clone());
    let eight = curve("eight", "1.6 m wide, 8 s a turn.", |t| {
        let w = TAU * t / 8.0;
        [0.8 * w.sin(), 0.4 * (2.0 * w).sin()]
    });
    add("manual", "eight", eight.clone());
    add(
        "manual",
        "spiral",
        curve("spiral", "Outward, 5 s a turn.", |t| {
            let (sin, cos) = (TAU * t / 5.0).sin_cos();
            [0.05 * t * cos, 0.05 * t * sin]
        }),
    );
    let teeth: Vec<Point> = (0..=8)
        .map(|i| [-0.5 + 0.125 * f64::from(i), if i % 2 == 0 { -0.3 } else { 0.3 }])
        .collect();
    add(
        "manual",
        "zigzag",
        keyed(robot, "zigzag", "Up and down every 2.5 s while going right.", &teeth, 25),
    );
    add(
        "manual",
        "rose",
        curve("rose", "Four petals, 12 s a turn.", |t| {
            let (sin, cos) = (TAU * t / 12.0).sin_cos();
            let r = 0.6 * (2.0 * TAU * t / 12.0).sin();
            [r * cos, r * sin]
        }),
    );
    add(
        "manual",
        "heart",
        curve("heart", "1.2 m wide, 10 s.", |t| {
            let w = TAU * t / 10.0;
            let y =
                13.0 * w.cos() - 5.0 * (2.0 * w).cos() - 2.0 * (3.0 * w).cos() - (4.0 * w).cos();
            [0.0375 * 16.0 * w.sin().powi(3), 0.0375 * (y + 2.5)]
        }),
    );

    add(
        "extra",
        "four_corners",
        posed(
            robot,
            "four corners",
            "From corner to corner; the way between is left open.",
            &[("a", [-0.4, -0.4]), ("b", [0.4, -0.4]), ("c", [0.4, 0.4]), ("d", [-0.4, 0.4])],
            &[
                ("b", 20, 10),
                ("c", 20, 10),
                ("d", 20, 10),
                ("a", 20, 10),
                ("b", 20, 10),
                ("c", 20, 10),
            ],
        ),
    );
    let mut step = blank(
        robot,
        "step goal",
        "The goal jumps half a metre, in full view: how soon and how calmly is it reached?",
        100,
    );
    step.fill = Fill::Hold;
    step.keys = vec![Key::new(0, &[0.0, 0.0]), Key::new(40, &[0.4, 0.3])];
    add("extra", "step_goal", step);
    add(
        "extra",
        "circle_sparse",
        thinned(&circle, 10, "circle, sparse", "As circle, with every 10th frame visible."),
    );
    add(
        "extra",
        "eight_sparse",
        thinned(&eight, 20, "eight, sparse", "As eight, with every 20th frame visible."),
    );
    let mut corners = star;
    corners.name = "star, corners only".into();
    corners.notes = "As star, with nothing but the points visible, two seconds apart.".into();
    corners.fill = Fill::Mask;
    add("extra", "star_corners", corners);

    validation(robot, &mut add);
    tasks
}

/// Other motions: the suite that compares models.
fn validation(robot: &Robot, add: &mut impl FnMut(&'static str, &'static str, Clip)) {
    let curve = |title: &str, notes: &str, q: fn(f64) -> Point| {
        dense(robot, title, notes, FRAMES, |t| q(t).to_vec())
    };
    add(
        "validation",
        "lissajous",
        curve("Lissajous", "Two to three, 16 s a turn.", |t| {
            let w = TAU * t / 16.0;
            [0.5 * (2.0 * w).sin(), 0.5 * (3.0 * w).sin()]
        }),
    );
    add(
        "validation",
        "cardioid",
        curve("cardioid", "9 s a turn.", |t| {
            let w = TAU * t / 9.0;
            let r = 0.35 * (1.0 - w.cos());
            [r * w.cos() + 0.3, r * w.sin()]
        }),
    );
    add(
        "validation",
        "astroid",
        curve("astroid", "Four cusps, 10 s a turn.", |t| {
            let w = TAU * t / 10.0;
            [0.7 * w.cos().powi(3), 0.7 * w.sin().powi(3)]
        }),
    );
    add(
        "validation",
        "hexagon",
        looped(robot, "hexagon", "Radius 0.5 m, 7.5 s a turn.", &ring(6, 0.5, 1), 25),
    );
    let n = [[-0.3, -0.5], [-0.3, 0.5], [0.3, -0.5], [0.3, 0.5]];
    add("validation", "letter_n", polyline(robot, "letter N", "Drawn in one stroke.", &n, FRAMES));
    let w = [[-0.6, 0.4], [-0.3, -0.4], [0.0, 0.2], [0.3, -0.4], [0.6, 0.4]];
    add("validation", "letter_w", polyline(robot, "letter W", "Drawn in one stroke.", &w, FRAMES));
    let six: Vec<(String, Point)> =
        ring(6, 0.4, 1).into_iter().zip('a'..).map(|(p, n)| (n.to_string(), p)).collect();
    let named: Vec<(&str, Point)> = six.iter().map(|(n, p)| (n.as_str(), *p)).collect();
    let round: Vec<(&str, u32, u32)> =
        named.iter().cycle().skip(1).take(8).map(|(n, _)| (*n, 15, 10)).collect();
    add(
        "validation",
        "hexagon_goals",
        posed(
            robot,
            "hexagon, goals",
            "From corner to corner of a hexagon; the way between is left open.",
            &named,
            &round,
        ),
    );
    add(
        "validation",
        "scatter",
        posed(
            robot,
            "scatter",
            "Goals here and there at uneven times.",
            &[
                ("a", [0.0, 0.0]),
                ("b", [0.42, 0.11]),
                ("c", [0.13, -0.38]),
                ("d", [-0.35, 0.27]),
                ("e", [-0.08, 0.44]),
            ],
            &[
                ("b", 17, 4),
                ("c", 14, 1),
                ("d", 19, 8),
                ("e", 11, 2),
                ("c", 24, 12),
                ("b", 13, 1),
                ("a", 16, 20),
                ("d", 13, 19),
            ],
        ),
    );
}

/// `n` points on a circle, every `step`-th in turn, the first at the top.
fn ring(n: u32, radius: f64, step: u32) -> Vec<Point> {
    (0..n)
        .map(|i| {
            let (sin, cos) = (FRAC_PI_2 + TAU * f64::from(i * step) / f64::from(n)).sin_cos();
            [radius * cos, radius * sin]
        })
        .collect()
}

/// Keys at the points, `leg` frames apart, with straight lines between.
fn keyed(robot: &Robot, title: &str, notes: &str, points: &[Point], leg: u32) -> Clip {
    let frames = leg * (points.len() as u32 - 1);
    let mut clip = blank(robot, title, notes, frames);
    clip.fill = Fill::Linear;
    clip.keys = (0..).zip(points).map(|(i, p)| Key::new(i * leg, p)).collect();
    clip
}

/// Follows a closed polygon again and again for 10 s.
fn looped(robot: &Robot, title: &str, notes: &str, corners: &[Point], leg: u32) -> Clip {
    let legs = FRAMES.div_ceil(leg) as usize;
    let mut points: Vec<Point> = corners.iter().copied().cycle().take(legs + 1).collect();
    let mut clip = keyed(robot, title, notes, &points, leg);
    let rest = FRAMES % leg;
    if rest > 0 {
        // The last key is where the motion stands when the clip ends.
        let (Some(to), Some(from)) = (points.pop(), points.last()) else { return clip };
        let share = f64::from(rest) / f64::from(leg);
        clip.keys.pop();
        clip.keys.push(Key::new(FRAMES, &[0, 1].map(|k| from[k] + share * (to[k] - from[k]))));
        clip.length = FRAMES + 1;
    }
    clip
}

/// Named points and the times at which they are held.
fn posed(
    robot: &Robot,
    title: &str,
    notes: &str,
    points: &[(&str, Point)],
    steps: &[(&str, u32, u32)],
) -> Clip {
    let mut clip = blank(robot, title, notes, 1);
    clip.poses = points
        .iter()
        .map(|(name, p)| ((*name).to_owned(), p.iter().map(|v| Some(*v)).collect()))
        .collect();
    sequence(&mut clip, points.first().map_or("", |p| p.0), steps);
    clip
}

/// Straight lines through points at constant speed.
fn polyline(robot: &Robot, title: &str, notes: &str, points: &[[f64; 2]], frames: u32) -> Clip {
    let mut clip = blank(robot, title, notes, frames);
    clip.fill = Fill::Linear;
    let leg = |w: &[[f64; 2]]| (w[1][0] - w[0][0]).hypot(w[1][1] - w[0][1]);
    let total: f64 = points.windows(2).map(leg).sum();
    let mut way = 0.0;
    clip.keys.extend(points.first().map(|p| Key::new(0, p)));
    for w in points.windows(2) {
        way += leg(w);
        clip.keys.push(Key::new((way / total * f64::from(frames)).round() as u32, &w[1]));
    }
    clip
}
