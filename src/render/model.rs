//! Converts a compiled model into a scene, and joint coordinates into poses of its geoms.

use std::sync::Arc;

use glam::Vec3;

use super::scene::{Floor, Geom, Pose, Scene, Shape};
use super::{Camera, CameraChoice, Error, Lens, Mesh, View};
use robert_mujoco::{self as mujoco, Data, Kind, Model, index};
use robert_plot::palette::{self, Theme};
use robert_robot::{self as robot, Robot};

/// Groups from this one on are for collision; they are drawn only if there is nothing else.
const COLLISION_GROUP: i32 = 3;
/// Cells along one edge of a height field.
const FIELD_CELLS: usize = 1024;

impl Scene {
    /// The visible content of a compiled model. Geom `i` of the scene is geom `i` of the model. A
    /// horizontal plane of the world becomes the floor. A model without one gets a floor below its
    /// lowest point, or at zero if it is above that.
    ///
    /// # Errors
    /// [`Error::Mesh`], [`Error::Geoms`], [`Error::NotFinite`].
    pub fn from_model(model: &Model) -> Result<Scene, Error> {
        let mut meshes = Vec::new();
        for i in 0..model.nmesh() {
            meshes.push(mesh(model, i)?);
        }
        let fields = meshes.len();
        for i in 0..model.nhfield() {
            meshes.push(field(model, i)?);
        }
        let shown = shown_groups(model);
        let mut geoms = Vec::with_capacity(model.ngeom());
        let mut floor = None;
        for i in 0..model.ngeom() {
            let mut geom = geom(model, i, fields);
            let group = model.geom_group()[i];
            if !shown(group) {
                geom.rgba[3] = 0.0;
            }
            if let Some(z) = floor_height(model, i, &geom)
                && shown(group)
            {
                floor.get_or_insert(Floor { z });
                geom.rgba[3] = 0.0;
            }
            geoms.push(geom);
        }
        let bodies = (0..model.nbody())
            .map(|i| model.name(Kind::Body, i).unwrap_or_default().to_owned())
            .collect();
        Ok(Scene::new(geoms, meshes, floor)?.with_bodies(bodies))
    }
}

/// What is farther from the moving parts than this many times their size belongs to no robot.
const NEAR: f32 = 3.0;

/// A robot with its scene and a simulation that is only used for kinematics.
#[derive(Debug)]
pub struct Stage {
    scene: Scene,
    data: Data,
    robot: Arc<Robot>,
    /// Per body: whether it moves or carries one that does.
    subject: Vec<bool>,
}

impl Stage {
    /// The robot's drawing model (visual geoms included).
    ///
    /// # Errors
    /// [`Error::Robot`] when the drawing model does not compile, and as [`Scene::from_model`].
    pub fn new(robot: &Arc<Robot>) -> Result<Stage, Error> {
        let model = robot.scene_model().map_err(Error::robot)?;
        let mut data = Data::new(model).map_err(Error::simulator)?;
        robot.write_state(&mut data, &robot.home()).map_err(Error::robot)?;
        data.kinematics().map_err(Error::simulator)?;
        let mut scene = Scene::from_model(model)?;
        if scene.floor.is_none() {
            let low =
                scene.corners(&poses(&data)).iter().fold(f32::INFINITY, |low, p| low.min(p.z));
            scene.floor = Some(Floor { z: if low.is_finite() { low.min(0.0) } else { 0.0 } });
        }
        let subject = subject(model);
        Ok(Stage { scene, data, robot: Arc::clone(robot), subject })
    }

    /// The scene that is drawn.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The robot.
    pub fn robot(&self) -> &Arc<Robot> {
        &self.robot
    }

    /// Poses of all geoms at a state (rad or m, in state order).
    ///
    /// # Errors
    /// [`Error::Robot`] for a wrong length or values that are not finite.
    pub fn poses(&mut self, state: &[f64]) -> Result<Vec<Pose>, Error> {
        self.place(state)?;
        Ok(poses(&self.data))
    }

    /// Position of a site (a fingertip, the end effector) at a state, metres.
    ///
    /// # Errors
    /// [`Error::Robot`].
    pub fn site(&mut self, state: &[f64], site: usize) -> Result<Vec3, Error> {
        self.place(state)?;
        Ok(vec3(self.data.site_xpos(), site))
    }

