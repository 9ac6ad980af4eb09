//! The content that changes from frame to frame: poses, ghosts, trails, glyphs, camera, caption.

use glam::Vec3;

use super::{Camera, Caption, Pose};

/// One picture to draw.
#[derive(Clone, Copy, Debug)]
pub struct FrameInput<'a> {
    /// Achieved pose of every geom of the scene, solid.
    pub poses: &'a [Pose],
    /// Draw only ghosts, without the moving parts of the solid robot.
    pub bare: bool,
    /// Other poses of the same scene, translucent. The first is the most important: previews on
    /// a software driver draw only the first three.
    pub ghosts: &'a [Ghost<'a>],
    /// Paths of points.
    pub trails: &'a [Trail<'a>],
    /// Crosses at single points (commanded keyframes).
    pub marks: &'a [Mark],
    /// Joint axes and contacts.
    pub glyphs: &'a [Glyph],
    /// The eye.
    pub camera: Camera,
    /// Direction to the light; `None` = [`SUN`].
    pub sun: Option<Vec3>,
    /// Text over the picture.
    pub caption: Option<&'a Caption>,
}

/// Default direction to the light: high, from the left of the default view.
pub const SUN: Vec3 = Vec3::new(-0.25, -0.60, 1.0);

/// The light for a view: from over the left shoulder of the viewer, so that shadows fall to the
/// right and away at any azimuth. Compute it once to keep it constant while a camera orbits.
pub fn sun_for(camera: &Camera) -> Vec3 {
    let (right, _, forward) = camera.axes();
    let back = Vec3::new(-forward.x, -forward.y, 0.0).normalize_or_zero();
    (back * 0.45 - right * 0.50 + Vec3::Z).normalize()
}

impl<'a> FrameInput<'a> {
    /// Only the robot.
    pub fn new(poses: &'a [Pose], camera: Camera) -> FrameInput<'a> {
        FrameInput {
            poses,
            bare: false,
            ghosts: &[],
            trails: &[],
            marks: &[],
            glyphs: &[],
            camera,
            sun: None,
            caption: None,
        }
    }
}

/// The meaning of a translucent pose, which decides its colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GhostKind {
    /// The commanded pose of this frame: blue, turning vermilion with the error of the link.
    Command,
    /// A keyframe before this frame.
    Past,
    /// A keyframe after this frame.
    Future,
}

/// A translucent copy of the robot.
#[derive(Clone, Copy, Debug)]
pub struct Ghost<'a> {
    /// Pose of every geom.
    pub poses: &'a [Pose],
    /// Its meaning.
    pub kind: GhostKind,
    /// Per geom 0 (reached) to 1 (far off), for the tint of [`GhostKind::Command`]. Empty = no
    /// tint.
    pub error: &'a [f32],
    /// Opacity facing the eye, 0 to 1; outlines are denser.
    pub opacity: f32,
}

impl<'a> Ghost<'a> {
    /// The commanded pose.
    pub fn command(poses: &'a [Pose]) -> Ghost<'a> {
        Ghost { poses, kind: GhostKind::Command, error: &[], opacity: 0.55 }
    }

    /// A neighbouring keyframe.
    pub fn onion(poses: &'a [Pose], past: bool) -> Ghost<'a> {
        let kind = if past { GhostKind::Past } else { GhostKind::Future };
        Ghost { poses, kind, error: &[], opacity: 0.30 }
    }
}

/// A path through the world.
#[derive(Clone, Copy, Debug)]
pub struct Trail<'a> {
    /// Points in order, metres.
    pub points: &'a [Vec3],
    /// sRGB, 0 to 1.
    pub color: [f32; 3],
    /// Width in pixels of a 480-line picture; scales with the picture.
    pub width: f32,
    /// Thin out towards the first point.
    pub fade: bool,
}

impl<'a> Trail<'a> {
    /// A solid path that fades towards its past.
    pub fn new(points: &'a [Vec3], color: [f32; 3]) -> Trail<'a> {
        Trail { points, color, width: 3.6, fade: true }
    }
}

/// A cross at a point, facing the eye.
#[derive(Clone, Copy, Debug)]
pub struct Mark {
    /// The position, m.
    pub at: Vec3,
    /// sRGB, 0 to 1.
    pub color: [f32; 3],
    /// Half size in pixels of a 480-line picture.
    pub size: f32,
}

/// A symbol for mechanics.
#[derive(Clone, Copy, Debug)]
pub enum Glyph {
    /// Axis of a joint with its sense of rotation.
    JointAxis {
        /// Anchor, metres.
        anchor: Vec3,
        /// Direction.
        axis: Vec3,
        /// Length, metres.
        length: f32,
    },
    /// A contact: a disc with an arrow along the normal force.
    Contact {
        /// The position, m.
        at: Vec3,
        /// Direction of the force.
        normal: Vec3,
        /// Length of the arrow, metres.
        length: f32,
    },
}
