//! Chooses the penalty of the linear prediction in closed loop, the frames that it learns from, and
//! whether it observes disturbances.
//!
//! The linear map that fits recorded motion best may have so much gain that it oscillates on a
//! robot with light joints behind heavy ones: it answers every error with the torque that would
//! remove it within one frame. A larger penalty lowers the gain. Frames that press instead of moving
//! spoil the map on some robots, and on others they are merely fast. An observer removes what stays
//! of an error while the robot holds still, but may make light joints oscillate. Only simulation shows
//! what is best, so the candidates perform the evaluator's clips.

use super::fitted_ridge::{FittedRidge, ridge_config};
use super::prepare::{Side, assemble, tokeniser};
use super::pressing::Pressing;
use super::{Error, Evaluate, TrainConfig};
use robert_base::progress::{Cancel, Progress};
use robert_dataset::{Dataset, Part};
use robert_net::encode::Encoder;
use robert_net::ridge::Ridge;
use robert_net::{Model, SkipKind};

/// Penalties per sample that are tried besides the usual one.
const CANDIDATES: [f64; 4] = [1e-6, 1e-3, 1e-2, 5e-2];
/// Percent that the newest frame counts in the observed disturbance: tried with each penalty, and
/// then with the best one.
const OBSERVER: u8 = 30;
const OTHER_OBSERVERS: [u8; 2] = [10, 50];
/// Another fit is chosen if its error is below this share of the usual one's, and an observer if it is
/// below this share of that without one.
const WORTH: f64 = 0.9;
/// The parts of the progress that a fit of all candidates counts as: performing all clips twice is one.
const FIT: usize = 1;
/// The share of frames that press from which fits without them are tried.
const SEVERAL: f64 = 0.01;

/// Settings of the linear prediction that differ from the usual ones.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Choice {
    /// Penalty per sample; `None` is the usual one.
    ridge_penalty: Option<f64>,
    /// Whether frames that press are left out.
    leave_pressing: bool,
    /// See [`robert_net::observer`].
    observer: u8,
}

impl Choice {
    /// Settings with this choice.
    fn on(self, cfg: TrainConfig) -> TrainConfig {
        let Choice { ridge_penalty, leave_pressing, observer } = self;
        TrainConfig { ridge_penalty, leave_pressing, observer, ..cfg }
    }

    /// What is compared for this error: a candidate that is not the usual one has to be worth it.
    fn score(self, error: f64) -> f64 {
        let fit = Choice { observer: 0, ..self };
        let usual = if fit == Choice::default() { WORTH } else { 1.0 };
        usual * if self.observer == 0 { error } else { error / WORTH }
    }
}

/// The error of the linear prediction of `model` with this observer on the evaluator's clips.
fn error(
    model: &mut Model,
    observer: u8,
    evaluator: &mut dyn Evaluate,
    cancel: &Cancel,
) -> Result<f64, Error> {
    model.card.observer = observer;
    let found = evaluator
        .evaluate_linear(model, cancel)
        .map_err(|why| Error::Evaluation { step: 0, why })?;
    // Without its errors there is no choice.
    if cancel.is_cancelled() {
        return Err(robert_net::Error::Stopped.into());
    }
    Ok(found.map_or(f64::INFINITY, |e| e.precision))
}