    /// Position of a body at a state, metres.
    ///
    /// # Errors
    /// [`Error::Robot`].
    pub fn body(&mut self, state: &[f64], body: usize) -> Result<Vec3, Error> {
        self.place(state)?;
        Ok(vec3(self.data.xpos(), body))
    }

    /// Corners of the parts that a picture of this robot should show: links that can move, and the
    /// parts that they are attached to. A pedestal is left out.
    pub fn moving_corners(&self, poses: &[Pose]) -> Vec<Vec3> {
        let corners = self.scene.corners_of(poses, |g| self.subject.get(g.body) == Some(&true));
        if corners.is_empty() { self.scene.corners(poses) } else { corners }
    }

    /// Corners of the parts of the robot that stand still, such as a pedestal, or an arm without joints.
    /// Imports make still parts a part of the world. What of that is far larger or farther away than the moving
    /// parts, whose corners are given, is scenery.
    pub fn still_corners(&self, poses: &[Pose], moving: &[Vec3]) -> Vec<Vec3> {
        let low = moving.iter().fold(Vec3::INFINITY, |a, p| a.min(*p));
        let high = moving.iter().fold(Vec3::NEG_INFINITY, |a, p| a.max(*p));
        let reach = Vec3::splat(NEAR * low.distance(high));
        let is_near = |at: Vec3, radius: f32| {
            (at - radius).cmpge(low - reach).all() && (at + radius).cmple(high + reach).all()
        };
        self.scene.corners_within(poses, |g, at, radius| {
            self.subject.get(g.body) != Some(&true) && (g.body != 0 || is_near(at, radius))
        })
    }

    /// Anchor and axis of every joint at the state of the last call, metres.
    pub fn joint_axes(&self) -> Vec<(Vec3, Vec3)> {
        let rows = |a: &[f64]| -> Vec<Vec3> {
            a.chunks_exact(3).map(|v| Vec3::new(v[0] as f32, v[1] as f32, v[2] as f32)).collect()
        };
        rows(self.data.xanchor()).into_iter().zip(rows(self.data.xaxis())).collect()
    }

    /// Places and force directions of contacts at a state, metres. The simulator computes them, so
    /// they exist only if the drawing model has contacts.
    ///
    /// # Errors
    /// [`Error::Robot`], [`Error::Simulator`].
    pub fn contacts(&mut self, state: &[f64]) -> Result<Vec<(Vec3, Vec3)>, Error> {
        self.place(state)?;
        self.data.forward().map_err(Error::simulator)?;
        let vec = |v: [f64; 3]| Vec3::from_array(v.map(|x| x as f32));
        Ok(self.data.contacts().map(|c| (vec(c.pos), vec(c.normal))).collect())
    }

    /// The points whose paths are drawn: end effector or fingertips (the sites of the profile's
    /// inverse kinematics), or the origin of its last body.
    pub fn tips(&self) -> Vec<usize> {
        let profile = self.robot.profile();
        profile.ik_sites.iter().filter_map(|s| self.data.model().id(Kind::Site, s)).collect()
    }

    /// The most saturated colour of the body of a site; a default colour for a grey body.
    pub fn accent(&self, site: usize, index: usize) -> [f32; 3] {
        let body = self.data.model().site_bodyid().get(site).and_then(|b| usize::try_from(*b).ok());
        let vivid = |c: &[f32; 4]| {
            let (low, high) = (c[0].min(c[1]).min(c[2]), c[0].max(c[1]).max(c[2]));
            high - low
        };
        let own = self.scene.geoms().iter().filter(|g| Some(g.body) == body && g.rgba[3] > 0.0);
        let best = own.map(|g| g.rgba).max_by(|a, b| vivid(a).total_cmp(&vivid(b)));
        match best {
            Some(c) if vivid(&c) > 0.25 => [c[0], c[1], c[2]],
            _ => palette::unit(if index == 0 { palette::ORANGE } else { Theme::Dark.line(index) }),
        }
    }

    /// The error per geom, 0 to 1: the distance between both poses, 1 at `full_m`.
    pub fn error(reached: &[Pose], commanded: &[Pose], full_m: f32) -> Vec<f32> {
        reached
            .iter()
            .zip(commanded)
            .map(|(a, b)| (a.pos.distance(b.pos) / full_m.max(1e-6)).min(1.0))
            .collect()
    }

    /// The profile's direction and lens, to be fitted to what moves.
    pub fn view(&self) -> View {
        View::of(&self.robot.profile().camera)
    }

