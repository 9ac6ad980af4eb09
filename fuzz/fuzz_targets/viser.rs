//! Messages of the page's 3D client: finite numbers and a camera that can be drawn with, or nothing.
#![no_main]

#[allow(dead_code)] // of their files only the reading is used
mod viewport;

use libfuzzer_sys::fuzz_target;
use viewport::incoming::Incoming;

fuzz_target!(|bytes: &[u8]| {
    if let Some(message) = Incoming::read(bytes) {
        assert!(viewport::is_sound(&message), "{message:?}");
    }
});
