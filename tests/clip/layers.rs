//! Offsets over dense motion, and clips as blocks of a sequence.

use proptest::prelude::*;
use robert::clip::*;

use super::generate;
use crate::run::robert;

/// A motion with a key at every frame.
fn dense(frames: u32) -> Clip {
    let joints = vec!["a".to_owned(), "b".to_owned()];
    let robot = RobotRef { id: "r".into(), joints, ..RobotRef::default() };
    let mut clip = Clip::new(robot, frames);
    let wave = |t: u32| [(f64::from(t) * 0.1).sin(), (f64::from(t) * 0.07).cos()];
    clip.keys = (0..frames).map(|t| Key::new(t, &wave(t))).collect();
    clip.normalize();
    clip
}

fn edit(clip: &Clip, op: &Op) -> Clip {
    edited(clip, op, None).unwrap_or_else(|e| panic!("{op:?}: {e}"))
}

fn column(clip: &Clip, joint: usize) -> Vec<f64> {
    let command = compile(clip).unwrap();
    (0..clip.length).map(|t| f64::from(command.row(t)[joint])).collect()
}

#[test]
fn one_offset_shapes_dense_motion_smoothly_and_nothing_else() {
    let base = dense(120);
    let set = |frame, value, fade| {
        let mut shaped = base.clone();
        shaped.offsets = vec![Offset::new(frame, "a", value, fade)];
        shaped
    };
    let shaped = set(60, 0.5, 20);
    let (was, is) = (column(&base, 0), column(&shaped, 0));
    assert_eq!(column(&base, 1), column(&shaped, 1), "the other joint");
    for t in 0..120 {
        let added = is[t] - was[t];
        assert!((0.0..=0.5 + 1e-6).contains(&added), "{t}");
        assert_eq!(added > 1e-6, (41..80).contains(&t), "{t}: {added}");
    }
    assert!((is[60] - was[60] - 0.5).abs() < 1e-6);
    // Its own second difference stays below that of a cubic through the same three points.
    let bend = |y: &dyn Fn(usize) -> f64| {
        (1..119).map(|t| (y(t + 1) - 2.0 * y(t) + y(t - 1)).abs()).fold(0.0, f64::max)
    };
    assert!(bend(&|t| is[t] - was[t]) < 0.5 * 6.0 / 400.0 * 1.2, "no corner");
    // Two that meet lead from one value to the other.
    let mut two = set(40, 0.3, 20);
    two.offsets.push(Offset::new(60, "a", 0.3, 20));
    let flat = column(&two, 0);
    for t in 40..=60 {
        assert!((flat[t] - was[t] - 0.3).abs() < 3e-6, "{t}");
    }
}

