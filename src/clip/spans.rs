//! The kinds of all frames of a clip, whose joints may be filled in different ways.
//!
//! A frame is of the kind `key` if any key is held there, otherwise of the strongest fill of its joints: a curve,
//! a line, or a value that is kept.

use super::command::{Span, SpanKind};

/// The kinds of frames while the keys of a clip are compiled, in order.
pub(super) struct Kinds {
    /// By frame, one more than the index of the last key that is held there; 0 = none.
    held: Vec<u32>,
    /// By frame, the strongest fill.
    fills: Vec<SpanKind>,
}

impl Kinds {
    /// All frames are open.
    pub(super) fn new(frames: u32) -> Kinds {
        let frames = frames as usize;
        Kinds { held: vec![0; frames], fills: vec![SpanKind::Open; frames] }
    }

    /// A key is held over the frames `from..to`.
    pub(super) fn key(&mut self, index: usize, from: u32, to: u32) {
        if let Some(held) = self.held.get_mut(from as usize..to as usize) {
            held.fill(index as u32 + 1);
        }
    }

    /// Some joint is filled in the frames `from..to`.
    pub(super) fn fill(&mut self, from: u32, to: u32, kind: SpanKind) {
        let frames = self.fills.get_mut(from as usize..to as usize).unwrap_or_default();
        frames.iter_mut().filter(|k| strength(**k) < strength(kind)).for_each(|k| *k = kind);
    }

    /// The spans, which tile the clip.
    pub(super) fn spans(self) -> Vec<Span> {
        let mut spans: Vec<Span> = Vec::new();
        let mut before = None;
        for (frame, (held, fill)) in (0..).zip(self.held.into_iter().zip(self.fills)) {
            let kind = if held > 0 { SpanKind::Key } else { fill };
            let run = Some((held, kind));
            match spans.last_mut() {
                Some(span) if run == before => span.to = frame + 1,
                _ => spans.push(Span { from: frame, to: frame + 1, kind }),
            }
            before = run;
        }
        spans
    }
}

fn strength(kind: SpanKind) -> u8 {
    match kind {
        SpanKind::Open | SpanKind::Masked => 0,
        SpanKind::Hold => 1,
        SpanKind::Linear => 2,
        SpanKind::Cubic => 3,
        SpanKind::Key => 4,
    }
}
