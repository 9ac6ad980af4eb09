//! Tracks: the keys of a joint lead from one to the next, whatever lies between them.

use proptest::prelude::*;
use robert::clip::*;

use super::generate;

fn two(length: u32) -> Clip {
    let joints = vec!["a".to_owned(), "b".to_owned()];
    Clip::new(RobotRef { id: "r".into(), joints, ..RobotRef::default() }, length)
}

#[test]
fn a_key_says_nothing_about_joints_without_a_value() {
    let mut k = two(40);
    k.keys = vec![
        key(5, Some(1.0), Some(1.0)).held(20).filled(Fill::Linear),
        key(10, Some(2.0), None).held(3),
        key(30, Some(4.0), Some(3.0)),
    ];
    let c = compile(&k).unwrap();
    let seen = |j: usize| -> Vec<u32> { (0..40).filter(|t| c.sees(*t, j)).collect() };
    assert_eq!(seen(0), (5..13).chain([30]).collect::<Vec<_>>(), "its own key ends its hold");
    assert_eq!(seen(1), (5..=30).collect::<Vec<_>>(), "held to 24, then a line");
    assert_eq!((c.row(24)[1], c.row(27)[1], c.row(30)[1]), (1.0, 2.0, 3.0));
    let spans: Vec<_> = c.spans().iter().map(|s| (s.from, s.to, s.kind)).collect();
    use SpanKind::{Key as Held, Linear, Open};
    let expect = [
        (0, 5, Open),
        (5, 10, Held),
        (10, 13, Held),
        (13, 25, Held),
        (25, 30, Linear),
        (30, 31, Held),
        (31, 40, Open),
    ];
    assert_eq!(spans, expect);
    assert_eq!([k.hold_end(0), k.hold_end(1)], [25, 13]);
    // After its last key a joint keeps its value while the other one moves on.
    k.keys[1] = key(10, Some(2.0), None).filled(Fill::Cubic);
    k.keys[2] = key(30, None, Some(3.0));
    let c = compile(&k).unwrap();
    assert!((10..40).all(|t| c.sees(t, 0) && c.row(t)[0] == 2.0));
    assert!(!c.sees(31, 1));
}

/// A key with values for some joints.
fn key(frame: u32, a: Option<f64>, b: Option<f64>) -> Key {
    Key::with(frame, Goal::Q(vec![a, b]))
}

/// The frames at which a joint has a goal after an edit.
fn seen_after(clip: &Clip, op: &str, joint: usize) -> Vec<u32> {
    let op: Op = serde_json::from_str(op).unwrap();
    let clip = edited(clip, &op, None).unwrap_or_else(|e| panic!("{op:?}: {e}"));
    let command = compile(&clip).unwrap();
    (0..clip.length).filter(|t| command.sees(*t, joint)).collect()
}

#[test]
fn an_edit_for_some_joints_leaves_the_holds_of_the_others() {
    let mut k = two(100);
    k.keys = vec![key(0, Some(0.0), Some(1.0)).held(60)];
    k.poses.insert("p".into(), vec![Some(0.3), Some(0.4)]);
    for op in [
        r#"{"op": "keys.paste", "args": {"at": 30, "keys": [{"frame": 0, "q": [0.3, 0.4]}], "joints": ["a"]}}"#,
        r#"{"op": "pose.apply", "args": {"name": "p", "frames": [30], "joints": ["a"]}}"#,
        r#"{"op": "pose.apply", "args": {"name": "p", "frames": [30], "joints": ["a"], "blend": 0.5}}"#,
    ] {
        assert_eq!(seen_after(&k, op, 0), (0..=30).collect::<Vec<_>>(), "{op}");
        assert_eq!(seen_after(&k, op, 1), (0..60).collect::<Vec<_>>(), "{op}");
    }
}

#[test]
fn a_hold_that_is_cut_for_one_joint_grows_into_no_inserted_and_no_deleted_time() {
    let mut k = two(100);
    k.keys = vec![key(0, Some(0.0), Some(1.0)).held(60), key(30, Some(0.5), None)];
    let insert = r#"{"op": "time.insert", "args": {"at": 30, "frames": 10}}"#;
    assert_eq!(seen_after(&k, insert, 0), (0..30).chain([40]).collect::<Vec<_>>());
    assert_eq!(seen_after(&k, insert, 1), (0..70).collect::<Vec<_>>());
    let delete = r#"{"op": "time.delete", "args": {"from": 20, "to": 35}}"#;
    assert_eq!(seen_after(&k, delete, 0), (0..20).collect::<Vec<_>>());
    assert_eq!(seen_after(&k, delete, 1), (0..45).collect::<Vec<_>>());
}

