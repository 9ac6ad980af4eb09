//! Prepares a network for training from a dataset and settings: normaliser, linear fit and action
//! centres, all from the training split alone.

use super::fitted_ridge::{FittedRidge, ridge_config};
use super::pressing::Pressing;
use super::{Error, SlideUnit, TrainConfig};
use robert_base::json;
use robert_base::progress::Cancel;
use robert_dataset::{Dataset, Part};
use robert_net::checkpoint::{TrainingCard, Usual};
use robert_net::kmeans::kmeans;
use robert_net::reach::Reach;
use robert_net::{Card, Encoder, Episodes, Net, Normaliser, Ridge, SkipKind, Tokeniser};
pub use robert_rollout::{card_of as robot_card, facts, normaliser};

/// The most actions to which the bins are fitted.
const ACTIONS: usize = 400_000;

/// One side of the split, as input of the fits.
#[derive(Debug)]
pub struct Side<'a> {
    data: &'a Dataset,
    episodes: Vec<usize>,
    /// Frames that count as contact too.
    pressing: Option<Pressing>,
}

impl<'a> Side<'a> {
    /// Trajectories of one part.
    pub fn new(data: &'a Dataset, part: Part, seed: u64) -> Self {
        Side { data, episodes: data.part(part, seed), pressing: None }
    }

    /// The trajectories that these settings train on, and what counts as contact.
    pub(super) fn of(data: &'a Dataset, cfg: &TrainConfig) -> Self {
        let pressing = cfg.leave_pressing.then(|| Pressing::find(data, cfg.seed));
        Side { pressing, ..Side::new(data, Part::Train, cfg.seed) }
    }

    /// The same with these frames as contact.
    pub(super) fn without(self, pressing: Pressing) -> Self {
        Side { pressing: Some(pressing), ..self }
    }

    fn frames(&self, episode: usize) -> (&'a [f32], &'a [f32]) {
        let at = self.episodes.get(episode).and_then(|&i| self.data.episodes().get(i));
        at.map_or((&[], &[]), |e| {
            let (q, _, a) = self.data.frames(e);
            (q, a)
        })
    }
}

impl Episodes for Side<'_> {
    fn count(&self) -> usize {
        self.episodes.len()
    }
    fn states(&self, episode: usize) -> &[f32] {
        self.frames(episode).0
    }
    fn actions(&self, episode: usize) -> &[f32] {
        self.frames(episode).1
    }
    fn in_contact(&self, episode: usize, frame: usize) -> bool {
        let Some(&at) = self.episodes.get(episode) else { return false };
        let seen = self.data.episodes().get(at).map(|e| self.data.self_contact(e));
        seen.and_then(|flags| flags.get(frame)).is_some_and(|&c| c != 0)
            || self.pressing.as_ref().is_some_and(|pressing| pressing.at(at, frame))
    }
}

/// A fresh network for this data, its features and its card. `linear` replaces the fit of the linear
/// prediction where it is the same.
///
/// # Errors
/// [`Error::Net`].
pub fn prepare(
    data: &Dataset,
    cfg: &TrainConfig,
    linear: Option<&FittedRidge>,
    threads: usize,
    cancel: &Cancel,
) -> Result<(Card, Net<f32>, Encoder), Error> {
    let train = Side::of(data, cfg);
    let ridge = if cfg.skip == SkipKind::Off {
        None
    } else {
        let tokens = tokeniser(data, cfg)?;
        Some(match linear.and_then(|linear| linear.suiting(data, cfg, &tokens)) {
            Some(same) => same,
            None => Ridge::fit(&tokens, &train, &ridge_config(cfg, &tokens), threads, cancel)?,
        })
    };
    assemble(&train, cfg, ridge, threads)
}

/// The features for this data.
///
/// # Errors
/// [`Error::Net`].
pub(super) fn tokeniser(data: &Dataset, cfg: &TrainConfig) -> Result<Tokeniser, Error> {
    let facts = facts(&data.manifest().robot);
    Ok(Tokeniser::new(cfg.token_config(&facts), facts, &network_normaliser(data, cfg))?)
}

/// Mean and spread of positions as the tokens see them.
fn network_normaliser(data: &Dataset, cfg: &TrainConfig) -> Normaliser {
    let (mut norm, _) = normaliser(data, cfg.seed);
    if cfg.slide_unit == SlideUnit::Motion {
        norm.centre_floating(&facts(&data.manifest().robot).joints);
    }
    norm
}

/// As [`prepare`], for the training part of data and with a linear prediction that is fitted already.
///
/// # Errors
/// [`Error::Net`].
pub(super) fn assemble(
    train: &Side<'_>,
    cfg: &TrainConfig,
    ridge: Option<Ridge>,
    threads: usize,
) -> Result<(Card, Net<f32>, Encoder), Error> {
    let data = train.data;
    let robot = &data.manifest().robot;
    let norm = network_normaliser(data, cfg);
    let tokens = tokeniser(data, cfg)?;
    let encoder = Encoder::new(tokens, ridge)?;
    let actions = encoder.tokens.facts().actions;
    let net_cfg = cfg.net_config(encoder.inputs(), actions, encoder.tokens.mask_replaces());
    net_cfg.check()?;
    // The skip already contains the mean; without one, the bins are around it.
    let centres = (cfg.skip == SkipKind::Off).then(|| {
        let total: usize = (0..train.count()).map(|e| train.actions(e).len() / actions).sum();
        let stride = total.div_ceil(ACTIONS).max(1);
        let mut points = Vec::with_capacity(total.min(ACTIONS) * actions);
        let mut index = 0;
        for e in 0..train.count() {
            for row in train.actions(e).chunks_exact(actions) {
                if index % stride == 0 {
                    points.extend_from_slice(row);
                }
                index += 1;
            }
        }
        kmeans(&points, actions, cfg.bins, cfg.seed, threads)
    });
    let net = Net::init(net_cfg.clone(), centres, cfg.seed)?;
    let training = TrainingCard {
        dataset_sha256: data.manifest().sha256(),
        agents: data.manifest().statistics.agents.clone(),
        config: json::value(cfg),
        seed: cfg.seed,
        ..TrainingCard::default()
    };
    let mut card = Card::new(robot_card(robot), net_cfg, &encoder.tokens, norm, training);
    let usual = robert_dataset::usual(data, &data.part(Part::Train, cfg.seed));
    card.usual = usual.into_iter().map(|[low, high, speed]| Usual { low, high, speed }).collect();
    card.observer = cfg.observer;
    if cfg.reach {
        card.reach = Some(Reach::fit(&card.facts, train, cfg.seed)?);
    }
    Ok((card, net, encoder))
}
