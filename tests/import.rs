//! Foreign models become folders that every command takes: checked against the
//! simulator's own reading of the same source.

use std::path::Path;
use std::sync::Arc;

use robert::clip::{Clip, Fill, Goal, Key, Reach, RobotRef, compile_for};
use robert::mujoco::{Data, Kind, Model};
use robert::robot::import::{ImportConfig, mark, mark_in};
use robert::robot::{Coupling, IkConfig, Point, Robot, Target};
use robert::rollout::ClipFacts as _;

use crate::run::{Ran, binary, call, robert};

/// A tetrahedron as binary STL, and as Wavefront OBJ.
fn tetrahedron_stl() -> Vec<u8> {
    let p: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]];
    let mut out = vec![0_u8; 80];
    out.extend(4_u32.to_le_bytes());
    for face in [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] {
        out.extend([0_u8; 12]);
        for v in face {
            p[v].iter().for_each(|c| out.extend(c.to_le_bytes()));
        }
        out.extend([0_u8; 2]);
    }
    out
}

const TETRAHEDRON_OBJ: &str =
    "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

/// Two moving fingers on an arm, one mimicking the other, fixed links in between, tilted
/// frames, a package mesh, a transmission.
const GRIPPER: &str = r#"<?xml version="1.0"?>
<robot name="gripper">
  <material name="steel"><color rgba=".5 .5 .6 1"/></material>
  <link name="base"><inertial><mass value="2"/><inertia ixx=".1" iyy=".2" izz=".25" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><box size=".2 .2 .1"/></geometry></collision></link>
  <link name="arm">
    <inertial><origin xyz=".1 .02 .3" rpy=".3 -.2 .9"/><mass value="1.5"/>
      <inertia ixx=".03" iyy=".04" izz=".02" ixy=".003" ixz="-.002" iyz=".001"/></inertial>
    <visual><origin xyz="0 0 .1" rpy="0 .1 0"/><geometry><mesh filename="package://gripper_description/meshes/Arm.STL" scale="2 2 2"/></geometry><material name="steel"/></visual>
    <collision><origin xyz="0 0 .2"/><geometry><cylinder radius=".05" length=".4"/></geometry></collision></link>
  <link name="flange"/>
  <link name="left"><inertial><mass value=".1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><sphere radius=".02"/></geometry></collision></link>
  <link name="right"><inertial><mass value=".1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="package://gripper_description/meshes/pretty.dxf"/></geometry></visual>
    <collision><geometry><sphere radius=".02"/></geometry></collision></link>
  <joint name="turn" type="continuous"><origin xyz="0 0 .05" rpy="0 0 .4"/><parent link="base"/><child link="arm"/>
    <axis xyz="0 .6 .8"/><limit effort="30" velocity="2"/><dynamics damping=".7" friction=".2"/></joint>
  <joint name="mount" type="fixed"><origin xyz="0 .1 .4" rpy="1.1 .2 -.3"/><parent link="arm"/><child link="flange"/></joint>
  <joint name="grip" type="prismatic"><origin xyz=".06 0 .1"/><parent link="flange"/><child link="left"/>
    <axis xyz="1 0 0"/><limit lower="0" upper=".04" effort="8" velocity=".1"/></joint>
  <joint name="grip2" type="prismatic"><origin xyz="-.06 0 .1" rpy="0 0 3.1"/><parent link="flange"/><child link="right"/>
    <axis xyz="1 0 0"/><limit lower="0" upper=".05" effort="8" velocity=".1"/><mimic joint="grip" multiplier="1.2" offset=".001"/></joint>
  <transmission name="t"/>
</robot>"#;

fn import_gripper(more: &[&str]) -> Ran {
    robert()
        .file("ws/gripper_description/urdf/gripper.urdf", GRIPPER)
        .file("ws/gripper_description/meshes/Arm.STL", tetrahedron_stl())
        .args(["import", "ws/gripper_description/urdf/gripper.urdf", "--out", "bot", "--json"])
        .args(["--package", "gripper_description=ws/gripper_description"])
        .args(more)
        .succeeds()
}

#[test]
fn packages_around_the_file_are_found() {
    let import = |folder: &str, urdf: &str| {
        robert()
            .file(&format!("{folder}/urdf/gripper.urdf"), urdf)
            .file(&format!("{folder}/meshes/Arm.STL"), tetrahedron_stl())
            .file(&format!("{folder}/meshes/pretty.dxf"), "not a mesh")
            .args(["import", &format!("{folder}/urdf/gripper.urdf"), "--out", "bot", "--json"])
    };
    for folder in ["ws/gripper_description", "ws/called_otherwise"] {
        let v = import(folder, GRIPPER).succeeds().json();
        let line = "package \"gripper_description\" is the folder ";
        let assumed = notes(&v, "assumed");
        let found = assumed.lines().find(|l| l.starts_with(line)).unwrap();
        assert!(found.ends_with(folder), "{found}");
    }
    // A package cannot point outside itself.
    let astray = GRIPPER.replace("gripper_description/meshes", "gripper_description/../meshes");
    let ran = import("ws/gripper_description", &astray).fails(3);
    assert!(ran.stderr.contains("--package gripper_description="), "{}", ran.stderr);
}

#[test]
fn limits_that_say_nothing_are_taken_as_such() {
    let urdf = GRIPPER.replace(
        "<limit effort=\"30\" velocity=\"2\"/><dynamics damping=\".7\" friction=\".2\"/>",
        "<limit lower=\"-1e16\" upper=\"1e16\" effort=\"-1\" velocity=\"111\"/>",
    );
    assert_ne!(urdf, GRIPPER);
    let import = |urdf: &str| {
        let more = ["--without-meshes", "--effort", "4000", "--json"];
        let call = robert().file("g.urdf", urdf).args(["import", "g.urdf", "--out", "bot"]);
        notes(&call.args(more).succeeds().json(), "assumed")
    };
    // A wheel may be fast, and its motor is given by hand.
    let assumed = import(&urdf);
    assert!(assumed.contains("spent at 20.000, the file allows 111"), "{assumed}");
    let stopped = urdf.replace("type=\"continuous\"", "type=\"revolute\"").replace("1e16", "1");
    let assumed = import(&stopped);
    assert!(assumed.contains("because 111 in the file is a placeholder"), "{assumed}");
    let said = robert()
        .file("g.urdf", urdf.replace("effort=\"-1\"", "effort=\"-2\""))
        .args(["import", "g.urdf", "--out", "bot", "--without-meshes"])
        .fails(3)
        .stderr;
    assert!(said.contains("joint \"turn\": effort -2 is negative"), "{said}");
}

#[test]
fn stops_that_fight_a_mimic_give_way() {
    let turned = GRIPPER.replace("multiplier=\"1.2\"", "multiplier=\"-1.2\"");
    let ran = robert()
        .file("ws/g/urdf/g.urdf", turned)
        .file("ws/g/meshes/Arm.STL", tetrahedron_stl())
        .args(["import", "ws/g/urdf/g.urdf", "--out", "bot", "--json"])
        .args(["--package", "gripper_description=ws/g"])
        .succeeds();
    let changed = notes(&ran.json(), "changed");
    let expected = "joint \"grip2\" stops at -0.047 and 0.05 instead of 0 and 0.05";
    assert!(changed.contains(expected), "{changed}");
    let robot = Robot::from_folder(&ran.path("bot")).unwrap();
    let follower = robot.joints().iter().find(|j| j.name == "grip2").unwrap();
    assert_eq!(follower.range, [-0.047, 0.05]);
    let changed = notes(&import_gripper(&[]).json(), "changed");
    assert!(!changed.contains("stops at"), "{changed}");
}

#[test]
fn limits_that_no_joint_needs_are_called_placeholders() {
    let warned = |effort: &str| {
        let urdf = GRIPPER.replace("effort=\"30\"", &format!("effort=\"{effort}\""));
        let ran = robert()
            .file("ws/g/urdf/g.urdf", urdf)
            .file("ws/g/meshes/Arm.STL", tetrahedron_stl())
            .args(["import", "ws/g/urdf/g.urdf", "--out", "bot", "--json"])
            .args(["--package", "gripper_description=ws/g"])
            .succeeds();
        notes(&ran.json(), "warnings")
    };
    let said = warned("10000");
    assert!(
        said.contains(
            "the motors of 1 of 2 joints with a torque limit have far more than the force"
        ),
        "{said}"
    );
    assert!(said.contains("\"turn\" has 10000 for "), "{said}");
    assert!(!warned("100").contains("placeholders"));
}

