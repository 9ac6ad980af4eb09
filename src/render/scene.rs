//! The geoms of a model to draw; poses come with every frame.
//!
//! A scene can be built from a compiled model or by hand, so that pictures (and their golden
//! tests) need no simulator.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::{Mat3, Vec3};

use super::{Error, Mesh};

/// The most geoms to draw; each costs 80 bytes per frame.
pub const GEOMS: usize = 100_000;

/// World pose of one geom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Position, metres.
    pub pos: Vec3,
    /// Rotation, `world_from_geom`.
    pub rot: Mat3,
}

impl Pose {
    /// No rotation, at the origin.
    pub const IDENTITY: Pose = Pose { pos: Vec3::ZERO, rot: Mat3::IDENTITY };

    /// From `geom_xpos` and `geom_xmat` of the simulator (row-major).
    pub fn from_mujoco(xpos: &[f64; 3], xmat: &[f64; 9]) -> Pose {
        let m = xmat.map(|x| x as f32);
        Pose {
            pos: Vec3::from_array(xpos.map(|x| x as f32)),
            rot: Mat3::from_cols_array(&m).transpose(),
        }
    }

    /// A position without rotation.
    pub fn at(x: f32, y: f32, z: f32) -> Pose {
        Pose { pos: Vec3::new(x, y, z), rot: Mat3::IDENTITY }
    }

    /// This pose turned about its own origin.
    #[must_use]
    pub fn turned(self, rot: Mat3) -> Pose {
        Pose { pos: self.pos, rot: self.rot * rot }
    }

    pub(super) fn is_finite(&self) -> bool {
        self.pos.is_finite() && self.rot.is_finite()
    }
}

/// Form and size of a geom in its own frame, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// Ball.
    Sphere {
        /// Radius.
        radius: f32,
    },
    /// Along z.
    Capsule {
        /// Radius.
        radius: f32,
        /// Half length of the straight part.
        half_length: f32,
    },
    /// Half axes.
    Ellipsoid {
        /// Along x, y, z.
        radii: Vec3,
    },
    /// Along z.
    Cylinder {
        /// Radius.
        radius: f32,
        /// Half length.
        half_length: f32,
    },
    /// Half edges.
    Box {
        /// Along x, y, z.
        half: Vec3,
    },
    /// In z = 0; an edge of 0 means infinite.
    Plane {
        /// Half edge along x.
        half_x: f32,
        /// Half edge along y.
        half_y: f32,
    },
    /// Index into [`Scene::meshes`]; height fields are meshes too.
    Mesh {
        /// The index of the mesh.
        mesh: usize,
    },
}

/// One thing to draw.
#[derive(Clone, Debug)]
pub struct Geom {
    /// Name for messages; may be empty.
    pub name: String,
    /// Body it is fixed to (0 = the world).
    pub body: usize,
    /// Form and size.
    pub shape: Shape,
    /// sRGB colour and opacity, 0 to 1, as models give it.
    pub rgba: [f32; 4],
}

/// The ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Floor {
    /// Height, metres.
    pub z: f32,
}

/// The visible content of a model.
#[derive(Clone, Debug)]
pub struct Scene {
    pub(super) id: u64,
    pub(super) geoms: Vec<Geom>,
    pub(super) meshes: Vec<Mesh>,
    pub(super) floor: Option<Floor>,
    bodies: Vec<String>,
}

impl Scene {
    /// A scene from its parts. Shapes without extent are not drawn, but they are allowed, because
    /// models use them as markers.
    ///
    /// # Errors
    /// [`Error::Geoms`], [`Error::Mesh`] for a geom without its mesh, [`Error::NotFinite`].
    pub fn new(geoms: Vec<Geom>, meshes: Vec<Mesh>, floor: Option<Floor>) -> Result<Scene, Error> {
        static NEXT: AtomicU64 = AtomicU64::new(1);
        if geoms.len() > GEOMS {
            return Err(Error::Geoms { geoms: geoms.len(), cap: GEOMS });
        }
        for (i, g) in geoms.iter().enumerate() {
            if let Shape::Mesh { mesh } = g.shape
                && mesh >= meshes.len()
            {
                return Err(Error::Mesh {
                    mesh: format!("of geom {}", label(i, &g.name)),
                    reason: format!("number {mesh} of {} meshes", meshes.len()),
                });
            }
            let finite = g.shape.radii().is_finite() && g.rgba.iter().all(|c| c.is_finite());
            if !finite {
                return Err(Error::NotFinite {
                    what: format!("size or colour of geom {}", label(i, &g.name)),
                });
            }
        }
        let id = NEXT.fetch_add(1, Ordering::Relaxed);
        Ok(Scene { id, geoms, meshes, floor, bodies: Vec::new() })
    }

    /// The geoms, in the order of the poses.
    pub fn geoms(&self) -> &[Geom] {
        &self.geoms
    }

    /// The meshes of the geoms.
    pub fn meshes(&self) -> &[Mesh] {
        &self.meshes
    }

