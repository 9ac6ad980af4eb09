//! Converts poses into draw lists: instances grouped by mesh, lines divided into segments, and
//! their bounds for the passes.

use std::collections::BTreeMap;
use std::f32::consts::TAU;
use std::ops::Range;

use glam::{Mat3, Mat4, Vec3};

use super::camera::{Camera, Lens};
use super::frame::{FrameInput, Ghost, GhostKind, Glyph, Mark, SUN, Trail};
use super::gpu::{Instance, Segment};
use super::prims::Prim;
use super::scene::{Geom, Pose, Scene, Shape};
use robert_plot::palette;

/// The shape of an instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Key {
    Prim(Prim),
    Mesh(usize),
}

/// Instances of one mesh.
#[derive(Clone, Debug)]
pub(super) struct Batch {
    pub key: Key,
    pub range: Range<u32>,
}

/// A frame, ready for the device.
#[derive(Debug, Default)]
pub(super) struct Drawn {
    pub instances: Vec<Instance>,
    pub segments: Vec<Segment>,
    /// Solid, with shadow.
    pub casters: Vec<Batch>,
    /// Solid, without shadow (planes, arrows).
    pub props: Vec<Batch>,
    /// Translucent parts of the model.
    pub glass: Vec<Batch>,
    pub ghosts: Vec<Batch>,
    /// Symbols that are drawn over everything else.
    pub signs: Vec<Batch>,
    /// Corners of the box around everything that casts a shadow.
    pub casting: Option<(Vec3, Vec3)>,
    /// Ball around the same.
    pub centre: Vec3,
    pub radius: f32,
    pub near: f32,
    pub far: f32,
    /// Whether anything reaches below the floor.
    pub below_floor: bool,
    /// The part of the picture with objects, pixels: x, y, width, height. `None` = all of it.
    pub rect: Option<[u32; 4]>,
    /// The part with objects or their shadows on the floor.
    pub shaded: Option<[u32; 4]>,
}

impl Key {
    /// The same form with fewer triangles, for its shadow.
    pub(super) fn coarser(self) -> Key {
        match self {
            Key::Prim(p) => Key::Prim(p.coarser()),
            Key::Mesh(_) => self,
        }
    }
}

impl Drawn {
    /// The used part of a shadow map with edges of `px` texels: x, y, width, height.
    pub(super) fn shadow_rect(&self, light: &Mat4, px: u32) -> [u32; 4] {
        let Some((low, high)) = self.casting else { return [0; 4] };
        let mut r = [1.0_f32, 1.0, -1.0, -1.0];
        for corner in corners(low, high) {
            let p = light.project_point3(corner);
            r = [r[0].min(p.x), r[1].min(p.y), r[2].max(p.x), r[3].max(p.y)];
        }
        pixels(r, px as f32, px as f32)
    }
}

/// Half edge of an infinite plane, in picture heights.
const ENDLESS: f32 = 40.0;
/// Ghosts closer than this many pixels to the solid pose are not drawn. From four times this
/// distance on they have their full opacity.
const COINCIDE_PX: f32 = 1.0;
/// Colour of contacts; it differs from every colour of a pose, because contacts are inside other
/// shapes.
pub(super) const CONTACT: palette::Rgb = [222, 30, 130];
/// The colour of joint axes.
pub(super) const AXIS: palette::Rgb = palette::VERMILION;

#[derive(Default)]
struct List(BTreeMap<Key, Vec<Instance>>);

impl List {
    fn push(&mut self, key: Key, instance: Instance) {
        self.0.entry(key).or_default().push(instance);
    }

    /// Sorted front to back, so that hidden parts are not shaded. Translucent lists are not sorted.
    fn flush_sorted(mut self, into: &mut Vec<Instance>, forward: Vec3) -> Vec<Batch> {
        let depth = |i: &Instance| {
            let [x, y, z] = i.rows.map(|r| r[3]);
            Vec3::new(x, y, z).dot(forward)
        };
        for list in self.0.values_mut() {
            list.sort_by(|a, b| depth(a).total_cmp(&depth(b)));
        }
        self.flush(into)
    }

