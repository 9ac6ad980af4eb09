//! Findings: what is found, where, and that the fix fixes it.

use robert::clip::*;
use robert::units::Unit;

fn table() -> JointTable {
    let joint = |name: &str| JointFacts {
        name: name.into(),
        unit: Unit::Rad,
        range: Some([-1.0, 2.0]),
        speed_max: Some(2.0),
        band: None,
        speed_usual: None,
        moves_alone: true,
    };
    JointTable {
        robot: "hand".into(),
        model_sha256: Some("ab".repeat(32)),
        joints: vec![joint("J1"), joint("J2"), joint("J3")],
        rest: vec![0.0; 3],
        mirror: Mirror::None("one hand".into()),
        couplings: vec![Coupling {
            kind: CouplingKind::Tendon,
            name: "J0".into(),
            members: ["J1", "J2"]
                .map(|j| CouplingMember { joint: j.into(), coef: 1.0, offset: 0.0 })
                .to_vec(),
            tolerance: 0.1,
        }],
        granularity: Granularity::State,
        kinematics: None,
    }
}

fn clip(keys: Vec<Key>) -> Clip {
    let joints = table().names();
    let robot = RobotRef { id: "hand".into(), joints, ..RobotRef::default() };
    let mut clip = Clip::new(robot, 60);
    clip.keys = keys;
    clip
}

fn found(clip: &Clip) -> Vec<Lint> {
    lint(clip, &compile(clip).unwrap(), &table(), None)
}

fn rules(clip: &Clip) -> Vec<Rule> {
    let mut rules: Vec<Rule> = found(clip).iter().map(|l| l.rule).collect();
    rules.dedup();
    rules
}

/// Every fix of this rule makes the number of its findings smaller.
fn fixes(clip: &Clip, rule: Rule) -> Vec<Lint> {
    let of_rule = |c: &Clip| found(c).into_iter().filter(|l| l.rule == rule).collect::<Vec<_>>();
    let lints = of_rule(clip);
    assert!(!lints.is_empty(), "{rule:?} not found");
    for lint in &lints {
        assert!(!lint.fixes.is_empty(), "{lint:?}");
        for fix in &lint.fixes {
            let next = edited(clip, &fix.op, Some(&table())).unwrap();
            assert!(of_rule(&next).len() < lints.len(), "{} does not fix {lint:?}", fix.title);
        }
    }
    lints
}

fn dense(frames: u32, step: f64) -> Vec<Key> {
    (0..frames).map(|f| Key::new(f, &[0.0, 0.0, -1.0 + step * f64::from(f)])).collect()
}

#[test]
fn nothing_to_say_about_a_good_clip() {
    let keys = vec![Key::new(0, &[0.0; 3]).held(20), Key::new(39, &[0.5, 0.5, 0.0]).held(21)];
    assert_eq!(found(&clip(keys)), []);
}

#[test]
fn a_single_frame_is_no_motion() {
    let mut c = clip(vec![Key::new(0, &[0.0; 3])]);
    c.length = 1;
    let lints = found(&c);
    assert_eq!((lints[0].rule, lints[0].level), (Rule::Empty, Level::Error));
}

#[test]
fn limits_speeds_and_couplings() {
    let keys = vec![Key::new(0, &[0.0; 3]).held(20), Key::new(40, &[0.5, 0.5, 2.5]).held(20)];
    let lints = fixes(&clip(keys), Rule::JointLimit);
    assert_eq!((lints[0].level, lints[0].pointer.as_str()), (Level::Error, "/keys/1/q/2"));
    assert_eq!((lints[0].frames, &lints[0].joints[..]), (Some([40, 41]), &["J3".to_owned()][..]));

    for fill in Fill::ALL {
        let mut c =
            clip(vec![Key::new(0, &[0.0; 3]).held(20), Key::new(25, &[0.0, 0.0, 1.5]).held(35)]);
        c.fill = fill;
        let lints = fixes(&c, Rule::JointSpeed);
        assert_eq!(lints[0].joints, ["J3"], "{fill:?}");
    }
    fixes(&clip(dense(20, 0.15)), Rule::JointSpeed);

    let lints = fixes(&clip(vec![Key::new(0, &[0.5, 0.0, 0.0]).held(60)]), Rule::Coupled);
    assert_eq!(lints[0].joints, ["J1", "J2"]);
}

