//! A take as a viser recording: the reached robot solid, the commanded one translucent.
//!
//! A body is a node with the world pose of its frame, with one static mesh per colour below it.
//! Only changes are written, so a body at rest costs nothing.

use super::super::document::{POSE, Take};
use super::super::error::Error;
use super::super::geometry::{BodyMesh, Solids, body_meshes};
use super::super::scene::GHOST;
use glam::{DQuat, DVec3};

use super::apart::Apart;
use super::buffer::Buffer;
use super::encode::file;
use super::messages::{
    AmbientLightProps, DirectionalLightProps, FrameProps, GridProps, MeshProps, Message,
};
use robert_base::units::CTRL_DT;
use robert_robot::Robot;

/// Messages with their times.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// Seconds and message, ascending.
    pub messages: Vec<(f64, Message)>,
    /// Length, seconds.
    pub duration_secs: f64,
}

/// A body's name as part of a node's path.
pub fn node_name(body: &str) -> String {
    body.replace('/', "_")
}

impl Recording {
    /// The recording of a take.
    ///
    /// # Errors
    /// [`Error::OtherRobot`], [`Error::Robot`], [`Error::Render`].
    pub fn of(take: &Take, robot: &Robot) -> Result<Recording, Error> {
        take.check_robot(robot)?;
        let mut out = Recording { messages: Vec::new(), duration_secs: take.secs() };
        let floor = Solids::of(robot)?.floor_z();
        out.stage(robot, floor);
        let meshes = body_meshes(robot)?;
        out.put(0.0, Message::create("/robot", FrameProps::default()));
        out.put(0.0, Message::create("/command", FrameProps::default()));
        let bodies: Vec<String> = take.robot.bodies.iter().map(|b| node_name(b)).collect();
        out.bodies("/robot", &bodies, &meshes, None);
        // Bodies that cannot move are always at their commanded place.
        let weld = robot.scene_model()?.body_weldid();
        let moving: Vec<BodyMesh> =
            meshes.iter().filter(|m| weld.get(m.body).is_some_and(|w| *w != 0)).cloned().collect();
        out.bodies("/command", &bodies, &moving, Some(GHOST));
        let corners = moving.iter().flat_map(|m| m.vertices.iter().map(|v| (m.body - 1, v)));
        let apart = Apart::new(bodies.len(), corners, size_m(take, &moving));

        let n = bodies.len() * POSE;
        let mut solid = Last { root: "/robot", poses: vec![f64::NAN; n] };
        let mut ghost = Last { root: "/command", poses: vec![f64::NAN; n] };
        let mut shown: Vec<Option<bool>> = vec![None; bodies.len()];
        out.put(0.0, Message::visibility("/command", true));
        for f in 0..take.frames() {
            let at = f as f64 * CTRL_DT;
            solid.move_to(&mut out, at, &bodies, take.body_poses(f));
            let goal = take.ghost.get(f).and_then(Option::as_ref);
            if let Some(poses) = goal {
                ghost.move_to(&mut out, at, &bodies, poses);
            }
            for (b, (body, shown)) in bodies.iter().zip(&mut shown).enumerate() {
                let seen = match (pose_of(take.body_poses(f), b), goal.and_then(|g| pose_of(g, b)))
                {
                    (Some(real), Some(asked)) => apart.seen(b, real, asked),
                    _ => false,
                };
                if *shown != Some(seen) {
                    *shown = Some(seen);
                    out.put(at, Message::visibility(&format!("/command/{body}"), seen));
                }
            }
        }
        Ok(out)
    }

    /// The file.
    ///
    /// # Errors
    /// [`Error::Encode`].
    pub fn to_bytes(&self) -> Result<Vec<u8>, Error> {
        file(&self.messages, self.duration_secs)
    }

    fn put(&mut self, at_secs: f64, message: Message) {
        self.messages.push((at_secs, message));
    }

