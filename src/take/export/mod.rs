//! Takes and datasets as files of other programs: learning, tracking, animation, robots.
//!
//! Every writer is a function from a take (and the robot, if its bodies are needed) to an
//! [`Export`]: files, the meaning of their numbers, and the command that opens them. The same take
//! gives the same bytes: nothing depends on the wall clock or on the order of a hash map.

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
pub use bvh::{JointedBody, bvh, bvh_unfit};
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
pub use ur_script::{UrMove, fits_ur, ur_script};
pub use usda::usda;
pub use video::Films;
