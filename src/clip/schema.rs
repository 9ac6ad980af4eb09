//! The published JSON Schema (2020-12) of `robert-clip/1`.
//!
//! It is generated from structs that mirror the document, so that an editor shows the same texts as
//! the Rust docs. The reader does not use it, because a schema cannot express "inside `length`" and
//! its errors have no line.

use std::collections::BTreeMap;

use schemars::{JsonSchema, Schema, SchemaGenerator, generate::SchemaSettings};
use serde::Deserialize;
use serde_json::Value;

use super::document::Fill;
use super::tangent::Tangent;
use robert_base::units::Unit;

/// The schema as JSON.
pub fn schema() -> Value {
    let mut generator = SchemaGenerator::new(SchemaSettings::draft2020_12());
    let mut schema: Schema = generator.root_schema_for::<Clip>();
    schema.insert("title".to_owned(), Value::from("robert-clip/1"));
    let mut value = schema.to_value();
    without_null(&mut value);
    value
}

/// Optional means absent: the reader does not accept `null` for a missing member, but `Option`
/// fields are generated as nullable. Array items stay nullable (a joint without a goal).
fn without_null(schema: &mut Value) {
    match schema {
        Value::Object(map) => {
            if let Some(Value::Object(properties)) = map.get_mut("properties") {
                properties.values_mut().for_each(not_null);
            }
            map.values_mut().for_each(without_null);
        }
        Value::Array(items) => items.iter_mut().for_each(without_null),
        _ => {}
    }
}

fn not_null(property: &mut Value) {
    let Value::Object(property) = property else { return };
    if let Some(Value::Array(types)) = property.get_mut("type") {
        types.retain(|t| t != "null");
        if let [one] = types.as_slice() {
            let one = one.clone();
            property.insert("type".to_owned(), one);
        }
    }
    let Some(Value::Array(choices)) = property.get_mut("anyOf") else { return };
    choices.retain(|c| c.get("type").is_none_or(|t| t != "null"));
    if let [Value::Object(one)] = choices.as_slice() {
        let one = one.clone();
        property.remove("anyOf");
        property.extend(one);
    }
}

/// A keyframe animation for a torque-controlled robot: which poses it should reach and when, and
/// which frames are left to the policy.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[allow(dead_code, missing_debug_implementations)] // only its shape is used
pub struct Clip {
    /// Name and major version of this format.
    format: Format,
    /// A title.
    #[schemars(length(max = 256))]
    name: Option<String>,
    /// Remarks.
    #[schemars(length(max = 65536))]
    notes: Option<String>,
    /// The robot that the clip was made for.
    robot: Robot,
    /// Frames per second; always 20.
    #[schemars(range(min = 20, max = 20))]
    fps: u32,
    /// Number of frames.
    #[schemars(range(min = 1, max = 100_000))]
    length: u32,
    /// The fill after keys without their own, up to the next key of each joint: mask (nothing), linear, cubic or
    /// hold.
    fill: Option<Fill>,
    /// The state before frame 0; without it, the values of the first key.
    start: Option<Start>,
    /// Named poses: one value per joint, or null for a joint that the pose says nothing about.
    #[schemars(extend("propertyNames" = {"minLength": 1, "maxLength": 256}))]
    poses: Option<BTreeMap<String, Row>>,
    /// Keyframes, at most one per frame.
    #[schemars(length(max = 50_000))]
    keys: Vec<Key>,
    /// Values that are added to the command of the keys, at most one offset per frame.
    #[schemars(length(max = 50_000))]
    offsets: Option<Vec<Offset>>,
    /// Spans without a goal, regardless of keys and fills.
    #[schemars(length(max = 50_000))]
    masks: Option<Vec<Mask>>,
    /// Named moments and blocks, at most one per frame.
    #[schemars(length(max = 50_000))]
    markers: Option<Vec<Marker>>,
    /// Extensions of other programs; kept, never read.
    x: Option<BTreeMap<String, Value>>,
}

/// The JSON shapes of the parts of a document, for every place where they are sent.
macro_rules! shaped {
    ($($room:ident::$part:ident),*) => {$(
        impl JsonSchema for super::$room::$part {
            fn schema_name() -> std::borrow::Cow<'static, str> {
                <$part as JsonSchema>::schema_name()
            }
            fn schema_id() -> std::borrow::Cow<'static, str> {
                <$part as JsonSchema>::schema_id()
            }
            fn json_schema(generator: &mut SchemaGenerator) -> Schema {
                <$part as JsonSchema>::json_schema(generator)
            }
        }
    )*};
}

shaped!(
    offset::Offset,
    document::Key,
    document::Mask,
    document::Marker,
    document::Start,
    reach::Reach
);

#[derive(Deserialize, JsonSchema)]
#[allow(dead_code)]
enum Format {
    #[serde(rename = "robert-clip/1")]
    One,
}

