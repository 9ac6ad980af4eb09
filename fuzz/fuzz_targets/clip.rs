//! Clips: what is accepted has a canonical text, compiles, and every fix that a check suggests applies.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use robert_base::units::Unit;
use robert_clip::{
    Clip, Granularity, JointFacts, JointTable, Mirror, compile, compile_for, edited, lint,
    parse_bytes,
};
use robert_robot::Robot;

static ARM: LazyLock<Robot> = LazyLock::new(|| Robot::builtin("ur5e").unwrap());

/// What a robot with the joints of the clip might say of itself. With those of the UR5e it has its links,
/// so that end-effector goals are solved.
fn table(clip: &Clip) -> JointTable {
    let fact = |(i, name): (usize, &String)| JointFacts {
        name: name.clone(),
        unit: clip.robot.units.get(i).copied().unwrap_or(Unit::Rad),
        range: (i % 3 != 2).then_some([-1.5, 1.5]),
        speed_max: (i % 2 == 0).then_some(2.0),
        band: None,
        speed_usual: None,
    };
    let joints: Vec<JointFacts> = clip.robot.joints.iter().enumerate().map(fact).collect();
    let is_arm = ARM.joints().iter().map(|j| &j.name).eq(&clip.robot.joints);
    JointTable {
        robot: clip.robot.id.clone(),
        model_sha256: None,
        rest: vec![0.0; joints.len()],
        joints,
        mirror: Mirror::None("there is no robot".to_owned()),
        couplings: Vec::new(),
        granularity: Granularity::State,
        kinematics: is_arm.then(|| ARM.kinematics().clone()),
    }
}

fuzz_target!(|bytes: &[u8]| {
    let Ok(parsed) = parse_bytes(bytes.to_vec()) else { return };
    let clip = parsed.clip.clone();
    let text = clip.to_text();
    let back = Clip::parse(&text).expect("our own text is read");
    assert_eq!(back, clip);
    assert_eq!(back.to_text(), text);
    // Long clips cost time and show nothing new.
    if clip.length > 2_000 {
        return;
    }
    let table = table(&clip);
    let Ok(command) = compile_for(&clip, Some(&table)) else {
        assert!(clip.keys.iter().any(|k| !k.reach.is_empty()), "only a point can be unknown");
        return;
    };
    assert!(command.q().iter().all(|v| v.is_finite()));
    if clip.keys.iter().all(|k| k.reach.is_empty()) {
        assert_eq!(compile(&clip).unwrap().q(), command.q());
    }
    let lints = lint(&clip, &command, &table, None);
    let places = parsed.places(lints.iter().map(|l| l.pointer.as_str()));
    assert_eq!(places.len(), lints.len());
    for fix in lints.iter().flat_map(|l| &l.fixes).take(20) {
        let next = edited(&clip, &fix.op, Some(&table)).expect("a fix applies");
        assert_eq!(next.validate(), Ok(()));
    }
});
