//! Chooses the penalty of the linear prediction in closed loop.
//!
//! The linear map that fits recorded motion best may have so much gain that it oscillates on a
//! robot with light joints behind heavy ones: it answers every error with the torque that would
//! remove it within one frame. A larger penalty lowers the gain. Only simulation shows which
//! penalty is best, so the candidates perform the evaluator's clips.

use super::prepare::{Side, assemble, ridge_config, tokeniser};
use super::{Error, Evaluate, TrainConfig};
use robert_base::progress::Cancel;
use robert_dataset::{Dataset, Part};
use robert_net::encode::Encoder;
use robert_net::ridge::Ridge;
use robert_net::{Model, SkipKind};

/// Penalties per sample that are tried besides the usual one.
const CANDIDATES: [f64; 3] = [1e-3, 1e-2, 5e-2];
/// Another penalty is chosen if its error is below this share of the usual one's.
const WORTH: f64 = 0.9;

/// The best penalty per sample; `None` if the usual one is best, or without a linear prediction.
///
/// # Errors
/// [`Error::Net`]; [`Error::Evaluation`] with the evaluator's message.
pub fn choose(
    data: &Dataset,
    cfg: &TrainConfig,
    threads: usize,
    evaluator: &mut dyn Evaluate,
    cancel: &Cancel,
) -> Result<Option<f64>, Error> {
    if cfg.skip == SkipKind::Off {
        return Ok(None);
    }
    let tokens = tokeniser(data, cfg)?;
    let fit = ridge_config(cfg, &tokens);
    let train = Side::new(data, Part::Train, cfg.seed);
    let [a, b, c] = CANDIDATES;
    let penalties = [fit.lambda_per_sample, a, b, c];
    let mut ridges = Ridge::fit_each(&tokens, &train, &fit, &penalties, threads, cancel)?;
    let others = ridges.split_off(1);
    let (card, net, encoder) = assemble(data, cfg, ridges.pop(), threads)?;
    let mut model = Model { card, net, encoder, optimiser: None };
    let mut error = |model: &Model| -> Result<f64, Error> {
        let found = evaluator
            .evaluate_linear(model, cancel)
            .map_err(|why| Error::Evaluation { step: 0, why })?;
        // Without its errors there is no choice.
        if cancel.is_cancelled() {
            return Err(robert_net::Error::Stopped.into());
        }
        Ok(found.map_or(f64::INFINITY, |e| e.precision))
    };
    let mut best = (None, WORTH * error(&model)?);
    for (penalty, ridge) in CANDIDATES.into_iter().zip(others) {
        model.encoder = Encoder::new(model.encoder.tokens, Some(ridge))?;
        let precision = error(&model)?;
        if precision < best.1 {
            best = (Some(penalty), precision);
        }
    }
    Ok(best.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Evaluation;
    use crate::tests::untrained;
    use std::collections::BTreeMap;

    /// Likes small weights, or does not.
    struct Judge {
        likes_small: bool,
        seen: Vec<f64>,
    }

    /// Is stopped at the first question.
    struct Stopper;

    impl Evaluate for Stopper {
        fn evaluate(&mut self, _: &Model, cancel: &Cancel) -> Result<Option<Evaluation>, String> {
            cancel.cancel();
            Ok(None)
        }
    }

    impl Evaluate for Judge {
        fn evaluate(&mut self, _: &Model, _: &Cancel) -> Result<Option<Evaluation>, String> {
            Err("only the linear prediction is asked about".to_owned())
        }

        fn evaluate_linear(
            &mut self,
            model: &Model,
            _: &Cancel,
        ) -> Result<Option<Evaluation>, String> {
            let ridge = model.encoder.ridge.as_ref().ok_or("no linear prediction")?;
            let size: f64 = ridge.weights().iter().map(|w| f64::from(w.abs())).sum();
            self.seen.push(size);
            let precision = if self.likes_small { size } else { 1.0 / size };
            Ok(Some(Evaluation { precision, suites: BTreeMap::new() }))
        }
    }

    #[test]
    fn a_larger_penalty_is_taken_only_where_it_pays() {
        let dir = tempfile::tempdir().unwrap();
        let (_, data, _) = untrained("pointmass", 0, dir.path());
        let cfg = TrainConfig::preset("instant").unwrap();
        for likes_small in [true, false] {
            let mut judge = Judge { likes_small, seen: Vec::new() };
            let found = choose(&data, &cfg, 2, &mut judge, &Cancel::default()).unwrap();
            assert!(judge.seen.windows(2).all(|w| w[1] < w[0]), "{:?}", judge.seen);
            assert_eq!(found, likes_small.then_some(CANDIDATES[2]));
        }
        let stopped = choose(&data, &cfg, 2, &mut Stopper, &Cancel::default());
        assert!(matches!(stopped, Err(Error::Net(robert_net::Error::Stopped))), "{stopped:?}");
    }
}
