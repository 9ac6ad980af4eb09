//! Takes and bags: a file is read whole, its frames before the damage are recovered, or it is refused.
#![no_main]

use libfuzzer_sys::fuzz_target;
use robert_take::{Take, import};

fn is_sound(take: &Take) {
    assert_eq!(take.reached.len() % take.state_dim().max(1), 0);
    assert!(take.reached.iter().all(|v| v.is_finite()));
    take.precision();
}

fuzz_target!(|bytes: &[u8]| {
    let read = Take::from_mcap(bytes);
    let recovered = Take::recover_mcap(bytes);
    if let Ok(take) = &read {
        is_sound(take);
        let recovered = recovered.as_ref().expect("what is whole can be recovered");
        assert!(recovered.damage.is_none());
    }
    if let Ok(recovered) = &recovered {
        is_sound(&recovered.take);
    }
    if let Ok(samples) = import::from_bag(bytes) {
        assert_eq!(samples.rows.len(), samples.secs.len());
    }
});
