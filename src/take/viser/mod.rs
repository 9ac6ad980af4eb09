//! The messages of the viser client 1.1.1, without any transport.
//!
//! Recordings ([`Recording`], `.viser` files and stand-alone pages) are written on this floor, and
//! the studio's live scene imports [`Message`] and [`frame`] from here. Messages that only the live
//! scene needs (gizmos, clicks) are here as well, so that there is one table of messages.
//!
//! * The client checks nothing: a missing prop breaks the rendering. Every struct therefore lists
//!   all props, and no optional field is left out.
//! * Quaternions are w x y z, poses are in the parent's frame, names are `/a/b/c`.
//! * Arrays are sent beside the msgpack, see [`Buffer`].

mod apart;
mod buffer;
mod encode;
mod messages;
mod record;

pub use apart::Apart;
pub use buffer::Buffer;
pub use encode::{SUBPROTOCOL, VERSION, frame};
pub use messages::*;
pub use record::{Recording, node_name};