#[test]
fn a_start_that_is_not_said_follows_the_first_key() {
    let mut clip = dense(40);
    clip.offsets = vec![Offset::new(0, "a", 0.25, 8)];
    let command = compile(&clip).unwrap();
    assert_eq!(command.start(), command.row(0), "no jump before the first frame");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn baked_offsets_command_the_same_bits(seed in any::<u64>(), all in any::<bool>()) {
        let mut clip = generate::clip(seed);
        // Masks hide frames; what they hide is baked too.
        clip.normalize();
        prop_assume!(!clip.offsets.is_empty());
        let frames: Vec<u32> = clip.offsets.iter().map(|o| o.frame).take(if all { 9 } else { 1 }).collect();
        let left = clip.offsets.len() - frames.len();
        let baked = edit(&clip, &Op::OffsetsBake(KeysFrames { frames }));
        prop_assert_eq!(baked.offsets.len(), left);
        let (before, after) = (compile(&clip).unwrap(), compile(&baked).unwrap());
        // Two offsets that are added one after the other are rounded twice, the first time to single
        // precision.
        let most = clip.offsets.iter().flat_map(|o| o.add.values()).fold(1.0_f64, |m, v| m.max(v.abs()));
        let far = (0..clip.length).flat_map(|t| before.row(t).iter().zip(after.row(t)))
            .map(|(a, b)| f64::from(a - b).abs() / (f64::from(a.abs()) + most)).fold(0.0, f64::max);
        prop_assert!(far < 2e-6, "{far}");
        if left == 0 {
            prop_assert_eq!(after.first_changed_frame(&before), None);
        }
    }

    #[test]
    fn blocks_in_the_same_order_are_the_same_motion(seed in any::<u64>(), blend in 0_u32..15) {
        let first = generate::clip(seed);
        let part = Part::of(&first);
        let mut clip = dense(20);
        clip.robot = first.robot.clone();
        clip.keys = vec![Key::new(0, &vec![0.0; first.dim()]), Key::new(19, &vec![0.1; first.dim()])];
        for _ in 0..3 {
            let (at, name, part) = (clip.length, "b".to_owned(), part.clone());
            clip = edit(&clip, &Op::BlocksInsert(BlocksInsert { at, name, part, blend }));
        }
        let frames: Vec<u32> =
            clip.markers.iter().filter(|m| m.to.is_some() && m.name == "b").map(|m| m.frame).collect();
        prop_assume!(clip.markers.iter().filter(|m| m.to.is_some()).count() == 3);
        let turned = vec![frames[1], frames[0], frames[2]];
        let again = edit(&clip, &Op::BlocksOrder(BlocksOrder { frames: frames.clone() }));
        prop_assert_eq!(
            compile(&again).unwrap().first_changed_frame(&compile(&clip).unwrap()), None
        );
        let swapped = edit(&clip, &Op::BlocksOrder(BlocksOrder { frames: turned }));
        prop_assert_eq!(swapped.length, clip.length);
        prop_assert_eq!(swapped.keys.len(), clip.keys.len());
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_block_without_a_blend_changes_nothing_beside_it(
        seed in any::<u64>(), length in 1_u32..60, at in 0_u32..300
    ) {
        let mut clip = generate::clip(seed);
        clip.normalize();
        prop_assume!(clip.markers.iter().all(|m| m.to.is_none()));
        let at = at.min(clip.length);
        let mut inner = Clip::new(clip.robot.clone(), length);
        inner.keys = vec![Key::new(0, &vec![0.5; clip.dim()]).held(length)];
        let (name, part) = ("b".to_owned(), Part::of(&inner));
        clip.offsets.clear();
        clip.masks.clear();
        let curved = clip.keys.iter().any(|k| clip.fill_after(k) == Fill::Cubic);
        let before = compile(&clip).unwrap();
        let most = before.q().iter().fold(0.0_f64, |most, v| most.max(f64::from(v.abs())));
        let insert = BlocksInsert { at, name, part, blend: 0 };
        let after = compile(&edit(&clip, &Op::BlocksInsert(insert))).unwrap();
        for t in 0..clip.length {
            let then = if t < at { t } else { t + length };
            for j in 0..clip.dim() {
                prop_assert_eq!(before.sees(t, j), after.sees(then, j), "frame {} joint {}", t, j);
                // What passes the cut is a line to a value in single precision, or a curve that has about
                // the same slopes at its new ends.
                let [a, b] = [before.row(t)[j], after.row(then)[j]].map(f64::from);
                prop_assert!(curved || (a - b).abs() < 1e-6 * (1.0 + most), "frame {t}: {a} {b}");
            }
        }
    }
}

#[test]
fn a_part_keeps_joints_whose_last_key_is_an_earlier_one() {
    let mut clip = dense(0);
    clip.length = 40;
    let one = |frame, a, b| Key::with(frame, Goal::Q(vec![a, b]));
    clip.fill = Fill::Cubic;
    let mut first = Key::new(0, &[0.0, 1.0]);
    first.tangents.insert("b".into(), Tangent::Slope(2.0));
    for fill in Fill::ALL {
        let last = one(20, Some(1.0), None).held(5).filled(fill);
        clip.keys = vec![first.clone(), one(10, Some(0.5), None), last];
        let twice = edit(
            &clip,
            &Op::BlocksInsert(BlocksInsert {
                at: 40,
                name: "again".into(),
                part: Part::of(&clip),
                blend: 0,
            }),
        );
        let (once, twice) = (compile(&clip).unwrap(), compile(&twice).unwrap());
        for t in 0..80 {
            for j in 0..2 {
                let goal = |c: &Command, t| c.sees(t, j).then(|| c.row(t)[j]);
                assert_eq!(goal(&twice, t), goal(&once, t % 40), "{fill:?}: frame {t}, joint {j}");
            }
        }
    }
}

#[test]
fn a_clip_is_inserted_with_a_blend_that_keeps_both_speeds() {
    let (base, other) = (dense(60), dense(40));
    let part = Part::of(&other);
    let insert = BlocksInsert { at: 30, name: "other".into(), part, blend: 20 };
    let clip = edit(&base, &Op::BlocksInsert(insert));
    assert_eq!(clip.length, 60 + 40 + 40);
    let block = clip.markers.iter().find(|m| m.to.is_some()).unwrap();
    assert_eq!((block.frame, block.to), (50, Some(90)));
    let (a, b, c) = (column(&base, 0), column(&other, 0), column(&clip, 0));
    assert_eq!(&c[..30], &a[..30], "what was before stays");
    assert_eq!(&c[50..90], &b[..], "the block is what was inserted");
    assert_eq!(&c[110..], &a[30..], "what follows comes later");
    let speed = |t: usize| c[t + 1] - c[t];
    for seam in [29_usize, 49, 89, 109] {
        assert!((speed(seam) - speed(seam - 1)).abs() < 0.05, "a corner at {seam}");
    }
    // The same again, then in another order, then away.
    let twice = edit(&clip, &Op::BlocksRepeat(BlocksRepeat { frame: 50, blend: 5 }));
    let starts: Vec<(u32, Option<u32>)> = twice.markers.iter().map(|m| (m.frame, m.to)).collect();
    assert_eq!(starts, [(50, Some(90)), (95, Some(135))]);
    assert_eq!(&column(&twice, 0)[95..135], &b[..], "the copy");
    let gone = edit(&twice, &Op::BlocksDelete(BlocksDelete { frame: 95 }));
    assert_eq!(gone.markers.len(), 1);
    assert_eq!(gone.length, clip.length + 5, "the blend that leads on stays");
}

#[test]
fn join_makes_one_clip_of_several_that_checks_and_performs() {
    let run = robert()
        .args(["clip", "new", "--robot", "pointmass", "--secs", "2", "-o", "a.clip.json"])
        .succeeds();
    let ops = r#"[{"op": "keys.add", "args": {"keys": [{"frame": 20, "q": [0.1, 0.1]}, {"frame": 39, "q": [0, 0.2]}]}},
        {"op": "fill.set", "args": {"fill": "cubic"}},
        {"op": "offsets.set", "args": {"frame": 20, "add": {"x": 0.05}, "in": 8, "out": 8}}]"#;
    std::fs::write(run.path("ops.json"), ops).unwrap();
    let again = |args: &[&str]| crate::run::call(run.dir.path(), args);
    assert_eq!(again(&["clip", "apply", "a.clip.json", "ops.json", "-i"]).0, 0);
    let (code, _, err) = again(&[
        "clip",
        "join",
        "a.clip.json",
        "a.clip.json",
        "--blend",
        "12",
        "-o",
        "b.clip.json",
    ]);
    assert_eq!(code, 0, "{err}");
    let joined = Clip::load(&run.path("b.clip.json")).unwrap();
    assert_eq!((joined.length, joined.offsets.len()), (40 + 12 + 40, 2));
    assert_eq!(joined.markers.iter().filter(|m| m.to.is_some()).count(), 2);
    assert_eq!(again(&["clip", "check", "--strict", "b.clip.json"]).0, 0);
    let (code, out, err) =
        again(&["rollout", "b.clip.json", "--policy", "computed-torque", "--json", "-o", "b.mcap"]);
    assert_eq!(code, 0, "{out}{err}");
    assert_eq!(again(&["export", "b.mcap", "--to", "csv", "-o", "b.csv"]).0, 0);
    let (code, _, err) = again(&["clip", "new", "--robot", "ur5e", "-o", "c.clip.json"]);
    assert_eq!(code, 0, "{err}");
    let (code, _, err) = again(&["clip", "join", "a.clip.json", "c.clip.json"]);
    assert_eq!(code, 3, "{err}");
    assert!(err.contains("c.clip.json") && err.contains("joint"), "{err}");
}