#[test]
fn motors_without_an_effort_are_sized_for_what_they_carry_and_turn() {
    // A beam of 40 kg, 2 m long: about a vertical axis it has inertia and no weight, about the
    // level one both.
    let beam = r#"<inertial><origin xyz="1 0 0"/><mass value="40"/>
        <inertia ixx="13" iyy="13" izz="13" ixy="0" ixz="0" iyz="0"/></inertial>"#;
    let link = |name: &str, inner: &str| format!("<link name=\"{name}\">{inner}</link>");
    let joint = |name: &str, parent: &str, child: &str, axis: &str| {
        format!(
            "<joint name=\"{name}\" type=\"revolute\"><parent link=\"{parent}\"/>\
             <child link=\"{child}\"/><axis xyz=\"{axis}\"/>\
             <limit lower=\"-0.1\" upper=\"0.1\" velocity=\"2\"/></joint>"
        )
    };
    let light = r#"<inertial><mass value="1"/>
        <inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>"#;
    let urdf = ["<robot name=\"crane\">".to_owned()]
        .into_iter()
        .chain([link("base", ""), link("column", light), link("boom", beam)])
        .chain([joint("turn", "base", "column", "0 0 1"), joint("lift", "column", "boom", "0 1 0")])
        .chain(["</robot>".to_owned()])
        .collect::<String>();
    let v = robert()
        .file("crane.urdf", urdf)
        .args(["import", "crane.urdf", "--out", "crane", "--json"])
        .succeeds()
        .json();
    let assumed = notes(&v, "assumed");
    let sized = |name: &str| -> f64 {
        let line = assumed.lines().find(|l| l.starts_with(&format!("joint \"{name}\""))).unwrap();
        let number = line.split("+-").nth(1).unwrap().split(',').next().unwrap();
        number.parse().unwrap()
    };
    // 5 rad/s^2 times 13 + 40 kg m^2, and 2.5 times 40 kg at 1 m.
    assert!((265.0..275.0).contains(&sized("turn")), "{assumed}");
    assert!((975.0..985.0).contains(&sized("lift")), "{assumed}");
}

fn notes(v: &serde_json::Value, key: &str) -> String {
    v[key].as_array().unwrap().iter().map(|s| s.as_str().unwrap()).collect::<Vec<_>>().join("\n")
}

#[test]
fn a_urdf_becomes_a_robot_with_everything_told() {
    let ran = import_gripper(&[]);
    let v = ran.json();
    assert_eq!((v["state_dim"].as_u64(), v["action_dim"].as_u64()), (Some(3), Some(2)));
    assert_eq!(v["files"].as_u64(), Some(1));
    assert!((v["mass_kg"].as_f64().unwrap() - 3.7).abs() < 1e-9);
    let (dropped, assumed, changed) =
        (notes(&v, "dropped"), notes(&v, "assumed"), notes(&v, "changed"));
    assert!(dropped.contains("pretty.dxf") && dropped.contains("<transmission>"), "{dropped}");
    assert!(assumed.contains("base - arm") && assumed.contains("armature 0.01"), "{assumed}");
    assert!(changed.contains("\"grip2\" follows \"grip\""), "{changed}");

    let robot = Robot::from_folder(&ran.path("bot")).unwrap();
    let joints: Vec<_> = robot.joints().iter().map(|j| (j.name.as_str(), j.speed_limit)).collect();
    let names: Vec<_> = joints.iter().map(|j| j.0).collect();
    assert_eq!(names, ["turn", "grip", "grip2"]);
    // Speeds are measured; gravity and friction take their share of what the URDF allows.
    for ((name, measured), allowed) in joints.iter().zip([2.0, 0.1, 0.1]) {
        assert!(*measured <= allowed && *measured > 0.7 * allowed, "{name}: {measured}");
    }
    let motors: Vec<_> =
        robot.actuators().iter().map(|a| (a.name.as_str(), a.ctrlrange[1])).collect();
    assert_eq!(motors, [("turn", 30.0), ("grip", 8.0)]);
    assert!(robot.joints()[0].unbounded);
    assert_eq!(robot.joints()[1].range, [0.0, 0.04]);
    let m = robot.model();
    // 30 N m are spent at 2 rad/s: the drive that the URDF leaves out.
    let turn = |m: &Model| (m.dof_damping()[0], m.dof_frictionloss()[0], m.dof_armature()[0]);
    assert_eq!(turn(m), (15.0, 0.2, 0.09));
    assert!(assumed.contains("turn: armature 0.09, damping 15"), "{assumed}");
    let word = import_gripper(&["--drives", "file"]);
    let plain = Robot::from_folder(&word.path("bot")).unwrap();
    assert_eq!(turn(plain.model()), (0.7, 0.2, 0.01));
    assert_eq!(
        robot.profile().couplings,
        [Coupling::Mimic {
            follower: "grip2".into(),
            leader: "grip".into(),
            offset: 0.001,
            multiplier: 1.2
        }]
    );
    assert!(robot.scene_model().unwrap().ngeom() > m.ngeom(), "the mesh is only looked at");

    // The follower follows in simulation.
    let mut d = Data::new(m).unwrap();
    robot.apply_action(&mut d, &[0.0, 0.5]).unwrap();
    d.step(400).unwrap();
    let q = robot.state(&d);
    assert!(q[1] > 0.03 && (q[2] - 0.001 - 1.2 * q[1]).abs() < 2e-3, "{q:?}");
}

#[test]
fn a_urdf_moves_as_in_the_simulators_own_reading() {
    let ran = import_gripper(&[]);
    let robot = Robot::from_folder(&ran.path("bot")).unwrap();
    let plain = GRIPPER
        .replace(
            "<robot name=\"gripper\">",
            "<robot name=\"gripper\"><mujoco><compiler fusestatic=\"false\"/></mujoco>",
        )
        .replace("package://gripper_description/meshes/pretty.dxf", "none.stl");
    let own = Arc::new(Model::from_xml(&plain).unwrap());
    let ours = robot.model();
    assert_eq!((own.nq(), own.nbody()), (ours.nq(), ours.nbody()));
    for (name, a, b) in [
        ("mass", own.body_mass(), ours.body_mass()),
        ("ipos", own.body_ipos(), ours.body_ipos()),
        ("inertia", own.body_inertia(), ours.body_inertia()),
        ("range", own.jnt_range(), ours.jnt_range()),
    ] {
        close(a, b, name);
    }
    let (mut x, mut y) = (Data::new(&own).unwrap(), Data::new(ours).unwrap());
    for q in [[0.0, 0.0, 0.0], [1.2, 0.03, 0.01], [-2.9, 0.01, 0.05]] {
        x.set_qpos(&q).unwrap();
        y.set_qpos(&q).unwrap();
        x.kinematics().unwrap();
        y.kinematics().unwrap();
        close(x.xpos(), y.xpos(), "xpos");
        close(x.xmat(), y.xmat(), "xmat");
        close(x.xipos(), y.xipos(), "xipos");
    }
}

fn close(a: &[f64], b: &[f64], what: &str) {
    assert_eq!(a.len(), b.len(), "{what}");
    for (i, (x, y)) in a.iter().zip(b).enumerate() {
        assert!((x - y).abs() < 1e-9, "{what}[{i}]: {x} and {y}");
    }
}

/// A leg with servos in a file that includes another and reads meshes from beside it.
fn import_leg(extra: &[&str]) -> crate::run::Robert {
    let main = r#"<mujoco model="leg">
  <compiler angle="radian" meshdir="../meshes"/>
  <option timestep="0.001" integrator="implicitfast" ls_iterations="9"/>
  <include file="parts/assets.xml"/>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body name="hip" pos="0 0 1"><geom type="box" size=".1 .1 .1"/>
      <body pos="0 0 -.12"><joint name="hip" axis="0 1 0" range="-1 1"/><geom type="mesh" mesh="Bone"/><geom size=".04"/>
        <body name="shank" pos="0 0 -.3"><joint axis="0 1 0" range="0 2"/><geom type="mesh" mesh="foot"/></body></body></body>
  </worldbody>
  <actuator><position name="hip" joint="hip" kp="50" kv="2" forcerange="-40 40" ctrlrange="-1 1"/></actuator>
  <sensor><jointpos joint="hip"/></sensor>
  <sensor><jointvel joint="hip"/></sensor>
</mujoco>"#;
    let mut args = vec!["import", "leg/xml/leg.xml", "--out", "bot", "--json"];
    args.extend(extra);
    robert()
        .file("leg/xml/leg.xml", main)
        .file("leg/xml/parts/assets.xml", "<mujoco><asset><mesh file=\"Bone.STL\"/><mesh name=\"foot\" file=\"sub/bone.stl\" scale=\"2 2 2\"/></asset></mujoco>")
        .file("leg/meshes/Bone.STL", tetrahedron_stl())
        .file("leg/meshes/sub/bone.stl", tetrahedron_stl())
        .args(args)
}

