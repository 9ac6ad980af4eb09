//! Inference in a control loop: one action per window.
//!
//! There are three options: averaging the predictions of successive windows for the same frame
//! (temporal ensembling, as in ACT by Zhao et al. 2023), an observer of disturbances, and a second thread.

use std::sync::Arc;
use std::time::Instant;

use super::adaptive_threads::AdaptiveThreads;
use super::batch::Batch;
use super::config::{COMMAND, CURRENT, NetConfig};
use super::encode::EncodeScratch;
use super::forward::{Forward, Forwards};
use super::head::{self, Choice};
use super::model::Net;
use super::observer::{self, BACK, Observer, SEEN};
use super::single::{Panels, Single};
use super::{Encoder, Error};
use robert_base::rng::{Rng, Stream};

/// Threads that share one window; the action is the same to the last bit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Threads {
    /// One.
    #[default]
    One,
    /// Two, which synchronise in every layer: faster if a second core is free, several times slower
    /// if not.
    Two,
    /// Whichever of the two has been faster recently.
    Faster,
}

/// The rule that turns the head's output into an action.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NetPolicyConfig {
    /// Draw the action bin (as in the paper) instead of using the most likely one.
    pub sample_bins: bool,
    /// Take the mean of all bins, weighted by how likely each is; not with `sample_bins`.
    pub mean_bins: bool,
    /// Seed of those draws.
    pub seed: u64,
    /// Windows whose predictions for the current frame are averaged; 1 is off, 21 at most.
    pub ensemble: usize,
    /// The prediction of j windows ago counts exp(−decay j).
    pub ensemble_decay: f64,
    /// Percent that the newest frame counts in the disturbance that is added to each action; 0 is
    /// off. See [`super::observer`].
    pub observer: u8,
    /// Threads that share one window.
    pub threads: Threads,
}

impl Default for NetPolicyConfig {
    fn default() -> Self {
        NetPolicyConfig {
            sample_bins: false,
            mean_bins: false,
            seed: 0,
            ensemble: 1,
            ensemble_decay: 0.5,
            observer: 0,
            threads: Threads::One,
        }
    }
}

/// A trained network in a control loop. Clones share weights, panels and features, so that
/// many rollouts of one network cost one packing.
#[derive(Clone, Debug)]
pub struct NetPolicy {
    cfg: NetPolicyConfig,
    net: Arc<Net<f32>>,
    encoder: Arc<Encoder>,
    scratch: EncodeScratch,
    batch: Batch<f32>,
    /// Buffers for each number of threads that may be used, fewest first.
    single: Vec<Single>,
    /// Chooses between them.
    adaptive: Arc<AdaptiveThreads>,
    /// Computes instead of them while it can.
    forward: Option<Arc<dyn Forward>>,
    action: Vec<f32>,
    /// Predictions of past windows, newest first: (ensemble, ensemble, A).
    past: Vec<f32>,
    windows: usize,
    /// Earlier actions, oldest first, up to (30, A); empty unless the network uses them.
    applied: Vec<f32>,
    observer: Option<Observer>,
    /// What the network says that the observed frame's action was, (A).
    inferred: Vec<f32>,
}

