//! A linear prediction that was fitted before, with what it was fitted to.
//!
//! Its fit takes half a minute on a robot with forty joints, and a new robot needs the same one
//! several times: for the choice of its penalty, for the policy that is usable at once, and as the
//! skip of the network.

use super::TrainConfig;
use robert_dataset::Dataset;
use robert_net::ridge::RidgeConfig;
use robert_net::{Model, Ridge, SkipKind, Tokeniser};

/// A fitted linear prediction.
#[derive(Clone, Debug)]
pub struct FittedRidge {
    dataset_sha256: String,
    tokens: Tokeniser,
    fit: RidgeConfig,
    leave_pressing: bool,
    ridge: Ridge,
}

impl FittedRidge {
    /// `ridge` with `tokens`, fitted to this data with these settings.
    pub(super) fn new(data: &Dataset, cfg: &TrainConfig, tokens: Tokeniser, ridge: Ridge) -> Self {
        FittedRidge {
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
        Some(FittedRidge {
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

/// The settings of the linear prediction's fit.
pub(super) fn ridge_config(cfg: &TrainConfig, tokens: &Tokeniser) -> RidgeConfig {
    let usual = RidgeConfig::for_tokens(tokens);
    let lambda_per_sample = cfg.ridge_penalty.unwrap_or(usual.lambda_per_sample);
    RidgeConfig { seed: cfg.seed, lambda_per_sample, ..usual }
}