#[test]
fn a_clip_in_degrees_is_read_as_a_whole() {
    let mut c = clip(vec![
        Key::new(0, &[0.0; 3]).held(20),
        // Alone this pose would be clamped.
        Key::new(39, &[0.0, 0.0, 20.0]),
        Key::new(59, &[30.0, 30.0, 20.0]),
    ]);
    c.start = Some(Start::Q(vec![0.0, 0.0, 9.0]));
    let lints: Vec<_> = found(&c).into_iter().filter(|l| l.rule == Rule::JointLimit).collect();
    assert_eq!(lints.len(), 3);
    assert!(lints.iter().all(|lint| lint.message.contains("are these degrees?")), "{lints:?}");
    let offered: Vec<_> =
        lints.iter().flat_map(|l| &l.fixes).filter(|f| f.title.starts_with("Read")).collect();
    assert_eq!((offered.len(), offered[0].title.as_str()), (1, "Read 3 poses as degrees"));
    let next = edited(&c, &offered[0].op, Some(&table())).unwrap();
    assert!(!rules(&next).contains(&Rule::JointLimit));
    let third = |k: usize| compile(&next).unwrap().row([39, 59][k])[2];
    assert_eq!([third(0), third(1)], [0.349_066, 0.349_066]);
    assert_eq!(next.start, Some(Start::Q(vec![0.0, 0.0, 0.157_08])));
    // A recording in degrees has a finding for each frame, and one edit for all of them.
    let mut long = clip((0..3000).map(|f| Key::new(f, &[30.0, 30.0, 20.0])).collect());
    long.length = 3000;
    let size: usize = found(&long).iter().map(|l| serde_json::to_vec(l).unwrap().len()).sum();
    assert!(size < 3 << 20, "{size} bytes");
    // A pose that is possible as it is stays.
    let c = clip(vec![Key::new(0, &[0.0, 0.0, 1.5]), Key::new(39, &[30.0, 30.0, 20.0])]);
    let lints = fixes(&c, Rule::JointLimit);
    assert_eq!(lints[0].fixes[0].title, "Read the pose as degrees");
    // One large value alone is a mistake of another kind.
    let c = clip(vec![Key::new(0, &[0.0, 0.0, 90.0])]);
    assert!(fixes(&c, Rule::JointLimit)[0].fixes[0].title.starts_with("Clamp"));
}

#[test]
fn the_way_from_the_start_to_the_first_key_is_as_slow_as_any() {
    let mut c = clip(vec![Key::new(8, &[0.0, 0.0, 1.5]).held(52)]);
    assert_eq!(rules(&c), [], "without a start it begins at the first key");
    c.start = Some(Start::Q(vec![0.0; 3]));
    let lints = fixes(&c, Rule::JointSpeed);
    assert_eq!(
        (lints[0].frames, lints[0].joints.as_slice()),
        (Some([0, 9]), &["J3".to_owned()][..])
    );
    assert_eq!(lints[0].fixes[0].title, "Allow 7 more frames before frame 8");
    assert!(lints[0].fixes.iter().any(|f| f.title.starts_with("Slow")), "{lints:?}");
    // A key at frame 0 that is held and is not where the robot begins.
    let mut c = clip(vec![Key::new(0, &[0.0, 0.0, 0.3]).held(20), Key::new(39, &[0.0; 3])]);
    c.start = Some(Start::Q(vec![0.0; 3]));
    let lints = fixes(&c, Rule::JointSpeed);
    assert_eq!(lints[0].fixes.len(), 1);
    assert_eq!(lints[0].fixes[0].title, "Allow 3 more frames before frame 0");
}