#[test]
fn an_mjcf_with_includes_and_meshes_becomes_a_folder() {
    let refused = import_leg(&[]).fails(3);
    assert!(refused.stderr.contains("--root"), "{}", refused.stderr);

    let kept = import_leg(&["--root", "leg"]).succeeds();
    let robot = Robot::from_folder(&kept.path("bot")).unwrap();
    let servo = &robot.actuators()[0];
    assert_eq!((servo.ctrlrange, servo.is_motor), ([-1.0, 1.0], false));
    // 2.2.2 does not know kv; the servo has it all the same.
    assert_eq!(servo.law.unwrap().bias, [0.0, -50.0, -2.0]);
    assert_eq!(robot.model().actuator_forcerange(), [-40.0, 40.0]);

    let ran = import_leg(&["--root", "leg", "--actuators", "torque"]).succeeds();
    let v = ran.json();
    assert_eq!(
        (v["state_dim"].as_u64(), v["action_dim"].as_u64(), v["files"].as_u64()),
        (Some(2), Some(1), Some(2))
    );
    let changed = notes(&v, "changed");
    assert!(changed.contains("servo \"hip\" became a motor of -40 to 40"), "{changed}");
    assert!(changed.contains("1 nameless joints"), "{changed}");
    let dropped = notes(&v, "dropped");
    assert!(dropped.contains("option/ls_iterations"));
    assert_eq!(dropped.matches("sensors:").count(), 1, "{dropped}");
    let robot = Robot::from_folder(&ran.path("bot")).unwrap();
    assert_eq!(robot.actuators()[0].ctrlrange, [-40.0, 40.0]);
    let m = robot.model();
    assert_eq!((m.timestep(), m.integrator(), m.cone()), (0.005, 0, 0));
    assert_eq!(robot.joints()[0].range, [-1.0, 1.0], "a range is a limit");
    // "hip" is fixed: its child starts inside it and must be left alone.
    let mut d = Data::new(m).unwrap();
    d.forward().unwrap();
    assert_eq!(d.contacts().count(), 0);
    // Meshes of equal names from two folders stay apart.
    let scaled = m.id(Kind::Mesh, "foot").unwrap();
    assert!(m.id(Kind::Mesh, "Bone").is_some_and(|b| b != scaled));
    assert!(ran.path("bot/assets/bone_2.stl").is_file() && ran.path("bot/import.json").is_file());
    // The folder stands alone: what it was made of may go.
    std::fs::remove_dir_all(ran.path("leg")).unwrap();
    Robot::from_folder(&ran.path("bot")).unwrap().settle(&[0.2, 0.3]).unwrap();
}

/// An arm on a table in the words of `MuJoCo` 3, with loose things about.
const SCENE: &str = r#"<mujoco model="scene">
  <compiler angle="radian"/><option integrator="implicitfast"/>
  <default><position kp="30" dampratio="1"/><default class="arm"><joint damping="1" actuatorfrcrange="-9 9"/></default></default>
  <worldbody>
    <camera name="eye" pos="0 -1 1" resolution="640 480" mode="targetbody" target="upper"/>
    <frame pos="0 0 .5" childclass="arm">
      <body name="upper"><joint name="a" axis="0 1 0" range="-1 1"/><geom name="beam" type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass="1"/>
        <body name="lower" pos=".3 0 0"><joint name="b" axis="0 1 0" range="-2 2"/><geom type="capsule" fromto="0 0 0 .2 0 0" size=".02" mass=".3"/>
          <replicate count="3" offset="0 .01 0"><site name="tip" pos=".2 0 0"/></replicate></body></body>
    </frame>
    <body name="cube" pos="1 0 .1"><freejoint/><geom name="cube" type="box" size=".02 .02 .02"/></body>
    <body name="ball" pos="1 1 .1"><joint name="fly" type="free"/><geom size=".02"/></body>
  </worldbody>
  <contact><pair geom1="beam" geom2="cube"/></contact>
  <actuator><position name="a" joint="a" inheritrange="1"/><position name="b" joint="b" kv=".2" forcerange="-5 20"/></actuator>
  <keyframe><key qpos="0 0 1 0 .1 1 0 0 0 1 1 .1 1 0 0 0"/></keyframe>
</mujoco>"#;

#[test]
fn a_scene_of_today_is_taken_in_without_its_loose_things() {
    let import = |more: &[&str]| {
        robert().file("s.xml", SCENE).args(["import", "s.xml", "--out", "bot", "--json"]).args(more)
    };
    let refused = import(&[]).fails(3).stderr;
    assert!(
        refused.contains("s.xml:11:") && refused.contains("--without cube --without ball;"),
        "{refused}"
    );
    let wrong = import(&["--without", "cup"]).fails(3).stderr;
    assert!(wrong.contains("upper") && wrong.contains("cube"), "{wrong}");

    let ran = import(&["--without", "cube,ball"]).succeeds();
    let v = ran.json();
    assert_eq!((v["state_dim"].as_u64(), v["action_dim"].as_u64()), (Some(2), Some(2)));
    let dropped = notes(&v, "dropped");
    assert!(dropped.contains("camera/resolution") && dropped.contains("\"cube\""), "{dropped}");
    let robot = Robot::from_folder(&ran.path("bot")).unwrap();
    let m = robot.model();
    // Range from the joint, force limit from the joint, damping of a critically damped servo.
    assert_eq!(robot.actuators()[0].ctrlrange, [-1.0, 1.0]);
    assert_eq!(m.actuator_forcerange(), [-9.0, 9.0, -5.0, 9.0]);
    let damping = [0, 1].map(|a| -robot.actuators()[a].law.unwrap().bias[2]);
    let critical = 2.0 * (30.0 * m.dof_M0()[0]).sqrt();
    assert!((damping[0] / critical - 1.0).abs() < 1e-6 && damping[1] == 0.2, "{damping:?}");
    let upper = m.id(Kind::Body, "upper").unwrap();
    let mut d = Data::new(m).unwrap();
    d.kinematics().unwrap();
    assert_eq!(d.xpos()[3 * upper + 2], 0.5);
    assert!(m.id(Kind::Site, "tip2").is_some());
    // The servos hold a pose that is asked for.
    assert!(robot.settle(&[0.3, -0.5]).unwrap().worst < 0.02);
}

/// A base on two slides with servos, as of a mobile robot, and a turret with a motor.
const CART: &str = r#"<mujoco><worldbody><body name="cart" pos="0 0 .1">
    <joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
    <geom type="box" size=".1 .1 .1" mass="3"/>
    <body name="turret" pos="0 0 .2"><joint name="turn" axis="0 0 1" armature=".1"/><geom type="box" size=".05 .02 .02" mass="1"/></body>
  </body></worldbody>
  <actuator><position joint="x" kp="900" kv="90"/><position joint="y" kp="900" kv="90" gear="2" ctrlrange="-4 4"/><motor joint="turn" ctrlrange="-1 1"/></actuator></mujoco>"#;

#[test]
fn slides_of_servos_end_where_the_servo_does() {
    let ran = robert().file("m.xml", CART).args(["import", "m.xml", "--out", "bot", "--json"]);
    let ran = ran.succeeds();
    assert!(notes(&ran.json(), "changed").contains("slide \"y\" ends where its servo does"));
    let bot = Robot::from_folder(&ran.path("bot")).unwrap();
    let ranges = [0, 1].map(|j| (bot.joints()[j].unbounded, bot.joints()[j].range));
    let pi = std::f64::consts::PI;
    assert_eq!(ranges, [(false, [-pi, pi]), (false, [-2.0, 2.0])]);
    assert!(bot.joints()[2].unbounded && bot.drives_undamped_joints());
    let damped = CART.replace("armature", "damping=\".2\" armature");
    let ran = robert().file("m.xml", damped).args(["import", "m.xml", "--out", "bot"]).succeeds();
    assert!(!Robot::from_folder(&ran.path("bot")).unwrap().drives_undamped_joints());
    // With motors in the place of its servos a slide stays endless.
    let ran = robert().file("m.xml", CART).args([
        "import",
        "m.xml",
        "--actuators",
        "torque",
        "--out",
        "bot",
    ]);
    let ran = ran.succeeds();
    assert!(Robot::from_folder(&ran.path("bot")).unwrap().joints()[0].unbounded);
}

#[test]
fn new_goes_on_only_with_the_model_that_the_folder_was_made_from() {
    let ran = robert().file("m.xml", CART).args(["import", "m.xml", "--out", "bot"]).succeeds();
    let dir = ran.dir.path();
    // Whether the model of these options is the folder's.
    let same = |change: fn(&mut ImportConfig)| {
        let mut config = ImportConfig::new(dir.join("m.xml"), dir.join("bot"), binary());
        change(&mut config);
        mark_in(&dir.join("bot")).unwrap() == Some(mark(&config).unwrap())
    };
    assert!(same(|_| ()));
    assert!(!same(|c| c.effort = Some(3.0)));
    let refused = |file: &str, more: &[&str]| {
        let (code, _, stderr) = call(dir, &[&["new", file, "--out", "bot"], more].concat());
        assert_eq!(code, 3, "{stderr}");
        stderr
    };
    assert!(refused("m.xml", &["--fixed-base"]).contains("robert new bot --out bot"));
    assert!(refused("gone.xml", &[]).contains("gone.xml"));
    // What is there stays as it was imported.
    let (code, _, stderr) =
        call(dir, &["new", "bot", "--out", "bot", "--drives", "file", "--minutes", "0"]);
    assert_eq!((code, stderr.contains("imported already")), (2, true), "{stderr}");
    std::fs::write(dir.join("m.xml"), CART.replace("armature", "damping=\".2\" armature")).unwrap();
    assert!(refused("m.xml", &[]).contains("another model"));
    assert!(!same(|_| ()));
}

#[test]
fn a_shoulder_that_hardly_lifts_its_arm_is_pointed_at() {
    let slow = |effort: u32| {
        let arm = format!(
            r#"<robot name="p"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 1"/><mass value="5"/>
            <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
            <joint name="shoulder" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
            <limit effort="{effort}" lower="-2.3" upper="2.3" velocity="3"/></joint></robot>"#
        );
        let ran = robert().file("m.urdf", arm);
        let ran = ran.args(["import", "m.urdf", "--out", "bot", "--json"]).succeeds();
        notes(&ran.json(), "warnings").contains("a small part of the speed")
    };
    assert!(slow(34) && !slow(200));
}