    fn flush(self, into: &mut Vec<Instance>) -> Vec<Batch> {
        let mut batches = Vec::with_capacity(self.0.len());
        for (key, mut list) in self.0 {
            let from = into.len() as u32;
            into.append(&mut list);
            batches.push(Batch { key, range: from..into.len() as u32 });
        }
        batches
    }
}

/// Running bounds of the visible content.
struct Reach<'a> {
    camera: &'a Camera,
    aspect: f32,
    forward: Vec3,
    near: f32,
    far: f32,
    low: Vec3,
    high: Vec3,
    floor_z: f32,
    below: bool,
    /// Left, bottom, right, top in -1..1.
    rect: [f32; 4],
    everywhere: bool,
}

impl Reach<'_> {
    fn ball(&mut self, at: Vec3, radius: f32, casts: bool) {
        let depth = (at - self.camera.eye).dot(self.forward);
        self.near = self.near.min(depth - radius);
        self.far = self.far.max(depth + radius);
        self.below |= at.z - radius < self.floor_z - 1e-5;
        if casts {
            self.low = self.low.min(at - Vec3::splat(radius));
            self.high = self.high.max(at + Vec3::splat(radius));
        }
        // In perspective a sphere appears wider than its radius at its centre's depth.
        let perspective = matches!(self.camera.lens, Lens::Perspective { .. });
        if perspective && depth <= radius * 1.5 {
            self.everywhere |= depth > -radius;
            return;
        }
        let Some(p) = self.camera.project(at, self.aspect) else { return };
        let scale = self.camera.half_height() * if perspective { depth - radius } else { 1.0 };
        let wide =
            if perspective { 1.0 + p.length() * 0.6 * self.camera.half_height() } else { 1.0 };
        let ry = radius / scale * wide.max(1.0) * 1.1;
        let rx = ry / self.aspect;
        let r = &mut self.rect;
        *r = [r[0].min(p.x - rx), r[1].min(p.y - ry), r[2].max(p.x + rx), r[3].max(p.y + ry)];
    }
}

impl Drawn {
    pub(super) fn collect(
        scene: &Scene,
        input: &FrameInput,
        ghosts: &[Ghost],
        aspect: f32,
        height_px: u32,
    ) -> Drawn {
        let camera = &input.camera;
        let mut reach = Reach {
            camera,
            aspect,
            forward: camera.axes().2,
            near: f32::INFINITY,
            far: f32::NEG_INFINITY,
            low: Vec3::INFINITY,
            high: Vec3::NEG_INFINITY,
            floor_z: scene.floor.map_or(f32::NEG_INFINITY, |f| f.z),
            below: false,
            rect: [1.0, 1.0, -1.0, -1.0],
            everywhere: false,
        };
        let (mut casters, mut props) = (List::default(), List::default());
        let (mut glass, mut veils) = (List::default(), List::default());
        for (geom, pose) in scene.geoms.iter().zip(input.poses) {
            if !geom.is_visible() || (input.bare && geom.body > 0) {
                continue;
            }
            let rgb = linear([geom.rgba[0], geom.rgba[1], geom.rgba[2]]);
            let opacity = geom.rgba[3].clamp(0.0, 1.0);
            let plane = matches!(geom.shape, Shape::Plane { .. });
            let Some((key, instance)) =
                place(scene, geom, pose, camera, height_px, [rgb[0], rgb[1], rgb[2], opacity])
            else {
                continue;
            };
            let (centre, radius) = ball_of(scene, geom, pose);
            if plane {
                reach.everywhere = true;
                reach.far = reach.far.max(ENDLESS * focus(camera));
            } else {
                reach.ball(centre, radius, opacity >= 0.99);
            }
            match (plane, opacity < 0.99) {
                (_, true) => glass.push(key, instance),
                (true, false) => props.push(key, instance),
                (false, false) => casters.push(key, instance),
            }
        }
        for ghost in ghosts {
            let solid = (!input.bare).then_some(input.poses);
            veil(scene, solid, ghost, camera, height_px, &mut reach, &mut veils);
        }
        let mut signs = List::default();
        for glyph in input.glyphs {
            let list = match glyph {
                Glyph::JointAxis { .. } => &mut props,
                Glyph::Contact { .. } => &mut signs,
            };
            glyph_solid(glyph, &mut reach, list);
        }
        let mut segments = Vec::new();
        let px = height_px as f32 / 480.0;
        for trail in input.trails {
            trail_segments(trail, px, &mut reach, &mut segments);
        }
        for glyph in input.glyphs {
            glyph_lines(glyph, px, &mut reach, &mut segments);
        }
        for mark in input.marks {
            cross(mark, camera, height_px, &mut reach, &mut segments);
        }
        // Pieces with an end behind the eye would be drawn mirrored.
        let ahead =
            |p: [f32; 4]| (Vec3::new(p[0], p[1], p[2]) - camera.eye).dot(reach.forward) > 1e-3;
        segments.retain(|s| ahead(s.a) && ahead(s.b));
        let sun = input.sun.unwrap_or(SUN).normalize_or(Vec3::Z);
        reach.finish([casters, props, glass, veils, signs], segments, height_px, sun)
    }
}