#[test]
fn keys_on_the_way_leave_free_joints_free() {
    let free = |frame, x| Key::with(frame, Goal::Q(vec![None, None, Some(x)]));
    let c = clip(vec![Key::new(0, &[0.0; 3]), free(41, 0.5), free(59, 0.5)]);
    let lints = fixes(&c, Rule::BlindSpan);
    let next = edited(&c, &lints[0].fixes[0].op, Some(&table())).unwrap();
    for frame in [14, 27] {
        let Goal::Q(row) = &next.key(frame).unwrap().goal else { panic!("a pose") };
        assert!(matches!(row[..], [None, None, Some(_)]), "{row:?}");
    }
}

#[test]
fn blind_spans_are_found_and_fixed() {
    let c = clip(vec![Key::new(0, &[0.0; 3]), Key::new(21, &[0.1; 3]).held(39)]);
    let lints = fixes(&c, Rule::BlindSpan);
    assert_eq!((lints.len(), lints[0].frames), (1, Some([1, 21])));
    assert_eq!(lints[0].fixes.len(), 2);
    // As few keys as needed, at even distances.
    for (goal, expected) in [(41, vec![14, 27]), (40, vec![20]), (60, vec![20, 40]), (22, vec![11])]
    {
        let mut c = clip(vec![Key::new(0, &[0.0; 3]), Key::new(goal, &[0.1; 3])]);
        c.length = goal + 1;
        let Op::KeysAdd(added) = &fixes(&c, Rule::BlindSpan)[0].fixes[0].op else { panic!() };
        let frames: Vec<u32> = added.keys.iter().map(|k| k.frame).collect();
        assert_eq!(frames, expected, "{goal}");
    }
    let c = clip(vec![Key::new(0, &[0.0; 3]), Key::new(20, &[0.1; 3]).held(40)]);
    assert_eq!(rules(&c), [], "20 frames apart is in sight");
    let mut c = clip(dense(60, 0.0));
    c.masks = vec![Mask { from: 10, to: 40, joints: None }];
    let blind = fixes(&c, Rule::BlindSpan);
    assert_eq!(blind[0].fixes[0].title, "Unmask frames 10 to 39");
    let tail = clip(vec![Key::new(0, &[0.0; 3])]);
    fixes(&tail, Rule::BlindSpan);
    let late = clip(vec![Key::new(59, &[0.1; 3])]);
    fixes(&late, Rule::BlindSpan);
}

#[test]
fn joints_left_open_need_a_policy_that_knows_them() {
    let mut c = clip(vec![Key::new(0, &[0.0; 3]).held(60)]);
    c.masks = vec![Mask { from: 5, to: 9, joints: Some(vec!["J3".into()]) }];
    let lints = fixes(&c, Rule::PartialMask);
    assert_eq!((lints[0].frames, &lints[0].joints[..]), (Some([5, 9]), &["J3".to_owned()][..]));
    let able = JointTable { granularity: Granularity::Joint, ..table() };
    assert_eq!(lint(&c, &compile(&c).unwrap(), &able, None), []);
}

#[test]
fn slopes_are_ones_that_joints_can_follow() {
    let still = |frame: u32, tangent: Option<Tangent>| {
        let mut key = Key::new(frame, &[0.0; 3]);
        key.tangents.extend(tangent.map(|t| ("J3".to_owned(), t)));
        key
    };
    let cubic = |tangent: Tangent| {
        let mut c = clip(vec![still(0, None), still(20, Some(tangent)), still(39, None).held(21)]);
        c.fill = Fill::Cubic;
        c
    };
    let lints = fixes(&cubic(Tangent::Slope(2.5)), Rule::JointSpeed);
    let slope = lints.iter().find(|l| l.pointer == "/keys/1/tangents/J3").unwrap();
    assert!(slope.message.contains("J3 2.50 of 2.00 rad/s"), "{}", slope.message);
    assert_eq!(rules(&cubic(Tangent::Slope(1.9))), []);
    // In 19 frames a curve that leaves with 19 rad/s rises far above the range of 2 rad.
    let mut wild = cubic(Tangent::corner(0.0, 19.0));
    let lints = fixes(&wild, Rule::JointLimit);
    assert_eq!((lints[0].level, lints[0].frames), (Level::Error, Some([20, 40])));
    fixes(&wild, Rule::JointSpeed);
    for _ in 0..4 {
        let Some(lint) = found(&wild).into_iter().find(|l| l.level > Level::Info) else { break };
        wild = edited(&wild, &lint.fixes[0].op, None).unwrap();
    }
    assert_eq!(rules(&wild), []);
    let mut unseen = cubic(Tangent::FLAT);
    unseen.fill = Fill::Linear;
    assert_eq!(fixes(&unseen, Rule::Hidden)[0].level, Level::Info);
}

