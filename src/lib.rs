//! `RoBERT` Studio: a few keyframes in, physically simulated motion out.
//!
//! A bidirectional transformer, trained on motion that curious agents produced
//! without reward, label or demonstration, reads the last 30 frames, the current
//! one and the next 20 commanded (or masked) frames at 20 Hz, and answers with the
//! torque to apply now. Around that policy this crate is the whole tool: robots,
//! clips, collection, training, rollouts, pictures, takes and the studio.
//!
//! The crate is a house of floors; imports only go down (`tests/floors.rs`).
//!
//! | floor | modules | what lives there |
//! |---|---|---|
//! | 0 | [`clip`], [`units`], [`rng`], [`limits`], [`exit`], [`fsio`], [`progress`] | documents, numbers, files: no simulator |
//! | 1 | [`mujoco`], [`robot`], [`linalg`], [`plot`] | the simulator layer, the robots, matrices, charts |
//! | 2 | [`dataset`], [`net`], [`explore`] | trajectories, the network, the curious agents |
//! | 3 | [`train`], [`rollout`], [`render`] | learning, acting, seeing |
//! | 4 | [`take`] | recorded rollouts and exports |
//! | 5 | [`studio`], [`cli`] | what people touch |
//!
//! Foreign data is answered with an error that names its place; an index of our own that must
//! exist is indexed, so that a mistake of ours panics instead of becoming a plausible number.
//!
//! Start reading at [`clip`] (what a person writes), then [`rollout`] (what is done
//! with it), then [`net`] (how the torque is found).

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