impl Reach<'_> {
    fn finish(
        self,
        [casters, props, glass, veils, signs]: [List; 5],
        segments: Vec<Segment>,
        height_px: u32,
        sun: Vec3,
    ) -> Drawn {
        let mut instances = Vec::new();
        let solid = self.low.x <= self.high.x;
        let scale = focus(self.camera);
        let far = if self.far.is_finite() { self.far.max(1e-3) * 1.01 } else { scale * 4.0 };
        let near = if self.near.is_finite() { self.near * 0.99 } else { 0.0 };
        let near = match self.camera.lens {
            // The floor reaches under the eye; it hides things below it only where it is not
            // clipped.
            Lens::Perspective { .. } if self.below => near.min(far * 0.02).max(far * 2e-4),
            Lens::Perspective { .. } => near.max(far * 2e-4),
            Lens::Orthographic { .. } => near,
        };
        let width_px = height_px as f32 * self.aspect;
        let to_px = |r: [f32; 4]| pixels(r, width_px, height_px as f32);
        let rect = (!self.everywhere).then(|| to_px(self.rect));
        let shaded = (!self.everywhere && solid).then(|| self.with_shadow(sun)).flatten();
        let shaded = if solid { shaded.map(to_px) } else { rect };
        Drawn {
            casters: casters.flush_sorted(&mut instances, self.forward),
            props: props.flush_sorted(&mut instances, self.forward),
            glass: glass.flush(&mut instances),
            ghosts: veils.flush(&mut instances),
            signs: signs.flush(&mut instances),
            instances,
            segments,
            casting: solid.then_some((self.low, self.high)),
            centre: if solid { 0.5 * (self.low + self.high) } else { Vec3::ZERO },
            radius: if solid { 0.5 * self.low.distance(self.high) } else { scale },
            near,
            far: far.max(near + 1e-3),
            below_floor: self.below,
            rect,
            shaded,
        }
    }
}

impl Reach<'_> {
    /// The rectangle of the objects, extended by the shadow of their bounding box on the floor;
    /// `None` if that is unknown (a low sun, a shadow behind the eye).
    fn with_shadow(&self, sun: Vec3) -> Option<[f32; 4]> {
        if !self.floor_z.is_finite() {
            return Some(self.rect);
        }
        if sun.z < 0.05 {
            return None;
        }
        let mut r = self.rect;
        for corner in corners(self.low, self.high) {
            let shadow = corner - sun * ((corner.z - self.floor_z) / sun.z);
            let p = self.camera.project(shadow, self.aspect)?;
            r = [r[0].min(p.x), r[1].min(p.y), r[2].max(p.x), r[3].max(p.y)];
        }
        Some(r)
    }
}