#[test]
fn other_robots_and_hidden_keys() {
    let mut c = clip(vec![Key::new(0, &[0.0; 3]).held(60)]);
    c.robot.id = "foot".into();
    assert_eq!(rules(&c), [Rule::OtherRobot]);
    let mut c = clip(vec![Key::new(0, &[0.0; 3]).held(60)]);
    c.robot.model_sha256 = Some("cd".repeat(32));
    assert_eq!(found(&c)[0].level, Level::Warning);
    let mut c = clip(vec![Key::new(0, &[0.0; 3]).held(60)]);
    c.robot.joints[1] = "thumb".into();
    assert_eq!(rules(&c), [Rule::UnknownJoint]);
    assert_eq!(found(&c).len(), 2, "one too many and one too few");
    c.robot.joints[2] = "wrist".into();
    let both: Vec<String> = found(&c).into_iter().map(|l| l.message).collect();
    assert!(both.len() == 2 && both[1].ends_with("has no joint thumb, wrist"), "{both:?}");
    let mut c = clip(vec![Key::new(0, &[0.0; 3]).held(60), Key::new(9, &[0.0; 3]).held(51)]);
    assert_eq!(found(&c)[0].pointer, "/keys/0/hold");
    fixes(&c, Rule::Hidden);
    c.keys[0].hold = 9;
    c.masks = vec![Mask { from: 0, to: 9, joints: None }];
    fixes(&c, Rule::Hidden);
}

#[test]
fn a_key_for_some_joints_ends_only_their_holds() {
    let whole = |frame| Key::new(frame, &[0.0; 3]);
    let one = |frame| Key::with(frame, Goal::Q(vec![Some(0.1), None, None]));
    let mut c = clip(vec![whole(0).held(20), one(12).filled(Fill::Linear), whole(30).held(30)]);
    let able = JointTable { granularity: Granularity::Joint, ..table() };
    let said = |c: &Clip| -> Vec<String> {
        let lints = lint(c, &compile(c).unwrap(), &able, None);
        lints.into_iter().filter(|l| l.rule == Rule::Hidden).map(|l| l.message).collect()
    };
    let cut = "the hold of 20 frames at frame 0 ends earlier for J1, at the key at frame 12";
    assert_eq!(said(&c), [cut]);
    c.keys[0] = whole(0).held(5).filled(Fill::Cubic);
    assert_eq!(said(&c), [""; 0], "the fill leads J2 and J3 past the key");
    // A mask of J1 hides the key, whatever is commanded of the other joints there.
    c.masks = vec![Mask { from: 12, to: 13, joints: Some(vec!["J1".into()]) }];
    assert_eq!(said(&c), ["the key at frame 12 is hidden by a mask"]);
}

