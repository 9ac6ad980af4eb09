//! glTF 2.0, binary: one node per body, its meshes, and the reached and the commanded motion as two
//! animations.
//!
//! glTF needs Y up, quaternions as x y z w, and times as floats from 0. One node at the root
//! rotates the axes, so that everything below stays in MuJoCo's frames.

use std::sync::Arc;

use serde_json::{Value, json};

use super::super::document::Take;
use super::super::error::Error;
use super::super::geometry::{BodyMesh, body_meshes};
use super::files::Export;
use super::skeleton::{Pose, Skeleton, commanded, reached};
use robert_base::units::CTRL_DT;
use robert_robot::Robot;

/// Movement below which a body counts as welded to its parent, m or 1 - |cos|.
const STILL: f64 = 1e-12;

/// The take as a GLB file.
///
/// # Errors
/// [`Error::Robot`], [`Error::Render`], [`Error::Encode`].
pub fn glb(take: &Take, robot: &Arc<Robot>, title: &str) -> Result<Export, Error> {
    let skeleton = Skeleton::of(robot)?;
    let mut file = Gltf::default();
    let frames = reached(take);
    let rest = skeleton.local(&frames[0]);
    file.bodies(&skeleton, &rest, &body_meshes(robot)?);
    let local: Vec<Vec<Pose>> = frames.iter().map(|f| skeleton.local(f)).collect();
    let times: Vec<f32> = (0..local.len()).map(secs).collect();
    file.animation(title, &times, &local);
    let goals = commanded(take);
    let at: Vec<f32> = goals.iter().map(|(f, _)| secs(*f)).collect();
    let local: Vec<Vec<Pose>> = goals.iter().map(|(_, f)| skeleton.local(f)).collect();
    file.animation(&format!("{title} (command)"), &at, &local);
    let mut export = Export::single(
        file.bytes(take)?,
        frames.len(),
        format!("npx @gltf-transform/cli inspect {}", Export::OUT),
    )
    .says("Metres, Y up; a node for each body, turned by a root node out of MuJoCo's Z up.")
    .says(format!("The animation \"{title}\" is the reached motion, 20 frames a second, linear."));
    if !goals.is_empty() {
        export = export.says(format!(
            "\"{title} (command)\" has a key for each of the {} frames with a goal for every joint, straight between them.",
            goals.len()
        ));
    }
    Ok(export)
}

fn secs(frame: usize) -> f32 {
    (frame as f64 * CTRL_DT) as f32
}

/// A document and its binary chunk while they grow.
#[derive(Debug, Default)]
struct Gltf {
    bin: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    nodes: Vec<Value>,
    meshes: Vec<Value>,
    materials: Vec<Value>,
    animations: Vec<Value>,
}

/// The use of a buffer view.
const VERTICES: u32 = 34962;
const INDICES: u32 = 34963;
const FLOAT: u32 = 5126;
const UINT: u32 = 5125;

