//! Robots and clips as strangers type them, of kinds and sizes that no robot in the program has.

use std::path::Path;
use std::sync::Arc;

use robert::clip::{Clip, Command, Goal, Key, Reach};
use robert::kinematics::{IkConfig, Point, Target};
use robert::progress::{Cancel, Silent};
use robert::robot::{Coupling, Robot};
use robert::rollout::{ClipFacts as _, Contenders, LiveRollout, PolicyConfig, PolicyName, Start};

use crate::run::{Ran, call, robert};

fn import(file: &str, text: &str) -> (Ran, Robot) {
    let ran = robert().file(file, text).args(["import", file, "--out", "bot", "--json"]).succeeds();
    let bot = Robot::from_folder(&ran.path("bot")).unwrap();
    (ran, bot)
}

/// Two cranks with motors, whose rods hold a plate: one by a point, one rigidly. Another joint is apart.
fn linkage() -> String {
    let limb = |side: &str, at: f64| {
        let (out, back) = (0.5 * at, -1.5 * at);
        format!(
            r#"<body pos="{at} 0 .5"><joint name="motor_{side}" axis="0 1 0" range="-2 2" damping="1"/>
            <geom type="capsule" size=".01" fromto="0 0 0 {out} 0 -.1"/>
            <body name="rod_{side}" pos="{out} 0 -.1"><joint name="knee_{side}" axis="0 1 0" range="-2 2" damping=".01"/>
              <geom type="capsule" size=".01" fromto="0 0 0 {back} 0 -.2"/></body></body>"#
        )
    };
    format!(
        r#"<mujoco><compiler angle="radian" autolimits="true"/><default><geom contype="0" conaffinity="0"/></default><worldbody>{}{}
          <body name="plate" pos="0 0 .2"><joint name="px" type="slide" axis="1 0 0" range="-1 1"/>
            <joint name="pz" type="slide" axis="0 0 1" range="-1 1"/><joint name="turn" axis="0 1 0" range="-3 3"/>
            <geom type="box" size=".05 .05 .01"/><site name="tool" pos="0 0 -.02"/></body>
          <body pos="1 0 .5"><joint name="apart" axis="0 1 0" range="-2 2" damping="1"/><geom size=".05"/></body>
        </worldbody><equality><connect body1="rod_left" body2="plate" anchor=".15 0 -.2"/><weld body1="plate" body2="rod_right"/></equality>
        <actuator><motor joint="motor_left" ctrlrange="-20 20"/><motor joint="motor_right" ctrlrange="-20 20"/>
          <motor joint="apart" ctrlrange="-20 20"/></actuator></mujoco>"#,
        limb("left", -0.1),
        limb("right", 0.1)
    )
}

/// Its motor cannot lift the load, but swing it up, which a planner finds that has no guide.
#[test]
fn a_load_that_must_be_swung_up_is_performed_live_as_at_once() {
    let text = r#"<robot name="p"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 -1"/><mass value="5"/>
        <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="shoulder" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
        <limit effort="25" lower="-2.3" upper="2.3" velocity="3"/></joint></robot>"#;
    let (_ran, bot) = import("m.urdf", text);
    let bot = Arc::new(bot);
    let goal = |frame: usize| if frame == 59 { 1.0 } else { 0.0 };
    let seen = |frame: usize| frame == 0 || frame == 59;
    let joints = vec!["shoulder".to_owned()];
    let (q, visible) = ((0..60).map(goal).collect(), (0..60).map(seen).collect());
    let command = Command::from_dense(joints, vec![0.0], q, visible).unwrap();
    let asked = PolicyConfig::new(PolicyName::Auto);
    let all = Contenders::new(&bot, &asked).unwrap();
    let (start, cancel) = (Start::Pose, Cancel::default());
    let chosen = all.perform(&command, &start, 0, 2, &Silent, &cancel).unwrap();
    assert_eq!(chosen.policy.label(), "ilqr");
    let mut live = LiveRollout::new(&bot, &asked, 0, &command).unwrap();
    let mut perform = || {
        while live.step().unwrap().is_some() {}
        while live.step_another() {
            live.show_best_so_far();
            live.step().unwrap();
        }
        let choice = live.choose().unwrap();
        assert_eq!(choice.policy, "ilqr");
        assert_eq!(live.shown().actions(), chosen.rollout.actions());
        live.set_command(&command).unwrap();
    };
    perform();
    perform();
}

