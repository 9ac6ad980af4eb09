//! The position of the camera.

use std::sync::Arc;

use glam::Vec3;

use super::framing;
use super::retained::Retained;
use super::scene_nodes::SceneNodes;
use super::space::Place;
use crate::simulation::RobotContext;
use robert_render::{self as render, View};
use robert_robot as robot;
use robert_take::viser::Message;

impl SceneNodes {
    /// The outermost points of a body at its current place, or of its children if the body itself
    /// is invisible.
    pub(super) fn around(&self, facts: &RobotContext, body: usize) -> Option<Vec<Vec3>> {
        let carried = |b: usize| facts.hangs_on(b, body);
        let points = |of: &dyn Fn(usize) -> bool| -> Vec<Vec3> {
            let hulls = self.hulls.iter().filter(|(b, _)| of(*b));
            hulls
                .filter_map(|(b, hull)| Some((self.shown(*b)?, hull)))
                .flat_map(|(place, hull)| {
                    hull.iter().map(move |p| {
                        let at = place.point(p.to_array().map(f64::from));
                        Vec3::from_array(at.map(|v| v as f32))
                    })
                })
                .collect()
        };
        let own = points(&|b| b == body);
        let found = if own.is_empty() { points(&carried) } else { own };
        (!found.is_empty()).then_some(found)
    }

    /// Points the camera at some points, from the usual direction for this robot.
    pub(super) fn look_at(scene: &mut Retained, facts: &RobotContext, points: &[Vec3]) -> bool {
        let fov = facts.camera.fovy_rad.clamp(0.2, 2.0);
        let view = View::of(&robot::Camera { fovy_rad: fov, ..facts.camera });
        Self::put_camera(scene, &framing::near(&view, points), fov);
        true
    }

    fn put_camera(scene: &mut Retained, camera: &render::Camera, fov: f64) {
        let [position, look_at] = [camera.eye, camera.target].map(|p| p.to_array().map(f64::from));
        let initial = true;
        scene.put(Message::SetCameraUpDirectionMessage { position: [0.0, 0.0, 1.0], initial });
        scene.put(Message::SetCameraFovMessage { fov, initial });
        scene.put(Message::SetCameraPositionMessage { position, initial });
        scene.put(Message::SetCameraLookAtMessage { look_at, initial });
    }

    /// The outermost points of the robot in all of these poses, (nbody, 7) each.
    fn reach(&self, poses: &[Arc<[f32]>]) -> Vec<Vec3> {
        framing::outline(poses.iter().flat_map(|bodies| {
            self.hulls.iter().flat_map(|(body, hull)| {
                let place = Place::of(bodies, *body);
                hull.iter().filter_map(move |p| {
                    let at = place?.point(p.to_array().map(f64::from));
                    Some(Vec3::from_array(at.map(|v| v as f32)))
                })
            })
        }))
    }

    /// Points the camera so that the whole robot is in view, also in these poses of its motion.
    pub(super) fn camera(
        &self,
        scene: &mut Retained,
        facts: &RobotContext,
        preset: &str,
        poses: &[Arc<[f32]>],
    ) -> bool {
        use std::f32::consts::FRAC_PI_2;
        let fov = facts.camera.fovy_rad.clamp(0.2, 2.0);
        let view = View::of(&robot::Camera { fovy_rad: fov, ..facts.camera });
        let moved = self.reach(poses);
        let points = if moved.is_empty() { &self.outline } else { &moved };
        let camera = match preset {
            // With nothing selected all of it is.
            "home" | "fit" | "selection" => framing::near(&view, points),
            "front" => framing::from(&view.from(0.0, 0.0), points),
            "side" => framing::from(&view.from(-FRAC_PI_2, 0.0), points),
            // Not straight down: the horizon would have no direction.
            "top" => framing::from(&view.from(-FRAC_PI_2, FRAC_PI_2 - 1e-3), points),
            _ => return false,
        };
        Self::put_camera(scene, &camera, fov);
        true
    }
}