#[test]
fn a_block_goes_without_what_is_held_before_it() {
    let mut k = two(100);
    let block = Marker { frame: 60, name: "b".into(), to: Some(80) };
    k.keys = vec![
        key(0, Some(0.0), Some(1.0)).held(50),
        key(10, Some(0.5), None),
        key(60, Some(1.0), Some(1.0)),
    ];
    k.markers = vec![block];
    let delete = r#"{"op": "blocks.delete", "args": {"frame": 60}}"#;
    assert_eq!(seen_after(&k, delete, 1), (0..50).collect::<Vec<_>>());
}

#[test]
fn a_joint_that_ends_where_a_block_is_inserted_is_led_no_farther() {
    let mut k = two(100);
    k.keys = vec![
        key(0, Some(0.0), Some(0.0)).held(50),
        key(10, Some(0.1), None).filled(Fill::Linear),
        key(60, Some(0.2), None),
        key(80, None, Some(0.3)),
    ];
    let insert = |frame: u32| {
        format!(
            r#"{{"op": "blocks.insert", "args": {{"at": 50, "name": "b", "part": {{"joints": ["a", "b"], "length": 10, "keys": [{{"frame": {frame}, "q": [1, null]}}]}}}}}}"#
        )
    };
    assert_eq!(seen_after(&k, &insert(0), 1), (0..50).chain([90]).collect::<Vec<_>>());
    // A part that says more than its frames is refused.
    let op: Op = serde_json::from_str(&insert(u32::MAX - 5)).unwrap();
    let said = edited(&k, &op, None).unwrap_err().to_string();
    assert!(said.contains("beyond its end"), "{said}");
}

#[test]
fn the_finding_names_the_joints_that_the_next_key_cuts() {
    let joints = ["a", "b", "c"].map(str::to_owned).to_vec();
    let mut k = Clip::new(RobotRef { id: "r".into(), joints, ..RobotRef::default() }, 100);
    let row = |frame, a, b, c| Key::with(frame, Goal::Q(vec![a, b, c]));
    k.keys = vec![
        row(0, Some(0.0), Some(1.0), Some(1.0)).held(60),
        row(30, Some(0.5), None, None),
        row(40, None, Some(0.5), None),
    ];
    let said = |k: &Clip| -> Vec<String> {
        let table = JointTable::from_clip(k);
        let lints = lint(k, &compile(k).unwrap(), &table, None);
        lints.into_iter().map(|l| l.message).filter(|m| m.contains("the hold")).collect()
    };
    assert_eq!(
        said(&k),
        ["the hold of 60 frames at frame 0 ends earlier for a, at the key at frame 30"]
    );
}