impl NetPolicy {
    /// Packs the weights for inference.
    ///
    /// # Errors
    /// [`Error::Config`] when network and encoder disagree, the ensemble is too large, the observer's
    /// percent or history does not fit, or the network sees the actions that an observer would infer.
    pub fn new(net: Net<f32>, encoder: Encoder, cfg: NetPolicyConfig) -> Result<Self, Error> {
        encoder.check(&net.cfg)?;
        if !(1..=COMMAND + 1).contains(&cfg.ensemble) {
            let why = format!("{} is not in 1..={}", cfg.ensemble, COMMAND + 1);
            return Err(Error::Config { field: "ensemble", why });
        }
        observer::check(cfg.observer, encoder.tokens.config())?;
        if cfg.observer > 0 && encoder.sees_actions() {
            let why =
                "the network sees past actions, so it has not learned to infer them".to_owned();
            return Err(Error::Config { field: "observer", why });
        }
        let e = cfg.ensemble;
        let observer = Observer::new(cfg.observer, net.cfg.actions);
        let used = CURRENT - observer.as_ref().map_or(0, |_| BACK)..CURRENT + e;
        let (panels, net) = (Arc::new(Panels::new(&net)), Arc::new(net));
        let n = &net.cfg;
        let on =
            |threads| Single::new(Arc::clone(&net), Arc::clone(&panels), used.clone(), threads);
        Ok(NetPolicy {
            scratch: encoder.scratch(),
            batch: Batch::zeros(n, 1),
            single: match cfg.threads {
                Threads::One => vec![on(1)],
                Threads::Two => vec![on(2)],
                Threads::Faster => vec![on(1), on(2)],
            },
            adaptive: Arc::default(),
            forward: None,
            action: vec![0.0; n.actions],
            past: vec![0.0; e * e * n.actions],
            windows: 0,
            applied: Vec::with_capacity(CURRENT * n.actions),
            observer,
            inferred: vec![0.0; n.actions],
            cfg,
            net,
            encoder: Arc::new(encoder),
        })
    }

    /// Sizes of the network.
    pub fn config(&self) -> &NetConfig {
        &self.net.cfg
    }

    /// Features and linear prediction.
    pub fn encoder(&self) -> &Encoder {
        &self.encoder
    }

    /// Lets a device compute, for this policy and its later clones. The last bits of actions depend on
    /// the device.
    pub fn on(&mut self, device: &dyn Forwards) {
        self.forward = device.open(&self.net);
    }

    /// Whether a device computes.
    pub fn is_on_device(&self) -> bool {
        self.forward.is_some()
    }

    /// Begins a new rollout: past windows are cleared, and random choices depend on `seed`.
    pub fn reset(&mut self, seed: u64) {
        self.windows = 0;
        self.applied.clear();
        if let Some(observer) = &mut self.observer {
            observer.reset();
        }
        self.cfg.seed = seed;
    }

    /// The state that is kept from step to step: predictions of past windows if they are averaged,
    /// earlier actions if the network uses them, and what its observer saw. It is empty for most
    /// policies.
    pub fn memory(&self) -> Vec<f64> {
        if self.cfg.ensemble == 1 && !self.encoder.sees_actions() && self.observer.is_none() {
            return Vec::new();
        }
        let all = self.past.iter().chain(&self.applied).map(|&x| f64::from(x));
        // A network has either an observer or an action history.
        let seen = self.observer.iter().flat_map(Observer::memory);
        std::iter::once(self.windows as f64).chain(all).chain(seen).collect()
    }

    /// Restores an earlier state.
    pub fn recall(&mut self, memory: &[f64]) {
        let Some((&windows, past)) = memory.split_first() else { return };
        self.windows = (windows as usize).min(self.cfg.ensemble);
        let (past, applied) = past.split_at(self.past.len().min(past.len()));
        for (to, &x) in self.past.iter_mut().zip(past) {
            *to = x as f32;
        }
        if let Some(observer) = &mut self.observer {
            observer.recall(applied);
        } else {
            self.applied.clear();
            self.applied.extend(applied.iter().map(|&x| x as f32));
        }
    }

    /// Tells the network which action was applied in the last frame, if it was not the result of
    /// [`NetPolicy::act`]; (A).
    pub fn applied(&mut self, action: &[f64]) {
        let last = self.applied.len().saturating_sub(action.len());
        for (to, &x) in self.applied[last..].iter_mut().zip(action) {
            *to = x as f32;
        }
        if let Some(observer) = &mut self.observer {
            observer.replace(action.iter().map(|&x| x as f32));
        }
    }

