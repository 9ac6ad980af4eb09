//! One rule a file; each adds its findings to the [`Finder`](super::finder::Finder).

mod blind;
mod coupled;
mod hidden;
mod limits;
mod offsets;
mod partial;
mod poses;
mod reach;
mod robot;
mod speeds;
mod tangents;
