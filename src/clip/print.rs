//! Writes a [`Clip`] as its canonical text: one key per line, sorted, shortest numbers. A diff
//! therefore shows one line per changed key.

use std::fmt::Write as _;

use serde_json::{Map, Value};

use super::document::{Clip, FORMAT, Goal, Key, Marker, Mask, Row, Start};
use super::offset::Offset;
use super::reach::Reach;
use robert_base::units::FPS;

impl Clip {
    /// The canonical text, with a trailing newline. Stable: parsing and printing it again
    /// gives the same bytes.
    pub fn to_text(&self) -> String {
        let mut clip = self.clone();
        clip.normalize();
        clip.print()
    }

    /// The same document as a JSON value.
    pub fn to_json(&self) -> Value {
        serde_json::from_str(&self.to_text()).unwrap_or_default()
    }

    fn print(&self) -> String {
        let mut members = vec![member("format", &quote(FORMAT))];
        if !self.name.is_empty() {
            members.push(member("name", &quote(&self.name)));
        }
        if !self.notes.is_empty() {
            members.push(member("notes", &quote(&self.notes)));
        }
        members.push(member("robot", &self.robot_text()));
        members.push(format!(
            "\"fps\": {FPS}, \"length\": {}, \"fill\": \"{}\"",
            self.length,
            self.fill.word()
        ));
        match &self.start {
            None => {}
            Some(Start::Pose(pose)) => {
                members.push(member("start", &format!("{{\"pose\": {}}}", quote(pose))));
            }
            Some(Start::Q(q)) => {
                let q = numbers(q.iter().copied().map(Some));
                members.push(member("start", &format!("{{\"q\": {q}}}")));
            }
        }
        if !self.poses.is_empty() {
            let lines = self.poses.iter().map(|(name, row)| member(name, &row_text(row)));
            members.push(member("poses", &block('{', lines, '}')));
        }
        members.push(member("keys", &block('[', self.keys.iter().map(key_text), ']')));
        if !self.offsets.is_empty() {
            let lines = self.offsets.iter().map(Offset::text);
            members.push(member("offsets", &block('[', lines, ']')));
        }
        if !self.masks.is_empty() {
            members.push(member("masks", &block('[', self.masks.iter().map(mask_text), ']')));
        }
        if !self.markers.is_empty() {
            let lines = self.markers.iter().map(marker_text);
            members.push(member("markers", &block('[', lines, ']')));
        }
        if !self.x.is_empty() {
            let lines = sorted(&self.x).into_iter().map(|(name, v)| member(name, &compact(v)));
            members.push(member("x", &block('{', lines, '}')));
        }
        format!("{{\n  {}\n}}\n", members.join(",\n  "))
    }

    fn robot_text(&self) -> String {
        let robot = &self.robot;
        let mut members = vec![member("id", &quote(&robot.id))];
        if let Some(model) = &robot.model {
            members.push(member("model", &quote(model)));
        }
        if let Some(sha) = &robot.model_sha256 {
            members.push(member("model_sha256", &quote(sha)));
        }
        members.push(member("joints", &list(robot.joints.iter().map(|j| quote(j)))));
        if !robot.units.is_empty() {
            members.push(member("units", &list(robot.units.iter().map(|u| quote(u.symbol())))));
        }
        format!("{{{}}}", members.join(", "))
    }
}

fn member(name: &str, value: &str) -> String {
    format!("{}: {value}", quote(name))
}

fn list(items: impl Iterator<Item = String>) -> String {
    format!("[{}]", items.collect::<Vec<_>>().join(", "))
}

/// One item per line.
fn block(open: char, lines: impl Iterator<Item = String>, close: char) -> String {
    let lines: Vec<String> = lines.collect();
    if lines.is_empty() {
        return format!("{open}{close}");
    }
    format!("{open}\n    {}\n  {close}", lines.join(",\n    "))
}

fn key_text(key: &Key) -> String {
    let mut out = format!("{{\"frame\": {}", key.frame);
    match &key.goal {
        Goal::Pose(pose) => write!(out, ", \"pose\": {}", quote(pose)).ok(),
        Goal::Q(row) => write!(out, ", \"q\": {}", row_text(row)).ok(),
        Goal::Open => None,
    };
    if !key.reach.is_empty() {
        write!(out, ", \"reach\": {}", list(key.reach.iter().map(Reach::text))).ok();
    }
    if key.hold != 1 {
        write!(out, ", \"hold\": {}", key.hold).ok();
    }
    if let Some(fill) = key.fill {
        write!(out, ", \"fill\": \"{}\"", fill.word()).ok();
    }
    if !key.tangents.is_empty() {
        let slopes = key.tangents.iter().map(|(joint, slope)| member(joint, &slope.text()));
        let slopes = slopes.collect::<Vec<_>>().join(", ");
        write!(out, ", \"tangents\": {{{slopes}}}").ok();
    }
    if !key.note.is_empty() {
        write!(out, ", \"note\": {}", quote(&key.note)).ok();
    }
    out.push('}');
    out
}

fn marker_text(marker: &Marker) -> String {
    let to = marker.to.map(|to| format!(", \"to\": {to}")).unwrap_or_default();
    format!("{{\"frame\": {}{to}, \"name\": {}}}", marker.frame, quote(&marker.name))
}

fn mask_text(mask: &Mask) -> String {
    let mut out = format!("{{\"from\": {}, \"to\": {}", mask.from, mask.to);
    if let Some(joints) = &mask.joints {
        write!(out, ", \"joints\": {}", list(joints.iter().map(|j| quote(j)))).ok();
    }
    out.push('}');
    out
}

pub(crate) fn row_text(row: &Row) -> String {
    numbers(row.iter().copied())
}

fn numbers(values: impl Iterator<Item = Option<f64>>) -> String {
    // `{}` of f64 is the shortest decimal that reads back as the same double, no exponent.
    list(values.map(|v| v.map_or_else(|| "null".to_owned(), |v| v.to_string())))
}

fn quote(text: &str) -> String {
    Value::from(text).to_string()
}

/// Object members by name: `serde_json`'s own order depends on a feature that another crate
/// of the build may switch on.
fn sorted(map: &Map<String, Value>) -> Vec<(&String, &Value)> {
    let mut members: Vec<_> = map.iter().collect();
    members.sort_by_key(|(name, _)| *name);
    members
}

fn compact(value: &Value) -> String {
    match value {
        Value::Object(map) => {
            let inside: Vec<String> =
                sorted(map).into_iter().map(|(k, v)| member(k, &compact(v))).collect();
            format!("{{{}}}", inside.join(", "))
        }
        Value::Array(items) => list(items.iter().map(compact)),
        other => other.to_string(),
    }
}
