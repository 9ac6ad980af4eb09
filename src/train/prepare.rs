//! From a dataset and settings to a network that can be trained: normaliser, linear fit,
//! action centres, all from the train split alone.

use super::{Error, TrainConfig};
use crate::dataset::{self, Dataset, Part};
use crate::net::checkpoint::{RobotCard, TrainingCard};
use crate::net::kmeans::kmeans;
use crate::net::ridge::RidgeConfig;
use crate::net::{
    Card, Encoder, Episodes, Facts, JointFacts, Net, Normaliser, Ridge, SkipKind, Tokeniser,
};
use crate::units::Unit;

/// Actions that the bins are fitted to, at most.
const ACTIONS: usize = 400_000;

/// One side of the split, as the fits read it.
#[derive(Debug)]
pub struct Side<'a> {
    data: &'a Dataset,
    episodes: Vec<usize>,
}

impl<'a> Side<'a> {
    /// Trajectories of one part.
    pub fn new(data: &'a Dataset, part: Part, seed: u64) -> Self {
        Side { data, episodes: data.part(part, seed) }
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
}

/// What the features need to know of the robot in a dataset.
pub fn facts(robot: &dataset::Robot) -> Facts {
    let joints = robot.units.iter().zip(&robot.ranges);
    Facts {
        joints: joints
            .map(|(&unit, &range)| JointFacts { hinge: unit == Unit::Rad, range })
            .collect(),
        actions: robot.actuators.len(),
    }
}

/// The robot of a dataset as a model card names it.
pub fn robot_card(robot: &dataset::Robot) -> RobotCard {
    RobotCard {
        id: robot.id.clone(),
        model_sha256: robot.model_sha256.clone(),
        joints: robot.joints.clone(),
        actuators: robot.actuators.clone(),
    }
}

/// The normaliser of the train split in the network's words.
pub fn normaliser(data: &Dataset, seed: u64) -> (Normaliser, f64) {
    let n = dataset::Normaliser::fit(data, &data.part(Part::Train, seed));
    let floor = |x: &[f64], least: f64| x.iter().map(|x| x.max(least)).collect();
    // A joint that never moves in the data must not blow up when it moves later.
    let norm = Normaliser {
        mean: n.qpos.mean,
        std: floor(&n.qpos.std, 1e-3),
        std_d1: floor(&n.d1.std, 1e-5),
        std_d2: floor(&n.d2.std, 1e-6),
    };
    let power = n.ctrl.std.iter().map(|s| s * s).sum::<f64>() / n.ctrl.std.len().max(1) as f64;
    (norm, power)
}

/// A fresh network for this data, its features and its card.
///
/// # Errors
/// [`Error::Net`].
pub fn prepare(
    data: &Dataset,
    cfg: &TrainConfig,
    threads: usize,
) -> Result<(Card, Net<f32>, Encoder), Error> {
    let robot = &data.manifest().robot;
    let facts = facts(robot);
    let (norm, _) = normaliser(data, cfg.seed);
    let tokens = Tokeniser::new(cfg.token_config(&facts), facts, &norm)?;
    let train = Side::new(data, Part::Train, cfg.seed);
    let ridge = if cfg.skip == SkipKind::Off {
        None
    } else {
        let fit = RidgeConfig { seed: cfg.seed, ..RidgeConfig::for_tokens(&tokens) };
        Some(Ridge::fit(&tokens, &train, &fit, threads)?)
    };
    let encoder = Encoder::new(tokens, ridge)?;
    let actions = encoder.tokens.facts().actions;
    let net_cfg = cfg.net_config(encoder.inputs(), actions, encoder.tokens.mask_replaces());
    net_cfg.check()?;
    // The skip already holds the mean; without one, bins sit around it.
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
        config: serde_json::to_value(cfg).unwrap_or_default(),
        seed: cfg.seed,
        ..TrainingCard::default()
    };
    let card = Card::new(robot_card(robot), net_cfg, &encoder.tokens, norm, training);
    Ok((card, net, encoder))
}