    /// The action to apply now, in [−1, 1]: positions `q` (51, S), visible where `visible`
    /// (51, S) says; `step` counts the frames of the rollout and names the draws.
    pub fn act(&mut self, q: &[f32], visible: &[bool], step: u64) -> &[f32] {
        let applied = &self.applied;
        self.encoder.encode(q, visible, applied, &mut self.scratch, &mut self.batch, 0);
        let (a, e, k) = (self.net.cfg.actions, self.cfg.ensemble, self.net.cfg.outputs());
        let back = self.observer.as_ref().map_or(0, |_| BACK);
        let rows = CURRENT - back..CURRENT + e;
        let computed = self.forward.as_ref().and_then(|f| f.run(&self.batch, rows));
        let out = if let Some(computed) = &computed {
            computed
        } else {
            let which = if self.single.len() > 1 { self.adaptive.choose() } else { 0 };
            let begin = Instant::now();
            let out = self.single[which].run(&self.batch);
            if self.cfg.threads == Threads::Faster {
                self.adaptive.took(which, begin.elapsed());
            }
            out
        };
        let decode = |frame: usize, choice: Choice, to: &mut [f32]| {
            let at = frame - (CURRENT - back);
            let linear = &self.batch.linear;
            head::decode(
                &self.net.cfg,
                &self.net.centres,
                &out[at * k..(at + 1) * k],
                if linear.is_empty() { &[] } else { &linear[frame * a..(frame + 1) * a] },
                choice,
                to,
            );
        };
        let settled = if self.cfg.mean_bins { Choice::Mean } else { Choice::Argmax };
        if back > 0 {
            decode(SEEN, settled, &mut self.inferred);
        }
        self.past.copy_within(..(e - 1) * e * a, e * a);
        for j in 0..e {
            let choice = if self.cfg.sample_bins {
                let index = step * (COMMAND as u64 + 1) + j as u64;
                Choice::Sample(Rng::new(self.cfg.seed, Stream::Bin, index).uniform())
            } else {
                settled
            };
            decode(CURRENT + j, choice, &mut self.past[j * a..(j + 1) * a]);
        }
        self.windows = (self.windows + 1).min(e);
        let mut total = 0.0;
        self.action.fill(0.0);
        for age in 0..self.windows {
            // The prediction of the window `age` steps ago for the frame `age` after its current
            // frame.
            let weight = (-self.cfg.ensemble_decay * age as f64).exp() as f32;
            total += weight;
            let said = &self.past[(age * e + age) * a..][..a];
            self.action.iter_mut().zip(said).for_each(|(to, x)| *to += weight * x);
        }
        self.action.iter_mut().for_each(|x| *x /= total);
        if let Some(observer) = &mut self.observer {
            observer.correct(&self.inferred, &mut self.action);
            observer.remember(self.action.iter().copied());
        }
        if self.encoder.sees_actions() {
            if self.applied.len() == CURRENT * a {
                self.applied.drain(..a);
            }
            self.applied.extend(self.action.iter().map(|x| x.clamp(-1.0, 1.0)));
        }
        &self.action
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Mixing, WINDOW};
    use crate::mask::MaskKind;
    use crate::model::{Arena, Panels as TrainPanels, forward};
    use crate::ridge::Ridge;
    use crate::token::{Facts, JointFacts, Normaliser, RIDGE_HEADS, TokenConfig, Tokeniser};
    use crate::{MaskGranularity, SkipKind};

    fn parts(bins: usize, mixing: Mixing) -> (Net<f32>, Encoder) {
        seeing(bins, mixing, false)
    }

    fn seeing(bins: usize, mixing: Mixing, previous_action: bool) -> (Net<f32>, Encoder) {
        let range = Some([-1.0, 1.0]);
        let facts = Facts { joints: vec![JointFacts { hinge: true, range }; 3], actions: 2 };
        let one = |x: f64| vec![x; 3];
        let norm = Normaliser { mean: one(0.0), std: one(0.5), std_d1: one(0.1), std_d2: one(0.1) };
        let config = TokenConfig { previous_action, ..TokenConfig::for_robot(&facts) };
        let tokens = Tokeniser::new(config, facts, &norm).unwrap();
        let encoder = Encoder::new(tokens, None).unwrap();
        let cfg = NetConfig {
            layers: 3,
            width: 32,
            heads: 4,
            inputs: encoder.inputs(),
            actions: 2,
            bins,
            offset_weight: 10.0,
            mask_replaces: false,
            skip: SkipKind::Off,
            mixing,
            dead_zone: 0.0,
        };
        let mut rng = Rng::new(1, Stream::Test, 0);
        let centres = (0..bins * 2).map(|_| 0.3 * rng.normal() as f32).collect();
        let mut net = Net::init(cfg, Some(centres), 1).unwrap();
        net.weights.iter_mut().for_each(|w| *w += 0.05 * rng.normal() as f32);
        (net, encoder)
    }

