//! The robot's geoms as shapes in body frames, for other viewers.
//!
//! Viewers have boxes, spheres and cylinders, but neither capsules nor height fields, and every
//! node costs a draw call. So all geoms of a body and colour are one mesh.

use glam::{Quat, Vec3};

use super::error::Error;
use robert_mujoco::Model;
use robert_render::{self as render, Shape};
use robert_robot::Robot;

/// Corners around a round shape.
const SEGMENTS: usize = 20;
/// Rings from the equator to a pole.
const RINGS: usize = 5;

/// One visible geom.
#[derive(Clone, Debug)]
pub(super) struct Solid {
    /// Body, 0 = the world.
    pub body: usize,
    pub shape: Shape,
    /// sRGB and opacity.
    pub rgba: [f32; 4],
    /// Place in the body, m.
    pub pos: Vec3,
    pub rot: Quat,
}

/// A robot's solids and the meshes that they name.
#[derive(Clone, Debug)]
pub(super) struct Solids {
    pub solids: Vec<Solid>,
    scene: render::Scene,
}

impl Solids {
    pub(super) fn of(robot: &Robot) -> Result<Solids, Error> {
        let model = robot.scene_model()?;
        let scene = render::Scene::from_model(model)?;
        let solids = scene
            .geoms()
            .iter()
            .enumerate()
            .filter(|(_, g)| g.rgba[3] > 0.0)
            .map(|(i, g)| {
                let (pos, rot) = place(model, i);
                Solid { body: g.body, shape: g.shape, rgba: g.rgba, pos, rot }
            })
            .collect();
        Ok(Solids { solids, scene })
    }

    /// Height of the floor, m.
    pub(super) fn floor_z(&self) -> Option<f32> {
        self.scene.floor().map(|f| f.z)
    }

    /// Triangles of a solid in its own frame.
    pub(super) fn triangles(&self, shape: Shape) -> Triangles {
        match shape {
            Shape::Mesh { mesh } => match self.scene.meshes().get(mesh) {
                Some(mesh) => {
                    let (vertices, faces) = mesh.corners();
                    Triangles { vertices, faces }
                }
                None => Triangles::default(),
            },
            Shape::Sphere { radius } => ellipsoid(Vec3::splat(radius)),
            Shape::Ellipsoid { radii } => ellipsoid(radii),
            Shape::Capsule { radius, half_length } => capsule(radius, half_length),
            Shape::Cylinder { radius, half_length } => cylinder(radius, half_length),
            Shape::Box { half } => cuboid(half),
            // An edge of 0 means infinite; only a part of limited size is drawn.
            Shape::Plane { half_x, half_y } => {
                let edge = |h: f32| if h > 0.0 { h } else { 2.0 };
                cuboid(Vec3::new(edge(half_x), edge(half_y), 5e-4))
            }
        }
    }
}

fn place(model: &Model, geom: usize) -> (Vec3, Quat) {
    let p = |k: usize| model.geom_pos()[3 * geom + k] as f32;
    let q = |k: usize| model.geom_quat()[4 * geom + k] as f32;
    let rot = Quat::from_xyzw(q(1), q(2), q(3), q(0));
    (Vec3::new(p(0), p(1), p(2)), if rot.length() > 0.5 { rot.normalize() } else { Quat::IDENTITY })
}

/// An indexed triangle list, counter-clockwise from outside; metres.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Triangles {
    pub vertices: Vec<[f32; 3]>,
    pub faces: Vec<[u32; 3]>,
}

impl Triangles {
    fn add(&mut self, other: &Triangles, pos: Vec3, rot: Quat) {
        let base = self.vertices.len() as u32;
        let placed = other.vertices.iter().map(|v| (rot * Vec3::from_array(*v) + pos).to_array());
        self.vertices.extend(placed);
        self.faces.extend(other.faces.iter().map(|f| f.map(|i| i + base)));
    }
}

/// All geoms of one body and colour as one mesh in the body's frame.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyMesh {
    /// Body of the model, 0 = the world.
    pub body: usize,
    /// sRGB and opacity, 0 to 1.
    pub rgba: [f32; 4],
    /// Corners, m.
    pub vertices: Vec<[f32; 3]>,
    /// Indices of corners, counter-clockwise from outside.
    pub faces: Vec<[u32; 3]>,
}

/// The visible parts of a robot, by body and colour, in the order of the bodies.
///
/// # Errors
/// [`Error::Robot`], [`Error::Render`].
pub fn body_meshes(robot: &Robot) -> Result<Vec<BodyMesh>, Error> {
    let solids = Solids::of(robot)?;
    let mut out: Vec<(usize, [f32; 4], Triangles)> = Vec::new();
    for solid in &solids.solids {
        let at = out.iter().position(|(b, c, _)| *b == solid.body && *c == solid.rgba);
        let at = at.unwrap_or_else(|| {
            out.push((solid.body, solid.rgba, Triangles::default()));
            out.len() - 1
        });
        if let Some((_, _, mesh)) = out.get_mut(at) {
            mesh.add(&solids.triangles(solid.shape), solid.pos, solid.rot);
        }
    }
    out.sort_by_key(|(body, _, _)| *body);
    Ok(out
        .into_iter()
        .filter(|(_, _, mesh)| !mesh.faces.is_empty())
        .map(|(body, rgba, mesh)| BodyMesh {
            body,
            rgba,
            vertices: mesh.vertices,
            faces: mesh.faces,
        })
        .collect())
}