#[test]
fn the_motors_of_a_loop_take_its_end_effector_there() {
    let (ran, bot) = import("linkage.xml", &linkage());
    let tree = bot.kinematics();
    let tool = Point::Site("tool".into());
    let start = bot.home();
    let at = tree.place(&start, &tree.point(&tool).unwrap()).pos;
    let to = |x: f64, z: f64| [at[0] + x, at[1], at[2] + z];
    let solve = |pos| {
        let target = Target { point: tool.clone(), pos, quat: None };
        tree.ik(&start, &[target], &IkConfig::default()).unwrap()
    };
    // Where the rods end is the middle of the plate.
    let open = |state: &[f64]| {
        let place = |body: &str, offset| {
            tree.place(state, &tree.point(&Point::Body { body: body.into(), offset }).unwrap())
        };
        let plate = place("plate", [0.0; 3]);
        let ends = [place("rod_left", [0.15, 0.0, -0.2]), place("rod_right", [-0.15, 0.0, -0.2])];
        let off = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f64>();
        ends.map(|end| off(&end.pos, &plate.pos)).iter().sum::<f64>()
            + off(&ends[1].quat, &plate.quat)
    };
    assert!(open(&start) < 1e-3);
    let found = solve(to(0.03, 0.02));
    assert!(found.reached && open(&found.state) < 1e-3, "{found:?}");
    let moved = |name: &str| {
        let joint = bot.joint_index(name).unwrap();
        (found.state[joint] - start[joint]).abs()
    };
    assert!(moved("motor_left") > 0.03 && moved("motor_right") > 0.03, "{found:?}");
    assert_eq!(moved("apart"), 0.0);
    assert_eq!(tree.movers(std::slice::from_ref(&tool)).unwrap().len(), bot.state_dim() - 1);
    // Out of reach it stays in one piece.
    let far = solve(to(0.0, -3.0));
    assert!(!far.reached && far.distance_m > 2.0 && open(&far.state) < 1e-3, "{far:?}");
    // And the motors do it.
    let mut clip = Clip::new(bot.clip_ref(), 60);
    let goal = Reach { point: tool, pos: to(0.03, 0.02), quat: None };
    clip.keys = vec![Key { hold: 30, reach: vec![goal], ..Key::with(30, Goal::Open) }];
    let report = rollout(ran.dir.path(), &clip, "auto");
    assert!(report["precision"].as_f64().unwrap() < 5e-3, "{report}");
    let arrival = &report["arrivals"][0];
    assert_eq!((&arrival["frames"], &arrival["point"]), (&[30, 60].into(), &"tool".into()));
    let worst = arrival["worst"].as_f64().unwrap();
    assert!(worst < 5e-3 && arrival["distance"].as_f64().unwrap() <= worst, "{arrival}");
    assert!(arrival["angle"].is_null());
}

#[test]
fn a_tendon_pulls_along_what_the_goal_does_not_need() {
    let gripper = r#"<mujoco><compiler angle="radian" autolimits="true"/><default><geom contype="0" conaffinity="0"/></default><worldbody>
      <body name="left" pos="0 .1 .5"><joint name="left" type="slide" axis="0 -1 0" range="0 .08" damping="5"/><geom size=".02" mass=".2"/>
        <site name="pad"/></body>
      <body pos="0 -.1 .5"><joint name="right" type="slide" axis="0 1 0" range="0 .08" damping="5"/><geom size=".02" mass=".2"/></body></worldbody>
      <tendon><fixed name="both"><joint joint="left" coef=".5"/><joint joint="right" coef=".5"/></fixed></tendon>
      <actuator><motor tendon="both" ctrlrange="-20 20"/></actuator></mujoco>"#;
    let (_, bot) = import("gripper.xml", gripper);
    let target = Target { point: Point::Site("pad".into()), pos: [0.0, 0.07, 0.5], quat: None };
    let found = bot.kinematics().ik(&[0.0; 2], &[target], &IkConfig::default()).unwrap();
    assert!(found.reached && found.state.iter().all(|q| (q - 0.03).abs() < 1e-3), "{found:?}");
}

