//! Renders pictures, with or without a screen or GPU. A scene, the poses of a frame and a camera
//! give a [`Picture`]; [`encode`] writes files of pictures.
//!
//! It is our own renderer over wgpu. Rejected: existing engines, which need hundreds of packages
//! and another version of glam, and are rarely used headless; and our own software rasteriser,
//! which would need a second set of reference pictures. Without a GPU, software Vulkan is used
//! (Mesa's lavapipe, one system package).
//!
//! ```no_run
//! use robert_render::{Camera, FrameInput, RenderConfig, Renderer, View, encode};
//! # fn f(scene: &robert_render::Scene, poses: &[robert_render::Pose]) -> Result<(), robert_render::Error> {
//! let mut renderer = Renderer::new(RenderConfig::default())?;
//! let camera = Camera::fit(&scene.corners(poses), &View::default(), 640.0 / 480.0);
//! let picture = renderer.draw(scene, &FrameInput::new(poses, camera))?;
//! let png = encode::png(&picture)?;
//! # Ok(()) }
//! ```

mod buffers;
mod camera;
mod camera_path;
mod caption;
mod error;
mod frame;
mod globals;
mod gpu;
mod instances;
mod mesh;
mod model;
mod motion;
mod pick;
mod picture;
mod prims;
mod renderer;
mod scene;
mod shot;
mod targets;

pub mod encode;

pub use camera::{Camera, CameraChoice, Lens, View};
pub use caption::{Caption, Key, Swatch};
pub use error::Error;
pub use frame::{FrameInput, Ghost, GhostKind, Glyph, Mark, SUN, Trail, sun_for};
pub use gpu::Backend;
pub use instances::tint as error_color;
pub use mesh::Mesh;
pub use model::{Stage, poses};
pub use motion::Motion;
pub use picture::{Picture, Strip};
pub use renderer::{Quality, RenderConfig, Renderer};
pub use scene::{Floor, GEOMS, Geom, Pose, Scene, Shape};
pub use shot::{Overlay, Shot};
