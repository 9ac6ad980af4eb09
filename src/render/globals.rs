//! What the shaders must know about a frame: camera, light, sky and floor.

use glam::{Mat4, Vec3};

use super::frame::{FrameInput, SUN};
use super::gpu::Globals;
use super::instances::{Drawn, linear};
use super::{Lens, RenderConfig, Scene};

impl Globals {
    /// What the shaders must know about a frame.
    pub(super) fn of_frame(
        config: &RenderConfig,
        shadow_px: u32,
        scene: &Scene,
        input: &FrameInput,
        drawn: &Drawn,
        aspect: f32,
    ) -> Globals {
        let camera = &input.camera;
        let (right, up, forward) = camera.axes();
        let half = camera.half_height();
        let ortho = matches!(camera.lens, Lens::Orthographic { .. });
        // Height of the picture at the target: the scale of cells and fog. It does not depend on
        // poses, so the floor does not move.
        let focus = 2.0 * camera.metres_a_px(camera.target, 2).max(1e-4);
        let cell = cell_size(focus / 5.0);
        let sun = input.sun.unwrap_or(SUN).normalize_or(Vec3::Z);
        // A shadow need not be finer than the picture, so texels have at least half a pixel. On a
        // software driver this saves a fifth of the frame: fewer texels are drawn, and lookups are
        // closer in memory.
        let least = 0.5 * camera.metres_a_px(drawn.centre, config.height);
        let reach = drawn.radius.max(0.5 * least * shadow_px as f32);
        let (light_proj, texel_m) = light_box(sun, drawn.centre, reach, shadow_px);
        let (a, b) = (linear([0.545, 0.575, 0.615]), linear([0.485, 0.515, 0.560]));
        let horizon = linear([0.735, 0.760, 0.790]);
        let zenith = linear([0.56, 0.62, 0.70]);
        let floor_z = scene.floor.map_or(-1e3, |f| f.z);
        Globals {
            view_proj: camera.matrix(aspect, drawn.near, drawn.far).to_cols_array_2d(),
            light_proj: light_proj.to_cols_array_2d(),
            eye: camera.eye.extend(f32::from(u8::from(ortho))).to_array(),
            forward: forward.extend(0.0).to_array(),
            ray_x: (right * half * aspect).extend(0.0).to_array(),
            ray_y: (up * half).extend(0.0).to_array(),
            sun: sun.extend(f32::from(u8::from(config.shadows)) * 0.92).to_array(),
            sun_color: [0.78, 0.75, 0.70, 0.22],
            sky: [0.36, 0.39, 0.44, 0.0],
            ground: [0.15, 0.14, 0.135, 0.0],
            zenith: [zenith[0], zenith[1], zenith[2], 0.0],
            horizon: [horizon[0], horizon[1], horizon[2], 0.0],
            floor_a: [a[0], a[1], a[2], cell],
            floor_b: [b[0], b[1], b[2], f32::from(u8::from(scene.floor.is_some()))],
            floor_pos: [camera.target.x, camera.target.y, floor_z, 0.9 * focus],
            floor_fog: [1.0 / (5.0 * focus), 0.10, 0.0, 0.0],
            shadow: [1.0 / shadow_px as f32, 1.5 * texel_m, 1.0, 1.4],
            view: [
                config.width as f32,
                config.height as f32,
                1.0 / config.width as f32,
                1.0 / config.height as f32,
            ],
        }
    }
}

/// The next of 1, 2, 5 times a power of ten, not below `wish`.
fn cell_size(wish: f32) -> f32 {
    let power = 10_f32.powf(wish.max(1e-6).log10().floor());
    let lead = wish / power;
    power
        * if lead <= 1.0 {
            1.0
        } else if lead <= 2.0 {
            2.0
        } else if lead <= 5.0 {
            5.0
        } else {
            10.0
        }
}

/// Orthographic light that covers a sphere, and the metres of one texel.
///
/// The size grows in steps of a tenth, and the centre is on the texel grid; otherwise the edge of a
/// shadow would flicker from frame to frame.
fn light_box(sun: Vec3, centre: Vec3, radius: f32, shadow_px: u32) -> (Mat4, f32) {
    let step = 1.1_f32;
    let radius = step.powf((radius.max(1e-4) * 1.03).log(step).ceil());
    let texel = 2.0 * radius / shadow_px as f32;
    let right = if sun.z.abs() > 0.999 { Vec3::X } else { Vec3::Z.cross(sun).normalize() };
    let up = sun.cross(right);
    let snap = |x: f32| (x / texel).round() * texel;
    let at = right * snap(centre.dot(right)) + up * snap(centre.dot(up)) + sun * centre.dot(sun);
    let eye = at + sun * 2.0 * radius;
    let view = Mat4::from_cols(
        Vec3::new(right.x, up.x, sun.x).extend(0.0),
        Vec3::new(right.y, up.y, sun.y).extend(0.0),
        Vec3::new(right.z, up.z, sun.z).extend(0.0),
        Vec3::new(-right.dot(eye), -up.dot(eye), -sun.dot(eye)).extend(1.0),
    );
    let proj = glam::camera::rh::proj::directx::orthographic(
        -radius,
        radius,
        -radius,
        radius,
        0.5 * radius,
        3.5 * radius,
    );
    (proj * view, texel)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_one_two_five() {
        for (wish, cell) in [(0.03, 0.05), (0.2, 0.2), (0.21, 0.5), (7.0, 10.0), (1.0, 1.0)] {
            assert!((cell_size(wish) / cell - 1.0).abs() < 1e-3, "{wish} {}", cell_size(wish));
        }
    }

    #[test]
    fn the_light_holds_its_ball() {
        for sun in [SUN.normalize(), Vec3::Z, Vec3::X] {
            let centre = Vec3::new(3.0, -1.0, 0.7);
            let (m, _) = light_box(sun, centre, 0.4, 1024);
            for d in [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z] {
                let p = m.project_point3(centre + d * 0.4);
                assert!(p.x.abs() <= 1.0 && p.y.abs() <= 1.0 && (0.0..=1.0).contains(&p.z), "{p}");
            }
        }
    }
}
