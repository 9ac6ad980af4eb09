//! Pictures, with or without a screen or GPU: a scene, the poses of a frame, an eye; out comes a
//! [`Picture`], and [`encode`] makes files of pictures.
//!
//! An own renderer over wgpu: the engines on offer bring hundreds of packages and another glam,
//! and none is known for headless work. Software Vulkan (Mesa's lavapipe, one system package) is
//! the driver where there is no GPU; a rasteriser of our own would only be a second look and a
//! second set of reference pictures.
//!
//! ```no_run
//! use robert::render::{Camera, FrameInput, RenderConfig, Renderer, View, encode};
//! # fn f(scene: &robert::render::Scene, poses: &[robert::render::Pose]) -> Result<(), robert::render::Error> {
//! let mut renderer = Renderer::new(RenderConfig::default())?;
//! let camera = Camera::fit(&scene.corners(poses), &View::default(), 640.0 / 480.0);
//! let picture = renderer.draw(scene, &FrameInput::new(poses, camera))?;
//! let png = encode::png(&picture)?;
//! # Ok(()) }
//! ```

mod camera;
mod caption;
mod error;
mod frame;
mod gpu;
mod instances;
mod mesh;
mod model;
mod pick;
mod picture;
mod prims;
mod renderer;
mod scene;
mod shot;

pub mod encode;

pub use camera::{Camera, CameraChoice, Lens, View};
pub use caption::{Caption, Key, Swatch};
pub use error::Error;
pub use frame::{FrameInput, Ghost, GhostKind, Glyph, Mark, SUN, Trail, sun_for};
pub use gpu::Backend;
pub use instances::tint as error_color;
pub use mesh::Mesh;
pub use model::{Stage, poses};
pub use picture::{Picture, Strip};
pub use renderer::{Quality, RenderConfig, Renderer};
pub use scene::{Floor, GEOMS, Geom, Pose, Scene, Shape};
pub use shot::{Motion, Overlay, Shot};
