//! The layout of the weights on the card: segments that one binding can hold, with rows and columns
//! of matrices padded to multiples of four by zeros, which stay zero.

use std::ops::Range;

use robert_net::params::{Layout, Tensor};

/// One tensor.
#[derive(Clone, Debug)]
pub(crate) struct Slot {
    pub(crate) segment: usize,
    /// Its place in the segment, in numbers.
    pub(crate) offset: usize,
    rows: usize,
    cols: usize,
    /// Rows and columns on the card.
    padded: [usize; 2],
    range: Range<usize>,
    decays: bool,
}

/// All tensors.
#[derive(Clone, Debug)]
pub(crate) struct Slots {
    slots: Vec<Slot>,
    /// Numbers in each segment.
    pub(crate) segments: Vec<usize>,
    /// Numbers in the layout of the processor.
    len: usize,
}

/// Tensors begin where a binding may, also in 16 bits: at a multiple of 256 bytes.
const STEP: usize = 128;
/// The most numbers of a segment of several tensors.
const SEGMENT: usize = 1 << 24;

impl Slots {
    /// Places for a layout; `most` numbers fit in a binding. If a tensor does not fit, its name is
    /// the error.
    pub(crate) fn new(layout: &Layout, most: usize) -> Result<Self, String> {
        let (mut slots, mut segments) = (Vec::new(), vec![0]);
        for tensor in &layout.tensors {
            let Tensor { name, shape, range, decays } = tensor;
            let (rows, cols) = match shape[..] {
                [rows, cols] => (rows, cols),
                _ => (1, range.len()),
            };
            let tall =
                if rows == 1 || name == "position" { rows } else { rows.next_multiple_of(4) };
            let padded = [tall, cols.next_multiple_of(4)];
            let need = (padded[0] * padded[1]).next_multiple_of(STEP);
            if need > most {
                return Err(format!(
                    "{name} has {} MiB, and a kernel sees {} MiB of a buffer",
                    need >> 18,
                    most >> 18
                ));
            }
            let mut at = segments.len() - 1;
            if segments[at] > 0 && segments[at] + need > most.min(SEGMENT) {
                segments.push(0);
                at += 1;
            }
            slots.push(Slot {
                segment: at,
                offset: segments[at],
                rows,
                cols,
                padded,
                range: range.clone(),
                decays: *decays,
            });
            segments[at] += need;
        }
        Ok(Slots { slots, segments, len: layout.len })
    }

    /// The slot of the tensor that has this range in the layout.
    pub(crate) fn of(&self, range: &Range<usize>) -> &Slot {
        let at = self.slots.partition_point(|s| s.range.start < range.start);
        let slot = &self.slots[at];
        assert!(slot.range == *range, "a range that is no tensor: {range:?}");
        slot
    }

    /// Numbers of the layout, as the segments hold them.
    pub(crate) fn spread(&self, flat: &[f32]) -> Vec<Vec<f32>> {
        let mut out: Vec<_> = self.segments.iter().map(|&n| vec![0.0; n]).collect();
        for s in &self.slots {
            for row in 0..s.rows {
                let from = &flat[s.range.start + row * s.cols..][..s.cols];
                out[s.segment][s.offset + row * s.padded[1]..][..s.cols].copy_from_slice(from);
            }
        }
        out
    }

    /// The reverse.
    pub(crate) fn gather(&self, segments: &[Vec<f32>]) -> Vec<f32> {
        let mut out = vec![0.0; self.len];
        for s in &self.slots {
            for row in 0..s.rows {
                let from = &segments[s.segment][s.offset + row * s.padded[1]..][..s.cols];
                out[s.range.start + row * s.cols..][..s.cols].copy_from_slice(from);
            }
        }
        out
    }

    /// For each 128 numbers of each segment, whether weight decay applies.
    pub(crate) fn decays(&self) -> Vec<Vec<u32>> {
        let mut out: Vec<_> = self.segments.iter().map(|&n| vec![0; n / STEP]).collect();
        for s in &self.slots {
            let from = s.offset / STEP;
            out[s.segment][from..from + s.len().div_ceil(STEP)].fill(u32::from(s.decays));
        }
        out
    }
}

impl Slot {
    /// Numbers, with padding.
    pub(crate) fn len(&self) -> usize {
        self.padded[0] * self.padded[1]
    }
}
