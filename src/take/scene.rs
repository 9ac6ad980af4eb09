//! The scene for Foxglove and Lichtblick: the robot's geoms as a `foxglove.SceneUpdate`, attached
//! to the frames of the body transforms; once solid, once translucent for the command.

use glam::{Quat, Vec3};
use prost::Message as _;

use super::document::{RobotFacts, Take};
use super::error::Error;
use super::geometry::{Solid, Solids};
use super::proto::{
    Color, CubePrimitive, CylinderPrimitive, Pose, Quaternion, SceneEntity, SceneUpdate,
    SpherePrimitive, TriangleListPrimitive, Vector3, timestamp,
};
use robert_base::limits;
use robert_render::Shape;
use robert_robot::Robot;

/// The root frame.
pub(super) const WORLD: &str = "world";
/// Prefix of command names, because viewers merge joints of one name over all topics.
pub(super) const COMMAND_PREFIX: &str = "cmd/";
/// sRGB and opacity of the commanded robot: the same blue in every picture of ours.
pub(super) const GHOST: [f32; 4] = [0.27, 0.51, 0.96, 0.3];

/// The largest scene: a reader takes the chunk that it is in, with the messages before it.
pub(super) const SCENE_BYTES: usize = limits::MCAP_RECORD_BYTES - (1 << 20);

/// A robot in the form for viewers.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    pub(super) entities: Vec<SceneEntity>,
}

impl Take {
    /// The robot of this take in the form for viewers.
    ///
    /// # Errors
    /// [`Error::OtherRobot`], [`Error::Robot`], [`Error::Render`].
    pub fn scene(&self, robot: &Robot) -> Result<Scene, Error> {
        self.check_robot(robot)?;
        let solids = Solids::of(robot)?;
        let mut entities = Vec::new();
        for (b, name) in (0..).zip(std::iter::once(WORLD).chain(bodies(&self.robot))) {
            let of_body = || solids.solids.iter().filter(move |s| s.body == b);
            if of_body().next().is_none() {
                continue;
            }
            entities.push(entity(&solids, of_body(), name, None));
            if b > 0 {
                entities.push(entity(
                    &solids,
                    of_body(),
                    &format!("{COMMAND_PREFIX}{name}"),
                    Some(GHOST),
                ));
            }
        }
        Ok(Scene { entities })
    }

    /// Whether this is the robot that the take was made with.
    ///
    /// # Errors
    /// [`Error::OtherRobot`].
    pub fn check_robot(&self, robot: &Robot) -> Result<(), Error> {
        if robot.model_sha256() == self.robot.model_sha256 {
            return Ok(());
        }
        Err(Error::OtherRobot {
            take_robot: self.robot.id.clone(),
            take_sha256: self.robot.model_sha256.clone(),
            robot: robot.id().to_owned(),
            sha256: robot.model_sha256().to_owned(),
        })
    }
}

impl Scene {
    fn update(&self, nanos: u64) -> SceneUpdate {
        let stamped = |e: &SceneEntity| SceneEntity { timestamp: timestamp(nanos), ..e.clone() };
        SceneUpdate { entities: self.entities.iter().map(stamped).collect() }
    }

    /// What a take leaves out because its meshes are too large to be read back.
    pub fn left_out(&self) -> Option<&'static str> {
        self.message(0, SCENE_BYTES).1
    }

    /// The whole scene if it has at most `most` bytes, else without the commanded robot, else none; and
    /// what was left out. It stays one message, because viewers that jump to a time read only the last one
    /// of a topic.
    pub(super) fn message(
        &self,
        nanos: u64,
        most: usize,
    ) -> (Option<SceneUpdate>, Option<&'static str>) {
        let whole = self.update(nanos);
        if whole.encoded_len() <= most {
            return (Some(whole), None);
        }
        let reached = whole.entities.into_iter().filter(|e| !e.id.starts_with(COMMAND_PREFIX));
        let reached = SceneUpdate { entities: reached.collect() };
        if reached.encoded_len() <= most {
            let what = "the shapes of the commanded robot are left out: the meshes are too large";
            return (Some(reached), Some(what));
        }
        (None, Some("the shapes are left out: the meshes are too large"))
    }
}

fn bodies(robot: &RobotFacts) -> impl Iterator<Item = &str> {
    robot.bodies.iter().map(String::as_str)
}

fn entity<'a>(
    solids: &Solids,
    of_body: impl Iterator<Item = &'a Solid>,
    frame: &str,
    tint: Option<[f32; 4]>,
) -> SceneEntity {
    let mut out = SceneEntity {
        frame_id: frame.to_owned(),
        id: frame.to_owned(),
        frame_locked: true,
        ..SceneEntity::default()
    };
    for solid in of_body {
        let pose = Some(pose(solid.pos, solid.rot));
        let color = Some(color(tint.unwrap_or(solid.rgba)));
        let size = |v: Vec3| Some(vector(2.0 * v));
        match solid.shape {
            Shape::Sphere { radius } => {
                out.spheres.push(SpherePrimitive { pose, size: size(Vec3::splat(radius)), color });
            }
            Shape::Ellipsoid { radii } => {
                out.spheres.push(SpherePrimitive { pose, size: size(radii), color });
            }
            Shape::Box { half } => {
                out.cubes.push(CubePrimitive { pose, size: size(half), color });
            }
            Shape::Cylinder { radius, half_length } => {
                let size = size(Vec3::new(radius, radius, half_length));
                let (bottom_scale, top_scale) = (1.0, 1.0);
                out.cylinders.push(CylinderPrimitive {
                    pose,
                    size,
                    bottom_scale,
                    top_scale,
                    color,
                });
            }
            Shape::Capsule { .. } | Shape::Plane { .. } | Shape::Mesh { .. } => {
                let mesh = solids.triangles(solid.shape);
                let point = |v: &[f32; 3]| vector(Vec3::from_array(*v));
                out.triangles.push(TriangleListPrimitive {
                    pose,
                    points: mesh.vertices.iter().map(point).collect(),
                    color,
                    indices: mesh.faces.iter().flatten().copied().collect(),
                });
            }
        }
    }
    out
}

fn vector(v: Vec3) -> Vector3 {
    Vector3 { x: v.x.into(), y: v.y.into(), z: v.z.into() }
}

fn pose(pos: Vec3, rot: Quat) -> Pose {
    let [x, y, z, w] = rot.to_array().map(f64::from);
    Pose { position: Some(vector(pos)), orientation: Some(Quaternion { x, y, z, w }) }
}

fn color(rgba: [f32; 4]) -> Color {
    let [r, g, b, a] = rgba.map(f64::from);
    Color { r, g, b, a }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_that_is_too_large_loses_the_ghost_first() {
        let entity = |id: &str| SceneEntity { id: id.to_owned(), ..SceneEntity::default() };
        let scene = Scene { entities: vec![entity("hand"), entity("cmd/hand")] };
        let shapes = |most| {
            let (message, left_out) = scene.message(7, most);
            let ids = |m: SceneUpdate| m.entities.into_iter().map(|e| e.id).collect::<Vec<_>>();
            (message.map(ids), left_out)
        };
        let whole = scene.update(7).encoded_len();
        assert_eq!(shapes(whole), (Some(vec!["hand".to_owned(), "cmd/hand".to_owned()]), None));
        let (reached, left_out) = shapes(whole - 1);
        assert_eq!(reached, Some(vec!["hand".to_owned()]));
        assert!(left_out.unwrap().contains("commanded"));
        let (none, left_out) = shapes(3);
        assert!(none.is_none() && left_out.unwrap().starts_with("the shapes are"));
    }
}
