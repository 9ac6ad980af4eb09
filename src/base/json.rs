//! Plain data as JSON. That it cannot be written would be a mistake of this program (a map whose
//! keys are not text), so it panics; an empty text in its place would be a plausible file.

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