/// Joint values in the order of `robot.joints`; null says nothing about a joint, whose holds and fills go on.
#[derive(Deserialize, JsonSchema)]
#[allow(dead_code)]
struct Row(#[schemars(length(min = 1, max = 256))] Vec<Option<Number>>);

/// Radians or metres.
#[derive(Deserialize, JsonSchema)]
#[allow(dead_code)]
struct Number(#[schemars(range(min = -1e6, max = 1e6))] f64);

/// The robot that a clip was made for.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)]
struct Robot {
    /// Its id, such as ur5e.
    #[schemars(length(min = 1, max = 256))]
    id: String,
    /// Path of its model.
    #[schemars(length(min = 1, max = 256))]
    model: Option<String>,
    /// Sha-256 of that model.
    #[schemars(regex(pattern = "^[0-9a-fA-F]{64}$"))]
    model_sha256: Option<String>,
    /// Joint names; all rows follow this order.
    #[schemars(length(min = 1, max = 256), extend("uniqueItems" = true))]
    joints: Vec<Name>,
    /// Units of the joints.
    #[schemars(length(max = 256))]
    units: Option<Vec<Unit>>,
}

#[derive(Deserialize, JsonSchema)]
#[allow(dead_code)]
struct Name(#[schemars(length(min = 1, max = 256))] String);

/// Exactly one of a named pose and values.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(extend("oneOf" = [{"required": ["pose"]}, {"required": ["q"]}]))]
#[allow(dead_code)]
struct Start {
    /// A named pose of this clip.
    pose: Option<String>,
    /// One value per joint.
    #[schemars(length(min = 1, max = 256))]
    q: Option<Vec<Number>>,
}

/// A keyframe: a named pose, values, or end-effector goals. If it has `reach` and also a pose or
/// values, the robot stays near these.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(extend(
    "anyOf" = [{"required": ["pose"]}, {"required": ["q"]}, {"required": ["reach"]}],
    "not" = {"required": ["pose", "q"]}
))]
#[allow(dead_code)]
struct Key {
    /// The frame of the key, from 0.
    #[schemars(range(min = 0, max = 99_999))]
    frame: u32,
    /// A named pose of this clip.
    pose: Option<String>,
    /// Values, one per joint.
    q: Option<Row>,
    /// End-effector goals: positions that points of the robot should reach.
    #[schemars(length(min = 1, max = 4096))]
    reach: Option<Vec<Reach>>,
    /// The number of frames for which the values are commanded; 1 when absent. The next key with a value for a joint
    /// ends the hold of this joint.
    #[schemars(range(min = 1, max = 100_000))]
    hold: Option<u32>,
    /// The fill after the hold, for each joint up to the next key with a value for it; the clip's `fill` when
    /// absent.
    fill: Option<Fill>,
    /// Slopes of cubic curves at this key, by joint: "flat", "linear", or rad/s or m/s; automatic
    /// when absent.
    #[schemars(extend("propertyNames" = {"minLength": 1, "maxLength": 256}))]
    tangents: Option<BTreeMap<String, Tangent>>,
    /// A remark.
    #[schemars(length(max = 256))]
    note: Option<String>,
}

/// An end-effector goal: the position that a site, or a point of a body, should have in the world.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(extend(
    "oneOf" = [{"required": ["site"]}, {"required": ["body"]}],
    "dependentRequired" = {"offset": ["body"]}
))]
#[allow(dead_code)]
struct Reach {
    /// The site.
    #[schemars(length(min = 1, max = 256))]
    site: Option<String>,
    /// The body whose point it is.
    #[schemars(length(min = 1, max = 256))]
    body: Option<String>,
    /// The point in the body's frame, m; its origin when absent.
    offset: Option<[Number; 3]>,
    /// Position in the world, m.
    pos: [Number; 3],
    /// Orientation in the world, w x y z; free when absent.
    quat: Option<[Number; 4]>,
}

/// Values that are added to the command around one frame: they grow, are held, and fade.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)]
struct Offset {
    /// The first frame at which the values are added in full.
    #[schemars(range(min = 0, max = 99_999))]
    frame: u32,
    /// What is added, by joint, rad or m.
    #[schemars(extend("propertyNames" = {"minLength": 1, "maxLength": 256}, "minProperties" = 1))]
    add: BTreeMap<String, Number>,
    /// The number of frames over which it grows; 10 when absent, 0 = at once.
    #[serde(rename = "in")]
    #[schemars(range(min = 0, max = 100_000))]
    fade_in: Option<u32>,
    /// The number of frames for which the values are added in full; 1 when absent.
    #[schemars(range(min = 1, max = 100_000))]
    hold: Option<u32>,
    /// The number of frames over which it fades; 10 when absent, 0 = at once.
    #[serde(rename = "out")]
    #[schemars(range(min = 0, max = 100_000))]
    fade_out: Option<u32>,
}

/// Frames from..to (to excluded) without a goal.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)]
struct Mask {
    /// First masked frame.
    #[schemars(range(min = 0, max = 99_999))]
    from: u32,
    /// First frame after it.
    #[schemars(range(min = 1, max = 100_000))]
    to: u32,
    /// Only these joints; all when absent.
    #[schemars(length(min = 1, max = 256), extend("uniqueItems" = true))]
    joints: Option<Vec<Name>>,
}

/// A named moment, or with `to` a named block of frames.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)]
struct Marker {
    /// The frame of the marker.
    #[schemars(range(min = 0, max = 99_999))]
    frame: u32,
    /// Its name.
    #[schemars(length(min = 1, max = 256))]
    name: String,
    /// First frame after the block; a moment when absent.
    #[schemars(range(min = 1, max = 100_000))]
    to: Option<u32>,
}
