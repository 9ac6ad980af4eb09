//! The scenes of the reference pictures.

use std::sync::Arc;

use glam::{Mat3, Vec3};
use robert::mujoco::{Data, Model};
use robert::render::poses;
use robert::render::{
    Camera, Caption, Floor, FrameInput, Geom, Ghost, Glyph, Key, Mark, Mesh, Pose, Scene, Shape,
    Stage, Swatch, Trail, View, sun_for,
};
use robert::robot::Robot;

/// Everything one picture needs, owned.
pub(super) struct Drawing {
    pub name: &'static str,
    scene: Scene,
    poses: Vec<Pose>,
    ghosts: Vec<(Vec<Pose>, Vec<f32>, u8)>,
    trail: Vec<Vec3>,
    marks: Vec<Mark>,
    glyphs: Vec<Glyph>,
    caption: Option<Caption>,
    camera: Camera,
}

const ASPECT: f32 = 4.0 / 3.0;

impl Drawing {
    fn new(name: &'static str, scene: Scene, poses: Vec<Pose>, view: &View) -> Drawing {
        let camera = Camera::fit(&scene.corners(&poses), view, ASPECT);
        Drawing {
            name,
            scene,
            poses,
            ghosts: vec![],
            trail: vec![],
            marks: vec![],
            glyphs: vec![],
            caption: None,
            camera,
        }
    }

    pub(super) fn with<T>(&self, f: impl FnOnce(&Scene, &FrameInput) -> T) -> T {
        let ghosts: Vec<Ghost> = self
            .ghosts
            .iter()
            .map(|(poses, error, kind)| match kind {
                0 => Ghost { error, ..Ghost::command(poses) },
                1 => Ghost::onion(poses, true),
                _ => Ghost::onion(poses, false),
            })
            .collect();
        let trails = [Trail::new(&self.trail, [0.9, 0.6, 0.1])];
        let input = FrameInput {
            ghosts: &ghosts,
            trails: if self.trail.is_empty() { &[] } else { &trails },
            marks: &self.marks,
            glyphs: &self.glyphs,
            caption: self.caption.as_ref(),
            sun: Some(sun_for(&self.camera)),
            ..FrameInput::new(&self.poses, self.camera)
        };
        f(&self.scene, &input)
    }
}

fn geom(shape: Shape, rgb: [f32; 3]) -> Geom {
    Geom { name: String::new(), body: 0, shape, rgba: [rgb[0], rgb[1], rgb[2], 1.0] }
}

fn floor() -> Option<Floor> {
    Some(Floor { z: 0.0 })
}

/// One shape, upright and tilted.
fn pair(name: &'static str, shape: Shape, rgb: [f32; 3]) -> Drawing {
    let scene =
        Scene::new(vec![geom(shape, rgb), geom(shape, [0.85; 3])], vec![], floor()).unwrap();
    let tilt = Mat3::from_rotation_y(0.9) * Mat3::from_rotation_x(0.5);
    let poses = vec![Pose::at(-0.16, 0.0, 0.17), Pose::at(0.16, 0.0, 0.17).turned(tilt)];
    Drawing::new(name, scene, poses, &View::default())
}

/// A torus: curved, with a hole, casting a shadow on itself.
fn torus() -> Mesh {
    let (n, m) = (40_u32, 20_u32);
    let at = |i: u32, j: u32| {
        let (a, b) = (
            std::f32::consts::TAU * i as f32 / n as f32,
            std::f32::consts::TAU * j as f32 / m as f32,
        );
        let r = 0.12 + 0.045 * b.cos();
        [r * a.cos(), r * a.sin(), 0.045 * b.sin()]
    };
    let vertices: Vec<[f32; 3]> = (0..n).flat_map(|i| (0..m).map(move |j| at(i, j))).collect();
    let id = |i: u32, j: u32| (i % n) * m + j % m;
    let faces: Vec<[u32; 3]> = (0..n)
        .flat_map(|i| {
            (0..m).flat_map(move |j| {
                [
                    [id(i, j), id(i + 1, j), id(i + 1, j + 1)],
                    [id(i, j), id(i + 1, j + 1), id(i, j + 1)],
                ]
            })
        })
        .collect();
    Mesh::new("torus", &vertices, &faces).unwrap()
}

