//! The binding to Debian's libmujoco 2.2.2, and the only place with `unsafe` besides the tile unit
//! (`linalg::amx`).
//!
//! Rejected: the published crates. They bind `MuJoCo` 3.x or 2.1, and none catches `mju_error`,
//! whose default action waits for a key press. Here every call goes through a guard in `shim.cc`
//! that turns engine errors and C++ exceptions into [`Error`].
//!
//! Invariants:
//! 1. every call that can reach `mju_error` goes through the guard, on the calling thread;
//! 2. slices from raw pointers have lengths from the model and borrow from it;
//! 3. qpos, qvel and ctrl are checked to be finite and of the right length;
//! 4. library version and struct sizes are checked before the first load;
//! 5. compiling a model holds one mutex (the library keeps a global "last XML");
//! 6. no binary `.mjb` models: three of 300 flipped bytes crash the library's loader;
//! 7. warnings go to `tracing`, never into a `MUJOCO_LOG.TXT`;
//! 8. a [`Data`] is poisoned by an engine error until it is reset;
//! 9. `mj_step` resets the state silently on NaN: [`Data::step`] reports that as an error.

#![allow(unsafe_code)]

#[allow(
    clippy::all,
    clippy::pedantic,
    clippy::undocumented_unsafe_blocks,
    missing_debug_implementations,
    non_camel_case_types,
    non_snake_case,
    non_upper_case_globals,
    unreachable_pub,
    dead_code,
    unused_imports
)]
mod bindings;
mod data;
mod environment;
mod error;
mod load;
mod model;
mod names;
mod raw;
mod snapshot;

pub use data::{BareLoop, Contact, Data, Warnings};
pub use environment::set_env_at_start;
pub use error::Error;
pub use load::check_library;
pub use model::{Geom, Inertial, Joint, Model, Transmission};
pub use names::{Kind, index};
pub use snapshot::Snapshot;

/// The required version, as `mj_version` returns it.
pub const VERSION: i32 = 222;
