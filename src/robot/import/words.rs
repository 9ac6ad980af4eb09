//! Attributes of MuJoCo 3 about motors and gravity that MuJoCo 2.2.2 does not read but can
//! simulate. They are kept and applied after the model is compiled.

use std::collections::BTreeMap;

use roxmltree::{Document, Node};

use super::classes::Classes;

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
    /// Whether the control range is the joint's range.
    pub(super) inherits: bool,
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
    pub(super) fn of(doc: &Document<'_>) -> Words {
        let classes = Classes::of(doc);
        let mut words = Words::default();
        let sections = doc.root_element().children().filter(|n| n.has_tag_name("actuator"));
        for actuator in sections.flat_map(|s| s.children().filter(Node::is_element)) {
            // The attributes of its class count only if the element is a position servo.
            let number = |name: &str| {
                let tags: &[&str] = if actuator.has_tag_name("position") { ACTUATORS } else { &[] };
                classes.get(actuator, tags, name).and_then(|v| v.trim().parse::<f64>().ok())
            };
            let position = actuator.has_tag_name("position");
            words.servos.push(Servo {
                kv: number("kv").filter(|_| position),
                dampratio: number("dampratio").filter(|_| position),
                inherits: number("inheritrange").is_some_and(|v| v > 0.0),
            });
        }
        let in_world = |n: &Node<'_, '_>| n.ancestors().any(|a| a.has_tag_name("worldbody"));
        for node in doc.descendants().filter(in_world) {
            if node.has_tag_name("joint")
                && let Some(name) = node.attribute("name")
                && let Some(text) = classes.get(node, &["joint"], "actuatorfrcrange")
            {
                let ends: Vec<f64> =
                    text.split_whitespace().filter_map(|t| t.parse().ok()).collect();
                if let [lo, hi] = ends[..]
                    && lo < hi
                {
                    words.torque.insert(name.to_owned(), [lo, hi]);
                }
            }
            if node.has_tag_name("body") && moves(node) && weighs(node) {
                words.moving += 1;
                let all = node.attribute("gravcomp").and_then(|v| v.trim().parse::<f64>().ok());
                words.weightless += usize::from(all.is_some_and(|v| v >= 0.99));
            }
        }
        words
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
