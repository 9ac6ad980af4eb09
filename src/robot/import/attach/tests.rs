//! Models that attach models, as the simulator sees them.

use std::path::PathBuf;
use std::sync::Arc;

use super::*;
use robert_mujoco::{Data, Kind, Model};

const ARM: &str = r#"<mujoco model="arm"><compiler angle="radian" eulerseq="zyx" meshdir="shapes" inertiagrouprange="0 2"/>
  <default><geom density="500"/><joint damping="3"/><default class="slow"><joint damping="30" range="-1 1"/></default></default>
  <asset><mesh file="hull.obj"/></asset>
  <worldbody><geom name="floor" type="plane" size="1 1 1"/>
    <body name="upper" pos="0 0 1" euler=".5 .2 .1"><joint name="j" class="slow"/><geom name="g" size=".1"/><geom size=".2" group="3"/>
      <geom type="mesh" mesh="hull" pos="0 0 .3" mass="0"/><site name="tip" pos="0 0 .5"/></body>
    <body name="other"><joint name="k" type="slide" range="-.2 .2"/><geom size=".1"/></body></worldbody>
  <actuator><motor name="m" joint="j"/><motor name="mk" joint="k"/></actuator>
  <keyframe><key name="home" qpos=".3 .1" ctrl="0 0"/></keyframe></mujoco>"#;

/// A folder with the arm in a folder of its own, and a model that attaches it.
fn scene(model: &str) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    std::fs::create_dir_all(dir.path().join("arm/shapes")).unwrap();
    std::fs::write(dir.path().join("arm/arm.xml"), ARM).unwrap();
    let hull = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    std::fs::write(dir.path().join("arm/shapes/hull.obj"), hull).unwrap();
    let path = dir.path().join("scene.xml");
    std::fs::write(&path, model).unwrap();
    (dir, path)
}

/// The model as it is compiled; its mesh file by its path.
fn compiled(path: &Path) -> Arc<Model> {
    let (project, _) = read(path, None, MissingFiles::Refuse).unwrap();
    let (flat, _) = modern::flatten(project.xml, path, "").unwrap();
    let flat = flat.replace("arm/shapes", &path.with_file_name("arm/shapes").to_string_lossy());
    let at = flat.rfind("</mujoco>").unwrap();
    let (head, tail) = flat.split_at(at);
    let text = format!("{head}<compiler autolimits=\"true\"/>{tail}");
    Arc::new(Model::from_xml(&text).unwrap())
}

fn near(got: &[f64], want: &[f64]) {
    assert!(
        got.len() == want.len() && got.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-5),
        "{got:?} {want:?}"
    );
}

#[test]
fn an_attached_model_keeps_its_terms() {
    let (_dir, path) = scene(
        r#"<mujoco><compiler angle="degree"/><default><geom density="100"/><joint armature=".1" damping="7"/></default>
        <asset><model name="a" file="arm/arm.xml"/></asset>
        <worldbody><geom name="own" size=".1"/><body name="base"><joint name="own"/><geom size=".1"/>
          <frame pos="1 0 0" euler="0 0 90"><attach model="a" prefix="left-" body="upper"/></frame></body>
          <attach model="a" prefix="right-"/></worldbody></mujoco>"#,
    );
    let model = compiled(&path);
    let joint = |name: &str| model.id(Kind::Joint, name).unwrap();
    assert_eq!(model.njnt(), 4);
    assert_eq!(model.nu(), 3);
    // Radians and a class of the attached model; what the other model says of joints does not count.
    near(&model.jnt_range()[2 * joint("left-j")..2 * joint("left-j") + 2], &[-1.0, 1.0]);
    near(&model.jnt_range()[2 * joint("right-k")..2 * joint("right-k") + 2], &[-0.2, 0.2]);
    let damping = ["own", "left-j", "right-j", "right-k"].map(|j| model.dof_damping()[joint(j)]);
    near(&damping, &[7.0, 30.0, 30.0, 3.0]);
    let armature = ["own", "left-j", "right-k"].map(|j| model.dof_armature()[joint(j)]);
    near(&armature, &[0.1, 0.0, 0.0]);
    // A ball of .1 m with 500 kg/m³; that of group 3 does not weigh.
    let body = |name: &str| model.id(Kind::Body, name).unwrap();
    let ball = 4.0 / 3.0 * std::f64::consts::PI * 0.001;
    near(&[model.body_mass()[body("left-upper")]], &[500.0 * ball]);
    near(&[model.body_mass()[body("base")]], &[100.0 * ball]);
    let mut data = Data::new(&model).unwrap();
    data.kinematics().unwrap();
    let at = |name: &str| data.xpos()[3 * body(name)..3 * body(name) + 3].to_vec();
    near(&at("left-upper"), &[1.0, 0.0, 1.0]);
    near(&at("right-upper"), &[0.0, 0.0, 1.0]);
    // z, y, x in radians: .5 about z, then .2 about y, then .1 about x.
    let quat = &data.xquat()[4 * body("right-upper")..4 * body("right-upper") + 4];
    near(quat, &[0.964_102, 0.023_515, 0.108_912, 0.241_026]);
}