    fn window(index: u64) -> (Vec<f32>, Vec<bool>) {
        let mut rng = Rng::new(2, Stream::Test, index);
        let q =
            (0..WINDOW * 3).map(|i| (0.02 * i as f64 + 0.01 * rng.normal()).sin() as f32).collect();
        let mut visible = vec![true; WINDOW * 3];
        MaskKind::ClUniform.draw(1.0, MaskGranularity::State, 3, &mut rng, &mut visible);
        (q, visible)
    }

    /// The action of a frame of the window, computed with the training code.
    fn slow(net: &Net<f32>, encoder: &Encoder, index: u64, frame: usize) -> Vec<f32> {
        let (q, visible) = window(index);
        let mut batch = Batch::zeros(&net.cfg, 1);
        encoder.encode(&q, &visible, &[], &mut encoder.scratch(), &mut batch, 0);
        let mut arena = Arena::new(&net.cfg, 1);
        forward(net, &TrainPanels::new(net), &batch, &mut arena);
        let k = net.cfg.outputs();
        let mut action = vec![0.0; 2];
        let out = &arena.out[frame * k..][..k];
        head::decode(&net.cfg, &net.centres, out, &[], Choice::Argmax, &mut action);
        action
    }

    #[test]
    fn the_short_way_gives_the_same_action() {
        for (bins, mixing) in [(1, Mixing::Attention), (5, Mixing::Attention), (1, Mixing::None)] {
            let (net, encoder) = parts(bins, mixing);
            let mut policy =
                NetPolicy::new(net.clone(), encoder.clone(), NetPolicyConfig::default()).unwrap();
            for index in 0..5 {
                let (q, visible) = window(index);
                let got = policy.act(&q, &visible, index).to_vec();
                let want = slow(&net, &encoder, index, CURRENT);
                for (g, w) in got.iter().zip(&want) {
                    assert!((g - w).abs() < 1e-5, "{got:?} {want:?}");
                }
            }
        }
    }

    #[test]
    fn two_threads_give_the_same_bits() {
        for (bins, mixing) in [(1, Mixing::Attention), (5, Mixing::Attention), (1, Mixing::None)] {
            let (net, encoder) = parts(bins, mixing);
            let policy = |threads| {
                let cfg = NetPolicyConfig { threads, ensemble: 3, ..NetPolicyConfig::default() };
                NetPolicy::new(net.clone(), encoder.clone(), cfg)
            };
            let [mut one, mut two, mut faster] =
                [Threads::One, Threads::Two, Threads::Faster].map(|t| policy(t).unwrap());
            for index in 0..40 {
                let (q, visible) = window(index);
                let want = one.act(&q, &visible, index);
                assert_eq!(want, two.act(&q, &visible, index));
                assert_eq!(want, faster.act(&q, &visible, index));
            }
        }
    }

