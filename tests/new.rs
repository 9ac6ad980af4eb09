//! `robert new`, from a file to a policy that performs.

use std::path::Path;

use crate::run::{call, robert};

const ARM: &str = r#"<mujoco><worldbody><body name="arm" pos="0 0 1">
    <joint name="lift" axis="0 1 0" range="-60 60" limited="true" damping=".4" armature=".05"/>
    <geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass=".5"/></body></worldbody>
  <actuator><motor joint="lift" gear="4" ctrlrange="-1 1"/></actuator></mujoco>"#;

#[test]
fn a_file_becomes_a_policy_and_the_same_command_finds_it_again() {
    let make =
        ["new", "arm.xml", "--out", "bot", "--minutes", "0", "--transitions", "10k", "--json"];
    let ran = robert().file("arm.xml", ARM).args(make).succeeds();
    let first = ran.json();
    let error = |policy: &str| first["precision"][policy].as_f64().unwrap();
    let kept = first["kept"].as_str().unwrap();
    assert!(["pd", "ridge"].contains(&kept), "{kept}");
    assert!(error("pd").min(error("ridge")) < 0.005, "{first}");
    assert!(error(kept) <= 1.5 * error("pd").min(error("ridge")), "{first}");

    // What is there is used, so the figures have the same digits.
    let dir = ran.dir.path();
    let shards = |dir: &Path| -> Vec<_> {
        let files = dir.join("bot/data/shards").read_dir().unwrap().map(|e| e.unwrap().path());
        let mut shards: Vec<_> = files.collect();
        shards.sort();
        shards.iter().map(|f| f.metadata().unwrap().modified().unwrap()).collect()
    };
    let before = shards(dir);
    assert!(!before.is_empty());
    let (code, stdout, stderr) = call(dir, &make);
    assert_eq!(code, 0, "{stderr}");
    let again: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(again["precision"], first["precision"]);
    assert_eq!(again["kept"], first["kept"]);
    assert!(before == shards(dir), "collected again");
}
