//! The pose of a `<frame>` of `MuJoCo` 3, and the joints in it.
//!
//! A joint in a frame moves the body around the frame, and the frame only says where it is. So it is written
//! into that body, with its anchor and its axis turned and moved.

use std::fmt::Write as _;
use std::path::Path;

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};
use roxmltree::Node;

use super::attach::Angles;
use super::classes::Classes;
use crate::text::{Edits, escape, inner};
use crate::{Error, preparse};
use robert_base::xml::numbers;

/// Whether an element is a joint.
fn is_joint(n: &Node<'_, '_>) -> bool {
    n.has_tag_name("joint") || n.has_tag_name("freejoint")
}

/// Refuses joints in an element that repeats its content: they would move one body several times.
pub(super) fn no_joints(node: Node<'_, '_>, path: &Path) -> Result<(), Error> {
    match node.children().find(is_joint) {
        Some(joint) => {
            let tag = node.tag_name().name();
            let message = format!("a joint inside of a <{tag}>; move it out, into the body itself");
            Err(preparse::refuse(joint, path, message))
        }
        None => Ok(()),
    }
}

/// The joints of a frame, as elements of the body around it, and the rest of the frame's content.
///
/// # Errors
/// [`Error::Refused`] where numbers are missing.
pub(super) fn split(node: Node<'_, '_>, xml: &str, path: &Path) -> Result<(String, String), Error> {
    let Some(first) = node.first_child() else { return Ok(Default::default()) };
    let (mut joints, mut rest) = (String::new(), Edits::default());
    let classes = Classes::of(node.document());
    for joint in node.children().filter(is_joint) {
        let start = first.range().start;
        rest.replace(joint.range().start - start..joint.range().end - start, "");
        let mut words: Vec<(&str, String)> =
            joint.attributes().map(|a| (a.name(), a.value().to_owned())).collect();
        let mut set = |name: &'static str, value: String| {
            words.retain(|(n, _)| *n != name);
            words.push((name, value));
        };
        if joint.has_tag_name("joint") {
            let (at, turned) = pose(node, path)?;
            let three = |name: &str, default: Vector3<f64>| match classes
                .get(joint, &["joint"], name)
                .map(numbers)
            {
                None => Ok(default),
                Some(Some(v)) if v.len() == 3 => Ok(Vector3::from_column_slice(&v)),
                Some(_) => {
                    Err(preparse::refuse(joint, path, format!("{name} takes three numbers")))
                }
            };
            let text = |v: Vector3<f64>| format!("{} {} {}", v.x, v.y, v.z);
            set("pos", text(at + turned * three("pos", Vector3::zeros())?));
            set("axis", text(turned * three("axis", Vector3::z())?));
        }
        if let Some(class) = node.attribute("childclass")
            && joint.attribute("class").is_none()
            && joint.has_tag_name("joint")
        {
            set("class", class.to_owned());
        }
        write!(joints, "<{}", joint.tag_name().name()).ok();
        for (name, value) in &words {
            write!(joints, " {name}=\"{}\"", escape(value)).ok();
        }
        joints.push_str("/>");
    }
    Ok((joints, rest.apply(inner(node, xml))))
}

