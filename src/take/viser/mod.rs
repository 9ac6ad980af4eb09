//! The language of the viser client 1.1.1, without any transport.
//!
//! Both ends of the program speak it: recordings ([`Recording`], `.viser` files and
//! stand-alone pages) are written on this floor, and the studio's live scene imports
//! [`Message`] and [`frame`] from here. What the live scene needs and a recording never
//! holds (gizmos, clicks) is here as well, so that there is one table of messages.
//!
//! * The client checks nothing: a prop that is missing shows as broken rendering. Every
//!   struct therefore lists all props, and none has optional fields that are left out.
//! * Quaternions are w x y z, poses are in the parent's frame, names are `/a/b/c`.
//! * Arrays travel beside the msgpack, see [`Buffer`].

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
