//! Mask spans of a compiled clip.

use std::collections::BTreeMap;

use super::command::{Span, SpanKind, push_span};
use super::document::Clip;

/// Removes the goals that mask spans cover; `visible` is (frames, dim). Returns the spans of the
/// clip, including the masked ones. Starts and ends of masks are counted and summed once, so that
/// many overlapping masks cost no more than the frames that they cover.
pub(super) fn hide(clip: &Clip, visible: &mut [bool], spans: Vec<Span>) -> Vec<Span> {
    let dim = clip.dim();
    let frames = clip.length as usize;
    if clip.masks.is_empty() {
        return spans;
    }
    let mut all = vec![0_i32; frames + 1];
    let mut some: Vec<i32> = Vec::new();
    if clip.masks.iter().any(|m| m.joints.is_some()) {
        some = vec![0; (frames + 1) * dim];
    }
    let index: BTreeMap<&str, usize> =
        clip.robot.joints.iter().enumerate().map(|(i, j)| (j.as_str(), i)).collect();
    for mask in &clip.masks {
        let ends = [(mask.from as usize, 1), (mask.to as usize, -1)];
        for (at, step) in ends {
            match &mask.joints {
                None => bump(&mut all, at, step),
                Some(joints) => {
                    for j in joints.iter().filter_map(|j| index.get(j.as_str())) {
                        bump(&mut some, at * dim + j, step);
                    }
                }
            }
        }
    }
    let mut hidden = vec![false; frames];
    let mut open = 0;
    let mut each = vec![0_i32; dim];
    for (t, row) in visible.chunks_exact_mut(dim).enumerate() {
        open += all.get(t).copied().unwrap_or(0);
        let steps = some.get(t * dim..).unwrap_or_default();
        each.iter_mut().zip(steps).for_each(|(n, d)| *n += d);
        for (v, n) in row.iter_mut().zip(&each) {
            *v &= open == 0 && *n == 0;
        }
        if let Some(h) = hidden.get_mut(t) {
            *h = open > 0;
        }
    }
    let mut out = Vec::new();
    for span in spans {
        let mut from = span.from;
        for t in span.from..span.to {
            let is = |t: u32| hidden.get(t as usize).copied().unwrap_or(false);
            if t + 1 == span.to || is(t) != is(t + 1) {
                let kind = if is(t) { SpanKind::Masked } else { span.kind };
                push_span(&mut out, from, t + 1, kind);
                from = t + 1;
            }
        }
    }
    out
}

fn bump(counts: &mut [i32], at: usize, step: i32) {
    if let Some(n) = counts.get_mut(at) {
        *n += step;
    }
}
