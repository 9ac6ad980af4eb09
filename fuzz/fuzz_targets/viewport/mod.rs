//! The files that read the messages. The rest of the studio would only be compiled.

#[path = "../../../src/studio/viewport/incoming.rs"]
pub(crate) mod incoming;
#[path = "../../../src/studio/viewport/page_camera.rs"]
mod page_camera;
#[path = "../../../src/studio/viewport/space.rs"]
mod space;

/// Whether the message can be used.
pub(crate) fn is_sound(message: &incoming::Incoming) -> bool {
    message.camera().is_none_or(|camera| {
        let way = camera.ray([0.25, 0.75]);
        camera.slope > 0.0 && camera.slope.is_finite() && way.iter().all(|v| !v.is_nan())
    })
}
