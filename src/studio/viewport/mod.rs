//! The 3D viewport: our side of the viser 1.1.1 protocol.
//!
//! | module | owns |
//! |---|---|
//! | `handle` | the way in for clients and requests |
//! | `incoming`, `message` | messages of the client, messages to the stage |
//! | `shared`, `retained` | the scene, and the part of it that each client has not received yet |
//! | `stage`, `run` | what is shown; the loop that keeps it up to date |
//! | `playback`, `overlays`, `refresh` | the frame, the figures beside the robot, and drawing both |
//! | `reachable` | the pose that the robot can reach where it cannot reach the commanded one |
//! | `drag`, `gestures`, `gizmo` | the drag in progress, mouse gestures, handles for dragging |
//! | `figure`, `scene_nodes`, `build`, `shell` | a robot as nodes; the outline of the selected link |
//! | `page_camera`, `camera`, `framing`, `hit` | positions of cameras; the part under a pointer |
//!
//! The messages and their encoding are in [`robert_take::viser`]. The client does not check them
//! and reconnects by itself; every connection gets the whole scene first.

mod build;
mod camera;
mod drag;
mod figure;
mod framing;
mod gestures;
mod gizmo;
mod handle;
mod hit;
mod incoming;
mod message;
mod motion_path;
mod overlays;
mod page_camera;
mod path_hands;
mod playback;
mod reachable;
mod refresh;
mod retained;
mod run;
mod scene_nodes;
mod shared;
mod shell;
mod sketch;
mod space;
mod stage;

pub(crate) use handle::Viewport;
pub(crate) use incoming::Incoming;