    /// Up, lights, floor, camera.
    fn stage(&mut self, robot: &Robot, floor_z: Option<f32>) {
        self.put(0.0, Message::z_up());
        self.put(0.0, Message::visibility("/WorldAxes", false));
        self.put(0.0, Message::EnableLightsMessage { enabled: true, cast_shadow: true });
        self.put(0.0, Message::no_environment());
        let ambient = AmbientLightProps { intensity: 0.75, ..AmbientLightProps::default() };
        self.put(0.0, Message::create("/ambient", ambient));
        self.put(0.0, Message::visibility("/ambient", true));
        let sun = DirectionalLightProps { intensity: 0.95, ..DirectionalLightProps::default() };
        self.put(0.0, Message::create("/sun", sun));
        self.put(0.0, Message::visibility("/sun", true));
        self.put(0.0, Message::position("/sun", [2.0, -1.5, 4.0]));
        self.put(0.0, Message::create("/floor", GridProps::default()));
        self.put(0.0, Message::visibility("/floor", true));
        let z = floor_z.map_or(0.0, f64::from);
        self.put(0.0, Message::position("/floor", [0.0, 0.0, z - 1e-3]));
        let c = &robot.profile().camera;
        let (el, az) = (c.elevation_rad, c.azimuth_rad);
        // Elevation and azimuth are those of the line of sight, so the eye is in the opposite
        // direction.
        let sight = [el.cos() * az.cos(), el.cos() * az.sin(), el.sin()];
        let [x, y, z] = c.lookat;
        let eye = |k: f64, s: f64| k - c.distance * s;
        let position = [eye(x, sight[0]), eye(y, sight[1]), eye(z, sight[2])];
        let up = [0.0, 0.0, 1.0];
        self.put(0.0, Message::SetCameraUpDirectionMessage { position: up, initial: true });
        self.put(0.0, Message::SetCameraPositionMessage { position, initial: true });
        self.put(0.0, Message::SetCameraLookAtMessage { look_at: c.lookat, initial: true });
        self.put(0.0, Message::SetCameraFovMessage { fov: c.fovy_rad, initial: true });
    }

    /// Nodes and meshes of one robot; body 0 (the world) has meshes only in the solid one.
    fn bodies(
        &mut self,
        root: &str,
        bodies: &[String],
        meshes: &[BodyMesh],
        tint: Option<[f32; 4]>,
    ) {
        for body in bodies {
            self.put(0.0, Message::create(&format!("{root}/{body}"), FrameProps::default()));
        }
        for (k, mesh) in meshes.iter().enumerate() {
            let name = match mesh.body.checked_sub(1).and_then(|b| bodies.get(b)) {
                Some(body) => format!("{root}/{body}/{k}"),
                None if tint.is_none() => format!("{root}/{k}"),
                None => continue,
            };
            self.put(0.0, Message::create(&name, props(mesh, tint)));
            // At a restart of playback, the client hides all nodes, and only a message shows them
            // again.
            self.put(0.0, Message::visibility(&name, true));
        }
    }
}

fn pose_of(poses: &[f64], body: usize) -> Option<&[f64; POSE]> {
    poses.get(body * POSE..)?.first_chunk()
}

/// The diagonal of the box around the moving bodies, at the first frame.
fn size_m(take: &Take, meshes: &[BodyMesh]) -> f64 {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for mesh in meshes {
        let Some(p) = pose_of(take.body_poses(0), mesh.body - 1) else { continue };
        let turn = DQuat::from_xyzw(p[4], p[5], p[6], p[3]).normalize();
        for v in &mesh.vertices {
            let at = DVec3::new(p[0], p[1], p[2]) + turn * DVec3::from_array(v.map(f64::from));
            (low, high) = (low.min(at), high.max(at));
        }
    }
    if low.x <= high.x { low.distance(high) } else { 0.0 }
}

fn props(mesh: &BodyMesh, tint: Option<[f32; 4]>) -> MeshProps {
    let rgba = tint.unwrap_or(mesh.rgba);
    let byte = |v: f32| (v.clamp(0.0, 1.0) * 255.0).round() as u8;
    let opaque = rgba[3] >= 1.0;
    MeshProps {
        vertices: Buffer::f32(mesh.vertices.as_flattened()),
        faces: Buffer::u32(mesh.faces.as_flattened()),
        color: [byte(rgba[0]), byte(rgba[1]), byte(rgba[2])],
        opacity: (!opaque).then(|| f64::from(rgba[3])),
        // Foreign meshes are not always closed.
        side: if opaque { "double" } else { "front" },
        cast_shadow: tint.is_none(),
        receive_shadow: tint.is_none(),
        ..MeshProps::default()
    }
}

/// Poses as they were last sent.
struct Last {
    root: &'static str,
    poses: Vec<f64>,
}