impl Gltf {
    /// Adds bytes as a buffer view; views begin at multiples of four.
    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        let offset = self.bin.len();
        self.bin.extend_from_slice(bytes);
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let mut view = json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes.len()});
        if let Some(target) = target {
            view["target"] = target.into();
        }
        self.views.push(view);
        self.views.len() - 1
    }

    /// Adds rows of floats, with `bounds` if readers need the least and greatest values.
    fn floats<const N: usize>(
        &mut self,
        rows: &[[f32; N]],
        target: Option<u32>,
        bounds: bool,
    ) -> usize {
        let view = self.view(bytemuck::cast_slice(rows.as_flattened()), target);
        let kind = ["SCALAR", "", "VEC3", "VEC4"][N - 1];
        let mut accessor = json!({
            "bufferView": view, "componentType": FLOAT, "count": rows.len(), "type": kind
        });
        if bounds {
            let over = |f: fn(f32, f32) -> f32, from: f32| -> Vec<f32> {
                (0..N).map(|k| rows.iter().map(|r| r[k]).fold(from, f)).collect()
            };
            accessor["min"] = json!(over(f32::min, f32::INFINITY));
            accessor["max"] = json!(over(f32::max, f32::NEG_INFINITY));
        }
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// Nodes: 0 is the world, then one node per body, then those of the meshes.
    fn bodies(&mut self, skeleton: &Skeleton, rest: &[Pose], meshes: &[BodyMesh]) {
        let half = std::f32::consts::FRAC_1_SQRT_2;
        self.nodes.push(json!({"name": "world", "rotation": [-half, 0.0, 0.0, half]}));
        let mut children: Vec<Vec<usize>> = vec![Vec::new(); rest.len() + 1];
        for (i, (name, pose)) in skeleton.names.iter().zip(rest).enumerate() {
            let (t, r) = (translation(*pose), rotation(*pose));
            self.nodes.push(json!({"name": name, "translation": t, "rotation": r}));
            children[skeleton.parents[i].map_or(0, |p| p + 1)].push(i + 1);
        }
        for mesh in meshes {
            let made = self.mesh(mesh);
            children[mesh.body].push(self.nodes.len());
            let of = self.nodes[mesh.body]["name"].as_str().unwrap_or("world");
            self.nodes.push(json!({"name": format!("{of} mesh {made}"), "mesh": made}));
        }
        for (node, children) in self.nodes.iter_mut().zip(children) {
            if !children.is_empty() {
                node["children"] = json!(children);
            }
        }
    }

    fn mesh(&mut self, mesh: &BodyMesh) -> usize {
        let position = self.floats(&mesh.vertices, Some(VERTICES), true);
        let indices: &[u32] = mesh.faces.as_flattened();
        let view = self.view(bytemuck::cast_slice(indices), Some(INDICES));
        self.accessors.push(json!({
            "bufferView": view, "componentType": UINT, "count": indices.len(), "type": "SCALAR"
        }));
        let material = self.material(mesh.rgba);
        self.meshes.push(json!({"primitives": [{
            "attributes": {"POSITION": position},
            "indices": self.accessors.len() - 1,
            "material": material
        }]}));
        self.meshes.len() - 1
    }

    fn material(&mut self, rgba: [f32; 4]) -> usize {
        let [r, g, b, a] = rgba;
        let mut material = json!({"pbrMetallicRoughness": {
            "baseColorFactor": [linear(r), linear(g), linear(b), a],
            "metallicFactor": 0.0,
            "roughnessFactor": 0.7
        }});
        if a < 1.0 {
            material["alphaMode"] = "BLEND".into();
        }
        if let Some(same) = self.materials.iter().position(|m| *m == material) {
            return same;
        }
        self.materials.push(material);
        self.materials.len() - 1
    }

    /// Channels of the bodies that move against their parents.
    fn animation(&mut self, name: &str, times: &[f32], frames: &[Vec<Pose>]) {
        let Some(first) = frames.first() else { return };
        let rows: Vec<[f32; 1]> = times.iter().map(|t| [*t]).collect();
        let input = self.floats(&rows, None, true);
        let (mut samplers, mut channels) = (Vec::new(), Vec::new());
        for (body, rest) in first.iter().enumerate() {
            let track = || frames.iter().map(|f| f[body]);
            let mut add = |output: usize, path: &str| {
                let sampler = samplers.len();
                samplers.push(json!({"input": input, "output": output, "interpolation": "LINEAR"}));
                channels
                    .push(json!({"sampler": sampler, "target": {"node": body + 1, "path": path}}));
            };
            if track().any(|p| p.rot.dot(rest.rot).abs() < 1.0 - STILL) {
                let mut rows: Vec<[f32; 4]> = track().map(rotation).collect();
                // Neighbouring quaternions are in one half-space, because readers interpolate the
                // shorter way.
                for i in 1..rows.len() {
                    let dot: f32 = rows[i - 1].iter().zip(rows[i]).map(|(a, b)| a * b).sum();
                    if dot < 0.0 {
                        rows[i] = rows[i].map(|v| -v);
                    }
                }
                add(self.floats(&rows, None, false), "rotation");
            }
            if track().any(|p| (p.pos - rest.pos).length_squared() > STILL) {
                let rows: Vec<[f32; 3]> = track().map(translation).collect();
                add(self.floats(&rows, None, false), "translation");
            }
        }
        if !channels.is_empty() {
            self.animations.push(json!({"name": name, "samplers": samplers, "channels": channels}));
        }
    }

    fn bytes(mut self, take: &Take) -> Result<Vec<u8>, Error> {
        let precision = take.precision();
        let clip: Option<Value> =
            take.clip_text.as_ref().and_then(|text| serde_json::from_str(text).ok());
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let mut document = json!({
            "asset": {
                "version": "2.0",
                "generator": take.provenance.program,
                "extras": {
                    "robot": take.robot,
                    "provenance": take.provenance,
                    "precision": precision.precision,
                    "masked_mae": precision.masked_mae,
                    "fps": robert_base::units::FPS,
                    "clip": clip,
                }
            },
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": self.nodes,
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": self.bin.len()}],
        });
        for (key, list) in [
            ("meshes", self.meshes),
            ("materials", self.materials),
            ("animations", self.animations),
        ] {
            // The format has no empty lists.
            if !list.is_empty() {
                document[key] = list.into();
            }
        }
        let mut text = serde_json::to_vec(&document)
            .map_err(|e| Error::Encode { what: "the document", problem: e.to_string() })?;
        text.resize(text.len().next_multiple_of(4), b' ');
        let total = 12 + 8 + text.len() + 8 + self.bin.len();
        let total = u32::try_from(total).map_err(|_too_long| Error::Encode {
            what: "the take",
            problem: format!("{total} bytes are more than a GLB file holds"),
        })?;
        let mut out = Vec::with_capacity(total as usize);
        out.extend_from_slice(b"glTF");
        for word in [2, total, text.len() as u32, 0x4E4F_534A] {
            out.extend_from_slice(&word.to_le_bytes());
        }
        out.extend_from_slice(&text);
        for word in [self.bin.len() as u32, 0x004E_4942] {
            out.extend_from_slice(&word.to_le_bytes());
        }
        out.extend_from_slice(&self.bin);
        Ok(out)
    }
}