#[test]
fn a_key_for_the_motors_of_a_loop_is_one_for_what_they_carry() {
    let (ran, bot) = import("linkage.xml", &linkage());
    let home = bot.home();
    let motors = ["motor_left", "motor_right"].map(|name| bot.joint_index(name).unwrap());
    let apart = bot.joint_index("apart").unwrap();
    let only: Vec<_> = (0..home.len()).map(|j| motors.contains(&j).then_some(-0.3)).collect();
    let mut clip = Clip::new(bot.clip_ref(), 80);
    clip.keys = vec![
        Key::new(0, &home),
        Key { hold: 5, ..Key::with(30, Goal::Q(only)) },
        Key { hold: 15, ..Key::new(60, &home) },
    ];
    let command = bot.compile(&clip).unwrap();
    let seen = |f: u32| (0..home.len()).filter(|j| command.sees(f, *j)).collect::<Vec<_>>();
    assert!(seen(30).len() == home.len() - 1 && !command.sees(30, apart), "{:?}", seen(30));
    assert_eq!(seen(20), [0_usize; 0]);
    let report = rollout(ran.dir.path(), &clip, "auto");
    assert!(report["precision"].as_f64().unwrap() < 2e-3, "{report}");
}

/// Performs a clip with keys `(frame, q)`, held for 10 frames, and returns its Precision.
fn precision(dir: &Path, bot: &Robot, keys: &[(u32, &[f64])], policy: &str) -> f64 {
    let mut clip = Clip::new(bot.clip_ref(), keys.last().unwrap().0 + 11);
    clip.keys = keys.iter().map(|(frame, q)| Key { hold: 10, ..Key::new(*frame, q) }).collect();
    rollout(dir, &clip, policy)["precision"].as_f64().unwrap()
}

/// Performs a clip, and returns the report.
fn rollout(dir: &Path, clip: &Clip, policy: &str) -> serde_json::Value {
    clip.save(&dir.join("typed.clip.json")).unwrap();
    let args = ["rollout", "typed.clip.json", "--robot", "bot", "--policy", policy, "--json"];
    let (code, stdout, stderr) = call(dir, &args);
    assert_eq!(code, 0, "{stderr}");
    serde_json::from_str(&stdout).unwrap()
}

const WRIST: &str = r#"<mujoco><compiler angle="radian"/><worldbody><body pos="0 0 .5">
    <joint name="pitch" axis="0 1 0" range="-1.5 1.5" limited="true" damping=".3" armature=".02"/><geom size=".03" mass=".4"/>
    <body><joint name="roll" axis="1 0 0" range="-2.5 2.5" limited="true" damping=".3" armature=".02"/>
      <geom type="capsule" fromto=".03 0 0 .12 0 0" size=".025" mass=".4" contype="0" conaffinity="0"/></body></body></worldbody>
  <tendon><fixed name="left"><joint joint="pitch" coef="1"/><joint joint="roll" coef="1"/></fixed>
    <fixed name="right"><joint joint="pitch" coef="1"/><joint joint="roll" coef="-1"/></fixed></tendon>
  <actuator><motor tendon="left" ctrllimited="true" ctrlrange="-4 4"/>RIGHT</actuator></mujoco>"#;

#[test]
fn the_joints_of_a_differential_can_be_set_apart() {
    let right = r#"<motor tendon="right" ctrllimited="true" ctrlrange="-4 4"/>"#;
    let (_, both) = import("wrist.xml", &WRIST.replace("RIGHT", right));
    assert!(both.profile().couplings.is_empty(), "{:?}", both.profile().couplings);
    let (_, one) = import("wrist.xml", &WRIST.replace("RIGHT", ""));
    // One motor cannot; the other tendon pulls at nothing.
    let [Coupling::Tendon { name, .. }] = &one.profile().couplings[..] else {
        panic!("{:?}", one.profile().couplings);
    };
    assert_eq!(name, "left");
}

