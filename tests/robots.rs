//! The built-in robots are the ones of the fact tables, and the hand stays in one piece.

use std::sync::Arc;

use robert::mujoco::{Data, Kind, Model, Warnings};
use robert::rng::{Rng, Stream};
use robert::robot::{Coupling, Drive, Gravity, Robot, derive};
use robert::units::{CTRL_DT, SIM_DT, SUBSTEPS};

use crate::run::{call, robert};

fn builtin(id: &str) -> Robot {
    Robot::builtin(id).unwrap()
}

fn body(m: &Model, name: &str) -> usize {
    m.id(Kind::Body, name).unwrap_or_else(|| panic!("no body {name}"))
}

#[test]
fn ls_is_the_contract_for_scripts() {
    let ran = robert().args(["robots", "ls", "--json"]).succeeds();
    let dims: Vec<(String, u64, u64)> = ran
        .json()
        .as_array()
        .unwrap()
        .iter()
        .map(|r| {
            let n = |k: &str| r[k].as_u64().unwrap();
            (r["id"].as_str().unwrap().to_owned(), n("state_dim"), n("action_dim"))
        })
        .collect();
    let want = [("pointmass", 2, 2), ("ur5e", 5, 5), ("ur5e_light", 5, 5), ("shadow_hand", 22, 18)];
    assert_eq!(dims, want.map(|(id, s, a)| (id.to_owned(), s, a)));
}

#[test]
fn an_unknown_robot_is_named_with_the_nearest() {
    let ran = robert().args(["robots", "show", "shadowhand"]).fails(3);
    assert!(ran.stderr.contains("did you mean \"shadow_hand\"?"), "{}", ran.stderr);
    robert().args(["robots", "settle", "ur5e", "--pose", "wave"]).fails(3);
    robert().args(["robots", "settle", "ur5e", "--set", "elbow"]).fails(2);
    let ran = robert().args(["robots", "settle", "ur5e", "--set", "elbow=9"]).fails(3);
    assert!(ran.stderr.contains("-3.1415"), "{}", ran.stderr);
}

#[test]
fn physics_is_as_decided() {
    assert!((SIM_DT * SUBSTEPS as f64 - CTRL_DT).abs() < 1e-12);
    for id in Robot::builtin_ids() {
        let m = builtin(id).model().clone();
        assert_eq!((m.timestep(), m.integrator(), m.cone()), (SIM_DT, 0, 0), "{id}");
        assert_eq!(m.contacts(), id != "pointmass", "{id}");
        let gravity = if id.starts_with("ur5e") { -9.81 } else { 0.0 };
        assert_eq!(m.gravity(), &[0.0, 0.0, gravity], "{id}");
    }
}

#[test]
fn pointmass_facts() {
    let r = builtin("pointmass");
    let m = r.model();
    assert_eq!((m.nq(), m.nu()), (2, 2));
    assert_eq!(m.body_mass(), [0.0, 0.3]);
    assert_eq!(m.dof_damping(), [3.0, 3.0]);
    assert!(r.joints().iter().all(|j| j.unbounded && j.speed_limit == 1.0));
    // Terminal speed 1 m/s, 63 % of it after 0.1 s (less half a substep).
    let mut d = Data::new(m).unwrap();
    r.apply_action(&mut d, &[1.0, 0.0]).unwrap();
    d.step(20).unwrap();
    assert!((d.qvel()[0] - 0.632).abs() < 0.02, "{}", d.qvel()[0]);
    d.step(200).unwrap();
    assert!((d.qvel()[0] - 1.0).abs() < 1e-3);
}

