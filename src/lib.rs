//! `RoBERT` Studio turns a few keyframes into physically simulated motion of torque-controlled
//! robots.
//!
//! A bidirectional transformer reads the last 30 frames, the current one and the next 20 commanded
//! (or masked) frames at 20 Hz, and answers with the torque to apply now. It is trained on recorded
//! motion without reward, label or demonstration. This crate contains that policy and the tools
//! around it: robots, clips, collection, training, rollouts, pictures, takes and the studio.
//!
//! Each module is a crate of its own (`robert-clip`, and so on). This crate re-exports them and
//! adds the command line. The crates are ordered in floors, and imports only go down
//! (`tests/floors.rs`).
//!
//! | floor | modules | content |
//! |---|---|---|
//! | 0 | [`units`], [`rng`], [`limits`], [`exit`], [`fsio`], [`scratch`], [`progress`], [`xml`], [`child`], [`kinematics`] | numbers, files, child processes, trees of bodies |
//! | 1 | [`clip`], [`mujoco`], [`linalg`], [`plot`] | the document, the simulator binding, matrices, charts |
//! | 2 | [`robot`], [`net`] | the robots, the network |
//! | 3 | [`dataset`], [`render`], [`gpu`] | recorded trajectories, pictures, training on graphics cards |
//! | 4 | [`explore`] | the collectors |
//! | 5 | [`rollout`] | policies and rollouts |
//! | 6 | [`train`], [`take`] | training, recorded rollouts and exports |
//! | 7 | [`studio`], [`shard`] | the server, work in shards |
//! | 8 | [`cli`] | the command line |
//!
//! Mistakes in foreign data are errors that name their place. Our own mistakes panic instead of
//! becoming plausible numbers: an index that must exist is indexed directly.
//!
//! Start reading at [`clip`] (the document that a person edits), then [`rollout`] (how it is
//! performed), then [`net`] (how the torque is computed).

pub use robert_base::{child, exit, fsio, limits, parallel, progress, rng, scratch, units, xml};

pub use robert_clip as clip;
pub use robert_dataset as dataset;
pub use robert_explore as explore;
pub use robert_gpu as gpu;
pub use robert_kinematics as kinematics;
pub use robert_linalg as linalg;
pub use robert_mujoco as mujoco;
pub use robert_net as net;
pub use robert_plot as plot;
pub use robert_render as render;
pub use robert_robot as robot;
pub use robert_rollout as rollout;
pub use robert_shard as shard;
pub use robert_studio as studio;
pub use robert_take as take;
pub use robert_train as train;

pub mod cli;
