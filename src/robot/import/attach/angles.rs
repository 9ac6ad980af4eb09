//! The unit and the order of the angles in an MJCF.

use nalgebra::{Unit, UnitQuaternion, Vector3};
use roxmltree::{Document, Node};

use crate::import::classes::Classes;
use crate::text::{Edits, compiler};
use robert_base::xml::numbers;

/// What `<compiler>` says of angles.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::import) struct Angles {
    degrees: bool,
    /// Axes of Euler angles: lower case turns with the body, upper case does not.
    sequence: String,
}

impl Angles {
    /// Those of a document; degrees about x, y, z unless it says otherwise.
    pub(in crate::import) fn of(doc: &Document<'_>) -> Self {
        Angles {
            degrees: compiler(doc, "angle") != Some("radian"),
            sequence: compiler(doc, "eulerseq").unwrap_or("xyz").to_owned(),
        }
    }

    /// The rotation of three Euler angles; `None` if the sequence is none.
    pub(in crate::import) fn rotation(&self, euler: Vector3<f64>) -> Option<UnitQuaternion<f64>> {
        let mut whole = UnitQuaternion::identity();
        if self.sequence.chars().count() != 3 {
            return None;
        }
        for (axis, angle) in self.sequence.chars().zip(euler.iter()) {
            let direction = match axis.to_ascii_lowercase() {
                'x' => Vector3::x_axis(),
                'y' => Vector3::y_axis(),
                'z' => Vector3::z_axis(),
                _ => return None,
            };
            let turn = self.about(direction, *angle);
            whole = if axis.is_ascii_lowercase() { whole * turn } else { turn * whole };
        }
        Some(whole)
    }

    /// The rotation by an angle of the document about an axis.
    pub(in crate::import) fn about(
        &self,
        axis: Unit<Vector3<f64>>,
        angle: f64,
    ) -> UnitQuaternion<f64> {
        let radians = if self.degrees { angle.to_radians() } else { angle };
        UnitQuaternion::from_axis_angle(&axis, radians)
    }

    /// Writes the angles of a document in terms of `other`.
    pub(super) fn write_as(&self, other: &Angles, doc: &Document<'_>, edits: &mut Edits) {
        if self == other {
            return;
        }
        let factor = match (self.degrees, other.degrees) {
            (true, false) => 1_f64.to_radians(),
            (false, true) => 1_f64.to_degrees(),
            _ => 1.0,
        };
        let scaled = |values: &[f64]| {
            values.iter().map(|v| (v * factor).to_string()).collect::<Vec<_>>().join(" ")
        };
        let classes = Classes::of(doc);
        for node in doc.descendants().filter(Node::is_element) {
            let tag = node.tag_name().name();
            let euler = node.attributes().find(|a| a.name() == "euler");
            if let Some(attribute) = euler
                && let Some([x, y, z]) = numbers(attribute.value()).as_deref()
            {
                if tag == "replicate" {
                    edits.replace(attribute.range_value(), scaled(&[*x, *y, *z]));
                } else if let Some(turn) = self.rotation(Vector3::new(*x, *y, *z)) {
                    let q = turn.quaternion();
                    let text = format!("quat=\"{} {} {} {}\"", q.w, q.i, q.j, q.k);
                    edits.replace(attribute.range(), text);
                }
            }
            let axisangle = node.attributes().find(|a| a.name() == "axisangle");
            if let Some(attribute) = axisangle
                && let Some([x, y, z, angle]) = numbers(attribute.value()).as_deref()
            {
                let text = format!("{x} {y} {z} {}", scaled(&[*angle]));
                edits.replace(attribute.range_value(), text);
            }
            // A class does not say what joints have it, so each gets its own values.
            let in_class = node.ancestors().any(|a| a.has_tag_name("default"));
            let kind = classes.get(node, &["joint"], "type").unwrap_or("hinge");
            let part = |p: Node<'_, '_>| p.has_tag_name("body") || p.has_tag_name("frame");
            if tag == "joint" && !in_class && node.parent().is_some_and(part) {
                for name in ["range", "ref", "springref"] {
                    let given = classes.get(node, &["joint"], name).and_then(numbers);
                    if let Some(values) = given {
                        let turns = matches!(kind, "hinge" | "ball");
                        let plain =
                            || values.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
                        edits.set(node, name, &if turns { scaled(&values) } else { plain() });
                    }
                }
            }
        }
    }
}