/// Where an element is, and how it is turned.
fn pose(node: Node<'_, '_>, path: &Path) -> Result<(Vector3<f64>, UnitQuaternion<f64>), Error> {
    let values = |name: &str, count: usize| -> Result<Option<Vec<f64>>, Error> {
        let Some(text) = node.attribute(name) else { return Ok(None) };
        let wrong = || preparse::refuse(node, path, format!("{name} takes {count} numbers"));
        numbers(text).filter(|v| v.len() == count).map(Some).ok_or_else(wrong)
    };
    let vector = |v: &[f64]| Vector3::new(v[0], v[1], v[2]);
    let at = values("pos", 3)?.map_or_else(Vector3::zeros, |v| vector(&v));
    let angles = Angles::of(node.document());
    let turned = if let Some(q) = values("quat", 4)? {
        UnitQuaternion::new_normalize(Quaternion::new(q[0], q[1], q[2], q[3]))
    } else if let Some(euler) = values("euler", 3)? {
        angles.rotation(vector(&euler)).ok_or_else(|| {
            preparse::refuse(node, path, "eulerseq takes three of x, y, z, X, Y, Z")
        })?
    } else if let Some(v) = values("axisangle", 4)? {
        angles.about(vector(&v), v[3])
    } else if let Some(v) = values("xyaxes", 6)? {
        let x = vector(&v).normalize();
        let y = vector(&v[3..]);
        let y = (y - x * x.dot(&y)).normalize();
        let columns = Matrix3::from_columns(&[x, y, x.cross(&y)]);
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(columns))
    } else if let Some(v) = values("zaxis", 3)? {
        let opposite = || UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        UnitQuaternion::rotation_between(&Vector3::z(), &vector(&v)).unwrap_or_else(opposite)
    } else {
        UnitQuaternion::identity()
    };
    if at.iter().chain(turned.coords.iter()).all(|v| v.is_finite()) {
        Ok((at, turned))
    } else {
        Err(preparse::refuse(node, path, "a direction of length 0"))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use robert_mujoco::{Data, Kind, Model};

    use crate::import::modern::flatten;

    /// A body whose joint is in a frame, and the same body with anchor and axis worked out by hand.
    #[test]
    fn joints_in_frames_turn_about_the_same_line() {
        let cases = [
            (r#"pos="0 0 1" euler="0 90 0""#, r#"pos=".5 0 0""#, [0.0, 0.0, 0.5], [1.0, 0.0, 0.0]),
            (
                r#"quat="0 0 1 0""#,
                r#"pos=".5 0 0" axis="1 0 0""#,
                [-0.5, 0.0, 0.0],
                [-1.0, 0.0, 0.0],
            ),
            (r#"axisangle="0 0 2 90""#, r#"axis="1 0 0""#, [0.0; 3], [0.0, 1.0, 0.0]),
            (r#"xyaxes="0 2 0 -1 1 0""#, r#"axis="1 0 0""#, [0.0; 3], [0.0, 1.0, 0.0]),
            (r#"zaxis="0 3 0""#, "", [0.0; 3], [0.0, 1.0, 0.0]),
            (r#"zaxis="0 0 -1""#, "", [0.0; 3], [0.0, 0.0, -1.0]),
            (r#"childclass="c""#, "", [0.0; 3], [0.0, 1.0, 0.0]),
            ("", r#"pos="1 2 3""#, [1.0, 2.0, 3.0], [0.0, 0.0, 1.0]),
        ];
        for (frame, joint, pos, axis) in cases {
            let xml = format!(
                r#"<mujoco><default><default class="c"><joint axis="0 1 0" damping="7"/></default></default>
                <worldbody><body name="b"><frame {frame}>
                  <geom name="g" size=".1" pos="0 0 1"/><joint name="j" {joint}/></frame></body></worldbody></mujoco>"#
            );
            let flat = flatten(xml, std::path::Path::new("m.xml"), "").unwrap().0;
            let model = Arc::new(Model::from_xml(&flat).unwrap());
            let mut data = Data::new(&model).unwrap();
            data.kinematics().unwrap();
            let near = |got: &[f64], want: [f64; 3]| {
                assert!(
                    got.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-9),
                    "{frame}: {got:?} {want:?}"
                );
            };
            assert_eq!((model.njnt(), model.id(Kind::Joint, "j")), (1, Some(0)), "{flat}");
            near(&data.xanchor()[..3], pos);
            near(&data.xaxis()[..3], axis);
            assert_eq!(model.dof_damping()[0], if frame.contains('c') { 7.0 } else { 0.0 });
        }
    }

    #[test]
    fn frames_in_frames_and_free_joints() {
        let flat = flatten(
            r#"<mujoco><worldbody><body name="b"><frame pos="1 0 0"><frame euler="0 0 90"><joint name="j" pos="1 0 0" axis="1 0 0"/></frame></frame><geom size=".1"/></body>
            <body name="f"><frame pos="0 0 2"><freejoint name="free"/><geom size=".1"/></frame></body></worldbody></mujoco>"#
                .to_owned(),
            std::path::Path::new("m.xml"),
            "",
        );
        let model = Arc::new(Model::from_xml(&flat.unwrap().0).unwrap());
        let mut data = Data::new(&model).unwrap();
        data.kinematics().unwrap();
        let near =
            |got: &[f64], want: [f64; 3]| got.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-9);
        assert!(near(&data.xanchor()[..3], [1.0, 1.0, 0.0]), "{:?}", data.xanchor());
        assert!(near(&data.xaxis()[..3], [0.0, 1.0, 0.0]), "{:?}", data.xaxis());
        assert_eq!(model.njnt(), 2);
    }

    #[test]
    fn numbers_that_are_missing_name_their_place() {
        for (frame, joint, word) in [
            (r#"pos="1 2""#, "", "pos takes 3 numbers"),
            (r#"xyaxes="0 0 0 1 0 0""#, "", "length 0"),
            ("", r#"axis="1""#, "axis takes three numbers"),
        ] {
            let xml = format!(
                "<mujoco><worldbody><body>\n<frame {frame}>\n<joint {joint}/></frame></body></worldbody></mujoco>"
            );
            let e = flatten(xml, std::path::Path::new("m.xml"), "").unwrap_err().to_string();
            assert!(
                e.contains(word) && (e.contains("m.xml:2:1") || e.contains("m.xml:3:1")),
                "{e}"
            );
        }
    }
}