    #[test]
    fn an_observer_infers_the_action_of_an_earlier_frame() {
        for (bins, mixing) in [(1, Mixing::Attention), (5, Mixing::Attention), (1, Mixing::None)] {
            let (net, encoder) = parts(bins, mixing);
            let make = |observer| {
                let cfg = NetPolicyConfig { observer, ..NetPolicyConfig::default() };
                NetPolicy::new(net.clone(), encoder.clone(), cfg).unwrap()
            };
            let (mut plain, mut policy) = (make(0), make(40));
            policy.reset(0);
            let mut observer = Observer::new(40, 2).unwrap();
            let mut half = Vec::new();
            for index in 0..8 {
                if index == 5 {
                    half = policy.memory();
                }
                let (q, visible) = window(index);
                let mut want = plain.act(&q, &visible, index).to_vec();
                observer.correct(&slow(&net, &encoder, index, SEEN), &mut want);
                let got = policy.act(&q, &visible, index);
                assert!(
                    got.iter().zip(&want).all(|(g, w)| (g - w).abs() < 1e-5),
                    "{got:?} {want:?}"
                );
                // Noise is added to what the policy says.
                let noisy: Vec<f32> = got.iter().map(|x| 0.9 * x + 0.05).collect();
                policy.applied(&noisy.iter().map(|&x| f64::from(x)).collect::<Vec<_>>());
                observer.remember(noisy);
            }
            assert!(observer.memory().take(2).any(|d| d.abs() > 1e-3), "it sees something");
            // From the middle it goes on as before.
            let end = policy.memory();
            policy.recall(&half);
            for index in 5..8 {
                let (q, visible) = window(index);
                let noisy: Vec<f64> = policy
                    .act(&q, &visible, index)
                    .iter()
                    .map(|x| f64::from(0.9 * x + 0.05))
                    .collect();
                policy.applied(&noisy);
            }
            assert_eq!(policy.memory(), end);
        }
        let (net, encoder) = seeing(1, Mixing::Attention, true);
        let cfg = NetPolicyConfig { observer: 40, ..NetPolicyConfig::default() };
        let refused = NetPolicy::new(net, encoder, cfg).unwrap_err();
        assert!(refused.to_string().contains("observer"), "{refused}");
    }

    #[test]
    fn past_actions_meet_the_linear_answer_of_their_own_frame() {
        let (net, plain) = seeing(1, Mixing::Attention, true);
        let mut rng = Rng::new(2, Stream::Test, 0);
        let n = plain.tokens.ridge_inputs();
        let weights = (0..RIDGE_HEADS * n * 2).map(|_| 0.1 * rng.normal() as f32).collect();
        let ridge = Ridge::new(n, 2, weights).unwrap();
        let encoder = Encoder::new(plain.tokens, Some(ridge)).unwrap();
        let inputs = encoder.inputs();
        let cfg = NetConfig { inputs, skip: SkipKind::Additive, ..net.cfg };
        let (q, visible) = window(3);
        let given: Vec<f32> = (0..2 * CURRENT).map(|_| 0.5 * rng.normal() as f32).collect();
        for known in [0, 7, CURRENT] {
            let mut batch = Batch::<f32>::zeros(&cfg, 1);
            let applied = &given[2 * (CURRENT - known)..];
            encoder.encode(&q, &visible, applied, &mut encoder.scratch(), &mut batch, 0);
            let (mut both, mut square, mut want) = ([0.1_f32; 2], [0.1_f32; 2], [[0.0_f32; 2]; 2]);
            for i in 0..WINDOW {
                want[0] = [0.0; 2];
                for j in 0..2 {
                    if i == 0 || i > CURRENT || i <= CURRENT - known {
                        continue;
                    }
                    let (u, line) = (given[2 * (i - 1) + j], batch.linear[2 * (i - 1) + j]);
                    both[j] += u * line;
                    square[j] += line * line;
                    want[0][j] = u - line;
                    want[1][j] = (both[j] / square[j]).clamp(0.2, 5.0) - 1.0;
                }
                let got = &batch.tokens[(i + 1) * inputs - 6..(i + 1) * inputs - 2];
                let want: Vec<f32> = want.concat();
                assert!(got.iter().zip(&want).all(|(g, w)| (g - w).abs() < 1e-5), "{known} {i}");
            }
        }
    }