#[test]
fn figures_in_the_other_unit_of_angles_are_pointed_at() {
    let warned = |text: &str| {
        let ran = robert().file("m.xml", text).args(["import", "m.xml", "--out", "bot", "--json"]);
        notes(&ran.succeeds().json(), "warnings")
    };
    let arm = |compiler: &str, range: &str, servo: &str| {
        format!(
            r#"<mujoco>{compiler}<worldbody><body><joint name="a" axis="0 0 1" limited="true" range="{range}" damping="1" armature=".1"/>
            <geom type="capsule" fromto="0 0 0 .3 0 0" size=".03"/></body></worldbody>
            <actuator><position joint="a" kp="20" ctrllimited="true" ctrlrange="{servo}"/></actuator></mujoco>"#
        )
    };
    let radian = "<compiler angle=\"radian\"/>";
    assert_eq!(warned(&arm(radian, "-1.2 1.2", "-1.2 1.2")), "");
    assert_eq!(warned(&arm("", "-70 70", "-1.2 1.2")), "");
    assert!(warned(&arm("", "-1.2 1.2", "-1.2 1.2")).contains("degrees unless"));
    assert!(warned(&arm(radian, "-70 70", "-1.2 1.2")).contains("\"a\" -70.0000 to 70.0000 rad"));
    assert!(warned(&arm("", "-70 70", "-70 70")).contains("control ranges are in radians"));
}

#[test]
fn actuators_with_dynamics_go_last_and_have_their_own_strength() {
    let text = r#"<mujoco><worldbody><body><joint name="a" axis="0 0 1"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".03"/>
        <body pos=".3 0 0"><joint name="b" axis="0 0 1"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".03"/></body></body></worldbody>
        <actuator><cylinder name="c" joint="a" timeconst=".05" area=".5" ctrllimited="true" ctrlrange="-30 40"/>
        <muscle name="m" joint="b" force="25"/><motor name="t" joint="b" ctrllimited="true" ctrlrange="-3 3"/></actuator></mujoco>"#;
    let ran =
        robert().file("m.xml", text).args(["import", "m.xml", "--out", "bot", "--json"]).succeeds();
    let changed = notes(&ran.json(), "changed");
    assert!(changed.contains("actuators with dynamics"), "{changed}");
    assert!(
        changed.contains("muscle, which only pulls, \"m\" became a motor of -25 to 25"),
        "{changed}"
    );
    let bot = Robot::from_folder(&ran.path("bot")).unwrap();
    let found: Vec<_> = bot.actuators().iter().map(|a| (a.name.as_str(), a.ctrlrange)).collect();
    assert_eq!(found, [("t", [-3.0, 3.0]), ("c", [-15.0, 20.0]), ("m", [-25.0, 25.0])]);
}

#[test]
fn nameless_actuators_of_one_joint_get_different_names_and_dampers_go() {
    let xml = "<mujoco><worldbody><body><joint name='j' axis='0 1 0' damping='1'/><geom size='.1' mass='1'/></body></worldbody>
        <actuator><motor joint='j' ctrlrange='-1 1' ctrllimited='true'/><damper joint='j' kv='5' ctrlrange='0 1'/>
        <general joint='j' dyntype='filter' dynprm='.05' gainprm='3' ctrlrange='-1 1' ctrllimited='true'/></actuator></mujoco>";
    let ran =
        robert().file("a.xml", xml).args(["import", "a.xml", "--out", "a", "--json"]).succeeds();
    let report: serde_json::Value = ran.json();
    assert_eq!(report["action_dim"], 2);
    assert!(notes(&report, "dropped").contains("a damper only brakes"), "{report}");
    let robot = Robot::from_folder(&ran.path("a")).unwrap();
    let names: Vec<&str> = robot.actuators().iter().map(|a| a.name.as_str()).collect();
    assert_eq!(names, ["j", "j_2"]);
}

#[test]
fn poses_of_a_base_that_is_held_stay() {
    let xml = "<mujoco><worldbody><body name='base' pos='0 0 1'><freejoint/><geom size='.1'/><body name='leg'>
        <joint name='hip' axis='0 1 0' range='-90 90' limited='true'/><geom size='.1' pos='0 0 -.3'/></body></body></worldbody>
        <actuator><motor joint='hip' ctrlrange='-9 9' ctrllimited='true'/></actuator>
        <keyframe><key name='stand' qpos='0 0 1 1 0 0 0 0'/><key name='crouch' qpos='0 0 .8 1 0 0 0 .7' qvel='0 0 0 0 0 0 0'/></keyframe></mujoco>";
    let ran = robert()
        .file("a.xml", xml)
        .args(["import", "a.xml", "--out", "a", "--fixed-base", "--json"])
        .succeeds();
    let robot = Robot::from_folder(&ran.path("a")).unwrap();
    assert_eq!((robot.home(), robot.pose("crouch").unwrap()), (vec![0.0], vec![0.7]));
    // With other numbers of coordinates it is unknown which are the base's.
    let odd = xml.replace("1 0 0 0 .7'", "1 0 0 .7'").replace("0 0 .8", "0 .8");
    let ran = robert()
        .file("a.xml", odd)
        .args(["import", "a.xml", "--out", "a", "--fixed-base", "--json"])
        .succeeds();
    assert!(notes(&ran.json(), "dropped").contains("keyframes"));
}

#[test]
fn a_stretched_leg_at_its_stop_bends() {
    // Two links in a line; the knee bends one way only, and its stop is where it is straight.
    let link = |name: &str, range: &str, inside: &str| {
        format!(
            "<body name='{name}' pos='0 0 -.4'><joint name='{name}' axis='0 1 0' range='{range}'/>\
             <geom type='capsule' fromto='0 0 0 0 0 -.4' size='.04'/>{inside}</body>"
        )
    };
    let knee = link("knee", "0 150", "<site name='sole' pos='0 0 -.4'/>");
    let motor =
        |j: &str| format!("<motor name='{j}' joint='{j}' ctrlrange='-99 99' ctrllimited='true'/>");
    let leg = format!(
        "<mujoco><compiler autolimits='true'/><worldbody>{}</worldbody><actuator>{}{}</actuator></mujoco>",
        link("hip", "-90 90", &knee),
        motor("hip"),
        motor("knee")
    );
    let ran = robert().file("leg.xml", leg).args(["import", "leg.xml", "--out", "leg"]).succeeds();
    let robot = Robot::from_folder(&ran.path("leg")).unwrap();
    let (tree, start) = (robot.kinematics(), robot.home());
    let sole = Point::Site("sole".into());
    let [x, y, z] = tree.place(&start, &tree.point(&sole).unwrap()).pos;
    let target = Target { point: sole.clone(), pos: [x, y, z + 0.15], quat: None };
    let search = |restarts: u32| {
        let config = IkConfig { restarts, ..IkConfig::default() };
        tree.ik(&start, std::slice::from_ref(&target), &config).unwrap()
    };
    assert!(!search(0).reached, "one search stays where it began");
    assert!(search(8).reached);
    let mut clip = Clip::new(robot.clip_ref(), 40);
    clip.keys.push(Key::new(0, &start));
    let reach = vec![Reach::site("sole", target.pos)];
    clip.keys.push(Key { reach, ..Key::with(20, Goal::Open) });
    let command = robot.compile(&clip).unwrap();
    assert!(command.reached().iter().all(|r| r.distance_m < 1e-3), "{:?}", command.reached());
}

#[test]
fn imports_that_cannot_be_leave_no_folder() {
    let xml = r#"<mujoco><worldbody><body><freejoint/><geom size=".1"/><body><joint name="k"/><geom size=".1" pos="1 0 0"/></body></body></worldbody></mujoco>"#;
    let ran = robert().file("m.xml", xml).args(["import", "m.xml", "--out", "bot"]).fails(3);
    assert!(
        ran.stderr.contains("m.xml:1:") && ran.stderr.contains("--fixed-base"),
        "{}",
        ran.stderr
    );
    let left: Vec<_> =
        std::fs::read_dir(ran.dir.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left, ["m.xml"]);

    let ran = robert()
        .file("m.xml", xml)
        .args(["import", "m.xml", "--out", "bot", "--fixed-base", "--json"])
        .succeeds();
    assert!(notes(&ran.json(), "assumed").contains("no actuators: 1 motors of +-22"));

    robert()
        .file("m.xml", xml)
        .file("bot/x", "mine")
        .args(["import", "m.xml", "--out", "bot"])
        .fails(3);
    robert().args(["import", "gone.urdf", "--out", "bot"]).fails(3);
    robert().file("m.xml", xml).args(["import", "m.xml", "--out", "b", "--package", "x"]).fails(2);
    let ran = robert().file("m.xml", xml).args(["robots", "show", "m.xml"]).fails(3);
    assert!(ran.stderr.contains("robert import m.xml"), "{}", ran.stderr);
}

#[test]
fn a_hundred_thousand_attributes_are_counted_before_any_parser_sees_them() {
    let attributes = (0..100_000).fold(String::new(), |all, i| all + &format!(" a{i}=\"\""));
    let link = format!("<robot name=\"r\">\n  <link name=\"a\"{attributes}/></robot>");
    let ran = robert().file("r.urdf", &link).args(["import", "r.urdf", "--out", "bot"]).fails(3);
    let said = "r.urdf:2:3: the element has 100001 attributes; at most 256 are read";
    assert!(ran.stderr.contains(said), "{}", ran.stderr);
    let body = format!("<mujoco><worldbody><body{attributes}/></worldbody></mujoco>");
    let ran = robert().file("r.xml", &body).args(["import", "r.xml", "--out", "bot"]).fails(3);
    assert!(ran.stderr.contains("r.xml:1:20: the element has 100000"), "{}", ran.stderr);
    assert!(!ran.path("bot").exists());
}