fn corners(low: Vec3, high: Vec3) -> [Vec3; 8] {
    [0, 1, 2, 3, 4, 5, 6, 7].map(|k: u8| {
        let pick = |b: u8, low: f32, high: f32| if k >> b & 1 == 1 { high } else { low };
        Vec3::new(pick(0, low.x, high.x), pick(1, low.y, high.y), pick(2, low.z, high.z))
    })
}

/// From -1..1 (y up) to whole pixels with a small margin: x, y, width, height.
fn pixels(r: [f32; 4], width: f32, height: f32) -> [u32; 4] {
    let at = |x: f32, size: f32| ((x * 0.5 + 0.5) * size).clamp(0.0, size);
    let x0 = (at(r[0], width) - 3.0).max(0.0).floor() as u32;
    let x1 = (at(r[2], width) + 3.0).min(width.round()).ceil() as u32;
    let y0 = (at(-r[3], height) - 3.0).max(0.0).floor() as u32;
    let y1 = (at(-r[1], height) + 3.0).min(height).ceil() as u32;
    [x0, y0, x1.saturating_sub(x0), y1.saturating_sub(y0)]
}

/// Height of the picture at the target, metres.
fn focus(camera: &Camera) -> f32 {
    camera.metres_a_px(camera.target, 1)
}

fn ball_of(scene: &Scene, geom: &Geom, pose: &Pose) -> (Vec3, f32) {
    match scene.extent(geom) {
        Some((centre, half)) => {
            let round = matches!(geom.shape, Shape::Sphere { .. } | Shape::Ellipsoid { .. });
            let radius = match geom.shape {
                Shape::Capsule { radius, half_length } => radius + half_length,
                _ if round => half.max_element(),
                _ => half.length(),
            };
            (pose.pos + pose.rot * centre, radius)
        }
        None => (pose.pos, 0.0),
    }
}

fn place(
    scene: &Scene,
    geom: &Geom,
    pose: &Pose,
    camera: &Camera,
    height_px: u32,
    color: [f32; 4],
) -> Option<(Key, Instance)> {
    let size = geom.shape.radii();
    let px = size.max_element() / camera.metres_a_px(pose.pos, height_px);
    let (key, size, half_length) = match geom.shape {
        Shape::Sphere { .. } | Shape::Ellipsoid { .. } => {
            (Key::Prim(Prim::ball_for(px)), size, 0.0)
        }
        Shape::Capsule { half_length, .. } => {
            (Key::Prim(Prim::ball_for(px)), size, half_length.max(0.0))
        }
        Shape::Cylinder { radius, .. } => {
            let px = radius / camera.metres_a_px(pose.pos, height_px);
            (Key::Prim(Prim::cylinder_for(px)), size, 0.0)
        }
        Shape::Box { .. } => (Key::Prim(Prim::Box), size, 0.0),
        Shape::Plane { half_x, half_y } => {
            let endless = ENDLESS * focus(camera);
            let edge = |e: f32| if e > 0.0 { e } else { endless };
            (Key::Prim(Prim::Square), Vec3::new(edge(half_x), edge(half_y), 1.0), 0.0)
        }
        Shape::Mesh { mesh } => {
            scene.meshes.get(mesh)?;
            (Key::Mesh(mesh), Vec3::ONE, 0.0)
        }
    };
    Some((key, instance(pose.pos, pose.rot, size, half_length, color)))
}

fn instance(pos: Vec3, rot: Mat3, size: Vec3, half_length: f32, color: [f32; 4]) -> Instance {
    let m = rot.transpose();
    Instance {
        rows: [
            m.x_axis.extend(pos.x).to_array(),
            m.y_axis.extend(pos.y).to_array(),
            m.z_axis.extend(pos.z).to_array(),
        ],
        size: size.extend(half_length).to_array(),
        color,
    }
}