    #[test]
    fn actions_given_before_are_seen_and_recalled() {
        let (net, encoder) = seeing(1, Mixing::Attention, true);
        assert_eq!(encoder.inputs(), parts(1, Mixing::Attention).1.inputs() + 4);
        let mut policy =
            NetPolicy::new(net.clone(), encoder.clone(), NetPolicyConfig::default()).unwrap();
        policy.reset(0);
        let begin = policy.memory();
        let mut given: Vec<f32> = Vec::new();
        let mut half = Vec::new();
        for index in 0..40 {
            if index == 35 {
                half = policy.memory();
            }
            let (q, visible) = window(index);
            let mut batch = Batch::zeros(&net.cfg, 1);
            let last = given.len().saturating_sub(CURRENT * 2);
            encoder.encode(&q, &visible, &given[last..], &mut encoder.scratch(), &mut batch, 0);
            // Without a linear prediction frame i holds the action that led to it, and no ratio; of
            // commands nothing is known.
            let n = net.cfg.inputs;
            for i in 0..WINDOW {
                let back = CURRENT.checked_sub(i).map(|b| given.len().checked_sub(2 * (b + 1)));
                let want = back
                    .flatten()
                    .filter(|_| i > 0)
                    .map_or(&[0.0, 0.0][..], |at| &given[at..at + 2]);
                let (action, ratio) = batch.tokens[(i + 1) * n - 4..(i + 1) * n].split_at(2);
                assert_eq!((action, ratio), (want, &[0.0; 2][..]), "{index} {i}");
            }
            let mut arena = Arena::new(&net.cfg, 1);
            forward(&net, &TrainPanels::new(&net), &batch, &mut arena);
            let (k, mut want) = (net.cfg.outputs(), [0.0; 2]);
            let out = &arena.out[CURRENT * k..][..k];
            head::decode(&net.cfg, &net.centres, out, &[], Choice::Argmax, &mut want);
            let got = policy.act(&q, &visible, index).to_vec();
            assert!(got.iter().zip(&want).all(|(g, w)| (g - w).abs() < 1e-5), "{got:?} {want:?}");
            given.extend(got);
        }
        let again = |policy: &mut NetPolicy, memory: &[f64], from: usize| {
            policy.recall(memory);
            let all = (from as u64..40).flat_map(|index| {
                let (q, visible) = window(index);
                policy.act(&q, &visible, index).to_vec()
            });
            assert_eq!(all.collect::<Vec<_>>(), given[2 * from..]);
        };
        again(&mut policy, &half, 35);
        again(&mut policy, &begin, 0);
    }

    #[test]
    fn ensembles_average_what_was_said_of_one_frame() {
        let (net, encoder) = parts(1, Mixing::Attention);
        let cfg =
            NetPolicyConfig { ensemble: 3, ensemble_decay: 0.7, ..NetPolicyConfig::default() };
        let mut policy = NetPolicy::new(net.clone(), encoder.clone(), cfg).unwrap();
        let mut got = Vec::new();
        for index in 0..4 {
            let (q, visible) = window(index);
            got = policy.act(&q, &visible, index).to_vec();
        }
        let weights: Vec<f32> = (0..3).map(|j| (-0.7 * j as f32).exp()).collect();
        let said: Vec<_> =
            (0..3).map(|j| slow(&net, &encoder, 3 - j as u64, CURRENT + j)).collect();
        for i in 0..2 {
            let want: f32 = said.iter().zip(&weights).map(|(s, w)| s[i] * w).sum::<f32>()
                / weights.iter().sum::<f32>();
            assert!((got[i] - want).abs() < 1e-5);
        }
    }

    #[test]
    fn bins_are_drawn_by_seed_and_step() {
        let (net, encoder) = parts(5, Mixing::Attention);
        let run = |seed| {
            let cfg = NetPolicyConfig { sample_bins: true, seed, ..NetPolicyConfig::default() };
            let mut policy = NetPolicy::new(net.clone(), encoder.clone(), cfg).unwrap();
            let (q, visible) = window(0);
            (0..20).map(|s| policy.act(&q, &visible, s).to_vec()).collect::<Vec<_>>()
        };
        assert_eq!(run(1), run(1));
        assert_ne!(run(1), run(2));
        assert!(run(1).windows(2).any(|w| w[0] != w[1]));
    }
}