#[test]
fn a_long_way_takes_as_long_as_it_takes() {
    let gantry = r#"<mujoco><worldbody><body pos="0 0 3"><joint name="bridge" type="slide" axis="1 0 0" range="-10 10" limited="true" damping="2000"/>
        <geom type="box" size=".3 .3 .3" mass="4000"/></body></worldbody>
      <actuator><motor joint="bridge" ctrllimited="true" ctrlrange="-6000 6000"/></actuator></mujoco>"#;
    let (_, bot) = import("gantry.xml", gantry);
    let far = bot.settle(&[8.0]).unwrap();
    assert!(far.within && far.rests, "{far:?}");
    assert!(!bot.settle_from(&bot.home(), &[8.0]).unwrap().within, "not in the usual time");
    // A clip may ask for the speed that the motor gives, although exploration does not.
    let joint = &bot.joints()[0];
    assert!(joint.speed_limit <= 1.0 && joint.top_speed > 1.2, "{joint:?}");
    assert_eq!(bot.joint_table().joints[0].speed_max, Some(joint.top_speed));
}

#[test]
fn a_small_motor_has_a_small_rotor() {
    let tiny = r#"<robot name="tiny"><link name="base"><inertial><mass value=".01"/><inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <link name="arm"><inertial><origin xyz="0 0 .01"/><mass value=".003"/><inertia ixx="1e-7" iyy="1e-7" izz="5e-8" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="tilt" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/><limit lower="-1.8" upper="1.8" effort=".002" velocity="10"/></joint></robot>"#;
    let (ran, bot) = import("tiny.urdf", tiny);
    assert!(bot.model().dof_armature()[0] < 1e-5, "{}", bot.model().dof_armature()[0]);
    let dir = ran.dir.path();
    assert!(
        precision(dir, &bot, &[(0, &[0.0]), (30, &[1.0]), (60, &[-0.8])], "computed-torque") < 0.02
    );
}

