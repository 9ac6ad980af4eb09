//! A linear prediction that was fitted before, with what it was fitted to.
//!
//! Its fit takes half a minute on a robot with forty joints, and a new robot needs the same one
//! several times: for the choice of its penalty, for the policy that is usable at once, and as the
//! skip of the network.

use super::TrainConfig;
use super::prepare::ridge_config;
use robert_dataset::Dataset;
use robert_net::ridge::RidgeConfig;
use robert_net::{Model, Ridge, SkipKind, Tokeniser};

/// A fitted linear prediction.
#[derive(Clone, Debug)]
pub struct Linear {
    dataset_sha256: String,
    tokens: Tokeniser,
    fit: RidgeConfig,
    leave_pressing: bool,
    ridge: Ridge,
}

impl Linear {
    /// `ridge` with `tokens`, fitted to this data with these settings.
    pub(super) fn new(data: &Dataset, cfg: &TrainConfig, tokens: Tokeniser, ridge: Ridge) -> Self {
        Linear {
            dataset_sha256: data.manifest().sha256(),
            fit: ridge_config(cfg, &tokens),
            leave_pressing: cfg.leave_pressing,
            tokens,
            ridge,
        }
    }

    /// The linear prediction of a model; `None` if it has none, or settings of another version.
    pub fn of(model: Model) -> Option<Self> {
        let training = model.card.training;
        let cfg: TrainConfig = serde_json::from_value(training.config).ok()?;
        Some(Linear {
            dataset_sha256: training.dataset_sha256,
            fit: ridge_config(&cfg, &model.encoder.tokens),
            leave_pressing: cfg.leave_pressing,
            tokens: model.encoder.tokens,
            ridge: model.encoder.ridge?,
        })
    }

    /// The prediction, if a fit to this data with these settings would give the same.
    pub(super) fn suiting(
        &self,
        data: &Dataset,
        cfg: &TrainConfig,
        tokens: &Tokeniser,
    ) -> Option<Ridge> {
        let same = cfg.skip != SkipKind::Off
            && self.leave_pressing == cfg.leave_pressing
            && self.fit == ridge_config(cfg, tokens)
            && self.tokens.same_ridge_features(tokens)
            && self.dataset_sha256 == data.manifest().sha256();
        same.then(|| self.ridge.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::{prepare, tokeniser};
    use crate::tests::{options, small, untrained};
    use crate::{paths, train};
    use robert_base::progress::{Cancel, Silent};
    use robert_net::checkpoint;

    #[test]
    fn a_fit_is_taken_over_only_where_it_is_the_same() {
        let dir = tempfile::tempdir().unwrap();
        let (_, data, _) = untrained("pointmass", 0, dir.path());
        let (cfg, cancel) = (small(2), Cancel::default());
        let run = dir.path().join("run");
        train(&data, &cfg, options(&run, 2, &cancel, &Silent)).unwrap();
        let model = checkpoint::load(&paths::last(&run), None).unwrap();
        let weights = model.encoder.ridge.as_ref().unwrap().weights().to_vec();
        let linear = Linear::of(model).unwrap();
        let of = |cfg: &TrainConfig| linear.suiting(&data, cfg, &tokeniser(&data, cfg).unwrap());
        assert_eq!(of(&cfg).unwrap().weights(), weights);
        // The network may be another one; the fit may not.
        assert!(of(&TrainConfig { layers: 1, steps: 9, lr: 1e-4, ..cfg.clone() }).is_some());
        for other in [
            TrainConfig { seed: 1, ..cfg.clone() },
            TrainConfig { ridge_penalty: Some(0.1), ..cfg.clone() },
            TrainConfig { ridge_history: 5, ..cfg.clone() },
            TrainConfig { leave_pressing: true, ..cfg.clone() },
            TrainConfig { skip: SkipKind::Off, ..cfg.clone() },
        ] {
            assert!(of(&other).is_none(), "{other:?}");
        }
        // A prepared network has the weights that were handed over, bit by bit.
        let changed: Vec<f32> = weights.iter().map(|w| 2.0 * w).collect();
        let (inputs, actions) = (linear.tokens.ridge_inputs(), linear.tokens.facts().actions);
        let changed = Ridge::new(inputs, actions, changed).unwrap();
        let given = Linear { ridge: changed.clone(), ..linear };
        let (_, _, encoder) = prepare(&data, &cfg, Some(&given), 2, &cancel).unwrap();
        assert_eq!(encoder.ridge.unwrap().weights(), changed.weights());
    }
}
