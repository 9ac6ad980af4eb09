//! The animation document: keyframes, masks and what can be done to them.

pub mod command;
pub mod compile;
pub mod document;
pub mod error;
mod json;
mod parse;
mod print;
pub mod validate;

pub use command::{
    Blind, Command, LOOKAHEAD_FRAMES, PRE_ROLL_FRAMES, Sight, Span, SpanKind, VirtualKey,
};
pub use compile::{compile, start_row};
pub use document::*;
pub use error::ClipError;
pub use parse::{Parsed, load, parse, parse_bytes};
pub use validate::{Flaw, Invalid};
