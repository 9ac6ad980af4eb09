//! Where the camera is in each frame of a film.

use glam::Vec3;

use super::{Camera, CameraChoice, Error, Motion, Stage, View};

/// The camera of each frame.
#[derive(Debug)]
pub(super) enum CameraPath {
    /// The same in every frame.
    Still(Camera),
    /// Once around these points.
    Orbit { points: Vec<Vec3>, view: View, aspect: f32 },
    /// With a body, by its smoothed displacement.
    Follow { camera: Camera, offsets: Vec<Vec3> },
}

impl CameraPath {
    /// The path that was chosen. `points` are what a fitted camera must show.
    pub(super) fn new(
        stage: &mut Stage,
        motion: &Motion,
        camera: &CameraChoice,
        points: &[Vec3],
        aspect: f32,
    ) -> Result<CameraPath, Error> {
        Ok(match camera {
            CameraChoice::Fit => CameraPath::Still(Camera::fit(points, &stage.view(), aspect)),
            CameraChoice::Fixed => CameraPath::Still(stage.fixed_camera()),
            CameraChoice::Top => CameraPath::Still(Camera::fit(points, &View::top(), aspect)),
            CameraChoice::Orbit => {
                CameraPath::Orbit { points: points.to_vec(), view: stage.view(), aspect }
            }
            CameraChoice::Named(name) => CameraPath::Still(stage.model_camera(name)?),
            CameraChoice::Follow(body) => {
                let body = stage.scene().body(body)?;
                let mut places = Vec::with_capacity(motion.frames());
                for state in &motion.achieved {
                    places.push(stage.body(state, body)?);
                }
                let first = motion.achieved.first().map(Vec::as_slice).unwrap_or_default();
                let poses = stage.poses(first)?;
                let camera = Camera::fit(&stage.moving_corners(&poses), &stage.view(), aspect);
                CameraPath::Follow { camera, offsets: smoothed(&places) }
            }
        })
    }

    /// The camera at a frame of a film of so many frames.
    pub(super) fn at(&self, frame: usize, frames: usize) -> Camera {
        match self {
            CameraPath::Still(camera) => *camera,
            CameraPath::Orbit { points, view, aspect } => {
                let share = frame as f32 / frames.max(1) as f32;
                let azimuth = view.azimuth_rad + std::f32::consts::TAU * share;
                Camera::fit(points, &view.from(azimuth, view.elevation_rad), *aspect)
            }
            CameraPath::Follow { camera, offsets } => {
                camera.shifted(offsets.get(frame).copied().unwrap_or(Vec3::ZERO))
            }
        }
    }
}

/// Displacement of each place from the first, averaged over half a second on both sides, so that
/// the camera does not follow every small motion.
fn smoothed(places: &[Vec3]) -> Vec<Vec3> {
    let half = 10;
    let mean = |i: usize| {
        let part = &places[i.saturating_sub(half)..(i + half + 1).min(places.len())];
        part.iter().sum::<Vec3>() / part.len() as f32
    };
    let first = if places.is_empty() { Vec3::ZERO } else { mean(0) };
    (0..places.len()).map(|i| mean(i) - first).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_following_camera_is_steady() {
        let places: Vec<Vec3> = (0..100)
            .map(|i| Vec3::new(0.01 * i as f32, if i % 2 == 0 { 0.05 } else { -0.05 }, 0.0))
            .collect();
        let s = smoothed(&places);
        assert_eq!(s[0], Vec3::ZERO);
        assert!(s.windows(2).all(|w| (w[1] - w[0]).y.abs() < 0.012));
        assert!((s[99].x - 0.9).abs() < 0.05);
    }
}
