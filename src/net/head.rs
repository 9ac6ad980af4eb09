//! The action head of Behaviour Transformers. There are K bins over the whole action vector; the
//! head gives a logit and an offset for each. The loss is the focal loss on the bin plus the
//! squared error of the true bin's offset. K = 1 is plain regression around the mean action.
//!
//! Output of one token: K logits, K × A offsets, and A gates when the linear skip is gated.

use super::batch::{Batch, Place};
use super::config::{CURRENT, NetConfig, SkipKind, WINDOW};
use robert_linalg::Real;

/// Numbers of hidden command frames right after the current one: 0 to 20.
pub const GAPS: usize = 21;

/// Oldest frame that counts in [`Sums::place_square`]: after 16 frames of history, more positions
/// do not improve the estimate of a velocity.
const SETTLED: usize = 16;

/// Sums over the tokens of a batch, for the log.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sums {
    /// Loss of the batch, already multiplied by its scale.
    pub loss: f64,
    /// Squared action error (mean over actuators) on visible and on masked tokens.
    pub square: [f64; 2],
    /// Tokens, visible and masked.
    pub tokens: [f64; 2],
    /// Squared error of the current frame's action by hidden frames after it.
    pub gap_square: [f64; GAPS],
    /// Windows by hidden frames after the current one.
    pub gap_windows: [f64; GAPS],
    /// Squared error of the actions of frames 16 to 30 whose next frame is visible, by
    /// [`Place`].
    pub place_square: [f64; 3],
    /// Those frames, by [`Place`].
    pub place_tokens: [f64; 3],
}

impl Sums {
    /// Adds another batch.
    pub fn add(&mut self, other: &Sums) {
        let pair = |a: &mut [f64], b: &[f64]| a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        self.loss += other.loss;
        pair(&mut self.square, &other.square);
        pair(&mut self.tokens, &other.tokens);
        pair(&mut self.gap_square, &other.gap_square);
        pair(&mut self.gap_windows, &other.gap_windows);
        pair(&mut self.place_square, &other.place_square);
        pair(&mut self.place_tokens, &other.place_tokens);
    }

    /// Counts the squared action error of one token of a batch; `masked` and `place` are those of
    /// the whole batch, (B, 51).
    pub fn count(&mut self, masked: &[bool], place: &[Place], row: usize, square: f64) {
        let (i, place) = (row % WINDOW, place[row]);
        if place == Place::Told {
            return;
        }
        let side = usize::from(masked[row]);
        self.square[side] += square;
        self.tokens[side] += 1.0;
        if i == CURRENT {
            let after = &masked[row + 1..row + WINDOW - CURRENT];
            let gap = after.iter().take_while(|&&m| m).count().min(GAPS - 1);
            self.gap_square[gap] += square;
            self.gap_windows[gap] += 1.0;
        }
        if (SETTLED..=CURRENT).contains(&i) && !masked[row + 1] {
            self.place_square[place as usize] += square;
            self.place_tokens[place as usize] += 1.0;
        }
    }
}

/// Index of the centre nearest to this action.
pub fn nearest<T: Real>(centres: &[T], action: &[T]) -> usize {
    let mut best = (0, f64::INFINITY);
    for (k, centre) in centres.chunks_exact(action.len().max(1)).enumerate() {
        let d: f64 = centre.iter().zip(action).map(|(&c, &a)| (c - a).f64().powi(2)).sum();
        if d < best.1 {
            best = (k, d);
        }
    }
    best.0
}