#[test]
fn obj_meshes_and_welded_joints_are_taken() {
    let urdf = GRIPPER
        .replace("package://gripper_description/meshes/Arm.STL", "arm.obj")
        .replace("package://gripper_description/meshes/pretty.dxf", "arm.obj");
    let ran = robert()
        .file("g.urdf", urdf)
        .file("arm.obj", TETRAHEDRON_OBJ)
        .args(["import", "g.urdf", "--out", "bot", "--weld", "turn", "--base-height", "0.7"])
        .succeeds();
    assert!(ran.stdout.contains("welded"), "{}", ran.stdout);
    let robot = Robot::from_folder(Path::new(&ran.path("bot"))).unwrap();
    assert_eq!((robot.state_dim(), robot.action_dim()), (2, 1));
    let base = robot.model().id(Kind::Body, "base").unwrap();
    assert_eq!(robot.model().body_pos()[3 * base + 2], 0.7);
    robert()
        .file("g.urdf", GRIPPER)
        .args(["import", "g.urdf", "--out", "b", "--weld", "nose"])
        .fails(3);
}

#[test]
fn what_follows_a_welded_joint_is_welded_with_it() {
    let import = |urdf: &str, weld: &str| {
        robert().file("g.urdf", urdf).args([
            "import",
            "g.urdf",
            "--out",
            "bot",
            "--without-meshes",
            "--json",
            "--weld",
            weld,
        ])
    };
    let said = import(GRIPPER, "grip").fails(3).stderr;
    assert!(
        said.contains("joint \"grip2\" follows the welded joint \"grip\" with an offset"),
        "{said}"
    );
    let straight = GRIPPER.replace(" offset=\".001\"", "");
    let ran = import(&straight, "grip").succeeds();
    let changed = notes(&ran.json(), "changed");
    assert!(changed.contains("\"grip2\" is welded with \"grip\", which it follows"), "{changed}");
    assert_eq!(Robot::from_folder(&ran.path("bot")).unwrap().state_dim(), 1);
    let changed = notes(&import(GRIPPER, "grip2").succeeds().json(), "changed");
    assert!(
        changed.contains("\"grip2\" is welded at its zero, and no longer follows \"grip\""),
        "{changed}"
    );
}

#[test]
fn pointers_of_git_lfs_are_named_and_can_be_left_out() {
    let pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n";
    let import = |more: &[&str]| {
        let urdf = GRIPPER.replace("<sphere radius=\".02\"/>", "<mesh filename=\"finger.dae\"/>");
        robert()
            .file("ws/g/urdf/g.urdf", urdf)
            .file("ws/g/urdf/finger.dae", pointer)
            .file("ws/g/meshes/Arm.STL", tetrahedron_stl())
            .args(["import", "ws/g/urdf/g.urdf", "--out", "bot", "--json"])
            .args(["--package", "gripper_description=ws/g"])
            .args(more)
    };
    let said = import(&[]).fails(3).stderr;
    assert!(
        said.contains("\"finger.dae\" is a pointer of Git LFS") && said.contains("git lfs pull"),
        "{said}"
    );
    let warned = notes(&import(&["--without-meshes"]).succeeds().json(), "warnings");
    assert!(warned.contains("collision mesh \"finger.dae\" of link \"left\""), "{warned}");
}

#[test]
fn an_mjcf_can_be_taken_without_the_files_that_are_missing() {
    const ARM: &str = "<mujoco>
        <asset>
          <mesh name='link' file='link.stl'/><mesh file='tool.obj'/><mesh file='there.stl'/>
          <texture name='wood' type='2d' file='wood.png'/><material name='skin' texture='wood'/>
        </asset>
        <worldbody><body><joint range='-90 90' damping='1'/>
          <geom type='capsule' size='.02' fromto='0 0 0 .2 0 0' material='skin'/>
          <geom type='mesh' mesh='link'/><geom type='mesh' mesh='there'/>
          <body pos='.2 0 0'><joint name='j' range='-90 90' damping='1' axis='0 1 0'/>
            <inertial pos='.1 0 0' mass='1' diaginertia='.01 .01 .01'/>
            <geom type='mesh' mesh='tool'/></body>
        </body></worldbody>
        <actuator><motor joint='j' ctrlrange='-5 5'/></actuator>
      </mujoco>";
    let import = |more: &[&str]| {
        robert()
            .file("arm.xml", ARM)
            .file("there.stl", tetrahedron_stl())
            .args(["import", "arm.xml", "--out", "bot", "--json"])
            .args(more)
    };
    let said = import(&[]).fails(3).stderr;
    assert!(said.contains("arm.xml:3:11: mesh file \"link.stl\" does not exist"), "{said}");
    assert!(said.contains("leave out what is missing: --without-meshes"), "{said}");
    let ran = import(&["--without-meshes"]).succeeds();
    let (dropped, warned) = (notes(&ran.json(), "dropped"), notes(&ran.json(), "warnings"));
    for (tag, file) in [("mesh", "link.stl"), ("mesh", "tool.obj"), ("texture", "wood.png")] {
        assert!(dropped.contains(&format!("{tag} file \"{file}\" does not exist")), "{dropped}");
    }
    assert!(
        dropped.contains("shapes made of them: 2, which neither collide nor weigh"),
        "{dropped}"
    );
    assert!(warned.contains("weigh less without these shapes: \"without a name\""), "{warned}");
    let robot = Robot::from_folder(&ran.path("bot")).unwrap();
    assert_eq!((robot.model().ngeom(), robot.state_dim()), (2, 2));
    // A default class keeps its other settings, and a pair goes with its shape.
    let class = ARM
        .replace("<worldbody>", "<default><default class='v'><geom mesh='link' density='0'/></default></default><contact><pair geom1='g' geom2='h'/></contact><worldbody>")
        .replace("mesh='link'/><geom type='mesh' mesh='there'/>", "mesh='link' name='g'/><geom type='mesh' mesh='there' name='h' class='v'/>");
    let ran = robert()
        .file("arm.xml", class)
        .file("there.stl", tetrahedron_stl())
        .args(["import", "arm.xml", "--out", "bot", "--without-meshes"])
        .succeeds();
    let model = Robot::from_folder(&ran.path("bot")).unwrap();
    let before = robot.model().body_mass().iter().sum::<f64>();
    assert!(model.model().body_mass().iter().sum::<f64>() < before, "the class has no density");
    // A body that consists of a mesh alone has no mass without it.
    let hollow = ARM.replace("<inertial pos='.1 0 0' mass='1' diaginertia='.01 .01 .01'/>", "");
    let said = robot_without(&hollow);
    assert!(said.contains("mass"), "{said}");
    // What lies outside the folder is refused in any case.
    let said = robot_without(&ARM.replace("link.stl", "../link.stl"));
    assert!(said.contains("outside the project folder"), "{said}");
}

/// What `import --without-meshes` says of an MJCF that it refuses.
fn robot_without(xml: &str) -> String {
    robert()
        .file("arm.xml", xml)
        .file("there.stl", tetrahedron_stl())
        .args(["import", "arm.xml", "--out", "bot", "--without-meshes"])
        .fails(3)
        .stderr
}

#[test]
fn links_without_mass_of_their_own_do_not_make_the_robot_heavier() {
    // The base is fixed to the world, so it needs no mass; a moving link is weighed by its shapes.
    let inertial = |mass: &str| {
        let from = GRIPPER.find(&format!("<inertial><mass value=\"{mass}\"")).unwrap();
        let to = from + GRIPPER[from..].find("</inertial>").unwrap() + "</inertial>".len();
        GRIPPER.replace(&GRIPPER[from..to], "")
    };
    let import = |urdf: &str| {
        let ran = robert()
            .file("g.urdf", urdf)
            .args(["import", "g.urdf", "--out", "bot", "--without-meshes", "--json"])
            .succeeds();
        let mass: f64 =
            Robot::from_folder(&ran.path("bot")).unwrap().model().body_mass().iter().sum();
        (mass, notes(&ran.json(), "assumed"))
    };
    let (mass, assumed) = import(&inertial("2"));
    assert!((mass - 1.7).abs() < 1e-6 && !assumed.contains("link \"base\""), "{mass} {assumed}");
    let (mass, assumed) = import(&inertial(".1"));
    // Two spheres of 2 cm.
    assert!((mass - 3.5 - 0.067).abs() < 1e-3, "{mass}");
    assert!(
        assumed.contains("link \"left\" has no inertia: that of its collision shapes"),
        "{assumed}"
    );
    // An inertia that the simulator would take for none.
    let tiny = GRIPPER.replace(
        "ixx=\"1e-4\" iyy=\"1e-4\" izz=\"1e-4\"",
        "ixx=\"3e-22\" iyy=\"3e-22\" izz=\"5e-22\"",
    );
    import(&tiny);
}

