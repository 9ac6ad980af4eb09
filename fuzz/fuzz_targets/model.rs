//! Weights: a model file is read with finite numbers, or refused.
#![no_main]

use std::path::Path;

use libfuzzer_sys::fuzz_target;
use robert_net::checkpoint;

fuzz_target!(|bytes: &[u8]| {
    let path = Path::new("model.safetensors");
    let card = checkpoint::card(bytes, path);
    if checkpoint::parse(bytes, path, None).is_ok() {
        card.expect("a model has a card");
    }
});
