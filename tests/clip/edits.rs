//! Properties that hold for every clip and every edit.

use proptest::prelude::*;
use robert::clip::*;

use super::generate;

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn print_then_parse_is_identity(seed in any::<u64>()) {
        let clip = generate::clip(seed);
        let text = clip.to_text();
        let back = Clip::parse(&text).unwrap();
        prop_assert_eq!(&back, &clip);
        prop_assert_eq!(back.to_text(), text, "formatting twice");
    }

    #[test]
    fn edits_are_invertible_and_atomic(seed in any::<u64>(), count in 1_u64..25) {
        let mut clip = generate::clip(seed);
        let table = generate::table(&clip);
        let original = clip.clone();
        let mut editor = Editor::new(clip.clone(), Some(table.clone())).unwrap();
        for i in 0..count {
            let op = generate::op(&mut generate::rng(seed, i + 1), &clip, true);
            let json = serde_json::to_string(&op).unwrap();
            let same: Op = serde_json::from_str(&json).unwrap();
            prop_assert_eq!(&same, &op, "{}", json);
            let before = clip.clone();
            let done = apply(&mut clip, &op, Some(&table));
            let change = editor.apply(&op);
            prop_assert_eq!(done.is_ok(), change.is_ok());
            match done {
                Err(_) => prop_assert_eq!(&clip, &before, "a refused edit left traces: {}", json),
                Ok(inverse) => {
                    prop_assert_eq!(clip.validate(), Ok(()), "{}", json);
                    prop_assert_eq!(&Clip::parse(&clip.to_text()).unwrap(), &clip);
                    let text = serde_json::to_string(&inverse).unwrap();
                    let inverse: Op = serde_json::from_str(&text).unwrap();
                    let mut back = clip.clone();
                    apply(&mut back, &inverse, None).unwrap();
                    prop_assert_eq!(&back, &before, "{} then {}", json, text);
                    let change = change.unwrap();
                    let mut patched = before.clone();
                    apply(&mut patched, &Op::Patch(Box::new(change.patch)), None).unwrap();
                    prop_assert_eq!(&patched, &clip, "the patch tells other views the truth");
                }
            }
            prop_assert_eq!(editor.clip(), &clip);
        }
        while editor.undo().unwrap().is_some() {}
        prop_assert_eq!(editor.clip(), &original);
        while editor.redo().unwrap().is_some() {}
        prop_assert_eq!(editor.clip(), &clip);
    }

    #[test]
    fn a_replay_is_what_was_done_and_undoes_alike(seed in any::<u64>(), count in 1_u64..25) {
        let clip = generate::clip(seed);
        let table = generate::table(&clip);
        let mut editor = Editor::new(clip.clone(), Some(table.clone())).unwrap();
        let mut steps = Vec::new();
        for i in 0..count {
            let mut rng = generate::rng(seed, i + 1);
            match rng.below(5) {
                0 if editor.undo().unwrap().is_some() => steps.push(Step::Undo),
                1 if editor.redo().unwrap().is_some() => steps.push(Step::Redo),
                _ => {
                    let op = generate::op(&mut rng, editor.clip(), true);
                    let Ok(change) = editor.apply(&op) else { continue };
                    if !change.patch.is_empty() {
                        steps.push(Step::Edit { label: change.label, patch: Box::new(change.patch) });
                    }
                }
            }
        }
        for whole in [true, false] {
            let mut again = Editor::new(clip.clone(), Some(table.clone())).unwrap();
            prop_assert_eq!(again.replay(&steps, whole).unwrap(), Vec::<usize>::new());
            let mut editor_back = Editor::new(clip.clone(), Some(table.clone())).unwrap();
            prop_assert_eq!(editor_back.replay(&steps, true).unwrap(), Vec::<usize>::new());
            prop_assert_eq!(again.clip(), editor.clip());
            prop_assert_eq!(again.command(), editor.command());
            prop_assert_eq!(again.history(), editor.history());
            prop_assert_eq!(again.labels(0..99), editor.labels(0..99));
            loop {
                let (a, b) = (again.undo().unwrap(), editor_back.undo().unwrap());
                prop_assert_eq!(again.clip(), editor_back.clip());
                prop_assert_eq!(a.is_some(), b.is_some());
                if a.is_none() {
                    break;
                }
            }
            let mut start = clip.clone();
            apply(&mut start, &Op::Patch(Box::default()), None).unwrap();
            prop_assert_eq!(again.clip(), &start);
        }
    }

    #[test]
    fn compiled_clips_hang_together(seed in any::<u64>()) {
        let clip = Clip { offsets: Vec::new(), ..generate::clip(seed) };
        let c = compile(&clip).unwrap();
        prop_assert_eq!(c.frames(), clip.length);
        let mut at = 0;
        for span in c.spans() {
            prop_assert_eq!(span.from, at, "spans tile the clip");
            at = span.to;
            for t in span.from..span.to {
                let hidden = matches!(span.kind, SpanKind::Open | SpanKind::Masked);
                prop_assert!(!hidden || c.sight(t) == Sight::Masked);
            }
        }
        prop_assert_eq!(at, clip.length);
        for (i, key) in clip.keys.iter().enumerate() {
            let masked = |t: u32, j: usize| clip.masks.iter().any(|m| {
                (m.from..m.to).contains(&t)
                    && m.joints.as_ref().is_none_or(|n| n.contains(&clip.robot.joints[j]))
            });
            for (j, v) in clip.row(key).unwrap().iter().enumerate() {
                let Some(v) = v else { continue };
                let own = |k: &&Key| clip.row(k).unwrap()[j].is_some();
                let next = clip.keys[i + 1..].iter().find(own).map_or(clip.length, |k| k.frame);
                let end = (key.frame + key.hold).min(next);
                for t in key.frame..end {
                    let seen = c.sees(t, j).then(|| c.row(t)[j]);
                    prop_assert_eq!(seen, (!masked(t, j)).then_some(*v as f32), "frame {} joint {}", t, j);
                }
                prop_assert!(end <= clip.hold_end(i));
            }
        }
        let json = formats::to_command_json(&c, "arm");
        let back = formats::from_command_json(&json, Some(&clip.robot), Fill::Mask).unwrap();
        prop_assert_eq!(compile(&back).unwrap().first_changed_frame(&c), None);
    }
}

