//! Charts.

pub mod font;
pub mod palette;
