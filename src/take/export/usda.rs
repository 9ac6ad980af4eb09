//! USD as text: one `Xform` per body, nested as the bodies are, with time samples.

use std::fmt::Write as _;
use std::sync::Arc;

use super::super::document::Take;
use super::super::error::Error;
use super::super::geometry::{BodyMesh, body_meshes};
use super::files::Export;
use super::skeleton::{Pose, Skeleton, reached};
use robert_base::units::FPS;
use robert_robot::Robot;

/// The reached motion as a USD layer.
///
/// # Errors
/// [`Error::Robot`], [`Error::Render`].
pub fn usda(take: &Take, robot: &Arc<Robot>) -> Result<Export, Error> {
    let skeleton = Skeleton::of(robot)?;
    let frames: Vec<Vec<Pose>> = reached(take).iter().map(|f| skeleton.local(f)).collect();
    let root = word(&take.robot.id);
    let mut text = format!(
        "#usda 1.0\n(\n    defaultPrim = \"{root}\"\n    doc = {}\n    endTimeCode = {}\n    framesPerSecond = {FPS}\n    metersPerUnit = 1\n    startTimeCode = 0\n    timeCodesPerSecond = {FPS}\n    upAxis = \"Z\"\n)\n\n",
        quoted(&format!("{} by {}", take.provenance.program, take.provenance.policy)),
        frames.len() - 1
    );
    writeln!(text, "def Xform \"{root}\" (\n    kind = \"component\"\n)\n{{").ok();
    let layer = Layer { skeleton: &skeleton, frames: &frames, meshes: &body_meshes(robot)? };
    layer.meshes(None, 1, &mut text);
    for body in skeleton.children(None) {
        layer.body(body, 1, &mut text);
    }
    text.push_str("}\n");
    let open = format!("usdview {}", Export::OUT);
    Ok(Export::single(text.into_bytes(), frames.len(), open)
        .says(
            "Metres, Z up, 20 time codes a second; an Xform for each body, relative to its parent.",
        )
        .says("The reached motion; the command, torques and velocities are lost."))
}

struct Layer<'a> {
    skeleton: &'a Skeleton,
    /// Poses in the parents' frames; (frames)(B).
    frames: &'a [Vec<Pose>],
    meshes: &'a [BodyMesh],
}

impl Layer<'_> {
    fn body(&self, body: usize, depth: usize, text: &mut String) {
        let pad = "    ".repeat(depth);
        // Two bodies of one parent may not share a name; numbers keep them apart.
        let name = word(&self.skeleton.names[body]);
        let twin = (0..body).any(|b| {
            self.skeleton.parents[b] == self.skeleton.parents[body]
                && word(&self.skeleton.names[b]) == name
        });
        let name = if twin { format!("{name}_{body}") } else { name };
        writeln!(text, "{pad}def Xform \"{name}\"\n{pad}{{").ok();
        let position = |p: &Pose| format!("({}, {}, {})", p.pos.x, p.pos.y, p.pos.z);
        self.samples("double3 xformOp:translate", body, depth + 1, position, text);
        // In single precision readers lose 2e-4 rad: they take the arc cosine of w, which is near 1.
        let turn = |p: &Pose| {
            let q = p.rot.normalize();
            format!("({}, {}, {}, {})", q.w, q.x, q.y, q.z)
        };
        self.samples("quatd xformOp:orient", body, depth + 1, turn, text);
        writeln!(
            text,
            "{pad}    uniform token[] xformOpOrder = [\"xformOp:translate\", \"xformOp:orient\"]"
        )
        .ok();
        self.meshes(Some(body), depth + 1, text);
        for child in self.skeleton.children(Some(body)) {
            self.body(child, depth + 1, text);
        }
        writeln!(text, "{pad}}}").ok();
    }

    /// An attribute: one value if it never changes, else one per frame.
    fn samples(
        &self,
        attribute: &str,
        body: usize,
        depth: usize,
        print: impl Fn(&Pose) -> String,
        text: &mut String,
    ) {
        let pad = "    ".repeat(depth);
        let values: Vec<String> = self.frames.iter().map(|f| print(&f[body])).collect();
        if values.iter().all(|v| *v == values[0]) {
            writeln!(text, "{pad}{attribute} = {}", values[0]).ok();
            return;
        }
        writeln!(text, "{pad}{attribute}.timeSamples = {{").ok();
        for (frame, value) in values.iter().enumerate() {
            writeln!(text, "{pad}    {frame}: {value},").ok();
        }
        writeln!(text, "{pad}}}").ok();
    }

    fn meshes(&self, body: Option<usize>, depth: usize, text: &mut String) {
        let of = body.map_or(0, |b| b + 1);
        let pad = "    ".repeat(depth);
        for (i, mesh) in self.meshes.iter().filter(|m| m.body == of).enumerate() {
            let points: Vec<String> =
                mesh.vertices.iter().map(|[x, y, z]| format!("({x}, {y}, {z})")).collect();
            let indices: Vec<String> = mesh.faces.iter().flatten().map(u32::to_string).collect();
            let [r, g, b, a] = mesh.rgba;
            write!(
                text,
                "{pad}def Mesh \"mesh_{i}\"\n{pad}{{\n{pad}    uniform token subdivisionScheme = \"none\"\n{pad}    int[] faceVertexCounts = [{}]\n{pad}    int[] faceVertexIndices = [{}]\n{pad}    point3f[] points = [{}]\n{pad}    color3f[] primvars:displayColor = [({r}, {g}, {b})]\n{pad}    float[] primvars:displayOpacity = [{a}]\n{pad}}}\n",
                vec!["3"; mesh.faces.len()].join(", "),
                indices.join(", "),
                points.join(", ")
            )
            .ok();
        }
    }
}