fn arm(bend: f32) -> Vec<Pose> {
    let lower = Pose::at(0.0, 0.0, 0.12);
    let turn = Mat3::from_rotation_y(bend);
    let upper = Pose { pos: Vec3::new(0.0, 0.0, 0.22) + turn * Vec3::Z * 0.1, rot: turn };
    let tip = Pose { pos: Vec3::new(0.0, 0.0, 0.22) + turn * Vec3::Z * 0.22, rot: turn };
    vec![lower, upper, tip]
}

fn arm_scene() -> Scene {
    let link = |r| Shape::Capsule { radius: r, half_length: 0.1 };
    let geoms = vec![
        geom(link(0.03), [0.2, 0.22, 0.25]),
        geom(link(0.026), [0.85, 0.85, 0.86]),
        geom(Shape::Sphere { radius: 0.04 }, [0.85, 0.35, 0.2]),
    ];
    Scene::new(geoms, vec![], floor()).unwrap()
}

fn arm_drawing(name: &'static str) -> Drawing {
    let mut all = arm(0.3);
    all.extend(arm(1.1));
    let scene = arm_scene();
    let mut d = Drawing::new(name, scene, arm(0.3), &View::default().from(-1.3, 0.35));
    let corners: Vec<Vec3> =
        [arm(0.3), arm(1.1), arm(-0.6)].iter().flat_map(|p| d.scene.corners(p)).collect();
    d.camera = Camera::fit(&corners, &View::default().from(-1.3, 0.35), ASPECT);
    d
}

fn robot(name: &'static str, id: &str, pose: Option<&str>) -> Drawing {
    let robot = Arc::new(Robot::builtin(id).unwrap());
    let mut stage = Stage::new(&robot).unwrap();
    let state = pose.map_or_else(|| robot.home(), |p| robot.pose(p).unwrap());
    let poses = stage.poses(&state).unwrap();
    let camera = Camera::fit(&stage.moving_corners(&poses), &stage.view(), ASPECT);
    let mut d = Drawing::new(name, stage.scene().clone(), poses, &stage.view());
    d.camera = camera;
    d
}

/// Hills with a ball on them, through the simulator: rows, columns and heights its own way.
fn height_field() -> Drawing {
    let (rows, columns) = (24_i32, 40_i32);
    let mut hills = [rows, columns].map(i32::to_le_bytes).concat();
    for r in 0..rows {
        for c in 0..columns {
            // A ridge along x and one peak near the far right corner: no symmetry to hide behind.
            let (x, y) = (c as f32 / (columns - 1) as f32, r as f32 / (rows - 1) as f32);
            let peak = (-40.0 * ((x - 0.8).powi(2) + (y - 0.75).powi(2))).exp();
            let ridge = 0.35 * (-30.0 * (y - 0.3).powi(2)).exp();
            hills.extend((peak + ridge).to_le_bytes());
        }
    }
    let xml = r#"<mujoco><asset><hfield name="hills" file="hills.bin" size=".4 .25 .16 .02"/></asset>
        <worldbody><geom type="plane" size="0 0 1"/><geom type="hfield" hfield="hills" pos="0 0 .02" rgba=".45 .6 .35 1"/>
        <geom type="sphere" size=".05" pos="-.2 .05 .09" rgba=".8 .35 .2 1"/></worldbody></mujoco>"#;
    let files: [(&str, &[u8]); 2] = [("model.xml", xml.as_bytes()), ("hills.bin", &hills)];
    let model = Arc::new(Model::from_assets("model.xml", &files).unwrap());
    let mut data = Data::new(&model).unwrap();
    data.kinematics().unwrap();
    let scene = Scene::from_model(&model).unwrap();
    Drawing::new("height_field", scene, poses(&data), &View::default())
}

