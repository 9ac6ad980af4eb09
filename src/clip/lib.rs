//! The animation document: keyframes, masks and what can be done to them.

pub mod apply;
pub mod command;
pub mod compile;
mod curve;
pub mod delta;
mod demand;
pub mod document;
pub mod editor;
pub mod error;
pub mod flaw;
pub mod formats;
mod grid;
mod history;
pub mod joints;
mod json;
pub mod lint;
mod masks;
pub mod offset;
pub mod op;
mod op_keys;
mod op_layers;
mod parse;
mod parse_key;
pub mod part;
mod path;
mod print;
pub mod reach;
mod schema;
pub mod solve;
mod sparsify;
pub mod tangent;
mod validate;

pub use apply::{OpError, apply, edited};
pub use command::{
    Blind, Command, LOOKAHEAD_FRAMES, PRE_ROLL_FRAMES, Sight, Span, SpanKind, VirtualKey,
};
pub use compile::{compile, compile_for};
pub use delta::{Delta, Foreign};
pub use demand::{Demand, demand};
pub use document::*;
pub use editor::{Change, Editor, Step, Version};
pub use error::ClipError;
pub use flaw::{Flaw, Invalid};
pub use grid::round;
pub use joints::*;
pub use lint::{Fix, Level, Lint, PoseChecker, PoseReport, Rule, lint};
pub use offset::{FADE_FRAMES, Offset};
pub use op::*;
pub use parse::{Parsed, load, parse, parse_bytes};
pub use part::Part;
pub use reach::{Reach, Reached};
pub use robert_kinematics::Point;
pub use schema::Clip as ClipShape;
pub use schema::schema;
pub use sparsify::thin;
pub use tangent::{Corner, Tangent, TangentName};
