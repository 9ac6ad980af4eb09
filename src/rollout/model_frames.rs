//! What a model sees of a window.

use std::sync::Arc;

use super::reachable::Reachable;
use super::window::Window;
use robert_net::reach::Reach;
use robert_net::{COMMAND, CURRENT, Encoder, MaskGranularity, WINDOW};

/// Converts a window of a rollout for the network.
#[derive(Clone, Debug)]
pub(super) struct Frames {
    granularity: MaskGranularity,
    reachable: Option<Arc<Reachable>>,
    /// Whether masked frames are left to the network.
    pub(super) masks: bool,
    /// See [`super::inference::Inference::ahead`].
    pub(super) ahead: usize,
    pub(super) q: Vec<f32>,        // (51, S)
    pub(super) visible: Vec<bool>, // (51, S)
}

impl Frames {
    pub(super) fn new(encoder: &Encoder, reach: Option<&Reach>) -> Self {
        let n = WINDOW * encoder.tokens.state();
        let granularity = encoder.tokens.config().granularity;
        let reachable = reach.map(|r| Arc::new(Reachable::new(r)));
        let (q, visible) = (vec![0.0; n], vec![true; n]);
        Frames { granularity, reachable, masks: false, ahead: 0, q, visible }
    }

    pub(super) fn sees_plan(&self) -> bool {
        self.reachable.is_some() && !self.masks
    }

    pub(super) fn fill(&mut self, window: &Window) {
        let s = window.dim();
        let mut put = |window: &Window| {
            let states = window.history.iter().chain(&window.current).chain(&window.command);
            for (to, &x) in self.q.iter_mut().zip(states) {
                *to = x as f32;
            }
            let command = &mut self.visible[(CURRENT + 1) * s..];
            command.copy_from_slice(&window.visible);
        };
        let mut window = window.clone();
        match &self.reachable {
            Some(reachable) if !self.masks => reachable.fill(&mut window),
            // This network was trained on whole frames.
            _ if self.granularity == MaskGranularity::State => window.complete_partial_frames(),
            _ => {}
        }
        if let Some(reachable) = &self.reachable {
            reachable.project(&mut window);
        }
        put(&window);
        if self.ahead > 0 {
            show_one(&mut self.visible[(CURRENT + 1) * s..], s, self.ahead - 1);
        }
    }
}

/// Hides all goals of each joint but one: the first visible one from frame `from` on, or else the last before it.
fn show_one(visible: &mut [bool], joints: usize, from: usize) {
    for j in 0..joints {
        let seen = |i: &usize| visible[i * joints + j];
        let one = (from..COMMAND).find(seen).or_else(|| (0..from).rev().find(seen));
        for i in (0..COMMAND).filter(|i| Some(*i) != one) {
            visible[i * joints + j] = false;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_goal_of_a_window_is_shown() {
        let shown = |goals: &[usize], ahead: usize| -> Vec<usize> {
            // The second joint has its only goal in the last frame.
            let of = |i: usize| [goals.contains(&(i + 1)), i + 1 == COMMAND];
            let mut visible: Vec<bool> = (0..COMMAND).flat_map(of).collect();
            show_one(&mut visible, 2, ahead - 1);
            let second: Vec<bool> = visible.iter().skip(1).step_by(2).copied().collect();
            assert_eq!(second.iter().position(|v| *v), Some(COMMAND - 1));
            let first = visible.iter().step_by(2).enumerate();
            first.filter_map(|(i, v)| v.then_some(i + 1)).collect()
        };
        let all: Vec<usize> = (1..=COMMAND).collect();
        assert_eq!(shown(&all, 2), [2]);
        assert_eq!(shown(&all, COMMAND), [COMMAND]);
        assert_eq!(shown(&[1, 7, 9], 2), [7]);
        assert_eq!(shown(&[1, 3], 5), [3]);
        assert!(shown(&[], 5).is_empty());
    }
}
