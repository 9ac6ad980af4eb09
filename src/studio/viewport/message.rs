//! Messages to the stage.

use std::sync::Arc;

use tokio::sync::oneshot;

use super::incoming::Incoming;
use crate::protocol::{Error, Geometry, Hovered, IkAnswer, Plane, StudioOp};
use crate::simulation::RobotContext;

/// Body transforms of poses; (nbody, 7) each.
pub(super) type Bodies = Result<Vec<Vec<f32>>, Error>;

/// Points of the world with their times: x, y, z in m, and seconds.
pub(super) type Sketched = Result<Vec<[f64; 4]>, Error>;

/// A message to the stage.
#[derive(Debug)]
pub(super) enum ViewportMessage {
    /// A request of a page, and a channel for its completion: what is read afterwards must show its
    /// effect.
    View(StudioOp, oneshot::Sender<()>),
    /// A message of a page's 3D client.
    Client(Option<String>, Incoming),
    /// Asks for the part under a page's pointer; 0 to 1 from the top left corner.
    Hover(String, [f64; 2], oneshot::Sender<Option<Hovered>>),
    /// Points of a page's picture with their times, to be projected onto a plane through a site.
    Sketch(String, Vec<[f64; 3]>, Plane, String, oneshot::Sender<Sketched>),
    /// Meshes of a robot.
    Geometry(Arc<RobotContext>, Result<Geometry, Error>),
    /// Transforms of a floating pose.
    Floating(u64, Bodies),
    /// Transforms of the commanded pose at a frame that is not simulated.
    Ghost(usize, Bodies),
    /// Transforms of the keys around the playhead.
    Onion([Option<u32>; 2], Bodies),
    /// Transforms of the pose that can be reached in the place of a commanded one.
    Reachable(Vec<f64>, Bodies),
    /// Inverse kinematics, for a drag.
    Ik(u64, Result<IkAnswer, Error>),
}
