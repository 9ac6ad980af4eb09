//! Encodes a window into a slot of a batch: tokens, masks, linear predictions, actions.

use super::action_history::ActionHistory;
use super::batch::Batch;
use super::config::{CURRENT, WINDOW};
use super::ridge::Ridge;
use super::token::{Scratch, Tokeniser};
use super::{Error, NetConfig, SkipKind};
use robert_linalg::Real;

/// Turns frames into network inputs. Threads share it, each with an [`EncodeScratch`].
#[derive(Clone, Debug)]
pub struct Encoder {
    /// Features.
    pub tokens: Tokeniser,
    /// The linear prediction, when the network has a skip.
    pub ridge: Option<Ridge>,
}

/// Memory for one thread.
#[derive(Clone, Debug)]
pub struct EncodeScratch {
    window: Scratch,
    token: Vec<f32>,
    features: Vec<f32>,
    linear: Vec<f32>,
    history: ActionHistory,
}

impl Encoder {
    /// Pairs features with the linear prediction.
    ///
    /// # Errors
    /// [`Error::Shape`] when the fit belongs to other features.
    pub fn new(tokens: Tokeniser, ridge: Option<Ridge>) -> Result<Self, Error> {
        if let Some(ridge) = &ridge {
            let want = super::token::RIDGE_HEADS * tokens.ridge_inputs() * tokens.facts().actions;
            if ridge.weights().len() != want {
                return Err(Error::Shape {
                    what: "ridge weights",
                    want,
                    got: ridge.weights().len(),
                });
            }
        }
        Ok(Encoder { tokens, ridge })
    }

    /// Inputs of a network behind this encoder.
    pub fn inputs(&self) -> usize {
        // The linear prediction, the distance of the last action from it, and the ratio of both.
        let per_action =
            usize::from(self.ridge.is_some()) + if self.sees_actions() { 2 } else { 0 };
        self.tokens.inputs() + per_action * self.tokens.facts().actions
    }

    /// Whether tokens contain the action history.
    pub fn sees_actions(&self) -> bool {
        self.tokens.config().previous_action
    }

    /// Refuses a network that does not fit.
    ///
    /// # Errors
    /// [`Error::Config`].
    pub fn check(&self, cfg: &NetConfig) -> Result<(), Error> {
        let refuse = |field, why: String| Err(Error::Config { field, why });
        if cfg.inputs != self.inputs() {
            return refuse("inputs", format!("{} for {} features", cfg.inputs, self.inputs()));
        }
        if cfg.actions != self.tokens.facts().actions {
            let want = self.tokens.facts().actions;
            return refuse("actions", format!("{} for a robot with {want}", cfg.actions));
        }
        if cfg.mask_replaces != self.tokens.mask_replaces() {
            return refuse("mask_replaces", "does not fit the token variant".into());
        }
        if (cfg.skip != SkipKind::Off) != self.ridge.is_some() {
            return refuse("skip", "needs a fitted linear prediction, and only then".into());
        }
        Ok(())
    }

    /// Memory for one thread.
    pub fn scratch(&self) -> EncodeScratch {
        EncodeScratch {
            window: self.tokens.scratch(),
            token: vec![0.0; self.tokens.inputs()],
            features: Vec::new(),
            linear: vec![0.0; WINDOW * self.tokens.facts().actions],
            history: ActionHistory::new(self.tokens.facts().actions),
        }
    }

    /// Encodes positions `q` (51, S), visible where `visible` (51, S) says, into `slot`.
    /// The caller fills actions and weights of the slot.
    ///
    /// `applied` contains the last actions before the current frame, oldest first, (n, A) with n up
    /// to 30; only networks with an action history read it. For frames whose action is not known,
    /// at the beginning of a rollout, the linear prediction counts as the applied action.
    pub fn encode<T: Real>(
        &self,
        q: &[f32],
        visible: &[bool],
        applied: &[f32],
        scratch: &mut EncodeScratch,
        batch: &mut Batch<T>,
        slot: usize,
    ) {
        let (f, all, a) = (self.tokens.inputs(), self.inputs(), self.tokens.facts().actions);
        self.tokens.read(q, visible, &mut scratch.window);
        if let Some(ridge) = &self.ridge {
            let EncodeScratch { window, features, linear, .. } = &mut *scratch;
            ridge.answers(&self.tokens, window, 0..WINDOW, features, linear);
            let to = &mut batch.linear[slot * WINDOW * a..(slot + 1) * WINDOW * a];
            to.iter_mut().zip(&*linear).for_each(|(to, &x)| *to = T::of(f64::from(x)));
        }
        scratch.history.clear();
        for i in 0..WINDOW {
            let row = slot * WINDOW + i;
            batch.masked[row] = self.tokens.masked(&scratch.window, i);
            self.tokens.token(&scratch.window, visible, i, &mut scratch.token);
            let (own, line) = batch.tokens[row * all..(row + 1) * all].split_at_mut(f);
            own.iter_mut().zip(&scratch.token).for_each(|(to, &x)| *to = T::of(f64::from(x)));
            let put = |to: &mut [T], from: &[f32]| {
                to.iter_mut().zip(from).for_each(|(to, &x)| *to = T::of(f64::from(x)));
            };
            let mut line = line;
            if self.sees_actions() {
                let (residual, gain);
                (residual, line) = line.split_at_mut(a);
                (gain, line) = line.split_at_mut(a);
                let EncodeScratch { history, linear, .. } = &mut *scratch;
                // Frames from here to the current one; the previous action led to this frame.
                let left = CURRENT.checked_sub(i).filter(|_| i > 0);
                match left.and_then(|left| (applied.len() / a).checked_sub(left + 1)) {
                    Some(n) => history.see(&applied[n * a..][..a], &linear[(i - 1) * a..]),
                    None => history.miss(),
                }
                put(residual, scratch.history.residual());
                put(gain, scratch.history.gain());
            }
            put(line, &scratch.linear[i * a..]);
        }
    }
}
