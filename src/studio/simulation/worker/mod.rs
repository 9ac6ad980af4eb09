//! The simulation in a process of its own.
//!
//! A segmentation fault, an allocation that aborts, an endless loop: none of them can be caught
//! inside a process, and models are foreign files. So everything that touches the simulator runs in
//! a child of the same binary (`robert __worker`), under limits that it sets itself. The parent
//! owns the document and the journal, so the death of the child loses no data.
//!
//! Rejected: threads with `catch_unwind`, which catches none of these, and a crate for sandboxes,
//! because the child is our own code and needs only limits.
//!
//! `message.rs` contains the messages, `codec.rs` the framing, `child.rs` the child's side,
//! `supervisor.rs` and `handle.rs` the parent's side. Pictures are drawn in a second child of the
//! same kind (`paint.rs`), so that neither a graphics driver nor its memory disturbs the
//! simulation.

mod child;
mod codec;
mod handle;
mod message;
mod out;
mod paint;
mod performer;
mod query;
mod slow;
mod supervisor;
mod trace;

pub use child::run;
pub(crate) use handle::WorkerHandle;
pub(crate) use message::{
    CheckPoses, Checked, Dense, DescribeRobot, Frames, Kinematics, LoadRobot, LookAtRobot,
    MotionRows, PaintRequest, Perform, PickRequest, Picture, Question, SetPolicy, Settle,
    SimulationEvent, Stop, Subject, Trace,
};
pub(crate) use supervisor::WorkerSink;