/// `cfg` with the best choice, and the linear prediction that was fitted with it; `None` for settings
/// without one.
///
/// # Errors
/// [`Error::Net`]; [`Error::Evaluation`] with the evaluator's message.
pub fn choose(
    data: &Dataset,
    cfg: &TrainConfig,
    threads: usize,
    evaluator: &mut dyn Evaluate,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<(TrainConfig, Option<FittedRidge>), Error> {
    if cfg.skip == SkipKind::Off {
        return Ok((cfg.clone(), None));
    }
    let tokens = tokeniser(data, cfg)?;
    let fit = ridge_config(cfg, &tokens);
    let penalties: Vec<f64> = [fit.lambda_per_sample].into_iter().chain(CANDIDATES).collect();
    let mut sides = vec![(Side::new(data, Part::Train, cfg.seed), false)];
    let pressing = Pressing::find(data, cfg.seed);
    if pressing.share() >= SEVERAL {
        sides.push((Side::new(data, Part::Train, cfg.seed).without(pressing), true));
    }
    let mut best: Option<(Choice, f64, Model)> = None;
    // A fit of all candidates takes about as long as performing the clips with one of them.
    let (mut done, total) = (0, (sides.len() * (FIT + penalties.len()) + 1) as u64);
    for (side, leave_pressing) in sides {
        progress.tick(
            done,
            total,
            if leave_pressing { "without frames that press" } else { "all frames" },
        );
        done += FIT as u64;
        let ridges = Ridge::fit_each(&tokens, &side, &fit, &penalties, threads, cancel)?;
        // Without frames that press, the reach is another one, too.
        let (card, net, encoder) = assemble(&side, cfg, None, threads)?;
        let mut model = Model { card, net, encoder, optimiser: None };
        let penalties = [None].into_iter().chain(CANDIDATES.map(Some));
        for (ridge_penalty, ridge) in penalties.zip(ridges) {
            progress.tick(
                done,
                total,
                &format!("penalty {}", ridge_penalty.unwrap_or(fit.lambda_per_sample)),
            );
            done += 1;
            model.encoder = Encoder::new(model.encoder.tokens, Some(ridge))?;
            for observer in [0, OBSERVER] {
                let choice = Choice { ridge_penalty, leave_pressing, observer };
                let score = choice.score(error(&mut model, observer, evaluator, cancel)?);
                if best.as_ref().is_none_or(|best| score < best.1) {
                    best = Some((choice, score, model.clone()));
                }
            }
        }
    }
    let Some((mut choice, mut least, mut model)) = best else {
        unreachable!("at least the usual penalty was tried");
    };
    progress.tick(done, total, "observer");
    for observer in OTHER_OBSERVERS {
        let other = Choice { observer, ..choice };
        let score = other.score(error(&mut model, observer, evaluator, cancel)?);
        if score < least {
            (choice, least) = (other, score);
        }
    }
    let cfg = choice.on(cfg.clone());
    let linear = model.encoder.ridge.map(|ridge| FittedRidge::new(data, &cfg, tokens, ridge));
    Ok((cfg, linear))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Evaluation;
    use crate::prepare::prepare;
    use crate::tests::untrained;
    use robert_base::progress::Silent;
    use robert_net::reach::Reach;
    use std::collections::BTreeMap;

    /// Likes small weights, or does not.
    struct Judge {
        likes_small: bool,
        seen: Vec<f64>,
        reaches: Vec<Option<Reach>>,
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
            self.reaches.push(model.card.reach.clone());
            let precision = if self.likes_small { size } else { 1.0 / size };
            Ok(Some(Evaluation { precision, suites: BTreeMap::new() }))
        }
    }

    /// Likes small weights, and an observer of this weight best.
    struct Watcher(u8);

    impl Evaluate for Watcher {
        fn evaluate(&mut self, model: &Model, _: &Cancel) -> Result<Option<Evaluation>, String> {
            let ridge = model.encoder.ridge.as_ref().ok_or("no linear prediction")?;
            let size: f64 = ridge.weights().iter().map(|w| f64::from(w.abs())).sum();
            let precision = size * (1.0 + f64::from(model.card.observer.abs_diff(self.0)) / 25.0);
            Ok(Some(Evaluation { precision, suites: BTreeMap::new() }))
        }

        fn evaluate_linear(
            &mut self,
            model: &Model,
            cancel: &Cancel,
        ) -> Result<Option<Evaluation>, String> {
            self.evaluate(model, cancel)
        }
    }

    #[test]
    fn an_observer_is_taken_where_it_pays() {
        let dir = tempfile::tempdir().unwrap();
        let (_, data, _) = untrained("pointmass", 0, dir.path());
        let cfg = TrainConfig::preset("instant").unwrap();
        for best in [10, 30, 50] {
            let (found, linear) =
                choose(&data, &cfg, 2, &mut Watcher(best), &Silent, &Cancel::default()).unwrap();
            let ridge_penalty = Some(CANDIDATES[3]);
            let want = TrainConfig { observer: best, ridge_penalty, ..cfg.clone() };
            assert_eq!(found, want);
            // It is in the card of every model that is made with it.
            let (card, ..) =
                prepare(&data, &found, linear.as_ref(), 2, &Cancel::default()).unwrap();
            assert_eq!(card.observer, best);
        }
        // A gain of less than a tenth is none.
        let choice = |observer| Choice { observer, ..Choice::default() };
        assert!(choice(30).score(0.95) > choice(0).score(1.0));
        assert!(choice(30).score(0.89) < choice(0).score(1.0));
    }

    #[test]
    fn a_larger_penalty_is_taken_only_where_it_pays() {
        let dir = tempfile::tempdir().unwrap();
        let (_, data, _) = untrained("pointmass", 0, dir.path());
        let cfg = TrainConfig::preset("instant").unwrap();
        for likes_small in [true, false] {
            let mut judge = Judge { likes_small, seen: Vec::new(), reaches: Vec::new() };
            let (found, linear) =
                choose(&data, &cfg, 2, &mut judge, &Silent, &Cancel::default()).unwrap();
            // With all frames, then without those at the walls; each without and with an observer. At
            // last other observers with the best.
            assert_eq!(judge.seen.len(), 22);
            for seen in judge.seen[..20].chunks(10) {
                assert!(seen.chunks(2).all(|pair| pair[0] == pair[1]), "{seen:?}");
                assert!(seen.windows(3).step_by(2).all(|w| w[2] < w[0]), "{seen:?}");
            }
            // Each half has its own reach.
            for half in judge.reaches[..20].chunks(10) {
                assert!(half[0].is_some() && half.iter().all(|r| *r == half[0]));
            }
            assert_ne!(judge.reaches[0], judge.reaches[10]);
            let ridge_penalty = likes_small.then_some(CANDIDATES[3]);
            // An observer that gains nothing is not taken.
            let choice = Choice { ridge_penalty, leave_pressing: false, observer: 0 };
            assert_eq!(found, choice.on(cfg.clone()));
            // What was fitted for the choice is what a fit with it gives.
            let tokens = tokeniser(&data, &found).unwrap();
            let taken = linear.unwrap().suiting(&data, &found, &tokens).unwrap();
            let (_, _, encoder) = prepare(&data, &found, None, 2, &Cancel::default()).unwrap();
            assert_eq!(taken.weights(), encoder.ridge.unwrap().weights());
        }
        let stopped = choose(&data, &cfg, 2, &mut Stopper, &Silent, &Cancel::default());
        assert!(matches!(stopped, Err(Error::Net(robert_net::Error::Stopped))), "{stopped:?}");
    }
}