/// The rules of studio edits, one by one.
#[test]
fn collisions_ripple_and_time() {
    let robot = RobotRef { id: "r".into(), joints: vec!["a".into()], ..RobotRef::default() };
    let mut clip = Clip::new(robot, 100);
    clip.keys = vec![Key::new(10, &[1.0]).held(5), Key::new(20, &[2.0]), Key::new(30, &[3.0])];
    clip.masks = vec![Mask { from: 22, to: 28, joints: None }];
    clip.markers = vec![Marker { frame: 25, name: "m".into(), to: None }];
    let frames = |c: &Clip| c.keys.iter().map(|k| k.frame).collect::<Vec<_>>();
    let with = |op: Op| {
        let mut c = clip.clone();
        apply(&mut c, &op, None).map(|_| c)
    };
    let shift = |df, ripple, replace| {
        with(Op::KeysMove(KeysMove { frames: vec![20], df, ripple, replace, copy: false }))
    };
    assert_eq!(shift(10, false, false), Err(OpError::Occupied { count: 1, frame: 30 }));
    assert_eq!(frames(&shift(10, false, true).unwrap()), [10, 30]);
    assert_eq!(frames(&shift(10, true, false).unwrap()), [10, 30, 40]);
    let far = shift(75, true, false).unwrap();
    assert_eq!((frames(&far), far.length), (vec![10, 95, 105], 106), "a ripple makes room");
    assert!(matches!(shift(-21, false, false), Err(OpError::Outside { frame: -1, .. })));
    let wide = with(Op::TimeInsert(TimeInsert { at: 12, frames: 6 })).unwrap();
    assert_eq!((frames(&wide), wide.length), (vec![10, 26, 36], 106));
    assert_eq!(wide.keys[0].hold, 11, "inserting inside a hold lengthens it");
    assert_eq!((wide.masks[0].from, wide.masks[0].to, wide.markers[0].frame), (28, 34, 31));
    let cut = with(Op::TimeDelete(TimeDelete { from: 12, to: 26 })).unwrap();
    assert_eq!((frames(&cut), cut.length, cut.keys[0].hold), (vec![10, 16], 86, 2));
    assert_eq!((cut.masks[0].from, cut.masks[0].to), (12, 14));
    assert!(cut.markers.is_empty());
    let scale = |factor| {
        let frames = vec![10, 20, 30];
        with(Op::KeysScale(KeysScale { frames, pivot: 10, factor, replace: false }))
    };
    assert_eq!(frames(&scale(2.0).unwrap()), [10, 30, 50]);
    assert_eq!(scale(0.01), Err(OpError::Occupied { count: 2, frame: 10 }));
    assert!(matches!(
        with(Op::KeysMirror(KeysFrames { frames: vec![10] })),
        Err(OpError::Mirror { .. })
    ));
    assert!(matches!(
        with(Op::ClipLength(ClipLength { length: 25, cut: false })),
        Err(OpError::Beyond { count: 2, length: 25 })
    ));
}

