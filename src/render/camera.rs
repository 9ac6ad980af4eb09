//! Cameras: orbit, fit, follow, fixed.
//!
//! [`Camera::fit`] solves the framing exactly: for a given direction it finds the eye from which
//! the outermost points touch two opposite sides of the frame. So any robot fills the picture
//! without a table of distances.

use glam::camera::rh;
use glam::{Mat4, Vec2, Vec3};

/// The camera of a motion.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum CameraChoice {
    /// The profile's direction, as close as the whole motion allows.
    #[default]
    Fit,
    /// The profile's camera, unchanged.
    Fixed,
    /// Straight down, with parallel rays.
    Top,
    /// As `Fit`, turning once around during the motion.
    Orbit,
    /// As `Fit` for one frame, moving along with this body.
    Follow(String),
    /// A camera of the model.
    Named(String),
}

impl CameraChoice {
    /// The words that are valid for any model.
    pub const NAMES: [&str; 5] = ["fit", "fixed", "top", "orbit", "follow:BODY"];

    /// From a word; anything else is a camera of the model.
    pub fn parse(text: &str) -> CameraChoice {
        match text {
            "fit" => CameraChoice::Fit,
            "fixed" => CameraChoice::Fixed,
            "top" => CameraChoice::Top,
            "orbit" => CameraChoice::Orbit,
            _ => match text.strip_prefix("follow:") {
                Some(body) => CameraChoice::Follow(body.to_owned()),
                None => CameraChoice::Named(text.to_owned()),
            },
        }
    }
}

/// The projection from depth to the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lens {
    /// Vertical field of view, radians.
    Perspective {
        /// Full angle.
        fov_y_rad: f32,
    },
    /// Parallel rays (plans, 2-D paths).
    Orthographic {
        /// Height of the picture in the world, metres.
        height: f32,
    },
}

/// The eye. z is up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Position of the eye, metres.
    pub eye: Vec3,
    /// The point in the middle of the picture.
    pub target: Vec3,
    /// The lens.
    pub lens: Lens,
}

/// A viewing direction, as in a robot's profile, independent of the robot's size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Angle about z from +x to the eye, radians.
    pub azimuth_rad: f32,
    /// Angle of the eye above the horizon, radians.
    pub elevation_rad: f32,
    /// The lens; the height of an orthographic one is set by the fit.
    pub lens: Lens,
    /// Free share of the picture on each side, 0 to 0.4.
    pub margin: f32,
}

impl Default for View {
    fn default() -> Self {
        View {
            azimuth_rad: -50_f32.to_radians(),
            elevation_rad: 22_f32.to_radians(),
            // About a 50 mm lens: hands and arms without wide-angle distortion.
            lens: Lens::Perspective { fov_y_rad: 32_f32.to_radians() },
            margin: 0.07,
        }
    }
}

impl View {
    /// Seen from this azimuth and elevation (radians).
    #[must_use]
    pub fn from(mut self, azimuth_rad: f32, elevation_rad: f32) -> View {
        self.azimuth_rad = azimuth_rad;
        self.elevation_rad = elevation_rad;
        self
    }

    /// Straight down with parallel rays: +x right, +y up.
    pub fn top() -> View {
        View {
            azimuth_rad: -std::f32::consts::FRAC_PI_2,
            elevation_rad: std::f32::consts::FRAC_PI_2,
            lens: Lens::Orthographic { height: 1.0 },
            margin: 0.07,
        }
    }

    /// Unit vector from the target to the eye.
    fn direction(&self) -> Vec3 {
        let (sa, ca) = self.azimuth_rad.sin_cos();
        let (se, ce) = self.elevation_rad.sin_cos();
        Vec3::new(ce * ca, ce * sa, se)
    }
}

impl Camera {
    /// Circles `target` at `distance` (metres).
    pub fn orbit(target: Vec3, distance: f32, view: &View) -> Camera {
        Camera { eye: target + view.direction() * distance, target, lens: view.lens }
    }