/// Turns the head's output into its gradient and returns the loss, summed over tokens and
/// multiplied by `scale`.
pub fn loss<T: Real>(
    cfg: &NetConfig,
    centres: &[T],
    batch: &Batch<T>,
    out: &mut [T],
    scale: f64,
    current_only: bool,
) -> Sums {
    let (a, bins) = (cfg.actions, cfg.bins);
    let (skips, gated) = (cfg.skip != SkipKind::Off, cfg.skip == SkipKind::Gated);
    let mut sums = Sums::default();
    let rows = out.chunks_exact_mut(cfg.outputs()).zip(batch.actions.chunks_exact(a));
    for (row, (y, action)) in rows.enumerate() {
        let weight = batch.weight[row].f64();
        let counts = !current_only || row % WINDOW == CURRENT;
        let factor = if counts { scale * weight } else { 0.0 };
        let bin = nearest(centres, action);

        let (logits, rest) = y.split_at_mut(bins);
        let (offsets, gates) = rest.split_at_mut(bins * a);
        let linear = if skips { &batch.linear[row * a..(row + 1) * a] } else { &[] };
        let centre = &centres[bin * a..(bin + 1) * a];
        let mut square = 0.0;
        let lambda = if bins > 1 { cfg.offset_weight } else { 1.0 };
        for (j, &want) in action.iter().enumerate() {
            let offset = offsets[bin * a + j].f64();
            let base = centre[j].f64();
            let gate = if gated { gates[j].f64() } else { 0.0 };
            let line = if skips { linear[j].f64() } else { 0.0 };
            let error = base + (1.0 + gate) * line + offset - want.f64();
            square += error * error;
            let slope = 2.0 * lambda * error / a as f64 * factor;
            for (k, o) in offsets.chunks_exact_mut(a).enumerate() {
                o[j] = if k == bin { T::of(slope) } else { T::default() };
            }
            if gated {
                gates[j] = T::of(slope * line);
            }
        }
        square /= a as f64;
        sums.loss += factor * (lambda * square + focal(logits, bin, factor));
        sums.count(&batch.masked, &batch.place, row, square);
    }
    sums
}

/// −(1 − p)² log p of the true bin; the logits become its gradient times `factor`.
fn focal<T: Real>(logits: &mut [T], bin: usize, factor: f64) -> f64 {
    if logits.len() == 1 {
        logits.fill(T::default());
        return 0.0;
    }
    let top = logits.iter().fold(f64::NEG_INFINITY, |m, l| m.max(l.f64()));
    let total: f64 = logits.iter().map(|l| (l.f64() - top).exp()).sum();
    let log_p = logits[bin].f64() - top - total.ln();
    let p = log_p.exp();
    let common = 2.0 * (1.0 - p) * p * log_p - (1.0 - p).powi(2);
    for (k, l) in logits.iter_mut().enumerate() {
        let q = (l.f64() - top).exp() / total;
        let one = if k == bin { 1.0 } else { 0.0 };
        *l = T::of(factor * common * (one - q));
    }
    -(1.0 - p).powi(2) * log_p
}

/// The rule that chooses a bin at inference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Choice {
    /// The most likely bin.
    Argmax,
    /// Drawn from the softmax with this uniform number (the paper's way).
    Sample(f64),
    /// The mean of all bins' actions, weighted by the softmax.
    Mean,
}

/// Applies the dead zone to a correction; see [`NetConfig::dead_zone`].
fn calm(correction: f64, dead_zone: f64) -> f64 {
    let share = dead_zone / correction;
    if share.abs() < 1.0 { correction * (1.0 - share * share) } else { 0.0 }
}