#[test]
fn motors_weaker_than_friction_and_motors_of_fingers_are_noticed() {
    let import = |urdf: &str| {
        let ran = robert()
            .file("g.urdf", urdf)
            .args(["import", "g.urdf", "--out", "bot", "--without-meshes", "--json"])
            .succeeds();
        ran.json()
    };
    let stiff = GRIPPER.replace("friction=\".2\"", "friction=\"100\"");
    let said = notes(&import(&stiff), "warnings");
    assert!(
        said.contains("1 of 2 joints with a torque limit are weaker than dry friction"),
        "{said}"
    );
    assert!(said.contains("\"turn\" has 30 for 100"), "{said}");
    // A finger that needs some newtons does not get the motor of an arm.
    let light = GRIPPER.replace("effort=\"8\"", "").replace("value=\".1\"", "value=\".01\"");
    let assumed = notes(&import(&light), "assumed");
    let line = assumed.lines().find(|l| l.contains("joint \"grip\" gives no effort")).unwrap();
    let least: f64 = line.split("+-").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!(least < 10.0 && least > 1.0, "{line}");
}

#[test]
fn the_drive_of_a_lift_leaves_force_beside_its_load() {
    // 57 of 100 N carry the lift, and half of the follower's weight comes on top.
    let mass = |kg: &str| {
        format!(
            "<inertial><mass value=\"{kg}\"/><inertia ixx=\".1\" iyy=\".1\" izz=\".1\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial>"
        )
    };
    let joint = |name: &str, more: &str| {
        format!(
            "<joint name=\"{name}\" type=\"prismatic\"><parent link=\"base\"/><child link=\"{name}_link\"/><axis xyz=\"0 0 1\"/><limit lower=\"0\" upper=\".7\" effort=\"100\" velocity=\".2\"/>{more}</joint>"
        )
    };
    let urdf = |kg: &str| {
        let follows = joint("torso", "<mimic joint=\"lift\" multiplier=\".5\"/>");
        let (lift, own, other) = (joint("lift", ""), mass(kg), mass("6.1"));
        // Without its drive this one would be too fast to be controlled.
        let (light, least) = (joint("light", ""), mass(".1"));
        format!(
            "<robot name=\"r\"><link name=\"base\"/><link name=\"lift_link\">{own}</link><link name=\"torso_link\">{other}</link><link name=\"light_link\">{least}</link>{lift}{follows}{light}</robot>"
        )
    };
    let import = |kg: &str| {
        let ran = robert()
            .file("l.urdf", urdf(kg))
            .args(["import", "l.urdf", "--out", "bot", "--json"])
            .succeeds();
        notes(&ran.json(), "assumed")
    };
    let said = import("5.8");
    assert!(said.contains("of 100, beside its load, spent at 0.200, as the file says"), "{said}");
    assert!(import("1").contains("(100 spent at 0.200, as the file says)"));
    // Hardly anything is left: the joint cannot be as fast as the file says.
    let said = import("6.9");
    assert!(
        said.contains("beside its load, spent at 0.0") && said.contains("the file allows 0.2"),
        "{said}"
    );
}

#[test]
fn the_folder_of_an_imported_robot_is_trained_in_place() {
    let ran = robert()
        .file("g.urdf", GRIPPER)
        .args(["import", "g.urdf", "--out", "bot", "--without-meshes"])
        .succeeds();
    let dir = ran.path(".");
    let (code, _, said) = call(&dir, &["new", "bot", "--out", "other", "--minutes", "0"]);
    assert!(code == 2 && said.contains("robert new bot --out bot"), "{code} {said}");
}

#[test]
fn addresses_without_a_package_and_shapes_without_size_are_read() {
    let urdf = GRIPPER
        .replace("package://gripper_description/meshes/Arm.STL", "package:///Arm.STL")
        .replace("package://gripper_description/meshes/pretty.dxf", "package:///sub/Arm.STL")
        .replace("<sphere radius=\".02\"/>", "<box size=\"0 .02 .02\"/>");
    let ran = robert()
        .file("g.urdf", &urdf)
        .file("Arm.STL", tetrahedron_stl())
        .file("sub/Arm.STL", tetrahedron_stl())
        .args(["import", "g.urdf", "--out", "bot", "--json"])
        .succeeds();
    let v = ran.json();
    assert_eq!(v["files"], 2);
    assert!(notes(&v, "dropped").contains("collision shape of link \"left\": its size is 0"));
    let beside =
        GRIPPER.replace("package://gripper_description/meshes/Arm.STL", "package://Arm.STL");
    let ran = robert()
        .file("g.urdf", &beside)
        .file("Arm.STL", tetrahedron_stl())
        .args(["import", "g.urdf", "--out", "bot", "--json"])
        .succeeds();
    assert_eq!(ran.json()["files"], 1);
    // A mesh that is only drawn may be missing, one that collides may not.
    let gone =
        GRIPPER.replace("package://gripper_description/meshes/Arm.STL", "package:///gone.STL");
    let ran = robert().file("g.urdf", &gone).args(["import", "g.urdf", "--out", "bot", "--json"]);
    let dropped = notes(&ran.succeeds().json(), "dropped");
    assert!(
        dropped.contains(
            "visual mesh \"package:///gone.STL\" of link \"arm\": \"gone.STL\" does not exist"
        ),
        "{dropped}"
    );
    let collides = gone.replace(
        "<cylinder radius=\".05\" length=\".4\"/>",
        "<mesh filename=\"package:///gone.STL\"/>",
    );
    let said = robert()
        .file("g.urdf", collides)
        .args(["import", "g.urdf", "--out", "bot"])
        .fails(3)
        .stderr;
    assert!(said.contains("\"gone.STL\" does not exist") && !said.contains("--package"), "{said}");
    let ran = robert()
        .file(
            "g.urdf",
            gone.replace("<cylinder radius=\".05\" length=\".4\"/>", "<mesh filename=\"no.STL\"/>"),
        )
        .args(["import", "g.urdf", "--out", "bot", "--without-meshes", "--json"])
        .succeeds();
    assert!(notes(&ran.json(), "warnings").contains("collision mesh \"no.STL\" of link \"arm\""));
    // A link that only a missing mesh would give its weight moves all the same.
    let weightless = gone
        .replace("<cylinder radius=\".05\" length=\".4\"/>", "<mesh filename=\"no.STL\"/>")
        .replace("<mass value=\"1.5\"/>", "<mass value=\"0\"/>");
    assert_ne!(weightless, gone);
    let ran = robert()
        .file("g.urdf", weightless)
        .args(["import", "g.urdf", "--out", "bot", "--without-meshes", "--json"])
        .succeeds();
    assert!(notes(&ran.json(), "assumed").contains("link \"arm\" has no inertia"));
    // A name that differs in upper and lower case only is found, as on other systems.
    let ran = robert()
        .file(
            "g.urdf",
            GRIPPER.replace("package://gripper_description/meshes/Arm.STL", "meshes/Arm.STL"),
        )
        .file("meshes/arm.stl", tetrahedron_stl())
        .args(["import", "g.urdf", "--out", "bot", "--without-meshes", "--json"])
        .succeeds();
    let assumed = notes(&ran.json(), "assumed");
    assert!(assumed.contains("mesh \"meshes/Arm.STL\" is the file arm.stl"), "{assumed}");
    // No way out is named that the program would refuse.
    let astray = |address: &str| {
        let urdf = GRIPPER.replace("package://gripper_description/meshes/Arm.STL", address);
        robert().file("g.urdf", urdf).args(["import", "g.urdf", "--out", "bot"]).fails(3).stderr
    };
    let said = astray("package://a=b/Arm.STL");
    assert!(said.contains("correct the address") && !said.contains("--package"), "{said}");
    let said = astray("package:///../Arm.STL");
    assert!(said.contains("outside the project folder"), "{said}");
    let negative = GRIPPER.replace("radius=\".02\"", "radius=\"-.02\"");
    let ran = robert().file("g.urdf", negative).args(["import", "g.urdf", "--out", "bot"]).fails(3);
    assert!(ran.stderr.contains("sizes are positive"), "{}", ran.stderr);
}

/// A model that leans on other files, or on a later simulator, is taken in and what it lacks said.
#[test]
fn names_that_a_model_lacks_and_faces_that_disagree_do_not_stop_an_import() {
    // The last face is turned over: it runs along its edges as its neighbours do.
    let torn = TETRAHEDRON_OBJ.replace("f 2 3 4", "f 2 4 3");
    assert_ne!(torn, TETRAHEDRON_OBJ);
    let xml = r#"<mujoco><asset><mesh name="m" file="torn.obj"/><mesh name="n" file="torn.obj" scale="1 1 2"/></asset>
        <default><geom material="skin"/></default><worldbody>
        <body childclass="limb"><joint name="a" class="large" axis="0 1 0"/><geom type="mesh" mesh="m"/>
        <body><joint name="b" axis="1 0 0"/><geom type="mesh" mesh="n" pos=".2 0 0"/></body></body>
        </worldbody></mujoco>"#;
    let ran = robert()
        .file("m.xml", xml)
        .file("torn.obj", &torn)
        .args(["import", "m.xml", "--out", "bot", "--json"])
        .succeeds();
    let v = ran.json();
    let (changed, warnings) = (notes(&v, "changed"), notes(&v, "warnings"));
    assert!(changed.contains("material \"skin\" is not in the file"), "{changed}");
    assert!(
        warnings.contains("does not define say nothing here: \"large\", \"limb\""),
        "{warnings}"
    );
    assert!(warnings.contains("mesh torn.obj: its faces do not agree"), "{warnings}");
    let held = std::fs::read_dir(ran.path("bot").join("assets")).unwrap().count();
    assert_eq!((v["files"].as_u64(), held), (Some(1), 1), "the file that was replaced is gone");
    // Whole tetrahedra with edges of 0.1 m at 1000 kg/m^3, one of them twice as high, weigh 0.5 kg;
    // these are estimates.
    let mass = v["mass_kg"].as_f64().unwrap();
    assert!((0.5..0.75).contains(&mass), "{mass}");
}

