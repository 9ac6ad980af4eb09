//! Clips: reading, editing, checking, converting.

mod command_line;
mod edits;
mod fuzz;
mod generate;
mod hostile;
mod lints;
mod schema;
