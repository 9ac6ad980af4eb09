//! Takes and datasets as files of other programs: learning, tracking, animation, robots.
//!
//! Every writer is a function from a take (and the robot, where bodies count) to an
//! [`Export`]: files, what their numbers mean, and the command that opens them. Same take,
//! same bytes: no wall clock, no order of a hash.

mod bag;
mod bvh;
mod episode;
mod files;
mod glb;
mod lafan;
mod lerobot;
mod lerobot_features;
mod lerobot_layout;
mod minari;
mod skeleton;
mod stats;
mod table;
mod track;
mod tracking;
mod trajectory;
mod ur_script;
mod usda;
mod video;

pub use bag::bag;
pub use bvh::bvh;
pub use episode::{Columns, Episode};
pub use files::{Export, File, Folder};
pub use glb::glb;
pub use lafan::lafan;
pub use lerobot::lerobot;
pub use lerobot_layout::{LeRobotAction, LeRobotOptions, LeRobotVersion};
pub use minari::minari;
pub use skeleton::{Bodies, Pose, Skeleton};
pub use tracking::{TRACKING_FPS, tracking};
pub use trajectory::{RosOptions, ros};
pub use ur_script::{UrMove, ur_script};
pub use usda::usda;
pub use video::Films;
