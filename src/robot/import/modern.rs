//! Rewrites elements of `MuJoCo` 3 for version 2.2.2: frames and replicas.
//!
//! A `<frame>` becomes a body without joints, which moves, weighs and collides as part of its
//! parent. A `<replicate>` becomes several of them. Both are rewritten from the inside out, and
//! stay on their lines as far as possible.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use nalgebra::Vector3;
use roxmltree::Node;

use super::attach::Angles;
use super::frame;
use crate::text::{Edits, escape, inner};
use crate::{Error, preparse};
use robert_base::limits;
use robert_base::xml::numbers;

/// Attributes of a `<frame>` that a body has as well.
const POSE: &[&str] = &["pos", "quat", "axisangle", "xyaxes", "zaxis", "euler", "childclass"];
/// Elements that this version does not have, with an alternative.
const REFUSED: &[(&str, &str)] = &[
    (
        "flexcomp",
        "<flexcomp> is a soft body, which MuJoCo 2.2.2 does not have; take the element out",
    ),
    ("flex", "<flex> is a soft body, which MuJoCo 2.2.2 does not have; take the element out"),
    ("plugin", "<plugin> needs a program of its own; take the element out"),
];

/// Rewrites all frames and replicas of a text, and says how many. `stem` begins the names of the bodies that
/// take their places.
///
/// # Errors
/// [`Error::Refused`] for what has no equal in 2.2.2, and for more replicas than are taken.
pub(super) fn flatten(
    mut xml: String,
    path: &std::path::Path,
    stem: &str,
) -> Result<(String, Option<String>), Error> {
    let (mut frames, mut replicas, mut joints) = (0, 0, 0);
    let doc = preparse::parse(&xml, path)?;
    let bodies = doc.descendants().filter(|n| n.has_tag_name("body"));
    let taken: BTreeSet<String> = bodies.filter_map(|n| n.attribute("name").map(escape)).collect();
    drop(doc);
    loop {
        let doc = preparse::parse(&xml, path)?;
        for (tag, why) in REFUSED {
            let in_use = |n: &Node<'_, '_>| {
                n.has_tag_name(*tag) && !n.ancestors().any(|a| a.has_tag_name("extension"))
            };
            if let Some(node) = doc.descendants().find(in_use) {
                return Err(preparse::refuse(node, path, *why));
            }
        }
        let modern = |n: &Node<'_, '_>| n.has_tag_name("frame") || n.has_tag_name("replicate");
        let innermost =
            |n: &Node<'_, '_>| modern(n) && !n.descendants().skip(1).any(|d| modern(&d));
        let mut edits = Edits::default();
        let mut any = false;
        for node in doc.descendants().filter(innermost) {
            // Other sections have elements called <frame>, too; they have no such children.
            if !node.ancestors().any(|a| a.has_tag_name("worldbody")) {
                continue;
            }
            any = true;
            // The name says whose part it is.
            let body = node.ancestors().find(|a| a.has_tag_name("body"));
            let around = body
                .and_then(|b| b.attribute("name"))
                .map_or_else(String::new, |b| escape(b) + "_");
            let named = |what: &str| {
                let mut name = format!("{stem}{around}{what}");
                while taken.contains(&name) {
                    name.push('_');
                }
                name
            };
            if node.has_tag_name("frame") {
                joints += node.children().filter(frame::is_joint).count();
                edits.replace(
                    node.range(),
                    frame(node, &xml, path, &named(&format!("frame_{frames}")))?,
                );
                frames += 1;
            } else {
                edits.replace(
                    node.range(),
                    replicate(node, &xml, path, &named(&format!("replica_{replicas}")))?,
                );
                replicas += 1;
            }
        }
        drop(doc);
        if !any {
            break;
        }
        let next = edits.apply(&xml);
        if next.len() as u64 > limits::MODEL_BYTES {
            let message = "with its replicas written out the model is too large".to_owned();
            return Err(Error::Refused { message, line: 0, column: 0, path: path.to_owned() });
        }
        xml = next;
    }
    let said = (frames + replicas > 0).then(|| {
        let moved = match joints {
            0 => String::new(),
            1 => "; 1 joint in them moved into the body around it".to_owned(),
            n => format!("; {n} joints in them moved into the bodies around them"),
        };
        format!("{frames} frames and {replicas} replicas of MuJoCo 3 became bodies without joints{moved}")
    });
    Ok((xml, said))
}

fn frame(
    node: Node<'_, '_>,
    xml: &str,
    path: &std::path::Path,
    name: &str,
) -> Result<String, Error> {
    let (joints, rest) = frame::split(node, xml, path)?;
    let mut attributes = String::new();
    for name in POSE {
        if let Some(value) = node.attribute(*name) {
            write!(attributes, " {name}=\"{}\"", escape(value)).ok();
        }
    }
    let inertial = frame::inertial(node);
    Ok(format!("{joints}<body name=\"{name}\"{attributes}>{inertial}{rest}</body>"))
}