    /// The profile's camera, unchanged.
    pub fn fixed_camera(&self) -> Camera {
        let c = &self.robot.profile().camera;
        let target = Vec3::from_array(c.lookat.map(|x| x as f32));
        Camera::orbit(target, c.distance as f32, &View::of(c))
    }

    /// A camera of the model, by name.
    ///
    /// # Errors
    /// [`Error::Unknown`] with the existing names.
    pub fn model_camera(&self, name: &str) -> Result<Camera, Error> {
        let model = self.data.model();
        let Some(id) = model.id(Kind::Camera, name) else {
            let own = (0..model.ncam()).filter_map(|i| model.name(Kind::Camera, i));
            let known: Vec<&str> = CameraChoice::NAMES.into_iter().chain(own).collect();
            return Err(Error::Unknown {
                kind: "camera",
                name: name.to_owned(),
                known: known.join(", "),
            });
        };
        let eye = vec3(self.data.cam_xpos(), id);
        // The camera looks along its -z: the third column of a row-major matrix.
        let turn = self.data.cam_xmat();
        let back = Vec3::from_array([2, 5, 8].map(|k| turn[9 * id + k] as f32));
        let fov_y_rad = (model.cam_fovy()[id] as f32).to_radians();
        Ok(Camera { eye, target: eye - back, lens: Lens::Perspective { fov_y_rad } })
    }

    fn place(&mut self, state: &[f64]) -> Result<(), Error> {
        self.robot.write_state(&mut self.data, state).map_err(Error::robot)?;
        self.data.kinematics().map_err(Error::simulator)
    }
}

fn subject(model: &Model) -> Vec<bool> {
    let weld = model.body_weldid();
    let moves = |b: usize| weld.get(b).is_some_and(|w| *w != 0);
    let mut subject: Vec<bool> = (0..model.nbody()).map(moves).collect();
    for (b, parent) in model.body_parentid().iter().enumerate() {
        let Ok(parent) = usize::try_from(*parent) else { continue };
        if moves(b) && parent != 0 {
            subject[parent] = true;
        }
    }
    subject
}

impl View {
    /// The direction and lens of a robot's own camera, to be fitted to what moves.
    pub fn of(c: &robot::Camera) -> View {
        View {
            // The simulator's azimuth is the direction of sight, ours that of the eye.
            azimuth_rad: c.azimuth_rad as f32 + std::f32::consts::PI,
            elevation_rad: -c.elevation_rad as f32,
            lens: Lens::Perspective { fov_y_rad: c.fovy_rad as f32 },
            ..View::default()
        }
    }
}

/// Poses of all geoms of a simulation, after forward kinematics.
pub fn poses(data: &Data) -> Vec<Pose> {
    data.geom_xpos()
        .chunks_exact(3)
        .zip(data.geom_xmat().chunks_exact(9))
        .map(|(p, m)| {
            let mut xpos = [0.0; 3];
            let mut xmat = [0.0; 9];
            xpos.copy_from_slice(p);
            xmat.copy_from_slice(m);
            Pose::from_mujoco(&xpos, &xmat)
        })
        .collect()
}

/// The drawn visibility groups: the visual ones, or all if a model has no visual ones.
fn shown_groups(model: &Model) -> impl Fn(i32) -> bool {
    let plane = Some(mujoco::Geom::Plane);
    let any = (0..model.ngeom()).any(|i| {
        model.geom_kind(i) != plane
            && model.geom_group().get(i).is_some_and(|g| *g < COLLISION_GROUP)
            && model.geom_color(i).is_some_and(|c| c[3] > 0.0)
    });
    move |group| !any || group < COLLISION_GROUP
}

/// Position `i` in a list of positions, metres.
fn vec3(positions: &[f64], i: usize) -> Vec3 {
    Vec3::from_array(positions.as_chunks::<3>().0[i].map(|x| x as f32))
}

