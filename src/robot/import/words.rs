//! Attributes of MuJoCo 3 about motors and gravity that MuJoCo 2.2.2 does not read but can
//! simulate. They are kept and applied after the model is compiled.

use std::collections::BTreeMap;
use std::path::Path;

use roxmltree::{Document, Node};

use super::classes::Classes;
use crate::Error;
use crate::preparse::refuse;
use robert_base::xml::numbers;

/// Elements that share the defaults of actuators.
pub(super) const ACTUATORS: &[&str] = &[
    "general",
    "position",
    "velocity",
    "intvelocity",
    "motor",
    "damper",
    "cylinder",
    "muscle",
    "adhesion",
];

/// The words of one actuator.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Servo {
    /// Damping of a position servo, N m s/rad or N s/m.
    pub(super) kv: Option<f64>,
    /// The damping as a ratio to critical damping.
    pub(super) dampratio: Option<f64>,
    /// The share of the joint's range, about its middle, that is the control range.
    pub(super) inherits: Option<f64>,
}

/// See the module.
#[derive(Clone, Debug, Default)]
pub(super) struct Words {
    /// By actuator, in the file's order.
    pub(super) servos: Vec<Servo>,
    /// Limits of the torque of all motors at a joint, by joint, N m or N.
    pub(super) torque: BTreeMap<String, [f64; 2]>,
    /// Moving bodies with mass of their own, and how many of them are weightless (`gravcomp`).
    pub(super) moving: usize,
    pub(super) weightless: usize,
}

impl Words {
    /// # Errors
    /// A word that should be a number, with its place in `path`.
    pub(super) fn of(doc: &Document<'_>, path: &Path) -> Result<Words, Error> {
        let number = |node: Node<'_, '_>, name: &str, text: Option<&str>| {
            let parsed = text.map(|v| v.trim().parse::<f64>()).transpose();
            parsed.map_err(|e| refuse(node, path, format!("{name}: {e}")))
        };
        let classes = Classes::of(doc);
        let mut words = Words::default();
        let sections = doc.root_element().children().filter(|n| n.has_tag_name("actuator"));
        for actuator in sections.flat_map(|s| s.children().filter(Node::is_element)) {
            // The attributes of its class count only if the element is a position servo.
            let position = actuator.has_tag_name("position");
            let tags: &[&str] = if position { ACTUATORS } else { &[] };
            let own = |name: &str| number(actuator, name, classes.get(actuator, tags, name));
            words.servos.push(Servo {
                kv: own("kv")?.filter(|_| position),
                dampratio: own("dampratio")?.filter(|_| position),
                inherits: own("inheritrange")?.filter(|v| *v > 0.0),
            });
        }
        let in_world = |n: &Node<'_, '_>| n.ancestors().any(|a| a.has_tag_name("worldbody"));
        for node in doc.descendants().filter(in_world) {
            if node.has_tag_name("joint")
                && let Some(name) = node.attribute("name")
                && let Some(text) = classes.get(node, &["joint"], "actuatorfrcrange")
            {
                let Some([lo, hi]) = numbers(text).and_then(|ends| <[f64; 2]>::try_from(ends).ok())
                else {
                    return Err(refuse(node, path, "actuatorfrcrange takes two numbers"));
                };
                if lo < hi {
                    words.torque.insert(name.to_owned(), [lo, hi]);
                }
            }
            if node.has_tag_name("body") && moves(node) && weighs(node) {
                words.moving += 1;
                let all = number(node, "gravcomp", node.attribute("gravcomp"))?;
                words.weightless += usize::from(all.is_some_and(|v| v >= 0.99));
            }
        }
        Ok(words)
    }
}

fn moves(body: Node<'_, '_>) -> bool {
    body.ancestors().any(|b| {
        b.has_tag_name("body")
            && b.children().any(|c| c.has_tag_name("joint") || c.has_tag_name("freejoint"))
    })
}

fn weighs(body: Node<'_, '_>) -> bool {
    body.children().any(|c| c.has_tag_name("inertial") || c.has_tag_name("geom"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_number_has_its_place() {
        let words = |inside: &str| {
            let xml = format!("<mujoco>\n{inside}\n</mujoco>");
            Words::of(&Document::parse(&xml).unwrap(), Path::new("m.xml"))
        };
        let servo = |kv| format!("<actuator>\n<position joint=\"j\" kv=\"{kv}\"/>\n</actuator>");
        assert_eq!(words(&servo("10")).unwrap().servos[0].kv, Some(10.0));
        let joint = |ends| {
            format!(
                "<worldbody><body>\n<joint name=\"j\" actuatorfrcrange=\"{ends}\"/>\n</body></worldbody>"
            )
        };
        assert_eq!(words(&joint("-2 3")).unwrap().torque["j"], [-2.0, 3.0]);
        for broken in [servo("1O"), joint("-2 x 3"), joint("-2"), joint("")] {
            let error = words(&broken).unwrap_err().to_string();
            assert!(error.contains("m.xml:3:1"), "{error}");
        }
    }
}
