//! Motion of other programs, read as clips.
//!
//! Each reader gives [`Samples`]: joints by name, rows with times. Samples become a clip for a
//! robot that has these joints, and thinning turns rows into keys. Facts that the files do not
//! contain (their rate, their order of joints) must be given and are never guessed.

mod bag;
mod bvh;
mod lafan;
mod lerobot;
mod pages;
mod samples;
mod thrift;
mod tracking;
mod turn;

pub use bag::from_bag;
pub use bvh::from_bvh;
pub use lafan::from_lafan;
pub use lerobot::{LeRobotSource, from_lerobot};
pub use samples::Samples;
pub use tracking::from_tracking;