// The range is Menagerie's rounded two turns, not the constant.
#[allow(clippy::approx_constant)]
#[test]
fn ur5e_facts() {
    let r = builtin("ur5e");
    let m = r.model();
    assert_eq!((m.nq(), m.nv(), m.nu()), (5, 5, 5));
    let names: Vec<_> = r.joints().iter().map(|j| j.name.as_str()).collect();
    assert_eq!(names, ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2"]);
    for (name, mass) in [
        ("base", 4.0),
        ("shoulder_link", 3.7),
        ("upper_arm_link", 8.393),
        ("forearm_link", 2.275),
        ("wrist_1_link", 1.219),
        ("wrist_2_link", 1.219),
        ("wrist_3_link", 0.1889),
    ] {
        assert_eq!(m.body_mass()[body(m, name)], mass, "{name}");
    }
    assert_eq!(m.dof_damping(), [100.0, 100.0, 100.0, 10.0, 10.0]);
    assert_eq!(m.dof_armature(), [0.1; 5]);
    assert_eq!(builtin("ur5e_light").model().dof_damping(), [10.0, 10.0, 10.0, 2.0, 2.0]);
    assert_ne!(r.model_sha256(), builtin("ur5e_light").model_sha256());
    for (j, hi) in r.joints().iter().zip([6.283_19, 6.283_19, 3.1415, 6.283_19, 6.283_19]) {
        assert_eq!(j.range, [-hi, hi], "{}", j.name);
    }
    let limits: Vec<f64> = r.actuators().iter().map(|a| a.ctrlrange[1]).collect();
    assert_eq!(limits, [150.0, 150.0, 150.0, 28.0, 28.0]);
    // Gravity at the zero pose, where the arm is straight out along +y: 52.4 and 14.5 N m.
    let mut d = Data::new(m).unwrap();
    d.forward().unwrap();
    assert!((d.qfrc_bias()[1].abs() - 52.4).abs() < 0.1, "{}", d.qfrc_bias()[1]);
    assert!((d.qfrc_bias()[2].abs() - 14.5).abs() < 0.1, "{}", d.qfrc_bias()[2]);
    let tip = 3 * r.site("end_effector").unwrap();
    let p = &d.site_xpos()[tip..tip + 3];
    assert!(p[1] > 0.8 && (p[2] - 1.5).abs() < 0.3, "{p:?}");
}

// Menagerie rounds quarter turns; the facts are its figures.
#[allow(clippy::approx_constant)]
#[test]
fn shadow_hand_facts() {
    let r = builtin("shadow_hand");
    let m = r.model();
    assert_eq!((m.nq(), m.nv(), m.nu(), m.ntendon()), (22, 22, 18, 4));
    let total: f64 = m.body_mass().iter().sum();
    assert!((total - 3.794).abs() < 1e-9, "{total}");
    let moving: f64 = m.body_subtreemass()[body(m, "palm")];
    assert!((moving - 0.694).abs() < 1e-9, "{moving}");
    let names: Vec<&str> = r.joints().iter().map(|j| j.name.as_str()).collect();
    let want = "FFJ4 FFJ3 FFJ2 FFJ1 MFJ4 MFJ3 MFJ2 MFJ1 RFJ4 RFJ3 RFJ2 RFJ1 LFJ5 LFJ4 LFJ3 LFJ2 LFJ1 THJ5 THJ4 THJ3 THJ2 THJ1";
    assert_eq!(names.join(" "), want);
    let motors: Vec<&str> = r.actuators().iter().map(|a| a.name.as_str()).collect();
    let want =
        "THJ5 THJ4 THJ3 THJ2 THJ1 FFJ4 FFJ3 FFJ0 MFJ4 MFJ3 MFJ0 RFJ4 RFJ3 RFJ0 LFJ5 LFJ4 LFJ3 LFJ0";
    assert_eq!(motors.join(" "), want);
    for a in r.actuators() {
        let limit = match a.name.as_str() {
            "THJ5" => 0.6,
            "THJ4" => 0.4,
            _ => 0.2,
        };
        assert_eq!(a.ctrlrange, [-limit, limit], "{}", a.name);
        assert_eq!(matches!(a.drive, Drive::Tendon(_)), a.name.ends_with("J0"), "{}", a.name);
    }
    for c in &r.profile().couplings {
        let Coupling::Tendon { coefs, range, .. } = c else { panic!("{c:?}") };
        assert_eq!((coefs.as_slice(), *range), ([1.0, 1.0].as_slice(), Some([0.0, 3.1415])));
    }
    for (name, lo, hi) in [
        ("FFJ4", -0.349_066, 0.349_066),
        ("MFJ3", -0.261_799, 1.5708),
        ("RFJ2", 0.0, 1.5708),
        ("LFJ5", 0.0, 0.785_398),
        ("THJ5", -1.0472, 1.0472),
        ("THJ4", 0.0, 1.22173),
        ("THJ3", -0.20944, 0.20944),
        ("THJ2", -0.698_132, 0.698_132),
        ("THJ1", -0.261_799, 1.5708),
    ] {
        let j = &r.joints()[r.joint_index(name).unwrap()];
        assert_eq!(j.range, [lo, hi], "{name}");
    }
    // Thumb straight out: its tip points along (.92, .36, .16) in the palm's frame.
    let mut d = Data::new(m).unwrap();
    let mut q = r.home();
    for (name, v) in [("THJ5", -0.6), ("THJ2", -0.5), ("THJ1", -0.2)] {
        q[r.joint_index(name).unwrap()] = v;
    }
    r.write_state(&mut d, &q).unwrap();
    d.kinematics().unwrap();
    let (palm, tip) = (9 * body(m, "palm"), 9 * body(m, "thdistal"));
    let dir = |k: usize| {
        (0..3).map(|r| d.xmat()[palm + 3 * r + k] * d.xmat()[tip + 3 * r + 2]).sum::<f64>()
    };
    for (k, want) in [0.92, 0.36, 0.16].iter().enumerate() {
        assert!((dir(k) - want).abs() < 0.01, "axis {k}: {}", dir(k));
    }
}

/// Ten seconds at zero control and ten of random control over the full range.
#[test]
fn the_hand_never_blows_up() {
    let r = builtin("shadow_hand");
    let mut d = Data::new(r.model()).unwrap();
    for full in [false, true] {
        d.reset().unwrap();
        for step in 0..200 {
            let mut rng = Rng::new(7, Stream::Test, step);
            let action: Vec<f64> =
                (0..18).map(|_| if full { rng.range(-1.0, 1.0) } else { 0.0 }).collect();
            r.apply_action(&mut d, &action).unwrap();
            d.step(SUBSTEPS).unwrap();
            assert!(d.qvel().iter().all(|v| v.abs() < 25.0), "step {step}");
        }
        assert_eq!(d.warnings(), Warnings::default());
        for (j, q) in r.joints().iter().zip(r.state(&d)) {
            assert!(q > j.range[0] - 0.2 && q < j.range[1] + 0.2, "{} at {q}", j.name);
        }
    }
}

/// Without its excludes the static palm collides with its own children and the solver
/// explodes: if this stops being so, the excludes are no longer tested by anything.
#[test]
fn palm_excludes_are_what_keeps_the_hand_together() {
    let r = builtin("shadow_hand");
    let without: String =
        r.mjcf().lines().filter(|l| !l.contains("<exclude body1=\"palm\"")).collect();
    assert_ne!(without.len(), r.mjcf().len());
    let mut d = Data::new(&Arc::new(Model::from_xml(&without).unwrap())).unwrap();
    d.forward().unwrap();
    assert!(d.contacts().count() > 0, "the palm touches its children");
    let survived = (0..20).all(|_| d.step(SUBSTEPS).is_ok());
    assert!(!survived, "one second at zero control ought to blow up");
    let mut d = Data::new(r.model()).unwrap();
    d.forward().unwrap();
    assert_eq!(d.contacts().count(), 0);
}

#[test]
fn what_is_drawn_weighs_nothing_and_changes_no_bit() {
    for id in Robot::builtin_ids() {
        let r = builtin(id);
        let scene = r.scene_model().unwrap();
        assert!(scene.ngeom() > 3 * r.model().ngeom(), "{id} has nothing to look at");
        assert_eq!(scene.body_mass(), r.model().body_mass(), "{id}");
        assert_eq!(scene.body_inertia(), r.model().body_inertia(), "{id}");
        let run = |m: &Arc<Model>| {
            let mut d = Data::new(m).unwrap();
            for step in 0..60 {
                let mut rng = Rng::new(3, Stream::Test, step);
                let action: Vec<f64> = (0..r.action_dim()).map(|_| rng.range(-1.0, 1.0)).collect();
                r.apply_action(&mut d, &action).unwrap();
                d.step(SUBSTEPS).unwrap();
            }
            d.qpos().iter().map(|v| v.to_bits()).collect::<Vec<_>>()
        };
        assert_eq!(run(scene), run(r.model()), "{id}");
    }
}

#[test]
fn profiles_say_what_the_model_implies() {
    for id in Robot::builtin_ids() {
        let r = builtin(id);
        let derived = derive(r.model(), id, "test".as_ref()).unwrap();
        let p = r.profile();
        assert_eq!(p.joints, derived.joints, "{id}");
        assert_eq!(p.actuators, derived.actuators, "{id}");
        assert_eq!(p.couplings, derived.couplings, "{id}");
        for g in &derived.groups {
            let same = p.groups.iter().find(|o| o.name == g.name);
            assert!(same.is_none_or(|o| o.joints == g.joints), "{id} {}", g.name);
        }
        let sites: Vec<_> = derived.ik_sites.iter().filter(|s| *s != "palm").collect();
        assert_eq!(p.ik_sites.iter().collect::<Vec<_>>(), sites, "{id}");
    }
    let hand = builtin("shadow_hand");
    let limbs = derive(hand.model(), "x", "test".as_ref()).unwrap().groups;
    let names: Vec<_> = limbs.iter().map(|g| g.name.as_str()).collect();
    assert_eq!(names, ["FF", "MF", "RF", "LF", "TH"]);
}

#[test]
fn actions_scale_clamp_and_refuse_nan() {
    let r = builtin("ur5e");
    let mut d = Data::new(r.model()).unwrap();
    r.apply_action(&mut d, &[0.5, -2.0, 1.0, 0.25, 0.0]).unwrap();
    assert_eq!(d.ctrl(), [75.0, -150.0, 150.0, 7.0, 0.0]);
    assert_eq!(r.action_of(d.ctrl()).unwrap(), [0.5, -1.0, 1.0, 0.25, 0.0]);
    assert!(r.apply_action(&mut d, &[f64::NAN, 0.0, 0.0, 0.0, 0.0]).is_err());
    assert!(r.apply_action(&mut d, &[0.0; 4]).is_err());
    assert_eq!(d.ctrl(), [75.0, -150.0, 150.0, 7.0, 0.0], "a refused action changes nothing");
    assert!(r.write_state(&mut d, &[f64::INFINITY, 0.0, 0.0, 0.0, 0.0]).is_err());
    assert_eq!(r.near_limits(&[6.25, 0.0, -3.1, 0.0, 0.0]), [0, 2]);
}

#[test]
fn a_folder_is_a_robot_and_its_mistakes_have_places() {
    let xml = r#"<mujoco><compiler angle="radian"/><worldbody><body name="b"><joint name="j" type="hinge" range="-1 1" limited="true"/>
      <geom size=".1"/></body></worldbody><actuator><motor name="m" joint="j" ctrlrange="-2 2" ctrllimited="true"/></actuator></mujoco>"#;
    let ran =
        robert().file("bot/robot.xml", xml).args(["robots", "show", "bot", "--json"]).succeeds();
    let v = ran.json();
    assert_eq!((v["id"].as_str(), v["state_dim"].as_u64()), (Some("bot"), Some(1)));
    assert_eq!(v["joints"][0]["range"][1].as_f64(), Some(1.0));

    let wrong = |profile: &str, needle: &str| {
        let ran = robert()
            .file("bot/robot.xml", xml)
            .file("bot/profile.toml", profile)
            .args(["robots", "show", "bot"])
            .fails(3);
        assert!(ran.stderr.contains(needle), "{needle}: {}", ran.stderr);
    };
    let head = "format = \"robert-robot/1\"\n";
    wrong("format = \"robert-robot/2\"", "profile.toml:1:1");
    wrong(&format!("{head}speed = 3\n"), "profile.toml:2:1");
    wrong(&format!("{head}joints = [{{ name = \"k\" }}]"), "\"j\"");
    wrong(&format!("{head}[poses]\nup = {{ j = 4.0 }}"), "outside -1 to 1");
    wrong(&format!("{head}home = \"up\""), "no such pose");
    wrong(&format!("{head}model = \"../robot.xml\""), "must be a file of this folder");
    wrong(&format!("{head}[physics.damping]\nk = 1.0"), "\"k\"");
    wrong(&format!("{head}[mirror]\n"), "mirror needs a table");
}

/// Two cranks and two rods that meet in one point; a motor on each crank.
const LINKAGE: &str = r#"<mujoco><compiler angle="radian" autolimits="true"/>
  <default><joint axis="0 1 0" damping=".2" armature=".01"/>
    <geom type="capsule" size=".012" contype="0" conaffinity="0" density="1500"/></default>
  <worldbody>
    <body pos="-.1 0 .5"><joint name="a" range="-1 1"/><geom fromto="0 0 0 -.15 0 -.2"/>
      <body name="left" pos="-.15 0 -.2"><joint name="b" range="-2 2"/><geom fromto="0 0 0 .25 0 -.25"/></body></body>
    <body pos=".1 0 .5"><joint name="c" range="-1 1"/><geom fromto="0 0 0 .15 0 -.2"/>
      <body name="right" pos=".15 0 -.2"><joint name="d" range="-2 2"/><geom fromto="0 0 0 -.25 0 -.25"/></body></body>
  </worldbody>
  <equality><connect body1="left" body2="right" anchor=".25 0 -.25"/></equality>
  <actuator><motor joint="a" ctrlrange="-8 8"/><motor joint="c" ctrlrange="-8 8"/></actuator>
</mujoco>"#;

#[test]
fn the_motors_of_a_linkage_carry_the_rods_without_motors() {
    let ran = robert().file("m.xml", LINKAGE).args(["import", "m.xml", "--out", "bot"]).succeeds();
    let robot = Arc::new(Robot::from_folder(&ran.path("bot")).unwrap());
    let home = robot.home();
    let mut data = Data::new(robot.model()).unwrap();
    robot.write_state(&mut data, &home).unwrap();
    let held = Gravity::of(&robot).unwrap().unwrap().at(data.qpos()).unwrap().to_vec();
    let of = |name: &str| held[robot.joints()[robot.joint_index(name).unwrap()].dofadr];
    // The weight of the rods alone would ask for .194 of each motor.
    assert!((of("a") - 0.748).abs() < 1e-3 && (of("c") + 0.748).abs() < 1e-3, "{held:?}");
    let before = robot.state(&data);
    data.set_qfrc_applied(&held).unwrap();
    data.step(200).unwrap();
    let moved = robot.state(&data).into_iter().zip(&before).map(|(a, b)| (a - b).abs());
    assert!(moved.fold(0.0, f64::max) < 2e-3, "the constraint itself is soft");
    assert!(robot.settle(&home).unwrap().within);

    // It stands still, whatever law holds it.
    let key = r#"{"format": "robert-clip/1", "fps": 20, "length": 41, "robot": {"id": "bot",
        "joints": ["a", "b", "c", "d"], "units": ["rad", "rad", "rad", "rad"]},
        "keys": [{"frame": 0, "hold": 41, "q": [0, 0, 0, 0]}]}"#;
    std::fs::write(ran.path("still.clip.json"), key).unwrap();
    for policy in ["pd", "computed-torque"] {
        let args = ["rollout", "still.clip.json", "--robot", "bot", "--policy", policy, "--json"];
        let (code, stdout, stderr) = call(ran.dir.path(), &args);
        assert_eq!(code, 0, "{stderr}");
        let report: serde_json::Value = serde_json::from_str(&stdout).unwrap();
        assert!(report["precision"].as_f64().unwrap() < 1e-3, "{policy}: {stdout}");
    }
}

/// An arm on a servo that its damping lets swing for long.
const SWINGING: &str = r#"<mujoco><compiler angle="radian" autolimits="true"/>
  <worldbody><body><joint name="a" axis="0 0 1" range="-2 2" damping=".5" armature=".05"/>
    <geom type="capsule" fromto="0 0 0 .8 0 0" size=".03" mass="4"/></body></worldbody>
  <actuator><position joint="a" kp="300" ctrlrange="-2 2" forcerange="-60 60"/></actuator>
</mujoco>"#;

#[test]
fn a_servo_that_swings_settles_where_it_is_sent() {
    let ran = robert()
        .file("m.xml", SWINGING)
        .args(["import", "m.xml", "--drives", "file", "--out", "bot"])
        .succeeds();
    let robot = Robot::from_folder(&ran.path("bot")).unwrap();
    let settled = robot.settle(&[-0.8]).unwrap();
    assert!(settled.worst < 1e-3 && settled.speed < 1e-2, "{settled:?}");
}