fn veil(
    scene: &Scene,
    solid: Option<&[Pose]>,
    ghost: &Ghost,
    camera: &Camera,
    height_px: u32,
    reach: &mut Reach,
    list: &mut List,
) {
    for (i, (geom, pose)) in scene.geoms.iter().zip(ghost.poses).enumerate() {
        if !geom.is_visible() || matches!(geom.shape, Shape::Plane { .. }) {
            continue;
        }
        let (centre, radius) = ball_of(scene, geom, pose);
        // The way of the geom's farthest point in pixels: shift plus turn times size.
        let apart = |real: &Pose| {
            let turn =
                (pose.rot - real.rot).to_cols_array().iter().map(|x| x * x).sum::<f32>().sqrt();
            let away = turn * std::f32::consts::FRAC_1_SQRT_2 * radius;
            let away_px =
                (pose.pos.distance(real.pos) + away) / camera.metres_a_px(pose.pos, height_px);
            let limit = COINCIDE_PX * height_px as f32 / 480.0;
            ((away_px - limit) / (3.0 * limit)).clamp(0.0, 1.0)
        };
        // Without the solid robot a ghost cannot coincide with anything.
        let seen = solid.and_then(|poses| poses.get(i)).map_or(1.0, apart);
        if seen <= 0.0 {
            continue;
        }
        let rgb = match ghost.kind {
            GhostKind::Command => {
                let error = f64::from(ghost.error.get(i).copied().unwrap_or(0.0).clamp(0.0, 1.0));
                tint(error)
            }
            GhostKind::Past => PAST,
            GhostKind::Future => FUTURE,
        };
        let rgb = linear(palette::unit(rgb));
        let color = [rgb[0], rgb[1], rgb[2], ghost.opacity.clamp(0.0, 1.0) * seen];
        if let Some((key, instance)) = place(scene, geom, pose, camera, height_px, color) {
            reach.ball(centre, radius, false);
            list.push(key, instance);
        }
    }
}

/// Colours of onion skins, as in the studio; neither is between the two colours of the command.
pub(super) const PAST: palette::Rgb = palette::GREEN;
pub(super) const FUTURE: palette::Rgb = palette::ORANGE;

/// The colour of a commanded link by its error, 0 to 1 = 10 % of the robot's size: blue, purple,
/// vermilion. A straight line between the ends would go through grey.
pub fn tint(error: f64) -> palette::Rgb {
    let (near, middle, far) = ([20, 132, 214], [168, 92, 190], palette::VERMILION);
    if error < 0.5 {
        palette::mix(near, middle, 2.0 * error)
    } else {
        palette::mix(middle, far, 2.0 * error - 1.0)
    }
}

/// sRGB to linear.
pub(super) fn linear(c: [f32; 3]) -> [f32; 3] {
    c.map(|x| if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) })
}

fn solid_color(c: palette::Rgb) -> [f32; 4] {
    let c = linear(palette::unit(c));
    [c[0], c[1], c[2], 1.0]
}

/// Any frame whose z is `axis`.
fn frame_along(axis: Vec3) -> Mat3 {
    let z = axis.normalize_or(Vec3::Z);
    let x = z.any_orthonormal_vector();
    Mat3::from_cols(x, z.cross(x), z)
}

fn glyph_solid(glyph: &Glyph, reach: &mut Reach, list: &mut List) {
    let (at, axis, length, color, from) = match *glyph {
        Glyph::JointAxis { anchor, axis, length } => (anchor, axis, length, AXIS, -0.5),
        Glyph::Contact { at, normal, length } => (at, normal, length, CONTACT, 0.0),
    };
    if !(at.is_finite() && axis.is_finite() && length.is_finite() && length > 0.0) {
        return;
    }
    let rot = frame_along(axis);
    let z = rot.z_axis;
    let color = solid_color(color);
    let thin = 0.022 * length;
    let shaft = 0.5 * length * 0.78;
    let base = at + z * from * length;
    reach.ball(at, 1.1 * length, false);
    let rod = Vec3::new(thin, thin, shaft);
    list.push(Key::Prim(Prim::CylinderCoarse), instance(base + z * shaft, rot, rod, 0.0, color));
    let head = Vec3::new(3.4 * thin, 3.4 * thin, 0.5 * length - shaft);
    list.push(
        Key::Prim(Prim::Cone),
        instance(base + z * (2.0 * shaft + head.z), rot, head, 0.0, color),
    );
    if matches!(glyph, Glyph::Contact { .. }) {
        let disc = Vec3::new(0.2 * length, 0.2 * length, 0.012 * length);
        list.push(Key::Prim(Prim::CylinderCoarse), instance(at, rot, disc, 0.0, color));
    }
}