/// The simulator finds no convex hull of a plate without thickness.
#[test]
fn a_flat_mesh_is_taken_in_and_it_is_said() {
    let plate = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\n";
    let xml = r#"<mujoco><asset><mesh name="m" file="plate.obj"/></asset><worldbody>
        <body><joint name="a" damping="1"/><inertial pos="0 0 0" mass="1" diaginertia=".1 .1 .1"/>
        <geom type="mesh" mesh="m"/></body></worldbody><actuator><motor joint="a"/></actuator></mujoco>"#;
    let ran = robert()
        .file("m.xml", xml)
        .file("plate.obj", plate)
        .args(["import", "m.xml", "--out", "bot", "--json"])
        .succeeds();
    let v = ran.json();
    let warnings = notes(&v, "warnings");
    assert!(warnings.contains("mesh plate.obj: its points were moved by up to"), "{warnings}");
    assert_eq!((v["files"].as_u64(), v["mass_kg"].as_f64()), (Some(1), Some(1.0)));
}

/// A platform on two legs that float at their ends: by bodies, or by sites as `MuJoCo` 3 writes it.
fn platform(ties: &str, left: &str) -> String {
    format!(
        r#"<mujoco><compiler angle="radian"/><default><joint damping="1" armature=".01"/></default><worldbody>
  <body name="plate" pos="0 0 .5"><freejoint name="free"/><geom type="box" size=".3 .1 .02" mass="1"/>
    <site name="l1" pos="-.2 0 0"/><site name="r1" pos=".2 0 0"/></body>
  <body name="left" pos="{left} 0 0"><joint name="a" type="slide" axis="0 0 1" range="-.1 .1" limited="true"/>
    <geom type="capsule" fromto="0 0 0 0 0 .4" size=".02" mass=".3"/><site name="l2" pos="0 0 .5"/></body>
  <body name="right" pos=".2 0 0"><joint name="b" type="slide" axis="0 0 1" range="-.1 .1" limited="true"/>
    <geom type="capsule" fromto="0 0 0 0 0 .4" size=".02" mass=".3"/><site name="r2" pos="0 0 .5"/></body>
  </worldbody><equality>
{ties}</equality>
  <actuator><motor joint="a" gear="40" ctrlrange="-1 1"/><motor joint="b" gear="40" ctrlrange="-1 1"/></actuator>
  <keyframe><key name="up" qpos="0 0 .5 1 0 0 0 0 0"/></keyframe></mujoco>"#
    )
}

#[test]
fn a_platform_that_closes_a_loop_gets_six_joints() {
    let bodies = r#"<connect body1="left" body2="plate" anchor="0 0 .5"/>
<connect body1="right" body2="plate" anchor="0 0 .5"/>
"#;
    let sites = r#"<connect site1="l2" site2="l1"/>
<connect site1="r2" site2="r1"/>
"#;
    let mut models = Vec::new();
    for ties in [bodies, sites] {
        let ran = robert().file("m.xml", platform(ties, "-.2"));
        let ran = ran.args(["import", "m.xml", "--out", "bot"]).succeeds();
        let robot = Robot::from_folder(&ran.path("bot")).unwrap();
        let names: Vec<&str> = robot.joints().iter().map(|j| j.name.as_str()).collect();
        let six = ["free_x", "free_y", "free_z", "free_roll", "free_pitch", "free_yaw"];
        assert_eq!(names, [&six[..], &["a", "b"]].concat());
        let damping = robot.model().dof_damping();
        assert!(damping[..6].iter().all(|d| *d == 0.0), "as a free joint: {damping:?}");
        assert!(
            ran.stdout.contains("closes a loop") && ran.stdout.contains("keyframes"),
            "{}",
            ran.stdout
        );
        models.push(robot);
    }
    // Both ways of writing the tie give the same robot.
    let ends = |r: &Robot| {
        let mut d = Data::new(r.model()).unwrap();
        d.set_ctrl(&[0.3, 0.1]).unwrap();
        d.step(40).unwrap();
        d.qpos().to_vec()
    };
    let [a, b] = [ends(&models[0]), ends(&models[1])];
    assert!(a.iter().zip(&b).all(|(x, y)| (x - y).abs() < 1e-9), "{a:?} {b:?}");

    // What closes no loop is refused as before, and what was asked for is done.
    let off = bodies.replace("<connect", "<connect active=\"false\"");
    let ran =
        robert().file("m.xml", platform(&off, "-.2")).args(["import", "m.xml", "--out", "bot"]);
    assert!(ran.fails(3).stderr.contains("--without plate"));
    let fixed = ["import", "m.xml", "--out", "bot", "--fixed-base"];
    let ran = robert().file("m.xml", platform(bodies, "-.2")).args(fixed).succeeds();
    assert_eq!(Robot::from_folder(&ran.path("bot")).unwrap().joints().len(), 2);

    let ran = robert().file("m.xml", platform(sites, "-.25"));
    let ran = ran.args(["import", "m.xml", "--out", "bot"]).fails(3);
    assert!(
        ran.stderr.contains("50.0 mm apart") && ran.stderr.contains("m.xml:9:1"),
        "{}",
        ran.stderr
    );
}

