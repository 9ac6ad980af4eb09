//! The one integration-test binary: behaviour through the `robert` command.
//!
//! Regressions are named by what broke. `robert()` is the builder that all tests use.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::format_push_string)]
#![allow(clippy::decimal_bitwise_operands, clippy::enum_variant_names, clippy::unnecessary_wraps)]

mod bootstrap;
mod children;
mod circles;
mod clip;
mod collect;
mod docs;
mod exports;
mod fit;
mod floors;
mod full_disk;
mod golden;
mod help;
mod import;
mod malformed;
mod motion;
mod new;
mod parsers;
mod pipes;
mod refusals;
mod render;
mod results;
mod robots;
mod rooms;
mod run;
mod shards;
mod slurm;
mod special_files;
mod strangers;
mod studio;
mod take;
mod tasks;
mod train;