/// What a policy sees at a step: goals, virtual keys, and what is held after the end.
fn window(c: &Command, step: u32) -> Vec<Option<f32>> {
    let mut seen = Vec::new();
    for f in step + 1..=step + LOOKAHEAD_FRAMES {
        let goal = |j: usize| c.sees(f, j).then(|| c.row(f)[j]);
        if f < c.frames() {
            seen.extend((0..c.dim()).map(goal));
        } else {
            seen.extend(c.held_end().into_iter().map(Some));
        }
    }
    let far = step + LOOKAHEAD_FRAMES;
    let free = |j: &usize| far < c.frames() && (step + 1..=far).all(|f| !c.sees(f, *j));
    // A joint without a goal in the window is led along its own line.
    seen.extend((0..c.dim()).filter(free).map(|j| Some(c.interpolated(far)[j])));
    seen.extend(c.virtual_key(step).into_iter().flat_map(|key| key.q).map(Some));
    seen
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_joint_is_commanded_as_if_the_clip_were_about_it_alone(seed in any::<u64>()) {
        let clip = generate::clip(seed);
        let whole = compile(&clip).unwrap();
        for (j, name) in clip.robot.joints.iter().enumerate() {
            let alone = compile(&only(&clip, j)).unwrap();
            prop_assert_eq!(alone.start(), &whole.start()[j..=j]);
            for t in 0..clip.length {
                let goal = |c: &Command, j: usize| c.sees(t, j).then(|| c.row(t)[j].to_bits());
                prop_assert_eq!(goal(&whole, j), goal(&alone, 0), "{} at frame {}", name, t);
            }
        }
    }

    #[test]
    fn inserted_time_changes_no_frame_that_nothing_leads_across(
        seed in any::<u64>(), at in 0_u32..300, frames in 1_u32..40
    ) {
        let mut clip = generate::clip(seed);
        clip.normalize();
        clip.offsets.clear();
        let at = at.min(clip.length);
        for key in &mut clip.keys {
            let curved = matches!(clip.fill, Fill::Linear | Fill::Cubic) && key.fill.is_none();
            if curved || matches!(key.fill, Some(Fill::Linear | Fill::Cubic)) {
                key.fill = Some(Fill::Hold);
            }
        }
        let before = compile(&clip).unwrap();
        let insert = TimeInsert { at, frames };
        let after = compile(&edited(&clip, &Op::TimeInsert(insert), None).unwrap()).unwrap();
        for t in 0..clip.length {
            let then = if t < at { t } else { t + frames };
            for j in 0..clip.dim() {
                prop_assert_eq!(before.sees(t, j), after.sees(then, j), "frame {} joint {}", t, j);
                prop_assert!(before.row(t)[j].to_bits() == after.row(then)[j].to_bits());
            }
        }
    }

    #[test]
    fn no_step_before_the_first_changed_one_sees_a_difference(seed in any::<u64>()) {
        let clip = generate::clip(seed);
        let mut editor = Editor::new(clip, None).unwrap();
        for i in 0..4 {
            let op = generate::op(&mut generate::rng(seed, i + 1), editor.clip(), true);
            let old = editor.version().command;
            let Ok(change) = editor.apply(&op) else { continue };
            let new = editor.command();
            let frames = new.frames().min(old.frames());
            let said = change.first_changed_step.unwrap_or(frames);
            for t in 0..said.min(frames) {
                prop_assert_eq!(window(&old, t), window(new, t), "step {} of {:?}", t, op);
            }
            let Some(f) = change.first_changed_frame.filter(|_| !new.is_partial() && !old.is_partial()) else { continue };
            if f.checked_sub(1).and_then(|t| new.prev_visible(t)).is_some_and(|a| f - a <= 20) {
                prop_assert_eq!(said, f.saturating_sub(20), "no gap: exactly 20 before");
            }
        }
    }
}

/// The clip for one of its joints alone: the keys that have a value for it.
fn only(clip: &Clip, joint: usize) -> Clip {
    let name = clip.robot.joints[joint].clone();
    let robot = RobotRef { joints: vec![name.clone()], units: Vec::new(), ..clip.robot.clone() };
    let mut alone = Clip::new(robot, clip.length);
    alone.fill = clip.fill;
    alone.start = clip.start.as_ref().map(|start| match start {
        Start::Q(q) => Start::Q(vec![q[joint]]),
        Start::Pose(pose) => Start::Q(vec![clip.poses[pose][joint].unwrap_or_default()]),
    });
    for key in &clip.keys {
        let Some(value) = clip.row(key).unwrap()[joint] else { continue };
        let tangents = key.tangents.iter().filter(|(j, _)| **j == name);
        alone.keys.push(Key {
            goal: Goal::Q(vec![Some(value)]),
            tangents: tangents.map(|(j, t)| (j.clone(), *t)).collect(),
            ..key.clone()
        });
    }
    let ours = |m: &&Mask| m.joints.as_ref().is_none_or(|joints| joints.contains(&name));
    alone.masks = clip.masks.iter().filter(ours).map(|m| Mask { joints: None, ..*m }).collect();
    alone.masks.sort();
    alone.masks.dedup();
    for offset in clip.offsets.iter().filter(|o| o.add.contains_key(&name)) {
        let add = [(name.clone(), offset.add[&name])].into();
        alone.offsets.push(Offset { add, ..offset.clone() });
    }
    alone
}
