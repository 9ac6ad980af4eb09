//! The protobuf messages of a take and their descriptors.
//!
//! Field numbers are those of the public foxglove schemas. A file must contain its schemas as a
//! `FileDescriptorSet`, which is built here from a table instead of by a protobuf compiler at build
//! time.

use prost::Message as _;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{
    DescriptorProto, EnumDescriptorProto, EnumValueDescriptorProto, FieldDescriptorProto,
    FileDescriptorProto, FileDescriptorSet, OneofDescriptorProto, Timestamp,
};

macro_rules! messages {
    ($($(#[$of:meta])* $name:ident { $($(#[$doc:meta])* $field:ident: $ty:ty = ($($kind:tt)+),)* })*) => {$(
        $(#[$of])*
        #[derive(Clone, PartialEq, prost::Message)]
        pub(super) struct $name {
            $($(#[$doc])* #[prost($($kind)+)] pub $field: $ty,)*
        }
    )*};
}

messages! {
    #[derive(Copy)]
    Vector3 {
        x: f64 = (double, tag = "1"),
        y: f64 = (double, tag = "2"),
        z: f64 = (double, tag = "3"),
    }
    /// x, y, z, w: not the simulator's order.
    #[derive(Copy)]
    Quaternion {
        x: f64 = (double, tag = "1"),
        y: f64 = (double, tag = "2"),
        z: f64 = (double, tag = "3"),
        w: f64 = (double, tag = "4"),
    }
    #[derive(Copy)]
    Color {
        r: f64 = (double, tag = "1"),
        g: f64 = (double, tag = "2"),
        b: f64 = (double, tag = "3"),
        a: f64 = (double, tag = "4"),
    }
    #[derive(Copy)]
    Pose {
        position: Option<Vector3> = (message, optional, tag = "1"),
        orientation: Option<Quaternion> = (message, optional, tag = "2"),
    }
    FrameTransform {
        timestamp: Option<Timestamp> = (message, optional, tag = "1"),
        parent_frame_id: String = (string, tag = "2"),
        child_frame_id: String = (string, tag = "3"),
        translation: Option<Vector3> = (message, optional, tag = "4"),
        rotation: Option<Quaternion> = (message, optional, tag = "5"),
    }
    FrameTransforms {
        transforms: Vec<FrameTransform> = (message, repeated, tag = "1"),
    }
    #[derive(Copy)]
    CubePrimitive {
        pose: Option<Pose> = (message, optional, tag = "1"),
        size: Option<Vector3> = (message, optional, tag = "2"),
        color: Option<Color> = (message, optional, tag = "3"),
    }
    #[derive(Copy)]
    SpherePrimitive {
        pose: Option<Pose> = (message, optional, tag = "1"),
        size: Option<Vector3> = (message, optional, tag = "2"),
        color: Option<Color> = (message, optional, tag = "3"),
    }
    #[derive(Copy)]
    CylinderPrimitive {
        pose: Option<Pose> = (message, optional, tag = "1"),
        size: Option<Vector3> = (message, optional, tag = "2"),
        bottom_scale: f64 = (double, tag = "3"),
        top_scale: f64 = (double, tag = "4"),
        color: Option<Color> = (message, optional, tag = "5"),
    }
    TriangleListPrimitive {
        pose: Option<Pose> = (message, optional, tag = "1"),
        /// `foxglove.Point3` has the same fields.
        points: Vec<Vector3> = (message, repeated, tag = "2"),
        color: Option<Color> = (message, optional, tag = "3"),
        indices: Vec<u32> = (fixed32, repeated, tag = "5"),
    }
    SceneEntity {
        timestamp: Option<Timestamp> = (message, optional, tag = "1"),
        frame_id: String = (string, tag = "2"),
        id: String = (string, tag = "3"),
        frame_locked: bool = (bool, tag = "5"),
        cubes: Vec<CubePrimitive> = (message, repeated, tag = "8"),
        spheres: Vec<SpherePrimitive> = (message, repeated, tag = "9"),
        cylinders: Vec<CylinderPrimitive> = (message, repeated, tag = "10"),
        triangles: Vec<TriangleListPrimitive> = (message, repeated, tag = "12"),
    }
    SceneUpdate {
        entities: Vec<SceneEntity> = (message, repeated, tag = "2"),
    }
    Log {
        timestamp: Option<Timestamp> = (message, optional, tag = "1"),
        /// 2 info, 3 warning.
        level: i32 = (int32, tag = "2"),
        message: String = (string, tag = "3"),
        name: String = (string, tag = "4"),
    }
    JointError {
        joint: String = (string, tag = "1"),
        error: f64 = (double, tag = "2"),
    }
    /// Our own message, one per frame.
    Metrics {
        frame: u32 = (uint32, tag = "1"),
        /// Mean absolute error over the joints with a goal; absent if there is none.
        frame_mae: Option<f64> = (double, optional, tag = "2"),
        masked: bool = (bool, tag = "3"),
        /// Joints with a goal.
        joint_error: Vec<JointError> = (message, repeated, tag = "4"),
        /// Action taken at this frame; empty at the last.
        action: Vec<f64> = (double, repeated, tag = "5"),
        /// The action as controls, N m or N.
        ctrl: Vec<f64> = (double, repeated, tag = "6"),
    }
}

/// Message, then `name number type`; `*` = repeated, `?` = optional, `enum:` = an enum of
/// this message, anything unknown = a message of the package.
type Table = &'static [(&'static str, &'static str)];

const FOXGLOVE: Table = &[
    ("Vector3", "x 1 double, y 2 double, z 3 double"),
    ("Point3", "x 1 double, y 2 double, z 3 double"),
    ("Quaternion", "x 1 double, y 2 double, z 3 double, w 4 double"),
    ("Color", "r 1 double, g 2 double, b 3 double, a 4 double"),
    ("Pose", "position 1 Vector3, orientation 2 Quaternion"),
    ("KeyValuePair", "key 1 string, value 2 string"),
    (
        "FrameTransform",
        "timestamp 1 Timestamp, parent_frame_id 2 string, child_frame_id 3 string, \
         translation 4 Vector3, rotation 5 Quaternion",
    ),
    ("FrameTransforms", "transforms 1 *FrameTransform"),
    (
        "ArrowPrimitive",
        "pose 1 Pose, shaft_length 2 double, shaft_diameter 3 double, head_length 4 double, \
         head_diameter 5 double, color 6 Color",
    ),
    ("CubePrimitive", "pose 1 Pose, size 2 Vector3, color 3 Color"),
    ("SpherePrimitive", "pose 1 Pose, size 2 Vector3, color 3 Color"),
    (
        "CylinderPrimitive",
        "pose 1 Pose, size 2 Vector3, bottom_scale 3 double, top_scale 4 double, color 5 Color",
    ),
    (
        "LinePrimitive",
        "type 1 enum:Type=LINE_STRIP/LINE_LOOP/LINE_LIST, pose 2 Pose, thickness 3 double, \
         scale_invariant 4 bool, points 5 *Point3, color 6 Color, colors 7 *Color, \
         indices 8 *fixed32",
    ),
    (
        "TriangleListPrimitive",
        "pose 1 Pose, points 2 *Point3, color 3 Color, colors 4 *Color, indices 5 *fixed32",
    ),
    (
        "TextPrimitive",
        "pose 1 Pose, billboard 2 bool, font_size 3 double, scale_invariant 4 bool, \
         color 5 Color, text 6 string",
    ),
    (
        "ModelPrimitive",
        "pose 1 Pose, scale 2 Vector3, color 3 Color, override_color 4 bool, url 5 string, \
         media_type 6 string, data 7 bytes",
    ),
    ("SceneEntityDeletion", "timestamp 1 Timestamp, type 2 enum:Type=MATCHING_ID/ALL, id 3 string"),
    (
        "SceneEntity",
        "timestamp 1 Timestamp, frame_id 2 string, id 3 string, lifetime 4 Duration, \
         frame_locked 5 bool, metadata 6 *KeyValuePair, arrows 7 *ArrowPrimitive, \
         cubes 8 *CubePrimitive, spheres 9 *SpherePrimitive, cylinders 10 *CylinderPrimitive, \
         lines 11 *LinePrimitive, triangles 12 *TriangleListPrimitive, texts 13 *TextPrimitive, \
         models 14 *ModelPrimitive",
    ),
    ("SceneUpdate", "deletions 1 *SceneEntityDeletion, entities 2 *SceneEntity"),
    (
        "Log",
        "timestamp 1 Timestamp, level 2 enum:Level=UNKNOWN/DEBUG/INFO/WARNING/ERROR/FATAL, \
         message 3 string, name 4 string, file 5 string, line 6 fixed32",
    ),
];

const ROBERT: Table = &[
    ("JointError", "joint 1 string, error 2 double"),
    (
        "Metrics",
        "frame 1 uint32, frame_mae 2 ?double, masked 3 bool, joint_error 4 *JointError, \
         action 5 *double, ctrl 6 *double",
    ),
];

/// Descriptors of the foxglove messages.
pub(super) fn foxglove_schema() -> Vec<u8> {
    schema("foxglove", FOXGLOVE)
}

/// Descriptors of our own messages.
pub(super) fn robert_schema() -> Vec<u8> {
    schema("robert", ROBERT)
}

fn schema(package: &str, table: Table) -> Vec<u8> {
    let time = |name: &str| {
        let field = |name: &str, number, kind: Type| FieldDescriptorProto {
            name: Some(name.to_owned()),
            number: Some(number),
            label: Some(Label::Optional.into()),
            r#type: Some(kind.into()),
            json_name: Some(name.to_owned()),
            ..FieldDescriptorProto::default()
        };
        FileDescriptorProto {
            name: Some(format!("google/protobuf/{}.proto", name.to_lowercase())),
            package: Some("google.protobuf".to_owned()),
            message_type: vec![DescriptorProto {
                name: Some(name.to_owned()),
                field: vec![field("seconds", 1, Type::Int64), field("nanos", 2, Type::Int32)],
                ..DescriptorProto::default()
            }],
            syntax: Some("proto3".to_owned()),
            ..FileDescriptorProto::default()
        }
    };
    let times = [time("Timestamp"), time("Duration")];
    let own = FileDescriptorProto {
        name: Some(format!("{package}/take.proto")),
        package: Some(package.to_owned()),
        dependency: times.iter().filter_map(|t| t.name.clone()).collect(),
        message_type: table.iter().map(|(name, fields)| message(package, name, fields)).collect(),
        syntax: Some("proto3".to_owned()),
        ..FileDescriptorProto::default()
    };
    let file = times.into_iter().chain([own]).collect();
    FileDescriptorSet { file }.encode_to_vec()
}

fn message(package: &str, name: &str, fields: &str) -> DescriptorProto {
    let mut out = DescriptorProto { name: Some(name.to_owned()), ..DescriptorProto::default() };
    for field in fields.split(", ") {
        let mut words = field.split_whitespace();
        let (Some(label), Some(number), Some(kind)) = (words.next(), words.next(), words.next())
        else {
            continue;
        };
        let repeated = kind.starts_with('*');
        let optional = kind.starts_with('?');
        let kind = kind.trim_start_matches(['*', '?']);
        let mut proto = FieldDescriptorProto {
            name: Some(label.to_owned()),
            number: number.parse().ok(),
            label: Some(if repeated { Label::Repeated } else { Label::Optional }.into()),
            json_name: Some(camel(label)),
            ..FieldDescriptorProto::default()
        };
        let typed = |t: Type| Some(i32::from(t));
        match kind {
            "double" => proto.r#type = typed(Type::Double),
            "fixed32" => proto.r#type = typed(Type::Fixed32),
            "uint32" => proto.r#type = typed(Type::Uint32),
            "bool" => proto.r#type = typed(Type::Bool),
            "string" => proto.r#type = typed(Type::String),
            "bytes" => proto.r#type = typed(Type::Bytes),
            "Timestamp" | "Duration" => {
                proto.r#type = typed(Type::Message);
                proto.type_name = Some(format!(".google.protobuf.{kind}"));
            }
            _ => {
                if let Some((own, values)) =
                    kind.strip_prefix("enum:").and_then(|k| k.split_once('='))
                {
                    proto.r#type = typed(Type::Enum);
                    proto.type_name = Some(format!(".{package}.{name}.{own}"));
                    out.enum_type.push(enumeration(own, values));
                } else {
                    proto.r#type = typed(Type::Message);
                    proto.type_name = Some(format!(".{package}.{kind}"));
                }
            }
        }
        if optional {
            // Presence in proto3 is a oneof of one.
            proto.proto3_optional = Some(true);
            proto.oneof_index = Some(out.oneof_decl.len() as i32);
            out.oneof_decl.push(OneofDescriptorProto {
                name: Some(format!("_{label}")),
                ..OneofDescriptorProto::default()
            });
        }
        out.field.push(proto);
    }
    out
}

fn enumeration(name: &str, values: &str) -> EnumDescriptorProto {
    let value = |(number, name): (i32, &str)| EnumValueDescriptorProto {
        name: Some(name.to_owned()),
        number: Some(number),
        ..EnumValueDescriptorProto::default()
    };
    EnumDescriptorProto {
        name: Some(name.to_owned()),
        value: (0..).zip(values.split('/')).map(value).collect(),
        ..EnumDescriptorProto::default()
    }
}

/// `frame_locked` is `frameLocked` in JSON.
fn camel(name: &str) -> String {
    let mut upper = false;
    let mut out = String::new();
    for c in name.chars() {
        match c {
            '_' => upper = true,
            c if std::mem::take(&mut upper) => out.extend(c.to_uppercase()),
            c => out.push(c),
        }
    }
    out
}

/// Time of a message, as message fields hold it.
#[allow(clippy::unnecessary_wraps)] // protobuf fields are optional
pub(super) fn timestamp(nanos: u64) -> Option<Timestamp> {
    Some(Timestamp {
        seconds: (nanos / 1_000_000_000) as i64,
        nanos: (nanos % 1_000_000_000) as i32,
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    /// Reads encoded messages with the published descriptors: every field that the structs write
    /// must be in the table with the same number and a matching type.
    #[test]
    fn structs_and_descriptors_agree() {
        let v = Vector3 { x: 1.0, y: 2.0, z: 3.0 };
        let q = Quaternion { x: 0.1, y: 0.2, z: 0.3, w: 0.4 };
        let pose = Some(Pose { position: Some(v), orientation: Some(q) });
        let color = Some(Color { r: 1.0, g: 0.5, b: 0.25, a: 0.75 });
        let scene = SceneUpdate {
            entities: vec![SceneEntity {
                timestamp: timestamp(1_000_000_001),
                frame_id: "f".into(),
                id: "i".into(),
                frame_locked: true,
                cubes: vec![CubePrimitive { pose, size: Some(v), color }],
                spheres: vec![SpherePrimitive { pose, size: Some(v), color }],
                cylinders: vec![CylinderPrimitive {
                    pose,
                    size: Some(v),
                    bottom_scale: 1.0,
                    top_scale: 1.0,
                    color,
                }],
                triangles: vec![TriangleListPrimitive {
                    pose,
                    points: vec![v],
                    color,
                    indices: vec![7],
                }],
            }],
        };
        let transforms = FrameTransforms {
            transforms: vec![FrameTransform {
                timestamp: timestamp(1),
                parent_frame_id: "p".into(),
                child_frame_id: "c".into(),
                translation: Some(v),
                rotation: Some(q),
            }],
        };
        let log = Log { timestamp: timestamp(1), level: 2, message: "m".into(), name: "n".into() };
        let metrics = Metrics {
            frame: 1,
            frame_mae: Some(0.5),
            masked: true,
            joint_error: vec![JointError { joint: "j".into(), error: 1.0 }],
            action: vec![1.0],
            ctrl: vec![2.0],
        };
        let fox = types(&foxglove_schema());
        assert_eq!(walk(&fox, ".foxglove.SceneUpdate", &scene.encode_to_vec()), 90);
        assert_eq!(walk(&fox, ".foxglove.FrameTransforms", &transforms.encode_to_vec()), 14);
        assert_eq!(walk(&fox, ".foxglove.Log", &log.encode_to_vec()), 5);
        let own = types(&robert_schema());
        assert_eq!(walk(&own, ".robert.Metrics", &metrics.encode_to_vec()), 8);
    }

    fn types(set: &[u8]) -> BTreeMap<String, DescriptorProto> {
        let set = FileDescriptorSet::decode(set).unwrap();
        let mut out = BTreeMap::new();
        for file in set.file {
            for m in file.message_type {
                out.insert(format!(".{}.{}", file.package.clone().unwrap(), m.name()), m);
            }
        }
        out
    }

    /// Number of fields, including those of nested messages.
    fn walk(types: &BTreeMap<String, DescriptorProto>, name: &str, mut bytes: &[u8]) -> usize {
        let varint = |bytes: &mut &[u8]| prost::encoding::decode_varint(bytes).unwrap();
        let message = types.get(name).unwrap_or_else(|| panic!("{name} is not described"));
        let mut met = 0;
        while !bytes.is_empty() {
            let key = varint(&mut bytes);
            let field = message
                .field
                .iter()
                .find(|f| f.number() == (key >> 3) as i32)
                .unwrap_or_else(|| panic!("{name} has no field {}", key >> 3));
            met += 1;
            let kind = field.r#type();
            let packed =
                field.label() == Label::Repeated && matches!(kind, Type::Double | Type::Fixed32);
            let want = match kind {
                _ if packed => 2,
                Type::Double => 1,
                Type::Fixed32 => 5,
                Type::String | Type::Bytes | Type::Message => 2,
                _ => 0,
            };
            assert_eq!(key & 7, want, "{name}.{}", field.name());
            match want {
                0 => drop(varint(&mut bytes)),
                1 => bytes = &bytes[8..],
                5 => bytes = &bytes[4..],
                _ => {
                    let n = varint(&mut bytes) as usize;
                    if kind == Type::Message {
                        met += walk(types, field.type_name(), &bytes[..n]);
                    }
                    bytes = &bytes[n..];
                }
            }
        }
        met
    }
}