    /// The closest eye in the view's direction whose frame contains all `points`; `aspect` is width
    /// divided by height. Without points it looks at the origin from one metre.
    pub fn fit(points: &[Vec3], view: &View, aspect: f32) -> Camera {
        let back = view.direction();
        let right = right_of(-back);
        let up = right.cross(-back);
        let room = 1.0 - 2.0 * view.margin.clamp(0.0, 0.4);
        let seen: Vec<Vec3> = points.iter().copied().filter(|p| p.is_finite()).collect();
        let Some(first) = seen.first() else { return Camera::orbit(Vec3::ZERO, 1.0, view) };
        let middle = seen.iter().fold((*first, *first), |(a, b), p| (a.min(*p), b.max(*p)));
        let middle = 0.5 * (middle.0 + middle.1);
        let local = |p: &Vec3| {
            let d = *p - middle;
            Vec3::new(d.dot(right), d.dot(up), d.dot(back))
        };
        let smallest = 1e-3;
        match view.lens {
            Lens::Perspective { fov_y_rad } => {
                let ty = (0.5 * fov_y_rad).tan() * room;
                let tx = ty * aspect;
                // |x - cx| <= (d - z) t on both sides: two half-planes in (d, cx) a direction.
                let solve = |t: f32, x: fn(Vec3) -> f32| {
                    let reach = |sign: f32| {
                        seen.iter()
                            .map(|p| {
                                let l = local(p);
                                sign * x(l) / t + l.z
                            })
                            .fold(f32::NEG_INFINITY, f32::max)
                    };
                    let (plus, minus) = (reach(1.0), reach(-1.0));
                    (0.5 * (plus + minus), 0.5 * t * (plus - minus))
                };
                let (dx, cx) = solve(tx, |l| l.x);
                let (dy, cy) = solve(ty, |l| l.y);
                let nearest = seen.iter().map(|p| local(p).z).fold(f32::NEG_INFINITY, f32::max);
                let distance = dx.max(dy).max(nearest + smallest);
                let target = middle + right * cx + up * cy;
                Camera { eye: target + back * distance, target, lens: view.lens }
            }
            Lens::Orthographic { .. } => {
                let span = |x: fn(Vec3) -> f32| {
                    seen.iter()
                        .map(|p| x(local(p)))
                        .fold((f32::MAX, f32::MIN), |(a, b), v| (a.min(v), b.max(v)))
                };
                let (x0, x1) = span(|l| l.x);
                let (y0, y1) = span(|l| l.y);
                let (z0, z1) = span(|l| l.z);
                let height = (y1 - y0).max((x1 - x0) / aspect).max(smallest) / room;
                let target = middle + right * 0.5 * (x0 + x1) + up * 0.5 * (y0 + y1);
                let distance = z1.max(0.0) + (z1 - z0) + height;
                Camera {
                    eye: target + back * distance,
                    target,
                    lens: Lens::Orthographic { height },
                }
            }
        }
    }

    /// The same view, moved with what it follows.
    #[must_use]
    pub fn shifted(self, by: Vec3) -> Camera {
        Camera { eye: self.eye + by, target: self.target + by, lens: self.lens }
    }

    pub(super) fn is_finite(&self) -> bool {
        let lens = match self.lens {
            Lens::Perspective { fov_y_rad } => fov_y_rad.is_finite() && fov_y_rad > 1e-3,
            Lens::Orthographic { height } => height.is_finite() && height > 0.0,
        };
        lens && self.eye.is_finite()
            && self.target.is_finite()
            && self.eye.distance(self.target) > 1e-6
    }

    /// Right, up, forward.
    pub(super) fn axes(&self) -> (Vec3, Vec3, Vec3) {
        let forward = (self.target - self.eye).normalize_or(Vec3::NEG_Z);
        let right = right_of(forward);
        (right, right.cross(forward), forward)
    }

    /// Half height of the picture at one metre (perspective) or anywhere (orthographic).
    pub(super) fn half_height(&self) -> f32 {
        match self.lens {
            Lens::Perspective { fov_y_rad } => (0.5 * fov_y_rad).tan(),
            Lens::Orthographic { height } => 0.5 * height,
        }
    }

    /// Metres that one pixel covers at `point`.
    pub(super) fn metres_a_px(&self, point: Vec3, height_px: u32) -> f32 {
        let per = 2.0 * self.half_height() / height_px as f32;
        match self.lens {
            Lens::Perspective { .. } => per * (point - self.eye).dot(self.axes().2).max(1e-4),
            Lens::Orthographic { .. } => per,
        }
    }

    /// Clip from world, for objects between `near` and `far` metres ahead.
    pub(super) fn matrix(&self, aspect: f32, near: f32, far: f32) -> Mat4 {
        let (right, up, forward) = self.axes();
        let view = Mat4::from_cols(
            Vec3::new(right.x, up.x, -forward.x).extend(0.0),
            Vec3::new(right.y, up.y, -forward.y).extend(0.0),
            Vec3::new(right.z, up.z, -forward.z).extend(0.0),
            Vec3::new(-right.dot(self.eye), -up.dot(self.eye), forward.dot(self.eye)).extend(1.0),
        );
        let proj = match self.lens {
            Lens::Perspective { fov_y_rad } => {
                rh::proj::directx::perspective(fov_y_rad, aspect, near, far)
            }
            Lens::Orthographic { height } => {
                let (h, w) = (0.5 * height, 0.5 * height * aspect);
                rh::proj::directx::orthographic(-w, w, -h, h, near, far)
            }
        };
        proj * view
    }

