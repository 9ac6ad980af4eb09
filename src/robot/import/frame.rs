//! The pose of a `<frame>` of `MuJoCo` 3, and the joints in it.
//!
//! A joint in a frame moves the body around the frame, and the frame only says where it is. So it is written
//! into that body, with its anchor and its axis turned and moved.

use std::fmt::Write as _;
use std::path::Path;

use nalgebra::{Matrix3, Quaternion, Rotation3, Unit, UnitQuaternion, Vector3};
use roxmltree::Node;

use super::attach::Angles;
use super::classes::Classes;
use crate::text::{Edits, compiler, escape, inner};
use crate::{Error, preparse};
use robert_base::xml::numbers;

/// Whether an element is a joint.
pub(super) fn is_joint(n: &Node<'_, '_>) -> bool {
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

/// The inertia of the body that replaces a frame: none, if the body around it names its own, which then does
/// not follow from geoms. Otherwise it follows from the geoms in the frame, and nothing is written.
pub(super) fn inertial(node: Node<'_, '_>) -> &'static str {
    let from_geoms = compiler(node.document(), "inertiafromgeom").unwrap_or("auto");
    let body = node.ancestors().find(|a| a.has_tag_name("body"));
    let own = body.is_some_and(|b| b.children().any(|n| n.has_tag_name("inertial")));
    if from_geoms == "false" || own && from_geoms != "true" {
        "<inertial pos=\"0 0 0\" mass=\"0\" diaginertia=\"0 0 0\"/>"
    } else {
        ""
    }
}

/// The joints of a frame, as elements of the body around it, and the rest of the frame's content.
///
/// # Errors
/// [`Error::Refused`] where numbers are missing, and for a frame that is in no body.
pub(super) fn split(node: Node<'_, '_>, xml: &str, path: &Path) -> Result<(String, String), Error> {
    let (Some(first), Some(joint)) = (node.first_child(), node.children().find(is_joint)) else {
        return Ok((String::new(), inner(node, xml).to_owned()));
    };
    if !node.ancestors().any(|a| a.has_tag_name("body")) {
        let message =
            "a joint in a <frame> of the world, which cannot move; put the frame into a <body>";
        return Err(preparse::refuse(joint, path, message));
    }
    let (mut joints, mut rest) = (String::new(), Edits::default());
    let (classes, pose) = (Classes::of(node.document()), pose(node, path)?);
    for joint in node.children().filter(is_joint) {
        let start = first.range().start;
        // What follows stays on its line.
        let lines = xml[joint.range()].matches('\n').count();
        rest.replace(joint.range().start - start..joint.range().end - start, "\n".repeat(lines));
        joints.push_str(&moved(joint, pose, &classes, path)?);
    }
    Ok((joints, rest.apply(inner(node, xml))))
}

/// A joint as an element of the body around its frame, whose position and rotation are given.
fn moved(
    joint: Node<'_, '_>,
    (at, turned): (Vector3<f64>, UnitQuaternion<f64>),
    classes: &Classes<'_, '_>,
    path: &Path,
) -> Result<String, Error> {
    let mut words: Vec<(&str, String)> =
        joint.attributes().map(|a| (a.name(), a.value().to_owned())).collect();
    let mut set = |name: &'static str, value: String| {
        words.retain(|(n, _)| *n != name);
        words.push((name, value));
    };
    // A free joint has neither anchor nor axis nor class.
    if joint.has_tag_name("joint") {
        let three = |name: &str, default: Vector3<f64>| match classes
            .get(joint, &["joint"], name)
            .map(numbers)
        {
            None => Ok(default),
            Some(Some(v)) if v.len() == 3 => Ok(Vector3::from_column_slice(&v)),
            Some(_) => Err(preparse::refuse(joint, path, format!("{name} takes three numbers"))),
        };
        let text = |v: Vector3<f64>| format!("{} {} {}", v.x, v.y, v.z);
        set("pos", text(at + turned * three("pos", Vector3::zeros())?));
        set("axis", text(turned * three("axis", Vector3::z())?));
        let class = joint.parent().and_then(|frame| frame.attribute("childclass"));
        if let Some(class) = class.filter(|_| joint.attribute("class").is_none()) {
            set("class", class.to_owned());
        }
    }
    let mut text = format!("<{}", joint.tag_name().name());
    for (name, value) in &words {
        write!(text, " {name}=\"{}\"", escape(value)).ok();
    }
    Ok(text + "/>")
}

