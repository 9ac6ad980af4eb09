//! Tests of each kernel and of the whole step against the processor. They run on the software
//! driver if there is one, so that a machine without a card runs all of them, else on any adapter.

mod forward;
mod half;
mod kernels;
mod speed;
mod steps;

use super::device::{Device, Span};
use super::kernel::{Step, Tape};
use super::{Arithmetic, Room, cards};
use robert_base::rng::{Rng, Stream};

/// An adapter, or a line that says that there is none.
pub(super) fn device() -> Option<Device> {
    let card = cards(true).into_iter().chain(cards(false)).next();
    let Some(card) = card else {
        println!(
            "skipped: this machine has no adapter for compute shaders, not even a software driver"
        );
        return None;
    };
    Some(Device::of(&card, Arithmetic::Single).unwrap())
}

/// An adapter that multiplies matrices of 16-bit numbers, or a line that says that there is none.
pub(super) fn half() -> Option<Device> {
    let mut all = cards(true).into_iter().chain(cards(false));
    let found = all.find_map(|card| Device::of(&card, Arithmetic::Half).ok());
    if found.is_none() {
        println!("skipped: no adapter of this machine multiplies matrices of 16-bit numbers");
    }
    found
}

/// As [`device`], with a binding of at most 1 MiB.
pub(super) fn narrow() -> Option<Device> {
    Some(device()?.within(Room { binding_bytes: 1 << 20, activation_bytes: 1 << 30 }))
}

pub(super) fn random(n: usize, index: u64) -> Vec<f32> {
    let mut rng = Rng::new(11, Stream::Test, index);
    (0..n).map(|_| rng.normal() as f32).collect()
}

/// A buffer with these numbers.
pub(super) fn put<T: bytemuck::Pod>(gpu: &Device, data: &[T]) -> Span {
    let span = gpu.buffer(size_of_val(data) as u64);
    gpu.write(&span, data);
    span
}

/// Runs the dispatches and reads the first `n` numbers of a buffer.
pub(super) fn run(
    gpu: &Device,
    steps: impl IntoIterator<Item = Step>,
    from: &Span,
    n: usize,
) -> Vec<f32> {
    let mut tape = Tape::default();
    tape.extend(steps);
    tape.submit(gpu);
    let mut all = gpu.read::<f32>(&[from], || ()).unwrap();
    let mut all = all.remove(0);
    all.truncate(n);
    all
}

/// Requires that the difference is small against the whole, and against each number's size.
#[track_caller]
pub(super) fn close(got: &[f32], want: &[f32], tolerance: f64, what: &str) {
    assert_eq!(got.len(), want.len(), "{what}");
    let norm = |x: &mut dyn Iterator<Item = f64>| x.map(|x| x * x).sum::<f64>().sqrt();
    let off = norm(&mut got.iter().zip(want).map(|(&g, &w)| f64::from(g) - f64::from(w)));
    let whole = norm(&mut want.iter().map(|&w| f64::from(w)));
    assert!(off <= tolerance * whole, "{what}: off by {off:e} of {whole:e}");
}
