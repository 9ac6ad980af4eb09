//! What a model file may say: sizes, numbers and names within limits.

use std::path::Path;

use roxmltree::{Document, Node};

use super::error::Error;
use super::origin::refuse;
use robert_base::limits;
use robert_base::xml;

/// Attributes that set a size, with their limits.
pub(super) const SIZES: &[(&str, &str, u64)] = &[
    ("size", "nstack", 20_000_000),
    ("size", "njmax", 100_000),
    ("size", "nconmax", 100_000),
    ("size", "nuserdata", 1_000_000),
    ("size", "nkey", 10_000),
    ("size", "nuser_body", 1_000),
    ("size", "nuser_jnt", 1_000),
    ("size", "nuser_geom", 1_000),
    ("size", "nuser_site", 1_000),
    ("size", "nuser_cam", 1_000),
    ("size", "nuser_tendon", 1_000),
    ("size", "nuser_actuator", 1_000),
    ("size", "nuser_sensor", 1_000),
    ("hfield", "nrow", 4_096),
    ("hfield", "ncol", 4_096),
];

/// Attributes with text, in which "nan" or "inf" may be a name.
const TEXTS: &[&str] = &[
    "name",
    "file",
    "class",
    "childclass",
    "body",
    "joint",
    "geom",
    "site",
    "mesh",
    "material",
    "texture",
    "model",
    "link",
    "filename",
];

/// The checks that need no other file.
pub(super) fn check(doc: &Document<'_>, path: &Path) -> Result<(), Error> {
    let mut elements = 0;
    let motors = doc.descendants().filter(|n| n.has_tag_name("actuator"));
    let motors: usize = motors.map(|a| a.children().filter(Node::is_element).count()).sum();
    for node in doc.descendants().filter(Node::is_element) {
        elements += 1;
        if elements > limits::MODEL_ELEMENTS {
            let message = format!("more than {} elements", limits::MODEL_ELEMENTS);
            return Err(refuse(node, path, message));
        }
        if node.tag_name().namespace().is_some_and(|n| n.contains("xacro")) {
            return Err(refuse(node, path, xml::XACRO));
        }
        let tag = node.tag_name().name();
        for a in node.attributes() {
            check_attribute(node, tag, a.name(), a.value()).map_err(|m| refuse(node, path, m))?;
        }
        if tag == "lengthrange" {
            check_length_range(node, motors).map_err(|m| refuse(node, path, m))?;
        }
        if tag == "composite" {
            let counts = node.attribute("count").unwrap_or("1");
            let total = counts
                .split_whitespace()
                .map(|c| c.parse::<f64>().unwrap_or(1.0).max(1.0))
                .product::<f64>();
            if total > limits::COMPOSITE_ELEMENTS as f64 {
                return Err(refuse(
                    node,
                    path,
                    format!(
                        "the composite has {total:.0} elements; at most {} are supported",
                        limits::COMPOSITE_ELEMENTS
                    ),
                ));
            }
        }
    }
    Ok(())
}

/// The compiler simulates every actuator in both directions to find its length range.
fn check_length_range(node: Node<'_, '_>, motors: usize) -> Result<(), String> {
    let number = |name: &str, default: f64| {
        node.attribute(name).and_then(|v| v.trim().parse::<f64>().ok()).unwrap_or(default)
    };
    let steps = 2.0 * motors as f64 * number("inttotal", 10.0) / number("timestep", 0.01);
    if steps > 0.0 && steps <= limits::LENGTH_RANGE_STEPS || motors == 0 {
        return Ok(());
    }
    Err(format!(
        "finding the length ranges of {motors} actuators takes {steps:.0} steps, at most {} are taken; \
         choose a smaller inttotal or a greater timestep",
        limits::LENGTH_RANGE_STEPS
    ))
}

/// Bytes of a texture in memory, three per pixel.
pub(super) fn texture_bytes(node: Node<'_, '_>, files: &[(u64, u64)]) -> u64 {
    if !files.is_empty() {
        return files.iter().map(|(w, h)| 3 * w * h).sum();
    }
    let edge = |name: &str| {
        let written = node.attribute(name).and_then(|v| v.trim().parse::<f64>().ok());
        written.unwrap_or(0.0).clamp(0.0, 1e6) as u64
    };
    // A builtin cube or sky box has six square sides.
    match node.attribute("type") {
        Some("2d") => 3 * edge("width") * edge("height"),
        _ => 18 * edge("width").pow(2),
    }
}

fn check_attribute(node: Node<'_, '_>, tag: &str, name: &str, value: &str) -> Result<(), String> {
    if TEXTS.contains(&name) {
        let cap = if matches!(name, "file" | "filename") { 4096 } else { limits::NAME_BYTES };
        if value.len() > cap {
            return Err(format!("{name} has {} bytes; at most {cap} are supported", value.len()));
        }
        return Ok(());
    }
    let Some(numbers) = xml::numbers::<f64>(value).filter(|n| !n.is_empty()) else {
        if value.len() > limits::MODEL_BYTES as usize / 4 {
            return Err(format!("{name} has {} bytes", value.len()));
        }
        return match (name, value) {
            ("dyntype" | "gaintype" | "biastype", "user") => {
                Err(format!("{name}=\"user\" needs its own program and cannot be simulated"))
            }
            _ => Ok(()),
        };
    };
    if let Some(v) = numbers.iter().find(|v| !v.is_finite()) {
        return Err(format!("{name} contains {v}, which is not a finite number"));
    }
    let first = numbers.first().copied().unwrap_or(0.0);
    if name == "quat" && numbers.len() == 4 && numbers.iter().all(|v| *v == 0.0) {
        return Err(
            "quat is 0 0 0 0, which is not a rotation; the neutral rotation is 1 0 0 0".into()
        );
    }
    if tag == "option" && name == "timestep" && !(1e-5..=0.1).contains(&first) {
        return Err(format!("timestep is {first} s, not within 0.00001 to 0.1 s"));
    }
    if let Some((_, _, cap)) = SIZES.iter().find(|(t, n, _)| *t == tag && *n == name) {
        if first > *cap as f64 {
            return Err(format!("{name} is {first}; at most {cap} is supported"));
        }
        // -1 tells MuJoCo to choose the value.
        if first < -1.0 {
            return Err(format!("{name} is {first}; a size must not be negative"));
        }
    }
    if node.tag_name().name() == "texture" && name == "height" && first > limits::TEXTURE_PX as f64
    {
        let kind = node.attribute("type").unwrap_or("cube");
        if kind == "2d" {
            return Err(format!("height is {first}; at most {} is supported", limits::TEXTURE_PX));
        }
    }
    Ok(())
}