/// The action of one token, clamped to [−1, 1].
pub fn decode<T: Real>(
    cfg: &NetConfig,
    centres: &[T],
    out: &[T],
    linear: &[T],
    choice: Choice,
    action: &mut [T],
) {
    let (a, bins) = (cfg.actions, cfg.bins);
    let (skips, gated) = (cfg.skip != SkipKind::Off, cfg.skip == SkipKind::Gated);
    let (logits, rest) = out.split_at(bins);
    let top = logits.iter().fold(f64::NEG_INFINITY, |m, l| m.max(l.f64()));
    let odds = |bin: usize| (logits[bin].f64() - top).exp();
    let total = || (0..bins).map(odds).sum::<f64>();
    let gates = &rest[bins * a..];
    let said = |bin: usize, j: usize| {
        let gate = if gated { gates[j].f64() } else { 0.0 };
        let base = centres[bin * a + j].f64();
        let offset = rest[bin * a + j].f64();
        let line = if skips { linear[j].f64() } else { 0.0 };
        match cfg.dead_zone {
            0.0 => base + (1.0 + gate) * line + offset,
            zone => line + calm(base + gate * line + offset, zone),
        }
    };
    let bin = match choice {
        Choice::Argmax => {
            (0..logits.len()).fold(0, |m, k| if logits[k] > logits[m] { k } else { m })
        }
        Choice::Sample(u) => {
            let mut left = u * total();
            let hit = (0..bins).position(|bin| {
                left -= odds(bin);
                left < 0.0
            });
            hit.unwrap_or(bins - 1)
        }
        Choice::Mean => {
            let total = total();
            for (j, to) in action.iter_mut().enumerate() {
                let mean: f64 = (0..bins).map(|bin| odds(bin) / total * said(bin, j)).sum();
                *to = T::of(mean.clamp(-1.0, 1.0));
            }
            return;
        }
    };
    for (j, to) in action.iter_mut().enumerate() {
        *to = T::of(said(bin, j).clamp(-1.0, 1.0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Mixing;

    #[test]
    fn the_mean_of_the_bins_lies_between_them() {
        let cfg = NetConfig {
            layers: 1,
            width: 16,
            heads: 1,
            inputs: 2,
            actions: 2,
            bins: 2,
            offset_weight: 10.0,
            mask_replaces: false,
            skip: SkipKind::Off,
            mixing: Mixing::Attention,
            dead_zone: 0.0,
        };
        // Odds of 1 to 3, then the offsets of each bin.
        let out = [0.0, 3.0_f64.ln(), 0.1, 0.0, -0.1, 2.0];
        let centres = [-0.5, 0.2, 0.5, 0.4];
        let mut action = [0.0_f64; 2];
        let mut run = |choice| {
            decode(&cfg, &centres, &out, &[], choice, &mut action);
            action
        };
        let near = |a: [f64; 2], b: [f64; 2]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(near(run(Choice::Argmax), [0.4, 1.0]));
        assert!(near(run(Choice::Sample(0.1)), [-0.4, 0.2]));
        assert!(near(run(Choice::Mean), [0.25 * -0.4 + 0.75 * 0.4, 1.0]));
    }

    #[test]
    fn small_corrections_count_for_nothing_and_large_ones_stay() {
        let cfg = NetConfig {
            layers: 1,
            width: 16,
            heads: 1,
            inputs: 2,
            actions: 3,
            bins: 1,
            offset_weight: 10.0,
            mask_replaces: false,
            skip: SkipKind::Gated,
            mixing: Mixing::Attention,
            dead_zone: 0.05,
        };
        // A logit, three offsets, three gates: corrections of .04, -.05 and .5.
        let out = [0.0, 0.04, -0.06, 0.5, 0.0, 0.05, 0.0];
        let (centres, linear) = ([0.0; 3], [0.3, 0.2, -0.1]);
        let mut action = [0.0_f64; 3];
        decode(&cfg, &centres, &out, &linear, Choice::Argmax, &mut action);
        let want = [0.3, 0.2, -0.1 + 0.5 - 0.0025 / 0.5];
        assert!(action.iter().zip(want).all(|(a, w)| (a - w).abs() < 1e-12), "{action:?}");
        let plain = NetConfig { dead_zone: 0.0, ..cfg };
        decode(&plain, &centres, &out, &linear, Choice::Argmax, &mut action);
        let want = [0.34, 0.15, 0.4];
        assert!(action.iter().zip(want).all(|(a, w)| (a - w).abs() < 1e-12), "{action:?}");
    }
}