    /// The ground, if there is one.
    pub fn floor(&self) -> Option<Floor> {
        self.floor
    }

    /// Names of the bodies, for cameras that follow one.
    #[must_use]
    pub fn with_bodies(mut self, names: Vec<String>) -> Scene {
        self.bodies = names;
        self
    }

    /// Name of a body; `None` if it has none.
    pub fn body_name(&self, body: usize) -> Option<&str> {
        self.bodies.get(body).map(String::as_str).filter(|n| !n.is_empty())
    }

    /// Number of the body of this name.
    ///
    /// # Errors
    /// [`Error::Unknown`] with the existing names.
    pub fn body(&self, name: &str) -> Result<usize, Error> {
        self.bodies.iter().position(|b| b == name).ok_or_else(|| Error::Unknown {
            kind: "body",
            name: name.to_owned(),
            known: self.bodies.join(", "),
        })
    }

    /// Refuses pose lists that do not fit or are not finite.
    pub(super) fn check(&self, what: &str, poses: &[Pose]) -> Result<(), Error> {
        if poses.len() != self.geoms.len() {
            return Err(Error::PoseCount {
                what: what.to_owned(),
                poses: poses.len(),
                geoms: self.geoms.len(),
            });
        }
        match poses.iter().position(|p| !p.is_finite()) {
            None => Ok(()),
            Some(i) => {
                let name = self.geoms.get(i).map_or("", |g| g.name.as_str());
                Err(Error::NotFinite { what: format!("{what}: pose of geom {}", label(i, name)) })
            }
        }
    }

    /// Centre and half edges of a geom's bounding box in its own frame; `None` if it is infinite.
    pub(super) fn extent(&self, geom: &Geom) -> Option<(Vec3, Vec3)> {
        match geom.shape {
            Shape::Mesh { mesh } => {
                let m = self.meshes.get(mesh)?;
                Some((0.5 * (m.low + m.high), 0.5 * (m.high - m.low)))
            }
            Shape::Plane { half_x, half_y } if half_x <= 0.0 || half_y <= 0.0 => None,
            Shape::Capsule { radius, half_length } => {
                Some((Vec3::ZERO, Vec3::new(radius, radius, radius + half_length)))
            }
            ref s => Some((Vec3::ZERO, s.radii())),
        }
    }

    /// The outermost points of all drawn geoms at these poses, for the framing of a camera: corners
    /// of bounding boxes, or points on the surface of round geoms. The infinite ground is left out.
    pub fn corners(&self, poses: &[Pose]) -> Vec<Vec3> {
        self.corners_of(poses, |_| true)
    }

    /// The outermost points of the geoms that `wanted` selects; see [`Scene::corners`].
    pub fn corners_of(&self, poses: &[Pose], wanted: impl Fn(&Geom) -> bool) -> Vec<Vec3> {
        self.corners_within(poses, |g, _, _| wanted(g))
    }

    /// As [`Scene::corners_of`]; `wanted` also gets the middle and the radius of the ball around a geom, m.
    pub(super) fn corners_within(
        &self,
        poses: &[Pose],
        wanted: impl Fn(&Geom, Vec3, f32) -> bool,
    ) -> Vec<Vec3> {
        let mut out = Vec::new();
        for (g, pose) in self.geoms.iter().zip(poses) {
            if !g.is_visible() || !pose.is_finite() {
                continue;
            }
            let Some((centre, half)) = self.extent(g) else { continue };
            if !wanted(g, pose.pos + pose.rot * centre, half.length()) {
                continue;
            }
            let mut put = |p: Vec3| out.push(pose.pos + pose.rot * (centre + p));
            match g.shape {
                // Of a ball, the middles of the faces, edges and corners of the box around it,
                // drawn in to its surface: from no side does it reach 14 % beyond them.
                Shape::Sphere { .. } | Shape::Ellipsoid { .. } => {
                    AROUND.iter().for_each(|d| put(half * d.normalize()));
                }
                Shape::Capsule { radius, half_length } => {
                    for d in &AROUND {
                        let on = radius * d.normalize();
                        if d.z >= 0.0 {
                            put(on + Vec3::Z * half_length);
                        }
                        if d.z <= 0.0 {
                            put(on - Vec3::Z * half_length);
                        }
                    }
                }
                _ => AROUND.iter().filter(|d| d.abs() == Vec3::ONE).for_each(|d| put(half * *d)),
            }
        }
        out
    }
}

impl Geom {
    /// Whether it is visible.
    pub(super) fn is_visible(&self) -> bool {
        let r = self.shape.radii();
        self.rgba.last().is_some_and(|a| *a > 0.0)
            && match self.shape {
                Shape::Plane { .. } => true,
                // With one zero edge it has no volume; models use such shapes as markers.
                _ => r.min_element() > 0.0,
            }
    }
}

