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
    assert_eq!(first["precision"].get("robert"), Some(&serde_json::Value::Null), "not trained");
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

    // A model that cannot be read is not a missing one: `auto` does not go on without it.
    let clip = r#"{"format": "robert-clip/1", "fps": 20, "length": 21, "robot": {"id": "bot",
        "joints": ["lift"], "units": ["rad"]}, "keys": [{"frame": 0, "hold": 21, "q": [0.3]}]}"#;
    std::fs::write(dir.join("a.clip.json"), clip).unwrap();
    let rollout = ["rollout", "a.clip.json", "--robot", "bot"];
    assert_eq!(call(dir, &rollout).0, 0);
    std::fs::write(dir.join("bot/models/robert.safetensors"), "torn").unwrap();
    let (code, _, stderr) = call(dir, &rollout);
    assert!(code == 3 && stderr.contains("robert.safetensors"), "{code} {stderr}");
}

#[test]
fn a_wrong_preset_is_refused_before_any_work() {
    let ran =
        robert().file("arm.xml", ARM).args(["new", "arm.xml", "--out", "bot", "--preset", "hug"]);
    let ran = ran.fails(2);
    assert!(ran.stderr.contains("hug") && ran.stderr.contains("quick"), "{}", ran.stderr);
    assert!(!ran.path("bot").exists());
}
