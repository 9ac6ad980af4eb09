//! Takes: recorded rollouts, their files and exports.
//!
//! A [`Take`] is a plain value with the clip and command, the reached coordinates, actions and body
//! poses, the precision and the origin. Its file is MCAP with `sensor_msgs/JointState` and
//! `foxglove.FrameTransforms`, the only pair of messages that Foxglove, Lichtblick and Rerun all
//! read.
//!
//! The same clip, policy and seed give the same bytes: the file contains no wall-clock time, and
//! log times count from a fixed [`EPOCH_SECS`].
//!
//! Rejected: our own format (no viewer would open it), the foxglove SDK (a runtime and dozens of
//! packages for four message types) and the readers of the `mcap` crate. Version 0.26 fixed the
//! endless loop of 0.25, but it still subtracts unchecked in an uncompressed chunk whose records
//! overrun it, slices a short attachment record unchecked, and names no place in its errors.
//! [`records`](self) reads with bounds instead.
//!
//! [`viser`] contains the messages of the viser client. Recordings are written from here, and the
//! studio's live scene uses the same messages.

mod assemble;
mod cdr;
mod document;
mod error;
pub mod export;
mod geometry;
mod header;
pub mod html;
pub mod import;
mod json;
mod proto;
mod read;
mod records;
#[cfg(test)]
mod sample;
mod scene;
mod text;
mod write;

pub mod viser;

pub use document::{Provenance, RobotFacts, Take, What};
pub use error::{Damage, Error};
pub use geometry::{BodyMesh, body_meshes};
pub use read::Recovered;
pub use scene::Scene;
pub use write::{EPOCH_SECS, topic};
