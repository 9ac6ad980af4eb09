//! The published schema agrees with the reader wherever a schema can.

use robert::clip::{Clip, schema};
use serde_json::{Value, json};

use super::generate;
use crate::run::robert;

#[test]
fn printed_schema_is_draft_2020_12() {
    let printed = robert().args(["clip", "schema"]).succeeds().json();
    assert_eq!(printed, schema());
    assert_eq!(printed["$schema"], "https://json-schema.org/draft/2020-12/schema");
    jsonschema::meta::validate(&printed).unwrap();
}

#[test]
fn every_generated_clip_satisfies_it() {
    let validator = jsonschema::validator_for(&schema()).unwrap();
    for seed in 0..300 {
        let value = generate::clip(seed).to_json();
        if let Err(e) = validator.validate(&value) {
            panic!("{e} at {}: {value}", e.instance_path());
        }
    }
}

#[test]
fn good_and_bad_files() {
    let validator = jsonschema::validator_for(&schema()).unwrap();
    let good = json!({
        "format": "robert-clip/1",
        "robot": {"id": "r", "joints": ["a", "b"], "units": ["rad", "m"]},
        "fps": 20, "length": 50, "fill": "linear",
        "start": {"q": [0, 1]},
        "poses": {"up": [0.5, null]},
        "keys": [{"frame": 0, "q": [0, null], "fill": "cubic", "hold": 3,
            "tangents": {"a": "flat", "b": {"in": 1, "out": -0.5}}}, {"frame": 9, "pose": "up", "tangents": {"a": 2.5, "b": "linear"}},
            {"frame": 12, "reach": [{"site": "tip", "pos": [0, 1, 2], "quat": [1, 0, 0, 0]}]},
            {"frame": 14, "q": [0, 0], "reach": [{"body": "b", "offset": [0, 0, 1], "pos": [0, 1, 2]}]}],
        "offsets": [{"frame": 9, "add": {"a": 0.5}}, {"frame": 12, "add": {"b": -1}, "in": 0, "hold": 3, "out": 4}],
        "masks": [{"from": 1, "to": 3, "joints": ["a"]}],
        "markers": [{"frame": 9, "name": "m"}, {"frame": 12, "to": 40, "name": "block"}],
        "x": {"anything": [1, {"b": 2}]}
    });
    let reads = |v: &Value| Clip::parse(&v.to_string()).is_ok();
    assert!(validator.is_valid(&good) && reads(&good));
    let bad = [
        ("/keys/0/frame", json!(-1)),
        ("/keys/0/frame", json!(1.5)),
        ("/keys/0/hold", json!(0)),
        ("/keys/0/fill", json!("spline")),
        ("/keys/0", json!({"frame": 0})),
        ("/keys/0", json!({"frame": 0, "q": [0, 0], "pose": "up"})),
        ("/keys/0", json!({"frame": 0, "q": [0, 0], "ease": 1})),
        ("/keys/0/q/0", json!("0")),
        ("/keys/0/q/0", json!(2e6)),
        ("/keys/2/reach", json!([])),
        ("/keys/2/reach/0", json!({"site": "tip"})),
        ("/keys/2/reach/0", json!({"pos": [0, 1, 2]})),
        ("/keys/2/reach/0", json!({"site": "tip", "body": "b", "pos": [0, 1, 2]})),
        ("/keys/2/reach/0", json!({"site": "tip", "offset": [0, 0, 0], "pos": [0, 1, 2]})),
        ("/keys/2/reach/0/pos", json!([0, 1])),
        ("/keys/2/reach/0/pos", json!([0, 1, 2, 3])),
        ("/keys/2/reach/0/pos/0", json!(2e6)),
        ("/keys/2/reach/0/quat", json!([0, 1, 2])),
        ("/keys/0/tangents", json!(["flat"])),
        ("/keys/0/tangents/a", json!("auto")),
        ("/keys/0/tangents/a", json!(null)),
        ("/keys/0/tangents/a", json!(2e6)),
        ("/keys/0/tangents/b", json!({"in": 1})),
        ("/keys/0/tangents/b", json!({"in": 1, "out": 1, "ease": 1})),
        ("/format", json!("robert-clip/2")),
        ("/fps", json!(30)),
        ("/length", json!(0)),
        ("/length", json!(100_001)),
        ("/fill", json!(null)),
        ("/robot", json!({"id": "r"})),
        ("/robot/joints", json!([])),
        ("/robot/joints", json!(["a", "a"])),
        ("/robot/units", json!(["deg", "m"])),
        ("/start", json!({"q": [0, null]})),
        ("/start", json!({})),
        ("/offsets/0/add", json!({})),
        ("/offsets/0/add", json!({"a": null})),
        ("/offsets/0/add/a", json!(2e6)),
        ("/offsets/0", json!({"add": {"a": 1}})),
        ("/offsets/0", json!({"frame": 9})),
        ("/offsets/1/hold", json!(0)),
        ("/offsets/1/in", json!(-1)),
        ("/offsets/1/out", json!(100_001)),
        ("/markers/1/to", json!(0)),
        ("/masks/0/to", json!(0)),
        ("/masks/0/joints", json!([])),
        ("/markers/0/name", json!("")),
        ("/x", json!([])),
    ];
    for (pointer, value) in bad {
        let mut doc = good.clone();
        *doc.pointer_mut(pointer).unwrap() = value.clone();
        assert!(!validator.is_valid(&doc), "the schema lets {pointer} = {value} pass");
        assert!(!reads(&doc), "the reader lets {pointer} = {value} pass");
    }
    for required in ["format", "robot", "fps", "length", "keys"] {
        let mut doc = good.clone();
        doc.as_object_mut().unwrap().remove(required);
        assert!(!validator.is_valid(&doc) && !reads(&doc), "{required}");
    }
}