fn geom(model: &Model, i: usize, fields: usize) -> Geom {
    let size = |k: usize| model.geom_size()[3 * i + k] as f32;
    let data = || index(model.geom_dataid()[i]);
    let shape = match model.geom_kind(i) {
        Some(mujoco::Geom::Plane) => Shape::Plane { half_x: size(0), half_y: size(1) },
        Some(mujoco::Geom::HField) => Shape::Mesh { mesh: fields.saturating_add(data()) },
        Some(mujoco::Geom::Sphere) => Shape::Sphere { radius: size(0) },
        Some(mujoco::Geom::Capsule) => Shape::Capsule { radius: size(0), half_length: size(1) },
        Some(mujoco::Geom::Ellipsoid) => {
            Shape::Ellipsoid { radii: Vec3::new(size(0), size(1), size(2)) }
        }
        Some(mujoco::Geom::Cylinder) => Shape::Cylinder { radius: size(0), half_length: size(1) },
        Some(mujoco::Geom::Box) => Shape::Box { half: Vec3::new(size(0), size(1), size(2)) },
        Some(mujoco::Geom::Mesh) => Shape::Mesh { mesh: data() },
        // Types that the simulator itself never draws.
        None => Shape::Sphere { radius: 0.0 },
    };
    Geom {
        name: model.name(Kind::Geom, i).unwrap_or_default().to_owned(),
        body: index(model.geom_bodyid()[i]),
        shape,
        rgba: model.geom_color(i).unwrap_or([0.5, 0.5, 0.5, 1.0]),
    }
}

/// Height of a horizontal plane of the world. It collides without end, whatever size it is drawn with.
fn floor_height(model: &Model, i: usize, geom: &Geom) -> Option<f32> {
    if !matches!(geom.shape, Shape::Plane { .. }) {
        return None;
    }
    let quat = model.geom_quat().get(4 * i..4 * i + 4)?;
    // The plane's normal points up: the quaternion turns about z only.
    let level = quat[1].abs() < 1e-6 && quat[2].abs() < 1e-6;
    let up = model.geom_pos().get(3 * i + 2)?;
    (level && geom.body == 0).then_some(*up as f32)
}

fn range(adr: &[i32], num: &[i32], i: usize, k: usize) -> Option<std::ops::Range<usize>> {
    let from = usize::try_from(*adr.get(i)?).ok()?;
    let len = usize::try_from(*num.get(i)?).ok()?;
    Some(k * from..k * (from + len))
}

fn mesh(model: &Model, i: usize) -> Result<Mesh, Error> {
    let name = model.name(Kind::Mesh, i).unwrap_or_default();
    let vertices = range(model.mesh_vertadr(), model.mesh_vertnum(), i, 3)
        .and_then(|r| model.mesh_vert().get(r))
        .unwrap_or_default();
    let faces = range(model.mesh_faceadr(), model.mesh_facenum(), i, 3)
        .and_then(|r| model.mesh_face().get(r))
        .unwrap_or_default();
    let vertices: Vec<[f32; 3]> = vertices.as_chunks::<3>().0.to_vec();
    let faces: Vec<[u32; 3]> = faces
        .as_chunks::<3>()
        .0
        .iter()
        .map(|f| f.map(|v| u32::try_from(v).unwrap_or(u32::MAX)))
        .collect();
    Mesh::new(name, &vertices, &faces)
}

fn field(model: &Model, i: usize) -> Result<Mesh, Error> {
    let name = format!("height field {i}");
    let (rows, columns) = (index(model.hfield_nrow()[i]), index(model.hfield_ncol()[i]));
    let fail = |reason: String| Error::Mesh { mesh: name.clone(), reason };
    if rows < 2 || columns < 2 || rows > FIELD_CELLS || columns > FIELD_CELLS {
        return Err(fail(format!(
            "{rows}x{columns} samples; each side must have 2 to {FIELD_CELLS}"
        )));
    }
    let from = index(model.hfield_adr()[i]);
    let heights = model
        .hfield_data()
        .get(from..from + rows * columns)
        .ok_or_else(|| fail("its samples are missing".to_owned()))?;
    let size = |k: usize| model.hfield_size()[4 * i + k] as f32;
    let place =
        |k: usize, count: usize, half: f32| half * (2.0 * k as f32 / (count - 1) as f32 - 1.0);
    let mut vertices = Vec::with_capacity(rows * columns);
    for r in 0..rows {
        for c in 0..columns {
            let z = heights[r * columns + c] * size(2);
            vertices.push([place(c, columns, size(0)), place(r, rows, size(1)), z]);
        }
    }
    let mut faces = Vec::with_capacity(2 * rows * columns);
    for r in 0..rows - 1 {
        for c in 0..columns - 1 {
            let a = (r * columns + c) as u32;
            let b = a + columns as u32;
            faces.push([a, a + 1, b + 1]);
            faces.push([a, b + 1, b]);
        }
    }
    Mesh::new(&name, &vertices, &faces)
}