impl Shape {
    /// Scale of the unit shape.
    pub(super) fn radii(&self) -> Vec3 {
        match *self {
            Shape::Sphere { radius } | Shape::Capsule { radius, .. } => Vec3::splat(radius),
            Shape::Ellipsoid { radii } => radii,
            Shape::Cylinder { radius, half_length } => Vec3::new(radius, radius, half_length),
            Shape::Box { half } => half,
            Shape::Plane { half_x, half_y } => Vec3::new(half_x, half_y, 0.0),
            Shape::Mesh { .. } => Vec3::ONE,
        }
    }
}

/// To the middles of the faces, edges and corners of a box.
const AROUND: [Vec3; 26] = {
    let mut out = [Vec3::ZERO; 26];
    let (mut k, mut i) = (0, 0);
    while k < 27 {
        if k != 13 {
            let (x, y, z) = (k % 3, k / 3 % 3, k / 9);
            out[i] = Vec3::new(x as f32 - 1.0, y as f32 - 1.0, z as f32 - 1.0);
            i += 1;
        }
        k += 1;
    }
    out
};

fn label(index: usize, name: &str) -> String {
    if name.is_empty() { format!("{index}") } else { format!("{name:?}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Camera, Lens, View};

    fn ball(radius: f32) -> Geom {
        Geom { name: "tip".into(), body: 1, shape: Shape::Sphere { radius }, rgba: [1.0; 4] }
    }

    #[test]
    fn poses_must_fit_and_be_finite() {
        let scene = Scene::new(vec![ball(0.1)], vec![], None).unwrap();
        assert!(matches!(scene.check("achieved", &[]), Err(Error::PoseCount { .. })));
        let text =
            scene.check("achieved", &[Pose::at(f32::NAN, 0.0, 0.0)]).unwrap_err().to_string();
        assert!(text.contains("tip"), "{text}");
        assert!(scene.check("achieved", &[Pose::IDENTITY]).is_ok());
    }

    #[test]
    fn shapes_without_extent_are_not_seen() {
        assert!(!ball(0.0).is_visible());
        assert!(Scene::new(vec![ball(0.0)], vec![], None).is_ok());
        assert!(Scene::new(vec![ball(f32::INFINITY)], vec![], None).is_err());
        let mesh = Geom { shape: Shape::Mesh { mesh: 3 }, ..ball(1.0) };
        assert!(matches!(Scene::new(vec![mesh], vec![], None), Err(Error::Mesh { .. })));
    }

    /// Whatever the direction, a ball or capsule ends within the margin around its points.
    #[test]
    fn a_camera_that_holds_the_points_holds_the_ball() {
        let capsule = Shape::Capsule { radius: 0.3, half_length: 0.5 };
        for (shape, reach) in [(Shape::Sphere { radius: 0.3 }, 0.0), (capsule, 0.5_f32)] {
            let geom = Geom { shape, ..ball(0.3) };
            let scene = Scene::new(vec![geom], vec![], None).unwrap();
            let points = scene.corners(&[Pose::at(1.0, 2.0, 3.0)]);
            let on = |p: &Vec3| {
                let p = *p - Vec3::new(1.0, 2.0, 3.0);
                (p - Vec3::Z * p.z.clamp(-reach, reach)).length()
            };
            assert!(points.iter().all(|p| (on(p) - 0.3).abs() < 1e-5), "on the surface");
            for k in 0..400 {
                let z = 1.0 - (2 * k + 1) as f32 / 400.0;
                let (sin, cos) = (2.4 * k as f32).sin_cos();
                let d = Vec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
                let far = points.iter().map(|p| d.dot(*p - Vec3::new(1.0, 2.0, 3.0)));
                let far = far.fold(f32::MIN, f32::max);
                let true_far = 0.3 + reach * d.z.abs();
                assert!(true_far / far < 1.14, "{d}: {far} of {true_far}");
            }
        }
        // From every side the whole of it is in the picture.
        let scene = Scene::new(vec![ball(5.0)], vec![], None).unwrap();
        let points = scene.corners(&[Pose::IDENTITY]);
        for azimuth in 0..12 {
            for elevation in [-0.3, 0.0, 0.38, 1.0] {
                let view = View::default().from(0.55 * azimuth as f32, elevation);
                let camera = Camera::fit(&points, &view, 1.4);
                let distance = camera.eye.length();
                let Lens::Perspective { fov_y_rad } = camera.lens else { unreachable!() };
                let (rim, edge) = ((5.0 / distance).asin(), 0.5 * fov_y_rad);
                let off = (camera.target - camera.eye).angle_between(-camera.eye);
                assert!(rim + off < edge, "{azimuth} {elevation}: {rim} + {off} of {edge}");
            }
        }
    }

    #[test]
    fn mujoco_rows_become_columns() {
        // A quarter turn about z takes x to y.
        let pose = Pose::from_mujoco(&[0.0; 3], &[0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        assert!((pose.rot * Vec3::X - Vec3::Y).length() < 1e-6);
    }
}