#[test]
fn speeds_and_slopes_are_those_between_the_keys_of_a_joint() {
    let one = |frame| Key::with(frame, Goal::Q(vec![None, Some(0.0), None]));
    let j3 = |frame, q| Key::with(frame, Goal::Q(vec![None, None, Some(q)]));
    let able = JointTable { granularity: Granularity::Joint, couplings: vec![], ..table() };
    let said = |c: &Clip, rule: Rule| -> Vec<Lint> {
        let lints = lint(c, &compile(c).unwrap(), &able, None);
        lints.into_iter().filter(|l| l.rule == rule).collect()
    };
    // J3 has 8 frames, and needs 15; the keys between are about another joint.
    let keys = vec![Key::new(0, &[0.0; 3]).held(20), one(22), one(24), j3(27, 1.5), one(59)];
    let mut c = clip(keys);
    for fill in Fill::ALL {
        c.fill = fill;
        let lints = said(&c, Rule::JointSpeed);
        assert_eq!((lints.len(), &lints[0].joints[..]), (1, &["J3".to_owned()][..]), "{fill:?}");
        for fix in &lints[0].fixes {
            let next = edited(&c, &fix.op, Some(&able)).unwrap();
            assert_eq!(said(&next, Rule::JointSpeed), [], "{fill:?}: {}", fix.title);
        }
        assert!(lints[0].fixes.len() > usize::from(fill != Fill::Hold), "{lints:?}");
    }
    // A steep slope shapes the curve to the joint's own next key.
    c.fill = Fill::Cubic;
    c.keys[3] = j3(40, 0.0);
    c.keys[0].tangents.insert("J3".into(), Tangent::Slope(19.0));
    c.keys[1].tangents.insert("J3".into(), Tangent::FLAT);
    let out = said(&c, Rule::JointLimit);
    assert_eq!(
        (out.len(), out[0].frames, &out[0].joints[..]),
        (1, Some([0, 41]), &["J3".to_owned()][..])
    );
    let idle = said(&c, Rule::Hidden);
    assert_eq!((idle.len(), idle[0].pointer.as_str()), (1, "/keys/1/tangents"));
    assert_eq!(idle[0].fixes.len(), 1, "no fill makes a curve of a joint without a value");
}

struct Wall;

impl PoseChecker for Wall {
    fn check(&mut self, _: &[String], q: &[f64]) -> PoseReport {
        let contacts = if q[0] > 1.0 { vec![("a".into(), "b".into(), 0.01)] } else { vec![] };
        PoseReport { contacts, settled: Some(q.iter().map(|v| v.min(1.0)).collect()) }
    }
}

#[test]
fn poses_are_judged_by_the_checker() {
    let mut c = clip(vec![Key::new(0, &[1.5, 1.5, 0.0]).held(60)]);
    c.poses.insert("p".into(), vec![Some(0.0), Some(0.0), Some(1.8)]);
    let lints = lint(&c, &compile(&c).unwrap(), &table(), Some(&mut Wall));
    let rules: Vec<_> = lints.iter().map(|l| (l.rule, l.pointer.as_str())).collect();
    let expect = [
        (Rule::SelfCollision, "/keys/0/q"),
        (Rule::Unreachable, "/keys/0/q"),
        (Rule::Unreachable, "/poses/p"),
    ];
    for e in expect {
        assert!(rules.contains(&e), "{rules:?}");
    }
    for found in lints {
        c = edited(&c, &found.fixes[0].op, None).unwrap();
    }
    assert_eq!(lint(&c, &compile(&c).unwrap(), &table(), Some(&mut Wall)), []);
}

#[test]
fn keys_are_judged_where_their_free_joints_do_not_move_along() {
    let judged = |row: [Option<f64>; 3], table: &JointTable| {
        let c = clip(vec![Key::with(0, Goal::Q(row.to_vec())).held(60)]);
        let lints = lint(&c, &compile(&c).unwrap(), table, Some(&mut Wall));
        lints.iter().any(|l| l.rule == Rule::Unreachable)
    };
    let free = [None, None, Some(1.8)];
    assert!(judged(free, &table()), "the others have motors of their own");
    assert!(judged([Some(0.5), Some(1.8), None], &table()));
    // Where the first joint has to be, only the tendon knows.
    assert!(!judged([None, Some(1.8), None], &table()));
    let mut spatial = table();
    spatial.couplings.clear();
    spatial.joints[1].moves_alone = false;
    assert!(!judged(free, &spatial), "it may hang on a motor with the third");
    assert!(judged([None, Some(0.0), Some(1.8)], &spatial));
}