impl Last {
    fn move_to(&mut self, out: &mut Recording, at: f64, bodies: &[String], poses: &[f64]) {
        let old = self.poses.chunks_exact_mut(POSE);
        for ((body, new), old) in bodies.iter().zip(poses.chunks_exact(POSE)).zip(old) {
            let name = format!("{}/{body}", self.root);
            let [x, y, z, qw, qx, qy, qz] = *new else { continue };
            if old.get(..3) != new.get(..3) {
                out.put(at, Message::position(&name, [x, y, z]));
            }
            if old.get(3..) != new.get(3..) {
                out.put(at, Message::orientation(&name, [qw, qx, qy, qz]));
            }
            old.copy_from_slice(new);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::sample;
    use super::*;

    #[derive(serde::Deserialize)]
    #[serde(rename_all = "camelCase")]
    struct File {
        duration_seconds: f64,
        viser_version: String,
        messages: Vec<(f64, serde_json::Value)>,
        binary_buffer_lengths: Vec<usize>,
    }

    fn decode(bytes: &[u8]) -> (File, usize) {
        let n = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        let inner = zstd::bulk::decompress(&bytes[8..], n).unwrap();
        let packed = u64::from_le_bytes(inner[..8].try_into().unwrap()) as usize;
        let file = rmp_serde::from_slice::<File>(&inner[8..8 + packed]).unwrap();
        let mut end = 8 + packed;
        for len in &file.binary_buffer_lengths {
            end = end.next_multiple_of(8) + len;
        }
        assert_eq!(end, inner.len(), "buffers are not where their lengths say");
        (file, inner.len())
    }

    /// The last pose of a node in the file is the take's.
    #[test]
    fn recording_moves_every_body_to_where_it_was() {
        let (robot, take) = sample::take("ur5e", 30, 30);
        let (file, _) = decode(&Recording::of(&take, &robot).unwrap().to_bytes().unwrap());
        assert_eq!(file.viser_version, "1.1.1");
        assert!((file.duration_seconds - 1.45).abs() < 1e-12);
        let times: Vec<f64> = file.messages.iter().map(|m| m.0).collect();
        assert!(times.windows(2).all(|w| w[0] <= w[1]), "times go back");
        let last_pose = take.body_poses(29);
        for (b, body) in take.robot.bodies.iter().enumerate() {
            let last = |kind: &str, field: &str| -> Vec<f64> {
                let found = file
                    .messages
                    .iter()
                    .rev()
                    .find(|(_, m)| m["type"] == kind && m["name"] == format!("/robot/{body}"));
                serde_json::from_value(found.unwrap().1[field].clone()).unwrap()
            };
            assert_eq!(last("SetPositionMessage", "position"), last_pose[b * 7..b * 7 + 3]);
            assert_eq!(last("SetOrientationMessage", "wxyz"), last_pose[b * 7 + 3..b * 7 + 7]);
        }
        // The ghost is there at keys that were missed, and only then: at the first the arm is
        // where it should be, early in the hold from frame 10 it is on its way.
        let shown = |body: &str| -> Vec<(f64, bool)> {
            let name = format!("/command/{body}");
            let of = file.messages.iter().filter(|(_, m)| m["name"] == name.as_str());
            of.filter_map(|(t, m)| Some((*t, m["visible"].as_bool()?))).collect()
        };
        let wrist = shown("wrist_3_link");
        assert_eq!(wrist[0], (0.0, false));
        assert!(wrist[1].0 > 0.499 && wrist[1].0 < 0.7 && wrist[1].1, "{wrist:?}");
        assert!(wrist.windows(2).all(|w| w[0].1 != w[1].1), "only changes are sent: {wrist:?}");
        assert_eq!(shown("base"), [(0.0, false)], "it cannot move");
        let of_base = |root: &str| {
            let inside = format!("{root}/base/");
            let mesh = |m: &serde_json::Value| {
                m["type"] == "MeshMessage"
                    && m["name"].as_str().is_some_and(|n| n.starts_with(&inside))
            };
            file.messages.iter().filter(|(_, m)| mesh(m)).count()
        };
        assert!(of_base("/robot") > 0);
        assert_eq!(of_base("/command"), 0);
        let meshes = file.messages.iter().filter(|(_, m)| m["type"] == "MeshMessage").count();
        assert!(meshes > take.robot.bodies.len(), "{meshes} meshes");
    }
}