fn glyph_lines(glyph: &Glyph, px: f32, reach: &mut Reach, out: &mut Vec<Segment>) {
    let Glyph::JointAxis { anchor, axis, length } = *glyph else { return };
    if !(anchor.is_finite() && axis.is_finite() && length.is_finite() && length > 0.0) {
        return;
    }
    // Three quarters of a turn with a head: the sense of rotation.
    let rot = frame_along(axis);
    let r = 0.26 * length;
    let at = |a: f32| anchor + rot * (Vec3::new(a.cos(), a.sin(), 0.0) * r);
    let arc: Vec<Vec3> = (0..=36).map(|k| at(0.75 * TAU * k as f32 / 36.0)).collect();
    let color = palette::unit(AXIS);
    let mut draw = |points: &[Vec3]| {
        let t = Trail { points, color, width: 2.0, fade: false };
        trail_segments(&t, px, reach, out);
    };
    draw(&arc);
    let end = at(0.75 * TAU);
    let back = at(0.75 * TAU - 0.5);
    let out_ward = (end - anchor).normalize_or_zero() * 0.07 * length;
    draw(&[back + out_ward, end, back - out_ward]);
}

fn trail_segments(trail: &Trail, px: f32, reach: &mut Reach, out: &mut Vec<Segment>) {
    let n = trail.points.len();
    let c = linear(trail.color);
    let half = 0.5 * trail.width * px;
    let point = |p: Vec3, w: f32| p.extend(w).to_array();
    for (i, w) in trail.points.windows(2).enumerate() {
        let &[a, b] = w else { continue };
        let before = i.checked_sub(1).and_then(|k| trail.points.get(k));
        let after = trail.points.get(i + 2);
        let share = |k: usize| {
            if trail.fade { 0.22 + 0.78 * (k as f32 / (n - 1) as f32).powf(1.3) } else { 1.0 }
        };
        let color = |k: usize| [c[0], c[1], c[2], share(k)];
        reach.ball(a, 0.0, false);
        reach.ball(b, 0.0, false);
        out.push(Segment {
            a: point(a, half),
            b: point(b, half),
            prev: point(before.copied().unwrap_or(a), 0.0),
            next: point(after.copied().unwrap_or(b), 0.0),
            color_a: color(i),
            color_b: color(i + 1),
        });
    }
}

fn cross(mark: &Mark, camera: &Camera, height_px: u32, reach: &mut Reach, out: &mut Vec<Segment>) {
    let px = height_px as f32 / 480.0;
    let metres = camera.metres_a_px(mark.at, height_px) * mark.size * px;
    let (right, up, forward) = camera.axes();
    // Moved towards the eye by its own size, so that half of it does not disappear in a surface.
    let at = mark.at - forward * metres;
    let c = linear(mark.color);
    reach.ball(mark.at, 2.0 * metres, false);
    for arm in [right + up, right - up] {
        let arm = arm * metres * std::f32::consts::FRAC_1_SQRT_2;
        let (a, b) = ((at - arm), (at + arm));
        let half = 0.5 * (mark.size * 0.36).max(1.6) * px;
        out.push(Segment {
            a: a.extend(half).to_array(),
            b: b.extend(half).to_array(),
            prev: a.extend(0.0).to_array(),
            next: b.extend(0.0).to_array(),
            color_a: [c[0], c[1], c[2], 1.0],
            color_b: [c[0], c[1], c[2], 1.0],
        });
    }
}