#[test]
fn a_joint_in_a_frame_keeps_its_terms_as_well() {
    let (_dir, path) = scene(
        r#"<mujoco><compiler angle="degree"/><asset><model name="a" file="arm/arm.xml"/></asset>
        <worldbody><geom name="own" size=".1"/><attach model="a" prefix="a-"/></worldbody></mujoco>"#,
    );
    let plain = compiled(&path);
    let joint = r#"<joint name="j" class="slow"/>"#;
    let framed = ARM.replace(joint, &format!("<frame>{joint}</frame>"));
    std::fs::write(path.with_file_name("arm/arm.xml"), framed).unwrap();
    let framed = compiled(&path);
    near(framed.jnt_range(), plain.jnt_range());
    near(&framed.jnt_range()[..2], &[-1.0, 1.0]);
    near(framed.jnt_axis(), plain.jnt_axis());
    near(framed.dof_damping(), plain.dof_damping());
}

#[test]
fn keyframes_come_along_where_nothing_else_moves() {
    let text = |more: &str| {
        format!(
            "<mujoco><asset><model file=\"arm/arm.xml\"/></asset><worldbody>{more}<attach model=\"arm\" prefix=\"\"/></worldbody></mujoco>"
        )
    };
    let (_dir, path) = scene(&text(""));
    assert!(
        read(&path, None, MissingFiles::Refuse)
            .unwrap()
            .0
            .xml
            .contains("<key name=\"home\" qpos=\".3 .1\" />")
    );
    assert_eq!(compiled(&path).nq(), 2);
    let (_dir, path) = scene(&text("<body><joint/><geom size=\".1\"/></body>"));
    assert!(!read(&path, None, MissingFiles::Refuse).unwrap().0.xml.contains("<key"));
}

#[test]
fn a_part_of_the_model_itself_can_be_attached() {
    let (_dir, path) = scene(
        r#"<mujoco><worldbody><body name="leg"><joint name="hip"/><geom size=".1"/></body>
        <frame pos="1 0 0"><attach body="leg" prefix="second_"/></frame></worldbody>
        <actuator><motor joint="hip"/></actuator></mujoco>"#,
    );
    let model = compiled(&path);
    assert_eq!((model.njnt(), model.nu()), (2, 2));
    assert!(model.id(Kind::Joint, "second_hip").is_some());
}

#[test]
fn what_cannot_be_attached_names_its_place() {
    let fails = |model: &str, what: &str| {
        let (_dir, path) = scene(model);
        let message = read(&path, None, MissingFiles::Refuse).unwrap_err().to_string();
        assert!(message.contains(what) && message.contains("scene.xml:2:"), "{message}");
    };
    fails(
        "<mujoco><asset><model name=\"a\" file=\"arm/arm.xml\"/></asset><worldbody>\n<attach model=\"b\" prefix=\"x\"/></worldbody></mujoco>",
        "there are: \"a\"",
    );
    fails(
        "<mujoco><asset><model name=\"a\" file=\"arm/arm.xml\"/></asset><worldbody>\n<attach model=\"a\" body=\"hand\" prefix=\"x\"/></worldbody></mujoco>",
        "\"hand\"",
    );
    fails(
        "<mujoco><asset>\n<model name=\"a\" file=\"../arm.xml\"/></asset><worldbody/></mujoco>",
        "--root",
    );
    fails(
        "<mujoco><asset>\n<model name=\"a\" file=\"scene.xml\"/></asset><worldbody/></mujoco>",
        "deep",
    );
}