/// Adds the surface of revolution of a profile of (radius, z), from low to high, about z. Profiles
/// that meet at an edge are added separately, because shared corners are shaded smoothly.
fn lathe(out: &mut Triangles, profile: &[(f32, f32)]) {
    let base = out.vertices.len() as u32;
    let n = SEGMENTS as u32;
    for &(r, z) in profile {
        for s in 0..SEGMENTS {
            let a = std::f32::consts::TAU * s as f32 / SEGMENTS as f32;
            out.vertices.push([r * a.cos(), r * a.sin(), z]);
        }
    }
    for (row, pair) in (0_u32..).zip(profile.windows(2)) {
        let &[(low, _), (high, _)] = pair else { continue };
        for s in 0..n {
            let t = (s + 1) % n;
            let at = |row: u32, s: u32| base + row * n + s;
            let (a, b, c, d) = (at(row, s), at(row, t), at(row + 1, s), at(row + 1, t));
            if low > 0.0 {
                out.faces.push([a, b, d]);
            }
            if high > 0.0 {
                out.faces.push([a, d, c]);
            }
        }
    }
}

/// (cos, sin) of the latitudes of half a ball, pole excluded from rounding.
fn arc(from: i32, to: i32) -> Vec<(f32, f32)> {
    (from..=to)
        .map(|i| {
            let lat = std::f32::consts::FRAC_PI_2 * i as f32 / RINGS as f32;
            if i.unsigned_abs() as usize == RINGS {
                (0.0, lat.sin())
            } else {
                (lat.cos(), lat.sin())
            }
        })
        .collect()
}

fn ellipsoid(radii: Vec3) -> Triangles {
    let mut out = Triangles::default();
    lathe(&mut out, &arc(-(RINGS as i32), RINGS as i32));
    for v in &mut out.vertices {
        *v = (Vec3::from_array(*v) * radii).to_array();
    }
    out
}

fn capsule(radius: f32, half: f32) -> Triangles {
    let low = arc(-(RINGS as i32), 0).into_iter().map(|(c, s)| (radius * c, radius * s - half));
    let high = arc(0, RINGS as i32).into_iter().map(|(c, s)| (radius * c, radius * s + half));
    let mut out = Triangles::default();
    lathe(&mut out, &low.chain(high).collect::<Vec<_>>());
    out
}

fn cylinder(radius: f32, half: f32) -> Triangles {
    let mut out = Triangles::default();
    lathe(&mut out, &[(0.0, -half), (radius, -half)]);
    lathe(&mut out, &[(radius, -half), (radius, half)]);
    lathe(&mut out, &[(radius, half), (0.0, half)]);
    out
}

fn cuboid(half: Vec3) -> Triangles {
    let mut out = Triangles::default();
    for axis in 0..3 {
        for sign in [-1.0_f32, 1.0] {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let base = out.vertices.len() as u32;
            for (du, dv) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
                let mut p = Vec3::ZERO;
                p[axis] = sign;
                p[u] = du * sign;
                p[v] = dv;
                out.vertices.push((p * half).to_array());
            }
            out.faces.push([base, base + 1, base + 2]);
            out.faces.push([base, base + 2, base + 3]);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn volume(t: &Triangles) -> f32 {
        let at = |i: u32| Vec3::from_array(t.vertices[i as usize]);
        t.faces.iter().map(|f| at(f[0]).dot(at(f[1]).cross(at(f[2]))) / 6.0).sum()
    }

    /// Signed volume: positive only when faces look outward, near the true one when closed.
    #[test]
    fn solids_are_closed_and_face_out() {
        use std::f32::consts::PI;
        let near = |t: Triangles, want: f32, loss: f32, what: &str| {
            let v = volume(&t);
            assert!(v > want * (1.0 - loss) && v <= want * 1.0001, "{what}: {v} of {want}");
        };
        near(cuboid(Vec3::new(1.0, 2.0, 3.0)), 48.0, 1e-5, "box");
        near(cylinder(0.5, 2.0), PI * 0.25 * 4.0, 0.03, "cylinder");
        near(ellipsoid(Vec3::new(1.0, 2.0, 3.0)), 4.0 / 3.0 * PI * 6.0, 0.06, "ellipsoid");
        near(capsule(1.0, 1.0), PI * 2.0 + 4.0 / 3.0 * PI, 0.05, "capsule");
    }

    #[test]
    fn builtin_robots_have_a_mesh_on_every_moving_part() {
        for id in Robot::builtin_ids() {
            let robot = Robot::builtin(id).unwrap();
            let meshes = body_meshes(&robot).unwrap();
            assert!(!meshes.is_empty(), "{id}");
            for m in &meshes {
                let n = m.vertices.len() as u32;
                assert!(m.faces.iter().flatten().all(|i| *i < n), "{id}");
                assert!(m.vertices.iter().flatten().all(|v| v.is_finite()), "{id}");
            }
        }
    }
}
