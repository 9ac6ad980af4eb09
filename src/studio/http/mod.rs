//! The HTTP interface for browsers and scripts: thin handlers behind one guard.

mod answer;
mod basics;
mod clip_import;
mod document;
pub(crate) mod guard;
mod jobs;
mod op;
mod pages;
mod pictures;
mod robots;
mod rollout;
mod router;
mod server;
mod socket;
mod viewport;
mod workspace;

pub(crate) use guard::Guard;
pub use pages::{has_page, has_viser};
pub(crate) use router::router;
pub(crate) use server::{bind, serve};