fn translation(pose: Pose) -> [f32; 3] {
    pose.pos.as_vec3().to_array()
}

/// x y z w, of unit length in single precision.
fn rotation(pose: Pose) -> [f32; 4] {
    pose.rot.as_quat().normalize().to_array()
}

/// Linear light of an sRGB value.
fn linear(v: f32) -> f32 {
    if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use glam::{Quat, Vec3};

    use super::super::super::sample;
    use super::*;

    /// World poses of the bodies at a frame, by an independent reader of the format.
    fn placed(gltf: &gltf::Gltf, animation: usize, frame: usize) -> Vec<(String, Vec3)> {
        let blob = gltf.blob.as_ref().unwrap();
        let mut local: Vec<(Vec3, Quat)> = gltf
            .nodes()
            .map(|n| {
                let (t, r, s) = n.transform().decomposed();
                assert_eq!(s, [1.0; 3]);
                (Vec3::from_array(t), Quat::from_array(r))
            })
            .collect();
        for channel in gltf.animations().nth(animation).unwrap().channels() {
            let reader = channel.reader(|_| Some(blob.as_slice()));
            let times: Vec<f32> = reader.read_inputs().unwrap().collect();
            assert!((times[frame] - frame as f32 / 20.0).abs() < 1e-6);
            let node = channel.target().node().index();
            match reader.read_outputs().unwrap() {
                gltf::animation::util::ReadOutputs::Rotations(r) => {
                    local[node].1 = Quat::from_array(r.into_f32().nth(frame).unwrap());
                }
                gltf::animation::util::ReadOutputs::Translations(mut t) => {
                    local[node].0 = Vec3::from_array(t.nth(frame).unwrap());
                }
                _ => panic!("neither turned nor moved"),
            }
        }
        let mut out = Vec::new();
        let mut walk = vec![(gltf.nodes().next().unwrap(), Vec3::ZERO, Quat::IDENTITY)];
        while let Some((node, at, turn)) = walk.pop() {
            let (t, r) = local[node.index()];
            let (at, turn) = (at + turn * t, turn * r);
            if node.mesh().is_none() {
                // Back from Y up.
                out.push((node.name().unwrap().to_owned(), Vec3::new(at.x, -at.z, at.y)));
            }
            walk.extend(node.children().map(|c| (c, at, turn)));
        }
        out
    }

    #[test]
    fn bodies_are_where_the_take_has_them() {
        for id in ["pointmass", "ur5e", "shadow_hand"] {
            let (robot, take) = sample::take(id, 40, 40);
            let export = glb(&take, &robot, "sample").unwrap();
            let bytes = &export.files[0].bytes;
            assert_eq!(glb(&take, &robot, "sample").unwrap(), export, "the same twice");
            let gltf = gltf::Gltf::from_slice(bytes).unwrap();
            let names: Vec<_> = gltf.animations().map(|a| a.name().unwrap().to_owned()).collect();
            assert_eq!(names, ["sample", "sample (command)"], "{id}");
            for frame in [0, 7, 20, 39] {
                let found = placed(&gltf, 0, frame);
                assert_eq!(found.len(), take.robot.bodies.len() + 1);
                for (body, pose) in take.robot.bodies.iter().zip(&reached(&take)[frame]) {
                    let (_, at) = found.iter().find(|(n, _)| n == body).unwrap();
                    let off = (at.as_dvec3() - pose.pos).length();
                    assert!(off < 1e-5, "{id} {body} frame {frame}: {off}");
                }
            }
            let extras = gltf.document.as_json().asset.extras.as_ref().unwrap().get();
            let extras: Value = serde_json::from_str(extras).unwrap();
            assert_eq!(extras["clip"]["format"], "robert-clip/1");
        }
    }
}