#[test]
fn balls_become_hinges_and_a_base_that_floats_is_one() {
    let model = |base: &str| {
        format!(
            r#"<mujoco><compiler angle="radian"/><worldbody><body name="hip" pos="0 0 1">{base}
  <geom size=".1" mass="2"/><body name="leg"><joint name="knee" axis="0 1 0" damping="1" armature=".1"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03" mass=".5"/>
  <body name="rod" pos="0 0 -.4"><joint name="eye" type="ball" damping=".02" armature=".001"/>
  <geom type="capsule" fromto="0 0 0 .2 0 0" size=".01" mass=".1"/></body></body></body></worldbody>
  <actuator><motor joint="knee" gear="20" ctrlrange="-1 1"/></actuator></mujoco>"#
        )
    };
    let ran =
        robert().file("m.xml", model("")).args(["import", "m.xml", "--out", "bot"]).succeeds();
    let robot = Robot::from_folder(&ran.path("bot")).unwrap();
    let names: Vec<&str> = robot.joints().iter().map(|j| j.name.as_str()).collect();
    assert_eq!(names, ["knee", "eye_roll", "eye_pitch", "eye_yaw"]);
    assert_eq!(robot.model().dof_damping()[1..], [0.02; 3]);
    assert!(ran.stdout.contains("three hinges each: eye"), "{}", ran.stdout);

    // The type may come from a default class.
    let by_class = model("")
        .replace(
            "<worldbody>",
            "<default><default class=\"r\"><joint type=\"ball\"/></default></default><worldbody>",
        )
        .replace("name=\"eye\" type=\"ball\"", "name=\"eye\" class=\"r\"");
    let ran = robert().file("m.xml", by_class).args(["import", "m.xml", "--out", "bot"]).succeeds();
    let of_class = Robot::from_folder(&ran.path("bot")).unwrap();
    let same: Vec<&str> = of_class.joints().iter().map(|j| j.name.as_str()).collect();
    assert_eq!(same, names);

    let weld = ["import", "m.xml", "--out", "bot", "--weld", "eye"];
    let ran = robert().file("m.xml", model("")).args(weld).succeeds();
    assert_eq!(Robot::from_folder(&ran.path("bot")).unwrap().joints().len(), 1);
    assert!(!ran.stdout.contains("three hinges"), "{}", ran.stdout);

    let floating = r#"<joint type="slide" axis="1 0 0"/>
<joint type="slide" axis="0 1 0"/>
<joint type="slide" axis="0 0 1"/>
<joint type="ball"/>"#;
    let ran = robert().file("m.xml", model(floating)).args(["import", "m.xml", "--out", "bot"]);
    let ran = ran.fails(3);
    let said = ran.stderr.contains("m.xml:4:1") && ran.stderr.contains("\"hip\" still");
    assert!(said && ran.stderr.contains("--fixed-base"), "{}", ran.stderr);
    let args = ["import", "m.xml", "--out", "bot", "--fixed-base"];
    let ran = robert().file("m.xml", model(floating)).args(args).succeeds();
    assert_eq!(Robot::from_folder(&ran.path("bot")).unwrap().joints().len(), 4);

    // Three hinges in place of the ball are joints that the state can have.
    let six = floating.replace(
        r#"<joint type="ball"/>"#,
        r#"<joint axis="1 0 0"/><joint axis="0 1 0"/><joint name="yaw" axis="0 0 1"/>"#,
    );
    let ran = robert().file("m.xml", model(&six)).args(args).succeeds();
    assert_eq!(Robot::from_folder(&ran.path("bot")).unwrap().joints().len(), 4);
    assert!(ran.stdout.contains("\"hip\" no longer floats"), "{}", ran.stdout);
    let falls = "\"hip\" floats on three slides and three hinges without motors";
    let import = |base: &str| robert().file("m.xml", model(base)).args(&args[..4]).succeeds();
    let ran = import(&six);
    assert_eq!(Robot::from_folder(&ran.path("bot")).unwrap().joints().len(), 10);
    assert!(ran.stdout.contains(falls), "{}", ran.stdout);
    let five = six.replace(r#"<joint axis="1 0 0"/>"#, "");
    assert!(!import(&five).stdout.contains(falls));
}

#[test]
fn every_named_keyframe_is_a_pose() {
    let xml = r#"<mujoco><compiler angle="radian"/><worldbody><body><joint name="a" axis="0 1 0" range="-1 1" damping="1"/>
      <geom type="capsule" fromto="0 0 0 .2 0 0" size=".02"/></body></worldbody>
      <actuator><motor joint="a" ctrlrange="-1 1"/></actuator>
      <keyframe><key name="home" qpos=".1"/><key name="tucked" qpos="2"/><key name="zero" qpos="0"/><key qpos=".3"/></keyframe></mujoco>"#;
    let ran = robert().file("m.xml", xml).args(["import", "m.xml", "--out", "bot"]).succeeds();
    let robot = Robot::from_folder(&ran.path("bot")).unwrap();
    let poses = &robot.profile().poses;
    assert_eq!(poses.keys().collect::<Vec<_>>(), ["home", "tucked", "zero"]);
    // Within the limits.
    assert_eq!((poses["home"]["a"], poses["tucked"]["a"]), (0.1, 1.0));
    assert_eq!(robot.pose("zero").unwrap(), [0.0], "and not as at home");
    // A key called like the pose of a key without a name.
    let unnamed = xml.replace("<key name=\"home\"", "<key").replace("tucked", "rest");
    let ran = robert().file("m.xml", unnamed).args(["import", "m.xml", "--out", "bot"]).succeeds();
    let robot = Robot::from_folder(&ran.path("bot")).unwrap();
    assert_eq!((robot.home(), robot.pose("rest").unwrap()), (vec![0.1], vec![1.0]));
}

#[test]
fn a_servo_may_inherit_a_share_of_the_range() {
    let xml = r#"<mujoco><compiler angle="radian"/><worldbody><body><joint name="a" axis="0 1 0" range="-1 2" damping="1" armature=".1"/>
      <geom type="capsule" fromto="0 0 0 .2 0 0" size=".02"/></body></worldbody>
      <actuator><position joint="a" kp="20" inheritrange=".8" forcerange="-9 9"/></actuator></mujoco>"#;
    let ran = robert().file("m.xml", xml).args(["import", "m.xml", "--out", "bot"]).succeeds();
    let robot = Robot::from_folder(&ran.path("bot")).unwrap();
    let range = robot.model().actuator_ctrlrange();
    assert!((range[0] + 0.7).abs() < 1e-9 && (range[1] - 1.7).abs() < 1e-9, "{range:?}");
}

/// Joint c follows b, which follows a.
#[test]
fn inverse_kinematics_moves_a_follower_of_a_follower() {
    let link = r#"<geom type="capsule" fromto="0 0 0 .2 0 0" size=".02"/>"#;
    let xml = format!(
        r#"<mujoco><compiler angle="radian"/><worldbody><body name="x"><joint name="a" axis="0 0 1" damping="1"/>{link}
          <body name="y" pos=".2 0 0"><joint name="b" axis="0 0 1" damping="1"/>{link}
          <body name="z" pos=".2 0 0"><joint name="c" axis="0 0 1" damping="1"/>{link}
          <site name="tip" pos=".2 0 0"/></body></body></body></worldbody>
          <equality><joint joint1="c" joint2="b" polycoef=".5 -1 0 0 0"/><joint joint1="b" joint2="a" polycoef="0 2 0 0 0"/></equality>
          <actuator><motor joint="a" ctrlrange="-9 9"/></actuator></mujoco>"#
    );
    let ran = robert().file("m.xml", xml).args(["import", "m.xml", "--out", "bot"]).succeeds();
    let robot = Robot::from_folder(&ran.path("bot")).unwrap();
    let point = Point::Site("tip".to_owned());
    let tree = robot.kinematics();
    let pos = tree.place(&[0.3, 0.6, -0.1], &tree.point(&point).unwrap()).pos;
    let target = Target { point, pos, quat: None };
    let mut data = Data::new(robot.model()).unwrap();
    let found = robot.ik(&mut data, &[0.0; 3], &[target], &IkConfig::default()).unwrap();
    let [a, b, c] = found.state[..] else { panic!("{found:?}") };
    assert!(found.reached && (a - 0.3).abs() < 1e-3, "{found:?}");
    assert!((b - 2.0 * a).abs() < 1e-9 && (c - 0.5 + b).abs() < 1e-9, "{found:?}");
}

/// A sled that can only slide along a plank into which it is drawn, and a spring arm on it whose tip is in the floor.
const STUCK: &str = r#"<mujoco><compiler angle="radian"/><worldbody><geom name="plank" type="box" size="2 .1 .1"/>
  <body name="sled"><joint name="along" type="slide" axis="1 0 0" range="-.5 .5" damping="5"/>
    <geom type="box" size=".1 .05 .05" mass="1"/></body>
  <geom name="floor" type="plane" size="9 9 .1" pos="0 2 0"/>
  <body name="arm" pos="0 3 .3"><joint name="pitch" axis="0 -1 0" range="-1.5 1.5" stiffness="4" springref="-1" damping=".5"/>
    <geom type="capsule" fromto="0 0 0 .4 0 0" size=".02" mass=".2"/></body></worldbody>
  <actuator><motor joint="along" ctrlrange="-10 10"/><motor joint="pitch" ctrlrange="-10 10"/></actuator></mujoco>"#;

#[test]
fn parts_that_contact_cannot_part_stay_where_they_are_and_springs_do_not_drive_the_others() {
    let ran = robert().file("m.xml", STUCK).args(["import", "m.xml", "--out", "bot"]).succeeds();
    let bot = Robot::from_folder(&ran.path("bot")).unwrap();
    // The tip touches the floor at -.77: asin(.3 - .02 over .4).
    let apart = bot.apart(&[0.1, -0.9]).unwrap().expect("the arm comes out of the floor");
    assert!((apart[1] + 0.775).abs() < 0.02 && (apart[0] - 0.1).abs() < 1e-3, "{apart:?}");
}

/// Two arms that meet in a point; their shoulders are driven.
const FIVE_BAR: &str = r#"<mujoco><compiler angle="radian"/><default><joint axis="0 1 0" damping=".2"/>
  <geom type="capsule" size=".01" contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="a" pos="-.12 0 .6"><joint name="left" range="-1.4 1.4"/><geom fromto="0 0 0 -.1 0 -.2"/>
      <body name="b" pos="-.1 0 -.2"><joint name="left_elbow" range="-2.5 2.5"/><geom fromto="0 0 0 .22 0 -.2"/></body></body>
    <body name="c" pos=".12 0 .6"><joint name="right" range="-1.4 1.4"/><geom fromto="0 0 0 .1 0 -.2"/>
      <body name="d" pos=".1 0 -.2"><joint name="right_elbow" range="-2.5 2.5"/><geom fromto="0 0 0 -.22 0 -.2"/></body></body>
  </worldbody>
  <equality><connect body1="b" body2="d" anchor=".22 0 -.2"/></equality>
  <actuator><motor joint="left" ctrlrange="-9 9"/><motor joint="right" ctrlrange="-9 9"/></actuator></mujoco>"#;

#[test]
fn a_loop_is_closed_on_the_way_from_key_to_key_and_its_joints_are_open_between() {
    let ran = robert().file("m.xml", FIVE_BAR).args(["import", "m.xml", "--out", "bot"]).succeeds();
    let bot = Robot::from_folder(&ran.path("bot")).unwrap();
    let names: Vec<String> = bot.joints().iter().map(|j| j.name.clone()).collect();
    let at = |name: &str| bot.joint_index(name).unwrap();
    let compiled = |count: u32, fill| {
        let own = RobotRef { id: "bot".into(), joints: names.clone(), ..RobotRef::default() };
        let mut clip = Clip::new(own, 121);
        clip.fill = fill;
        let key = |i: u32| {
            // Apart, then together.
            let s = 0.3 - 1.1 * f64::from(i) / f64::from(count);
            let mut row = vec![None; names.len()];
            (row[at("left")], row[at("right")]) = (Some(s), Some(-s));
            Key::with(i * 120 / count, Goal::Q(row))
        };
        clip.keys = (0..=count).map(key).collect();
        compile_for(&clip, Some(&bot.joint_table())).unwrap()
    };
    let (near, far) = (compiled(20, Fill::Mask), compiled(1, Fill::Mask));
    for elbow in ["left_elbow", "right_elbow"] {
        let [a, b] = [&near, &far].map(|c| c.sees(120, at(elbow)).then(|| c.row(120)[at(elbow)]));
        assert!((a.unwrap() - b.unwrap()).abs() < 1e-3, "{elbow}: {a:?} {b:?}");
    }
    let led = compiled(1, Fill::Linear);
    assert!(led.sees(60, at("left")) && !led.sees(60, at("left_elbow")));
}