pub(super) fn all() -> Vec<Drawing> {
    let mut out = vec![
        pair("sphere", Shape::Sphere { radius: 0.1 }, [0.2, 0.5, 0.75]),
        pair("capsule", Shape::Capsule { radius: 0.05, half_length: 0.08 }, [0.75, 0.25, 0.15]),
        pair("ellipsoid", Shape::Ellipsoid { radii: Vec3::new(0.12, 0.06, 0.09) }, [0.2, 0.6, 0.4]),
        pair("cylinder", Shape::Cylinder { radius: 0.07, half_length: 0.09 }, [0.85, 0.55, 0.1]),
        pair("box", Shape::Box { half: Vec3::new(0.09, 0.06, 0.08) }, [0.5, 0.35, 0.65]),
        pair("plane", Shape::Plane { half_x: 0.12, half_y: 0.09 }, [0.3, 0.45, 0.5]),
    ];
    let mesh = Geom {
        shape: Shape::Mesh { mesh: 0 },
        ..geom(Shape::Sphere { radius: 1.0 }, [0.75, 0.6, 0.3])
    };
    let scene = Scene::new(vec![mesh], vec![torus()], floor()).unwrap();
    let tilted = Pose::at(0.0, 0.0, 0.16).turned(Mat3::from_rotation_x(0.9));
    out.push(Drawing::new("mesh", scene, vec![tilted], &View::default()));

    let mut glass = geom(Shape::Box { half: Vec3::splat(0.1) }, [0.3, 0.6, 0.9]);
    glass.rgba[3] = 0.35;
    let inside = geom(Shape::Sphere { radius: 0.05 }, [0.9, 0.4, 0.2]);
    let sunk = geom(Shape::Sphere { radius: 0.07 }, [0.8; 3]);
    let scene = Scene::new(vec![glass, inside, sunk], vec![], floor()).unwrap();
    let poses = vec![Pose::at(0.0, 0.0, 0.12), Pose::at(0.0, 0.0, 0.12), Pose::at(0.22, 0.0, 0.0)];
    out.push(Drawing::new("glass_and_floor", scene, poses, &View::default()));

    let mut d = arm_drawing("ghost");
    d.ghosts = vec![(arm(1.1), vec![0.0, 0.4, 1.0], 0)];
    out.push(d);
    let mut d = arm_drawing("onion_skins");
    d.ghosts = vec![(arm(1.1), vec![], 2), (arm(-0.6), vec![], 1)];
    out.push(d);
    let mut d = arm_drawing("trail_and_marks");
    d.trail = (0..=30).map(|i| arm(1.1 - 0.8 * i as f32 / 30.0)[2].pos).collect();
    d.marks = [1.1, 0.7, 0.3]
        .map(|b| Mark { at: arm(b)[2].pos, color: [0.0, 0.45, 0.7], size: 7.0 })
        .to_vec();
    out.push(d);
    let mut d = arm_drawing("axis_and_contact");
    d.glyphs = vec![
        Glyph::JointAxis { anchor: Vec3::new(0.0, 0.0, 0.22), axis: Vec3::Y, length: 0.25 },
        Glyph::Contact { at: Vec3::new(0.2, 0.0, 0.0), normal: Vec3::Z, length: 0.15 },
    ];
    out.push(d);
    let mut d = arm_drawing("caption");
    d.caption = Some(Caption {
        title: "caption".into(),
        line: "frame 40 · 2.00 s · Precision 0.031 rad".into(),
        legend: vec![
            Key { swatch: Swatch::Solid, color: [208, 212, 218], text: "achieved".into() },
            Key { swatch: Swatch::Ghost, color: [56, 152, 226], text: "command".into() },
            Key { swatch: Swatch::Cross, color: [56, 152, 226], text: "keyframe".into() },
        ],
        ..Caption::default()
    });
    out.push(d);
    let mut d = arm_drawing("from_above");
    d.camera = Camera::fit(&d.scene.corners(&d.poses), &View::top(), ASPECT);
    out.push(d);
    out.push(height_field());
    out.push(robot("pointmass", "pointmass", None));
    out.push(robot("ur5e", "ur5e", None));
    out.push(robot("shadow_hand", "shadow_hand", Some("gun")));
    out
}