#[test]
fn tangents_follow_time_and_mirror() {
    let joints = vec!["a".to_owned(), "b".to_owned()];
    let mut clip = Clip::new(RobotRef { id: "r".into(), joints, ..RobotRef::default() }, 100);
    clip.keys = vec![Key::new(10, &[1.0, 0.0]), Key::new(20, &[2.0, 0.0])];
    let before = clip.clone();
    let table = generate::table(&clip);
    let all = |joints: Option<&str>, tangent| {
        let joints = joints.map(|j| vec![j.to_owned()]);
        Op::TangentSet(TangentSet { frames: vec![10, 20], joints, tangent })
    };
    let undo = apply(&mut clip, &all(None, Some(Tangent::corner(1.0, 2.0))), None).unwrap();
    apply(&mut clip, &all(Some("b"), None), None).unwrap();
    let at =
        |c: &Clip, frame| c.key(frame).unwrap().tangents.clone().into_iter().collect::<Vec<_>>();
    assert_eq!(at(&clip, 20), [("a".to_owned(), Tangent::corner(1.0, 2.0))]);
    let scale = KeysScale { frames: vec![10, 20], pivot: 10, factor: 2.0, replace: false };
    let slow = edited(&clip, &Op::KeysScale(scale), None).unwrap();
    assert_eq!(at(&slow, 30)[0].1, Tangent::corner(0.5, 1.0), "half as fast");
    let mirror = Op::KeysMirror(KeysFrames { frames: vec![20] });
    let image = edited(&clip, &mirror, Some(&table)).unwrap();
    assert_eq!(at(&image, 20)[0].1, Tangent::corner(-1.0, -2.0), "the first joint turns around");
    assert!(matches!(edited(&clip, &all(Some("c"), None), None), Err(OpError::NoJoint { .. })));
    apply(&mut clip, &all(Some("b"), Some(Tangent::FLAT)), None).unwrap();
    apply(&mut clip, &all(None, None), None).unwrap();
    assert_eq!(clip, before);
    apply(&mut clip, &undo, None).unwrap();
    assert_eq!(clip, before);
}

#[test]
fn masks_split_by_joint() {
    let joints = vec!["a".to_owned(), "b".to_owned(), "c".to_owned()];
    let mut clip = Clip::new(RobotRef { id: "r".into(), joints, ..RobotRef::default() }, 50);
    let set = |from, to, joints: Option<&[&str]>, masked| {
        let joints = joints.map(|j| j.iter().map(|n| (*n).to_owned()).collect());
        Op::MaskSet(MaskSet { from, to, joints, masked })
    };
    apply(&mut clip, &set(10, 30, None, true), None).unwrap();
    apply(&mut clip, &set(30, 40, None, true), None).unwrap();
    assert_eq!(clip.masks, [Mask { from: 10, to: 40, joints: None }], "neighbours join");
    apply(&mut clip, &set(20, 25, Some(&["b"]), false), None).unwrap();
    let rest = Some(vec!["a".to_owned(), "c".to_owned()]);
    let expect = [
        Mask { from: 10, to: 20, joints: None },
        Mask { from: 20, to: 25, joints: rest },
        Mask { from: 25, to: 40, joints: None },
    ];
    assert_eq!(clip.masks, expect);
    apply(&mut clip, &set(0, 50, None, false), None).unwrap();
    assert!(clip.masks.is_empty());
}

#[test]
fn unknown_operations_and_arguments_are_refused() {
    for text in [
        r#"{"op": "keys.dance", "args": {}}"#,
        r#"{"op": "keys.move", "args": {"frames": [1], "df": 1, "riple": true}}"#,
        r#"{"op": "keys.delete", "args": {"frames": [1]}, "id": 7}"#,
        r#"{"args": {"frames": [1], "x": 1}, "op": "keys.delete"}"#,
        r#"{"op": "keys.add", "args": {"keys": [{"frame": 1}]}}"#,
        r#"{"op": "keys.add", "args": {"keys": [{"frame": 1, "q": [1], "colour": 2}]}}"#,
        r#"{"op": "markers.add", "args": {"frame": -1, "name": "a"}}"#,
    ] {
        assert!(serde_json::from_str::<Op>(text).is_err(), "{text}");
    }
    let fill = r#"{"op": "keys.set", "args": {"frame": 3, "fill": null}}"#;
    let Ok(Op::KeysSet(set)) = serde_json::from_str(fill) else { panic!("{fill}") };
    assert_eq!(set.fill, Some(None), "null is not absent");
}