    /// The ray of a point of the picture (-1 to 1, y up): where it starts and its direction.
    pub(super) fn ray(&self, at: Vec2, aspect: f32) -> (Vec3, Vec3) {
        let (right, up, forward) = self.axes();
        let h = self.half_height();
        let across = right * (at.x * h * aspect) + up * (at.y * h);
        match self.lens {
            Lens::Perspective { .. } => (self.eye, forward + across),
            Lens::Orthographic { .. } => (self.eye + across, forward),
        }
    }

    /// Place of a point in the picture, -1 to 1 in x and y (up); `None` behind the eye.
    pub fn project(&self, point: Vec3, aspect: f32) -> Option<Vec2> {
        let (right, up, forward) = self.axes();
        let d = point - self.eye;
        let depth = d.dot(forward);
        let h = self.half_height();
        let scale = match self.lens {
            Lens::Perspective { .. } if depth <= 1e-4 => return None,
            Lens::Perspective { .. } => h * depth,
            Lens::Orthographic { .. } => h,
        };
        Some(Vec2::new(d.dot(right) / (scale * aspect), d.dot(up) / scale))
    }
}

/// Straight up or down, +x is used as the right direction.
fn right_of(forward: Vec3) -> Vec3 {
    let right = forward.cross(Vec3::Z);
    if right.length() < 1e-4 { Vec3::X } else { right.normalize() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud() -> Vec<Vec3> {
        (0..40)
            .map(|i| {
                let a = i as f32;
                Vec3::new((a * 1.7).sin() * 0.4, (a * 0.9).cos() * 0.1, (a * 2.3).sin() * 0.7 + 3.0)
            })
            .collect()
    }

    #[test]
    fn fit_touches_opposite_sides_and_holds_all() {
        for lens in [Lens::Perspective { fov_y_rad: 0.6 }, Lens::Orthographic { height: 1.0 }] {
            for (az, el) in [(0.3, 0.2), (2.0, -0.4), (-1.0, 1.4)] {
                for aspect in [0.5, 1.0, 1.8] {
                    let view = View { lens, margin: 0.0, ..View::default().from(az, el) };
                    let camera = Camera::fit(&cloud(), &view, aspect);
                    let p: Vec<Vec2> =
                        cloud().iter().map(|p| camera.project(*p, aspect).unwrap()).collect();
                    let most = |f: fn(&Vec2) -> f32| p.iter().map(f).fold(f32::MIN, f32::max);
                    let (l, r) = (most(|p| -p.x), most(|p| p.x));
                    let (b, t) = (most(|p| -p.y), most(|p| p.y));
                    let worst = l.max(r).max(b).max(t);
                    assert!((worst - 1.0).abs() < 1e-3, "{lens:?} {az} {aspect}: {worst}");
                    let tight_x = (l - 1.0).abs() < 1e-3 && (r - 1.0).abs() < 1e-3;
                    let tight_y = (b - 1.0).abs() < 1e-3 && (t - 1.0).abs() < 1e-3;
                    assert!(tight_x || tight_y, "{l} {r} {b} {t}");
                }
            }
        }
    }

    #[test]
    fn matrix_agrees_with_project() {
        let camera = Camera::fit(&cloud(), &View::default(), 1.5);
        let m = camera.matrix(1.5, 0.1, 10.0);
        for p in cloud() {
            let c = m.project_point3(p);
            let q = camera.project(p, 1.5).unwrap();
            assert!((c.truncate() - q).length() < 1e-4, "{c} {q}");
            assert!((0.0..=1.0).contains(&c.z));
        }
    }

    #[test]
    fn nothing_to_see_is_no_crash() {
        assert!(Camera::fit(&[], &View::default(), 1.0).is_finite());
        assert!(Camera::fit(&[Vec3::splat(f32::NAN)], &View::top(), 1.0).is_finite());
        assert!(Camera::fit(&[Vec3::ONE], &View::default(), 1.0).is_finite());
        assert!(Camera::fit(&[Vec3::ONE], &View::top(), 1.0).is_finite());
    }
}