#[test]
fn a_drive_leaves_the_weaker_direction_its_speed() {
    let ankle = |range: &str, joint: &str| {
        let text = format!(
            r#"<mujoco><compiler angle="radian"/><worldbody><body pos="0 0 1"><joint name="ankle" axis="0 1 0" range="-.9 .6" limited="true" {joint}/>
            <geom type="box" size=".1 .04 .02" mass=".7"/></body></worldbody>
            <actuator><motor joint="ankle" gear="5" ctrllimited="true" ctrlrange="{range}"/></actuator></mujoco>"#
        );
        import("ankle.xml", &text)
    };
    let (ran, bot) = ankle("-1 8", r#"damping=".1" armature=".001""#);
    // 5 N m, the weaker side, are spent at 2 rad/s.
    assert_eq!((bot.model().dof_damping()[0], bot.model().dof_armature()[0]), (2.5, 0.015));
    assert!(ran.stdout.contains("armature 0.015 instead of 0.001, damping 2.5 instead of 0.1"));
    assert_eq!(ankle("-8 8", "").1.model().dof_damping()[0], 20.0);
    assert_eq!(ankle("0 8", "").1.model().dof_damping()[0], 20.0, "pulled one way only");
    // Two that pull against each other.
    let pair = r#"<mujoco><compiler angle="radian"/><worldbody><body pos="0 0 1"><joint name="ankle" axis="0 1 0" range="-.9 .6" limited="true"/>
        <geom type="box" size=".1 .04 .02" mass=".7"/></body></worldbody>
        <actuator><motor joint="ankle" gear="5" ctrllimited="true" ctrlrange="0 8"/>
        <motor joint="ankle" gear="-5" ctrllimited="true" ctrlrange="0 8"/></actuator></mujoco>"#;
    assert_eq!(import("pair.xml", pair).1.model().dof_damping()[0], 20.0);
}

#[test]
fn servos_give_way_and_computed_torque_knows_it() {
    // Usual ones, stiff ones, and ones so stiff that they swing.
    for (kp, most) in [(200, 0.1), (1000, 0.1), (3000, 2.0)] {
        let arm = format!(
            r#"<mujoco><compiler angle="radian"/><worldbody><body pos="0 0 .5"><joint name="lift" axis="0 1 0" range="-1.5 1.5" limited="true" damping="1" armature=".05"/>
            <geom type="capsule" fromto="0 0 .02 0 0 .25" size=".03" mass="1.2"/>
            <body pos="0 0 .27"><joint name="elbow" axis="0 1 0" range="-2.3 2.3" limited="true" damping=".6" armature=".03"/>
              <geom type="capsule" fromto="0 0 .03 0 0 .22" size=".025" mass=".8"/></body></body></worldbody>
          <actuator><position joint="lift" kp="{kp}" ctrllimited="true" ctrlrange="-1.5 1.5"/>
            <position joint="elbow" kp="{}" ctrllimited="true" ctrlrange="-2.3 2.3"/></actuator></mujoco>"#,
            kp / 2
        );
        let (ran, bot) = import("arm.xml", &arm);
        let keys: &[(u32, &[f64])] = &[(0, &[0.0, 0.0]), (30, &[0.6, -0.8]), (60, &[-0.4, 0.9])];
        let of = |policy| precision(ran.dir.path(), &bot, keys, policy);
        let (pd, ct) = (of("pd+smooth"), of("computed-torque+smooth"));
        assert!(ct < most * pd, "{kp}: {ct} {pd}");
    }
}

#[test]
fn a_tendon_without_an_actuator_is_no_trouble() {
    let text = WRIST
        .replace("RIGHT", "")
        .replace(r#"<motor tendon="left" ctrllimited="true" ctrlrange="-4 4"/>"#, "");
    let dir = tempfile::tempdir().unwrap();
    std::fs::create_dir(dir.path().join("bot")).unwrap();
    std::fs::write(dir.path().join("bot/robot.xml"), text).unwrap();
    let profile = "format = \"robert-robot/1\"\nid = \"bot\"\n";
    std::fs::write(dir.path().join("bot/profile.toml"), profile).unwrap();
    let (code, _, stderr) = call(dir.path(), &["robots", "show", "bot"]);
    assert_eq!(code, 0, "{stderr}");
}

#[test]
fn a_limit_that_is_ten_thousand_times_what_it_takes_is_a_placeholder() {
    let warned = |effort: f64, mass: f64| {
        let hub = format!(
            r#"<robot name="hub"><link name="base"/><link name="wheel"><inertial><origin xyz=".002 0 0"/><mass value="{mass}"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
            <joint name="steer" type="revolute"><parent link="base"/><child link="wheel"/><axis xyz="0 1 0"/><limit lower="-.5" upper=".5" effort="{effort}" velocity="3"/></joint></robot>"#
        );
        import("hub.urdf", &hub).0.stdout
    };
    assert!(warned(300.0, 0.1).contains("if these limits are placeholders"));
    assert!(!warned(8.0, 0.1).contains("placeholders"));
    assert!(warned(9e5, 1e5).contains("weigh 100000 kg"));
}

#[test]
fn millimetres_are_recognised() {
    let arm = |x: f64| {
        format!(
            r#"<mujoco><compiler angle="radian" autolimits="true"/><worldbody><body pos="0 0 .5"><joint name="a" axis="0 0 1" range="-2 2" damping="1"/>
            <geom type="box" size=".1 .02 .02"/><body name="fore" pos="{x} 0 0"><joint name="b" axis="0 0 1" range="-2 2" damping="1"/>
            <geom type="box" size=".1 .02 .02"/><site name="tool" pos=".2 0 0"/></body></body></worldbody>
            <actuator><motor joint="a" ctrlrange="-20 20"/><motor joint="b" ctrlrange="-20 20"/></actuator></mujoco>"#
        )
    };
    let (far, _) = import("far.xml", &arm(200.0));
    let said = "the body \\\"fore\\\" is 200 m away from its parent: lengths are in metres";
    assert!(far.stdout.contains(said), "{}", far.stdout);
    let (near, bot) = import("near.xml", &arm(0.2));
    assert!(!near.stdout.contains("away from its parent"));
    let check = |pos| {
        let mut clip = Clip::new(bot.clip_ref(), 40);
        let goal = Reach { point: Point::Site("tool".into()), pos, quat: None };
        clip.keys = vec![Key { reach: vec![goal], ..Key::with(20, Goal::Open) }];
        clip.save(&near.dir.path().join("r.clip.json")).unwrap();
        call(near.dir.path(), &["clip", "check", "r.clip.json"]).1
    };
    let hint = "divide millimetres by 1000";
    assert!(check([300.0, 200.0, 500.0]).contains(hint), "{}", check([300.0, 200.0, 500.0]));
    let metres = check([3.0, 2.0, 0.5]);
    assert!(metres.contains("from its goal") && !metres.contains(hint), "{metres}");
}