/// Where an element is, and how it is turned.
fn pose(node: Node<'_, '_>, path: &Path) -> Result<(Vector3<f64>, UnitQuaternion<f64>), Error> {
    let values = |name: &str, count: usize| -> Result<Option<Vec<f64>>, Error> {
        let Some(text) = node.attribute(name) else { return Ok(None) };
        let wrong = || preparse::refuse(node, path, format!("{name} takes {count} numbers"));
        numbers(text).filter(|v| v.len() == count).map(Some).ok_or_else(wrong)
    };
    let vector = |v: &[f64]| Vector3::new(v[0], v[1], v[2]);
    let none = || preparse::refuse(node, path, "its rotation has no direction");
    // A length that overflows is as bad as none.
    let unit = |v: Vector3<f64>| {
        Unit::try_new(v, 0.0).filter(|u| (u.norm() - 1.0).abs() < 1e-9).ok_or_else(none)
    };
    let at = values("pos", 3)?.map_or_else(Vector3::zeros, |v| vector(&v));
    let angles = Angles::of(node.document());
    let turned = if let Some(q) = values("quat", 4)? {
        let q = UnitQuaternion::new_normalize(Quaternion::new(q[0], q[1], q[2], q[3]));
        Some(q).filter(|q| (q.norm() - 1.0).abs() < 1e-9).ok_or_else(none)?
    } else if let Some(euler) = values("euler", 3)? {
        angles.rotation(vector(&euler)).ok_or_else(|| {
            preparse::refuse(node, path, "eulerseq takes three of x, y, z, X, Y, Z")
        })?
    } else if let Some(v) = values("axisangle", 4)? {
        angles.about(unit(vector(&v))?, v[3])
    } else if let Some(v) = values("xyaxes", 6)? {
        let (x, y) = (unit(vector(&v))?, vector(&v[3..]));
        let y = unit(y - x.scale(x.dot(&y)))?;
        let columns = Matrix3::from_columns(&[*x, *y, x.cross(&y)]);
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(columns))
    } else if let Some(v) = values("zaxis", 3)? {
        let opposite = || UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let z = unit(vector(&v))?;
        UnitQuaternion::rotation_between(&Vector3::z(), &z).unwrap_or_else(opposite)
    } else {
        UnitQuaternion::identity()
    };
    Ok((at, turned))
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

    /// The geoms of a frame do not add to the mass that the body around it names.
    #[test]
    fn a_mass_that_is_given_counts_once() {
        for (section, mass) in [("", 2.0), (r#"<compiler inertiafromgeom="true"/>"#, 5.0)] {
            for part in ["<frame>", r#"<replicate count="1">"#] {
                let end = if part == "<frame>" { "</frame>" } else { "</replicate>" };
                let xml = format!(
                    r#"<mujoco>{section}<worldbody><body><inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/><joint/>
                    <geom size=".1" mass="3"/>{part}<frame><geom size=".1" mass="1"/></frame><geom size=".1" mass="1"/>{end}</body></worldbody></mujoco>"#
                );
                let flat = flatten(xml, std::path::Path::new("m.xml"), "").unwrap().0;
                let model = Model::from_xml(&flat).unwrap();
                assert_eq!(model.body_mass().iter().sum::<f64>(), mass, "{flat}");
            }
        }
    }

    #[test]
    fn a_joint_over_several_lines_keeps_them_and_one_of_the_world_is_refused() {
        let flat = |xml: &str| flatten(xml.to_owned(), std::path::Path::new("m.xml"), "");
        let xml = "<mujoco><worldbody><body><geom size='.1'/><frame>\n<joint\nname='j'/>\n<site name='s'/></frame></body></worldbody></mujoco>";
        let (flattened, said) = flat(xml).unwrap();
        assert_eq!(flattened.lines().position(|l| l.contains("'s'")), Some(3), "{flattened}");
        assert!(said.unwrap().contains("1 joint"));
        let e = flat("<mujoco><worldbody>\n<frame>\n<joint/></frame></worldbody></mujoco>");
        let e = e.unwrap_err().to_string();
        assert!(e.contains("m.xml:3:1") && e.contains("put the frame into a <body>"), "{e}");
    }

    #[test]
    fn numbers_that_are_missing_name_their_place() {
        for (frame, joint, word) in [
            (r#"pos="1 2""#, "", "pos takes 3 numbers"),
            (r#"xyaxes="0 0 0 1 0 0""#, "", "no direction"),
            (r#"zaxis="0 0 0""#, "", "no direction"),
            (r#"quat="0 0 0 0""#, "", "no direction"),
            (r#"quat="1e200 1e200 0 0""#, "", "no direction"),
            (r#"axisangle="0 0 0 90""#, "", "no direction"),
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
