//! `RoBERT` Studio turns a few keyframes into physically simulated motion of torque-controlled
//! robots.
//!
//! A bidirectional transformer reads the last 30 frames, the current one and the next 20 commanded
//! (or masked) frames at 20 Hz, and answers with the torque to apply now. It is trained on recorded
//! motion without reward, label or demonstration. This crate contains that policy and the tools
//! around it: robots, clips, collection, training, rollouts, pictures, takes and the studio.
//!
//! The modules are arranged in floors, and imports only go down (`tests/floors.rs`).
//!
//! | floor | modules | content |
//! |---|---|---|
//! | 0 | [`clip`], [`units`], [`rng`], [`limits`], [`exit`], [`fsio`], [`progress`] | documents, numbers, files: no simulator |
//! | 1 | [`mujoco`], [`robot`], [`linalg`], [`plot`] | the simulator binding, the robots, matrices, charts |
//! | 2 | [`dataset`], [`net`], [`explore`] | recorded trajectories, the network, the collectors |
//! | 3 | [`train`], [`rollout`], [`render`] | training, policies and rollouts, pictures |
//! | 4 | [`take`] | recorded rollouts and exports |
//! | 5 | [`studio`], [`cli`] | the two user interfaces |
//!
//! Mistakes in foreign data are errors that name their place. Our own mistakes panic instead of
//! becoming plausible numbers: an index that must exist is indexed directly.
//!
//! Start reading at [`clip`] (the document that a person edits), then [`rollout`] (how it is
//! performed), then [`net`] (how the torque is computed).

pub mod child;
pub mod clip;
pub mod exit;
pub mod fsio;
pub mod limits;
pub mod progress;
pub mod rng;
pub mod units;
pub mod xml;

pub mod linalg;
pub mod mujoco;
pub mod plot;
pub mod robot;

pub mod dataset;
pub mod explore;
pub mod net;

pub mod render;
pub mod rollout;
pub mod train;

pub mod take;

pub mod cli;
pub mod studio;
