//! The positions of a robot's parts, and inverse kinematics.
//!
//! [`Kinematics`] is a tree of bodies on hinges and slides, as plain data: it can be sent, stored and
//! compared. Clips with end-effector goals are compiled with it, in processes that never load a
//! simulator. Rejected: asking the simulator. A clip is compiled again at every step of a drag, and
//! the compiler would depend on a process, or on MuJoCo, for a few products of matrices.
//!
//! `robert-robot` fills the tree from a model, and its tests compare all places with MuJoCo's.

mod ik;
mod loops;
mod place;
mod search;
mod tree;

pub use ik::{IkResult, Target};
pub use loops::{Carried, Loops};
pub use place::{Place, PointId, UnknownPoint, shortest_turn};
pub use search::IkConfig;
pub use tree::{
    Anchor, Closure, Follow, JointAxis, JointMotion, Kinematics, LinkFrame, Point, Share, SiteFrame,
};