/// Makes copies of an element. Copy i is turned by i times the angles and set beside the one before, and its
/// names end in its number.
fn replicate(
    node: Node<'_, '_>,
    xml: &str,
    path: &std::path::Path,
    name: &str,
) -> Result<String, Error> {
    frame::no_joints(node, path)?;
    let count: usize = node
        .attribute("count")
        .and_then(|c| c.trim().parse().ok())
        .ok_or_else(|| preparse::refuse(node, path, "<replicate> has no count"))?;
    if count > limits::BODIES {
        let message = format!("count is {count}, at most {} are taken", limits::BODIES);
        return Err(preparse::refuse(node, path, message));
    }
    if count as u64 * inner(node, xml).len() as u64 > limits::MODEL_BYTES {
        return Err(preparse::refuse(
            node,
            path,
            "with its replicas written out the model is too large",
        ));
    }
    let three = |name: &str| -> Result<Vector3<f64>, Error> {
        let Some(text) = node.attribute(name) else { return Ok(Vector3::zeros()) };
        match numbers(text).as_deref() {
            Some([x, y, z]) => Ok(Vector3::new(*x, *y, *z)),
            _ => Err(preparse::refuse(node, path, format!("{name} takes three numbers"))),
        }
    };
    let (offset, euler) = (three("offset")?, three("euler")?);
    let angles = Angles::of(node.document());
    let childclass = node
        .attribute("childclass")
        .map_or_else(String::new, |c| format!(" childclass=\"{}\"", escape(c)));
    let inertial = frame::inertial(node);
    let digits = count.to_string().len();
    let separator = node.attribute("sep").unwrap_or("");
    let mut at = Vector3::zeros();
    let mut out = String::new();
    for i in 0..count {
        let suffix = format!("{separator}{i:0digits$}");
        let [x, y, z] = [at.x, at.y, at.z];
        let turned = angles.rotation(euler * i as f64).ok_or_else(|| {
            preparse::refuse(node, path, "eulerseq takes three of x, y, z, X, Y, Z")
        })?;
        let q = turned.quaternion();
        write!(
            out,
            "<body name=\"{name}_{i}\"{childclass} pos=\"{x} {y} {z}\" quat=\"{} {} {} {}\">{inertial}{}</body>",
            q.w,
            q.i,
            q.j,
            q.k,
            suffixed(node, xml, &suffix)
        )
        .ok();
        at += turned * offset;
    }
    Ok(out)
}

/// The content with a suffix on every name in it.
fn suffixed(node: Node<'_, '_>, xml: &str, suffix: &str) -> String {
    let mut edits = Edits::default();
    let start = node.first_child().map_or(node.range().start, |c| c.range().start);
    for d in node.descendants().skip(1).filter(Node::is_element) {
        if let Some(name) = d.attributes().find(|a| a.name() == "name") {
            let at = name.range_value();
            edits.insert(at.end - start, suffix);
        }
    }
    edits.apply(inner(node, xml))
}

#[cfg(test)]
mod tests {
    use super::*;
    use robert_mujoco::{Data, Kind, Model};
    use std::sync::Arc;

    fn flat(xml: &str) -> Result<String, Error> {
        Ok(flatten(xml.to_owned(), std::path::Path::new("m.xml"), "")?.0)
    }

    #[test]
    fn frames_and_replicas_stand_where_they_stood() {
        let xml = flat(
            r#"<mujoco><worldbody><frame pos="1 0 0" euler="0 0 90"><geom name="g" size=".1" pos="1 0 0"/></frame>
            <body name="b"><joint name="j" axis="0 1 0"/><geom size=".1"/>
              <replicate count="3" offset="0 .5 0" euler="0 0 90" sep="-"><frame pos="0 0 1"><site name="s" pos="1 0 0"/></frame></replicate></body>
            </worldbody></mujoco>"#,
        )
        .unwrap();
        let model = Arc::new(Model::from_xml(&xml).unwrap());
        let mut data = Data::new(&model).unwrap();
        data.kinematics().unwrap();
        let near = |got: &[f64], want: [f64; 3]| {
            assert!(got.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-9), "{got:?} {want:?}");
        };
        let geom = model.id(Kind::Geom, "g").unwrap();
        near(&data.geom_xpos()[3 * geom..3 * geom + 3], [1.0, 1.0, 0.0]);
        for (i, want) in
            [[1.0, 0.0, 1.0], [0.0, 1.5, 1.0], [-1.5, 0.5, 1.0]].into_iter().enumerate()
        {
            let site = model.id(Kind::Site, &format!("s-{i}")).unwrap();
            near(&data.site_xpos()[3 * site..3 * site + 3], want);
        }
        assert_eq!(model.njnt(), 1);
    }

    #[test]
    fn a_frame_takes_no_name_of_a_body() {
        let xml = flat(
            r#"<mujoco><worldbody><body name="a"><frame><geom name="g" size=".1"/></frame><body name="a_frame_0"/></body></worldbody></mujoco>"#,
        );
        let model = Model::from_xml(&xml.unwrap()).unwrap();
        let body = model.geom_bodyid()[model.id(Kind::Geom, "g").unwrap()];
        assert_eq!(model.name(Kind::Body, body as usize), Some("a_frame_0_"));
    }

    #[test]
    fn what_has_no_equal_names_line_and_way_out() {
        let e = flat("<mujoco><worldbody>\n<body><flexcomp/></body></worldbody></mujoco>");
        let e = e.unwrap_err().to_string();
        assert!(e.contains("m.xml:2:7") && e.contains("take the element out"), "{e}");
        let e = flat(
            "<mujoco><worldbody><body><replicate count=\"2\">\n<joint/></replicate></body></worldbody></mujoco>",
        );
        assert!(e.unwrap_err().to_string().contains("m.xml:2:1"));
        let e = flat(
            "<mujoco><worldbody>\n<replicate count=\"2\" offset=\"0 l 0 1\"><geom size=\".1\"/></replicate></worldbody></mujoco>",
        );
        let e = e.unwrap_err().to_string();
        assert!(e.contains("m.xml:2:1") && e.contains("offset takes three numbers"), "{e}");
    }
}
