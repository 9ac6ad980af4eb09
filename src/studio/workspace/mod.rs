//! The folder that the studio works in, with imports and exports.

pub(crate) mod clip_import;
pub(crate) mod export;
pub(crate) mod folders;
pub(crate) mod formats;
pub(crate) mod gallery;
mod pictures;
mod recent;
pub(crate) mod robot_folders;
pub(crate) mod runs;
mod shared;
pub(crate) mod transfer;
mod uploads;

pub(crate) use pictures::Shown;
pub use recent::state_dir;
pub(crate) use shared::Workspace;
pub(crate) use uploads::upload_path;