/// J2 follows J1, and J3 follows J2.
#[test]
fn joints_that_follow_may_be_left_free() {
    let mut table = table();
    let follows = |name: &str, leader: &str, coef: f64| Coupling {
        kind: CouplingKind::Mimic,
        name: leader.into(),
        members: [(leader, 1.0), (name, coef)]
            .map(|(j, coef)| CouplingMember { joint: j.into(), coef, offset: 0.0 })
            .to_vec(),
        tolerance: 0.1,
    };
    table.couplings = vec![follows("J3", "J2", 0.5), follows("J2", "J1", 1.0)];
    let said = |row: [Option<f64>; 3]| {
        let mut c = clip(vec![Key::new(0, &[0.0; 3]).held(60)]);
        c.poses.insert("p".into(), row.to_vec());
        let lints = lint(&c, &compile(&c).unwrap(), &table, Some(&mut Wall));
        lints.into_iter().filter(|l| l.rule == Rule::Unreachable).collect::<Vec<_>>()
    };
    let found = said([Some(1.5), None, None]);
    assert_eq!((found.len(), &found[0].joints[..]), (1, &["J1".to_owned()][..]));
    assert_eq!(found[0].settled.as_ref().unwrap().asked, [1.5, 1.5, 0.75]);
    // What is stored leaves free what was free.
    let mut c = clip(vec![Key::new(0, &[0.0; 3]).held(60)]);
    c.poses.insert("p".into(), vec![Some(1.5), None, None]);
    let stored = edited(&c, &found[0].fixes[0].op, None).unwrap();
    assert_eq!(stored.poses["p"], [Some(1.0), None, None]);
    assert_eq!(said([Some(0.5), None, None]), []);
}

#[test]
fn what_a_robot_holds_in_the_place_of_a_pose_is_said_with_its_distance_and_its_keys() {
    let mut c = clip(vec![Key::new(0, &[0.0, 0.0, 0.0])]);
    c.poses.insert("p".into(), vec![Some(1.2), Some(0.0), Some(1.8)]);
    for (frame, hold) in [(10, 5), (30, 1)] {
        c.keys.push(Key { frame, hold, goal: Goal::Pose("p".into()), ..Key::new(0, &[0.0]) });
    }
    let lints = lint(&c, &compile(&c).unwrap(), &table(), Some(&mut Wall));
    let found = lints.iter().find(|l| l.rule == Rule::Unreachable).unwrap();
    assert_eq!(found.joints, ["J3", "J1"], "the farthest first");
    assert!(found.message.ends_with("J3 by 0.800 rad, J1 by 0.200 rad"), "{}", found.message);
    let settled = found.settled.clone().unwrap();
    assert_eq!(settled.held, [[10, 15], [30, 31]], "both keys that use it");
    assert_eq!((settled.asked, settled.q), (vec![1.2, 0.0, 1.8], vec![1.0, 0.0, 1.0]));
    assert!(settled.joint == "J3" && (settled.distance - 0.8).abs() < 1e-12);
    assert!(lints.iter().all(|l| l.settled.is_none() || l.rule == Rule::Unreachable));
}

#[test]
fn a_long_wild_clip_is_checked_in_a_second() {
    let keys: Vec<Key> = (0..50_000)
        .map(|i| Key::new(i * 2, &[f64::from(i % 2) * 5.0, -3.0, f64::from(i % 3)]))
        .collect();
    let mut c = clip(keys);
    c.length = 100_000;
    c.masks = (0..1000).map(|i| Mask { from: i * 100, to: i * 100 + 41, joints: None }).collect();
    for fill in Fill::ALL {
        c.fill = fill;
        let start = super::cpu();
        let lints = found(&c);
        let took = super::cpu().saturating_sub(start);
        assert!(took.as_secs_f64() < 1.0, "{fill:?}: {took:?}");
        assert!(lints.len() > 1000 && lints.len() < 6000, "{}", lints.len());
        let text = serde_json::to_string(&lints).unwrap();
        assert!(text.len() < 8 << 20, "{} bytes", text.len());
    }
}