/// A name of a prim: letters, digits and underscores, no digit first.
fn word(name: &str) -> String {
    let plain: String =
        name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if plain.starts_with(|c: char| c.is_ascii_digit()) || plain.is_empty() {
        format!("_{plain}")
    } else {
        plain
    }
}

fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', " "))
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::super::super::sample;
    use super::*;

    /// World places of the bodies at a frame: nesting by braces, values by their attributes.
    fn places(text: &str, frame: usize) -> Vec<(String, DVec3)> {
        let numbers = |line: &str| -> Vec<f64> {
            let inner = line.split_once('(').unwrap().1.split(')').next().unwrap();
            inner.split(',').map(|v| v.trim().parse().unwrap()).collect()
        };
        let mut out = Vec::new();
        // Name, local place and turn of the open prims.
        let mut open: Vec<(String, DVec3, DQuat)> = Vec::new();
        let (mut pending, mut sampled) = (None, None);
        for line in text.lines().map(str::trim) {
            if let Some(rest) = line.strip_prefix("def ") {
                pending = Some(rest.split('"').nth(1).unwrap().to_owned());
            } else if line == "{" {
                open.push((pending.take().unwrap(), DVec3::ZERO, DQuat::IDENTITY));
            } else if line == "}" {
                if sampled.take().is_some() {
                    continue;
                }
                open.pop();
            } else if line.contains("timeSamples") {
                sampled = Some(line.contains("translate"));
            } else {
                let value = match sampled {
                    Some(place) if line.starts_with(&format!("{frame}:")) => Some(place),
                    None if line.contains("xformOp:translate = (") => Some(true),
                    None if line.contains("xformOp:orient = (") => Some(false),
                    _ => None,
                };
                let Some(place) = value else {
                    if line.contains("xformOpOrder") {
                        let (mut at, mut turn) = (DVec3::ZERO, DQuat::IDENTITY);
                        for (_, p, r) in &open {
                            (at, turn) = (at + turn * *p, turn * *r);
                        }
                        out.push((open.last().unwrap().0.clone(), at));
                    }
                    continue;
                };
                let v = numbers(line);
                let top = open.last_mut().unwrap();
                if place {
                    top.1 = DVec3::from_slice(&v);
                } else {
                    top.2 = DQuat::from_xyzw(v[1], v[2], v[3], v[0]);
                }
            }
        }
        assert!(open.is_empty());
        out
    }

    #[test]
    fn bodies_are_where_the_take_has_them() {
        for id in ["pointmass", "ur5e", "shadow_hand"] {
            let (robot, take) = sample::take(id, 30, 30);
            let export = usda(&take, &robot).unwrap();
            let text = std::str::from_utf8(&export.files[0].bytes).unwrap();
            for frame in [0, 11, 29] {
                let found = places(text, frame);
                assert_eq!(found.len(), take.robot.bodies.len());
                for ((name, at), pose) in found.iter().zip(&reached(&take)[frame]) {
                    let off = (*at - pose.pos).length();
                    assert!(off < 1e-5, "{id} {name} frame {frame}: {off}");
                }
            }
        }
    }
}
