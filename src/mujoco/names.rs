//! The kinds of named objects in a model.

use super::bindings as mj;

/// The kind of object that a name or id refers to (`mjtObj`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A body.
    Body,
    /// A joint.
    Joint,
    /// A geom.
    Geom,
    /// A site.
    Site,
    /// A camera.
    Camera,
    /// A mesh.
    Mesh,
    /// A tendon.
    Tendon,
    /// An actuator.
    Actuator,
    /// An MJCF `<key>`, a full-state snapshot (not our keyframe).
    Key,
}

impl Kind {
    pub(super) fn raw(self) -> i32 {
        let code = match self {
            Kind::Body => mj::mjOBJ_BODY,
            Kind::Joint => mj::mjOBJ_JOINT,
            Kind::Geom => mj::mjOBJ_GEOM,
            Kind::Site => mj::mjOBJ_SITE,
            Kind::Camera => mj::mjOBJ_CAMERA,
            Kind::Mesh => mj::mjOBJ_MESH,
            Kind::Tendon => mj::mjOBJ_TENDON,
            Kind::Actuator => mj::mjOBJ_ACTUATOR,
            Kind::Key => mj::mjOBJ_KEY,
        };
        code as i32
    }
}

/// An index that a compiled model contains, such as the body of a joint. It is never negative.
pub fn index(id: i32) -> usize {
    assert!(id >= 0, "a compiled model has no index {id}");
    id as usize
}
