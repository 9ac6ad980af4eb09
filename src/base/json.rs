//! Plain data as JSON. If it could not be written (a map whose keys are not text), that would be a
//! mistake of this program, so it panics. Writing an empty text instead would produce a file that
//! looks valid.

use serde::Serialize;

/// The data as JSON in one line, without a line break at its end.
pub fn line<T: Serialize + ?Sized>(data: &T) -> String {
    serde_json::to_string(data).unwrap_or_else(|e| refuse(&e))
}

/// The data as indented JSON, without a line break at its end.
pub fn pretty<T: Serialize + ?Sized>(data: &T) -> String {
    serde_json::to_string_pretty(data).unwrap_or_else(|e| refuse(&e))
}

/// The data as a JSON value.
pub fn value<T: Serialize>(data: T) -> serde_json::Value {
    serde_json::to_value(data).unwrap_or_else(|e| refuse(&e))
}

fn refuse(error: &serde_json::Error) -> ! {
    panic!("plain data that JSON cannot hold: {error}")
}
