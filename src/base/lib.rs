//! The base of all floors: exit codes, files, limits, progress, random numbers, units.

pub mod child;
pub mod exit;
pub mod fsio;
pub mod json;
pub mod limits;
pub mod parallel;
pub mod progress;
pub mod rng;
pub mod scratch;
pub mod units;
pub mod xml;