#[test]
fn attached_models_bind_at_the_cap() {
    let models = |count: usize| {
        let model = |i| format!("<model name=\"m{i}\" file=\"arm/arm.xml\"/>");
        let all: String = (0..count).map(model).collect();
        scene(&format!("<mujoco><asset>{all}</asset><worldbody/></mujoco>"))
    };
    let (_dir, path) = models(limits::ATTACHED_MODELS);
    assert!(read(&path, None, MissingFiles::Refuse).is_ok());
    let (_dir, path) = models(limits::ATTACHED_MODELS + 1);
    assert!(read(&path, None, MissingFiles::Refuse).unwrap_err().to_string().contains("in all"));
}

#[test]
fn what_belongs_to_replicas_and_inertias_stays_with_them() {
    let arm = ARM
        .replace("inertiagrouprange", "inertiafromgeom=\"true\" inertiagrouprange")
        .replace(
            "<site name=\"tip\" pos=\"0 0 .5\"/>",
            "<inertial pos=\"0 0 0\" mass=\"9\" diaginertia=\"1 1 1\"/><replicate count=\"2\" euler=\"0 0 1.5\">\
             <body pos=\"1 0 0\"><joint name=\"r\"/><geom size=\".1\"/></body></replicate>",
        )
        .replace("<actuator>", "<actuator><motor name=\"m1\" joint=\"r1\"/>")
        .replace("qpos=\".3 .1\"", "qpos=\".3 0 0 .1\"");
    let (dir, path) = scene(
        "<mujoco><asset><model name=\"a\" file=\"arm/arm.xml\"/></asset><worldbody><body name=\"base\">\
         <inertial pos=\"0 0 0\" mass=\"55\" diaginertia=\"1 1 1\"/><joint/><geom size=\".1\" group=\"4\"/>\
         <attach model=\"a\" body=\"upper\" prefix=\"x\"/></body></worldbody></mujoco>",
    );
    std::fs::write(dir.path().join("arm/arm.xml"), arm).unwrap();
    let model = compiled(&path);
    let mass = |name: &str| model.body_mass()[model.id(Kind::Body, name).unwrap()];
    let ball = 4.0 / 3.0 * std::f64::consts::PI * 0.001;
    near(&[mass("base"), mass("xupper")], &[55.0, 500.0 * ball]);
    // The motors of the upper arm and of the second replica.
    assert_eq!((model.nu(), model.njnt()), (2, 4));
    assert!(model.id(Kind::Joint, "xr1").is_some());
    let (_dir, path) = scene(
        "<mujoco><asset><model name=\"a\" file=\"arm/arm.xml\"/></asset><worldbody>\n\
         <replicate count=\"2\"><attach model=\"a\" prefix=\"x\"/></replicate></worldbody></mujoco>",
    );
    let message = read(&path, None, MissingFiles::Refuse).unwrap_err().to_string();
    assert!(message.contains("inside of a <replicate>"), "{message}");
}

#[test]
fn models_that_attach_models_keep_their_classes_apart() {
    let (dir, path) = scene(
        "<mujoco><asset><model name=\"m\" file=\"middle.xml\"/></asset><worldbody>\
         <attach model=\"m\" prefix=\"\"/></worldbody></mujoco>",
    );
    let middle = "<mujoco><default><joint damping=\"5\"/></default><asset><model name=\"a\" file=\"arm/arm.xml\"/></asset>\
         <worldbody><body name=\"world_of_its_own\"><joint name=\"world\"/><geom size=\".1\"/></body>\
         <attach model=\"a\" prefix=\"\"/></worldbody></mujoco>";
    std::fs::write(dir.path().join("middle.xml"), middle).unwrap();
    let model = compiled(&path);
    let damping = |name: &str| model.dof_damping()[model.id(Kind::Joint, name).unwrap()];
    near(&[damping("world"), damping("j"), damping("k")], &[5.0, 30.0, 3.0]);
}
